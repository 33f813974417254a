"""Courses of motions, and clocks along them: geometry kept, rests kept, smooth in time."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.differences import rate

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.desired.timing import ArcLength, Clock, Profile, nodes
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.paths import Harmonic, Line, Path, Term, Waypoints

LINE = Line((0, 0, 1), (3, 0, 5), 2.0, 1.0)
PAUSE = Waypoints([0, 1, 1.5, 3], [(0, 0, 0), (1, 1, 0), (1, 1, 0), (1, 0, 0)])
BACK_AND_FORTH = Harmonic(x=(Term(1.0, 0.0, 2.0),))


def arc(path: Path, duration: float) -> ArcLength:
    """The length of the way of a point on a path."""
    time = np.linspace(0.0, duration, int(200 * duration) + 1)
    place = path(time)
    return ArcLength(Reference(Motion(time, place[:, 0], place[:, 1], place[:, 2])))


def even(found: ArcLength, square: float) -> list[Profile]:
    """Profiles of a bang and a bang, from rest to rest, with a greatest speed."""
    profiles = []
    for stretch in found.stretches:
        lengths = np.linspace(stretch.first, stretch.last, 400)
        nearest = np.minimum(lengths - stretch.first, stretch.last - lengths)
        profiles.append(Profile(lengths, np.minimum(2.0 * nearest, square)))
    return profiles


def test_rests_part_stretches() -> None:
    (stretch,) = arc(LINE, 4.0).stretches
    assert (stretch.begin, stretch.end) == pytest.approx((1.0, 3.0), abs=2e-3)
    assert stretch.last - stretch.first == pytest.approx(5.0, rel=1e-9)
    assert stretch.speeds == (0.0, 0.0)
    first, second = arc(PAUSE, 3.0).stretches
    assert (first.end, second.begin) == pytest.approx((1.0, 1.5), abs=1e-2)
    assert first.last == second.first


def test_a_motion_rests_where_it_turns_back() -> None:
    stretches = arc(BACK_AND_FORTH, 4.0).stretches
    assert [s.begin for s in stretches] == pytest.approx([0.0, np.pi / 2, np.pi], abs=3e-3)
    assert [s.speeds[0] for s in stretches] == [0.0, 0.0, 0.0]
    assert stretches[-1].speeds[1] == pytest.approx(2.0 * abs(np.sin(8.0)), rel=1e-6)


def test_lengths_and_times_are_inverse_and_directions_have_length_one() -> None:
    found = arc(PAUSE, 3.0)
    time = np.array([0.2, 0.7, 0.9, 1.8, 2.5])
    assert_allclose(found.times(found.length(time)), time, atol=1e-9)
    q, direction, _ = found.at(time)
    assert_allclose(np.linalg.norm(direction, axis=1), 1.0, atol=1e-6)
    assert_allclose(q, PAUSE(time)[:, 0], atol=1e-9)
    # How the direction changes along the path, by differences.
    inner = found.length(np.array([0.5, 2.0, 2.3]))
    slope = rate(lambda lengths: found.at(found.times(lengths))[1], inner, 1e-3)
    assert_allclose(found.at(found.times(inner))[2], slope, atol=2e-3)


def test_nodes_go_from_end_to_end() -> None:
    found = arc(LINE, 4.0)
    (stretch,) = found.stretches
    time = nodes(found, stretch, 0.02)
    assert time[[0, -1]].tolist() == [stretch.begin, stretch.end]
    assert np.all(np.diff(found.length(time)) > 0.0)
    assert np.diff(time).max() < 0.04
    assert np.diff(found.length(time)).max() < 0.02 * 5.0


@pytest.mark.parametrize("window", [0.0, 0.08])
@pytest.mark.parametrize(("path", "duration"), [(LINE, 4.0), (PAUSE, 3.0), (BACK_AND_FORTH, 3.0)])
def test_a_clock_keeps_the_geometry_and_is_smooth(
    path: Path, duration: float, window: float
) -> None:
    found = arc(path, duration)
    clock = Clock(found, even(found, 2.25), 0.005, window)
    time = np.linspace(0.05, clock.duration - 0.05, 41) + 1e-4
    q, v, a = clock.motion(time)
    scenario_time = clock.scenario_time(time)
    assert_allclose(q, path(scenario_time[:, 0])[:, 0], atol=1e-8)
    for order, series in ((0, v), (1, a)):
        slope = rate(lambda t, k=order: clock.motion(t)[k], time, step=1e-4)
        # At a rest the time along the path is known to some 1e-6 s, and q to 1e-9 over these steps.
        assert_allclose(slope, series, atol=2e-2 if order else 1e-5)
    moving = np.linalg.norm(v, axis=1) > 0.1
    slope = rate(lambda t: clock.scenario_time(t)[:, 0], time[moving], step=1e-4)
    assert_allclose(slope, scenario_time[moving, 1], rtol=1e-5)
    assert np.linalg.norm(a, axis=1).max() < 1.0 + 2.25 * 0.1 + 10.0 * (path is PAUSE)


def test_ends_and_rests_are_at_rest_and_as_long_as_they_were() -> None:
    found = arc(PAUSE, 3.0)
    clock = Clock(found, even(found, 4.0), 0.005, 0.05)
    q, v, a = clock.motion(np.array([0.0, clock.duration]))
    assert_allclose(q, [(0, 0, 0), (1, 0, 0)], atol=1e-9)
    assert_allclose(v, 0.0, atol=1e-9)
    assert_allclose(a, 0.0, atol=1e-7)
    time = np.linspace(0.0, clock.duration, 4001)
    still = time[np.linalg.norm(clock.motion(time)[1], axis=1) < 1e-9]
    inner = still[(still > 0.5) & (still < clock.duration - 0.5)]
    assert inner[-1] - inner[0] == pytest.approx(0.5, abs=0.04)


def test_a_motion_longer_than_a_flight_may_be_is_refused() -> None:
    found = arc(LINE, 4.0)
    with pytest.raises(UsageError, match=r"takes .* s, and a flight at most"):
        Clock(found, even(found, 1e-7), 0.005, 0.0)
