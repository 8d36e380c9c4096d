"""The wheel in a person's hands: what a joystick or keys make of the leader, no faster than its
followers can keep up with.

Both axes run from -1 to 1: ``turn`` is positive to the left, ``speed`` positive forwards. The
leader

* drives at most as fast as the leader of the configuration, behind which its followers learned (and
  at most nine tenths of their fastest level, so that they can also catch up), and never backwards
  into them;
* where followers cannot stand still (their slowest level is above 0), does not drive more slowly
  than that level either;
* turns by at most 1 rad/s, with no wheel faster than theirs;
* changes its speed by at most 0.1 m/s² (times the robot's pace against an e-puck's).

>>> from workbench.formation.config import ConvoyConfig
>>> joystick = Joystick(ConvoyConfig(wheel_speed_mps=(0.0, 0.09)))
>>> [joystick.steer(0.0, 1.0) for _ in range(3)]
[(78, 78), (155, 155), (233, 233)]

Contract: a joystick remembers its speed; one call is one control period. All limits are our choice.
"""

import math

from workbench.formation.config import ConvoyConfig
from workbench.robot.description import EPUCK
from workbench.robot.geometry import CONTROL_PERIOD

SHARE = 0.9  # of the followers' fastest level
TURN = 1.0  # rad/s
ACCELERATION = 0.1  # m/s² of an e-puck


class Joystick:
    """Turn the position of a joystick into a leader's wheel commands.

    Attributes:
        slowest, fastest: m/s of the leader.
        speed_mps: its speed now.
    """

    def __init__(self, config: ConvoyConfig) -> None:
        low, high = config.wheel_speed_mps
        self._robot = config.robot
        self._high = high
        self.fastest = min(SHARE * high, config.leader_speed_mps)
        self.slowest = min(max(low, 0.0), self.fastest)
        self._change = ACCELERATION * config.robot.most_mps / EPUCK.most_mps * CONTROL_PERIOD
        self.speed_mps = self.slowest

    def steer(self, turn: float, speed: float) -> tuple[int, int]:
        """Return the leader's wheel commands in whole steps/s for this control period.

        Args:
            turn, speed: position of the joystick, clipped to -1 to 1; what is no number counts as
                0.
        """
        turn, speed = (
            min(max(value, -1.0), 1.0) if math.isfinite(value) else 0.0 for value in (turn, speed)
        )
        wanted = self.slowest + max(speed, 0.0) * (self.fastest - self.slowest)
        self.speed_mps += min(max(wanted - self.speed_mps, -self._change), self._change)
        half = turn * TURN * self._robot.track_m / 2
        half = min(max(half, -self._high / 2), self._high / 2)
        middle = min(self.speed_mps, self._high - abs(half))
        return self._robot.steps(middle - half), self._robot.steps(middle + half)
