"""Names that MATLAB and GNU Octave take: of the package, of variables and of fields of structs."""

from __future__ import annotations

import re

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS
from gibbs_codegen.program.model import Model

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
    all any atan circshift cos double error eye fieldnames full isequal isfield isfinite islogical
    isnumeric isreal isscalar isstruct narginchk nargin numel ones prod repmat reshape sin size
    sprintf sqrt strcmp struct zeros ans disp e eps false help i inf j load nan norm ode45 pi plot
    save test true
"""
TAKEN = {*re.findall(r"\w+", _KEYWORDS + _FUNCTIONS)}
# What functions call their own variables, beside arguments and outputs.
_OWN = {"constants", "count", "values"}


def variable(name: str) -> str:
    """A name as a variable or field, with an x before the _ that no name in MATLAB begins with."""
    return f"x{name}" if name.startswith("_") else name


def check_names(model: Model) -> None:
    """Raise `UsageError` where names of a robot cannot be told apart in MATLAB.

    A name is too long, is taken, or would be that of something else.
    """
    package = model.robot.name
    program = model.program
    given = {*model.defaults, *(name for names in program.inputs.values() for name in names)}
    outputs = {output.name for row in FUNCTIONS.values() for output in row.outputs}
    computed = {s.name for f in program.functions for s in f.statements}
    computed |= {statement.name for statement in program.prepare}
    variables = {*map(variable, given), *computed, *ARGUMENTS, *outputs, *_OWN}
    if package in TAKEN:
        raise _refusal(f"the robot's name {package} is a word or a function of MATLAB or Octave")
    if package in variables:
        raise _refusal(f"the robot's name {package} is that of a variable in its functions")
    for name in (package, *sorted(given)):
        if len(variable(name)) > LONGEST:
            raise _refusal(f"{printable(name)} has more than {LONGEST} characters")
    for name in sorted(given):
        if variable(name) != name and variable(name) in given:
            raise _refusal(f"{name} would be {variable(name)}, which is there already")


def _refusal(why: str) -> UsageError:
    return UsageError(f"--target matlab: {why}; give it another name in the robot file")
