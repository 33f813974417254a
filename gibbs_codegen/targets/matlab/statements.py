"""MATLAB and GNU Octave as languages: the names that they take, and statements as lines.

How statements are written and broken is decided here alone.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from gibbs_codegen.arrays.matlab_text import continued
from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.files.line_breaks import INDENT, WIDTH
from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Node, Number, Output
from gibbs_codegen.targets.printers import InfixPrinter, StatementPrinter


class MatlabPrinter(InfixPrinter):
    """Prints nodes entry by entry: a name is a row, with an entry for each state."""

    TIMES = ".*"
    OVER = "./"

    def name(self, name: str) -> str:
        """As in the program, unless MATLAB does not take that."""
        return variable(name)

    def call(self, function: str, argument: str) -> str:
        """A call on a row; zeros have signs, which MATLAB's own sign does not tell."""
        if function == "sign":
            return f"(1.0 - 2.0 .* (1.0 ./ ({argument}) < 0.0))"
        return super().call(function, argument)


class MatlabStatements(StatementPrinter):
    """Prints statements in MATLAB."""

    COMMENT = "% {}"

    def assign(self, name: str, value: Node) -> list[str]:
        """A variable, or entries of one."""
        return continued(f"{name} = {self._expressions.expression(value)};")

    def fill(self, name: str, output: Output) -> list[str]:
        """An output, whose zeros are there before its other entries."""
        lines = ["", f"{name} = zeros({len(output.entries)}, count);"]
        places = column_major(output.shape)
        for place, entry in sorted(zip(places, output.entries, strict=True), key=lambda x: x[0]):
            if entry != Number(0.0):
                lines += self.assign(f"{name}({place}, :)", entry)
        if len(output.shape) > 1:
            sizes = ", ".join(map(str, output.shape))
            lines.append(f"{name} = reshape({name}, {sizes}, count);")
        return lines


def column_major(shape: tuple[int, ...]) -> list[int]:
    """Linear index in MATLAB, from 1, of each entry of an array in C order."""
    size = int(np.prod(shape))
    return (1 + np.arange(size).reshape(shape, order="F")).ravel().tolist()


def load(name: str, array: str, place: int) -> str:
    """A variable that is the row at `place`, from 0, of an array."""
    return f"{variable(name)} = {array}({place + 1}, :);"


def column(texts: Sequence[str]) -> list[str]:
    """Lines between the brackets of a column, or between the braces of a cell column.

    Each expression stays whole, as a line break within a quoted text is an error.
    """
    lines: list[str] = []
    for text in texts:
        if lines and len(f"{lines[-1]}; {text};") <= WIDTH - 2 * INDENT:
            lines[-1] += f"; {text}"
        else:
            lines.append(text)
    return [*(f"{line};" for line in lines[:-1]), *lines[-1:]]


# Characters in a name that MATLAB tells apart.
LONGEST = 63
# Words of both languages.
_KEYWORDS = """
    arguments break case catch classdef continue do else elseif end enumeration events for function
    global if methods otherwise parfor persistent properties return spmd switch try until while
    endif endfor endfunction endwhile endswitch endparfor end_try_catch unwind_protect
    unwind_protect_cleanup end_unwind_protect
"""
# In Octave a package hides the function of its name, in MATLAB the function hides the package.
# These are what the emitted source calls, and what is in every script.
_FUNCTIONS = """
    all any atan cos double error eye fieldnames full isequal isfield isfinite islogical
    isnumeric isreal isscalar isstruct narginchk nargin numel ones prod repmat reshape sin size
    sprintf sqrt strcmp struct zeros ans disp e eps false help i inf j load nan norm ode45 pi plot
    save test true
"""
TAKEN = {*re.findall(r"\w+", _KEYWORDS + _FUNCTIONS)}
# What functions call their own variables, beside arguments and outputs.
_RESERVED = {"constants", "count", "values"}


def variable(name: str) -> str:
    """A name as a variable or field, with an x before the _ that no name in MATLAB begins with."""
    return f"x{name}" if name.startswith("_") else name


def check_names(model: Model) -> None:
    """Raise `UsageError` for names of a robot that MATLAB cannot distinguish.

    A name is too long, is taken, or would be that of something else.
    """
    package = model.robot.name
    program = model.program
    robot_names = {*model.defaults, *(name for names in program.inputs.values() for name in names)}
    outputs = {output.name for row in FUNCTIONS.values() for output in row.outputs}
    computed = {s.name for f in program.functions for s in f.statements}
    computed |= {statement.name for statement in program.prepare}
    variables = {*map(variable, robot_names), *computed, *ARGUMENTS, *outputs, *_RESERVED}
    if package in TAKEN:
        raise _refusal(f"the robot's name {package} is a word or a function of MATLAB or Octave")
    if package in variables:
        raise _refusal(f"the robot's name {package} is that of a variable in its functions")
    # Entries of arguments that no function here has are names of nothing.
    read = {name for f in program.functions for node in f.nodes() for name in node.names}
    longest = max((package, *sorted({*model.defaults, *read})), key=lambda x: len(variable(x)))
    if (length := len(variable(longest))) > LONGEST:
        raise _refusal(
            f"{printable(longest)} has {length} characters, more than the {LONGEST} of MATLAB"
        )
    for name in sorted(robot_names):
        if variable(name) != name and variable(name) in robot_names:
            raise _refusal(f"{name} would be {variable(name)}, which exists already")


def _refusal(why: str) -> UsageError:
    return UsageError(f"--target matlab: {why}; give it another name in the robot file")
