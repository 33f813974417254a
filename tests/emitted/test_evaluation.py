"""What every NumPy module holds, imported by itself and given a module of its own: one kernel."""

from __future__ import annotations

import inspect
import math
import re

import numpy as np
import pytest

from gibbs_codegen.emitted.evaluation import (
    Evaluator,
    NotFiniteReport,
    batch_shape,
    shaped,
    state_array,
)


def _kernel(k, sin, cos, q, u):
    """A sine, a product, a quotient, and a number that is the same for all states."""
    return sin(q[0]), k[0] * q[1] * u[0], 1.0 / q[0], 7.0


EVALUATE = Evaluator("toy", ("angle", "height"), ("turn", "climb"), ("thrust",), ("base",), (4.0,))


def test_numbers_become_an_array() -> None:
    q = np.array([1.0, 2.0])
    assert state_array("q", q, 2) is q
    assert state_array("q", [True, 2], 2).tolist() == [1.0, 2.0]
    assert batch_shape({"q": np.zeros((3, 1, 2)), "v": np.zeros((4, 5))}) == (3, 4)
    assert batch_shape({"q": np.zeros((3, 1, 2)), "v": np.zeros(5)}, (4,)) == (3, 4)
    words = r"leading axes do not broadcast: q \(2,\), v \(3,\)$"
    with pytest.raises(ValueError, match=words):
        batch_shape({"q": np.zeros((2, 1)), "v": np.zeros((3, 1)), "u": np.zeros(2)})
    with pytest.raises(ValueError, match=r"do not broadcast: q \(2,\), constants \(3,\)$"):
        batch_shape({"q": np.zeros((2, 1))}, (3,))


@pytest.mark.parametrize(
    ("values", "error", "message"),
    [
        ([1j, 2.0], TypeError, "q must be real numbers: not complex"),
        (["1", "2"], TypeError, "q must be real numbers: not str"),
        ([None, 2.0], TypeError, "q must be real numbers: not NoneType"),
        ([1.0, 10**400], ValueError, "q must be real numbers: int too large"),
        (np.ma.array([1.0, 2.0], mask=[0, 1]), ValueError, "q must be real numbers: not masked"),
        ([1.0], ValueError, "q must have 2 entries along its last axis, not shape (1,)"),
        (1.0, ValueError, "q must have 2 entries along its last axis, not shape ()"),
        (np.zeros((1,) * 31 + (2,)), ValueError, "q must have at most 31 axes, not 32"),
    ],
)
def test_what_is_no_state_is_refused_by_name(
    values: object, error: type[Exception], message: str
) -> None:
    with pytest.raises(error) as raised:
        state_array("q", values, 2)
    assert str(raised.value).startswith(message)


def test_one_state_is_computed_on_floats_and_a_batch_on_arrays() -> None:
    q, u = np.array([[0.5, 2.0], [1.0, 3.0], [2.0, 5.0]]), np.array([10.0])
    entries, batch = EVALUATE(_kernel, None, q[0], u)
    assert batch == ()
    assert [*map(type, entries)] == [float] * 4
    assert entries == (math.sin(0.5), 80.0, 2.0, 7.0)
    many, batch = EVALUATE(_kernel, None, q, u)
    assert batch == (3,)
    np.testing.assert_array_equal(shaped(many, (2, 2), batch)[0], shaped(entries, (2, 2), ()))
    np.testing.assert_array_equal(shaped(many, (4,), batch)[:, 3], [7.0] * 3)
    assert EVALUATE(_kernel, (1.0,), q[0], u)[0][1] == 20.0


@pytest.mark.parametrize("constants", [[4.0], (4,), (4.0, 4.0), (True,)])
def test_constants_of_another_kind_are_refused(constants: object) -> None:
    with pytest.raises(TypeError, match=r"what this module's prepare\(\) returned"):
        EVALUATE(_kernel, constants, np.ones(2), np.ones(1))


@pytest.mark.parametrize("count", [1, 3])
def test_what_is_not_finite_is_reported_with_the_largest_argument(count: int) -> None:
    q = np.array([[0.5, 2.0], [0.0, -3.0], [0.0, 5.0]])
    given, where = (q[1], "") if count == 1 else (q, " in 2 of 3 states, first [1],")
    said = f"toy.kernel is not finite{where} though its arguments are:"
    place = re.escape("(largest there: q of height, -3)")
    with pytest.warns(RuntimeWarning, match=f"{re.escape(said)}.*{place}") as warned:
        entries, _ = EVALUATE(_kernel, None, given, np.ones(1))
    assert np.isinf(np.max(entries[2]))
    assert warned[0].filename != inspect.getfile(Evaluator)
    with np.errstate(invalid="ignore"):
        EVALUATE(_kernel, None, given, np.ones(1))
    with np.errstate(invalid="raise"), pytest.raises(FloatingPointError, match=place):
        EVALUATE(_kernel, None, given, np.ones(1))


def test_arguments_that_are_not_finite_are_not_reported() -> None:
    entries, _ = EVALUATE(_kernel, None, np.array([math.nan, 1.0]), np.ones(1))
    assert math.isnan(entries[0])
    lost = {"q": np.array([[math.inf, 1.0]])}
    NotFiniteReport("toy", ("angle", "height"), (), (), ())("kernel", lost, np.array([False]), 1)
