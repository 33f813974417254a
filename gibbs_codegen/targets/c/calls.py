"""Array programs beside the C of a module: the functions of a model that they call."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from gibbs_codegen.arrays.contents import functions_of
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import FUNCTIONS, default_functions
from gibbs_codegen.program.model import Model


def model_functions(model: Model) -> Functions:
    """The functions of a model, and those that are there by default."""
    names = tuple(dict.fromkeys((*model.functions, *default_functions())))
    return Functions(replace(model, functions=names).listing)


def check_calls(model: Model, programs: Iterable[Program], subject: str) -> None:
    """Raise `UsageError` about `subject` if programs call functions that a model has not."""
    called = {name for program in programs for _, name in functions_of(program)}
    if missing := [name for name in FUNCTIONS if name in called - {*model.functions}]:
        them = "them" if missing[1:] else "it"
        raise UsageError(f"{subject} {', '.join(missing)}: add {them} to --functions")
