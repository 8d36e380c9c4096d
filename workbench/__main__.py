"""The command line: ``python -m workbench VERB``. Thin: one function a verb, which reads flags,
calls the package and prints. What a verb needs is imported when it is called.

The last line of every verb is one JSON object.
"""

import importlib
import json
import math
import os
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import click

from workbench.robot import ends
from workbench.robot.faults import RobotError

Result = dict[str, Any]

# what bad input, a full disk or a diverging run raise: one line, no traceback
ERRORS = (ValueError, TypeError, OSError, ArithmeticError, RuntimeError, MemoryError, ImportError)
ROBOT_VERBS = ("emulate", "drive", "record", "hello")
VALIDATIONS = {
    "drive": "workbench.studies.validation.drives:validate_drive",
    "infrared": "workbench.studies.validation.infrared:validate_infrared",
    "tiles": "workbench.studies.validation.tiles:validate_tiles",
    "camera": "workbench.studies.validation.camera:validate_camera",
    "deadlines": "workbench.studies.validation.deadlines:measure_deadlines",
}
_UNITS = """Units: speeds in m/s or motor steps/s (1 step = 0.1288 mm), lengths in m (…_m), angles
in rad (…_rad) or degrees (…_deg), errors in mm (…_mm), times in simulated minutes or wall-clock
seconds (wall_s). STEPS are learning updates, summed over the followers. A share is a part of all
visits; …_all_time has reset and lost time in the denominator.

Fields for --set NAME=VALUE, in their order (dots for parts: --set learner.alpha=0.05,
--set track.shape=eight). --set robot=large, or robot=FILE.json, takes a robot's file and scales
distances, speeds and track with it; what is set after that stays.
"""


class _Place(click.ParamType):
    """A path; "~" is the user's home, also behind an equals sign, where a shell leaves it."""

    name = "path"

    def convert(self, value: Any, param: Any, ctx: Any) -> str:
        return str(Path(value).expanduser())


class _WithFields(click.Command):
    """A verb whose help ends with the fields of a configuration."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        from workbench import fields
        from workbench.formation.config import ConvoyConfig

        config = ConvoyConfig()
        values = {name: getattr(config, name) for name in fields.to_dict(config)}
        parts = {name: type(value) for name, value in values.items() if is_dataclass(value)}
        told = (
            f"{name and name + ':'}\n{fields.describe(cls)}"
            for name, cls in ({"": ConvoyConfig} | parts).items()
        )
        formatter.write("\n" + _UNITS + "\n".join(told) + "\n")


PLACE = _Place()


class _Count(click.ParamType):
    """A whole number, also as 1e5 or 100_000."""

    name = "number"

    def convert(self, value: Any, param: Any, ctx: Any) -> int:
        """Return the number."""
        try:
            number = float(str(value).replace("_", ""))
        except ValueError:
            number = math.nan
        if not number.is_integer():
            self.fail(f"{value!r} is no whole number, such as 100000 or 1e5", param, ctx)
        return int(number)


COUNT = _Count()


class _Verbs(click.Group):
    """The verbs; a wrong one is answered with what it is like."""

    def resolve_command(self, ctx: Any, args: Any) -> Any:
        """Return the command that is asked for."""
        if args and args[0] not in self.commands and not args[0].startswith("-"):
            from workbench.fields import did_you_mean

            listed = ", ".join(sorted(self.commands))
            hint = did_you_mean(args[0], self.commands)
            ctx.fail(f"no verb {args[0]!r}; expected one of {listed}{hint}")
        return super().resolve_command(ctx, args)


@click.group(
    cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
def verbs() -> None:
    """Formation control with Greedy-GQ(λ).

    A terminal gets a table; a pipe, or --json, one JSON object as the last line.
    """


def _option(*names: str, **kinds: Any) -> Callable[..., Any]:
    return click.option(*names, **({"default": None} | kinds))


@verbs.command(cls=_WithFields)
@_option("--steps", type=COUNT, help="Learning updates of all followers (default 1_300_000).")
@_option("--setting", help="paper, paper-robot, logarithmic, offset, recommended, infrared.")
@_option("--followers", type=COUNT, help="Robots behind the leader (default 4).")
@_option("--drive", help="Simulated robot: wheels (default), planar or, for sweeps, rolling.")
@_option("--sensing", help="Where errors come from: truth (default), camera, ir-metric, ir-raw, …")
@_option("--seed", type=COUNT, help="Seed of everything random (default 1).")
@_option("--out", type=PLACE, help="Folder; new or empty, unless --resume. Without: not kept.")
@click.option("--resume", is_flag=True, help="Continue the run in --out, or show a complete one.")
@click.option(
    "--set", "fields_set", multiple=True, metavar="NAME=VALUE", help="Any field, as JSON."
)
def learn(
    steps: int | None,
    setting: str | None,
    out: str | None,
    resume: bool,
    fields_set: Any,
    **given: Any,
) -> Result:
    """Let followers learn online; prints the run's summary."""
    from workbench import fields
    from workbench.formation.config import SETTINGS, ConvoyConfig
    from workbench.lab import runs

    values = fields.to_dict(ConvoyConfig())
    length = 1_300_000
    if setting is not None:
        if resume:
            raise ValueError(f"--setting {setting!r}; a run that is resumed keeps its own")
        if setting not in SETTINGS:
            hint = fields.did_you_mean(setting, SETTINGS)
            listed = ", ".join(SETTINGS)
            raise ValueError(f"--setting {setting!r}; expected one of {listed}{hint}")
        values = fields.to_dict(SETTINGS[setting])
    if out is None:
        if resume:
            raise ValueError("--resume without --out; expected the folder of the run: --out FOLDER")
    elif resume:
        try:
            config, length = runs.stored_request(out)
            values = fields.to_dict(config)
        except FileNotFoundError:
            pass  # killed before it began: begin
    config = _configure(values, given, fields_set)
    length = fields.positive("steps", length if steps is None else steps)
    if out is None:
        click.echo("nothing of this run is kept; --out FOLDER keeps it", err=True)
    return dict(runs.learn(config, steps=length, out=out, resume=resume).summary)


@verbs.command(cls=_WithFields)
@click.argument("run", type=PLACE)
@click.option("--minutes", type=float, default=30.0, help="Simulated minutes (default 30).")
@_option("--drive", help="Wheels, planar or rolling (default: the run's).")
@_option("--seed", type=COUNT, help="Seed (default: a run's + 1000, another track; for a law 1).")
@_option("--out", type=PLACE, help="Store the evaluation in this folder.")
@click.option("--resume", is_flag=True, help="Continue the interrupted evaluation in --out.")
@click.option(
    "--set", "fields_set", multiple=True, metavar="NAME=VALUE", help="Any field, as JSON."
)
def evaluate(
    run: str, minutes: float, out: str | None, resume: bool, fields_set: Any, **given: Any
) -> Result:
    """Follow a run's policy greedily, without learning.

    RUN is the folder of a complete run, or the name of a classical law: carrot, leader-frame,
    l-psi, pursuit, path.
    """
    from workbench import fields
    from workbench.formation.config import ConvoyConfig
    from workbench.formation.laws.table import LAWS, Controller
    from workbench.lab import runs

    policy: Controller
    if Path(run).exists():
        stored = runs.load_run(run)
        policy = stored.policy
        config = runs.elsewhere(stored, None)
    elif run in LAWS:
        policy = LAWS[run]()
        config = ConvoyConfig()
    else:
        hint = fields.did_you_mean(run, LAWS)
        listed = ", ".join(LAWS)
        raise FileNotFoundError(f"{run} holds no run, and is no classical law ({listed}){hint}")
    config = _configure(fields.to_dict(config), given, fields_set)
    return dict(runs.evaluate(policy, config, minutes=minutes, out=out, resume=resume).summary)


@verbs.command()
@click.option("--peers", "others", is_flag=True, help="Time other simulators that are installed.")
def bench(others: bool) -> Result:
    """Measure speed against bare MuJoCo, start, sweeps and memory (some minutes)."""
    from workbench.bench import bench

    return bench(others=others, progress=True)


@verbs.command()
@click.argument("name", default="list")
@_option("--scheduler", help="Address of a dask scheduler, tcp://HOST:PORT; default: all cores.")
@click.option("--workers", type=int, default=0, help="Processes here (default: one per core).")
@_option("--out", type=PLACE, help="Folder of the table (default data/studies/).")
def study(name: str, scheduler: str | None, workers: int, out: str | None) -> Result:
    """Run a study and write its table; continues where it stopped.

    NAME is the name of a study, "all", or "list" to see what there is.
    """
    from workbench.studies.tables import STUDIES, run_study

    if name == "list":
        for one in STUDIES.values():
            click.echo(f"{one.name:12} {one.question}")
        return {"studies": list(STUDIES)}
    names = list(STUDIES) if name == "all" else [name]
    folder = Path(out) if out else None
    with ExitStack() as stack:
        executor = None
        if scheduler:
            from distributed import Client

            client = stack.enter_context(Client(scheduler, timeout="20s"))
            functions = [STUDIES[one].function for one in names if one in STUDIES]
            _same_sources(client, functions)
            executor = client.get_executor()
        tables = {
            one: run_study(one, executor=executor, workers=workers, out=folder) for one in names
        }
    return {"lines": {one: len(table) for one, table in tables.items()}}


def _same_sources(client: Any, functions: list[Callable[..., Any]]) -> None:
    """Refuse a cluster without workers, or with workers that run other sources than these."""
    from workbench.sources import digest_of

    others: set[str] = set()
    for function in functions:
        theirs = client.run(digest_of, function)
        if not theirs:
            raise RuntimeError("the scheduler has no workers; start some with: dask worker ADDRESS")
        ours = digest_of(function)
        others |= {worker for worker, digest in theirs.items() if digest != ours}
    if others:
        raise RuntimeError(
            "workers with other sources or versions of the workbench: "
            f"{', '.join(sorted(others))}; update them"
        )


@verbs.command()
@click.argument("what")
@_option("--out", type=PLACE, help="Folder of the aggregates (default data/validation/).")
def validate(what: str, out: str | None) -> Result:
    """Compare with recordings of real robots (WORKBENCH_RECORDINGS), pixels, or the clock.

    WHAT is drive (wheels against set-points), infrared (proximity and ground sensors), tiles (of
    real readings), camera (pixels) or deadlines (clock).
    """
    if what not in VALIDATIONS:
        *most, last = VALIDATIONS
        from workbench.fields import did_you_mean

        hint = did_you_mean(what, [*most, last])
        raise ValueError(f"validate {what!r}; expected {', '.join(most)} or {last}{hint}")
    module, name = VALIDATIONS[what].split(":")
    result: Result = getattr(importlib.import_module(module), name)(out=Path(out) if out else None)
    return result


@verbs.command("export-c")
@click.argument("run", type=PLACE)
@click.option("--out", type=PLACE, required=True, help="C file to write.")
@click.option("--table", type=int, default=0, help="Whose weights; 0: the first follower's.")
def export_c(run: str, out: str, table: int) -> Result:
    """Write a policy on raw infrared readings as a C99 file for a firmware, with the output and the
    trim of its run.

    RUN is the folder of a complete run, or a weights file.
    """
    from workbench import fields
    from workbench.formation.config import ConvoyConfig
    from workbench.lab.weights import load_weights
    from workbench.logs import export_c

    weights = load_weights(run)
    policy = weights.learned(run)
    config = fields.from_dict(ConvoyConfig, weights.about["config"])
    source = f"weights {policy.sha256()[:12]}, follower {table + 1}"
    sizes = export_c.export_c(policy, out, table=table, source=source, config=config)
    return sizes | {"written": out}


@verbs.command()
@click.argument("protocol")
@click.option("--port", type=int, default=0, help="TCP port (default: a free one).")
@click.option(
    "--rate", type=float, default=1.0, help="Simulated s per s; 0: moves when it is read."
)
@click.option("--seconds", type=float, default=0.0, help="End after so long (default: Ctrl-C).")
def emulate(protocol: str, port: int, rate: float, seconds: float) -> Result:
    """Serve an emulated robot on a pseudo-terminal or a TCP port.

    PROTOCOL is epuck1, epuck1-bt, overo (SerCom on a pseudo-terminal) or epuck2 (TCP).
    """
    from workbench.logs import sessions

    return {"url": sessions.emulate(protocol, port=port, rate=rate, seconds=seconds)}


@verbs.command()
@click.option(
    "--robot", required=True, help="sim:, serial:PORT, board:PORT, overo:PORT or tcp:HOST[:PORT]."
)
@click.option("--weights", type=PLACE, required=True, help="Folder of the run.")
@click.option("--seconds", type=float, default=60.0, help="How long (default 60).")
@click.option("--learn", type=COUNT, default=0, help="Learn on, over so many updates.")
@_option("--record", type=PLACE, help="Write a recording to this .csv.")
@_option("--out", type=PLACE, help="Folder to keep the weights in, where it learns.")
@click.option("--real", is_flag=True, help="The recording is of a real robot.")
@_option("--hello", type=PLACE, help="Report of `hello`, whose delay is to be foreseen.")
@click.option(
    "--set", "fields_set", multiple=True, metavar="NAME=VALUE", help="Any field, as JSON."
)
def drive(robot: str, weights: str, fields_set: Any, **kinds: Any) -> Result:
    """Let a run's follower drive a robot, with the output and the eyes of its run; --set changes
    them, as in --set prediction=both.
    """
    from workbench.logs import sessions

    def change(config: Any) -> Any:
        from workbench import fields

        return _configure(fields.to_dict(config), {}, fields_set)

    return sessions.drive_robot(robot, weights, change=change, **kinds)


@verbs.command()
@click.option(
    "--robot", required=True, help="sim:, serial:PORT, board:PORT, overo:PORT, tcp:…, log:FILE."
)
@click.option("--out", type=PLACE, required=True, help="The .csv; must be new.")
@click.option("--seconds", type=float, default=10.0, help="How long (default 10).")
@click.option("--speeds", type=int, nargs=2, default=(0, 0), help="LEFT RIGHT in steps/s.")
@click.option("--real", is_flag=True, help="It is a real robot, not an emulated one.")
def record(robot: str, out: str, **kinds: Any) -> Result:
    """Record a robot that stands or drives at constant speeds."""
    from workbench.logs import sessions

    return sessions.record_robot(robot, out, **kinds)


@verbs.command()
@click.argument("recording", type=PLACE)
@click.option("--gap", type=float, default=math.inf, help="Refuse intervals longer than so many s.")
def check(recording: str, gap: float) -> Result:
    """Check a recording; names the first thing that is wrong by row and column."""
    from workbench.logs.recordings import load_recording

    return load_recording(recording, gap_s=gap).summary()


@verbs.command()
def robots() -> Result:
    """List serial ports, and what answers at each."""
    from workbench.logs.hello import list_robots

    found = list_robots()
    for one in found:
        click.echo(f"{one['url']:28} {one['port']}: {one['answers']}")
    return {"robots": found}


@verbs.command()
@click.argument("url")
@click.option("--move", is_flag=True, help="Drive 5 cm and turn by 90°, after a yes.")
@click.option("--yes", is_flag=True, help="Do not ask.")
@_option("--out", type=PLACE, help="Write the report to this .json.")
def hello(url: str, move: bool, yes: bool, out: str | None) -> Result:
    """Meet a robot: what it is, its battery, delay and rate, lights, wheels."""
    from workbench.logs.hello import hello

    if move and not yes:
        click.confirm(
            "the robot will drive 5 cm straight on and turn: is the floor free?", abort=True
        )
    return hello(url, move=move, out=out)


@verbs.command("calibrate-camera")
@click.argument("folder", type=PLACE)
@click.option("--board", type=int, nargs=2, default=(7, 5), help="Squares across and down (7 5).")
@click.option("--square", type=float, required=True, help="Edge of a square in m, as printed.")
@_option("--marker", type=float, help="Edge of its markers in m; without: a plain chessboard.")
@click.option("--markers", default="4X4_50", help="Their dictionary (default 4X4_50).")
@_option("--floor", help="Name of the picture in which the board lies on the floor.")
@click.option("--out", type=PLACE, required=True, help="The .json to write.")
def calibrate_camera(
    folder: str,
    board: tuple[int, int],
    square: float,
    markers: str,
    out: str,
    marker: float | None = None,
    floor: str | None = None,
) -> Result:
    """Calibrate your own camera from pictures of a ChArUco board or chessboard."""
    from workbench.arena.camera.calibrate import Board, calibrate
    from workbench.lab.storage import write_json

    target = Path(out)
    if target.suffix != ".json" or target.exists():
        raise ValueError(f"--out {out}: expected a new name that ends in .json")
    target.parent.mkdir(parents=True, exist_ok=True)
    printed = Board(*board, square_m=square, marker_m=marker, markers=markers)
    found = calibrate(folder, printed, floor=floor)
    write_json(target, found)
    if floor is None:
        click.echo("lens only: with --floor PICTURE it can say where the camera hangs")
    names = ["focal_px", "focal_sd_px", "reprojection_px", "worst_picture", "pictures"]
    names += ["left_out", "position"]
    return {name: found[name] for name in names} | {"written": out}


@verbs.command("find")
@click.argument("source", type=PLACE)
@click.option("--camera", type=PLACE, required=True, help="The .json of calibrate-camera.")
@click.option("--robots", type=int, required=True, help="How many; robot i carries marker i.")
@click.option("--marker", type=float, default=0.048, help="Edge of a marker in m (default 0.048).")
@_option("--rate", type=float, help="Pictures per second (a video says it itself).")
@click.option("--out", type=PLACE, required=True, help="The .csv; must be new.")
def find_robots(source: str, camera: str, out: str, **kinds: Any) -> Result:
    """Find robots in a folder of pictures or a video: their poses, picture by picture."""
    from workbench.logs.found import find_robots

    return find_robots(source, camera, out, **kinds)


@verbs.command("import")
@click.argument("file", type=PLACE)
@_option("--robot", help="Which robot it was, in words.")
@click.option("--map", "names", multiple=True, metavar="COLUMN=NAME", help="Which column is which.")
@click.option("--unit", "units", multiple=True, metavar="NAME=UNIT", help="Unit of a column.")
@click.option("--real", is_flag=True, help="It is of a real robot.")
@click.option("--no-commands", is_flag=True, help="The log has no commands: zeros are written.")
@click.option("--cut", is_flag=True, help="Cut rows out that lack a number.")
@_option("--out", type=PLACE, help="The .csv to write (default: FILE with _recording).")
@click.option("--overwrite", is_flag=True, help="It may exist.")
def import_log(
    file: str, names: tuple[str, ...], units: tuple[str, ...], no_commands: bool, **kinds: Any
) -> Result:
    """Make a recording of anybody's own log, a CSV of any kind or a ROS 2 bag (MCAP).

    NAME is one of t_s, left_command, right_command, ps0 … ps7, light0 … light7, gs_left, gs_centre,
    gs_right, left_steps, right_steps, gyro_x, …, x_m, y_m, heading_rad, and x_m_ahead, … of the
    robot in front. UNIT is s, ms, us, ns; steps/s, mm/s, cm/s, m/s, rad/s; m, cm, mm; rad, deg.

    For example: import log.csv --robot "e-puck2 4521" --map Zeit=t_s --map Winkel=heading_rad
    --unit Winkel=deg --unit x=mm --unit y=mm --no-commands
    """
    from workbench.logs.csv_import import import_table

    pairs = [dict(_pair(text) for text in texts) for texts in (names, units)]
    result = import_table(file, names=pairs[0], units=pairs[1], commands=not no_commands, **kinds)
    for line in result["said"]:
        click.echo(line)
    return result


def _pair(text: str) -> tuple[str, str]:
    left, equals, right = text.rpartition("=")
    if not equals:
        raise ValueError(f"{text!r}; expected COLUMN=NAME or NAME=UNIT")
    return left, right


@verbs.command()
@click.option("--check", is_flag=True, help="Only tell what would change, and by how much.")
def figures(check: bool) -> Result:
    """Run the experiment and all notebooks; regenerate figures/."""
    from workbench.publishing import regenerate

    files, numbers = regenerate(check=check)
    if len(numbers):
        click.echo("plotted numbers that differ:")
        shown = numbers.to_string(index=False, float_format=lambda number: f"{number:.3g}")
        click.echo(shown)
    else:
        click.echo("no plotted number differs from what was there before")
    code = 1 if check and files else 0
    differ = int(numbers["numbers"].sum())
    return {"changed_files": files, "numbers_that_differ": differ, "code": code}


def main(arguments: list[str] | None = None) -> int:
    """Run one verb; return the exit code: 0; 1 for what --check found, or where nobody reads on; 2
    for bad input; 130 if interrupted.
    """
    ends.hold()  # from here on no signal is lost, whatever is being imported or compiled
    try:
        return _run(sys.argv[1:] if arguments is None else arguments)
    finally:
        ends.release()


def _run(given: list[str]) -> int:
    for stream in (sys.stdout, sys.stderr):  # what a terminal cannot show is replaced, not refused
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    begun = time.perf_counter()
    machine = "--json" in given
    given = [word for word in given if word != "--json"]
    try:
        result = verbs.main(given, prog_name="python -m workbench", standalone_mode=False)
        if not isinstance(result, dict):  # help was asked for
            return int(result or 0)
        code: int = result.pop("code", 0)
        result["wall_s"] = round(time.perf_counter() - begun, 3)
        from workbench.lab.storage import plain

        values = plain(result)
        people = sys.stdout.isatty() and not machine
        text = _as_lines(values) if people else json.dumps(values, ensure_ascii=False)
        print(text, flush=True)
        return code
    except click.ClickException as error:
        error.show()
        return 2
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (KeyboardInterrupt, click.Abort):
        stored = "what is finished is stored; the same command continues, learn and evaluate with "
        stored += "--resume"
        if given and given[0] in ROBOT_VERBS:
            stored = "the robot has been told to stop; a recording keeps what was written"
        print(f"interrupted: {stored}", file=sys.stderr)
        return 130
    except (RobotError, *ERRORS) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _as_lines(values: dict[str, Any], before: str = "") -> str:
    """Return plain values as aligned lines for people, long numbers rounded."""
    known = {name: value for name, value in values.items() if value is not None}
    width = max(map(len, known), default=0)
    lines = []
    for name, value in known.items():
        if isinstance(value, dict):
            lines += [f"{before}{name}", _as_lines(value, before + "  ")]
            continue
        shown = f"{value:.4g}" if isinstance(value, float) else str(value)
        lines.append(f"{before}{name:{width}}  {shown}")
    return "\n".join(lines)


def _plain(text: str) -> Any:
    """Return a value as JSON; several may stand with commas between them; else a bare word."""
    if text in ("True", "False"):  # as Python, and the help, write them
        return text == "True"
    inner = text[1:-1] if text.startswith("(") and text.endswith(")") else text
    for form in (text, f"[{inner}]" if "," in text else text):
        with suppress(ValueError):
            return json.loads(form)
    return text


def _configure(values: dict[str, Any], given: dict[str, Any], settings: Any) -> Any:
    """Return a configuration from plain values, flags and NAME=VALUE settings, in this order."""
    from workbench import fields
    from workbench.formation.config import ConvoyConfig
    from workbench.robot.description import load_robot

    values = values | {name: value for name, value in given.items() if value is not None}
    nested = sorted(name for name, value in values.items() if isinstance(value, dict))
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise ValueError(
                f"--set {setting!r}; expected NAME=VALUE, for example learner.alpha=0.05"
            )
        value = _plain(text)
        place, *rest = name.split(".")
        if rest and place not in nested:
            raise TypeError(
                f"--set {name}: {place!r} has no parts; parts with fields of their own: "
                f"{', '.join(nested)}"
            )
        if name == "robot" and isinstance(value, str):
            known = fields.from_dict(ConvoyConfig, values)
            values = fields.to_dict(known.with_robot(load_robot(value)))
            continue
        values[place] = values[place] | {".".join(rest): value} if rest else value
    return fields.from_dict(ConvoyConfig, values)


if __name__ == "__main__":
    sys.exit(main())
