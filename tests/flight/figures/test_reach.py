"""The figure of reachable wrenches draws their vertices, hovering and its margins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from mpl_toolkits.mplot3d.art3d import Line3D, Poly3DCollection

from gibbs_codegen import UsageError, reachable_wrenches, reachable_wrenches_figure

Load = Callable[[str], ModuleType]


@pytest.mark.slow
def test_polygons_join_the_vertices_and_lines_are_the_margins(shipped: Load) -> None:
    found = reachable_wrenches(shipped("dual_arm"))
    figure = reachable_wrenches_figure(found)
    shapes = (found.forces, found.torques)
    for axes, shape, part in zip(figure.axes, shapes, (slice(0, 3), slice(3, 6)), strict=True):
        (faces,) = (c for c in axes.collections if isinstance(c, Poly3DCollection))
        corners = np.concatenate([np.array(face) for face in faces._faces])  # no public way
        assert all(np.isclose(corners, vertex).all(axis=1).any() for vertex in shape.vertices)
        assert len(faces._faces) == (len(shape.offsets) if shape.basis.shape[1] == 3 else 1)
        *margins, hover = (line for line in axes.lines if isinstance(line, Line3D))
        assert np.ravel(hover.get_data_3d()) == pytest.approx(found.hover[part])
        for axis, line in enumerate(margins):
            ends = np.array(line.get_data_3d())[axis]
            assert ends - found.hover[part][axis] == pytest.approx(
                found.margins[part][axis] * [-1, 1]
            )
        assert axes.get_xlabel() in ("$F_x$ (N)", "$M_x$ (N m)")


def test_a_robot_that_cannot_hover_is_not_drawn(shipped: Load) -> None:
    found = reachable_wrenches(shipped("quadrotor"))
    with pytest.raises(UsageError, match="no thrusts within the limits hover"):
        reachable_wrenches_figure(replace(found, limits=found.limits / 10.0))
