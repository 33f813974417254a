"""The functions that a choice of a user stands for: names, groups, and words."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Sequence
from typing import TypeAlias

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.interface import FUNCTIONS, default_functions, derivatives_among
from gibbs_codegen.interface.choice import DEFAULT, group
from gibbs_codegen.interface.table import DERIVATIVE_GROUPS, GROUPS

# The choice of functions: names and groups, in any order; None for those by default.
Functions: TypeAlias = str | Sequence[str] | None
# The choice of derivatives besides: True for all that are not long, or none of them; one name, or
# several; "all" stands for the long ones too.
Derivatives: TypeAlias = bool | str | Sequence[str]
# Nobody reads suggestions for more unknown names.
_MOST_SUGGESTIONS = 5


def chosen_functions(
    functions: Functions = None, derivatives: Derivatives = False
) -> tuple[str, ...]:
    """All functions that two choices stand for, in the order of the table.

    With a name come those that it is composed of. Raises `UsageError` where a name is unknown, or
    something is no choice.
    """
    if functions is None:
        names = {*default_functions()}
    else:
        groups = (DEFAULT, *GROUPS, *DERIVATIVE_GROUPS)
        listed = _names("functions", functions, [*groups, *FUNCTIONS])
        names = {name for word in listed for name in (group(word) if word in groups else (word,))}
    names |= {*chosen_derivatives(derivatives)}
    names |= {part for name in names for part in FUNCTIONS[name].composed}
    # A derivative is verified by the function whose derivative it is.
    names |= {FUNCTIONS[name].derivative_of for name in names} - {""}
    return tuple(name for name in FUNCTIONS if name in names)


def chosen_derivatives(derivatives: Derivatives) -> tuple[str, ...]:
    """The derivatives that a choice stands for, in the order of the table.

    True stands for all that are not long, "all" for those too. Raises `UsageError` where a name is
    unknown, or it is no choice.
    """
    offered = derivatives_among(FUNCTIONS)
    if isinstance(derivatives, bool):
        return tuple(name for name in offered if derivatives and not FUNCTIONS[name].is_long)
    names = {*_names("derivatives", derivatives, [*offered, "all"])}
    names |= {part for name in names - {"all"} for part in FUNCTIONS[name].composed}
    return tuple(name for name in offered if name in names or "all" in names)


def _names(option: str, words: str | Sequence[str], choices: Sequence[str]) -> Sequence[str]:
    """Words of a choice, all of them known. Raises `UsageError`."""
    listed = [words] if isinstance(words, str) else words
    if not isinstance(listed, Collection) or not all(isinstance(name, str) for name in listed):
        allowed = "True, False, a name" if option == "derivatives" else "None, a name"
        raise UsageError(
            f"{option}: must be {allowed} or a list of names, not {printable(repr(words), 60)}"
        )
    if unknown := sorted({*listed}.difference(choices)):
        few = unknown[:_MOST_SUGGESTIONS]
        near = [difflib.get_close_matches(name[:80], choices, n=1) for name in few]
        complaints = [
            printable(repr(name)) + "".join(f" (did you mean {best}?)" for best in close)
            for name, close in zip(few, near, strict=True)
        ]
        complaints += [f"and {len(unknown) - len(few)} more"] if len(few) < len(unknown) else []
        rest = "" if all(near) else f"; known: {', '.join(choices)}"
        raise UsageError(f"--{option}: unknown: {', '.join(complaints)}{rest}")
    return listed
