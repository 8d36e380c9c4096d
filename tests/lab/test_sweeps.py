"""Sweeps: order, resuming, failures, dying workers, and the same bytes on every executor, dask
included.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import sweepable
from distributed import Client

from workbench.__main__ import main
from workbench.formation.config import ConvoyConfig
from workbench.lab.sweeps import Failed, key_of, process_pool, sweep


def _bytes(folder):
    return {path.name: path.read_bytes() for path in sorted(Path(folder).glob("*"))}


def test_results_come_in_input_order_whatever_finishes_first():
    delays = [0.3, 0.0, 0.1]
    with ThreadPoolExecutor(3) as pool:
        assert sweep(sweepable.sleep, delays, pool, progress=False) == delays


def test_serial_local_processes_and_threads_give_the_same_bytes(tmp_path):
    configs = [ConvoyConfig(followers=1, drive="planar", seed=seed) for seed in (3, 1, 2)]
    serial = sweep(
        sweepable.learn_a_little, configs, store=tmp_path / "serial", workers=1, progress=False
    )
    local = sweep(
        sweepable.learn_a_little, configs, store=tmp_path / "local", workers=2, progress=False
    )
    with ThreadPoolExecutor(2) as pool:
        threads = sweep(
            sweepable.learn_a_little, configs, pool, store=tmp_path / "threads", progress=False
        )
    assert serial == local == threads and len({run["theta"] for run in serial}) == 3
    assert _bytes(tmp_path / "serial") == _bytes(tmp_path / "local") == _bytes(tmp_path / "threads")


def test_a_second_call_runs_only_what_is_missing_and_returns_the_same(tmp_path):
    log = tmp_path / "log"
    configs = [{"value": value, "log": str(log)} for value in (1, 2, 2)]
    first = sweep(sweepable.note, configs, store=tmp_path / "store", workers=1, progress=False)
    assert first == [
        {"value": 1, "nan": None},
        {"value": 2, "nan": None},
        {"value": 2, "nan": None},
    ]
    configs.append({"value": 3, "log": str(log)})
    damaged = sorted((tmp_path / "store").glob("*.json"))[0]
    damaged.write_text("{not json")
    assert (
        sweep(sweepable.note, configs, store=tmp_path / "store", workers=1, progress=False)[:3]
        == first
    )
    ran = log.read_text().split()
    assert len(ran) == 4 and set(ran) == {
        "1",
        "2",
        "3",
    }  # 1 and 2 once, 3 once, and the damaged one again


@pytest.mark.parametrize("workers", [1, 2])
def test_a_failing_configuration_is_reported_and_takes_no_other_with_it(workers, tmp_path):
    with pytest.warns(
        RuntimeWarning,
        match=r"1 of 4 runs failed \(3 others are done and stored\).*ValueError: 2 is even",
    ):
        results = sweep(
            sweepable.refuse_even, [1, 2, 3, 5], store=tmp_path, workers=workers, progress=False
        )
    assert [results[k] for k in (0, 2, 3)] == [1, 3, 5]
    failed = results[1]
    assert isinstance(failed, Failed) and failed.config == 2 and "refuse_even" in failed.trace
    assert len(list(tmp_path.glob("*.json"))) == 3


def test_a_configuration_that_kills_its_process_is_found_and_the_others_finish():
    with pytest.warns(RuntimeWarning, match="1 of 8 runs failed.*its process died"):
        results = sweep(sweepable.die_at_four, list(range(8)), workers=2, progress=False)
    assert [result for k, result in enumerate(results) if k != 4] == [0, 1, 2, 3, 5, 6, 7]
    assert isinstance(results[4], Failed) and results[4].config == 4


def test_functions_and_configurations_without_a_name_are_refused(tmp_path):
    with pytest.raises(TypeError, match="cannot be imported by worker processes"):
        sweep(lambda x: x, [1], workers=2)
    with pytest.raises(TypeError, match="has no name to store results under"):
        sweep(lambda x: x, [1], workers=1, store=tmp_path)
    with pytest.raises(TypeError, match=r"config holds \{1\}, a set; stored sweeps need"):
        sweep(sweepable.sleep, [{1}], workers=1, store=tmp_path)
    with pytest.raises(ValueError, match="workers = -1"):
        sweep(sweepable.sleep, [0.0], workers=-1)
    assert sweep(sweepable.sleep, [], progress=False) == []


def test_an_idle_worker_that_dies_holds_nothing_up(tmp_path):
    def tell(_):
        time.sleep(0.5)  # what is in flight finishes meanwhile
        victims = [int(path.name) for path in tmp_path.glob("[0-9]*")]
        for victim in victims[:1]:
            (tmp_path / str(victim)).unlink()
            with contextlib.suppress(ProcessLookupError):  # of an earlier pool, ended with it
                os.kill(victim, signal.SIGKILL)

    configs = [{"folder": str(tmp_path), "number": number} for number in range(9)]
    assert sweep(sweepable.sign_in, configs, workers=2, progress=tell) == list(range(9))


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize(
    ("function", "error"),
    [
        (sweepable.leave, "SystemExit: bye"),
        (sweepable.raise_what_cannot_be_read_back, "Stubborn: the real reason 1 2"),
        (
            sweepable.return_a_set,
            "TypeError: Object of type set is not JSON serializable; stored results are",
        ),
    ],
)
def test_no_failure_takes_others_with_it(function, error, workers, tmp_path):
    with pytest.warns(RuntimeWarning, match="1 of 3 runs failed"):
        results = sweep(function, [1, 2, 3], workers=workers, store=tmp_path, progress=False)
    assert results[0] == 1 and results[2] == 3 and results[1].error.startswith(error)
    assert len(list(tmp_path.glob("*.json"))) == 2


def test_a_callers_broken_pool_is_reported_and_not_raised():
    with (
        ProcessPoolExecutor(2) as pool,
        pytest.warns(RuntimeWarning, match="its process or one beside it died"),
    ):
        results = sweep(sweepable.die_at_four, list(range(8)), pool, progress=False)
        assert isinstance(results[4], Failed) and len(results) == 8
        again = sweep(
            sweepable.die_at_four, [0], pool, progress=False
        )  # the pool is of no use any more
    assert isinstance(again[0], Failed)


def test_interrupting_a_sweep_stops_its_processes_at_once():
    def interrupt(_):
        raise KeyboardInterrupt

    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        sweep(sweepable.sleep, [0.0, 60.0, 60.0, 60.0], workers=2, progress=interrupt)
    assert (
        time.monotonic() - begun < 30
    )  # a bound on waiting for a run of 60 s, not a measure of speed


def test_different_requests_have_different_names():
    one = sweepable.Point(1)
    other = sweepable.Other(1)
    requests = [
        one,
        other,
        {"class": "Point", "x": 1},
        [one],
        (one,),
        {"x": one},
        [1],
        (1,),
        [1.0],
        [True],
        np.int64(1),
        {"1": 0},
    ]
    keys = {key_of(sweepable.sleep, request) for request in requests}
    assert len(keys) == len(requests)
    assert key_of(sweepable.sleep, 1) != key_of(sweepable.pid, 1)
    for function in (sweepable.Point(2).scaled, sweepable.decorated):
        with pytest.raises(TypeError, match="has no name to store results under"):
            key_of(function, 1)
    with pytest.raises(TypeError, match="a dict"):
        key_of(sweepable.sleep, {1: 0})


@pytest.mark.slow
def test_a_script_without_its_guard_is_told_so(tmp_path):
    script = (
        "import sys; sys.path[:0] = {!r}\nimport sweepable\nfrom workbench.lab.sweeps "
        "import sweep\n"
    )
    script += "print(sweep(sweepable.sleep, [0.0, 0.0], workers=2, progress=False))\n"
    (tmp_path / "script.py").write_text(script.format([str(Path(__file__).parent)]))
    done = subprocess.run(
        [sys.executable, str(tmp_path / "script.py")],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (
        done.returncode == 1
        and "call sweep() only below `if __name__ == '__main__':`" in done.stderr
    )


def test_progress_counts_every_run_once():
    told = []
    sweep(sweepable.sleep, [0.0, 0.0, 0.0], workers=1, progress=told.append)
    assert told == [1, 1, 1]


@pytest.mark.slow
def test_workers_end_when_their_parent_is_killed(tmp_path):
    script = (
        "import time\nfrom workbench.lab.sweeps import process_pool\nimport sweepable\n"
        "if __name__ == '__main__':\n    with process_pool(1) as pool:\n"
        "        print(pool.submit(sweepable.pid, 0).result(), flush=True)\n        "
        "time.sleep(60)\n"
    )
    path = tmp_path / "parent.py"
    path.write_text(script)
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
    with subprocess.Popen(
        [sys.executable, str(path)], stdout=subprocess.PIPE, text=True, env=environment
    ) as parent:
        worker = int(parent.stdout.readline())
        os.kill(worker, 0)
        parent.kill()
    for _ in range(100):
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            break
        if (
            Path(f"/proc/{worker}/stat").exists()
            and Path(f"/proc/{worker}/stat").read_text().split()[2] == "Z"
        ):
            break  # dead, waiting for whoever adopted it
        time.sleep(0.1)
    else:
        pytest.fail(f"worker {worker} outlived its parent by ten seconds")


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # dask's own, while a worker is being killed
def test_dask_delivers_all_runs_once_though_a_worker_is_killed_half_way(tmp_path):
    configs = [ConvoyConfig(followers=1, drive="planar", seed=seed) for seed in range(200)]
    serial = sweep(
        sweepable.learn_a_little, configs, store=tmp_path / "serial", workers=2, progress=False
    )
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
    dask = [sys.executable, "-m", "dask"]
    address = tmp_path / "scheduler.json"
    scheduler = subprocess.Popen(
        [*dask, "scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(address)],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    workers = []
    try:
        while not address.is_file():
            time.sleep(0.1)
        for _ in range(2):
            workers.append(
                subprocess.Popen(
                    [
                        *dask,
                        "worker",
                        "--scheduler-file",
                        str(address),
                        "--nthreads",
                        "1",
                        "--no-nanny",
                        "--no-dashboard",
                    ],
                    env=environment,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    cwd=tmp_path,
                )
            )
        done = []

        def tell(count):
            done.append(count)
            if len(done) == 100:
                workers[0].send_signal(signal.SIGKILL)

        with Client(scheduler_file=str(address)) as client:
            client.wait_for_workers(2, timeout=60)
            results = sweep(
                sweepable.learn_a_little,
                configs,
                client.get_executor(),
                store=tmp_path / "dask",
                progress=tell,
            )
        assert workers[0].wait() == -signal.SIGKILL and workers[1].poll() is None
        scheduler_address = json.loads(address.read_text())[
            "address"
        ]  # the command line, on what is left of the cluster
        assert (
            main(
                ["study", "inner", "--scheduler", scheduler_address, "--out", str(tmp_path / "cli")]
            )
            == 0
        )
        assert (tmp_path / "cli" / "inner.csv").read_text().count("\n") == 13
    finally:
        for process in [*workers, scheduler]:
            process.kill()
            process.wait()
    assert sum(done) == 200 and results == serial
    assert _bytes(tmp_path / "dask") == _bytes(tmp_path / "serial")
    assert [run["seed"] for run in results] == list(range(200))


def test_a_pool_runs_in_other_processes():
    with process_pool(1) as pool:
        assert pool.submit(sweepable.pid, 0).result() != os.getpid()
