"""A machine whose parameters differ from state to state, against one set after the other."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from gibbs_codegen.arrays import Functions, variable
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.interface.actuators import trivial

COUNT = 4


@pytest.mark.parametrize("robot", ["hexarotor_3link", "hydrus"])
def test_a_vehicle_with_arrays_is_as_many_vehicles(
    robot: str, shipped: Callable[[str], ModuleType]
) -> None:
    module, rng = shipped(robot), np.random.default_rng(2)
    values = {name: x * rng.uniform(0.8, 1.2, COUNT) for name, x in module.PARAMETERS.items()}
    many = Vehicle(module, values)
    q = many.neutral + rng.uniform(-0.5, 0.5, (COUNT, len(module.COORDINATES)))
    force = rng.normal(size=(COUNT, many.layout.v.size))
    wrenches, here = many.thrust_wrenches(q), many.thrust_wrenches()
    offsets, pushes = many.centre_offset(q), many.base_wrench(q, force)
    damping = many.damping
    for i in range(COUNT):
        one = Vehicle(module, {name: float(x[i]) for name, x in values.items()})
        np.testing.assert_allclose(wrenches[i], one.thrust_wrenches(q[i]), atol=1e-13)
        np.testing.assert_allclose(here[i], one.thrust_wrenches(), atol=1e-13)
        np.testing.assert_allclose(offsets[i], one.centre_offset(q[i]), atol=1e-13)
        np.testing.assert_allclose(pushes[i], one.base_wrench(q[i], force[i]), atol=1e-12)
        np.testing.assert_allclose(damping[i], one.damping, atol=1e-12)
        angles = np.broadcast_to(many.arm_angles(), (COUNT, *one.arm_angles().shape))
        np.testing.assert_allclose(angles[i], one.arm_angles(), atol=1e-13)
        assert many.rotors_move == one.rotors_move


def test_values_that_are_wrong_are_not_listed(shipped: Callable[[str], ModuleType]) -> None:
    module = shipped("hexarotor_3link")
    masses = {name: np.zeros(1000) for name in module.PARAMETERS if "mass" in name}
    with pytest.raises(UsageError, match=r"parameters: state 0 of 1000: .* of shape \(1000,\)"):
        Vehicle(module, masses)
    gravity = np.where(np.arange(1000) == 17, np.nan, 9.81)
    with pytest.raises(UsageError) as raised:
        Vehicle(module, {"gravity": gravity})
    assert str(raised.value) == (
        "hexarotor_3link: parameters: gravity: value 17 of 1000 must be a finite number, not nan"
    )


def test_commands_are_inputs_where_there_are_no_drives(
    shipped: Callable[[str], ModuleType],
) -> None:
    """Nothing follows them; what stands for drives is not called where a robot has some."""
    module = shipped("hexarotor_3link")
    vehicle, u = Vehicle(module), np.arange(18.0).reshape(2, 9)
    robot, nodes = Functions(module), [variable(x, 9) for x in ("x", "command")]
    for name in ("inputs_of", "command_of"):
        np.testing.assert_array_equal(vehicle.function(name)(None, None, u), u)
        assert getattr(robot, name)(*nodes) is nodes[1]
    for name in ("actuator_rates", "actuator_state_of"):
        assert vehicle.function(name)(u).shape == (2, 0)
        assert getattr(robot, name)(*nodes).size == 0
    without_states = SimpleNamespace(COMMANDS=("F_1",), ROTORS=("F_1",), ACTUATOR_STATES=())
    assert trivial(without_states).keys() == {"actuator_rates", "actuator_state_of"}
    assert trivial(SimpleNamespace(COMMANDS=("F_1",), ACTUATOR_STATES=("F_1",))) == {}
