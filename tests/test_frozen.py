"""Frozen dataclasses of the package behave as those of the standard library."""

from __future__ import annotations

import copy
from dataclasses import FrozenInstanceError, asdict, dataclass, field, replace
from inspect import signature
from typing import Any

import pytest

from gibbs_codegen.frozen import frozen


class _Part:
    name: str

    def __post_init__(self) -> None:
        if not self.name:
            raise ValueError("no name")


@frozen
class Part(_Part):
    """As `OfLibrary`."""

    name: str
    self_inertia: tuple[float, ...] = (1.0, 2.0)
    words: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class OfLibrary(_Part):
    """As `Part`."""

    name: str
    self_inertia: tuple[float, ...] = (1.0, 2.0)
    words: dict[str, str] = field(default_factory=dict)


@frozen
class Longer(Part):
    """With a field more."""

    length: float = 3.0


@frozen
class Nothing:
    """Without fields."""


@pytest.mark.parametrize("made", [Part, OfLibrary])
def test_behaves_as_the_librarys(made: Any) -> None:
    """Construction, comparison, hashing, text, copies and refusals are those of the library."""
    part = made("arm")
    assert part == made(name="arm", words={}) != made("leg")
    assert part.words is not made("arm").words
    assert asdict(part) == {"name": "arm", "self_inertia": (1.0, 2.0), "words": {}}
    assert repr(part) == f"{made.__name__}(name='arm', self_inertia=(1.0, 2.0), words={{}})"
    assert replace(part, self_inertia=()) == made("arm", ())
    assert copy.deepcopy(part) == part is not copy.copy(part)
    assert [*signature(made).parameters] == ["name", "self_inertia", "words"]
    assert made.__match_args__ == ("name", "self_inertia", "words")
    with pytest.raises(TypeError, match="unhashable"):
        hash(part)
    with pytest.raises(TypeError, match=r"__init__\(\) missing 1 required"):
        made()
    with pytest.raises(ValueError, match="no name"):
        made("")
    with pytest.raises(FrozenInstanceError):
        part.name = "leg"
    with pytest.raises(FrozenInstanceError):
        del part.name


def test_compares_by_class_and_fields() -> None:
    """Equal fields of one class are equal and hash alike; other classes are not."""
    assert Part("arm") != OfLibrary("arm")
    assert Longer("arm") == Longer("arm", length=3.0) != Part("arm")
    assert Nothing() == Nothing() != Part("arm")
    assert hash(Nothing()) == hash(Nothing())
    assert hash(Part("arm", words=())) == hash(Part("arm", words=()))  # type: ignore[arg-type]
