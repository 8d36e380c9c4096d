"""The configuration of a convoy: everything that a run depends on, apart from its length."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workbench.arena.camera.config import CameraConfig
from workbench.arena.drives.table import DRIVES
from workbench.arena.tracks import TrackConfig
from workbench.fields import (
    Named,
    choice,
    configuration,
    flag,
    integer,
    integers,
    part,
    real,
    reals,
)
from workbench.formation.body import BodyConfig
from workbench.formation.estimate import FILTERS, LONGEST_S, PREDICTIONS, EstimateConfig
from workbench.formation.graph import Edges, check_graph, shortest_rigid
from workbench.formation.output import ACTIONS, LEARN_BY, OUTPUTS
from workbench.formation.reward import GRAPH, OWN, PRESETS
from workbench.formation.senses.range_bearing import RangeBearingConfig
from workbench.formation.senses.table import KEEPING, SENSES
from workbench.formation.shapes import FormationConfig, check_shape, places, random_reach
from workbench.learning.config import LearnerConfig
from workbench.learning.rules import RULES
from workbench.learning.tiles import MAX_TILES, MAX_TILINGS, TileGrid, Tiling, offset_grids
from workbench.robot.description import EPUCK, RobotConfig
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.ground import MODULES
from workbench.robot.infrared import InfraredConfig

TILINGS = ("uniform", "logarithmic")
FASTEST = 10.0  # m/s, of any robot


@configuration
class ConvoyConfig:
    """One leader and its followers: the robots, the track, the task and the learner.

    What the paper states is taken from it: up to four followers, 9×9 states and 7×7 actions in
    simulation. It gives no speeds, bounds, control period, reward or step sizes; these defaults are
    our choice.
    """

    followers: int = integer(1, 256, "", "robots behind the leader", default=4)
    drive: str = choice(tuple(DRIVES), "fidelity of the simulated robot", default="wheels")
    robot: RobotConfig = part(RobotConfig, "sizes, masses and motors of the robots", default=EPUCK)
    sensing: str = choice(
        tuple(SENSES),
        "where the errors come from: "
        + "; ".join(f"{row.name} {row.tells}" for row in SENSES.values()),
        default="truth",
    )
    noise_distance_m: float = real(
        0.0, 0.1, "m", "standard deviation of white noise on the sensed distance", default=0.0
    )
    noise_bearing_rad: float = real(
        0.0, 1.0, "rad", "standard deviation of white noise on the sensed bearing", default=0.0
    )
    camera: CameraConfig = part(CameraConfig, "the overhead camera", default=CameraConfig())
    infrared: InfraredConfig = part(
        InfraredConfig, "proximity sensors and what they look at", default=InfraredConfig()
    )
    range_bearing: RangeBearingConfig = part(
        RangeBearingConfig, "the ring of infrared receivers", default=RangeBearingConfig()
    )
    body: BodyConfig = part(
        BodyConfig, "how robots and their link differ from the nominal ones", default=BodyConfig()
    )
    threshold_counts: float = real(
        1.0,
        1000.0,
        "counts",
        "infrared readings below it do not count as seen; 12 are ten standard deviations",
        default=12.0,
    )
    track: TrackConfig = part(TrackConfig, "the line on the floor", default=TrackConfig())
    ground: str = choice(
        tuple(MODULES), "which measured ground sensors the leader has", default="a"
    )
    ground_calibrated: bool = flag(
        "whether the leader has learned black and white from its own sensors; otherwise it "
        "takes them for those of module a",
        default=True,
    )
    leader_speed_mps: float = real(
        0.005, FASTEST, "m/s", "constant speed of the leader", default=0.06
    )
    distance_m: tuple[float, float] = reals(
        0.0201,
        20.0,
        "m",
        "terminal distances between centres; d* is the middle",
        default=(0.08, 0.22),
    )
    bearing_limit_rad: float = real(
        0.05, math.pi, "rad", "terminal bearing on both sides", default=math.pi / 4
    )
    state_tiles: tuple[int, int] = integers(
        1, MAX_TILES, "", "cells of distance and bearing", default=(9, 9)
    )
    distance_tiling: str = choice(TILINGS, "spacing of the distance cells", default="uniform")
    bearing_tiling: str = choice(TILINGS, "spacing of the bearing cells", default="uniform")
    tilings: int = integer(
        1,
        MAX_TILINGS,
        "",
        "offset tilings of the state, a power of two; the paper has one",
        default=1,
    )
    inner_distance_m: float = real(
        1e-4, 5.0, "m", "half width of the middle distance cell (logarithmic)", default=0.003
    )
    inner_bearing_rad: float = real(
        1e-3,
        3.0,
        "rad",
        "half width of the middle bearing cell (logarithmic)",
        default=math.radians(2),
    )
    action_levels: tuple[int, int] = integers(
        1, MAX_TILES, "", "speed levels of the left and the right wheel", default=(7, 7)
    )
    wheel_speed_mps: tuple[float, float] = reals(
        -FASTEST, FASTEST, "m/s", "slowest and fastest level of a wheel", default=(0.03, 0.09)
    )
    actions: str = choice(
        ACTIONS,
        "what the levels are: wheel speeds, or relative: less their middle, they are added to the "
        "estimated speed of the predecessor",
        default="wheels",
    )
    output: str = choice(
        OUTPUTS,
        "what a table commands: its greedy action, or the mean of those of the four nearest cells",
        default="greedy",
    )
    trim: float = real(
        0.0,
        1.0,
        "1/control period",
        "gain of the integral of the distance error that a table is told; 0 for none",
        default=0.0,
    )
    trim_limit_m: float = real(
        0.0, 10.0, "m", "how large the integral of the distance error may be", default=0.03
    )
    learn_by: str = choice(
        LEARN_BY,
        "what a follower that learns drives by: the table's own actions, or its output; who copies "
        "does not learn",
        default="table",
    )
    filter: str = choice(
        FILTERS, "whether a follower filters what it sees of its predecessor", default="none"
    )
    prediction: str = choice(
        PREDICTIONS,
        "who is moved ahead to where the next command arrives: nobody, the follower by its own "
        "commands, or its predecessor, too",
        default="none",
    )
    estimate: EstimateConfig = part(
        EstimateConfig, "what filter and prediction assume", default=EstimateConfig()
    )
    reward: str = choice(
        (*PRESETS, OWN, GRAPH),
        "reward preset, all ours; own: a function, see learn(reward=…); graph: on distances "
        "between the robots of a shape",
        default="quadratic",
    )
    terminal_factor: float = real(
        1.0, 1000.0, "", "terminal reward in units of the worst step reward / (1 - γ)", default=1.0
    )
    reset: str = choice(
        ("manoeuvre", "restart"),
        "after a loss: drive back (II-C), or restart the simulation",
        default="manoeuvre",
    )
    sight_m: float = real(
        0.1, 100.0, "m", "distance within which a lost predecessor can be seen", default=2.0
    )
    compute_time_s: float = real(
        0.0,
        CONTROL_PERIOD,
        "s",
        "simulated time that one update takes; without the buffer the command waits for it",
        default=0.0,
    )
    weights: str = choice(
        ("own", "shared", "first"),
        "own tables; one shared table; the first learns, others copy",
        default="own",
    )
    formation: FormationConfig = part(
        FormationConfig, "who drives where: the shape", default=FormationConfig()
    )
    learner: LearnerConfig = part(
        LearnerConfig, "step sizes, discount, exploration", default=LearnerConfig()
    )
    seed: int = integer(0, 2**63 - 1, "", "seed of everything random in the run", default=1)
    fleet: int = integer(
        0,
        2**63 - 1,
        "",
        "seed of who the robots are: sensors, wheels, axles and the camera's lens; 0 takes "
        "that of the run",
        default=0,
    )

    def _check(self) -> None:
        for name in ("distance_m", "wheel_speed_mps"):
            low, high = getattr(self, name)
            if low >= high:
                raise ValueError(
                    f"ConvoyConfig.{name} = {(low, high)!r}; expected (low, high) with low < high"
                )
        low, high = self.wheel_speed_mps
        paced = self.actions == "relative" or low <= self.leader_speed_mps <= high
        if not paced:
            raise ValueError(
                f"ConvoyConfig.leader_speed_mps = {self.leader_speed_mps!r}; followers can "
                "only keep pace if it lies "
                f"within wheel_speed_mps = {self.wheel_speed_mps!r}"
            )
        self._check_robot()
        if self.sight_m < self.distance_m[1]:
            raise ValueError(
                f"ConvoyConfig.sight_m = {self.sight_m!r}; expected at least the terminal "
                f"distance {self.distance_m[1]!r} m: a "
                "predecessor that is followed must be in sight"
            )
        if self.middle_m > self.track.radius_m:
            raise ValueError(
                f"ConvoyConfig.distance_m = {self.distance_m!r} asks for d* = "
                f"{self.middle_m:g} m on a track with radius_m = "
                f"{self.track.radius_m!r}; expected d* up to the radius: enlarge track.radius_m"
            )
        SENSES[self.sensing].check(self)
        self._check_formation()
        self._check_estimate()
        self._check_time()
        # refuses an even number of logarithmic cells and inner cells wider than the range
        self.grids()

    def _check_formation(self) -> None:
        """Refuse shapes that cannot be sensed, or that no robot can keep."""
        told = self.formation
        self._check_graph()
        if not told.shaped:
            return
        if self.sensing not in KEEPING:
            raise ValueError(
                f"ConvoyConfig.sensing = {self.sensing!r} with formation.frame = "
                f"{told.relative_to!r}; places are by the leader, whom nobody sees past others: "
                f"expected one of {', '.join(KEEPING)}"
            )
        fastest = min(self.robot.most_mps, self.wheel_speed_mps[1])
        if self.actions == "relative":
            fastest = self.robot.most_mps
        check_shape(
            told,
            self.places,
            leader_mps=self.leader_speed_mps,
            fastest_mps=fastest,
            radius_m=self.track.radius_m,
            track_m=self.robot.track_m,
            body_radius_m=self.robot.body_radius_m,
        )

    def _check_graph(self) -> None:
        """Refuse rewards on distances that do not hold the shape, and edges without them."""
        told = self.formation
        if told.edges and self.reward != GRAPH:
            raise ValueError(
                f"FormationConfig.edges = {told.edges!r} with reward = {self.reward!r}; expected "
                f"edges with reward = {GRAPH!r}, and only there"
            )
        if self.reward != GRAPH:
            return
        if told.relative_to != "heading":
            raise ValueError(
                f"ConvoyConfig.reward = {GRAPH!r} with formation.frame = {told.relative_to!r}; a "
                "shape has distances of its own where it does not bend with a path: expected "
                "formation.frame = 'heading'"
            )
        check_graph(self._framework, self.edges)

    @property
    def _framework(self) -> NDArray[np.float64]:
        """Leader and places, (followers + 1, 2) in m, that a graph must hold; of random ones a
        wedge: what holds one shape holds nearly all.
        """
        told = self.formation
        shape = "wedge" if told.shape == "random" else told.shape
        found = places(shape, self.followers, self.spacing_m, told.points)
        return np.vstack([[[0.0, 0.0]], found])

    @property
    def edges(self) -> Edges:
        """Edges that reward "graph" is of; none with another reward."""
        if self.reward != GRAPH:
            return ()
        return self.formation.edges or shortest_rigid(self._framework)

    @property
    def spacing_m(self) -> float:
        """Distance between neighbouring places in m."""
        return self.formation.spacing_m or self.middle_m

    @property
    def places(self) -> NDArray[np.float64]:
        """Places of the formation's shape, (followers, 2) in m; of random ones the corners of where
        they are drawn, (2, 2).
        """
        told = self.formation
        if told.shape == "random":
            depth, width = random_reach(self.followers, self.spacing_m)
            return np.array([[-depth, width], [-depth, -width]])
        return places(told.shape, self.followers, self.spacing_m, told.points)

    def _check_time(self) -> None:
        """Refuse what does not go together in time: whose weights, delays, time steps."""
        if RULES[self.learner.rule].remembers and self.weights == "shared":
            raise ValueError(
                f"ConvoyConfig.weights = 'shared' with learner.rule = {self.learner.rule!r}; "
                "what this rule remembers of its last "
                "update is wrong once others have written to its table: expected weights = "
                "'own' or 'first'"
            )
        if self.body.delay and self.delay_steps:
            raise ValueError(
                f"ConvoyConfig.body.delay = {self.body.delay!r} with compute_time_s = "
                f"{self.compute_time_s!r} and no buffer; "
                "expected one or the other: give the whole delay in control periods"
            )
        timestep = DRIVES[self.drive].timestep_s
        steps = self.compute_time_s / timestep
        if not math.isclose(steps, round(steps), rel_tol=1e-9):
            raise ValueError(
                f"ConvoyConfig.compute_time_s = {self.compute_time_s!r}; expected a multiple "
                f"of {timestep:g} s, "
                f"the time step of the {self.drive!r} drive"
            )

    def _check_estimate(self) -> None:
        """Refuse to filter and foresee what has no metres, and longer delays than are foreseen."""
        if not self.estimates:
            return
        if not SENSES[self.sensing].metric:
            others = ", ".join(repr(row.name) for row in SENSES.values() if row.metric)
            raise ValueError(
                f"ConvoyConfig.filter = {self.filter!r}, prediction = {self.prediction!r}, "
                f"actions = {self.actions!r} with sensing = {self.sensing!r}; what it tiles are "
                "readings, and nobody knows how they change with the place: expected filter = "
                f"'none', prediction = 'none' and actions = 'wheels', or sensing = {others}"
            )
        if self.late_s > LONGEST_S:
            raise ValueError(
                f"body.delay = {self.body.delay!r} with readings that are "
                f"{SENSES[self.sensing].age(self):g} s old makes {self.late_s:g} s; expected at "
                f"most {LONGEST_S:g} s to be foreseen"
            )

    def _check_robot(self) -> None:
        robot = self.robot
        most = self.robot.most_mps * (1 + 1e-9)
        if self.distance_m[0] <= 2 * robot.body_radius_m:
            raise ValueError(
                f"ConvoyConfig.distance_m = {self.distance_m!r}; two robots touch at "
                f"{2 * robot.body_radius_m:g} m: expected a near bound above that; "
                "config.with_robot(robot) scales distances, speeds and track with a robot"
            )
        if max(abs(speed) for speed in self.wheel_speed_mps) > most:
            raise ValueError(
                f"ConvoyConfig.wheel_speed_mps = {self.wheel_speed_mps!r}; expected at most "
                f"{robot.most_mps:.4f} m/s, "
                "what this robot's wheels do"
            )
        if robot != EPUCK and SENSES[self.sensing].epuck:
            others = ", ".join(repr(row.name) for row in SENSES.values() if not row.epuck)
            raise ValueError(
                f"ConvoyConfig.sensing = {self.sensing!r} with a robot that is no e-puck; "
                "markers, readings and what "
                f"they look at were measured on e-pucks: expected {others} (with "
                "noise_distance_m, noise_bearing_rad)"
            )

    @property
    def noisy(self) -> bool:
        """Whether sensed distances or bearings get white noise."""
        return self.noise_distance_m > 0 or self.noise_bearing_rad > 0

    @property
    def estimates(self) -> bool:
        """Whether followers keep an estimate of their predecessor, see ``formation.estimate``."""
        return (self.filter, self.prediction, self.actions) != ("none", "none", "wheels")

    @property
    def late_s(self) -> float:
        """How late a command moves the wheels, from when what is seen was true, as a follower
        assumes it.
        """
        known = self.body.delay * CONTROL_PERIOD + SENSES[self.sensing].age(self)
        known += self.delay_steps * DRIVES[self.drive].timestep_s
        return self.estimate.delay_s or known

    @property
    def middle_m(self) -> float:
        """The wanted distance d*, the middle of the bounds (requirement S1)."""
        return (self.distance_m[0] + self.distance_m[1]) / 2

    @property
    def half_range_m(self) -> float:
        """Largest |e_d|: half the distance between the bounds."""
        return (self.distance_m[1] - self.distance_m[0]) / 2

    @property
    def delay_steps(self) -> int:
        """Physics steps for which commands wait for an update; none with the buffer."""
        return (
            0 if self.learner.buffer else round(self.compute_time_s / DRIVES[self.drive].timestep_s)
        )

    def grid(self) -> TileGrid:
        """Return the tilings of the distance error (m) and of the bearing (rad), in the order of
        the state index.

        With sensing "ir-raw": of the left and the right front reading in counts, see
        ``workbench.formation.readings``.
        """
        own = SENSES[self.sensing].tilings
        if own is not None:
            return TileGrid(*own(self))
        tilings = []
        for kind, count, half, inner, name in (
            (
                self.distance_tiling,
                self.state_tiles[0],
                self.half_range_m,
                self.inner_distance_m,
                "inner_distance_m",
            ),
            (
                self.bearing_tiling,
                self.state_tiles[1],
                self.bearing_limit_rad,
                self.inner_bearing_rad,
                "inner_bearing_rad",
            ),
        ):
            try:
                if kind == "uniform":
                    tilings.append(Tiling.uniform(-half, half, count))
                else:
                    tilings.append(Tiling.logarithmic(-half, half, count, inner=inner))
            except ValueError as error:
                raise ValueError(
                    f"ConvoyConfig.state_tiles = {self.state_tiles!r} with {name} = "
                    f"{inner!r}: {error}"
                ) from None
        return TileGrid(*tilings)

    def grids(self) -> tuple[TileGrid, ...]:
        """Return the offset grids whose cells are the features; the first one is ``grid()``, whose
        cells are the states.
        """
        try:
            return offset_grids(self.grid(), self.tilings)
        except ValueError as error:
            raise ValueError(f"ConvoyConfig.tilings = {self.tilings!r}: {error}") from None

    @property
    def rows(self) -> int:
        """Number of rows of a weight table: cells of all grids together; with one tiling the number
        of states.
        """
        return sum(grid.n for grid in self.grids())

    def levels(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the speed levels of the left and right wheel in whole steps/s, slowest first; with
        relative actions about their middle.
        """
        low, high = self.wheel_speed_mps
        base = (low + high) / 2 if self.actions == "relative" else 0.0
        left, right = (
            np.array(
                [self.robot.steps(float(v)) for v in np.linspace(low - base, high - base, count)],
                dtype=np.int64,
            )
            for count in self.action_levels
        )
        return left, right

    @property
    def action_count(self) -> int:
        """Number of actions, the full product of both wheels' levels."""
        return self.action_levels[0] * self.action_levels[1]

    def with_robot(self, robot: RobotConfig) -> "ConvoyConfig":
        """Return the same task for another robot: lengths scaled by its body's radius, speeds by
        its wheels' fastest.

        What is scaled: distances, the track with its judder and line, sight, noise of distances,
        the limit of the trim; speeds of leader and wheels, expected accelerations. Angles, rewards
        (in units of the bounds) and the control period stay. ``replace`` sets single values
        afterwards.
        """
        if not isinstance(robot, RobotConfig):
            raise TypeError(
                f"robot = {robot!r}; expected a RobotConfig, as load_robot({robot!r}) gives it"
            )
        size = robot.body_radius_m / self.robot.body_radius_m
        pace = robot.most_mps / self.robot.most_mps
        return replace(
            self,
            robot=robot,
            track=self.track.scaled(size),
            distance_m=_times(size, self.distance_m),
            sight_m=size * self.sight_m,
            inner_distance_m=size * self.inner_distance_m,
            noise_distance_m=size * self.noise_distance_m,
            trim_limit_m=size * self.trim_limit_m,
            estimate=replace(
                self.estimate,
                noise_distance_m=size * self.estimate.noise_distance_m,
                acceleration_mps2=pace * self.estimate.acceleration_mps2,
            ),
            leader_speed_mps=pace * self.leader_speed_mps,
            wheel_speed_mps=_times(pace, self.wheel_speed_mps),
            formation=self.formation.scaled(size, pace),
            range_bearing=replace(
                self.range_bearing,
                range_m=size * self.range_bearing.range_m,
                noise_range_m=size * self.range_bearing.noise_range_m,
            ),
        )

    def alone(self) -> "ConvoyConfig":
        """Return the configuration with the first follower only."""
        return replace(self, followers=1, formation=replace(self.formation, edges=()))

    def with_seed(self, seed: int) -> "ConvoyConfig":
        """Return the same configuration with another seed."""
        return replace(self, seed=seed)


def _times(factor: float, pair: tuple[float, float]) -> tuple[float, float]:
    return factor * pair[0], factor * pair[1]


# Named settings. "paper": tiles and actions that the paper states for its simulation; "paper-
# robot": those for its robots; "logarithmic": the paper's other spacing, with initial values that
# leave room to improve on; "offset": four coarse tilings that together resolve 7 mm × 4.5°, the
# best of all that were tried without an output stage (notebook 12). "recommended": few cells, few
# actions, and commands interpolated between them, with a trim that takes away the offset: 135
# weights, exact, calm, also under noise. "infrared": with nothing but the two front sensors, 8 to
# 13 cm and ±25° (notebook 05).
SETTINGS = Named[ConvoyConfig](
    {
        "paper": ConvoyConfig(),
        "paper-robot": ConvoyConfig(state_tiles=(5, 5), action_levels=(3, 3)),
        "logarithmic": ConvoyConfig(
            distance_tiling="logarithmic",
            bearing_tiling="logarithmic",
            learner=LearnerConfig(theta0=0.0),
        ),
        "offset": ConvoyConfig(state_tiles=(5, 5), tilings=4),
        "recommended": ConvoyConfig(
            state_tiles=(5, 3), action_levels=(3, 3), output="interpolated", trim=0.01
        ),
        "infrared": ConvoyConfig(
            sensing="ir-metric",
            distance_m=(0.08, 0.13),
            bearing_limit_rad=math.radians(25),
            leader_speed_mps=0.05,
            distance_tiling="logarithmic",
            bearing_tiling="logarithmic",
            inner_distance_m=0.002,
        ),
    }
)


def expect_config(config: object) -> None:
    """Raise TypeError unless it is a ConvoyConfig."""
    if not isinstance(config, ConvoyConfig):
        raise TypeError(
            f"config is a {type(config).__name__}; expected a ConvoyConfig, such as "
            "SETTINGS['recommended']"
        )
