"""Arrays in C: as parameters and arguments, as local ones, and their entries.

The entries of an array are `stride` reals apart: 1 for one state, LANES for a block of states.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def load(name: str, array: str, place: int | str, sign: str = "") -> str:
    """A line with a local constant that is an entry of an array.

    `place` is a number, or what `place_in_loop` returns; `sign` is "-" where the array has minus
    the constant.
    """
    return f"const real {name} = {sign}{array}[{place} * stride];"


def spill(array: str, place: int | str, name: str, sign: str = "") -> str:
    """A line that assigns a local constant to an entry, from which `load` reads it.

    `sign` is "-" where minus the constant is stored.
    """
    return f"{array}[{place} * stride] = {sign}{name};"


def place_in_loop(first: int, step: int = 0) -> str:
    """Number of an entry in round `i` of a loop, in parentheses, moving by `step` or one."""
    return f"({first} + {step} * i)" if step else f"({first} + i)"


def array_size(entries: int | str, lanes: bool) -> str:
    """Reals in an array, by the entries of one state: a number, or an expression that is a factor.

    With `lanes` it holds a block of states.
    """
    return f"{entries} * LANES" if lanes else str(entries)


def local_arrays(names: Sequence[str], size: str) -> str:
    """A declaration of local arrays, all of one size, as `array_size` returns it."""
    return f"real {', '.join(f'{name}[{size}]' for name in names)};"


def from_entry(array: str, entry: int) -> str:
    """An array without its first `entry` entries, as an argument of a call for one state."""
    return f"{array} + {entry}"


def from_block(array: str, width: int, block: str) -> str:
    """An array without its first blocks of states, as many as the variable `block` says.

    `width` is the number of entries of one state.
    """
    return f"{array} + {block} * ({width} * LANES)"


def read_arrays(
    names: Iterable[str], real: str = "real", qualifier: str = "RESTRICT "
) -> list[str]:
    """Declarations of parameters that are arrays from which a function reads."""
    return [f"const {parameter}" for parameter in written_arrays(names, real, qualifier)]


def written_arrays(
    names: Iterable[str], real: str = "real", qualifier: str = "RESTRICT "
) -> list[str]:
    """Declarations of parameters that are arrays to which a function writes."""
    return [f"{real} *{qualifier}{name}" for name in names]
