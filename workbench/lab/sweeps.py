"""Many runs of one function, on all cores or on any executor: in order, resumable, and no failure
takes others with it.

>>> sweep(abs, [-3, 1, -2], workers=1, progress=False)
[3, 1, 2]

``executor`` is any ``concurrent.futures.Executor``: a process or thread pool, or dask's
``Client.get_executor()``. Without one, all cores of this machine are used, one process each;
``workers=1`` runs here, in this process.

With ``store``, every finished result is kept in a folder of its own files, named after the function
and the configuration; a sweep that is interrupted and called again runs only what is missing.
Results are then plain JSON values (NaN becomes None), the same whether they were just computed or
read back, and equal configurations are run once. The name knows the function by its module and name
(in a script also by its source), not what it calls: change the folder when that changes.

Contract: results come back in the order of the configurations. A configuration that raises, or
kills its process, gives a ``Failed`` in its place and one warning names it; nothing is stored for
it. The function must give the same result in any process: take chance from the configuration.
Interrupting a sweep stops its processes at once.
"""

import hashlib
import inspect
import json
import multiprocessing
import os
import pickle
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    as_completed,
    wait,
)
from contextlib import contextmanager
from dataclasses import dataclass, fields as dataclass_fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workbench.lab.progress import Progress, report
from workbench.lab.storage import plain, read_json, write_json

Function = Callable[[Any], Any]
DIED = "its process died: killed, out of memory, or a crash in compiled code"


@dataclass(frozen=True)
class Failed:
    """What stands in place of a result: the configuration, the error in one line, and where it came
    from.
    """

    config: Any
    error: str
    trace: str


def sweep(
    function: Function,
    configs: Sequence[Any],
    executor: Executor | None = None,
    *,
    store: str | Path | None = None,
    workers: int = 0,
    progress: Progress = True,
) -> list[Any]:
    """Return function(config) for every configuration, in their order.

    Args:
        function: importable by the workers, with one argument.
        configs: with ``store`` dataclasses, mappings, sequences, numbers or words; anything
            picklable without.
        executor: where to run; default: processes on this machine.
        store: folder in which finished results are kept.
        workers: processes without an executor; 0 for one per core, 1 for none but this one.
        progress: True for a bar, or a function called with the number of runs just done.

    Raises:
        TypeError: with ``store``, a configuration or function without a name to store under; or a
            function that worker processes cannot import.
        RuntimeError: worker processes cannot start at all.
        OSError: a result could not be stored; what was stored before is kept.
    """
    _check(function, executor, workers)
    keys = [
        key_of(function, config) if store is not None else str(number)
        for number, config in enumerate(configs)
    ]
    folder = Path(store).expanduser() if store is not None else None
    results: dict[str, Any] = _stored(folder, keys) if folder is not None else {}
    todo = {key: config for key, config in zip(keys, configs, strict=True) if key not in results}
    failures = []
    outcomes = _outcomes(function, todo, executor, workers or cores())
    with report(
        progress,
        len(todo) + len(results),
        getattr(function, "__name__", "sweep"),
        len(results),
        " runs",
    ) as tell:
        for key, outcome in outcomes:
            results[key] = (
                outcome
                if folder is None or isinstance(outcome, Failed)
                else _keep(folder, key, todo[key], outcome)
            )
            if isinstance(results[key], Failed):
                failures.append(results[key])
            tell(1)
    if failures:
        rest = f"{len(results) - len(failures)} others are done" + (
            " and stored" if folder is not None else ""
        )
        warnings.warn(
            f"{len(failures)} of {len(results)} runs failed ({rest}); first: "
            f"{failures[0].error}, with {failures[0].config!r}",
            RuntimeWarning,
            stacklevel=2,
        )
    return [results[key] for key in keys]


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def process_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of clean processes; they end with this one even if it is killed, and at once if
    the block is left early.
    """
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_end_with_parent)
    try:
        yield pool
    except BaseException:
        processes = list(
            (getattr(pool, "_processes", None) or {}).values()
        )  # no public way before Python 3.14
        pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        raise
    pool.shutdown()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _attempt(function: Function, config: Any) -> Any:
    """Run the function where the worker is; what it raises comes back as a Failed, which needs no
    importing to be read.
    """
    try:
        result = function(config)
        pickle.dumps(result)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit too: a run may end itself, not the sweep
        return Failed(
            config, f"{type(error).__name__}: {error}", "".join(traceback.format_exception(error))
        )
    return result


def _outcomes(
    function: Function, todo: Mapping[str, Any], executor: Executor | None, workers: int
) -> Iterator[tuple[str, Any]]:
    """Yield (key, result or Failed) as they come."""
    if executor is not None:
        yield from _foreign(function, todo, executor)
    elif workers == 1:
        for key, config in todo.items():
            yield key, _attempt(function, config)
    elif todo:
        yield from _local(function, todo, workers)


def _foreign(
    function: Function, todo: Mapping[str, Any], executor: Executor
) -> Iterator[tuple[str, Any]]:
    beside = "its process or one beside it died; without executor= the sweep finds out which"
    futures: dict[Future[Any], str] = {}
    try:
        for key, config in todo.items():
            try:
                futures[executor.submit(_attempt, function, config)] = key
            except BrokenExecutor:
                yield key, Failed(config, beside, "")
        for future in as_completed(futures):
            yield futures[future], _result(future, todo[futures[future]], beside)
    finally:
        for future in futures:
            future.cancel()


def _local(function: Function, todo: Mapping[str, Any], workers: int) -> Iterator[tuple[str, Any]]:
    """Run on a process pool; where a process dies, give those that ran beside it a pool each, to
    find the guilty one.
    """
    waiting = list(todo)
    suspects = list[str]()
    while waiting:
        with process_pool(min(workers, len(waiting))) as pool:
            _wait_for_a_worker(pool)
            running = dict[Future[Any], str]()
            while waiting or running:
                try:
                    while waiting and len(running) < 2 * workers:
                        running[pool.submit(_attempt, function, todo[waiting[0]])] = waiting[0]
                        waiting.pop(0)
                except BrokenExecutor:
                    if not running:
                        break  # an idle process died: nobody's fault, a new pool goes on
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                broken = [
                    future for future in done if isinstance(future.exception(), BrokenExecutor)
                ]
                for future in done - set(broken):
                    key = running.pop(future)
                    yield key, _result(future, todo[key], DIED)
                if broken:
                    suspects += running.values()
                    break
    for key in suspects:
        with process_pool(1) as pool:
            _wait_for_a_worker(pool)
            future = pool.submit(_attempt, function, todo[key])
            outcome = _result(future, todo[key], DIED)
        yield key, outcome


def _wait_for_a_worker(pool: ProcessPoolExecutor) -> None:
    try:
        pool.submit(os.getpid).result()
    except BrokenExecutor as error:
        raise RuntimeError(
            "worker processes cannot start: in a script, call sweep() only below `if __name__ "
            "== '__main__':` (workers import "
            "it); otherwise see what they printed, or use workers=1"
        ) from error


def _result(future: Future[Any], config: Any, died: str) -> Any:
    try:
        return future.result()
    except BrokenExecutor:
        return Failed(config, died, "")
    except Exception as error:
        return Failed(
            config, f"{type(error).__name__}: {error}", "".join(traceback.format_exception(error))
        )


def _check(function: Function, executor: Executor | None, workers: int) -> None:
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 0:
        raise ValueError(
            f"workers = {workers!r}; expected a whole number of processes, 0 for one per core"
        )
    here = executor is None and (workers or cores()) == 1
    name = getattr(function, "__qualname__", "")
    interactive = getattr(function, "__module__", "") == "__main__" and not hasattr(
        sys.modules["__main__"], "__file__"
    )
    if executor is None and not here and ("<" in name or interactive):
        raise TypeError(
            f"function {name or function!r} cannot be imported by worker processes; put it "
            "into a module of its own, or run "
            "here with workers=1"
        )


def key_of(function: Function, config: Any) -> str:
    """Return the name under which the result of function(config) is stored.

    Raises:
        TypeError: the function is not a plain one, or the configuration holds something that has no
            lasting name.
    """
    name = getattr(function, "__qualname__", "")
    if (
        not name
        or "<" in name
        or any(getattr(function, mark, None) for mark in ("__self__", "__wrapped__", "__closure__"))
    ):
        if not inspect.isbuiltin(function):
            raise TypeError(
                f"function {function!r} has no name to store results under; give a plain "
                "function of a module, and what it "
                "depends on in the configuration"
            )
    origin = [function.__module__, name]
    if function.__module__ == "__main__":
        origin.append(inspect.getsource(function))
    text = json.dumps([origin, _named(config)], sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def _named(config: Any) -> Any:
    """Return a configuration as JSON from which nothing else can come; refuse what has no lasting
    name.
    """
    if is_dataclass(config) and not isinstance(config, type):
        values = {
            field.name: _named(getattr(config, field.name)) for field in dataclass_fields(config)
        }
        return ["dataclass", type(config).__module__, type(config).__qualname__, values]
    if isinstance(config, Mapping) and all(isinstance(name, str) for name in config):
        return ["mapping", {name: _named(value) for name, value in config.items()}]
    if isinstance(config, (list, tuple)):
        return [type(config).__name__, [_named(value) for value in config]]
    if isinstance(config, np.generic):
        return ["numpy", str(config.dtype), config.item()]
    if config is None or isinstance(config, (bool, int, float, str)):
        return config
    raise TypeError(
        f"config holds {config!r}, a {type(config).__name__}; stored sweeps need dataclasses, "
        "mappings with words as keys, "
        "lists, numbers or words"
    )


def _keep(folder: Path, key: str, config: Any, outcome: Any) -> Any:
    """Store a result and return what reading it back would give, or a Failed if it is nothing that
    JSON can hold.
    """
    part = folder / f".{key}.{os.getpid()}"  # two sweeps may store the same run at the same time
    try:
        text = json.dumps(plain(outcome), allow_nan=False)
        write_json(part, {"config": _named(config), "result": outcome})
    except (TypeError, ValueError) as error:
        return Failed(
            config,
            f"{type(error).__name__}: {error}; stored results are numbers, words, lists and "
            "mappings",
            "",
        )
    os.replace(part, folder / f"{key}.json")
    return json.loads(text)


def _stored(folder: Path, keys: Sequence[str]) -> dict[str, Any]:
    """Return what an earlier call finished; a damaged file is run again."""
    folder.mkdir(parents=True, exist_ok=True)
    results = {}
    for key in dict.fromkeys(keys):
        path = folder / f"{key}.json"
        if path.is_file():
            try:
                results[key] = read_json(path)["result"]
            except (ValueError, KeyError, TypeError):
                path.unlink()
    return results
