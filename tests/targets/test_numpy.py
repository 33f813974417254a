"""The emitted NumPy module as its users meet it: batches, constants, names, bad arguments."""

from __future__ import annotations

import ast
import inspect
from types import ModuleType

import numpy as np
import pytest

from gibbs_codegen.targets.numpy.statements import literals

FUNCTIONS = {
    "mass_matrix": (("q",), (9, 9)),
    "residual": (("q", "v"), (9,)),
    "input_matrix": (("q",), (9, 9)),
    "hybrid_mass_matrix": (("q",), (19, 19)),
    "hybrid_residual": (("q", "v"), (19,)),
    "hybrid_input_matrix": (("q",), (19, 9)),
    "forward_dynamics": (("q", "v", "u"), (9,)),
    "inverse_dynamics": (("q", "v", "a"), (9,)),
    "constraint_torques": (("q", "v", "a", "u"), (5,)),
    "gibbs": (("q", "v", "a"), ()),
    "kinetic_energy": (("q", "v"), ()),
    "potential_energy": (("q",), ()),
    "positions": (("q",), (12, 3)),
    "tip_pose": (("q",), (4, 4)),
    "tip_jacobian": (("q",), (6, 9)),
    "tip_bias_acceleration": (("q", "v"), (6,)),
}


@pytest.fixture(scope="module")
def module(shipped) -> ModuleType:
    return shipped("hexarotor_3link")


def arguments(names: tuple[str, ...], *batch: int) -> list[np.ndarray]:
    rng = np.random.default_rng(1)
    return [rng.normal(size=(*batch, 9)) for _ in names]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_one_state_and_batches_agree(module: ModuleType, name: str) -> None:
    function = getattr(module, name)
    names, shape = FUNCTIONS[name]
    values = arguments(names, 2, 3)
    batch = function(*values)
    assert batch.shape == (2, 3, *shape)
    assert batch.dtype == np.float64
    assert batch.flags.c_contiguous
    for i, j in np.ndindex(2, 3):
        one = function(*(value[i, j] for value in values))
        assert one.shape == shape
        np.testing.assert_allclose(one, batch[i, j], rtol=1e-13, atol=1e-13)


def test_leading_axes_broadcast(module: ModuleType) -> None:
    q, v = arguments(("q", "v"), 4)
    one, many = module.residual(q[0], v), module.residual(np.broadcast_to(q[0], (4, 9)), v)
    np.testing.assert_array_equal(one, many)
    crossed = module.residual(q[:, None, :], v[None, :, :])
    assert crossed.shape == (4, 4, 9)
    np.testing.assert_allclose(crossed[1, 2], module.residual(q[1], v[2]), rtol=1e-13)
    assert module.mass_matrix(np.zeros((0, 9))).shape == (0, 9, 9)


def test_both_in_one_pass(module: ModuleType) -> None:
    q, v = arguments(("q", "v"), 5)
    matrix, residual = module.mass_matrix_and_residual(q, v)
    np.testing.assert_allclose(matrix, module.mass_matrix(q), rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(residual, module.residual(q, v), rtol=1e-12)
    np.testing.assert_array_equal(matrix, matrix.swapaxes(-1, -2))


def test_lists_and_integers_are_welcome(module: ModuleType) -> None:
    zeros = [0] * 9
    np.testing.assert_array_equal(module.mass_matrix(zeros), module.mass_matrix(np.zeros(9)))


def test_constants_of_other_parameters(module: ModuleType) -> None:
    """Half the gravity halves the weight; a key left out keeps its default."""
    q = arguments(("q",))[0]
    light = module.prepare({"gravity": module.PARAMETERS["gravity"] / 2})
    ours = module.potential_energy(q, constants=light)
    assert ours == pytest.approx(module.potential_energy(q) / 2, rel=1e-15)


def test_every_function_takes_constants(module: ModuleType) -> None:
    for name in (*FUNCTIONS, "mass_matrix_and_residual"):
        assert list(inspect.signature(getattr(module, name)).parameters)[-1] == "constants"


def test_unknown_parameter_is_refused(module: ModuleType) -> None:
    with pytest.raises(ValueError, match="gravty"):
        module.prepare({"gravty": 1.0})


def test_wrong_length_is_refused_by_name(module: ModuleType) -> None:
    with pytest.raises(ValueError, match=r"v must have 9 entries along its last axis"):
        module.residual(np.zeros(9), np.zeros(8))
    with pytest.raises(ValueError, match=r"q must have 9 entries"):
        module.mass_matrix(0.0)


def test_one_state_that_is_not_finite_answers_as_a_batch_does(module: ModuleType) -> None:
    """Floats would raise where arrays give inf or nan."""
    q, v, u = arguments(("q", "v", "u"))
    q[0] = np.nan
    one, batch = module.forward_dynamics(q, v, u), module.forward_dynamics(q[None], v, u)
    np.testing.assert_array_equal(one, batch[0])
    q[0] = np.inf
    assert np.isnan(module.mass_matrix(q)).any()


def test_names_are_those_of_the_contract(module: ModuleType) -> None:
    assert module.NAME == "hexarotor_3link"
    assert module.ATTITUDE == "xyz"
    assert module.COORDINATES[:4] == ("theta_m1", "theta_0", "theta_1", "theta_7")
    assert (*(f"F_{k}" for k in range(1, 7)), "tau_7", "tau_8", "tau_9") == module.INPUTS
    motors = [f"motor{k}" for k in range(1, 7)]
    assert ("O1", "O2", *motors, "joint7", "joint8", "joint9", "tip") == module.POINTS
    assert module.PARAMETERS["link2_mass_per_length"] == 1.0
    assert "base_drag_1" not in module.PARAMETERS
    assert set(module.__all__) >= {"prepare", "PARAMETERS", *FUNCTIONS}


def test_leading_axes_that_do_not_fit_are_named(module: ModuleType) -> None:
    with pytest.raises(ValueError, match=r"leading axes do not broadcast: q \(2,\), v \(3,\)"):
        module.residual(np.zeros((2, 9)), np.zeros((3, 9)))


def test_constants_must_be_the_module_s_own(module: ModuleType, shipped) -> None:
    others = shipped("quadrotor_2link").prepare({})
    for wrong in (module.PARAMETERS, others, [1.0]):
        with pytest.raises(TypeError, match=r"what this module's prepare\(\) returned"):
            module.mass_matrix(np.zeros(9), constants=wrong)


def test_parameters_that_are_no_numbers_are_refused(module: ModuleType) -> None:
    with pytest.raises(ValueError, match="link2_length must be a finite number, not nan"):
        module.prepare({"link2_length": float("nan")})


def test_parameters_that_overflow_are_refused(module: ModuleType) -> None:
    length = next(name for name in module.PARAMETERS if name.endswith("_length"))
    with pytest.raises(ValueError, match="too large or too small"):
        module.prepare({length: 1e200})


def test_parameters_that_leave_no_mass_are_refused(module: ModuleType) -> None:
    massless = {name: 0.0 for name in module.PARAMETERS if name.endswith("mass_per_length")}
    with pytest.raises(ValueError, match="leave an acceleration undetermined"):
        module.prepare(massless)


def test_a_machine_may_weigh_grams(module: ModuleType) -> None:
    densities = {n: v for n, v in module.PARAMETERS.items() if n.endswith("mass_per_length")}
    light = module.prepare({name: density / 1e4 for name, density in densities.items()})
    q = arguments(("q",))[0]
    mass = module.mass_matrix(q)[-1, -1]
    assert module.mass_matrix(q, constants=light)[-1, -1] == pytest.approx(mass / 1e4, rel=1e-12)


def test_no_line_of_a_list_ends_in_a_text() -> None:
    units = ("N", *["N m"] * 60)
    lines = literals(units)
    assert len(lines) > 1
    assert ast.literal_eval(f"({' '.join(lines)})") == units
    assert all(line.count('"') % 2 == 0 for line in lines)
