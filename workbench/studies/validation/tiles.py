"""Where real infrared readings fall among the tiles of a follower, beside the model's in the same
situation.

The situation: an e-puck2 backs off from an object straight ahead, recorded in four runs
(``validation.infrared``). Taken are the rows with a gap of 6 to 56 mm, which are the bounds of the
setting "infrared" between two paper cups; its readings go through the follower's own perception.
The object is no cup but reads like a wall, so that the model's reading is that of a wall too: as
the nominal sensor has it (gain 1), and with the gain that fits this sensor in this run on even
rows. Counted are odd rows: as recorded (single samples, some 0 beside neighbours of hundreds), and
as the median of five odd rows (4.8 mm of driving). A run's first gap is fitted as well, so that
distances are known from readings and from how far the robot drove.

A follower has learned in the nominal simulation, ten seeds. A tile counts as reached if the seeds
together were there in at least one of 10 000 steps; what the policy would do is compared seed by
seed.

Contract: recordings stay where they are; only aggregates are written, and nothing feeds back into
the simulator.
"""

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from workbench import paths
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.policy import Policy
from workbench.formation.senses.table import INFRARED
from workbench.lab.runs import learn
from workbench.lab.storage import write_json, write_table
from workbench.logs.importers import PS, wii42_backing_off
from workbench.measures.off_policy import perceive
from workbench.robot.infrared import BEARINGS, CONTACT, SENSORS, saturate
from workbench.studies.validation.infrared import FOLDER, fit_run, wall_light

LEFT = 7
RIGHT = 0
GAP_MM = (6.0, 56.0)  # shell to shell of two cups at 80 and at 130 mm
REACHED = 1e-4
FILTERS = (1, 5)  # rows
SEEDS = 10
STEPS = 100_000


def _config(route: str, states: int, actions: int) -> ConvoyConfig:
    return replace(
        SETTINGS["infrared"],
        drive="planar",
        followers=1,
        sensing=route,
        state_tiles=(states, states),
        action_levels=(actions, actions),
    )


def validate_tiles(
    *, out: Path | None = None, seeds: int = SEEDS, steps: int = STEPS
) -> dict[str, Any]:
    """Write tiles.csv, tile_changes.csv and tiles.json; return the aggregates.

    Args:
        out: folder of the aggregates, default data/validation/.
        seeds, steps: runs that learn in simulation, and the updates of each.

    Raises:
        FileNotFoundError: WORKBENCH_RECORDINGS or the recordings in it are missing.
    """
    recorded = wii42_backing_off(paths.recordings())
    filtered = {
        f"median of {n} rows" if n > 1 else "as recorded": {
            k: _situations(f, n) for k, f in recorded.items()
        }
        for n in FILTERS
    }
    lines = []
    changes = []
    for route in INFRARED:
        for states, actions in ((9, 7), (5, 3)):
            config = _config(route, states, actions)
            policies, visits = _learned(config, seeds, steps)
            reached = visits >= REACHED * visits.sum()
            label = {"route": route, "table": f"{states}×{states}/{actions}×{actions}"}
            found, moved = _compare_places(config, policies, reached, filtered)
            lines += [label | line for line in found]
            changes += [label | change for change in moved]
    table = pd.DataFrame(lines)
    moved = pd.DataFrame(changes)
    folder = out or FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for name, frame in (("tiles", table), ("tile_changes", moved)):
        write_table(folder / f"{name}.csv", frame, digits=6)
    summary = table[table["run"] == "all"].drop(columns="run").to_dict("records")
    write_json(
        folder / "tiles.json",
        {
            "what": "tiles of real proximity readings, of the model's in the same situation, "
            "and of a simulated follower",
            "source": "github Wii42/Robotics_Project commit 0dd269a",
            "gap_mm": GAP_MM,
            "reached_from": REACHED,
            "seeds": seeds,
            "updates": steps,
            "aggregates": summary,
        },
    )
    return {"aggregates": summary, "written": ["tiles.csv", "tile_changes.csv", "tiles.json"]}


def _compare_places(
    config: ConvoyConfig, policies: Any, reached: Any, filtered: dict[str, Any]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return a line per kind of readings and run, and the changes of tiles between neighbours."""
    lines = []
    changes = []
    for readings, gains in product(filtered, ("nominal", "fitted")):
        runs = filtered[readings]
        seen = {"readings": readings, "model": gains}
        places = {
            name: (perceive(config, run["real"])[0], perceive(config, run[gains])[0])
            for name, run in runs.items()
        }
        real, model = (np.concatenate([pair[k] for pair in places.values()]) for k in (0, 1))
        places["all"] = (real, model)
        for name, pair in places.items():
            lines.append(seen | {"run": name} | _compare(config, policies, reached, *pair))
        changes += [seen | change for change in _changes(config, real, model)]
    return lines, changes


def _situations(frame: pd.DataFrame, rows: int) -> dict[str, NDArray[np.float64]]:
    """Return readings (n, 8) of one run's odd rows inside GAP_MM: real ones, and the model's with
    nominal and fitted gains.

    Real ones are medians of so many odd rows around each.

    All but the front sensors are set to nothing: a follower does not look at them.
    """
    gap, gains = fit_run(frame)
    place = gap + frame["row_mm"].to_numpy()
    used = (place >= GAP_MM[0]) & (place <= GAP_MM[1]) & (np.arange(len(frame)) % 2 == 1)
    found = {name: np.zeros((int(used.sum()), SENSORS)) for name in ("real", "nominal", "fitted")}
    for k in (LEFT, RIGHT):
        light = wall_light(place[used], np.full(used.sum(), abs(BEARINGS[k])))
        odd = frame[PS[k]].where(np.arange(len(frame)) % 2 == 1).dropna()
        found["real"][:, k] = (
            odd.rolling(rows, center=True, min_periods=1).median().reindex(frame.index)[used]
        )
        found["nominal"][:, k] = np.vectorize(saturate)(light, CONTACT)
        found["fitted"][:, k] = np.vectorize(saturate)(gains[k] * light, CONTACT)
    return found


def _learned(
    config: ConvoyConfig, seeds: int, steps: int
) -> tuple[list[Policy], NDArray[np.int64]]:
    policies = []
    visits = np.zeros(config.grid().n, np.int64)
    for seed in range(1, seeds + 1):
        run = learn(config.with_seed(seed), steps=steps, progress=False)
        assert isinstance(run.policy, Policy)
        policies.append(run.policy)
        visits += run.visits.sum(axis=0).ravel()
    return policies, visits


def _compare(
    config: ConvoyConfig,
    policies: list[Policy],
    reached: NDArray[np.bool_],
    real: NDArray[np.int64],
    model: NDArray[np.int64],
) -> dict[str, float]:
    """Return how many rows are inside the bounds as real readings and as the model's, and shares of
    those that are both.
    """
    inside = real >= 0
    both = (real >= 0) & (model >= 0)
    cells = [
        np.stack(np.unravel_index(states[both], config.grid().shape)) for states in (real, model)
    ]
    away = np.abs(cells[0] - cells[1]).max(axis=0, initial=0)
    same_action = (
        [
            np.mean(greedy[real[both]] == greedy[model[both]])
            for greedy in (policy.greedy()[0] for policy in policies)
        ]
        if both.any()
        else [np.nan]
    )
    return {
        "rows": len(real),
        "real_inside": int(inside.sum()),
        "model_inside": int((model >= 0).sum()),
        "both_inside": int(both.sum()),
        "share_not_seen": float(((model >= 0) & ~inside).sum() / max((model >= 0).sum(), 1)),
        "share_reached": float(reached[real[inside]].mean()) if inside.any() else np.nan,
        "share_same_tile": float((away == 0).mean()) if both.any() else np.nan,
        "share_within_one_tile": float((away <= 1).mean()) if both.any() else np.nan,
        "share_same_action": float(np.mean(same_action)),
    }


def _changes(
    config: ConvoyConfig, real: NDArray[np.int64], model: NDArray[np.int64]
) -> list[dict[str, int]]:
    """Return how many rows the model has in one tile and the recording in another (or the same),
    tile by tile; -1 is outside.
    """
    pairs, counts = np.unique(np.stack([model, real], axis=1), axis=0, return_counts=True)
    lines = []
    for (one, other), count in zip(pairs.tolist(), counts.tolist(), strict=True):
        cells = [config.grid().cells(state) if state >= 0 else (-1, -1) for state in (one, other)]
        names = ("model_first", "model_second", "real_first", "real_second")
        lines.append(dict(zip(names, (*cells[0], *cells[1]), strict=True)) | {"rows": count})
    return lines


def in_the_right_tile(tiles: pd.DataFrame) -> pd.DataFrame:
    """Return how many of the rows that the model sees inside the bounds lie in its tile, by
    readings and model.

    Args:
        tiles: lines of data/validation/tiles.csv; the shares of their routes and tables are summed
            up as lowest and highest.
    """
    share = tiles["share_same_tile"] * tiles["both_inside"] / tiles["model_inside"]
    return share.groupby([tiles["readings"], tiles["model"]]).agg(["min", "max"])
