"""One trial of a study: learn with one configuration and seed, then follow the learned policy
greedily on an unseen track.

``measure`` and ``measure_sections`` turn a Trial into one line of a table: plain numbers, the same
in any process. Lengths are in mm, angles in degrees, rates per follower and hour. A number that
does not exist (a criterion never reached, errors where nobody followed) is NaN.

>>> trial = Trial(config=ConvoyConfig(followers=1, drive="planar"), steps=300, minutes=1.0)
>>> sorted(measure(trial))[:3]
['bearing_std_deg_last_third', 'greedy_bearing_mean_deg', 'greedy_bearing_std_deg']
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.arena.drives.table import DRIVES
from workbench.arena.tracks import Track, TrackConfig
from workbench.fields import choice, configuration, integer, part, real
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import BLOCK, Convoy
from workbench.formation.follower import GAVE_UP, LOSS, RECOVERED, TIMED_OUT
from workbench.formation.laws.carrot import CarrotPI
from workbench.formation.laws.l_psi import LPsi
from workbench.formation.laws.table import LAWS, Controller, quantised_carrot
from workbench.formation.reset import FOLLOW
from workbench.lab.records import SUMS
from workbench.lab.runs import UNSEEN, Run, evaluate, learn
from workbench.robot.geometry import CONTROL_PERIOD

OTHER_TRACKS = {  # beside the circle that is learned on
    "anticlockwise": TrackConfig(direction="anticlockwise"),
    "eight": TrackConfig(shape="eight"),
    "stadium": TrackConfig(shape="stadium"),
    "replan": TrackConfig(judder="replan"),
}
SECTIONS = 4  # equal parts of the loop, counted from where each robot started


# the carrot's best gains, without and with noise that is filtered (study ``tuning``)
TUNED = {
    False: CarrotPI(k_distance=8.0, k_integral=0.5, k_bearing=1.0),
    True: CarrotPI(k_distance=1.0, k_integral=0.1, k_bearing=2.0),
}
# Who drives the followers: a law by its name, or one of these. "learner" learns first; "tractrix"
# is the ideal of rods that pull, without any robot
_OTHERS: dict[str, Callable[[ConvoyConfig], Controller] | None] = {
    "learner": None,
    "tractrix": None,
    "l-psi, point half way": lambda config: LPsi(ahead_m=config.middle_m / 2),
    "l-psi-leader": lambda _: LPsi(leader=True),
    "quantised carrot": quantised_carrot,
    "carrot, tuned": lambda config: TUNED[config.noisy],
}
CONTROLLERS = _OTHERS | {name: lambda _, law=law: law() for name, law in LAWS.items()}


@configuration
class Trial:
    """What one line of a study's table is measured on."""

    config: ConvoyConfig = part(
        ConvoyConfig, "robots, task, learner and seed", default=ConvoyConfig()
    )
    controller: str = choice(tuple(CONTROLLERS), "who drives the followers", default="learner")
    steps: int = integer(
        0, 10**9, "", "learning updates, summed over the followers", default=300_000
    )
    horizon: int = integer(
        0, 10**9, "", "updates over which schedules are stretched, 0 for steps", default=0
    )
    minutes: float = real(0.1, 1e4, "min", "simulated time of the greedy evaluation", default=30.0)

    @property
    def unseen(self) -> ConvoyConfig:
        """The configuration that it is judged in: another track, other noise."""
        return self.config.with_seed(self.config.seed + UNSEEN)


@configuration
class JudgedTrial(Trial):
    """A trial that may be judged on another drive than it learns on."""

    judged: str = choice(
        ("same", *DRIVES), "the drive that it is judged on; same: as it learned", default="same"
    )

    def _check(self) -> None:
        _ = self.unseen  # what cannot be is an error before anything is learned

    @property
    def unseen(self) -> ConvoyConfig:
        drive = self.config.drive if self.judged == "same" else self.judged
        return replace(super().unseen, drive=drive)


def measure(trial: Trial) -> dict[str, float]:
    """Return losses and errors while learning, in its last third, and greedy on an unseen track
    with the reset manoeuvre.
    """
    return _numbers_of(trial, learn(trial.config, steps=trial.steps, progress=False))


def _numbers_of(trial: Trial, run: Run) -> dict[str, float]:
    judged = replace(trial.unseen, reset="manoeuvre")
    learned = run.summary
    greedy = evaluate(run.policy, judged, minutes=trial.minutes, progress=False).summary
    late = ("losses_per_hour", "rms_distance_error_mm", "bearing_std_deg")
    kept = (
        "losses",
        "mean_distance_error_mm",
        "rms_distance_error_mm",
        "bias_mm",
        "ripple_mm",
        "bearing_mean_deg",
        "bearing_std_deg",
    )
    return (
        {"losses": learned["losses"], "updates_to_lossfree": first_lossfree(run.records)}
        | {f"{name}_last_third": _number(learned[f"{name}_last_third"]) for name in late}
        | {
            "share_of_time_away": learned["share_of_time_away"],
            "simulated_minutes": learned["simulated_minutes"],
        }
        | {f"greedy_{name}": _number(greedy[name]) for name in kept}
    )


def measure_widely(trial: Trial) -> dict[str, float]:
    """Return what ``measure`` does, and greedy losses and errors on kinds of track that were not
    learned on, a third as long.
    """
    result = {}
    run = learn(trial.config, steps=trial.steps, progress=False)
    for name, track in OTHER_TRACKS.items():
        judged = replace(trial.unseen, track=track)
        greedy = evaluate(run.policy, judged, minutes=trial.minutes / 3, progress=False).summary
        for key in ("losses", "rms_distance_error_mm", "bias_mm", "ripple_mm", "bearing_std_deg"):
            result[f"{name}_{key}"] = _number(greedy[key])
    return _numbers_of(trial, run) | result


def first_lossfree(records: dict[str, NDArray[Any]]) -> float:
    """Return the updates before the first whole block of 2 500 control periods without any loss,
    NaN if there is none.
    """
    losses = records["sums"][:, :, SUMS.index("losses")].sum(axis=1)
    whole = records["sums"][:, 0, SUMS.index("periods")] == BLOCK
    free = np.flatnonzero((losses == 0) & whole)
    return float(records["starts"][free[0]]) if free.size else math.nan


def measure_sections(trial: Trial) -> dict[str, float]:
    """Return where on the loop was learned, how resets went, and how well each section is followed
    greedily afterwards.

    The greedy evaluation is on the track that was learned on; its losses end in the reset
    manoeuvre. Sections are quarters of the loop, counted from each robot's own start: section 1 is
    what follows a restart, section 4 is reached last.
    """
    theta, learned = _learn_sections(trial)
    return learned | _follow_sections(trial, theta)


def _learn_sections(trial: Trial) -> tuple[NDArray[np.float64], dict[str, float]]:
    """Return the learned weights, and how resets and visits of sections went meanwhile."""
    convoy = Convoy(trial.config, [trial.config.seed], steps=trial.steps, threads=1)
    training = np.zeros(SECTIONS)
    resets = list[int]()
    losses = 0
    gave_up = 0
    started: NDArray[np.float64] | None = None
    away = np.zeros(trial.config.followers, np.int64)
    for [block] in convoy.steps():
        place, started = _sections(convoy.world.tracks[0], block, started)
        at = block[:, 1:]
        training += np.bincount(place[at["state"] >= 0], minlength=SECTIONS)
        losses += int(np.count_nonzero(at["event"] & LOSS))
        gave_up += int(np.count_nonzero(at["event"] & (TIMED_OUT | GAVE_UP)))
        if trial.config.reset == "manoeuvre":  # a restart takes no time
            resets += _durations(at, away)
    if convoy.updates[0] < trial.steps:
        raise RuntimeError(
            f"seed {trial.config.seed}: only {convoy.updates[0]} of {trial.steps} updates; "
            "the followers were lost"
        )
    theta, _ = convoy.tables(0)
    result = {"losses": float(losses), "resets": float(len(resets)), "time_outs": float(gave_up)}
    for name, of in (("reset_median_s", 0.5), ("reset_p95_s", 0.95)):
        duration = float(np.quantile(resets, of)) if resets else math.nan
        result[name] = duration * CONTROL_PERIOD
    for k in range(SECTIONS):
        result[f"training_share_{k + 1}"] = float(training[k] / max(training.sum(), 1))
    return theta, result


def _follow_sections(trial: Trial, theta: NDArray[np.float64]) -> dict[str, float]:
    """Return losses and errors by section of a greedy drive."""
    judged = replace(trial.config, reset="manoeuvre")
    periods = round(trial.minutes * 60 / CONTROL_PERIOD)
    follow = Convoy(judged, [judged.seed], periods=periods, policy=theta, threads=1)
    square, visits, lost, hours = (np.zeros(SECTIONS) for _ in range(4))
    begun: NDArray[np.float64] | None = None
    for [block] in follow.steps():
        place, begun = _sections(follow.world.tracks[0], block, begun)
        at = block[:, 1:]
        seen = at["state"] >= 0
        visits += np.bincount(place[seen], minlength=SECTIONS)
        square += np.bincount(
            place[seen], weights=at["distance_error"][seen].astype(float) ** 2, minlength=SECTIONS
        )
        lost += np.bincount(place[at["event"] & LOSS != 0], minlength=SECTIONS)
        hours += np.bincount(place.ravel(), minlength=SECTIONS) * CONTROL_PERIOD / 3600
    result = {}
    for k in range(SECTIONS):
        result[f"greedy_losses_per_hour_{k + 1}"] = (
            float(lost[k] / hours[k]) if hours[k] else math.nan
        )
        result[f"greedy_rms_distance_error_mm_{k + 1}"] = (
            1000 * math.sqrt(square[k] / visits[k]) if visits[k] else math.nan
        )
    return result


def _sections(
    track: Track, block: NDArray[np.void], started: NDArray[np.float64] | None
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the section of every follower at every period, (periods, followers), and where each
    started, (followers,) m.
    """
    at = block[:, 1:]
    along = track.s[track.nearest(np.stack([at["x"], at["y"]], axis=-1), at["heading"])]
    origin = along[0] if started is None else started
    progress = ((along - origin) / track.length_m + 1e-9) % 1.0
    return np.minimum((progress * SECTIONS).astype(np.int64), SECTIONS - 1), origin


def _durations(at: NDArray[np.void], away: NDArray[np.int64]) -> list[int]:
    """Return the control periods of every reset that ended in this block; ``away`` counts on from
    block to block.
    """
    found = []
    for follower in range(at.shape[1]):
        events = at["event"][:, follower]
        phases = at["phase"][:, follower]
        for period in np.flatnonzero((phases != FOLLOW) | (events & RECOVERED != 0)):
            if events[period] & RECOVERED:
                found.append(int(away[follower]))
                away[follower] = 0
            if phases[period] != FOLLOW:
                away[follower] += 1
    return found


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
