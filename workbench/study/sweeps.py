"""Many runs of one function, on all cores or on any executor: in order, resumable, and no failure takes others with it.

>>> sweep(abs, [-3, 1, -2], workers=1, progress=False)
[3, 1, 2]

``executor`` is any ``concurrent.futures.Executor``: a process or thread pool, or dask's ``Client.get_executor()``. Without
one, all cores of this machine are used, one process each; ``workers=1`` runs here, in this process.

With ``store``, every finished result is kept in a folder of its own files, named after the function and the configuration; a
sweep that is interrupted and called again runs only what is missing. Results are then plain JSON values (NaN becomes None),
the same whether they were just computed or read back, and equal configurations are run once.

Contract: results come back in the order of the configurations. A configuration that raises, or kills its process, gives a
``Failed`` in its place and one warning names it; nothing is stored for it. The function must give the same result in any
process: take chance from the configuration.
"""

import hashlib
import json
import multiprocessing
import os
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, as_completed, wait
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any

from workbench import fields
from workbench.study.progress import Progress, report
from workbench.study.storage import plain, read_json, remove_temporaries, write_json

Function = Callable[[Any], Any]


@dataclass(frozen=True)
class Failed:
    """What stands in place of a result: the configuration, the error in one line, and where it came from."""

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
        configs: configurations, mappings, sequences, numbers or words (anything picklable without ``store``).
        executor: where to run; default: processes on this machine.
        store: folder in which finished results are kept.
        workers: processes without an executor; 0 for one per core, 1 for none but this one.
        progress: True for a bar, or a function called with the number of runs just done.

    Raises:
        TypeError: with ``store``, a configuration or function without a name to store under; or a function that worker
            processes cannot import.
    """
    _check(function, executor, workers)
    keys = [_key(function, config) if store is not None else str(number) for number, config in enumerate(configs)]
    folder = Path(store) if store is not None else None
    results: dict[str, Any] = _stored(folder, keys) if folder is not None else {}
    todo = {key: config for key, config in zip(keys, configs, strict=True) if key not in results}
    failures = []
    with report(progress, len(todo) + len(results), getattr(function, "__name__", "sweep"), len(results), " runs") as tell:
        for key, outcome in _outcomes(function, todo, executor, workers or cores()):
            if isinstance(outcome, Failed):
                failures.append(outcome)
            results[key] = outcome if folder is None or isinstance(outcome, Failed) else _keep(folder, key, todo[key], outcome)
            tell(1)
    if failures:
        rest = f"{len(results) - len(failures)} others are done" + (" and stored" if folder is not None else "")
        warnings.warn(
            f"{len(failures)} of {len(results)} runs failed ({rest}); first: {failures[0].error}, with {failures[0].config!r}",
            RuntimeWarning,
            stacklevel=2,
        )
    return [results[key] for key in keys]


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def process_pool(workers: int) -> ProcessPoolExecutor:
    """Return a pool of clean processes that end with this one, even if this one is killed."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=_end_with_parent)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _outcomes(function: Function, todo: Mapping[str, Any], executor: Executor | None, workers: int) -> Iterator[tuple[str, Any]]:
    """Yield (key, result or Failed) as they come."""
    if executor is not None:
        futures = {executor.submit(function, config): key for key, config in todo.items()}
        try:
            for future in as_completed(futures):
                yield futures[future], _result(future, todo[futures[future]])
        finally:
            for future in futures:
                future.cancel()
    elif workers == 1:
        for key, config in todo.items():
            try:
                yield key, function(config)
            except Exception as error:
                yield key, _failed(config, error)
    else:
        yield from _local(function, todo, workers)


def _local(function: Function, todo: Mapping[str, Any], workers: int) -> Iterator[tuple[str, Any]]:
    """Run on a process pool; where a process dies, give those that ran with it a pool each, to find the guilty one."""
    waiting, suspects = list(todo), list[str]()
    while waiting:
        with process_pool(min(workers, len(waiting))) as pool:
            running = dict[Future[Any], str]()
            while waiting or running:
                try:
                    while waiting and len(running) < 2 * workers:
                        running[pool.submit(function, todo[waiting[0]])] = waiting[0]
                        waiting.pop(0)
                except BrokenExecutor:
                    pass  # seen below, in what was running
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                broken = [future for future in done if isinstance(future.exception(), BrokenExecutor)]
                for future in done - set(broken):
                    key = running.pop(future)
                    yield key, _result(future, todo[key])
                if broken:
                    suspects += running.values()
                    break
    for key in suspects:
        with process_pool(1) as pool:
            yield key, _result(pool.submit(function, todo[key]), todo[key])


def _result(future: Future[Any], config: Any) -> Any:
    try:
        return future.result()
    except BrokenExecutor:
        return Failed(config, "its process died (killed, out of memory, or a crash in compiled code)", "")
    except Exception as error:
        return _failed(config, error)


def _failed(config: Any, error: Exception) -> Failed:
    return Failed(config, f"{type(error).__name__}: {error}", "".join(traceback.format_exception(error)))


def _check(function: Function, executor: Executor | None, workers: int) -> None:
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 0:
        raise ValueError(f"workers = {workers!r}; expected a whole number of processes, 0 for one per core")
    here = executor is None and (workers or cores()) == 1
    name = getattr(function, "__qualname__", "")
    interactive = getattr(function, "__module__", "") == "__main__" and not hasattr(sys.modules["__main__"], "__file__")
    if executor is None and not here and ("<" in name or interactive):
        raise TypeError(
            f"function {name or function!r} cannot be imported by worker processes; put it into a module of its own, or run "
            "here with workers=1"
        )


def _key(function: Function, config: Any) -> str:
    name = getattr(function, "__qualname__", "")
    if not name or "<" in name:
        raise TypeError(f"function {function!r} has no name to store results under; give a plain function of a module")
    text = json.dumps([function.__module__, name, _plain(config)], sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def _plain(config: Any) -> Any:
    """Return a configuration as JSON values, from which its name is made; refuse what has none."""
    if is_dataclass(config) and not isinstance(config, type):
        return {"class": type(config).__qualname__} | fields.to_dict(config)
    if isinstance(config, Mapping):
        return {str(name): _plain(value) for name, value in config.items()}
    if isinstance(config, (list, tuple)):
        return [_plain(value) for value in config]
    if config is None or isinstance(config, (bool, int, float, str)):
        return config
    raise TypeError(
        f"config {config!r} is a {type(config).__name__}; stored sweeps need dataclasses, mappings, lists, numbers or words"
    )


def _keep(folder: Path, key: str, config: Any, outcome: Any) -> Any:
    """Store a result; return what reading it back would give."""
    write_json(folder / f"{key}.json", {"config": _plain(config), "result": outcome})
    return json.loads(json.dumps(plain(outcome)))


def _stored(folder: Path, keys: Sequence[str]) -> dict[str, Any]:
    """Return what an earlier call finished; a damaged file is run again."""
    folder.mkdir(parents=True, exist_ok=True)
    remove_temporaries(folder, [f"{key}.json" for key in keys])
    results = {}
    for key in dict.fromkeys(keys):
        path = folder / f"{key}.json"
        if path.is_file():
            try:
                results[key] = read_json(path)["result"]
            except (ValueError, KeyError, TypeError):
                path.unlink()
    return results
