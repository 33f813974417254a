"""Distances of links from discs of rotors and from walls, against clouds of points and geometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from scipy.spatial import cKDTree
from support.synthetic_flight import synthetic_flight

from gibbs_codegen.cli.simulate import collisions_of
from gibbs_codegen.flight.record.clearance import disc_distances, rim_distances, wall_distances
from gibbs_codegen.flight.record.flight import Flight, read_flight
from gibbs_codegen.flight.scenario.walls import Sphere

pytestmark = pytest.mark.usefixtures("derived_once")


def test_distances_of_discs_are_those_of_clouds_of_points() -> None:
    """A base at point 0 with a rotor, and an arm of points 2 to 4, the first of them a joint."""
    random = np.random.default_rng(2)
    parents = np.array([-1, 0, 0, 2, 3])
    places = random.uniform(-1.0, 1.0, (80, 5, 3))
    axes = random.normal(size=(80, 1, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    radius = 0.4
    found = disc_distances(places, parents, [1], axes, np.array([radius]))[:, 0]
    around = np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
    out, turn = (x.ravel() for x in np.meshgrid(np.linspace(0.0, radius, 30), around))
    share = np.linspace(0.0, 1.0, 400)[:, np.newaxis]
    pierced = 0
    for sample, (points, axis) in enumerate(zip(places, axes[:, 0], strict=True)):
        first, second = np.linalg.svd(axis[np.newaxis])[2][1:]
        disc = (
            points[1] + np.outer(out * np.cos(turn), first) + np.outer(out * np.sin(turn), second)
        )
        links = [points[a] + share * (points[b] - points[a]) for a, b in ((2, 3), (3, 4))]
        near = cKDTree(disc).query(np.concatenate(links))[0].min()
        assert max(found[sample], 0.0) == pytest.approx(near, abs=0.03)
        if found[sample] < 0.0:
            pierced += 1
            inside = []
            for link in links:
                height = (link - points[1]) @ axis
                cut = np.flatnonzero(np.diff(np.sign(height)))
                away = np.linalg.norm(link[cut] - points[1], axis=1)
                inside += (radius - away).tolist()
            assert -found[sample] == pytest.approx(max(inside), abs=0.01)
    assert 3 < pierced < 77
    unknown = disc_distances(places, parents, [1], axes, np.zeros(1))
    assert np.isnan(unknown).all()


def test_distances_of_walls_are_those_of_geometry() -> None:
    ball = Sphere("tip", (0.1, 0.2, 0.3), 0.5, 1.0)
    random = np.random.default_rng(3)
    parents, places = np.array([-1, 0, 1]), random.uniform(-1.5, 1.5, (50, 3, 3))
    found = wall_distances(places, parents, "sphere", np.array(ball.figures), [])

    def away(a: np.ndarray, b: np.ndarray) -> float:
        share = np.clip((ball.centre - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        return float(np.linalg.norm(a + share * (b - a) - ball.centre)) - ball.radius

    expected = [min(away(p[0], p[1]), away(p[1], p[2])) for p in places]
    assert found == pytest.approx(np.array(expected), abs=1e-9)
    assert found.min() < 0.0 < found.max()
    # The end that is there to touch does not count.
    beside = wall_distances(places, parents, "sphere", np.array(ball.figures), [2])
    assert beside == pytest.approx(np.array([away(p[0], p[1]) for p in places]), abs=1e-9)


def test_distances_of_rims_from_walls_are_those_of_geometry() -> None:
    random = np.random.default_rng(4)
    centres, axes = random.normal(size=(2, 20, 2, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    plane = np.array([0.1, 0.2, 0.3, 0.6, 0.0, 0.8])
    found = rim_distances(centres, axes, np.array([0.4, 0.0]), "plane", plane)
    height, upright = (centres[:, 0] - plane[:3]) @ plane[3:], axes[:, 0] @ plane[3:]
    exact = height - 0.4 * np.sqrt(1.0 - upright**2)
    assert np.all((found > exact - 1e-12) & (found < exact + 0.004))


def test_collisions_are_told(shipped: Callable[[str], ModuleType], tmp_path: object) -> None:
    flight: Flight = synthetic_flight(shipped("hexarotor_3link"))
    assert collisions_of(flight) == ""
    assert np.isnan(flight.rotor_distances).all()
    floor = np.array([[0.0, 0.0, flight.point("tip")[:, 2].min() + 0.01, 0.0, 0.0, 1.0]])
    low = replace(flight, walls=floor, wall_kinds=("floor",))
    assert collisions_of(low).startswith("a link is 0.01 m behind wall 1 at t = ")
    touching = replace(low, contact_walls=np.array([1]), contact_frames=("tip",))
    assert collisions_of(touching) == ""
    spinning = replace(low, disc_radii=np.full(6, 0.2))
    assert "a link or rotor is 0.01 m behind wall 1" in collisions_of(spinning)
    wide = replace(flight, disc_radii=np.full(flight.rotors, 0.2))
    columns = {name for name, *_ in wide.columns()}
    assert {"F_1_distance", "F_6_distance"} <= columns
    wide.write_npz(f"{tmp_path}/wide.npz")
    again = read_flight(f"{tmp_path}/wide.npz")
    assert np.array_equal(again.rotor_distances, wide.rotor_distances)
