"""``open_robot(url)``: the robot behind an address, whatever it is.

    sim:                         a simulated robot (keywords: config, robot, others, realtime)
    serial:/dev/rfcomm0          an e-puck1 (variant, binary, baud)
    overo:/dev/ttyS0             an e-puck1 from its own Overo computer
    tcp:192.168.1.20:1000        an e-puck2
    log:path/to/recording.csv    a recording, replayed; it cannot be driven

The back-end is imported when it is asked for. The robot is not connected yet: use ``with``, or
``connect``.

>>> open_robot("sim:").capabilities >= {"proximity", "drive"}
True
"""

from typing import Any

from workbench.robot.api import Robot

SCHEMES = ("sim", "serial", "overo", "tcp", "log")


def open_robot(url: str, **options: Any) -> Robot:
    """Return the robot behind a URL; ``options`` go to its class.

    Raises:
        ValueError: an unknown scheme, or a URL without an address.
        FileNotFoundError: no such recording.
    """
    scheme, colon, address = url.partition(":")
    if scheme not in SCHEMES or not colon:
        raise ValueError(
            f"robot {url!r}; expected sim:, serial:PORT, overo:PORT, tcp:HOST[:PORT] or log:FILE"
        )
    if scheme != "sim" and not address:
        raise ValueError(f"robot {url!r} has no address; expected {scheme}:ADDRESS")
    if scheme == "sim":
        from workbench.formation.simulated import SimulatedRobot

        return SimulatedRobot(**options)
    if scheme == "tcp":
        from workbench.robot.epuck2 import EPuck2Robot

        return EPuck2Robot(address, **options)
    if scheme == "log":
        from workbench.study.replay import ReplayedRobot

        return ReplayedRobot(address, **options)
    from workbench.robot.epuck1 import SerComRobot

    if scheme == "overo":
        options = {"variant": "overo", "binary": True} | options
    return SerComRobot(address, **options)
