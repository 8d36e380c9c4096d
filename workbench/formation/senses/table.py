"""The sensing modes: a row each, see ``senses.sense``."""

from typing import Any

from workbench.compiled import chosen
from workbench.formation import virtual
from workbench.formation.senses import camera, infrared, range_bearing, truth
from workbench.formation.senses.sense import Draw, Sense

_ROWS = (
    Sense(
        "truth",
        "reads the simulator's poses",
        ("distance", "bearing", "odometry", "heading", "speed", "turning rate"),
        truth.see,
        see_place=virtual.see,
    ),
    Sense(
        "truth-relative",
        "only distance and bearing of them",
        ("distance", "bearing", "odometry"),
        truth.see,
        see_place=virtual.see,
    ),
    *camera.MODES,
    *infrared.MODES,
    range_bearing.MODE,
)
SENSES = {row.name: row for row in _ROWS}
# what each mode tells a follower
SENSING = {row.name: row.gives for row in _ROWS}
CAMERA = tuple(row.name for row in camera.MODES)
INFRARED = tuple(row.name for row in infrared.MODES)


def _distinct(parts: Any) -> list[Any]:
    return list(dict.fromkeys(parts))


# fields that modes add to the records of the loop
ROBOT_PARTS = _distinct(part for row in _ROWS for part in row.robot)
TASK_PARTS = _distinct(part for row in _ROWS for part in row.task)
DRAWS: list[Draw] = []
for _draw in (draw for row in _ROWS for draw in row.draws):
    if _draw not in DRAWS:
        DRAWS.append(_draw)

_COLUMNS = {
    column: _distinct(getattr(row, column) for row in _ROWS)
    for column in ("locate", "see", "tiled", "errors", "trimmed")
}
# places of a shape take the place of robots in front
_COLUMNS["locate"].append(virtual.locate)
_COLUMNS["see"] = _distinct(
    [*_COLUMNS["see"], *(row.see_place for row in _ROWS if row.see_place is not None)]
)
KEEPING = tuple(row.name for row in _ROWS if row.see_place is not None)
SENSE_FIELDS = [(column, "i8") for column in _COLUMNS]  # fields of TASK.sense
locate = chosen(_COLUMNS["locate"])
see = chosen(_COLUMNS["see"])
tiled = chosen(_COLUMNS["tiled"])
errors = chosen(_COLUMNS["errors"])
trimmed = chosen(_COLUMNS["trimmed"])


def numbers(sensing: str, *, shaped: bool = False) -> dict[str, int]:
    """Return the fields of TASK.sense: which compiled functions a mode has, or one whose followers
    keep places.
    """
    row = SENSES[sensing]
    chosen = {column: getattr(row, column) for column in _COLUMNS}
    if shaped:
        chosen["locate"] = virtual.locate
        chosen["see"] = row.see_place
    return {column: found.index(chosen[column]) for column, found in _COLUMNS.items()}
