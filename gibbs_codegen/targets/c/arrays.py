"""Arrays in C: as parameters and arguments, as local ones, and their entries.

The entries of an array are `stride` reals apart: 1 for one state, LANES for a block of states.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def load(name: str, array: str, place: int | str, sign: str = "") -> str:
    """A local constant that is an entry of an array.

    Args:
        name: Of the constant.
        array: Name of the array.
        place: Number of the entry, or what `place_in_loop` returns.
        sign: "-" where the array has minus the constant.

    Returns:
        A line.
    """
    return f"const real {name} = {sign}{array}[{place} * stride];"


def spill(array: str, place: int | str, name: str, sign: str = "") -> str:
    """An assignment of a local constant to an entry of an array, from which `load` reads it.

    Args:
        array: Name of the array.
        place: Number of the entry, or what `place_in_loop` returns.
        name: Of the constant.
        sign: "-" where minus the constant is stored.

    Returns:
        A line.
    """
    return f"{array}[{place} * stride] = {sign}{name};"


def place_in_loop(first: int, step: int = 0) -> str:
    """Number of an entry in round `i` of a loop.

    Args:
        first: The number in round 0.
        step: How far it moves in a round; without it by one.

    Returns:
        An expression in parentheses.
    """
    return f"({first} + {step} * i)" if step else f"({first} + i)"


def array_size(entries: int | str, lanes: bool) -> str:
    """Reals in an array.

    Args:
        entries: Of one state: a number, or an expression that is a factor.
        lanes: Whether it holds a block of states.

    Returns:
        An expression.
    """
    return f"{entries} * LANES" if lanes else str(entries)


def local_arrays(names: Sequence[str], size: str) -> str:
    """A declaration of local arrays.

    Args:
        names: Of the arrays.
        size: What `array_size` returns, the same for all.

    Returns:
        A line.
    """
    return f"real {', '.join(f'{name}[{size}]' for name in names)};"


def from_entry(array: str, entry: int) -> str:
    """An array without its first entries, as an argument of a call for one state.

    Args:
        array: Name of the array.
        entry: How many entries are left out.

    Returns:
        An expression.
    """
    return f"{array} + {entry}"


def from_block(array: str, width: int, block: str) -> str:
    """An array without its first blocks of states, as an argument of a call.

    Args:
        array: Name of the array.
        width: Entries of one state.
        block: The variable that says how many blocks are left out.

    Returns:
        An expression.
    """
    return f"{array} + {block} * ({width} * LANES)"


def read_arrays(
    names: Iterable[str], real: str = "real", qualifier: str = "RESTRICT "
) -> list[str]:
    """Parameters that are arrays from which a function reads.

    Args:
        names: Of the parameters.
        real: The type of an entry.
        qualifier: What stands before a name.

    Returns:
        A declaration each.
    """
    return [f"const {parameter}" for parameter in written_arrays(names, real, qualifier)]


def written_arrays(
    names: Iterable[str], real: str = "real", qualifier: str = "RESTRICT "
) -> list[str]:
    """Parameters that are arrays to which a function writes.

    Args:
        names: Of the parameters.
        real: The type of an entry.
        qualifier: What stands before a name.

    Returns:
        A declaration each.
    """
    return [f"{real} *{qualifier}{name}" for name in names]
