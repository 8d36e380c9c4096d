"""Short seeded runs of everything that the loop can do, and hashes of what they did.

``python tests/golden.py`` writes tests/data/golden.json anew; do that only where behaviour is meant
to change, and say so in the commit. ``test_golden.py`` compares. A hash is of all step records,
weights and physics, so that it changes with the last bit.
"""

import functools
import hashlib
import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

FILE = Path(__file__).parent / "data" / "golden.json"
PERIODS = 200


def _digest(*arrays):
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def machine():
    """Return a hash of what this machine's mathematics library and compiler make of the same
    numbers.
    """
    from workbench.formation.angles import wrap

    x = np.linspace(-7.0, 7.0, 2001)
    compiled = [wrap(value) for value in x[::10]]
    return _digest(
        np.sin(x),
        np.exp(x),
        x @ x,
        np.array([math.atan2(value, 0.3) for value in x]),
        np.array(compiled),
    )


@functools.cache
def _configs():
    """Return name → (configuration, keywords of Convoy)."""
    from workbench.arena.camera.config import CameraConfig
    from workbench.arena.tracks import TrackConfig
    from workbench.formation.body import BodyConfig
    from workbench.formation.config import SETTINGS, ConvoyConfig
    from workbench.formation.laws.l_psi import LPsi
    from workbench.formation.laws.own import OwnLaw
    from workbench.formation.laws.table import LAWS, quantised_carrot
    from workbench.formation.own_reward import own_reward
    from workbench.learning.config import RULES, LearnerConfig
    from workbench.robot.description import load_robot
    from workbench.robot.infrared import InfraredConfig

    wheels = ConvoyConfig(followers=2)
    planar = ConvoyConfig(drive="planar")
    infrared = replace(SETTINGS["infrared"], drive="planar")
    learn = {"steps": 10**6}
    greedy = {"steps": 0}
    cases = {"wheels": (wheels, learn), "planar": (planar, learn)}
    for name, setting in SETTINGS.items():
        cases[f"setting {name}"] = (replace(setting, drive="planar"), learn)
    cases["three seeds"] = (planar, {"steps": 1500, "seeds": (5, 1, 4)})
    cases["horizon"] = (planar, {"steps": 300, "horizon": 1000})
    # sensing
    for mode in ("camera", "ir-metric", "ir-raw"):
        base = infrared if mode.startswith("ir") else planar
        cases[f"sensing {mode}"] = (replace(base, sensing=mode), learn)
        cases[f"sensing {mode}, wheels"] = (
            replace(base, sensing=mode, drive="wheels", followers=2),
            learn,
        )
    cases["sensing pixels"] = (
        replace(planar, sensing="pixels", followers=1),
        learn | {"periods": 30},
    )
    late = CameraConfig(conditions="bad", latency_s=0.1, dropout=0.1, every=2)
    cases["bad camera"] = (replace(planar, sensing="camera", camera=late), learn)
    cases["bad pixels"] = (
        replace(planar, sensing="pixels", followers=1, camera=late),
        learn | {"periods": 30},
    )
    noisy = replace(planar, noise_distance_m=0.002, noise_bearing_rad=0.04)
    cases["noise"] = (noisy, learn)
    cases["out of sight"] = (replace(planar, sight_m=0.23), learn)
    for name, changes in {
        "shell": {"target": "shell"},
        "tape": {"target": "tape"},
        "beacon": {"target": "beacon"},
        "bright": {"brightness": 1.2},
        "ambient": {"ambient_counts": 3000.0},
        "blinding": {"ambient_counts": 4000.0, "ambient_direction_rad": 1.0},
        "not calibrated": {"calibrated": False},
        "matched": {"gain_spread": 0.0},
        "noise × 3": {"noise": 3.0, "samples": 2},
        "logarithmic": {"warp": "logarithmic"},
        "offset": {"warp": "offset"},
        "saturating": {"warp": "saturating"},
    }.items():
        seen = replace(
            infrared, sensing="ir-raw", infrared=InfraredConfig(**changes), distance_m=(0.08, 0.115)
        )
        cases[f"infrared {name}"] = (seen, learn)
    # rolling
    rolling = replace(planar, drive="rolling")
    cases["rolling"] = (rolling, learn)
    cases["rolling, offset"] = (
        replace(SETTINGS["offset"], drive="rolling"),
        learn | {"seeds": (5, 1, 4)},
    )
    cases["rolling, infrared"] = (replace(infrared, drive="rolling", sensing="ir-raw"), learn)
    cases["rolling, camera, restart"] = (
        replace(rolling, sensing="camera", reset="restart"),
        learn,
    )
    cases["rolling, touching"] = (replace(rolling, distance_m=(0.0702, 0.09)), learn)
    late = LearnerConfig(buffer=False)
    cases["rolling, slow"] = (replace(rolling, learner=late, compute_time_s=0.04), learn)
    # laws
    for name, law in LAWS.items():
        for drive in ("wheels", "planar"):
            cases[f"law {name}, {drive}"] = (replace(planar, drive=drive), {"policy": law()})
    cases["law l-psi, point half way"] = (planar, {"policy": LPsi(ahead_m=0.075)})
    cases["law with noise"] = (noisy, {"policy": LAWS["path"](half_window=4)})
    cases["law on infrared"] = (
        replace(infrared, sensing="ir-metric"),
        {"policy": LAWS["carrot"]()},
    )
    cases["law on a camera"] = (replace(planar, sensing="camera"), {"policy": LAWS["pursuit"]()})
    cases["law, truth-relative"] = (
        replace(planar, sensing="truth-relative"),
        {"policy": LAWS["path"]()},
    )
    cases["law of one's own"] = (
        planar,
        {"policy": OwnLaw(function=lambda d, b: (0.06 + 2 * (d - 0.15), 4 * b))},
    )
    cases["quantised carrot"] = (planar, greedy | {"policy": quantised_carrot(planar).theta})
    # output and estimate
    calm = replace(SETTINGS["recommended"], drive="rolling")
    cases["calm"] = (calm, greedy | {"policy": quantised_carrot(calm).theta})
    cases["calm, learning"] = (replace(calm, learn_by="output"), learn)
    cases["calm, raw readings"] = (
        replace(infrared, sensing="ir-raw", output="interpolated", learn_by="output"),
        learn,
    )
    relative = replace(
        calm,
        actions="relative",
        filter="alpha-beta",
        prediction="both",
        noise_distance_m=1e-3,
        noise_bearing_rad=0.02,
        body=BodyConfig(delay=2),
    )
    cases["relative, filtered, foreseen"] = (
        relative,
        greedy | {"policy": quantised_carrot(relative).theta},
    )
    cases["carrot, foreseen by camera"] = (
        replace(planar, sensing="camera", prediction="both", body=BodyConfig(delay=3)),
        greedy | {"policy": LAWS["carrot"]()},
    )
    # rules, tilings, schedules, traces, buffer
    several = replace(SETTINGS["offset"], drive="planar")
    for rule in RULES:
        for name, base in (("paper", planar), ("offset", several)):
            eta = 1.0 if rule == "qrc" else 0.1
            cases[f"rule {rule}, {name}"] = (
                replace(base, learner=LearnerConfig(rule=rule, eta=eta)),
                learn,
            )
    for schedule in ("exponential", "constant"):
        learner = LearnerConfig(epsilon_schedule=schedule, epsilon=0.2, gamma=0.7)
        cases[f"schedule {schedule}"] = (replace(planar, learner=learner), {"steps": 600})
    for name, learner in {
        "whole trace": LearnerConfig(trace_cutoff=0.0),
        "short trace": LearnerConfig(trace_cutoff=0.1, lam=0.9),
        "no trace": LearnerConfig(lam=0.0),
        "no discount": LearnerConfig(gamma=0.0),
        "no buffer": LearnerConfig(buffer=False),
        "fast": LearnerConfig(alpha=0.4, eta=1.0, theta0=0.0),
    }.items():
        cases[name] = (replace(planar, learner=learner), learn)
    slow = replace(planar, learner=LearnerConfig(buffer=False), compute_time_s=0.06)
    cases["slow, no buffer"] = (slow, learn)
    cases["slow, wheels"] = (replace(slow, drive="wheels", followers=2), learn)
    cases["slow, as long as a period"] = (replace(slow, compute_time_s=0.1), learn)
    for n, m in ((3, 2), (4, 4), (5, 8)):
        cases[f"{m} tilings of {n}×{n + 1}"] = (
            replace(planar, state_tiles=(n, n + 1), tilings=m, action_levels=(3, 5)),
            learn,
        )
    kinds = ("uniform", "logarithmic")
    for along in kinds:
        for across in kinds:
            tiled = replace(planar, distance_tiling=along, bearing_tiling=across)
            cases[f"tiles {along} × {across}"] = (tiled, learn)
            raw = replace(infrared, sensing="ir-raw", distance_tiling=along, bearing_tiling=across)
            cases[f"readings {along} × {across}"] = (raw, learn)
    # rewards
    for reward in ("absolute", "distance", "alive"):
        cases[f"reward {reward}"] = (replace(planar, reward=reward, terminal_factor=2.0), learn)
    own = own_reward(lambda u, v: -(u * u + 3 * v * v))
    cases["reward of one's own"] = (replace(planar, reward="own"), learn | {"reward": own})
    # bodies, fleets, resets, tables
    for name, body in {
        "delay 1": BodyConfig(delay=1),
        "delay 3": BodyConfig(delay=3),
        "slip": BodyConfig(slip=0.1),
        "missed": BodyConfig(missed=0.3),
        "spread": BodyConfig(wheel_spread=0.1, axle_spread=0.1),
        "everything": BodyConfig(
            wheel_spread=0.05, axle_spread=0.05, slip=0.05, delay=2, missed=0.1
        ),
    }.items():
        cases[f"body {name}"] = (replace(planar, body=body), learn)
    everything = cases["body everything"][0].body
    cases["body, rolling"] = (replace(rolling, body=everything), learn)
    cases["body, wheels"] = (replace(wheels, body=everything), learn)
    cases["body, infrared"] = (replace(infrared, sensing="ir-raw", body=everything), learn)
    cases["body, camera"] = (replace(planar, sensing="camera", body=everything), learn)
    cases["body, noise"] = (replace(noisy, body=everything), learn)
    cases["fleet"] = (replace(infrared, body=everything, fleet=9), learn)
    cases["restart"] = (replace(planar, reset="restart"), learn)
    cases["restart, wheels"] = (replace(wheels, reset="restart"), learn)
    cases["restart, infrared"] = (replace(infrared, sensing="ir-raw", reset="restart"), learn)
    cases["restart, camera"] = (replace(planar, sensing="camera", reset="restart"), learn)
    for weights in ("shared", "first"):
        cases[f"weights {weights}"] = (replace(planar, weights=weights), learn)
        cases[f"weights {weights}, offset"] = (replace(several, weights=weights), learn)
    theta = np.random.default_rng(0).normal(size=(4, 81, 49))
    cases["policy of four tables"] = (planar, greedy | {"policy": theta})
    cases["policy of one table"] = (planar, greedy | {"policy": theta[:1]})
    carrot = quantised_carrot(planar).theta / 1000
    for name, cutoff in (("trace", 1e-8), ("whole trace", 0.0)):
        kept = replace(planar, learner=LearnerConfig(trace_cutoff=cutoff, alpha=1e-3))
        cases[f"{name} of one who follows"] = (kept, learn | {"policy": carrot})
    cases["learning on"] = (planar, learn | {"policy": theta})
    # tracks, ground, robots, bounds
    for name, track in {
        "eight": TrackConfig(shape="eight"),
        "stadium": TrackConfig(shape="stadium"),
        "replan": TrackConfig(judder="replan"),
        "smooth": TrackConfig(judder="none"),
        "anticlockwise": TrackConfig(direction="anticlockwise"),
    }.items():
        cases[f"track {name}"] = (replace(planar, track=track), learn)
    cases["ground b"] = (replace(planar, ground="b"), learn)
    cases["not calibrated on the ground"] = (
        replace(planar, ground="c", ground_calibrated=False),
        learn,
    )
    cases["large robot"] = (planar.with_robot(load_robot("large")), learn)
    cases["large robot, wheels"] = (wheels.with_robot(load_robot("large")), learn)
    cases["eight followers"] = (replace(planar, followers=8), learn)
    cases["backwards too"] = (replace(planar, wheel_speed_mps=(-0.02, 0.1)), learn)
    return cases


def run_case(name):
    """Return hash and a few numbers of one case."""
    from workbench.formation.convoy import Convoy
    from workbench.formation.follower import LOSS

    config, kinds = _configs()[name]
    kinds = {"periods": PERIODS} | kinds
    seeds = kinds.pop("seeds", (config.seed,))
    convoy = Convoy(config, seeds, threads=1, **kinds)
    blocks = []
    while not convoy.finished:
        block = convoy.run_block()
        blocks.append(
            block[:, : int(convoy.periods.max() - sum(b.shape[1] for b in blocks))].copy()
        )
    steps = np.concatenate(blocks, axis=1)
    return _summary(steps, convoy.weights, convoy.world.states, LOSS)


def _summary(steps, weights, states, loss, early=50):
    """Return a hash of everything, and numbers of the first five seconds, which other machines must
    reach within rounding.
    """
    begin = steps[:, :early]
    return {
        "sha256": _digest(steps, weights, states),
        "losses": int(np.count_nonzero(steps["event"] & loss)),
        "x_m": float(begin["x"].astype(float).mean()),
        "y_m": float(begin["y"].astype(float).mean()),
        "left": float(begin["left"].astype(float).mean()),
    }


def run_outside(config, robot):
    """Return hash and numbers of a convoy that is driven period by period: one robot, or (None) all
    followers, from outside.
    """
    from workbench.formation.convoy import Convoy
    from workbench.formation.follower import LOSS
    from workbench.formation.laws.outside import Outside

    law = Outside() if robot is None else None
    convoy = Convoy(config, [1, 2], periods=10**6, policy=law, external=robot, threads=1)
    rng = np.random.default_rng(3)
    kept = []
    for t in range(PERIODS):
        kept.append(convoy.period(t).copy())
        shape = (2, config.followers)
        left, right = rng.integers(200, 700, (2, *shape))
        if robot is None:
            convoy.command_all(left, right, t)
        else:
            convoy.command(robot, int(left[0, 0]), int(right[0, 0]), t)
        convoy.world.step()
    return _summary(np.stack(kept, axis=1), convoy.weights, convoy.world.states, LOSS)


def run_solo(config, steps):
    """Return hash and numbers of a follower that drives a simulated robot through the robot API."""
    from workbench.formation.policy import Policy
    from workbench.formation.simulated import SimulatedRobot
    from workbench.formation.solo import SoloFollower

    theta = np.random.default_rng(5).normal(size=(1, config.rows, config.action_count)) / 100
    follower = SoloFollower(config, Policy.of(config, theta), steps=steps)
    readings = []
    with SimulatedRobot(config) as robot:
        robot.enable("proximity", "light", "floor", "motor_position", "accelerometer")
        robot.calibrate_proximity_sensors()
        for _ in range(PERIODS):
            robot.step()
            seen = [
                *robot.get_proximity(),
                *robot.get_light_sensor(),
                *robot.get_floor_sensors(),
                *robot.get_motor_position(),
            ]
            left, right = follower.decide(robot.get_proximity(), robot.get_light_sensor())
            robot.set_motors_speed(left, right)
            follower.learn()
            readings.append(
                [
                    *seen,
                    left,
                    right,
                    follower.probability,
                    float(follower.record["choice"]["state"]),
                ]
            )
    table = np.array(readings)
    return {
        "sha256": _digest(table, follower.weights),
        "losses": 0,
        "x_m": float(table[:50].mean()),
        "y_m": 0.0,
        "left": 0.0,
    }


def run_records(drive):
    """Return hash and numbers of what a run keeps, of its summary, and of the measures of its
    motion.
    """
    from workbench.formation.config import ConvoyConfig
    from workbench.formation.laws.carrot import CarrotPI
    from workbench.lab.runs import evaluate, learn
    from workbench.measures.judder import judder
    from workbench.measures.motion import chatter, follow

    config = ConvoyConfig(drive=drive, followers=2, reset="manoeuvre")
    run = learn(config, steps=8000, progress=False)
    judged = evaluate(run.policy, config.with_seed(2), minutes=2, progress=False)
    motion = follow(CarrotPI(), config, minutes=2.5)
    tables = [
        chatter(run).to_numpy(float),
        chatter(motion).to_numpy(float),
        judder(motion).to_numpy(float),
    ]
    texts = json.dumps([run.summary, judged.summary], sort_keys=True)
    arrays = [run.records[name] for name in sorted(run.records)] + tables
    return {
        "sha256": _digest(*arrays, run.w, np.frombuffer(texts.encode(), np.uint8)),
        "losses": run.summary["losses"],
        "x_m": 0.0,
        "y_m": 0.0,
        "left": 0.0,
    }


def run_environment(observation, actions):
    """Return hash and numbers of a vectorised environment under random actions."""
    from workbench.envs.environments import FollowVectorEnv
    from workbench.formation.config import SETTINGS, ConvoyConfig

    config = SETTINGS["infrared"] if observation == "infrared" else ConvoyConfig()
    env = FollowVectorEnv(
        3, replace(config, drive="planar"), observation=observation, actions=actions, seconds=10.0
    )
    seen, _ = env.reset(seed=4)
    env.action_space.seed(7)
    kept = [np.asarray(seen, float)]
    for _ in range(PERIODS):
        seen, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        kept += [np.asarray(value, float) for value in (seen, reward, terminated, truncated)]
    return {"sha256": _digest(*kept), "losses": 0, "x_m": 0.0, "y_m": 0.0, "left": 0.0}


STUDIED = {  # study → which of its trials, and changes that make them short
    "tiles": (0, -1),
    "reset": (0, -1),
    "recommended": (0,),
    "smoothness": (0, 1),
    "stability": (0,),
    "controllers": (0, 2, 3, -1),
    "rivals": (0, -1),
    "camera": (0,),
    "infrared": (0, -1),
    "infrared-world": (5,),
    "copies": (0, -1),
    "warm": (0,),
    "transfer": (0, 1, 3, 4),
    "delays": (0,),
    "gap": (0, -1),
}


def run_study(name):
    """Return hash and numbers of what a study measures on some of its trials, made short."""
    from workbench.studies.tables import STUDIES

    study = STUDIES[name]
    _, trials = study.trials((1,), quick=True)
    lines = []
    for k in STUDIED[name]:
        short = {"there_steps": 200} if hasattr(trials[k], "there_steps") else {}
        trial = replace(trials[k], steps=min(trials[k].steps, 1000), minutes=2.5, **short)
        lines.append({key: float(value) for key, value in study.function(trial).items()})
    text = json.dumps([sorted(line.items()) for line in lines])
    losses = sum(
        value
        for line in lines
        for key, value in line.items()
        if "losses" in key and np.isfinite(value)
    )
    return {
        "sha256": _digest(np.frombuffer(text.encode(), np.uint8)),
        "losses": int(losses),
        "x_m": 0.0,
        "y_m": 0.0,
        "left": 0.0,
    }


def run_log():
    """Return hash and numbers of the log and the returns from which a policy's value is
    estimated.
    """
    from workbench.formation.config import SETTINGS
    from workbench.formation.policy import Policy
    from workbench.measures.off_policy import evaluate_log
    from workbench.studies.off_policy_trials import Driver

    config = replace(SETTINGS["infrared"], sensing="ir-raw", followers=1, drive="planar")
    policy = Policy.of(
        config, np.random.default_rng(5).normal(size=(1, config.rows, config.action_count)) / 100
    )
    driver = Driver(config, policy)
    log = driver.log(epsilon=0.5, periods=800)
    found = evaluate_log(log, policy, gamma=0.8, seed=1)
    returns = driver.returns(epsilon=0.1, gamma=0.8, stretches=5)
    arrays = (
        log.state,
        log.action,
        log.probability,
        log.reward,
        returns,
        np.array(sorted(found.items()), object).astype(str),
    )
    return {"sha256": _digest(*arrays), "losses": 0, "x_m": 0.0, "y_m": 0.0, "left": 0.0}


@functools.cache
def cases():
    """Return name → function without arguments that gives hash and numbers."""
    from workbench.formation.config import SETTINGS, ConvoyConfig

    planar = ConvoyConfig(drive="planar")
    raw = replace(SETTINGS["infrared"], sensing="ir-raw", followers=1)
    found = {name: (lambda name=name: run_case(name)) for name in _configs()}
    found |= {f"study {name}": (lambda name=name: run_study(name)) for name in STUDIED}
    found |= {
        "log": run_log,
        "from outside, all": lambda: run_outside(planar, None),
        "from outside, the leader": lambda: run_outside(planar, 0),
        "from outside, a follower": lambda: run_outside(replace(planar, drive="wheels"), 1),
        "solo, greedy": lambda: run_solo(replace(raw, drive="planar"), 0),
        "solo, learning": lambda: run_solo(raw, 500),
        "solo, metric": lambda: run_solo(replace(raw, sensing="ir-metric", drive="planar"), 500),
        "records, wheels": lambda: run_records("wheels"),
        "records, planar": lambda: run_records("planar"),
        "environment, errors": lambda: run_environment("errors", "continuous"),
        "environment, tiles": lambda: run_environment("tiles", "discrete"),
        "environment, infrared": lambda: run_environment("infrared", "discrete"),
    }
    return found


def main():
    result = {"machine": machine(), "cases": {}}
    for name, run in cases().items():
        result["cases"][name] = run()
        print(name, result["cases"][name], flush=True)
    FILE.write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
