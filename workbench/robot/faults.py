"""What can go wrong between a program and a robot. No other errors come from a link."""


class RobotError(Exception):
    """Something is wrong with the robot or the link to it."""


class LinkTimeout(RobotError):
    """No reply, or only a part of it, in time. The link may still be alive."""


class LinkLost(RobotError):
    """The link is gone. The robot may still be moving."""


class BadReply(RobotError):
    """A reply that cannot be right."""


class NotSupported(RobotError):
    """This back-end cannot do that; see ``capabilities``."""


class NotConnected(RobotError):
    """Call ``connect`` first, or use a ``with`` block."""
