"""Workers that die, and sweeps that are killed: nothing is lost, and nobody else is blamed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from support.tools import HANGING

from gibbs_codegen import UsageError, sweep, uniform
from gibbs_codegen.flight.sweeps import chunks
from gibbs_codegen.flight.sweeps.workers import Workers

DEADLY = 0.063
PARAMETERS = {
    "duration": [0.05, DEADLY],
    "integration.method": "rk4",
    "start.offset[0]": [0.0, 0.1],
}
WORST = {"worst [m]": "tip_error.max"}
KILLED = """
import os, signal, sys
from gibbs_codegen import sweep, uniform
from gibbs_codegen.flight.sweeps import chunks
chunks._MOST_FLIGHTS, add = 2, chunks.ResultFile.add
def last(*rows):
    add(*rows)
    os.kill(os.getpid(), signal.SIGKILL)
chunks.ResultFile.add = last
parameters = {"duration": 0.05, "start.offset[0]": uniform(-0.1, 0.1)}
sweep(sys.argv[1], "hover", parameters, 6, 3, {"x": "tip_error.max"}, out=sys.argv[2], workers=2)
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
    table = sweep(robot, "hover", PARAMETERS, measure=measure, out=tmp_path / "c", workers=1).table
    assert all(life.exists() for life in lives)
    assert table.tobytes() == alive.tobytes()


@pytest.mark.slow
def test_executorlib_flies_the_same(robot, tmp_path, alive):
    executorlib = pytest.importorskip("executorlib")
    lives = [tmp_path / "first"]
    measure = {"worst [m]": mortal(lives)}
    with executorlib.SingleNodeExecutor(
        max_workers=1, block_allocation=True, restart_limit=2, hostname_localhost=True
    ) as executor:
        table = sweep(robot, "hover", PARAMETERS, 1, 0, measure, executor, tmp_path / "d").table
    assert all(life.exists() for life in lives)
    assert table.tobytes() == alive.tobytes()


@pytest.mark.slow
def test_dask_flies_the_same(robot, tmp_path, alive):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            1, threads_per_worker=1, processes=False, dashboard_address=None
        ) as cluster,
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
    with pytest.raises(UsageError, match=r"accepts no work: .*; finished flights are kept"):
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


@pytest.mark.slow
def test_a_sweep_that_is_killed_ends_its_workers_and_goes_on(robot, tmp_path):
    """They hold its output, which is read to its end."""
    file = tmp_path / "killed" / chunks.FILE
    command = [sys.executable, "-c", KILLED, robot, tmp_path / "killed"]
    done = subprocess.run(command, stdout=subprocess.PIPE, timeout=HANGING)
    assert done.returncode == -signal.SIGKILL
    kept = [line for line in file.read_text().split("\n") if line]
    assert 0 < len(kept) < 6
    parameters = {"duration": 0.05, "start.offset[0]": uniform(-0.1, 0.1)}
    measure, tables = {"x": "tip_error.max"}, []
    with ThreadPoolExecutor(1) as here:
        for name in ("killed", "whole"):
            call = (parameters, 6, 3, measure, here, tmp_path / name)
            tables.append(sweep(robot, "hover", *call).table.tobytes())
    assert tables[0] == tables[1]
    lines = [line for line in file.read_text().split("\n") if line]
    assert lines[: len(kept)] == kept
    assert len(lines) == 6


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
