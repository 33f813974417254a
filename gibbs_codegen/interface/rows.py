"""Parts of a row of the table of emitted functions: arguments, and outputs with shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

# What a row may give of the function whose derivative it is: a matrix by each argument, a product
# with a direction, a gradient of the results times weights, second derivatives of these, or what
# the parameters change.
Kind = Literal["", "jacobian", "jvp", "vjp", "hessian", "parameters"]
# Units of accelerations, and of entries of a mass matrix.
ACCELERATIONS = "rad/s^2 or m/s^2"
INERTIAS = "[kg m^2] between angles, [kg] between lengths, [kg m] between both"
# Entries of an input matrix, of wrenches through joints, and of accelerations of frames.
LEVERS = "[N/N], [N m/N] and [N m/(N m)], by row and column"
LOADS = "[N] in the first three, [N m] in the others, a row for each of {bodies}"
MOTIONS = "[m/s^2] in the first three, [rad/s^2] in the others"


@dataclass(frozen=True)
class Argument:
    """An argument and its shape, in the letters of the table.

    Of one axis, an entry is named `prefix` and its name in the list that the letter stands for. Its
    unit is `unit`, where {unit} is that of the list, and {step} the same times a second. With a
    quaternion velocities are no rates of coordinates, and the meaning is `with_quaternion`, where
    that says something else.
    """

    shape: str
    meaning: str
    prefix: str = ""
    with_quaternion: str = ""
    unit: str = "{unit}"

    @property
    def is_coordinates(self) -> bool:
        """True if its entries are coordinates, a quaternion among them where there is one."""
        return self.shape == "q"


@dataclass(frozen=True)
class Output:
    """An array that a function returns: its name, its shape, and the unit of its entries.

    `entries` says what the entries are; `targets.documentation` puts a robot's lists in place of
    names in braces. `derivation` is the name under which `derivation.functions` has what derives
    it, where that is not the name of the row. Of derivatives, `by` is the argument by which they
    are.
    """

    name: str
    shape: str
    unit: str
    entries: str = "[{unit}]"
    derivation: str = ""
    by: str = ""

    @property
    def is_coordinates(self) -> bool:
        """True if it is a configuration, a quaternion of unit length in it where there is one."""
        return self.entries == "{coordinates}"

    def sizes(self, lengths: Mapping[str, int]) -> tuple[int, ...]:
        """The shape in numbers, given the length that each letter stands for."""
        return sizes(self.shape, lengths)


def sizes(shape: str, lengths: Mapping[str, int]) -> tuple[int, ...]:
    """A shape of letters and digits, one for each axis, in numbers."""
    return tuple(int(x) if x.isdigit() else lengths[x] for x in shape)


@dataclass(frozen=True)
class Row:
    """A row of the table; `source` is the equation that the function implements.

    In `details`, {singularity} stands for what is to be said of the attitude. Only robots whose
    module lists something under each name of `needs`, or has the frame of that name, have the
    function. A module has one that is generated `on_request` only where it was asked for; one that
    `is_long`, whose text grows with the cube of the number of joints, only where it was asked for
    by name. One that is `composed` has no derivation: it calls the functions named there so many
    times. `derivative_of` is the function of which it gives
    derivatives, of some `kind`. `parts` are functions that return one of its outputs each, by its
    own text. Functions of a `group` can be asked for by its name; those that are not on request are
    compiled together.
    """

    name: str
    arguments: Sequence[str]
    outputs: tuple[Output, ...]
    summary: str
    source: str
    details: str = ""
    needs: tuple[str, ...] = ()
    on_request: bool = False
    is_long: bool = False
    composed: Mapping[str, int] = field(default_factory=dict)
    derivative_of: str = ""
    kind: Kind = ""
    parts: tuple[str, ...] = ()
    group: str = ""

    @property
    def derivations(self) -> tuple[str, ...]:
        """For each output the name of what derives it; composed functions have none."""
        return () if self.composed else tuple(o.derivation or self.name for o in self.outputs)


def of_group(group: str, *rows: Row) -> tuple[Row, ...]:
    """Rows of functions of a group, but for those that have one."""
    return tuple(replace(row, group=row.group or group) for row in rows)


def on_request(group: str, *rows: Row, needs: tuple[str, ...] = ()) -> tuple[Row, ...]:
    """Rows of a group of functions that are generated on request only."""
    changes: dict[str, Any] = {"needs": needs} if needs else {}
    return tuple(replace(row, group=group, on_request=True, **changes) for row in rows)


# Shapes of what a derivative by an argument has for each entry, where that is not "v", and words.
COLUMNS = {"u": "u", "x": "z", "command": "m", "W": "f6"}
_BY = {
    "q": "a displacement along each of VELOCITIES",
    "v": "each of VELOCITIES",
    "u": "each of INPUTS",
    "x": "each of ACTUATOR_STATES",
    "command": "each of COMMANDS",
}
# Names of the functions that give derivatives, after those of the functions that these are of.
_ENDINGS = {"jacobian": "derivatives"}


def derivative(
    row: Row, kind: Kind, outputs: tuple[Output, ...], summary: str, **others: Any
) -> Row:
    """A row that gives derivatives of the function of another, with `others` of its entries."""
    # What is solved first is differentiated then.
    then = " and" if "solved" in row.source else ","
    slope = Row(
        f"{row.name}_{_ENDINGS.get(kind, kind)}",
        *(row.arguments, outputs, summary, f"{row.source}{then} differentiated"),
        needs=row.needs,
        derivative_of=row.name,
        kind=kind,
    )
    return replace(slope, **others)


def jacobian_row(row: Row) -> Row:
    """The derivatives of what a function returns by its arguments, each after what it returns."""
    by, outputs = [argument for argument in row.arguments if argument in _BY], []
    for output in row.outputs:
        derivation = output.derivation or row.name
        outputs.append(replace(output, derivation=derivation))
        for x in by:
            shape, words = output.shape + COLUMNS.get(x, "v"), f"[{{unit}}], by {_BY[x]}"
            name = f"{output.name}_d{x}"
            outputs.append(Output(name, shape, output.unit, words, f"{derivation}_d{x}", x))
    summary = f"Results of {row.name}, and their derivatives by {', '.join(by)}."
    return derivative(row, "jacobian", tuple(outputs), summary)
