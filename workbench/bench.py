"""Speed and memory, measured as ratios within one run.

The reference is bare physics: ``mj_step`` on one MjData, replaying the very controls that the full
loop has just recorded, from the same state. The full loop is everything: senses, learning, reset,
records and their reduction, without progress bar. Loops that are compared are timed in short turns,
one after the other, so that a busy machine slows all of them; what is reported are medians over the
turns. Times are per formation step: 0.1 s of one leader and its followers, unless a name says so.

``…_former_us`` is MuJoCo as it was run before blocks were compiled as a whole (WORKBENCH_BATCH=1).
``bench --peers`` times other simulators beside ours, see ``workbench.peers``.
"""

import contextlib
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from workbench.arena.library import stopwatches
from workbench.compiled import compiled_with_arrays
from workbench.envs.environments import FollowVectorEnv
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.convoy import BLOCK, Convoy
from workbench.lab.progress import stages
from workbench.lab.records import Recorder
from workbench.lab.runs import learn
from workbench.lab.sweeps import cores, sweep
from workbench.learning.behaviour import greedy_action
from workbench.learning.kernel import Features, Learner, Signal, StepSizes, gq_update, new_trace
from workbench.peers import peers
from workbench.sources import LIBRARIES, version

# turns between those of loops whose blocks are long
_EVERY = {"wheels": 4, "wheels_former": 4, "64": 9}
FOLLOWERS = (4, 16, 64, 256)
FORMATIONS = (1, 4, 16, 64)
PLANAR_FORMATIONS = 16
ROUTES = ("camera", "ir-metric", "ir-raw")
ROLLING = ConvoyConfig(drive="rolling")


class _Loop:
    """A single formation that learns, and bare physics that replays its controls."""

    def __init__(self, config: ConvoyConfig, *, former: bool = False) -> None:
        self.former = former
        self.full: list[float] = []
        self.bare: list[float] = []
        with _former_way(former):
            self.convoy = Convoy(config, [config.seed], steps=10**9, threads=1)
            world = self.convoy.world
            if world.drive.batch is None:
                self.model = world.physics
                self.data = mujoco.MjData(self.model)
            self.convoy.run_block()  # compiles
        self.substeps = world.substeps
        self.recorder = Recorder(config, 10**9)

    def warm_up(self, blocks: int) -> None:
        """Compile, and learn beyond the first stumbling."""
        with _former_way(self.former):
            for _ in range(blocks):
                self.convoy.run_block()

    def turn(self) -> None:
        """Time one block of the full loop, then the same block as bare physics."""
        world = self.convoy.world
        start = world.states[0].copy()
        with _former_way(self.former):
            begun = time.perf_counter()
            block = self.convoy.run_block()
            self.recorder.add(block[0], int(self.convoy.updates[0]))
            self.full.append((time.perf_counter() - begun) / BLOCK)
        if world.drive.batch is None:
            self._replay(start, block[0])

    def _replay(self, start: NDArray[np.float64], block: NDArray[np.void]) -> None:
        """Time a block as bare physics."""
        world = self.convoy.world
        controls = self._controls(block)
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

    @property
    def us(self) -> float:
        """Microseconds of a formation step."""
        return 1e6 * float(np.median(self.full))

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


@contextlib.contextmanager
def _former_way(former: bool) -> Iterator[None]:
    """Let MuJoCo be run as formerly meanwhile, or not."""
    if not former:
        yield
        return
    before = os.environ.get("WORKBENCH_BATCH")
    os.environ["WORKBENCH_BATCH"] = "1"
    stopwatches(True)
    try:
        yield
    finally:
        if before is None:
            del os.environ["WORKBENCH_BATCH"]
        else:
            os.environ["WORKBENCH_BATCH"] = before
        stopwatches(before == "1")


def bench(
    *, turns: int = 36, runs: int = 200, others: bool = False, progress: bool = False
) -> dict[str, Any]:
    """Return the machine, times in µs, their ratios and the peak memory of this process in MiB.

    Args:
        turns: timed blocks of 2 500 formation steps per loop; runs: of the sweep.
        others: time other simulators as well, those that are installed.
        progress: say each second where it is.
    """
    result: dict[str, Any] = {"machine": machine()}
    parts: dict[str, Callable[[], dict[str, Any]]] = {
        "drives beside bare physics": lambda: _loops(turns),
        "updates": _updates,
        "sensing modes": lambda: _routes(turns),
        "followers": lambda: _sizes(turns),
        "formations and threads": lambda: _side_by_side(turns),
        "a whole run": _whole_run,
        "environments": lambda: _environment("planar") | _environment("rolling"),
        "memory": lambda: {"peak_mib": peak_mib()},
        "first and cached start": _starts,
        "sweeps": lambda: _sweeps(runs),
        "overhead of trials": lambda: _overhead(runs),
    }
    if others:
        parts["other simulators"] = lambda: _peers(turns)
    with stages(progress, "bench") as begin:
        for name, part in parts.items():
            begin(name)
            result |= part()
    return result


def machine() -> dict[str, Any]:
    """Return what this runs on."""
    model = platform.processor() or platform.machine()
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as lines:
        names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
        model = names[0] if names else model
    versions = {library: version(library) for library in LIBRARIES}
    return {"cpu": model, "cores": cores(), "python": platform.python_version()} | versions


def _in_turns(loops: Mapping[str, _Loop], turns: int) -> None:
    """Time loops in turns."""
    for turn in range(turns):
        for name, loop in loops.items():
            if turn % _EVERY.get(name, 1) == 0:
                loop.turn()


def _loops(turns: int) -> dict[str, Any]:
    """Return the drives beside bare physics, beside the former way, and with many followers."""
    wheels = ConvoyConfig()
    planar = replace(wheels, drive="planar")
    loops = {
        "wheels": _Loop(wheels),
        "planar": _Loop(planar),
        "rolling": _Loop(ROLLING),
        "recommended": _Loop(replace(SETTINGS["recommended"], drive="rolling")),
        "wheels_former": _Loop(wheels, former=True),
        "planar_former": _Loop(planar, former=True),
        "4": _Loop(replace(planar, seed=2)),
        "64": _Loop(replace(planar, followers=64, seed=2)),
    }
    for name, loop in loops.items():
        loop.warm_up(2 if name in _EVERY else 8)
    _in_turns(loops, turns)
    result: dict[str, Any] = {}
    for name in ("wheels", "planar"):
        full = np.array(loops[name].full)
        bare = np.array(loops[name].bare)
        result[f"{name}_us"] = loops[name].us
        result[f"{name}_bare_us"] = float(np.median(bare)) * 1e6
        result[f"{name}_ratio"] = float(np.median(full / bare))
    others = ("rolling", "recommended", "wheels_former", "planar_former")
    result |= {f"{name}_us": loops[name].us for name in others}
    for name, of in (("wheels", "wheels"), ("planar", "planar"), ("rolling", "planar")):
        ratios = np.array(loops[name].full) / np.array(loops[f"{of}_former"].full)
        result[f"{name}_over_former"] = float(np.median(ratios))
    growth = {}
    for name in ("4", "64"):
        robots = int(name) + 1
        result[f"robot_us_{name}"] = loops[name].us / robots
        result[f"robot_bare_us_{name}"] = float(np.median(loops[name].bare)) * 1e6 / robots
        growth[name] = result[f"robot_us_{name}"] / result[f"robot_bare_us_{name}"]
    result["robot_growth_over_bare"] = growth["64"] / growth["4"]
    return result


def _routes(turns: int) -> dict[str, float]:
    """Return formation steps that roll, by sensing mode."""
    infrared = replace(SETTINGS["infrared"], drive="rolling")
    loops = {
        route: _Loop(replace(ROLLING if route == "camera" else infrared, sensing=route))
        for route in ROUTES
    }
    for loop in loops.values():
        loop.warm_up(6)
    _in_turns(loops, turns)
    return {f"rolling_us_{route}": loop.us for route, loop in loops.items()}


def _sizes(turns: int) -> dict[str, float]:
    """Return steps of one robot that rolls, by the number of followers."""
    loops = {str(n): _Loop(replace(ROLLING, followers=n, seed=2)) for n in FOLLOWERS}
    for loop in loops.values():
        loop.warm_up(4)
    for turn in range(turns):
        for number, loop in enumerate(loops.values()):
            if turn % 3**number == 0:
                loop.turn()
    result = {f"rolling_robot_us_{name}": loop.us / (int(name) + 1) for name, loop in loops.items()}
    most, few = (result[f"rolling_robot_us_{n}"] for n in (FOLLOWERS[-1], FOLLOWERS[0]))
    return result | {"rolling_robot_growth": most / few}


def _side_by_side(turns: int) -> dict[str, float]:
    """Return formation steps by drive, formations side by side and threads."""
    result = {}
    cases = [("rolling", count) for count in FORMATIONS] + [("planar", PLANAR_FORMATIONS)]
    for drive, formations in cases:
        convoys = {
            threads: Convoy(
                replace(ROLLING, drive=drive),
                range(1, formations + 1),
                steps=10**9,
                threads=threads,
            )
            for threads in (1, 2)
            if threads <= formations
        }
        taken: dict[int, list[float]] = {threads: [] for threads in convoys}
        for turn in range(max(turns // 4, 1) + 3):
            for threads, convoy in convoys.items():
                begun = time.perf_counter()
                convoy.run_block()
                if turn >= 3:
                    taken[threads].append((time.perf_counter() - begun) / BLOCK / formations)
        for threads, times in taken.items():
            name = f"{drive}_us_{formations}_formations_{threads}_threads"
            result[name] = 1e6 * float(np.median(times))
        if len(taken) == 2:
            gain = np.array(taken[1]) / np.array(taken[2])
            result[f"{drive}_two_threads_{formations}"] = float(np.median(gain))
    return result


def _whole_run(updates: int = 1_300_000) -> dict[str, float]:
    """Return how long the paper's run takes, rolling, records and their reduction included."""
    begun = time.perf_counter()
    learn(ROLLING, steps=updates, progress=False)
    return {"rolling_1300000_updates_s": (time.perf_counter() - begun) * 1_300_000 / updates}


def _starts() -> dict[str, float]:
    """Return how long a first short run takes from a shell, with nothing compiled, and later."""
    command = [sys.executable, "-m", "workbench", "learn", "--steps", "1000"]
    result = {}
    with tempfile.TemporaryDirectory() as folder:
        surroundings = os.environ | {"NUMBA_CACHE_DIR": folder}
        for name in ("first_start_s", "cached_start_s"):
            begun = time.perf_counter()
            subprocess.run(command, env=surroundings, check=True, capture_output=True)
            result[name] = time.perf_counter() - begun
    return result


def _overhead(runs: int) -> dict[str, float]:
    """Return how many ms a trial takes beside its simulation when all cores are at it: trials of
    ten updates, in processes here and, where dask is installed, on a cluster of workers here.
    """
    configs = [replace(ROLLING, seed=seed) for seed in range(2, 10 * runs + 2)]
    result = dict[str, float]()
    begun = time.perf_counter()
    sweep(tiny_run, configs[: 2 * cores()], progress=False)
    start = time.perf_counter() - begun
    begun = time.perf_counter()
    sweep(tiny_run, configs, progress=False)
    taken = time.perf_counter() - begun - start
    result["trial_ms_local"] = 1000 * taken / len(configs)
    with contextlib.suppress(ImportError):
        from distributed import Client, LocalCluster

        with (
            LocalCluster(
                n_workers=cores(), threads_per_worker=1, dashboard_address=None
            ) as cluster,
            Client(cluster) as client,
        ):
            pool = client.get_executor()
            sweep(tiny_run, configs[: 2 * cores()], pool, progress=False)
            begun = time.perf_counter()
            sweep(tiny_run, configs, client.get_executor(), progress=False)
            taken = time.perf_counter() - begun
        result["trial_ms_dask"] = 1000 * taken / len(configs)
    return result


def tiny_run(config: ConvoyConfig) -> int:
    """Learn ten updates; return the number of losses."""
    return int(learn(config, steps=10, progress=False).summary["losses"])


def _peers(turns: int, periods: int = 1000) -> dict[str, float]:
    """Return what other simulators take for a step of five robots without learning, and how many of
    ours, with it, fit into that.
    """
    steps = peers()
    ours = _Loop(ROLLING)
    ours.warm_up(8)
    taken: dict[str, list[float]] = {name: [] for name in steps}
    for _ in range(turns):
        ours.turn()
        for name, step in steps.items():
            begun = time.perf_counter()
            step(periods)
            taken[name].append((time.perf_counter() - begun) / periods)
    result = {}
    for name, times in taken.items():
        result[f"peer_us_{name}"] = 1e6 * float(np.median(times))
        result[f"peer_over_rolling_{name}"] = float(np.median(np.array(times) / ours.full))
    return result


def _environment(
    drive: str, formations: int = 64, steps: int = 500, turns: int = 5
) -> dict[str, float]:
    """Return follower steps per second of the vectorised environment on one core: errors in, speed
    pairs out.

    Its actions are a law's, computed on arrays, so that followers follow; a new random action now
    and then makes some get lost.
    """
    env = FollowVectorEnv(formations, ConvoyConfig(drive=drive))
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
    name = "environment" if drive == "planar" else f"environment_{drive}"
    return {f"{name}_steps_per_s": float(np.median(rates))}


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
