"""What the command line tells of limits that inputs reached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from support.synthetic_flight import synthetic_flight

from gibbs_codegen.cli.simulate import joints_beyond, reached_limits
from gibbs_codegen.flight.record.flight import Flight


@pytest.fixture(scope="module")
def flight(shipped: Callable[[str], ModuleType]) -> Flight:
    """Commands in a range of 1 to 9, for limits of 0 to 10."""
    base = synthetic_flight(shipped("hexarotor_3link"))
    shape = base.commanded.shape
    limits = np.array([[0.0], [10.0]]) * np.ones(shape[1])
    least, greatest = np.full(shape, 1.0), np.full(shape, 9.0)
    return replace(base, input_limits=limits, commanded_least=least, commanded_greatest=greatest)


def test_nothing_is_told_where_nothing_is_reached(flight: Flight) -> None:
    endless = np.array([[-np.inf], [np.inf]]) * np.ones(len(flight.input_names))
    assert reached_limits(flight) == ""
    assert reached_limits(replace(flight, input_limits=endless)) == ""


def test_the_worst_is_told_with_its_time(flight: Flight) -> None:
    greatest, least = flight.commanded_greatest.copy(), flight.commanded_least.copy()
    greatest[5, 0], least[7, 2], greatest[9, 6] = 10.0, -12.0, 15.0
    greatest[-1, 1] = np.nan
    beyond = replace(flight, commanded_greatest=greatest, commanded_least=least)
    assert reached_limits(beyond) == (
        f"F_1, F_3, tau_7 (F_3 was asked for -12 N of 0 N at t = {flight.time[7]:.3g} s)"
    )
    greatest[3, 6] = 88.0
    assert "(tau_7 was asked for 88 N m of 10 N m at t =" in reached_limits(beyond)


def test_an_input_that_stays_at_a_limit_is_told_to_be_there(flight: Flight) -> None:
    greatest = flight.commanded_greatest.copy()
    greatest[4, 1] = 10.00001
    said = reached_limits(replace(flight, commanded_greatest=greatest))
    assert "(F_2 reached 10 N at" in said
    least = flight.commanded_least.copy()
    least[4, 1] = 0.0
    said = reached_limits(replace(flight, commanded_least=least))
    assert said == f"F_2 (F_2 reached 0 N at t = {flight.time[4]:.3g} s)"


def test_of_a_rotor_that_is_held_at_nothing_nothing_is_told(flight: Flight) -> None:
    limits, least = flight.input_limits.copy(), flight.commanded_least.copy()
    greatest = flight.commanded_greatest.copy()
    limits[:, 1] = least[:, 1] = greatest[:, 1] = 0.0
    limited = replace(
        flight, input_limits=limits, commanded_least=least, commanded_greatest=greatest
    )
    assert reached_limits(limited) == ""
    greatest[6, 1] = 3e-10  # Rounding, beside the weight.
    assert reached_limits(limited) == ""
    greatest[6, 1] = 3.0
    assert "F_2 was asked for 3 N of 0 N at" in reached_limits(limited)


def test_a_joint_beyond_its_limits_is_told_with_the_worst_time(flight: Flight) -> None:
    joints = flight.layout.q.joints
    count = len(flight.coordinates[joints])
    q = flight.q.copy()
    q[:, joints] = 0.0
    limits = np.array([[-1.0], [1.0]]) * np.ones(count)
    limited = replace(flight, q=q, joint_limits=limits)
    assert joints_beyond(limited) == ""
    q[4, joints.start], q[5, joints.start], q[6, joints.start] = 1.1, 1.3, np.nan
    assert joints_beyond(limited) == (
        f"{flight.coordinates[joints][0]} came to 1.3 rad, beyond 1 rad, at t = "
        f"{flight.time[5]:.3g} s"
    )
    assert joints_beyond(replace(limited, joint_limits=np.zeros((2, 0)))) == ""


def test_of_many_inputs_the_first_are_named_and_the_others_counted(
    flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of six thrusts and three torques."""
    monkeypatch.setattr("gibbs_codegen.cli.simulate._MOST_NAMES", 7)
    greatest = np.full_like(flight.commanded_greatest, 11.0)
    said = reached_limits(replace(flight, commanded_greatest=greatest))
    named, _, more = said.partition(" (")[0].partition(" and ")
    assert len(named.split(", ")) + int(more.removesuffix(" more")) == 9
    assert more == "2 more"
