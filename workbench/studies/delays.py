"""How late may commands come for weights from the simulation (E8, E9)?"""

from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure

from workbench.lab.study import Case, Rows, Study
from workbench.lab.trial import Trial
from workbench.measures.comparisons import by_quantity
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import curve_panels, one_note
from workbench.plots.style import note
from workbench.studies.conditions import travels
from workbench.studies.published import load_study
from workbench.studies.transfer import judged
from workbench.studies.transfer_trials import (
    DELAYS,
    measure_delays,
)


def cases() -> Sequence[Case]:
    """Return the conditions."""
    return [
        (label, Trial(config=config, steps=steps, minutes=30.0))
        for label, config, steps in travels()
    ]


VALUES = {
    "share_inside": "share of time inside the bounds",
    "degradation": "RMS distance error / nominal",
}


def against_nominal(table: pd.DataFrame) -> pd.DataFrame:
    """Return the drives in judging worlds, with degradation (their RMS distance error over that in
    the nominal simulation), ``late`` (s) and ``case`` (route and table).
    """
    keys = ["route", "table", "seed"]
    nominal = table[table["world"] == "nominal"].set_index(keys)["rms_distance_mm"]
    late = table[table["world"] == "judging"].sort_values("late_s", kind="stable")
    own = nominal.loc[pd.MultiIndex.from_frame(late[keys])].to_numpy()
    return late.assign(
        degradation=late["rms_distance_mm"] / own,
        late=late["late_s"],
        case=late["route"] + ", " + late["table"],
    )


def by_delay(table: pd.DataFrame) -> pd.DataFrame:
    """Return share inside and degradation by how late (s) commands come, per case (route and
    table).
    """
    groups = against_nominal(table).groupby("late")
    return pd.concat(by_quantity(part, ["case", "late"], VALUES) for _, part in groups)


def losses_by_delay(table: pd.DataFrame) -> pd.DataFrame:
    """Return losses over all worlds, worlds without any, and the worst degradation, by how late
    commands come.
    """
    return (
        against_nominal(table)
        .groupby(["route", "table", "late"], sort=False)
        .agg(
            losses=("losses", lambda lost: int(lost.sum())),
            without_loss=("losses", lambda lost: int((lost == 0).sum())),
            worst_degradation=("degradation", "max"),
        )
    )


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw time inside and errors against how late commands come."""
    late, label = against_nominal(table), "commands late by (s), emulated"
    fig = curve_panels(late, "case", "late", VALUES, xlabel=label, size=(9.6, 3.9), legends=(1,))
    left, right = fig.axes
    right.axhline(1.5, color="#777777", linewidth=0.8)
    one_note(fig.axes)
    note(left, f"mean, 95 % bootstrap interval over worlds, n = {STUDY.seeds}")
    return fig, by_delay(table)


def verdict(table: pd.DataFrame) -> Verdict:
    """Decide E8: no losses and errors within 1.5 of nominal, in time and as late as worlds are."""
    lost = losses_by_delay(table).loc["camera"]
    drawn = judged(load_study("transfer"))
    drawn = drawn[(drawn["route"] == "camera") & (drawn["training"] == "nominal")]
    parts = []
    words = []
    for name in ("9×9/7×7", "5×5/3×3"):
        in_time, late = lost.loc[(name, 0.0)], drawn[drawn["table"] == name]
        for when, losses, error in (
            ("in time", in_time["losses"], in_time["worst_degradation"]),
            (
                "as late as the worlds have them",
                late["judged_losses"].sum(),
                late["degradation"].max(),
            ),
        ):
            parts += [bool(losses == 0), bool(error <= 1.5)]
            words.append(
                f"{name}, commands {when}: {losses:.0f} losses, worst error {error:.2f} × nominal"
            )
    claim = "Weights learned in simulation drive the real robot with absolute coordinates."
    because = "nominal weights, four followers, 30 min in ten emulated worlds. " + "; ".join(words)
    return Verdict("E8", claim, ruling(*parts), because)


ROWS = Rows(
    ("world", "late_s"),
    {("nominal", 0.0): "nominal_{}"} | {("judging", k / 10): f"delay_{k}_{{}}" for k in DELAYS},
)
STUDY = Study(
    "delays",
    __doc__,
    cases,
    function=measure_delays,
    rows=ROWS,
    plots={"late_commands": plot},
    verdicts={"E8": verdict},
)
