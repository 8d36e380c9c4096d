"""Speed and memory, measured as ratios within one run.

The reference is bare physics: ``mj_step`` on one MjData, replaying the very controls that the full
loop has just recorded, from the same state. The full loop is everything: senses, learning, reset,
records and their reduction, without progress bar. Both are timed in short turns, one after the
other, so that a busy machine slows both; what is reported are medians over the turns. Times are per
formation step: 0.1 s of one leader and its followers.
"""

import resource
import sys
import time
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from workbench.compiled import compiled_with_arrays
from workbench.envs.environments import FollowVectorEnv
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import BLOCK, Convoy
from workbench.lab.records import Recorder
from workbench.lab.runs import learn
from workbench.lab.sweeps import cores, sweep
from workbench.learning.behaviour import greedy_action
from workbench.learning.kernel import Features, Learner, Signal, StepSizes, gq_update, new_trace

_EVERY = {"wheels": 4, "planar": 1, "4": 1, "64": 9}  # long blocks take fewer turns


class _Loop:
    """A single formation that learns, and bare physics that replays its controls."""

    def __init__(self, config: ConvoyConfig) -> None:
        self.convoy = Convoy(config, [config.seed], steps=10**9, threads=1)
        self.recorder = Recorder(config, 10**9)
        self.model = self.convoy.world.physics
        self.data = mujoco.MjData(self.model)
        self.substeps = self.convoy.world.substeps
        self.full: list[float] = []
        self.bare: list[float] = []

    def warm_up(self, blocks: int) -> None:
        """Compile, and learn beyond the first stumbling."""
        for _ in range(blocks):
            self.convoy.run_block()

    def turn(self) -> None:
        """Time one block of the full loop, then the same block as bare physics."""
        world = self.convoy.world
        start = world.states[0].copy()
        begun = time.perf_counter()
        block = self.convoy.run_block()
        self.recorder.add(block[0], int(self.convoy.updates[0]))
        self.full.append((time.perf_counter() - begun) / BLOCK)

        controls = self._controls(block[0])
        mujoco.mj_setState(self.model, self.data, start, mujoco.mjtState.mjSTATE_INTEGRATION)
        data = self.data
        model = self.model
        substeps = self.substeps
        ctrl = self.data.ctrl
        step = mujoco.mj_step
        begun = time.perf_counter()
        for row in controls:
            ctrl[:] = row
            step(model, data, nstep=substeps)
        self.bare.append((time.perf_counter() - begun) / BLOCK)
        if not np.array_equal(world.qpos[0], data.qpos):
            raise RuntimeError(
                "bare physics did not reproduce the recorded run; the comparison would be "
                "meaningless"
            )

    def _controls(self, block: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the controls (periods, nu) that the recorded commands of a block mean."""
        world = self.convoy.world
        kept = world.ctrl[0].copy()
        controls = np.zeros((len(block), world.ctrl.shape[1]))
        for t, row in enumerate(block):
            for robot in range(world.robots):
                world.command(0, robot, int(row[robot]["left"]), int(row[robot]["right"]))
            controls[t] = world.ctrl[0]
        world.ctrl[0] = kept
        return controls


def bench(*, turns: int = 36, runs: int = 200) -> dict[str, Any]:
    """Return times in µs, their ratios and the peak memory of this process in MiB.

    Args:
        turns: timed blocks of 2 500 formation steps per loop; runs: of the sweep.
    """
    base = ConvoyConfig()
    planar = replace(base, drive="planar")
    loops = {
        "wheels": _Loop(base),
        "planar": _Loop(planar),
        "4": _Loop(replace(planar, seed=2)),
        "64": _Loop(replace(planar, followers=64, seed=2)),
    }
    for name, loop in loops.items():
        loop.warm_up(2 if name in ("wheels", "64") else 8)
    for turn in range(turns):
        for name, loop in loops.items():
            if turn % _EVERY[name] == 0:
                loop.turn()
    micro = 1e6
    result: dict[str, Any] = {}
    for name in ("wheels", "planar"):
        full = np.array(loops[name].full)
        bare = np.array(loops[name].bare)
        result[f"{name}_us"] = float(np.median(full)) * micro
        result[f"{name}_bare_us"] = float(np.median(bare)) * micro
        result[f"{name}_ratio"] = float(np.median(full / bare))
    result |= _updates()
    growth = {}
    for name in ("4", "64"):
        robots = int(name) + 1
        result[f"robot_us_{name}"] = float(np.median(loops[name].full)) * micro / robots
        result[f"robot_bare_us_{name}"] = float(np.median(loops[name].bare)) * micro / robots
        growth[name] = result[f"robot_us_{name}"] / result[f"robot_bare_us_{name}"]
    result["robot_growth_over_bare"] = growth["64"] / growth["4"]
    result |= _environment()
    result["peak_mib"] = peak_mib()
    return result | _sweeps(runs)


def _environment(formations: int = 64, steps: int = 500, turns: int = 5) -> dict[str, float]:
    """Return follower steps per second of the vectorised environment on one core: planar, errors
    in, speed pairs out.

    Its actions are a law's, computed on arrays, so that followers follow; a new random action now
    and then makes some get lost.
    """
    env = FollowVectorEnv(formations)
    seen, _ = env.reset(seed=1)
    rng = np.random.default_rng(0)
    levels = env.config.action_levels[1]
    rates = []
    for _ in range(turns):
        begun = time.perf_counter()
        for _ in range(steps):
            pair = np.round(3 + 3 * seen[:, :1] + np.array([-4.0, 4.0]) * seen[:, 1:])
            left, right = np.clip(pair, 0, levels - 1).astype(np.int64).T
            action = np.where(
                rng.random(formations) < 0.05,
                rng.integers(0, levels**2, formations),
                left * levels + right,
            )
            seen, *_ = env.step(action)
        rates.append(formations * steps / (time.perf_counter() - begun))
    return {
        "environment_formations": formations,
        "environment_steps_per_s": float(np.median(rates)),
    }


def short_run(config: ConvoyConfig) -> int:
    """Learn 20 000 updates; return the number of losses."""
    return int(learn(config, steps=20_000, progress=False).summary["losses"])


def _sweeps(runs: int) -> dict[str, float]:
    """Return the time of a sweep in this process and on all cores, start of the processes
    included.
    """
    configs = [ConvoyConfig(drive="planar", seed=seed) for seed in range(runs)]
    taken = {}
    for workers in (1, cores()):
        begun = time.perf_counter()
        results = sweep(short_run, configs, workers=workers, progress=False)
        taken[workers] = (time.perf_counter() - begun, results)
    (serial, expected) = taken[1]
    (local, found) = taken[cores()]
    if expected != found:
        raise RuntimeError("serial and parallel sweeps differ; their times cannot be compared")
    return {
        "sweep_runs": runs,
        "sweep_workers": cores(),
        "sweep_serial_s": serial,
        "sweep_local_s": local,
        "sweep_speedup": serial / local,
    }


def peak_mib() -> float:
    """Return the largest resident memory that this process has had, in MiB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1024 if sys.platform != "darwin" else peak / 1024**2


def _updates(count: int = 200_000, turns: int = 9) -> dict[str, float]:
    """Return the time of one learning update with 15×15 and with 5×5 states, 49 actions each, over
    the same visits.

    Both tables see one walk: a state of the smaller grid, embedded in the larger one, so that only
    the table's size differs. Finding the next state's greedy action, O(|A|), is part of both.
    """
    times: dict[int, list[float]] = {5: [], 15: []}
    rng = np.random.default_rng(0)
    walk = rng.integers(0, 25, count + 1)
    actions = rng.integers(0, 49, count)
    rho = np.where(rng.random(count) < 0.97, 1.03, 0.0)
    for _ in range(turns):
        for side, taken in times.items():
            scale = side // 5
            states = walk // 5 * scale * side + walk % 5 * scale
            theta = np.full(side * side * 49, -0.1)
            w = np.zeros(side * side * 49)
            begun = time.perf_counter()
            _replay(Learner(theta, w, *new_trace(theta.size)), states, actions, rho)
            taken.append((time.perf_counter() - begun) / count * 1e6)
    # the first turn compiles
    small = np.array(times[5][1:])
    large = np.array(times[15][1:])
    return {
        "update_us_5x5": float(np.median(small)),
        "update_us_15x15": float(np.median(large)),
        "update_ratio": float(np.median(large / small)),
    }


@compiled_with_arrays
def _replay(learner: Any, states: Any, actions: Any, rho: Any) -> None:
    """Learn a given walk with reward -1, as the followers do, in one compiled loop."""
    phi = Features(np.empty(1, np.int64), np.ones(1))
    bar = Features(np.empty(1, np.int64), np.ones(1))
    sizes = StepSizes(0.1, 1e-3, 1e-8, 0.0)
    n = 0
    for t in range(actions.size):
        phi.index[0] = states[t] * 49 + actions[t]
        start = states[t + 1] * 49
        bar.index[0] = start + greedy_action(learner.theta, start, 49)
        signal = Signal(-1.0, 0.0, 1.0, rho[t])
        n, _, _ = gq_update(learner, n, phi, bar, signal, 0.64, 0.8, 0.8, sizes)
