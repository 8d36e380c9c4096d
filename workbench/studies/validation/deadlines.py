"""How often the control loop keeps its 0.1 s on the link of the paper's robots: an Overo module,
230400 baud to the e-puck.

The link is emulated: the real protocol on a real pseudo-terminal, with bytes as slow as on the
wire, round a simulated robot that moves on in real time. The loop learns while it drives. An update
takes this computer's time and in addition that of a slower one: a dense update of all weights, as
in a textbook NumPy program, times a stated factor (``studies.tables.update_time_s``). How slow the
paper's module was nobody measured, so the table goes over factors.

With the update buffer (paper II-D) the command is sent before the transition is learned, without it
afterwards. Two deadlines tell these apart: whether a control period begins in time, and whether a
command comes within 0.1 s of its readings.

Contract: times are of the computer that measures, so two measurements differ; nothing here feeds
back into the simulator.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pandas as pd

from workbench import paths
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.policy import Policy
from workbench.formation.simulated import SimulatedRobot
from workbench.formation.solo import SoloFollower
from workbench.lab.runs import learn
from workbench.lab.storage import write_json, write_table
from workbench.logs.driving import drive
from workbench.robot.open import open_robot
from workbench.robot.wire.emulator import Emulator
from workbench.studies.tables import update_time_s

BAUD = 230_400
FACTORS = (0.0, 2000.0, 3000.0, 4000.0, 5000.0)
TABLES = {"9×9 states, 7×7 actions": ((9, 9), (7, 7)), "5×5 states, 3×3 actions": ((5, 5), (3, 3))}
SMALL_TABLE_FACTORS = (4000.0, 5000.0)
LEARNED = 60_000  # updates before the drive, so that the robot follows


def measure_deadlines(
    *,
    seconds: float = 8.0,
    seeds: int = 10,
    factors: Sequence[float] = FACTORS,
    out: Path | None = None,
) -> dict[str, Any]:
    """Drive all conditions in real time, write deadlines.csv (a line per drive) and deadlines.json,
    and return the medians.

    Args:
        seconds: of each drive.
        seeds: drives per condition.
        factors: how many times slower than a desktop computer updates are; 0 adds nothing.
        out: folder of the table, default data/validation/.
    """
    folder = out or paths.DATA / "validation"
    folder.mkdir(parents=True, exist_ok=True)
    lines = []
    for table in TABLES:
        lines += _drives(table, factors, seeds, seconds)
    frame = pd.DataFrame(lines)
    write_table(folder / "deadlines.csv", frame, digits=4)
    write_json(
        folder / "deadlines.json",
        {
            "what": "control loop on an emulated Overo link in real time, learning while it "
            "drives; simulated robot",
            "baud": BAUD,
            "seconds_per_drive": seconds,
            "seeds": seeds,
            "drives": len(frame),
            "updates_before": LEARNED,
            "sensing": SETTINGS["infrared"].sensing,
            "tables": list(TABLES),
            "factors": list(factors),
        },
    )
    medians = frame.groupby(["table", "factor", "buffer"], sort=False)[
        ["periods_met", "commands_met", "latency_ms"]
    ].median()
    return {
        "medians": medians.reset_index().to_dict("records"),
        "written": ["deadlines.csv", "deadlines.json"],
    }


def _drives(
    table: str, factors: Sequence[float], seeds: int, seconds: float
) -> list[dict[str, Any]]:
    """Return a line per drive with one of TABLES."""
    states, actions = TABLES[table]
    lines = []
    base = replace(SETTINGS["infrared"], followers=1, state_tiles=states, action_levels=actions)
    policy = learn(replace(base, drive="planar"), steps=LEARNED, progress=False).policy
    assert isinstance(policy, Policy)
    for factor in factors if states == (9, 9) else [f for f in SMALL_TABLE_FACTORS if f in factors]:
        for buffer in (True, False):
            for seed in range(1, seeds + 1):
                config = replace(base, learner=replace(base.learner, buffer=buffer), seed=seed)
                label = {
                    "table": table,
                    "factor": factor,
                    "buffer": "on" if buffer else "off",
                    "seed": seed,
                }
                update_s = update_time_s(factor, config)
                lines.append(
                    label
                    | {"update_ms": 1000 * update_s}
                    | _drive(config, policy, update_s, seconds)
                )
    return lines


def _drive(
    config: ConvoyConfig, policy: Policy, update_s: float, seconds: float
) -> dict[str, float]:
    """Drive once behind a new leader and return shares of deadlines met, latencies in ms and
    losses.
    """
    follower = SoloFollower(config, policy, steps=100_000)
    with (
        Emulator(SimulatedRobot(config), "overo", baud=BAUD) as emulator,
        open_robot(emulator.url) as robot,
    ):
        robot.calibrate_proximity_sensors()
        report = asdict(drive(robot, follower, seconds=seconds, update_s=update_s))
    periods = report["periods"]
    return {
        "periods": periods,
        "periods_met": 1 - report["missed"] / periods,
        "commands_met": 1 - report["late_commands"] / periods,
        "latency_ms": 1000 * report["command_latency_s"],
        "worst_start_ms": 1000 * report["worst_latency_s"],
        "updates": report["updates"],
        "losses": report["losses"],
    }
