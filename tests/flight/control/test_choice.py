"""Which law a robot is flown by, and the words for robots that none flies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from gibbs_codegen import generate
from gibbs_codegen.flight.control.choice import control_law, law_of
from gibbs_codegen.flight.plant.allocation import AllocationError, allocation_of, thrust_axis
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.parts import Control, Law
from gibbs_codegen.machine.laws import LAWS

Load = Callable[[str], ModuleType]


def bent(vehicle: Vehicle, *angles: float) -> Array:
    """Configurations (s, nq) with all joints at an angle each."""
    q = np.tile(vehicle.neutral, (len(angles), 1))
    q[:, vehicle.arm] = np.reshape(angles, (-1, 1))
    return q


@pytest.mark.parametrize(
    ("name", "law", "chosen"),
    [
        ("hexarotor", "tracking", "computed_torque"),
        ("hexarotor", "computed_torque", "computed_torque"),
        ("quadrotor", "tracking", "geometric"),
        ("quadrotor", "geometric", "geometric"),
        ("hydrus", "tracking", "geometric"),
        ("quadrotor_2link", "open_loop", "open_loop"),
        ("quadrotor_2link", "off", "off"),
    ],
)
def test_the_rotors_decide(name: str, law: Law, chosen: Law, shipped: Load) -> None:
    vehicle = Vehicle(shipped(name))
    assert law_of(law, vehicle, bent(vehicle, 1.0, 1.2), "hover") == chosen


@pytest.mark.parametrize(
    ("name", "law", "words"),
    [
        (
            "quadrotor",
            "computed_torque",
            "quadrotor: to fly 'hover' under computed torque, the base must be fully actuated, but "
            "the rotors cannot command force along x and force along y (in the base's frame, about "
            'the base centre); set control.law to "tracking" or "geometric"',
        ),
        (
            "hexarotor",
            "geometric",
            "hexarotor: to fly 'hover' under the geometric law, the rotors must push along one "
            "axis, but they command all directions; set control.law to",
        ),
        ("quadrotor_2link", "tracking", "cannot command force along y and torque about x (in"),
        ("quadrotor_2link", "tracking", "add rotors (all directions take 6 or more), or set"),
        ("quadrotor_2link", "computed_torque", "cannot command force along y and torque about x"),
        ("quadrotor_2link", "geometric", "cannot command force along y and torque about x (in"),
    ],
)
def test_what_cannot_be_flown_is_told(name: str, law: Law, words: str, shipped: Load) -> None:
    vehicle = Vehicle(shipped(name))
    with pytest.raises(AllocationError) as refused:
        law_of(law, vehicle, vehicle.neutral, "hover")
    assert words in str(refused.value)


def test_rotors_on_links_must_command_the_moments_all_along_the_motion(shipped: Load) -> None:
    """Stretched out, all rotors of hydrus are in a row, and none turns it about that."""
    vehicle = Vehicle(shipped("hydrus"))
    assert thrust_axis(vehicle, bent(vehicle, 1.0)) == pytest.approx(np.array([[0.0, 0.0, 1.0]]))
    with pytest.raises(AllocationError, match="torque about x"):
        law_of("tracking", vehicle, bent(vehicle, 1.0, 0.0, 1.0), "hover")


def test_a_law_is_a_row_of_the_table(
    shipped: Load, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """One by another name is chosen, commands the same inputs, and is written in C."""
    name = "hexarotor"
    monkeypatch.setitem(LAWS, "other", replace(LAWS["computed_torque"], title="another law"))
    vehicle = Vehicle(shipped(name))
    still = np.zeros((2, len(vehicle.module.VELOCITIES)))
    motion = Motion(np.array([0.0, 1.0]), np.stack([vehicle.neutral] * 2), still, still)
    reference: Reference = vehicle.kinematics.reference(motion)
    allocation, control = allocation_of(vehicle), Control(integral=0.5)
    q, (v, memory) = vehicle.neutral + 0.1, np.full((2, len(still[0])), 0.2)
    law = law_of("other", vehicle, q, "hover")
    found, same = (
        control_law(each, control, vehicle, reference, allocation)(0.0, q, v, memory)
        for each in (law, "computed_torque")
    )
    assert np.array_equal(found, same)
    folder = generate(name, tmp_path, laws=[law], verify=False)
    assert f"void {name}_other(" in (folder / f"{name}_laws.h").read_text(encoding="utf-8")


def test_the_attitude_is_four_times_as_fast_unless_the_scenario_says(shipped: Load) -> None:
    vehicle = Vehicle(shipped("quadrotor"))
    still = np.zeros((2, 6))
    motion = Motion(np.array([0.0, 1.0]), np.stack([vehicle.neutral] * 2), still, still)
    reference: Reference = vehicle.kinematics.reference(motion)
    places = vehicle.layout.v
    laws: tuple[Law, ...] = ("geometric", "computed_torque")
    for law, control, attitude in (
        (laws[0], Control(frequency=3.0), 12.0),
        (laws[1], Control(frequency=3.0), 3.0),
        (laws[0], Control(frequency=3.0, attitude_frequency=7.0), 7.0),
        (laws[1], Control(frequency=3.0, attitude_frequency=7.0), 7.0),
    ):
        gains = control_law(law, control, vehicle, reference, allocation_of(vehicle)).gains
        assert np.sqrt(gains.stiffness[places.attitude]) == pytest.approx([attitude] * 3)
        assert np.sqrt(gains.stiffness[places.position]) == pytest.approx([3.0] * 3)
        assert gains.damping == pytest.approx(2.0 * np.sqrt(gains.stiffness))
