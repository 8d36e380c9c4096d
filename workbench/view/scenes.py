"""What the arena shows: frames of all robots, live from the simulator, or from a run, a motion or a
recorded drive.

A frame is an array (robots, len(FIELDS)) of float32, one per control period:

    x, y, heading                     m, rad
    distance, bearing                 of the robot in front as sensed, m and rad (0 for the leader)
    state, phase                      tile (-1: none) and phase of the follower (formation.reset)
    left, right                       commands in steps/s
    ps0 … ps7                         proximity readings in counts; stored runs without infrared: 0
    place_x, place_y                  where its place is, m; without a shape 0

>>> scene = LiveScene(ConvoyConfig(followers=1, drive="planar"), law=CarrotPI())
>>> scene.advance(3).shape, scene.about["robots"], scene.live
((3, 2, 19), 2, True)

A drive by hand is kept as its commands; everything else follows from the configuration's seed.
``save_drive`` drives it again behind the robot API, so that the recording has the leader's own
readings, and ``load_drive`` reads the commands back: the same followers then do the same to the
last bit, others show what they would have made of it.

Distances and bearings are those that were sensed where a scene is live, the true ones where it is
stored.

Contract: a scene is used by one thread at a time (``lock``); ``frames`` is everything shown so far,
and grows until a restart.
"""

import contextlib
import signal
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.laws.carrot import CarrotPI
from workbench.formation.laws.law import ControlLaw
from workbench.formation.laws.own import OwnLaw
from workbench.formation.places import track_of
from workbench.formation.policy import Policy
from workbench.formation.reset import PHASES
from workbench.formation.senses.infrared import equip as fit_sensors
from workbench.formation.simulated import SimulatedRobot, sense
from workbench.lab.records import sampled_blocks
from workbench.lab.runs import Run
from workbench.logs.recordings import Recorder, load_recording
from workbench.measures.motion import Motion
from workbench.robot.description import EPUCK
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.infrared import BEARINGS, RING, SENSORS
from workbench.view.joystick import Joystick

FIELDS = (
    "x",
    "y",
    "heading",
    "distance",
    "bearing",
    "state",
    "phase",
    "left",
    "right",
    *(f"ps{k}" for k in range(SENSORS)),
    "place_x",
    "place_y",
)
READINGS = slice(FIELDS.index("ps0"), FIELDS.index("ps0") + SENSORS)
PLACES = slice(FIELDS.index("place_x"), FIELDS.index("place_x") + 2)
ASKED = ("column", "line", "wedge", "diamond", "circle")  # shapes that a page can ask for
NOTE = "driven by hand in the live arena; simulated physics, no real robot"
Frames = NDArray[np.float32]


def describe(
    config: ConvoyConfig, line: NDArray[np.float64], *, free: bool = False
) -> dict[str, Any]:
    """Return what a picture needs to know besides frames, as plain values: sizes, line, bounds and
    tiles in m and rad.

    ``free``: whether somebody drives the leader, who may leave the line.
    """
    tiles = None
    if config.sensing != "ir-raw":  # there tiles are of counts and have no place on the floor
        distance, bearing = config.grid().tilings
        tiles = {
            "distance": (distance.edges + config.middle_m).tolist(),
            "bearing": bearing.edges.tolist(),
        }
    thin = line[:: max(1, len(line) // 600)]
    return {
        "robots": config.followers + 1,
        "radius": config.robot.body_radius_m,
        "period": CONTROL_PERIOD,
        "line": np.round(thin, 4).tolist(),
        "line_width": config.track.line_width_m,
        "fields": list(FIELDS),
        "phases": list(PHASES),
        "bounds": {
            "distance": list(config.distance_m),
            "bearing": config.bearing_limit_rad,
            "middle": config.middle_m,
        },
        "tiles": tiles,
        "free": free,
        "ring": RING * config.robot.size,
        "sensors": BEARINGS.tolist() if config.robot == EPUCK else [],
        "shapes": list(ASKED) if config.formation.shaped else [],
    }


class StoredScene:
    """Frames that are all there already.

    Args:
        config: of the convoy.
        frames: (T, robots, len(FIELDS)).
        title: one line that says what is shown.
    """

    live = False
    drivable = False
    ended = True
    generation = 1

    def __init__(self, config: ConvoyConfig, frames: Frames, title: str) -> None:
        self.config = config
        self.frames = frames
        self.title = title
        self.lock = threading.RLock()
        self.about = describe(config, track_of(config).line)

    def __len__(self) -> int:
        return len(self.frames)

    def since(self, first: int) -> Frames:
        """Return the frames from one on."""
        return self.frames[first:]

    @classmethod
    def of_run(cls, run: Run) -> "StoredScene":
        """Return the last whole block of a run."""
        start, steps = sampled_blocks(run.records)[-1]
        unit = "control periods" if run.kind == "evaluate" else "updates"
        return cls(
            run.config,
            _frames_of(steps, run.config),
            f"from the run: the block after {start:,} {unit}".replace(",", " "),
        )

    @classmethod
    def of_motion(cls, motion: Motion, config: ConvoyConfig) -> "StoredScene":
        """Return a motion that was driven under a configuration, sampled once per control period.

        Raises:
            ValueError: another rate or number of robots.
        """
        robots = motion.position.shape[1]
        if robots != config.followers + 1 or not np.isclose(motion.fs, 1 / CONTROL_PERIOD):
            raise ValueError(
                f"a motion of {robots} robots at {motion.fs:g} Hz; expected "
                f"{config.followers + 1} robots, as the configuration "
                f"has, at {1 / CONTROL_PERIOD:g} Hz"
            )
        frames = np.zeros((len(motion.position), robots, len(FIELDS)), np.float32)
        frames[..., :2] = motion.position
        frames[..., 2] = motion.heading
        frames[:, 1:, 3], frames[:, 1:, 4] = motion.errors()
        if motion.command is not None:
            frames[..., 7:9] = motion.command
        frames[..., 5] = -1
        return cls(config, frames, "from a motion")


def _frames_of(steps: NDArray[np.void], config: ConvoyConfig) -> Frames:
    """Return frames of step records (T, robots); distances and bearings are the true ones."""
    frames = np.zeros((*steps.shape, len(FIELDS)), np.float32)
    for name in ("x", "y", "heading", "phase", "left", "right"):
        frames[..., FIELDS.index(name)] = steps[name]
    frames[:, 1:, 3], frames[:, 1:, 4] = Motion.of_steps(steps, robot=config.robot).errors()
    frames[..., 5] = -1
    frames[:-1, :, 5] = np.where(steps["state"] >= 0, steps["state"], -1)[
        1:
    ]  # a record has the state where its action began
    return frames


def _checked(
    commands: Sequence[tuple[int, int]] | NDArray[np.int64], config: ConvoyConfig
) -> NDArray[np.int64]:
    """Return a leader's commands as (T, 2) whole steps/s."""
    given = np.asarray(commands)
    most = config.robot.most_steps
    if given.ndim != 2 or given.shape[1] != 2 or not len(given) or np.abs(given).max() > most:
        raise ValueError(
            f"commands have shape {given.shape}; expected (T, 2) with T >= 1 and whole "
            f"steps/s from -{most} to {most}"
        )
    return given.astype(np.int64)


@contextlib.contextmanager
def whole() -> Iterator[None]:
    """Let an interrupt wait until the block is done: half a control period would leave a scene
    inconsistent.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[Any] = []
    before = signal.signal(signal.SIGINT, lambda *arguments: waiting.append(arguments))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if waiting and callable(before):
            before(*waiting[0])


def _who(law: ControlLaw | None) -> str:
    """Return who drives the followers, in words."""
    if isinstance(law, OwnLaw):
        return "your own law"
    return f"law {law.name!r}" if law is not None else "nobody"


def _check(
    config: ConvoyConfig, policy: Policy | None, law: ControlLaw | None, learn: object, free: bool
) -> None:
    """Refuse what no live scene can show; ``free``: somebody drives the leader."""
    if policy is not None and law is not None:
        raise ValueError(
            "policy and law are both given; expected one of them to drive the followers"
        )
    if (
        isinstance(learn, bool)
        or not isinstance(learn, int)
        or learn < 0
        or (learn and law is not None)
    ):
        raise ValueError(
            f"learn = {learn!r} with law = {law!r}; expected a whole number of updates "
            "from 0, and no law where they learn"
        )
    if config.delay_steps:
        raise ValueError(
            f"ConvoyConfig.compute_time_s = {config.compute_time_s!r} without the buffer; "
            "a live scene runs whole control "
            "periods: expected learner.buffer = True"
        )
    if config.reset == "restart" and free:
        raise ValueError(
            "ConvoyConfig.reset = 'restart' with a leader that somebody drives; it would "
            "be put back at every loss: expected "
            "'manoeuvre'"
        )


class LiveScene:
    """A simulated convoy, one frame per control period.

    Args:
        config: the convoy; its seed too.
        policy, law: who drives the followers; default: a carrot, or θ₀ where they learn.
        learn: updates over which the exploration schedule runs while they learn on; 0: they do not
            learn.
        drive: whether a person drives the leader, by ``steer``.
        commands: (T, 2) wheel commands of the leader, as ``load_drive`` gives them; the scene then
            ends after T periods.

    Attributes:
        convoy: the simulation, open to every use.
        frames: (T, robots, len(FIELDS)) everything so far.
        generation: how often it has begun; lock: what pages hold while they use it.
        commands: list of the leader's commands so far, where a person drives.
    """

    live = True

    def __init__(
        self,
        config: ConvoyConfig,
        *,
        policy: Policy | None = None,
        law: ControlLaw | None = None,
        learn: int = 0,
        drive: bool = False,
        commands: Sequence[tuple[int, int]] | NDArray[np.int64] | None = None,
    ) -> None:
        _check(config, policy, law, learn, drive or commands is not None)
        if policy is not None:
            policy.check(config)
        elif law is None and not learn:
            law = CarrotPI()
        self.config = config
        self.policy = policy
        self.law = law
        self.learn = learn
        self.drivable = drive
        self._stored = None if commands is None else _checked(commands, config)
        self.generation = 0
        self.lock = threading.RLock()
        self._external = drive or commands is not None
        self.restart()
        self.about = describe(config, self.convoy.world.tracks[0].line, free=self._external)
        who = (
            "followers learn"
            if learn
            else ("a learned policy" if policy is not None else _who(law))
        )
        self.title = f"live, simulated ({config.drive}): {who}" + (
            "; you drive the leader" if drive else ""
        )

    def restart(self) -> None:
        """Begin again from the configuration's seed."""
        self.convoy = Convoy(
            self.config,
            [self.config.seed],
            steps=10**12 if self.learn else 0,
            periods=10**12,
            horizon=self.learn or None,
            policy=self.law if self.policy is None else self.policy.theta,
            external=0 if self._external else None,
            threads=1,
        )
        if not self.convoy.has_sensors:
            fit_sensors(self.convoy)
        self.convoy.task["infrared"]["all"] = True  # all sensors are shown
        self._noise = np.random.default_rng(self.config.seed)  # of the readings that are only shown
        self._stick = Joystick(self.config)
        self._joystick = (0.0, 0.0)
        self.commands: list[tuple[int, int]] = []
        self.instructed = False
        self.t = 0
        self.generation += 1
        self._kept: list[Frames] = []

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def frames(self) -> Frames:
        """Everything shown so far."""
        return self.since(0)

    def since(self, first: int) -> Frames:
        """Return the frames from one on."""
        kept = self._kept[first:]
        return (
            np.stack(kept)
            if kept
            else np.zeros((0, self.config.followers + 1, len(FIELDS)), np.float32)
        )

    @property
    def ended(self) -> bool:
        """Whether stored commands are used up."""
        return self._stored is not None and self.t >= len(self._stored)

    def steer(self, turn: float, speed: float) -> None:
        """Hold the joystick there, see ``view.joystick``."""
        self._joystick = (float(turn), float(speed))

    def advance(self, periods: int = 1) -> Frames:
        """Let control periods pass; return their frames, fewer where stored commands end.

        Raises:
            FloatingPointError: learning diverged.
        """
        before = len(self)
        for _ in range(periods):
            if self.ended:
                break
            with whole():
                self._period()
        return self.since(before)

    def _period(self) -> None:
        steps = self.convoy.period(self.t)[0]
        frame = self._frame(steps)
        if self._external:
            left, right = (
                self._stick.steer(*self._joystick)
                if self._stored is None
                else self._stored[self.t].tolist()
            )
            self.convoy.command(0, left, right, self.t)
            self.commands.append((left, right))
            frame[0, 7:9] = left, right
        self.convoy.world.step()
        self.t += 1
        self._kept.append(frame)

    def _frame(self, steps: NDArray[np.void]) -> Frames:
        robots = self.convoy.robots[0]
        frame = np.zeros((len(robots), len(FIELDS)), np.float32)
        for name in ("x", "y", "heading", "phase", "left", "right"):
            frame[:, FIELDS.index(name)] = steps[name]
        frame[1:, 3] = np.minimum(robots["seen"]["distance"][1:], 10.0)
        frame[1:, 4] = robots["seen"]["bearing"][1:]
        frame[:, 5] = np.where(steps["phase"] == 0, robots["choice"]["state"], -1)
        frame[0, 5] = -1
        if not self.convoy.task["infrared"]["sees"][0]:
            for i in range(1, len(robots)):
                sense(self.convoy.task, robots, i, self._noise.standard_normal(SENSORS))
        frame[:, READINGS] = robots["infrared"]["readings"]
        if self.config.formation.shaped:
            frame[1:, PLACES] = self.convoy.places[0]
        return frame

    def instruct(self, shape: str, points: ArrayLike = ()) -> None:
        """Ask the formation for a shape, see ``Convoy.instruct``.

        Raises:
            ValueError: no such shape, or none that robots can keep.
        """
        self.convoy.instruct(shape, points)
        self.instructed = True

    def save_drive(self, path: str | Path) -> Path:
        """Record the drive so far: drive it again behind the robot API, the leader's own readings
        with its commands.

        Raises:
            ValueError: nobody has driven yet.
            FileExistsError: there is something at path already.
            RuntimeError: it came out otherwise, as the scene was changed by hand; nothing is kept
                then.
        """
        if not self.commands:
            raise ValueError(
                "nobody has driven yet; there is nothing to save: start the scene with "
                "drive=True and press play"
            )
        if self.instructed:
            raise ValueError(
                "the formation has been asked for another shape on the way, which a recording does "
                "not hold: press restart and drive with one shape"
            )
        others = self.policy if self.policy is not None else self.law
        with SimulatedRobot(self.config, robot=0, others=others, learn=self.learn) as robot:
            robot.enable(*({"proximity", "floor", "motor_position"} & robot.capabilities))
            who = others.sha256() if others is not None else "none"
            note = f"{NOTE}; followers: {who}, learning over {self.learn} updates"
            same = True
            with Recorder(
                path, robot, link="sim:", real=False, config=self.config, note=note
            ) as recorder:
                for command, frame in zip(self.commands, self._kept, strict=True):
                    robot.step()
                    same &= bool(
                        np.array_equal(robot.record["x"], frame[:, 0])
                        and np.array_equal(robot.record["y"], frame[:, 1])
                    )
                    robot.set_motors_speed(*command)
                    recorder.add(robot.time_s, robot, command=command)
                robot.step()
        if not same:
            for file in (Path(path), Path(path).with_suffix(".json")):
                file.unlink()
            raise RuntimeError(
                "the drive came out otherwise when it was driven again (was the scene changed "
                "by hand?); nothing is saved"
            )
        return Path(path)


def load_drive(path: str | Path) -> tuple[ConvoyConfig, NDArray[np.int64]]:
    """Read configuration and commands (T, 2) of a drive that ``save_drive`` recorded.

    Raises:
        ValueError: another kind of recording.
    """
    recording = load_recording(path)
    if recording.config is None or not str(recording.header.get("note", "")).startswith(NOTE):
        raise ValueError(
            f"{path} is no drive of a leader by hand; expected a recording that the live "
            "arena saved"
        )
    return recording.config, recording.frame[["left_command", "right_command"]].to_numpy(np.int64)
