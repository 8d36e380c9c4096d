"""How does the learner compare with classical control (E10)?"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import SETTINGS
from workbench.formation.laws.table import LAWS
from workbench.lab.statistics import interval
from workbench.lab.study import Case, Study, by_robot
from workbench.lab.trial import Trial
from workbench.measures.comparisons import by_condition
from workbench.measures.verdicts import (
    SIMILAR_DEG,
    SIMILAR_MM,
    SIMILAR_TURNING,
    Verdict,
    no_worse,
    ruling,
)
from workbench.plots.runs import intervals_by_case
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.studies.motion_trials import measure_motion
from workbench.studies.published import formation, per_robot

LEARNING = 400_000  # updates of the learners
DRIVERS = (
    "learner",
    "tractrix",
    "carrot, tuned",
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
    for noise, mm, kept in (
        ("none", 0.0, "none"),
        ("2 mm, 2°", 2.0, "none"),
        (FILTERED, 2.0, "alpha-beta"),
    ):
        for controller in DRIVERS:
            learns = controller in ("learner", "quantised carrot")
            if controller == "tractrix" and noise != "none":
                continue  # it senses nothing
            if noise == FILTERED and controller not in ("learner", "carrot, tuned"):
                continue
            for name in TILES if learns else ("paper",):
                config = replace(
                    SETTINGS[name],
                    drive="rolling",
                    noise_distance_m=mm / 1000,
                    noise_bearing_rad=math.radians(mm),
                    filter=kept,
                )
                trial = Trial(config=config, controller=controller, steps=LEARNING, minutes=20.0)
                cases.append(({"controller": controller, "setting": name, "noise": noise}, trial))
    return cases


FILTERED = "2 mm, 2°, filtered"
TILES = {"paper": "paper's tiles", "offset": "offset tilings", "recommended": "recommended"}
LEARNERS = tuple(f"learned, {tiles}" for tiles in TILES.values())
PEERS = ("carrot, tuned", "carrot", "pursuit", "path")  # told what the learner is, no giving up
ORDER = (
    *LEARNERS,
    *(f"quantised carrot, {tiles}" for tiles in TILES.values()),
    "carrot, tuned",
    *(name for name in LAWS if name != "l-psi"),
    "l-psi",
    "l-psi, point half way",
    "tractrix",
)
PANELS = {
    "following_bias_mm": "bias in mm",
    "following_ripple_mm": "ripple in mm",
    "following_bearing_std_deg": "bearing spread in °",
    "judder_ratio": "judder J₁/J₀",
    "turning": "turning above 1 Hz in °/s",
}
TICKS = (
    (0.01, 0.1, 1, 10),
    (0.2, 1, 5, 20),
    (0.2, 1, 5, 20),
    (0.2, 0.5, 1, 2),
    (1, 5, 20, 50),
)
# measure → its words, the margin of being similar, and whether it is one of a ratio
COMPARED = {
    "following_rms_distance_error_mm": ("mm RMS", SIMILAR_MM, False),
    "following_bearing_std_deg": ("° spread", SIMILAR_DEG, False),
    "turning": ("turning", SIMILAR_TURNING, True),
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
    """Return learner minus peer (turning: over peer), paired by seed, for every noise, learner,
    peer and measure; ``fine`` where the whole interval lies within the margin of being similar.
    """
    lines = []
    for noise, part in drives(table).groupby("noise", sort=False):
        runs = {who: of.set_index("seed") for who, of in part.groupby("who")}
        for who, peer in itertools.product(LEARNERS, PEERS):
            if peer not in runs:
                continue
            for value, (words, margin, ratio) in COMPARED.items():
                own, other = runs[who][value], runs[peer][value]
                effect = interval(own / other if ratio else own - other)
                fine = no_worse(effect[2], margin)
                lines.append((noise, who, peer, words, *effect, fine))
    columns = ["noise", "learner", "beside", "measure", "value", "low", "high", "fine"]
    return pd.DataFrame(lines, columns=columns)


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw errors, judder and turning of everybody who drives, with and without noise."""
    every = drives(table)
    robots = every[every["controller"] != "tractrix"]
    rod = every.loc[every["controller"] == "tractrix", "judder_ratio"].mean()
    rows = [by_condition(robots, ["who", "noise"], v).assign(quantity=v) for v in PANELS]
    fig = Figure(figsize=(13.0, 6.0), layout="constrained")
    axes = fig.subplots(1, len(PANELS), sharey=True)
    for ax, (value, words), lines, at in zip(axes, PANELS.items(), rows, TICKS, strict=True):
        marked = {"pulled rod": rod} if value == "judder_ratio" else {}
        intervals_by_case(lines, "value", rows="who", colours="noise", lines=marked, ax=ax)
        ax.set(xlabel=words, xscale="log")
        ax.set_xticks(at, [f"{number:g}" for number in at])
        ax.minorticks_off()
        ax.get_legend().remove()
    handles = axes[list(PANELS).index("judder_ratio")].get_legend_handles_labels()
    fig.legend(*handles, loc="outside lower center", ncols=4)
    return fig, pd.concat(rows)


def verdict(table: pd.DataFrame) -> Verdict:
    """Decide E10 for the paper's tiles beside the tuned carrot without noise: similar in distance,
    then in bearing and turning, with nobody lost, at the price of training.
    """
    every = drives(table)
    clean = every[every["noise"] == "none"]
    answer = beside_peers(table)
    tuned = answer[(answer["noise"] == "none") & (answer["beside"] == "carrot, tuned")]
    words, fine = {}, {}
    for who in LEARNERS:
        pair = tuned[tuned["learner"] == who].set_index("measure")
        fine[who] = pair["fine"].tolist()
        words[who] = ", ".join(
            f"{measure} {line.value:.2f} [{line.low:.2f}, {line.high:.2f}]"
            for measure, line in zip(pair.index, pair.itertuples(), strict=True)
        )
    paper = clean[clean["who"] == LEARNERS[0]]
    lost = clean[clean["who"].isin([LEARNERS[0], "carrot, tuned"])]["following_losses"] > 0
    price = interval(paper["learning_losses"])
    because = (
        f"paper's tiles beside the tuned carrot (difference, turning as a ratio): "
        f"{words[LEARNERS[0]]}; margins {SIMILAR_MM:g} mm, {SIMILAR_DEG:g}°, "
        f"{SIMILAR_TURNING:g} ×; drives that lost anybody: {int(lost.sum())} of {len(lost)}. "
        f"Training: {price[0]:.0f} [{price[1]:.0f}, {price[2]:.0f}] losses in "
        f"{LEARNING / 4 * CONTROL_PERIOD / 3600:.1f} h; n = {STUDY.seeds} seeds"
    )
    fails = (
        "an interval of the difference in RMS distance that reaches beyond 0.5 mm; then in bearing "
        "or turning, a frozen drive that loses anybody, or training without losses"
    )
    claim = (
        "Compared to classical control, our results are quite similar and comparable, but training "
        "takes some time."
    )
    parts = (*fine[LEARNERS[0]], not lost.any(), price[1] > 0)
    ours = _others(answer, words)
    return Verdict("E10", claim, ruling(*map(bool, parts)), because, fails, ours)


def _others(answer: pd.DataFrame, words: Mapping[str, str]) -> str:
    """Return how the followers that are not the paper's stand beside their peers."""
    within = answer.groupby("learner", sort=False)["fine"].agg(["sum", "size"])
    counts = ", ".join(f"{who} {row['sum']} of {row['size']}" for who, row in within.iterrows())
    told = "; ".join(f"{who}: {words[who]}" for who in LEARNERS[1:])
    return f"{told}. Within the margins, all noises and peers: {counts}"


STUDY = Study(
    "controllers",
    __doc__,
    cases,
    function=measure_motion,
    rows=by_robot(0, 1, 2, 3, 4),
    plots={"controllers": plot},
    verdicts={"E10": verdict},
)
