"""``open_robot(url)``: the robot behind an address, whatever it is.

    sim:                         a simulated robot (keywords: config, robot, others, realtime)
    serial:/dev/rfcomm0          an e-puck1 (variant, binary, baud)
    board:/dev/rfcomm0           the same with a range-and-bearing board on it
    overo:/dev/ttyS0             an e-puck1 from its own Overo computer
    tcp:192.168.1.20:1000        an e-puck2
    log:path/to/recording.csv    a recording, replayed; it cannot be driven

The back-end is imported when it is asked for. The robot is not connected yet: use ``with``, or
``connect``.

>>> open_robot("sim:").capabilities >= {"proximity", "drive"}
True
"""

import importlib
from typing import Any

from workbench.robot import ends
from workbench.robot.api import Robot

ends.note_interrupts()  # before whatever else is imported and compiled

# scheme → class, what stands behind the colon, and options that the scheme stands for
BACK_ENDS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "sim": ("workbench.formation.simulated:SimulatedRobot", "", {}),
    "serial": ("workbench.robot.wire.epuck1:SerComRobot", "PORT", {}),
    "board": ("workbench.robot.wire.epuck1:SerComRobot", "PORT", {"board": True}),
    "overo": (
        "workbench.robot.wire.epuck1:SerComRobot",
        "PORT",
        {"variant": "overo", "binary": True},
    ),
    "tcp": ("workbench.robot.wire.epuck2:EPuck2Robot", "HOST[:PORT]", {}),
    "log": ("workbench.logs.replay:ReplayedRobot", "FILE", {}),
}


def open_robot(url: str, *, guardian: bool = False, **options: Any) -> Robot:
    """Return the robot behind a URL; ``options`` go to its class.

    Args:
        guardian: put a small process between this program and the wire, that stops the robot when
            this program is killed, or says nothing any more; see ``robot.guardian``. A robot
            without a wire needs none.

    Raises:
        ValueError: an unknown scheme, or a URL without an address.
        FileNotFoundError: no such recording.
    """
    scheme, colon, address = str(url).partition(":")
    if scheme not in BACK_ENDS or not colon:
        forms = [f"{name}:{place}" for name, (_, place, _) in BACK_ENDS.items()]
        raise ValueError(f"robot {url!r}; expected {', '.join(forms[:-1])} or {forms[-1]}")
    entry, place, fixed = BACK_ENDS[scheme]
    if place and not address:
        raise ValueError(f"robot {url!r} has no address; expected {scheme}:ADDRESS")
    module, name = entry.split(":")
    back_end: type[Robot] = getattr(importlib.import_module(module), name)
    if guardian and back_end.wired:
        options["guardian"] = True
    return back_end(*([address] if place else []), **(fixed | options))
