"""Random calls of a module's functions, right and wrong, through every way there is into them.

A program: `python argument_fuzz.py FOLDER SEED EXAMPLES`. It runs in a process of its own, so that
a crash is told from a failure. Every call goes to the NumPy functions, to the compiled ones, and to
the compiled ones as they are where Python's headers are not installed.
"""

from __future__ import annotations

import array
import sys
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from types import ModuleType
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gibbs_codegen import load
from gibbs_codegen.interface import Signature, module_signatures
from gibbs_codegen.runtime import c_backend

Array = NDArray[np.float64]


class Special(np.ndarray):
    """A subclass of ndarray."""


class Wrapped:
    """What has no numbers but makes an array when asked."""

    def __init__(self, values: Array) -> None:
        self.values = values

    def __array__(self, dtype: Any = None, copy: Any = None) -> NDArray[Any]:
        """The array."""
        return np.asarray(self.values, dtype)


def strided(x: Array) -> Array:
    room = np.full((*x.shape[:-1], 3 * x.shape[-1]), 7.0)
    room[..., ::3] = x
    return room[..., ::3]


def unaligned(x: Array) -> Array:
    return np.frombuffer(b"\0" + x.tobytes(), np.uint8)[1:].view(np.float64).reshape(x.shape)


def read_only(x: Array) -> Array:
    x.flags.writeable = False
    return x


# Values are whole numbers of quarters from 0 to 10, which most types can hold: what is made of them
# has the same numbers.
PRESENTATIONS: dict[str, Callable[[Array], Any]] = {
    "plain": lambda x: x,
    "list": lambda x: x.tolist(),
    "tuple": lambda x: tuple(x.tolist()),
    "list of arrays": list,
    "strided": strided,
    "reversed": lambda x: x[..., ::-1].copy()[..., ::-1],
    "rows reversed": lambda x: x[::-1].copy()[::-1],
    "Fortran": np.asfortranarray,
    "moved axes": lambda x: np.moveaxis(np.moveaxis(x, -1, 0).copy(), 0, -1),
    "unaligned": unaligned,
    "read-only": read_only,
    "subclass": lambda x: x.view(Special),
    "masked nowhere": np.ma.array,
    "wrapped": Wrapped,
    "memory view": lambda x: memoryview(x) if x.size else x,
    "array of Python": lambda x: array.array("d", x) if x.ndim == 1 else x,
    "fractions": lambda x: np.vectorize(Fraction, otypes=[object])(x).tolist(),
    "objects": lambda x: x.astype(object),
    **{
        name: lambda x, name=name: x.astype(name)
        for name in ("f2", "f4", "g", ">f8", "<f8", ">f4", ">f2")
    },
}
# The same for whole numbers, and for 0 and 1.
WHOLE: dict[str, Callable[[Array], Any]] = {
    **{
        name: lambda x, name=name: x.astype(name)
        for name in ("i1", "i2", ">i4", "i8", "u1", ">u2", "u4", "u8")
    },
    "list of whole numbers": lambda x: x.astype(int).tolist(),
}
TRUTHS: dict[str, Callable[[Array], Any]] = {
    "bool": lambda x: x.astype(bool),
    "list of bool": lambda x: x.astype(bool).tolist(),
}
REFUSED: dict[str, Callable[[Array], Any]] = {
    "complex": lambda x: x + 0j,
    "complex64": lambda x: x.astype("c8"),
    "list of complex": lambda x: (x + 1j).tolist(),
    "objects of complex": lambda x: (x + 1j).astype(object),
    "text": lambda x: x.astype(str),
    "list of text": lambda x: x.astype(str).tolist(),
    "bytes": lambda x: x.astype("S"),
    "one text": lambda x: "q" * x.shape[-1],
    "one bytes": lambda x: bytes(x.shape[-1]),
    "objects of digits": lambda x: np.full(x.shape, "1.5", dtype=object),
    "objects of bytes": lambda x: np.full(x.shape, b"2", dtype=object),
    "nothing in a list": lambda x: np.where(np.arange(x.shape[-1]) == 1, None, x).tolist(),
    "objects of text": lambda x: np.full(x.shape, "no number", dtype=object),
    "dates": lambda x: x.astype("M8[s]"),
    "spans of time": lambda x: x.astype("m8[s]"),
    "structured": lambda x: x.copy().view([("a", "f8")]),
    "two fields": lambda x: np.zeros(x.shape, [("a", "f8"), ("b", "f8")]),
    "void": lambda x: np.zeros(x.shape, "V8"),
    "masked somewhere": lambda x: np.ma.array(x, mask=np.ones(x.shape, bool)),
    "nothing": lambda x: None,
    "one number": lambda x: 1.0,
    "no axis": lambda x: np.array(1.0),
    "no numbers": lambda x: [],
    "one more": lambda x: np.concatenate([x, x[..., :1]], axis=-1),
    "one less": lambda x: x[..., 1:],
    "transposed": lambda x: np.ones((x.shape[-1], 1)),
    "many axes": lambda x: x.reshape((1,) * (32 - x.ndim) + x.shape),
    "too large a number": lambda x: [10**400] * x.shape[-1],
    "uneven": lambda x: [[1.0], [1.0, 2.0]],
    "table": lambda x: {"q": x},
    "set": lambda x: {1.0},
    "generator": lambda x: (value for value in x),
    "function": lambda x: len,
    "object": lambda x: object(),
}
# Presentations of one number, and of what is none.
ONE_NUMBER = ["plain", "list", "read-only", "subclass", "wrapped", "objects", "f4", ">f8", "i1"]
NO_NUMBER = ["complex", "text", "nothing", "dates", "table", "set", "function", "object"]
CONSTANTS_REFUSED: dict[str, Callable[[Any], Any]] = {
    "one more": lambda k: k + k[:1],
    "one less": lambda k: k[1:],
    "empty": lambda k: k[:0],
    "list": list,
    "bytearray": lambda k: bytearray(len(k)),
    "array": lambda k: np.ones(len(k)),
    "text": lambda k: "k" * len(k),
    "number": lambda k: 7,
    "of the other back end": lambda k: bytes(8 * len(k)) if isinstance(k, tuple) else (1.0,) * 27,
    "with text": lambda k: ("k", *k[1:]) if isinstance(k, tuple) else "k",
    "with nothing": lambda k: (*k[1:], None) if isinstance(k, tuple) else (),
    "with an array": lambda k: (*k[1:], np.ones(3)) if isinstance(k, tuple) else np.ones(3),
    "with a complex": lambda k: (*k[1:], 1j) if isinstance(k, tuple) else 1j,
    "with a large one": lambda k: (*k[1:], 10**400) if isinstance(k, tuple) else 10**400,
}

# What nobody can tell from constants that were prepared: other numbers.
CONSTANTS_CHANGED: dict[str, Callable[[Array], Array]] = {
    "given": lambda k: k,
    "scaled": lambda k: 1.5 * k,
    "not numbers": lambda k: np.full_like(k, np.nan),
}
# Mostly as they should be.
CONSTANTS = [*["left out", "none", "of each", *CONSTANTS_CHANGED] * 8, *CONSTANTS_REFUSED]


@dataclass(frozen=True)
class Case:
    """A module, the ways into it, and what it has."""

    numpy: ModuleType
    ways: tuple[ModuleType, ...]
    functions: tuple[Signature, ...]


def case(folder: str) -> Case:
    """The module in a folder. Raises `RuntimeError` where it does not compile."""
    numpy, fast = load(folder), load(folder, backend="c")
    c_backend.caller_type = lambda _: None
    slow = load(folder, backend="c")
    if any(module.__file__ == numpy.__file__ for module in (fast, slow)):
        raise RuntimeError("nothing compiles")
    return Case(numpy, (numpy, fast, slow), tuple(module_signatures(numpy)))


BATCHES = [(), (), (), (1,), (2,), (9,), (2, 3), (0,), (3, 0), (1, 1, 2)]
# What broadcasts with each of them.
SMALLER = {(2,): (1,), (9,): (), (2, 3): (3,), (1, 1, 2): (2,), (0,): (1,), (3, 0): (3, 1)}


@dataclass
class Argument:
    """An argument: the numbers meant, what is given for them, and whether that is refused."""

    numbers: Array
    given: Any
    refused: bool


def shown(shape: tuple[int, ...], numbers: Array, kind: str) -> tuple[Array, Any]:
    """Numbers of a shape, and the presentation of them that has a name."""
    repeated = np.resize(numbers, shape) if 0 not in shape else np.empty(shape)
    if kind in WHOLE:
        repeated = np.floor(repeated)
        return repeated, WHOLE[kind](repeated.copy())
    if kind in TRUTHS:
        repeated = np.floor(repeated) % 2.0
        return repeated, TRUTHS[kind](repeated.copy())
    if kind == "broadcast":
        row = np.resize(numbers, shape[-1:])
        return np.array(np.broadcast_to(row, shape)), np.broadcast_to(row, shape)
    return repeated, PRESENTATIONS[kind](repeated.copy())


# A list has no place for the number of axes after one that is empty.
NESTED = {"list", "tuple", "list of arrays", "fractions", *(k for k in WHOLE | TRUTHS if "of" in k)}
ACCEPTED = sorted({*PRESENTATIONS, *WHOLE, *TRUTHS, "broadcast"})


@st.composite
def arguments(draw: st.DrawFn, shapes: tuple[tuple[int, ...], ...]) -> list[Argument]:
    """Arguments of a function; in a third of the cases one of them is wrong."""
    batch = draw(st.sampled_from(BATCHES))
    quarters = draw(st.lists(st.integers(0, 40), min_size=5, max_size=11))
    numbers = np.array(quarters) / 4.0
    wrong = draw(st.sampled_from([None, None, *range(len(shapes))]))
    made = []
    for i, own in enumerate(shapes):
        leading = SMALLER.get(batch, batch) if draw(st.booleans()) and i else batch
        shape = (*leading, *own)
        if i == wrong:
            kind = draw(st.sampled_from(sorted(REFUSED) if own else NO_NUMBER))
            plain = np.resize(numbers, shape if 0 not in shape else own)
            made.append(Argument(plain, REFUSED[kind](plain.copy()), True))
            continue
        kind = draw(st.sampled_from(ACCEPTED if shape else ONE_NUMBER))
        if 0 in shape and kind in NESTED:
            kind = "plain"
        values, presented = shown(shape, np.roll(numbers, i), kind)
        if kind in PRESENTATIONS and kind != "fractions" and values.size and draw(st.booleans()):
            special = draw(st.sampled_from([np.nan, np.inf, -np.inf, -0.0, 1024.0, -2.5]))
            values[(..., draw(st.integers(0, own[-1] - 1))) if own else ...] = special
            presented = PRESENTATIONS[kind](values.copy())
        made.append(Argument(values, presented, False))
    return made


def outcome(call: Callable[[], Any]) -> Any:
    """Results of a call as a tuple of arrays, or the error that it raised."""
    try:
        with np.errstate(all="ignore"):
            results = call()
    except (TypeError, ValueError) as error:
        return error
    return results if isinstance(results, tuple) else (results,)


def frozen(value: Any) -> Any:
    """What tells whether an argument was changed."""
    return value.tobytes() if isinstance(value, np.ndarray) else repr(value)


def assert_same(found: Any, expected: Any) -> None:
    """Results that agree, not-a-number at the same places; or the same refusal."""
    if isinstance(expected, Exception):
        assert type(found) is type(expected), (found, expected)
        assert str(found) == str(expected)
        return
    assert not isinstance(found, Exception), found
    for ours, theirs in zip(found, expected, strict=True):
        assert ours.shape == theirs.shape
        assert ours.dtype == np.float64
        assert ours.flags.c_contiguous
        assert ours.flags.writeable
        np.testing.assert_array_equal(np.isfinite(ours), np.isfinite(theirs))
        finite = np.isfinite(theirs)
        size = np.abs(theirs[finite]).max(initial=1.0)
        # Accelerations at a state that was drawn may be those of a matrix near to singular.
        np.testing.assert_allclose(ours[finite], theirs[finite], rtol=0, atol=1e-9 * size)


def check_call(case: Case, signature: Signature, made: list[Argument], data: st.DataObject) -> None:
    """One call through every way, in one form of passing arguments."""
    names = signature.arguments
    refused = [name for name, argument in zip(names, made, strict=True) if argument.refused]
    split = data.draw(st.integers(0, len(names)))
    constants = data.draw(st.sampled_from(CONSTANTS))
    by_name = data.draw(st.booleans()) or split < len(names)
    plain = [argument.numbers for argument in made]
    chosen: dict[str, Any] = {}
    if constants in CONSTANTS_CHANGED:
        numbers = CONSTANTS_CHANGED[constants](np.array(case.numpy.prepare({})))
        chosen = {"tuple": tuple(numbers.tolist()), "bytes": numbers.tobytes()}
    elif constants == "of each":
        # Along an axis before all others.
        axes = max((x.ndim - len(s) for x, s in zip(plain, signature.argument_shapes, strict=True)))
        factors = np.linspace(1.0, 1.5, 3).reshape(3, *(1,) * max(axes, 0), 1)
        each = factors * np.array(case.numpy.prepare({}))
        chosen = {"tuple": tuple(np.moveaxis(each, -1, 0)), "bytes": each}
    expected = outcome(
        lambda: getattr(case.numpy, signature.name)(*plain, constants=chosen.get("tuple"))
    )
    assert refused or not isinstance(expected, Exception)
    before = [frozen(argument.given) for argument in made]
    found = []
    for module in case.ways:
        positional: list[Any] = [argument.given for argument in made[:split]]
        named = {n: a.given for n, a in zip(names[split:], made[split:], strict=True)}
        if constants != "left out":
            own = module.prepare({})
            value = chosen.get(type(own).__name__)
            if constants in CONSTANTS_REFUSED:
                value = CONSTANTS_REFUSED[constants](own)
            if by_name:
                named["constants"] = value
            else:
                positional.append(value)
        function = getattr(module, signature.name)
        found.append(outcome(lambda f=function, p=positional, n=named: f(*p, **n)))  # type: ignore[misc]
        if "generator" in str(before):  # It is used up by the first call.
            break
    assert [frozen(argument.given) for argument in made] == before
    if constants in CONSTANTS_REFUSED or refused:
        for error in found:
            assert isinstance(error, TypeError | ValueError)
            assert "constants must be" in str(error) or any(
                str(error).startswith(f"{name} must") for name in refused
            ), error
        if not refused or constants not in CONSTANTS_REFUSED:
            assert len({(type(error), str(error)) for error in found}) == 1, found
        return
    for results in found:
        assert_same(results, expected)


WRONG_FORMS: list[Callable[[Callable[..., Any], list[Any]], Any]] = [
    lambda f, a: f(*a[:-1]),
    lambda f, a: f(*a, None, None),
    lambda f, a: f(*a, constant=None),
    lambda f, a: f(*a, None, constants=None),
    lambda f, a: f(*a, **{"q": a[0]}),
    lambda f, a: f(*a, **{"": None}),
    lambda f, a: f(*a, **{"constants\0": None}),
    lambda f, a: f(*a, None, **{"ü": None}),
    lambda f, a: f(constants=None),
]


def main(folder: str, number: int, examples: int) -> None:
    """Try so many calls from a seed."""
    module = case(folder)

    @seed(number)
    @settings(
        max_examples=examples,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def call(data: st.DataObject) -> None:
        signature = data.draw(st.sampled_from(module.functions))
        made = data.draw(arguments(signature.argument_shapes))
        check_call(module, signature, made, data)
        if made and data.draw(st.integers(0, 9)) == 0:
            form = data.draw(st.sampled_from(WRONG_FORMS))
            given = [argument.numbers for argument in made]
            for way in module.ways:
                error = outcome(lambda w=way: form(getattr(w, signature.name), given))  # type: ignore[misc]
                assert isinstance(error, TypeError), error
                assert str(error).startswith(f"{signature.name}()")
                assert "argument" in str(error)

    call()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
