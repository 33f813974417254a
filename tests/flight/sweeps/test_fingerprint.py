"""Digests that are the same in every process, and others where anything is another."""

from __future__ import annotations

import enum
import functools
import math
import os
import subprocess
import sys
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

from gibbs_codegen import UsageError, read_scenario
from gibbs_codegen.flight.sweeps.fingerprint import fingerprint

SCRIPT = """
import abc, collections, enum, functools, math
from dataclasses import dataclass, field
import numpy as np
from gibbs_codegen import read_scenario
from gibbs_codegen.flight.sweeps.fingerprint import fingerprint

scale = 3.0
def helper(flight): return scale * np.max(flight.x) in {"a", "b", "c"}
def again(n): return again(n - 1) if n else 0
class Measure:
    order, kinds = ("x", "y"), frozenset({"x", "y", "z"})
    def __init__(self): self.names = {"x", "y", "z"}
    def __call__(self, flight): return helper(flight)
    @functools.cached_property
    def once(self): return 3
class Side(enum.Enum):
    LEFT, RIGHT = "left", "right"
@dataclass
class Limits(abc.ABC):
    upper: float = 1.0
    sides: list = field(default_factory=lambda: [Side.LEFT])
    def __call__(self, flight): return super().__class__ and self.upper
def inner():
    def recursive(n): return recursive(n - 1) if n else {"a", "b"}
    return recursive
functions = [lambda f: helper(f), again, Measure(), functools.partial(helper, 2), math.sin, np.mean]
functions += [Limits(), Limits().__call__, Side.RIGHT, inner(), Measure, collections.Counter("ab")]
import of_user
functions += [of_user.measure]
print(fingerprint(functions, np.arange(3.0), read_scenario("paper"), {"a": [1, 2.0, None, True]}))
"""
OF_USER = """
units = ("m s", "m s", "length of arm")
def measure(flight): return {"m s": 1.0, "length of arm": 2.0}[units[0]]
"""
limit = 2.0


def over(flight):
    return flight.x > limit


@pytest.mark.slow
def test_it_is_the_same_in_every_process(tmp_path):
    found = set()
    (tmp_path / "of_user.py").write_text(OF_USER)
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
    for name, seed in (("one.py", "1"), ("two.py", "2")):  # The second reads byte code of a file.
        (tmp_path / name).write_text(f"# Comment of {name}\n" * int(seed) + SCRIPT)
        environment["PYTHONHASHSEED"] = seed
        words = [sys.executable, tmp_path / name]
        found.add(subprocess.run(words, env=environment, capture_output=True, check=True).stdout)
    assert len(found) == 1
    assert len(found.pop().strip()) == 64


def closed_over(value):
    return lambda flight: flight.x > value


class Unit(enum.Enum):
    """A unit that a measure may be in."""

    METRE = 1.0
    FOOT = 0.3048


def of_class(value=None, limit=0):
    class Measure:
        attribute = value

        def __call__(self, flight, factor=limit):
            return factor * flight.x[self.attribute]

    return Measure


def named_like_another(factor):
    return functools.wraps(np.max)(lambda flight: factor * flight.x)


class Wrapping:
    """A measure around another, with something of its own."""

    def __init__(self, factor):
        functools.update_wrapper(self, over)
        self.factor = factor


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1, 1.0),
        (0.1, math.nextafter(0.1, 1.0)),
        ("1", 1),
        ([1, [2]], [[1], 2]),
        ({"a": 1}, {"b": 1}),
        (np.zeros(3), np.zeros((3, 1))),
        (lambda f: f.x + 1, lambda f: f.x + 2),
        (lambda f: f.x, lambda f: f.y),
        (lambda f: f.x.max(), lambda f: f.x.min()),
        (closed_over(1.0), closed_over(2.0)),
        (of_class((1, 2)), of_class((1, 3))),
        (of_class([1, 2]), of_class([2, 1])),
        (of_class({"a": 1}), of_class({"a": 2})),
        (of_class(np.zeros(2)), of_class(np.array([0.0, -0.0]))),
        (of_class(Unit.METRE), of_class(Unit.FOOT)),
        (of_class(limit=2)().__call__, of_class(limit=3)().__call__),
        (math.sin, math.cos),
        (np.max, np.min),
        (functools.partial(max, 1), functools.partial(max, 2)),
        (named_like_another(1), named_like_another(2)),
        (Wrapping(1), Wrapping(2)),
        [functools.update_wrapper(functools.partial(over, k), over) for k in (1, 2)],
        (lambda *v: v, lambda v: v),
        (lambda v, w: v, lambda v, *, w: v),
        (read_scenario("hover"), replace(read_scenario("hover"), duration=4.9)),
    ],
)
def test_what_differs_has_another(one, other):
    assert fingerprint(one) == fingerprint(one)
    assert fingerprint(one) != fingerprint(other)


def test_globals_that_a_function_uses_count(monkeypatch):
    before = fingerprint(over)
    monkeypatch.setitem(over.__globals__, "limit", 3.0)
    assert fingerprint(over) != before


def test_what_nothing_tells_is_refused():
    with pytest.raises(UsageError, match="cannot recognise this value"):
        fingerprint(each for each in range(3))


def test_what_holds_itself_is_refused_in_words():
    own = []
    own.append(own)
    with pytest.raises(UsageError, match=r"cannot recognise this value \(it holds itself\)"):
        fingerprint(own)


def test_equal_arrays_count_alike_whether_or_not_they_are_one():
    array = np.arange(3.0)
    assert fingerprint([array, array]) == fingerprint([array, array.copy()])


HELPERS = """
import dataclasses, functools
def h(x): return {0} * x
@functools.lru_cache
def cached(x): return {0} * x
@dataclasses.dataclass(frozen=True)
class Called:
    n: int
    def __call__(self, flight): return {0} * flight.q[self.n]
class Plain:
    def at(self, flight): return {0} * flight.q
plain = Plain()
"""


def of_module(name, factor, make):
    module = ModuleType(name)
    module.__file__ = f"{name}.py"
    sys.modules[name] = module
    exec(HELPERS.format(factor), vars(module))  # noqa: S102  # Shorter than files.
    return fingerprint(make(module))


def imported_within(module):
    def measure(flight):
        import helpers_of_a_user

        return helpers_of_a_user.h(flight.q)

    return measure


@pytest.mark.parametrize(
    "make",
    [
        lambda module: lambda flight: module.h(flight.q),
        lambda module: (lambda h: lambda flight: h(flight.q))(module.h),
        lambda module: module.cached,
        lambda module: module.Called(1),
        lambda module: module.plain.at,
        lambda module: lambda flight: module.plain.at(flight),
        imported_within,
    ],
)
def test_code_of_other_modules_of_the_user_counts(make, monkeypatch):
    name = "helpers_of_a_user"
    monkeypatch.setitem(sys.modules, name, None)
    assert of_module(name, 2, make) == of_module(name, 2, make)
    assert of_module(name, 2, make) != of_module(name, 3, make)


def test_a_module_of_the_user_may_be_named_like_one_of_pythons(monkeypatch):
    monkeypatch.setitem(sys.modules, "trace", None)
    found = {of_module("trace", factor, lambda module: module.h) for factor in (2, 3)}
    assert len(found) == 2


def test_what_is_imported_within_a_function_and_is_not_there_is_refused():
    def measure(flight):
        from no_such_helpers import h

        return h(flight)

    with pytest.raises(UsageError, match=r"the module no_such_helpers, which .*at the top"):
        fingerprint(measure)
