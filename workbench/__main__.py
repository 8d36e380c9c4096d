"""The command line: ``python -m workbench VERB``. Thin: it reads flags, calls the package and
prints.

The last line of every verb is one JSON object.
"""

import argparse
import json
import signal
import sys
import time
from contextlib import ExitStack
from dataclasses import fields as dataclass_fields, is_dataclass
from pathlib import Path
from typing import Any

from workbench import fields
from workbench.arena.tracks import TrackConfig
from workbench.formation.config import SENSING, SETTINGS, ConvoyConfig
from workbench.formation.laws import LAWS, Controller
from workbench.lab.storage import plain
from workbench.learning.config import LearnerConfig
from workbench.robot.faults import RobotError

ROBOT_VERBS = ("emulate", "drive", "record")
_UNITS = """Units: speeds in m/s or motor steps/s (1 step = 0.1288 mm), lengths in m (…_m),
angles in rad (…_rad) or degrees (…_deg), errors in mm (…_mm), times in simulated minutes
or wall-clock seconds (wall_s). STEPS are learning updates, summed over the followers. A share is
a part of all visits; …_all_time has reset and lost time in the denominator.

Fields for --set NAME=VALUE (dots for parts: --set learner.alpha=0.05 --set track.shape='"eight"'):
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m workbench", description="Formation control with Greedy-GQ(λ)."
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    parts = (("", ConvoyConfig), ("learner", LearnerConfig), ("track", TrackConfig))
    epilog = _UNITS + "\n".join(
        f"{name and name + ':'}\n{fields.describe(cls)}" for name, cls in parts
    )
    shape: dict[str, Any] = {
        "formatter_class": argparse.RawDescriptionHelpFormatter,
        "epilog": epilog,
    }

    learn = verbs.add_parser(
        "learn", help="let followers learn online; prints the run's summary", **shape
    )
    learn.add_argument("--steps", type=int, help="learning updates, summed over the followers")
    learn.add_argument("--setting", help=f"start from a named setting: {', '.join(SETTINGS)}")
    learn.add_argument("--followers", type=int, help="robots behind the leader")
    learn.add_argument("--drive", help="wheels or planar")
    learn.add_argument("--sensing", help=" or ".join(SENSING))
    learn.add_argument("--seed", type=int, help="seed of everything random")
    learn.add_argument(
        "--out", required=True, help="folder of the run; must be new or empty, unless --resume"
    )
    learn.add_argument(
        "--resume",
        action="store_true",
        help="continue the interrupted run in --out, or show a complete one",
    )
    learn.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="any field, value as JSON"
    )

    evaluate = verbs.add_parser(
        "evaluate",
        help="follow a run's policy greedily, without learning; or a classical law",
        **shape,
    )
    evaluate.add_argument(
        "run", help=f"folder of a complete run, or a classical law: {', '.join(LAWS)}"
    )
    evaluate.add_argument(
        "--minutes", type=float, default=30.0, help="simulated minutes (default 30)"
    )
    evaluate.add_argument("--drive", help="wheels or planar (default: the run's)")
    evaluate.add_argument("--seed", type=int, help="evaluation seed (default: the run's)")
    evaluate.add_argument("--out", help="store the evaluation in this folder")
    evaluate.add_argument(
        "--resume", action="store_true", help="continue the interrupted evaluation in --out"
    )
    evaluate.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="any field, value as JSON"
    )

    verbs.add_parser("bench", help="measure speed against bare MuJoCo, and memory")

    study = verbs.add_parser(
        "study",
        help="run a study and write its table into data/studies/; continues where it stopped",
    )
    study.add_argument("name", help="name of a study, 'all', or 'list' to see what there is")
    study.add_argument(
        "--scheduler", help="address of a dask scheduler, tcp://HOST:PORT; default: all cores here"
    )
    study.add_argument(
        "--workers", type=int, default=0, help="processes on this machine (default: one per core)"
    )
    study.add_argument("--out", help="folder of the table (default data/studies/)")

    validate = verbs.add_parser(
        "validate",
        help="compare with recordings of real robots (WORKBENCH_RECORDINGS), with pixels, or "
        "with the clock",
    )
    validate.add_argument(
        "what",
        help="drive (wheels against set-points), infrared (proximity and ground sensors), "
        "tiles (of real readings), "
        "camera (pixels) or deadlines (clock)",
    )
    validate.add_argument("--out", help="folder of the aggregates (default data/validation/)")

    export = verbs.add_parser(
        "export-c", help="write a policy on raw infrared readings as a C99 file for a firmware"
    )
    export.add_argument("run", help="folder of a complete run, or a weights file")
    export.add_argument("--out", required=True, help="C file to write")
    export.add_argument(
        "--table", type=int, default=0, help="whose weights, 0 for the first follower's (default)"
    )

    emulate = verbs.add_parser(
        "emulate", help="serve an emulated robot on a pseudo-terminal or a TCP port"
    )
    emulate.add_argument(
        "protocol", help="epuck1, epuck1-bt, overo (SerCom on a pseudo-terminal) or epuck2 (TCP)"
    )
    emulate.add_argument("--port", type=int, default=0, help="TCP port (default: a free one)")
    emulate.add_argument(
        "--rate",
        type=float,
        default=1.0,
        help="simulated seconds per second; 0: moves only when it is read",
    )
    emulate.add_argument(
        "--seconds", type=float, default=0.0, help="end after so many seconds (default: Ctrl-C)"
    )

    drive = verbs.add_parser("drive", help="let a run's follower drive a robot")
    drive.add_argument(
        "--robot", required=True, help="sim:, serial:PORT, overo:PORT or tcp:HOST[:PORT]"
    )
    drive.add_argument("--weights", required=True, help="folder of the run")
    drive.add_argument("--seconds", type=float, default=60.0, help="how long (default 60)")
    drive.add_argument(
        "--learn",
        type=int,
        default=0,
        help="learn on, over so many updates (default: follow greedily)",
    )
    drive.add_argument("--record", help="write a recording to this .csv")
    drive.add_argument("--out", help="folder to keep the weights in, where it learns")
    drive.add_argument(
        "--real",
        action="store_true",
        help="the recording is of a real robot, not of an emulated one",
    )

    record = verbs.add_parser(
        "record", help="record a robot that stands or drives at constant speeds"
    )
    record.add_argument(
        "--robot", required=True, help="sim:, serial:PORT, overo:PORT, tcp:HOST[:PORT] or log:FILE"
    )
    record.add_argument("--out", required=True, help="the .csv; must be new")
    record.add_argument("--seconds", type=float, default=10.0, help="how long (default 10)")
    record.add_argument(
        "--speeds",
        type=int,
        nargs=2,
        default=(0, 0),
        metavar=("LEFT", "RIGHT"),
        help="steps/s (default 0 0)",
    )
    record.add_argument(
        "--real", action="store_true", help="it is a real robot, not an emulated one"
    )

    check = verbs.add_parser(
        "check", help="check a recording; names the first thing that is wrong by row and column"
    )
    check.add_argument("recording", help="the .csv")

    figures = verbs.add_parser(
        "figures", help="run the experiment and all notebooks; regenerate figures/"
    )
    figures.add_argument(
        "--check", action="store_true", help="only tell what would change, and by how much"
    )
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run one verb; return the exit code: 0, 1 for what --check found, 2 for bad input, 130 if
    interrupted.
    """
    flags = _parser().parse_args(arguments)
    begun = time.perf_counter()
    code = 0
    before = {}
    if (
        flags.verb in ROBOT_VERBS
    ):  # a robot is stopped also when the program is told to end, or its terminal goes away
        ends = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
        before = {number: signal.signal(number, signal.default_int_handler) for number in ends}
    try:
        if flags.verb == "learn":
            result = _learn(flags)
        elif flags.verb == "evaluate":
            result = _evaluate(flags)
        elif flags.verb == "bench":
            from workbench.bench import bench

            result = bench()
        elif flags.verb == "study":
            result = _study(flags)
        elif flags.verb == "export-c":
            result = _export(flags)
        elif flags.verb == "validate":
            result = _validate(flags)
        elif flags.verb == "figures":
            result = _figures(flags)
            code = 1 if flags.check and result["changed_files"] else 0
        else:
            result = _robot(flags)
    except (
        RobotError,
        ValueError,
        TypeError,
        OSError,
        ArithmeticError,
        RuntimeError,
        MemoryError,
    ) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        stored = (
            "what is finished is stored; the same command continues, learn and evaluate "
            "with --resume"
        )
        if flags.verb in ROBOT_VERBS:
            stored = "the robot has been told to stop; a recording keeps what was written"
        print(f"interrupted: {stored}", file=sys.stderr)
        return 130
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    result["wall_s"] = round(time.perf_counter() - begun, 1)
    print(json.dumps(plain(result), ensure_ascii=False))
    return code


def _learn(flags: argparse.Namespace) -> dict[str, Any]:
    from workbench.lab import runs

    asked = {name: getattr(flags, name) for name in ("followers", "drive", "sensing", "seed")}
    given = {name: value for name, value in asked.items() if value is not None}
    values = fields.to_dict(ConvoyConfig())
    steps = 1_300_000
    if flags.setting is not None:
        if flags.setting not in SETTINGS or flags.resume:
            why = (
                "a run that is resumed keeps its own"
                if flags.resume
                else f"expected one of {', '.join(SETTINGS)}"
            )
            raise ValueError(f"--setting {flags.setting!r}; {why}")
        values = fields.to_dict(SETTINGS[flags.setting])
    if flags.resume:
        try:
            config, steps = runs.stored_request(flags.out)
            values = fields.to_dict(config)
        except FileNotFoundError:
            pass  # killed before it began: begin
    config = _configure(values, given, flags.set)
    if flags.steps is not None:
        steps = flags.steps
    return dict(runs.learn(config, steps=steps, out=flags.out, resume=flags.resume).summary)


def _evaluate(flags: argparse.Namespace) -> dict[str, Any]:
    from workbench.lab import runs

    policy: Controller
    if Path(flags.run).exists():
        run = runs.load_run(flags.run)
        policy = run.policy
        config = run.config
    elif flags.run in LAWS:
        policy = LAWS[flags.run]()
        config = ConvoyConfig()
    else:
        raise FileNotFoundError(
            f"{flags.run} holds no run, and is no classical law ({', '.join(LAWS)})"
        )
    asked = {"drive": flags.drive, "seed": flags.seed}
    given = {name: value for name, value in asked.items() if value is not None}
    config = _configure(fields.to_dict(config), given, flags.set)
    return dict(
        runs.evaluate(
            policy, config, minutes=flags.minutes, out=flags.out, resume=flags.resume
        ).summary
    )


def _study(flags: argparse.Namespace) -> dict[str, Any]:
    from workbench.studies.tables import STUDIES, run_study

    if flags.name == "list":
        for study in STUDIES.values():
            print(f"{study.name:12} {study.question}")
        return {"studies": list(STUDIES)}
    names = list(STUDIES) if flags.name == "all" else [flags.name]
    out = Path(flags.out) if flags.out else None
    with ExitStack() as stack:
        executor = None
        if flags.scheduler:
            from distributed import Client

            client = stack.enter_context(Client(flags.scheduler, timeout="20s"))
            _same_sources(client)
            executor = client.get_executor()
        lines = {
            name: len(run_study(name, executor=executor, workers=flags.workers, out=out))
            for name in names
        }
    return {"lines": lines}


def _same_sources(client: Any) -> None:
    """Refuse a cluster without workers, or with workers that run other sources than this
    process.
    """
    from workbench import sources

    theirs = client.run(sources.digest, "workbench.studies.tables")
    if not theirs:
        raise RuntimeError("the scheduler has no workers; start some with: dask worker ADDRESS")
    others = sorted(
        worker
        for worker, digest in theirs.items()
        if digest != sources.digest("workbench.studies.tables")
    )
    if others:
        raise RuntimeError(
            f"workers with other sources or versions of the workbench: {', '.join(others)}; "
            "update them"
        )


def _export(flags: argparse.Namespace) -> dict[str, Any]:
    from workbench.lab.weights import load_policy
    from workbench.logs.export_c import export_c

    policy = load_policy(flags.run)
    source = f"weights {policy.sha256()[:12]}, follower {flags.table + 1}"
    return export_c(policy, flags.out, table=flags.table, source=source) | {"written": flags.out}


def _validate(flags: argparse.Namespace) -> dict[str, Any]:
    out = Path(flags.out) if flags.out else None
    if flags.what == "drive":
        from workbench.studies.validation.drives import validate_drive

        return validate_drive(out=out)
    if flags.what == "infrared":
        from workbench.studies.validation.infrared import validate_infrared

        return validate_infrared(out=out)
    if flags.what == "tiles":
        from workbench.studies.validation.tiles import validate_tiles

        return validate_tiles(out=out)
    if flags.what == "camera":
        from workbench.studies.validation.camera import validate_camera

        return validate_camera(out=out)
    if flags.what == "deadlines":
        from workbench.studies.validation.deadlines import measure_deadlines

        return measure_deadlines(out=out)
    raise ValueError(
        f"validate {flags.what!r}; expected drive, infrared, tiles, camera or deadlines"
    )


def _robot(flags: argparse.Namespace) -> dict[str, Any]:
    from workbench.logs import sessions as live

    if flags.verb == "emulate":
        return {
            "url": live.emulate(
                flags.protocol, port=flags.port, rate=flags.rate, seconds=flags.seconds
            )
        }
    if flags.verb == "drive":
        return live.drive_robot(
            flags.robot,
            flags.weights,
            seconds=flags.seconds,
            learn=flags.learn,
            record=flags.record,
            real=flags.real,
            out=flags.out,
        )
    if flags.verb == "record":
        speeds = (flags.speeds[0], flags.speeds[1])
        return live.record_robot(
            flags.robot, flags.out, seconds=flags.seconds, speeds=speeds, real=flags.real
        )
    from workbench.logs.recordings import load_recording

    return load_recording(flags.recording).summary()


def _figures(flags: argparse.Namespace) -> dict[str, Any]:
    from workbench.publishing import regenerate

    files, numbers = regenerate(check=flags.check)
    if len(numbers):
        print("plotted numbers that differ:")
        print(numbers.to_string(index=False, float_format=lambda number: f"{number:.3g}"))
    else:
        print("no plotted number differs from what was there before")
    return {"changed_files": files, "numbers_that_differ": int(numbers["numbers"].sum())}


def _configure(values: dict[str, Any], given: dict[str, Any], settings: list[str]) -> ConvoyConfig:
    """Return a configuration from plain values, flags and NAME=VALUE settings, in this order."""
    values = values | given
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise ValueError(
                f"--set {setting!r}; expected NAME=VALUE, for example learner.alpha=0.05"
            )
        try:
            value = json.loads(text)
        except ValueError:
            value = text  # a bare word
        place, *rest = name.split(".")
        nested = {
            field.name for field in dataclass_fields(ConvoyConfig) if is_dataclass(field.default)
        }
        if rest and place not in nested:
            raise TypeError(
                f"--set {name}: {place!r} has no parts; parts with fields of their own: "
                f"{', '.join(sorted(nested))}"
            )
        if rest:
            values[place] = values[place] | {".".join(rest): value}
        else:
            values[place] = value
    return fields.from_dict(ConvoyConfig, values)


if __name__ == "__main__":
    sys.exit(main())
