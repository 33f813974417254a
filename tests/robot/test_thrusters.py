"""Rank and conditioning of motor arrangements, against what a person can work out."""

from __future__ import annotations

import numpy as np
import pytest
from support.random_robots import random_robot

from gibbs_codegen.robot.balance import TiltHint, arrangement, tilt_hint, wrench_matrix
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.parts.body import Rod
from gibbs_codegen.robot.parts.numbers import AXES


def test_paper_s_arrangement_commands_every_motion() -> None:
    assert arrangement(paper_family(6, 3)).rank == 6


def test_all_thrusts_up_give_force_and_two_moments_only() -> None:
    base = Base(
        rotors=6,
        arms=(Rod(length=0.5, mass_per_length=1.0),),
        thrust=(AXES["z"],) * 6,
        drag=(0.0,) * 6,
    )
    found = arrangement(Robot("upright", base))
    assert found.rank == 3
    assert found.condition == np.inf
    assert found.missing == ("force along x", "force along y", "torque about z")


def test_a_quadrotor_lacks_two_directions() -> None:
    assert arrangement(paper_family(4, 2)).rank == 4
    assert len(arrangement(paper_family(4, 2)).missing) == 2


@pytest.mark.parametrize("rotors", [2, 3, 6, 9])
def test_motor_1_pushes_up_behind_the_centre(rotors: int) -> None:
    """Motor 1 sits at −x and pushes up: force z and a moment about y of +l."""
    matrix = wrench_matrix(paper_family(rotors, 0))
    np.testing.assert_allclose(matrix[:, 0], [0, 0, 1, 0, 0.5, 0], atol=1e-15)


def test_motors_of_an_upright_quadrotor_stand_around_it() -> None:
    """Behind the centre, to its right, in front and to its left: moments (y, −x) of the force."""
    base = Base(
        rotors=4,
        arms=(Rod(length=0.5, mass_per_length=1.0),),
        thrust=(AXES["z"],) * 4,
        drag=(0.0,) * 4,
    )
    moments = wrench_matrix(Robot("upright", base))[3:5]
    np.testing.assert_allclose(moments, [[0, -0.5, 0, 0.5], [0.5, 0, -0.5, 0]], atol=1e-15)


def test_condition_is_that_of_the_wrenches() -> None:
    robot = random_robot(3, 8, 0)
    found = arrangement(robot)
    assert found.rank == 6
    assert found.missing == ()
    assert found.condition == pytest.approx(np.linalg.cond(wrench_matrix(robot)), rel=1e-9)


def test_thrusts_along_their_own_arms_push_in_the_plane_only() -> None:
    base = Base(
        rotors=4,
        arms=(Rod(length=0.5, mass_per_length=1.0),),
        thrust=(AXES["x"],) * 4,
        drag=(0.0,) * 4,
    )
    found = arrangement(Robot("radial", base))
    assert found.rank == 2
    assert found.missing == (
        "force along z",
        "torque about x",
        "torque about y",
        "torque about z",
    )


def tilted(rotors: int, signs: list[int], drag: float = 0.02) -> Robot:
    """Rotors tilted by 20 degrees about their arms, to the sides that signs give."""
    s, c = np.sin(np.deg2rad(20)), np.cos(np.deg2rad(20))
    thrust = tuple((0.0, float(sign * s), float(c)) for sign in signs)
    drags = tuple((-1) ** k * drag for k in range(rotors))
    return Robot(
        "tilted",
        Base(
            rotors=rotors, arms=(Rod(length=0.3, mass_per_length=1.0),), thrust=thrust, drag=drags
        ),
    )


def test_alternating_tilts_want_the_other_sign_on_arm_1() -> None:
    """One rule for all arms gives arm 1, whose axes point the other way, the wrong sign."""
    one_rule = [(-1) ** k for k in range(6)]
    hint = tilt_hint(tilted(6, one_rule))
    assert hint is not None
    assert hint.motors == (1,)
    right = tilted(6, [-one_rule[0], *one_rule[1:]])
    assert hint.condition == pytest.approx(arrangement(right).condition)
    assert hint.condition < arrangement(tilted(6, one_rule)).condition / 3
    assert tilt_hint(right) is None
    assert "thrust of motor 1 tilted to the other side" in hint.text()


def test_tilts_that_do_not_alternate_are_told_to() -> None:
    hint = tilt_hint(tilted(6, [-1, 1, 1, 1, 1, 1], drag=0.0))
    assert hint is not None
    assert hint.motors == (2, 4, 6)
    assert "motors 2, 4 and 6" in hint.text()
    assert np.isfinite(hint.condition)


@pytest.mark.parametrize("rotors", [4, 6])
def test_no_hint_where_no_signs_would_help(rotors: int) -> None:
    upright = Robot(
        "upright",
        Base(
            rotors=rotors,
            arms=(Rod(length=0.5, mass_per_length=1.0),),
            thrust=(AXES["z"],) * rotors,
            drag=(0.0,) * rotors,
        ),
    )
    assert tilt_hint(upright) is None
    assert tilt_hint(paper_family(rotors, 0)) is None
    assert TiltHint((1, 3), 5.0).text().startswith("if the thrust of motors 1 and 3 tilted")
