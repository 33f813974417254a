"""Workers that die, and sweeps that are killed: nothing is lost, and nobody else is blamed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from gibbs_codegen import UsageError, sweep, uniform
from gibbs_codegen.flight.sweeps import chunks
from gibbs_codegen.flight.sweeps.execution import Workers

DEADLY = 0.063
PARAMETERS = {
    "duration": [0.05, DEADLY],
    "integration.method": "rk4",
    "start.offset[0]": [0.0, 0.1],
}
WORST = {"worst [m]": "tip_error.max"}
SCRIPT = """
import sys
from gibbs_codegen import scaled, sweep, uniform
from gibbs_codegen.flight.sweeps import chunks
chunks._MOST_FLIGHTS = 4
parameters = {"duration": 0.2, "start.offset[0]": uniform(-0.1, 0.1)}
measure = {"last": "tip_error.last", "mean": lambda flight: flight.q.mean()}
sweep(sys.argv[1], "hover", parameters, 20, 3, measure, out=sys.argv[2], workers=2)
"""


def deadly(flight):
    """A measure that no process survives of one flight."""
    if abs(flight.time[-1] - DEADLY) < 1e-9 and flight.centre_error[0] > 0.05:
        os.kill(os.getpid(), signal.SIGKILL)
    return flight.tip_error.max()


@pytest.fixture(scope="module")
def alive(robot, tmp_path_factory):
    """The table without a measure that kills."""
    out = tmp_path_factory.mktemp("alive")
    with ThreadPoolExecutor(1) as executor:
        yield sweep(robot, "hover", PARAMETERS, 1, 0, WORST, executor, out).table


@pytest.fixture(autouse=True)
def _short_chunks(monkeypatch):
    monkeypatch.setattr(chunks, "_MOST_FLIGHTS", 2)


def assert_one_is_dead(table, alive):
    dead = [f"{row['duration']} {row['start.offset[0]']}" for row in table if row["failed"]]
    assert dead == [f"{DEADLY} 0.1"]
    left = table["failed"] == ""
    assert np.array_equal(table["worst [m]"][left], alive["worst [m]"][left])
    assert "the process that flew it died" in table["failed"][~left][0]


@pytest.mark.slow
def test_the_one_case_that_kills_its_worker_is_found(robot, tmp_path, alive):
    measure = {"worst [m]": deadly}
    table = sweep(robot, "hover", PARAMETERS, measure=measure, out=tmp_path / "a", workers=1).table
    assert_one_is_dead(table, alive)
    # The reason is kept like any result: the same call again kills nothing.
    with ThreadPoolExecutor(1) as here:
        again = sweep(robot, "hover", PARAMETERS, 1, 0, measure, here, tmp_path / "a").table
    assert again.tobytes() == table.tobytes()
    # What is there already counts as done.
    kept = tmp_path / "a" / chunks.FILE
    kept.write_bytes(b"\n".join(kept.read_bytes().split(b"\n")[3:]))
    told = []
    call = (measure, None, tmp_path / "a", lambda what, share: told.append(share), 1)
    sweep(robot, "hover", PARAMETERS, 1, 0, *call)
    assert told[-1] == 1.0


def mortal(lives):
    """A measure that no process survives before all of some files are there."""

    def measure(flight):
        for life in lives:
            if not life.exists():
                life.touch()
                os.kill(os.getpid(), signal.SIGKILL)
        return flight.tip_error.max()

    return measure


@pytest.mark.slow
def test_a_worker_that_dies_twice_loses_nothing(robot, tmp_path, alive):
    lives = [tmp_path / "first", tmp_path / "second"]
    measure = {"worst [m]": mortal(lives)}
    table = sweep(robot, "hover", PARAMETERS, measure=measure, out=tmp_path / "c").table
    assert all(life.exists() for life in lives)
    assert table.tobytes() == alive.tobytes()


@pytest.mark.slow
def test_executorlib_flies_the_same(robot, tmp_path, alive):
    executorlib = pytest.importorskip("executorlib")
    lives = [tmp_path / "first", tmp_path / "second"]
    measure = {"worst [m]": mortal(lives)}
    with executorlib.SingleNodeExecutor(
        max_workers=2, block_allocation=True, restart_limit=2, hostname_localhost=True
    ) as executor:
        table = sweep(robot, "hover", PARAMETERS, 1, 0, measure, executor, tmp_path / "d").table
    assert all(life.exists() for life in lives)
    assert table.tobytes() == alive.tobytes()


@pytest.mark.slow
def test_dask_flies_the_same(robot, tmp_path, alive):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        table = sweep(
            robot, "hover", PARAMETERS, 1, 0, WORST, client.get_executor(), tmp_path / "e"
        ).table
    assert table.tobytes() == alive.tobytes()


@pytest.mark.slow
def test_an_executor_that_never_works_is_told(robot, tmp_path, monkeypatch):
    monkeypatch.setattr(chunks, "_MOST_FLIGHTS", 1)
    pool = ProcessPoolExecutor(1, get_context("spawn"))
    pool.submit(os._exit, 1).exception()
    parameters = {"duration": 0.05, "start.offset[0]": uniform(-0.1, 0.1)}
    with pytest.raises(UsageError, match="the executor has failed 21 times in a row"):
        sweep(robot, "hover", parameters, 30, executor=pool, out=tmp_path / "f")


def test_an_executor_that_was_ended_is_told(robot, tmp_path):
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    with pytest.raises(UsageError, match=r"takes no work: .*; what was done is kept"):
        sweep(robot, "hover", {"duration": 0.05}, executor=pool, out=tmp_path)


class Unpackable:
    """A measure that no worker can unpack."""

    __call__ = abs

    def __setstate__(self, state):
        raise RuntimeError("no licence here")

    def __getstate__(self):
        return {"a": 1}


@pytest.mark.slow
def test_what_no_worker_can_unpack_is_told(robot, tmp_path):
    with pytest.raises(UsageError, match="a worker cannot fly: RuntimeError: no licence here"):
        sweep(robot, "hover", {"duration": 0.05}, measure={"a": Unpackable()}, out=tmp_path)


def started(script, *arguments):
    return subprocess.Popen([sys.executable, script, *arguments], start_new_session=True)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0])
def test_a_sweep_killed_at_any_moment_goes_on(robot, tmp_path, seed):
    script = tmp_path / "script.py"  # Which is not what workers import.
    script.write_text(SCRIPT)
    whole = started(script, robot, tmp_path / "whole")
    begin = time.monotonic()
    assert whole.wait() == 0
    seconds = time.monotonic() - begin
    random = np.random.default_rng(seed)
    kills, out = 0, tmp_path / "killed"
    while kills < 2:
        run = started(script, robot, out)
        try:
            run.wait(random.uniform(0.2, 1.0) * seconds)
        except subprocess.TimeoutExpired:
            # With all that it has started, or by itself.
            os.killpg(run.pid, signal.SIGKILL) if kills % 2 else run.kill()
            kills += 1
            run.wait()
        else:
            break
    assert started(script, robot, out).wait() == 0
    table = [(tmp_path / each / "table.npy").read_bytes() for each in ("whole", "killed")]
    assert table[0] == table[1]
    hidden = [path for path in Path(out).rglob("*") if path.name.startswith(".")]
    assert len(hidden) <= kills


@pytest.mark.slow
def test_workers_end_when_the_program_is_killed(robot, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.replace("0.2", "20.0"))
    run = started(script, robot, tmp_path / "out")
    children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
    deadline = time.monotonic() + 300.0
    while not (found := children.read_text().split()) or len(found) < 3:
        assert time.monotonic() < deadline
        time.sleep(0.1)
    time.sleep(2.0)
    run.kill()
    run.wait()
    while any(Path(f"/proc/{each}").exists() for each in found):
        assert time.monotonic() < deadline
        time.sleep(0.1)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="POSIX alone has masks")
def test_ctrl_c_is_the_callers_while_workers_begin() -> None:
    """Else a worker that is still importing would print a traceback; the caller hears it again."""
    workers = Workers(1)
    try:
        held = workers.submit(signal.pthread_sigmask, signal.SIG_BLOCK, ()).result()
    finally:
        workers.end()
    assert signal.SIGINT in held
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
