"""The catalogue of studies: which choices matter and which claims hold, one question each, and the
conditions that answer it.

All conditions differ from the defaults of ConvoyConfig in what their label says and in nothing
else. They run on the planar drive, 200 000 updates and a greedy evaluation of 20 simulated minutes
each, ten seeds, unless said otherwise: "recommended", "smoothness" and "controllers" run on wheels,
"stability" and "rivals" have 30 seeds.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from workbench import fields
from workbench.arena.camera.config import CameraConfig
from workbench.arena.tracks import TrackConfig
from workbench.formation.body import BodyConfig
from workbench.formation.config import INFRARED, SETTINGS, TILINGS, ConvoyConfig
from workbench.lab.trial import CONTROLLERS, Trial, measure, measure_sections, measure_widely
from workbench.learning.config import PRESETS, LearnerConfig
from workbench.learning.rules import RULES
from workbench.robot.infrared import InfraredConfig
from workbench.studies.camera_trials import measure_camera
from workbench.studies.infrared_trials import measure_infrared
from workbench.studies.motion_trials import measure_motion, measure_rival, measure_stability
from workbench.studies.off_policy_trials import measure_off_policy
from workbench.studies.transfer_trials import (
    TRAININGS,
    Transfer,
    measure_copies,
    measure_delays,
    measure_gap,
    measure_transfer,
    measure_warm,
)

Labels = dict[str, Any]
Case = tuple[
    Mapping[str, Any], ConvoyConfig | Trial
]  # a configuration takes the study's own steps and minutes
BASE = ConvoyConfig(drive="planar")
ROBOT = replace(SETTINGS["paper-robot"], drive="planar")
LOGARITHMIC = replace(SETTINGS["logarithmic"], drive="planar")
OTHER = BodyConfig(wheel_spread=0.02, axle_spread=0.02)  # robots that are not alike
HORIZON = 1_000_000  # updates of the study of smoothness, over which ε falls
COMPUTE_TIMES_S = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1)


@dataclass(frozen=True)
class Study:
    """A question, the function that measures a trial, and the labelled conditions that it is
    measured on.
    """

    name: str
    question: str
    cases: Callable[[], Sequence[Case]]
    function: Callable[[Any], Mapping[str, float]] = measure  # of a Trial, or of what its cases are
    steps: int = 200_000
    minutes: float = 20.0
    seeds: int = 10

    def trials(
        self, seeds: Sequence[int], *, quick: bool = False
    ) -> tuple[list[Labels], list[Trial]]:
        """Return the labels and the trials of all conditions and seeds, one of each per line of the
        table.
        """
        labels = []
        trials = []
        for label, case in self.cases():
            whole = (
                case
                if isinstance(case, Trial)
                else Trial(config=case, steps=self.steps, minutes=self.minutes)
            )
            trial = replace(whole, steps=min(whole.steps, 2000), minutes=2.5) if quick else whole
            for seed in seeds:
                labels.append({**label, "seed": seed})
                trials.append(replace(trial, config=trial.config.with_seed(seed)))
        return labels, trials


def _learner(config: ConvoyConfig, **changes: float | str | bool) -> ConvoyConfig:
    return replace(
        config, learner=fields.from_dict(LearnerConfig, fields.to_dict(config.learner) | changes)
    )


def _tiles() -> Sequence[Case]:
    cases: list[Case] = []
    both = (True, True)
    for axis, along, theta0 in (
        ("distance", (True, False), -0.1),
        ("bearing", (False, True), -0.1),
        ("both", both, -0.1),
        ("both", both, 0.0),
    ):
        for spacing in TILINGS:
            for count in (3, 5, 7, 9, 11, 13, 15):
                numbers = (count if along[0] else 9, count if along[1] else 9)
                kinds = (spacing if along[0] else "uniform", spacing if along[1] else "uniform")
                config = replace(
                    BASE, state_tiles=numbers, distance_tiling=kinds[0], bearing_tiling=kinds[1]
                )
                label = {"axis": axis, "spacing": spacing, "tiles": count, "theta0": theta0}
                cases.append((label, _learner(config, theta0=theta0)))
    return cases


def _inner() -> Sequence[Case]:
    cases = []
    for mm, degrees in ((1.0, 0.7), (2.0, 1.3), (3.0, 2.0), (4.5, 3.0), (6.0, 4.0), (7.8, 5.0)):
        config = replace(
            LOGARITHMIC, inner_distance_m=mm / 1000, inner_bearing_rad=math.radians(degrees)
        )
        cases.append(({"inner_distance_mm": mm, "inner_bearing_deg": degrees}, config))
    return cases


def _offsets() -> Sequence[Case]:
    return [
        ({"tiles": f"{n}×{n}", "tilings": m}, replace(BASE, state_tiles=(n, n), tilings=m))
        for n in (3, 5, 7, 9)
        for m in (1, 2, 4, 8)
    ]


def _actions() -> Sequence[Case]:
    levels = [("levels", f"{n}×{n}", replace(BASE, action_levels=(n, n))) for n in (3, 5, 7, 9, 11)]
    ranges = [
        (
            "range",
            f"{1000 * low:.0f}–{1000 * high:.0f} mm/s",
            replace(BASE, wheel_speed_mps=(low, high)),
        )
        for low, high in (
            (0.0, 0.12),
            (0.015, 0.105),
            (0.03, 0.09),
            (0.045, 0.075),
            (0.0525, 0.0675),
        )
    ]
    settings = [
        ("setting", name, replace(SETTINGS[name], drive="planar"))
        for name in ("paper", "paper-robot")
    ]
    return [
        ({"factor": factor, "level": level}, config)
        for factor, level, config in levels + ranges + settings
    ]


def _parameters() -> Sequence[Case]:
    values: dict[str, Sequence[float]] = {
        "lam": (0.0, 0.4, 0.6, 0.8, 0.9, 1.0),
        "gamma": (0.0, 0.5, 0.7, 0.8, 0.9, 0.95),
        "alpha": (0.01, 0.03, 0.1, 0.3, 0.6),
        "eta": (0.0, 0.01, 0.1, 1.0),
        "theta0": (-1.0, -0.3, -0.1, -0.03, 0.0),
    }
    cases = [
        ({"factor": n, "level": f"{v:g}"}, _learner(BASE, **{n: v}))
        for n, several in values.items()
        for v in several
    ]
    schedules: dict[str, dict[str, float | str]] = {
        "0.05 → 0.01": {},
        "0.05 → 0": {"epsilon_final": 0.0},
        "0.2 → 0.01": {"epsilon": 0.2},
        "0.05 → 0.01, exponential": {"epsilon_schedule": "exponential"},
        "0.05": {"epsilon_schedule": "constant"},
        "0.01": {"epsilon_schedule": "constant", "epsilon": 0.01},
        "0": {"epsilon_schedule": "constant", "epsilon": 0.0},
    }
    cases += [
        ({"factor": "epsilon", "level": name}, _learner(BASE, **changes))
        for name, changes in schedules.items()
    ]
    return cases + [
        ({"factor": "preset", "level": name}, replace(BASE, learner=learner))
        for name, learner in PRESETS.items()
    ]


def _rewards() -> Sequence[Case]:
    presets = ("quadratic", "absolute", "distance", "alive")
    cases = [
        ({"reward": name, "terminal_factor": 1.0, "theta0": -0.1}, replace(BASE, reward=name))
        for name in presets
    ]
    for factor in (2.0, 10.0):
        cases.append(
            (
                {"reward": "quadratic", "terminal_factor": factor, "theta0": -0.1},
                replace(BASE, terminal_factor=factor),
            )
        )
    optimistic = {
        "quadratic": 0.0,
        "absolute": 0.0,
        "distance": 0.0,
        "alive": 5.0,
    }  # no reward sums up to more: 1 / (1 - γ) = 5
    for name, theta0 in optimistic.items():
        label = {"reward": name, "terminal_factor": 1.0, "theta0": theta0}
        cases.append((label, _learner(replace(BASE, reward=name), theta0=theta0)))
    return cases


def _buffer() -> Sequence[Case]:
    cases = []
    for table, config in (("9×9 states, 7×7 actions", BASE), ("5×5 states, 3×3 actions", ROBOT)):
        cases.append(
            ({"table": table, "buffer": "on", "compute_time_s": 0.0}, config)
        )  # the same at every compute time
        for seconds in COMPUTE_TIMES_S:
            timed = replace(_learner(config, buffer=False), compute_time_s=seconds)
            cases.append(({"table": table, "buffer": "off", "compute_time_s": seconds}, timed))
    return cases


def _reset() -> Sequence[Case]:
    return [
        (
            {"track": shape, "reset": reset, "steps": steps},
            Trial(
                config=replace(BASE, reset=reset, track=TrackConfig(shape=shape)),
                steps=steps,
                minutes=20.0,
            ),
        )
        for shape in ("circle", "eight")
        for steps in (2_500, 5_000, 10_000, 20_000, 40_000, 80_000)
        for reset in ("manoeuvre", "restart")
    ]


def _recommended() -> Sequence[Case]:
    settings = {name: SETTINGS[name] for name in ("paper", "logarithmic", "recommended")}
    settings["logarithmic 3×3"] = replace(
        SETTINGS["logarithmic"], state_tiles=(3, 3)
    )  # the smallest table that follows well
    settings["recommended, 3×3 actions"] = replace(SETTINGS["recommended"], action_levels=(3, 3))
    return [
        ({"setting": name}, replace(config, drive="wheels")) for name, config in settings.items()
    ]


def _smoothness() -> Sequence[Case]:
    cases: list[Case] = []
    for name in ("paper", "recommended"):
        for updates in (0, 1_000, 10_000, 100_000, HORIZON):
            trial = Trial(config=SETTINGS[name], steps=updates, horizon=HORIZON, minutes=20.0)
            cases.append(({"setting": name, "updates": updates}, trial))
    return cases


def _stability() -> Sequence[Case]:
    return [
        ({"setting": name}, replace(SETTINGS[name], drive="planar"))
        for name in ("paper", "recommended")
    ]


def _controllers() -> Sequence[Case]:
    cases: list[Case] = []
    for noise, mm, degrees in (("none", 0.0, 0.0), ("2 mm, 2°", 2.0, 2.0)):
        for controller in CONTROLLERS:
            if controller == "tractrix" and noise != "none":
                continue  # it senses nothing
            for name in (
                ("paper", "recommended")
                if controller in ("learner", "quantised carrot")
                else ("paper",)
            ):
                config = replace(
                    SETTINGS[name],
                    noise_distance_m=mm / 1000,
                    noise_bearing_rad=math.radians(degrees),
                )
                trial = Trial(config=config, controller=controller, steps=400_000, minutes=20.0)
                cases.append(({"controller": controller, "setting": name, "noise": noise}, trial))
    return cases


def _rivals() -> Sequence[Case]:
    cases: list[Case] = []
    for setting, alphas in (("paper", (0.03, 0.1, 0.3)), ("recommended", (0.1,))):
        base = replace(SETTINGS[setting], drive="planar")
        for rule in RULES:
            for alpha in alphas:
                several = (
                    (0.01, 0.1, 1.0)
                    if rule == "greedy-gq" and alpha == 0.1
                    else (1.0 if rule == "qrc" else 0.01,)
                )
                for eta in several:
                    config = _learner(base, rule=rule, alpha=alpha, eta=eta)
                    used = round(
                        config.learner.beta / alpha, 9
                    )  # rules without a correction have none
                    cases.append(
                        ({"setting": setting, "rule": rule, "eta": used, "alpha": alpha}, config)
                    )
    return cases


def _camera() -> Sequence[Case]:
    bad = CameraConfig(conditions="bad", latency_s=0.1, dropout=0.1)
    base = ConvoyConfig(drive="planar", sensing="camera")
    return [
        ({"drive": "planar", "sensing": "truth"}, replace(base, sensing="truth")),
        ({"drive": "planar", "sensing": "camera"}, base),
        ({"drive": "planar", "sensing": "bad camera"}, replace(base, camera=bad)),
        ({"drive": "wheels", "sensing": "camera"}, replace(base, drive="wheels")),
    ]


def _infrared() -> Sequence[Case]:
    sizes = {
        "9×9 states, 7×7 actions": ((9, 9), (7, 7)),
        "5×5 states, 3×3 actions": ((5, 5), (3, 3)),
    }
    base = replace(SETTINGS["infrared"], drive="wheels")
    cases: list[Case] = []
    for followers, steps in ((1, 100_000), (4, 400_000)):  # the same time for every follower
        for route in INFRARED:
            for name, (states, actions) in sizes.items():
                config = replace(
                    base,
                    followers=followers,
                    sensing=route,
                    state_tiles=states,
                    action_levels=actions,
                )
                label = {"followers": followers, "route": route, "table": name}
                cases.append((label, Trial(config=config, steps=steps, minutes=10.0)))
    return cases


def _infrared_world() -> Sequence[Case]:
    cases: list[Case] = []
    for route in INFRARED:
        base = replace(SETTINGS["infrared"], drive="planar", followers=1, sensing=route)
        worlds = {
            "as assumed": base,
            "linear tiles": replace(base, distance_tiling="uniform", bearing_tiling="uniform"),
        }
        if route == "ir-raw":
            worlds |= {
                f"{warp} distortion": _seen(base, warp=warp)
                for warp in ("logarithmic", "offset", "saturating")
            }
        worlds |= {
            "matched sensors": _seen(base, gain_spread=0.0),
            "gain spread 30 %": _seen(base, gain_spread=0.3),
            "noise × 2": _seen(base, noise=2.0),
            "offsets not calibrated": _seen(base, calibrated=False),
            "bare shell, to 115 mm": _seen(replace(base, distance_m=(0.08, 0.115)), target="shell"),
            "light from one side": _seen(base, ambient_counts=3000.0),
            "blinding light": _seen(base, ambient_counts=4000.0),
            "active beacon": _seen(base, target="beacon"),
        }
        cases += [({"route": route, "world": world}, config) for world, config in worlds.items()]
    return cases


def _seen(config: ConvoyConfig, **changes: float | str | bool) -> ConvoyConfig:
    return replace(
        config, infrared=fields.from_dict(InfraredConfig, fields.to_dict(config.infrared) | changes)
    )


def _off_policy() -> Sequence[Case]:
    small = replace(
        SETTINGS["infrared"], drive="planar", followers=1, state_tiles=(5, 5), action_levels=(3, 3)
    )
    return [({"route": route}, replace(small, sensing=route)) for route in INFRARED]


def _copies() -> Sequence[Case]:
    infrared = replace(
        SETTINGS["infrared"], drive="planar", state_tiles=(5, 5), action_levels=(3, 3)
    )
    settings = {
        "paper, on wheels": (SETTINGS["paper"], 400_000),
        "paper-robot, camera": (replace(ROBOT, sensing="camera"), 400_000),
        "recommended": (replace(SETTINGS["recommended"], drive="planar"), 400_000),
    } | {f"5×5/3×3, {route}": (replace(infrared, sensing=route), 200_000) for route in INFRARED}
    cases: list[Case] = []
    for name, (config, steps) in settings.items():
        for robots in ("alike", "different"):
            fleet = (
                replace(_seen(config, gain_spread=0.0), body=BodyConfig())
                if robots == "alike"
                else replace(config, body=OTHER)
            )
            cases.append(
                (
                    {"setting": name, "robots": robots},
                    Trial(config=fleet, steps=steps, minutes=20.0),
                )
            )
    return cases


def _warm() -> Sequence[Case]:
    tasks = {
        "other robots": replace(BASE, body=OTHER),
        "leader 20 % slower": replace(BASE, leader_speed_mps=0.048),
        "leader 20 % faster": replace(BASE, leader_speed_mps=0.072),
        "leader at half speed": replace(BASE, leader_speed_mps=0.03),
        "anticlockwise": replace(BASE, track=TrackConfig(direction="anticlockwise")),
        "figure eight": replace(BASE, track=TrackConfig(shape="eight")),
        "commands 0.2 s late": replace(BASE, body=BodyConfig(delay=2)),
    }
    return [({"task": name}, config) for name, config in tasks.items()]


def _routes() -> dict[str, tuple[ConvoyConfig, int]]:
    infrared = replace(SETTINGS["infrared"], drive="planar", followers=1)
    camera = {"camera": (replace(BASE, sensing="camera"), 200_000)}
    return camera | {route: (replace(infrared, sensing=route), 100_000) for route in INFRARED}


def _travels() -> Sequence[tuple[Labels, ConvoyConfig, int]]:
    return [
        (
            {"route": route, "table": f"{n}×{n}/{m}×{m}"},
            replace(base, state_tiles=(n, n), action_levels=(m, m)),
            steps,
        )
        for route, (base, steps) in _routes().items()
        for n, m in ((9, 7), (5, 3))
    ]


def _transfer() -> Sequence[Case]:
    cases: list[Case] = []
    for label, config, steps in _travels():
        for training in TRAININGS:
            there = steps if training == "there" else steps // 10
            trial = Transfer(
                config=config, steps=steps, there_steps=there, minutes=30.0, training=training
            )
            cases.append((label | {"training": training}, trial))
    return cases


def _delays() -> Sequence[Case]:
    return [
        (label, Trial(config=config, steps=steps, minutes=30.0))
        for label, config, steps in _travels()
    ]


def _gap() -> Sequence[Case]:
    noisy = replace(BASE, noise_distance_m=0.001, noise_bearing_rad=math.radians(1))
    routes = {"absolute, 1 mm and 1°": (noisy, 200_000)} | {
        route: case for route, case in _routes().items() if route != "camera"
    }
    return [
        (
            {"route": route, "training": training},
            Transfer(config=config, steps=steps, minutes=10.0, training=training),
        )
        for route, (config, steps) in routes.items()
        for training in ("nominal", "randomised")
    ]


STUDIES = {
    study.name: study
    for study in (
        Study(
            "tiles", "How many tiles, uniform or logarithmic, for distance and for bearing?", _tiles
        ),
        Study("inner", "How wide should the middle cell of logarithmic tiles be?", _inner),
        Study(
            "offsets",
            "What do several offset tilings do that the paper's single one does not?",
            _offsets,
        ),
        Study("actions", "How many speed levels, over which range?", _actions),
        Study("parameters", "Which of λ, γ, α, η, θ₀ and the ε schedule matter?", _parameters),
        Study("rewards", "What does the reward decide, and the punishment of a loss?", _rewards),
        Study("buffer", "From which compute time on does the update buffer matter?", _buffer),
        Study(
            "reset",
            "What does restarting the simulation do to sections that are seldom reached?",
            _reset,
            measure_sections,
        ),
        Study(
            "recommended",
            "How do the settings follow on wheels?",
            _recommended,
            measure_widely,
            400_000,
            30.0,
        ),
        Study(
            "smoothness",
            "Is the path a smoothed variant, more so with learning (E5, E6)?",
            _smoothness,
            measure_motion,
        ),
        Study(
            "stability",
            "Do robots stabilise from the first on (E4)?",
            _stability,
            measure_stability,
            1_300_000,
            seeds=30,
        ),
        Study(
            "controllers",
            "How does the learner compare with classical control (E10)?",
            _controllers,
            measure_motion,
        ),
        Study(
            "rivals",
            "What do other linear learners do in its place?",
            _rivals,
            measure_rival,
            minutes=10.0,
            seeds=30,
        ),
        Study(
            "camera",
            "Does the full run keep its quality through a camera (N1)?",
            _camera,
            measure_camera,
            1_300_000,
            30.0,
        ),
        Study(
            "infrared",
            "Do two infrared sensors suffice to follow (N2)?",
            _infrared,
            measure_infrared,
        ),
        Study(
            "infrared-world",
            "What do targets, mismatch, light and distortion change for infrared (N4, N5, N7)?",
            _infrared_world,
            measure_infrared,
            100_000,
            4.0,
        ),
        Study(
            "off-policy",
            "Is a policy's value known from a log that it did not make?",
            _off_policy,
            measure_off_policy,
            100_000,
        ),
        Study(
            "copies",
            "Do the first follower's weights serve all others (E7)?",
            _copies,
            measure_copies,
        ),
        Study(
            "warm",
            "When do weights of other robots or another task help, and when do they harm (E7)?",
            _warm,
            measure_warm,
            minutes=10.0,
        ),
        Study(
            "transfer",
            "Do weights from the simulation drive an emulated reality (E8, E9, E11)?",
            _transfer,
            measure_transfer,
        ),
        Study(
            "delays",
            "How late may commands come for weights from the simulation (E8, E9)?",
            _delays,
            measure_delays,
        ),
        Study(
            "gap",
            "How much more noise than they learned with do policies bear (E9)?",
            _gap,
            measure_gap,
        ),
    )
}
