"""How does the learner compare with classical control (E10)?"""

import math
from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import SETTINGS
from workbench.formation.laws.table import LAWS
from workbench.lab.statistics import interval
from workbench.lab.study import Case, Study, by_robot
from workbench.lab.trial import Trial
from workbench.measures.comparisons import by_condition, difference
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.runs import intervals_by_case
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.studies.motion_trials import measure_motion
from workbench.studies.published import formation, per_robot

LEARNING = 400_000  # updates of the learners
DRIVERS = (
    "learner",
    "tractrix",
    "carrot",
    "leader-frame",
    "l-psi",
    "l-psi, point half way",
    "pursuit",
    "path",
    "quantised carrot",
)


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    for noise, mm, degrees in (("none", 0.0, 0.0), ("2 mm, 2°", 2.0, 2.0)):
        for controller in DRIVERS:
            if controller == "tractrix" and noise != "none":
                continue  # it senses nothing
            for name in (
                ("paper", "recommended")
                if controller in ("learner", "quantised carrot")
                else ("paper",)
            ):
                config = replace(
                    SETTINGS[name],
                    drive="rolling",
                    noise_distance_m=mm / 1000,
                    noise_bearing_rad=math.radians(degrees),
                )
                trial = Trial(config=config, controller=controller, steps=LEARNING, minutes=20.0)
                cases.append(({"controller": controller, "setting": name, "noise": noise}, trial))
    return cases


TILES = {"paper": "paper's tiles", "recommended": "recommended"}
LEARNERS = tuple(f"learned, {tiles}" for tiles in TILES.values())
PEERS = ("carrot", "pursuit", "path")  # told what the learner is, without giving up
ORDER = (
    *LEARNERS,
    *(f"quantised carrot, {tiles}" for tiles in TILES.values()),
    *(name for name in LAWS if name != "l-psi"),
    "l-psi",
    "l-psi, point half way",
    "tractrix",
)
PANELS = {
    "following_rms_distance_mm": "RMS distance error in mm",
    "following_bearing_std_deg": "bearing spread in °",
    "judder_ratio": "judder J₁/J₀",
    "turning": "turning above 1 Hz in °/s",
}
TICKS = (
    (0.5, 1, 2, 5, 20),
    (0.2, 1, 5, 20),
    (0.2, 0.5, 1, 2),
    (1, 2, 5, 20, 50),
)
COMPARED = {
    "following_rms_distance_mm": "mm RMS",
    "following_bearing_std_deg": "° spread",
    "judder_ratio": "J₁/J₀",
    "turning": "turning",
    "variation": "Σ|Δu|",
}


def drives(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per drive: who drove, the formation's numbers, and the smoothness of its robots.

    ``judder_ratio``, ``gain_1``, ``excess_1`` and ``product_4`` are ``judder``'s of the follower
    with that number; ``turning`` (°/s RMS above 1 Hz) and ``variation`` (m/s per m) are means over
    the four followers.
    """
    short = {"learner": "learned", "quantised carrot": "quantised carrot"}
    found = formation(table)
    pairs = zip(found["controller"], found["setting"], strict=True)
    judder = per_robot(table, "judder_mm")
    followers = [1, 2, 3, 4]
    variation = per_robot(table, "variation_mm_s_per_m")[followers].mean(axis=1, skipna=False)
    who = [f"{short[c]}, {TILES[s]}" if c in short else c for c, s in pairs]
    found = found.assign(
        who=who,
        rank=[ORDER.index(name) for name in who],
        judder_ratio=judder[1] / judder[0],
        gain_1=per_robot(table, "gain")[1],
        excess_1=per_robot(table, "excess")[1],
        product_4=per_robot(table, "product")[4],
        turning=per_robot(table, "turn_rms_deg_s")[followers].mean(axis=1),
        variation=variation / 1000,
    )
    return found.sort_values(["noise", "rank", "seed"], ascending=[False, True, True])


def beside_peers(table: pd.DataFrame) -> pd.DataFrame:
    """Return learner minus peer, paired by seed, for every noise, learner, peer and measure;
    ``fine`` where the learner is not clearly worse.
    """
    lines = []
    for noise, part in drives(table).groupby("noise", sort=False):
        for who in LEARNERS:
            for peer in PEERS:
                pair = part[part["who"].isin([who, peer])]
                for value, words in COMPARED.items():
                    row = difference(pair, ["who"], value, {"who": peer}).set_index("who").loc[who]
                    effect = [row[name] for name in ("value", "low", "high")]
                    lines.append((noise, who, peer, words, *effect, bool(effect[1] <= 0)))
    columns = ["noise", "learner", "beside", "measure", "value", "low", "high", "fine"]
    return pd.DataFrame(lines, columns=columns)


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw errors, judder and turning of everybody who drives, with and without noise."""
    every = drives(table)
    robots = every[every["controller"] != "tractrix"]
    rod = every.loc[every["controller"] == "tractrix", "judder_ratio"].mean()
    rows = [by_condition(robots, ["who", "noise"], v).assign(quantity=v) for v in PANELS]
    fig = Figure(figsize=(12.0, 5.6), layout="constrained")
    fig.set_layout_engine("constrained", w_pad=0.1)  # inches: room for the longest name
    axes = fig.subplots(1, 4, sharey=True)
    for ax, (value, words), lines, at in zip(axes, PANELS.items(), rows, TICKS, strict=True):
        marked = {"pulled rod": rod} if value == "judder_ratio" else {}
        intervals_by_case(lines, "value", rows="who", colours="noise", lines=marked, ax=ax)
        ax.set(xlabel=words, xscale="log")
        ax.set_xticks(at, [f"{number:g}" for number in at])
        ax.minorticks_off()
        ax.get_legend().remove()
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return fig, pd.concat(rows)


def verdict(table: pd.DataFrame) -> Verdict:
    """Decide E10: nobody lost on either side, and not clearly worse in any measure."""
    every = drives(table)
    clean = every[every["noise"] == "none"]
    answer = beside_peers(table)
    counts = answer.groupby(["learner", "beside"], sort=False)["fine"].agg(["sum", "size"])
    beside = "; ".join(
        f"{who} beside {peer} {row['sum']} of {row['size']}"
        for (who, peer), row in counts.iterrows()
    )
    gap = answer[(answer["beside"] == "carrot") & (answer["noise"] == "none")]
    said = {
        measure: "; ".join(
            f"{line.learner} {line.value:.2f} [{line.low:.2f}, {line.high:.2f}]"
            for line in gap[gap["measure"] == measure].itertuples()
        )
        for measure in ("mm RMS", "turning")
    }
    learned = clean[clean["controller"] == "learner"].groupby("setting", sort=False)
    price = "; ".join(
        "{}: {:.0f} [{:.0f}, {:.0f}] losses while learning".format(TILES[setting], *interval(lost))
        for setting, lost in learned["learning_losses"]
    )
    measures = answer.groupby("measure", sort=False)["fine"].agg(["sum", "size"])
    each = ", ".join(f"{name} {row['sum']} of {row['size']}" for name, row in measures.iterrows())
    losses = int(clean[clean["who"].isin(LEARNERS + PEERS)]["following_losses"].sum())
    because = (
        f"losses, learners and peers together: {losses}. Not clearly worse, of all comparisons by "
        f"measure: {each}; by pair (5 measures × 2 noises): {beside}. Without noise, learner − "
        f"carrot: mm RMS {said['mm RMS']}; turning °/s {said['turning']}. The price: {price}, in "
        f"{LEARNING / 4 * CONTROL_PERIOD / 3600:.1f} h; n = {STUDY.seeds} seeds."
    )
    claim = (
        "Compared to classical control, our results are quite similar and comparable, but training "
        "takes some time."
    )
    return Verdict("E10", claim, ruling(losses == 0, *map(bool, answer["fine"])), because)


STUDY = Study(
    "controllers",
    __doc__,
    cases,
    function=measure_motion,
    rows=by_robot(0, 1, 2, 3, 4),
    plots={"controllers": plot},
    verdicts={"E10": verdict},
)
