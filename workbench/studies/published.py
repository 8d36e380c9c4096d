"""The published tables of studies, as they come with the project.

Where a trial has numbers for every robot, these stand in rows of their own, and the whole
formation's in a row without a robot; ``formation`` and ``per_robot`` take them apart.

>>> table = pd.DataFrame({"seed": [1, 1, 1], "robot": [None, 1, 2], "losses": [5, 2, 3]})
>>> formation(table)["losses"].tolist(), per_robot(table, "losses")[2].tolist()
([5], [3])
"""

import pandas as pd

from workbench import paths

FOLDER = paths.DATA / "studies"


def load_study(name: str) -> pd.DataFrame:
    """Return the published table of a study.

    Raises:
        FileNotFoundError: it has not been run yet.
    """
    path = FOLDER / f"{name}.csv"
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist; run: python -m workbench study {name}")
    # a whole formation has no robot: whole numbers that may be missing
    table = pd.read_csv(path, dtype={"robot": "Int64"})
    return table.copy()  # in one piece: columns can be added without a warning


def formation(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of whole formations: one per trial, in the table's order."""
    return table[table["robot"].isna()].reset_index(drop=True)


def per_robot(table: pd.DataFrame, value: str) -> pd.DataFrame:
    """Return one column as a row per trial, in the table's order, and a column per robot."""
    rows = table[table["robot"].notna()]
    robots = sorted(rows["robot"].unique())
    return pd.DataFrame(rows[value].to_numpy().reshape(-1, len(robots)), columns=robots)
