"""The functions of a module: by default, and by the options that choose others."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from gibbs_codegen.interface.table import DERIVATIVE_GROUPS, FUNCTIONS, GROUPS

DEFAULT = "default"


def default_functions() -> tuple[str, ...]:
    """The functions of a module where nothing else is chosen."""
    return tuple(row.name for row in FUNCTIONS.values() if not row.on_request)


def group(name: str) -> tuple[str, ...]:
    """The functions of a group, less the long ones; those by default for that word."""
    if name == DEFAULT:
        return default_functions()
    return tuple(row.name for row in FUNCTIONS.values() if row.group == name and not row.is_long)


def derivatives_among(functions: Iterable[str]) -> tuple[str, ...]:
    """Those of some functions that --derivatives chooses."""
    return tuple(name for name in functions if FUNCTIONS[name].group in DERIVATIVE_GROUPS)


def options_with(names: Iterable[str], functions: Collection[str]) -> dict[str, list[str]]:
    """The words of options that bring functions, and keep others.

    A group stands for most of its functions, so that the words are few.
    """
    chosen = [name for name in dict.fromkeys((*functions, *names)) if name in FUNCTIONS]
    words = {"derivatives": [*derivatives_among(chosen)], "functions": _words(chosen, share=0.5)}
    return {option: listed for option, listed in words.items() if listed not in ([], [DEFAULT])}


def _words(functions: Collection[str], share: float = 1.0) -> list[str]:
    """Groups and names for functions, less the derivatives among them.

    A group stands where more than a share of it is among them, or all.
    """
    derivatives = derivatives_among(functions)
    rest = [name for name in functions if name not in derivatives]
    words = []
    for word in (DEFAULT, *GROUPS):
        # Not every robot has those that need something.
        members = [name for name in group(word) if not FUNCTIONS[name].needs] or group(word)
        count = len({*members} & {*rest})
        if count == len(members) or count > share * len(members):
            words.append(word)
            rest = [name for name in rest if name not in group(word)]
    return words + rest


def options_for(functions: Collection[str]) -> list[str]:
    """The options of the command line that choose exactly these functions, as short as may be."""
    derivatives = derivatives_among(functions)
    words = _words(functions) or [*derivatives]
    options = [] if words == [DEFAULT] else [f"--functions={','.join(words)}"]
    if derivatives and derivatives != tuple(functions):
        derivable = derivatives_among(FUNCTIONS)
        short = tuple(name for name in derivable if not FUNCTIONS[name].is_long)
        listed = {short: "", derivable: "=all"}.get(derivatives, f"={','.join(derivatives)}")
        options.append(f"--derivatives{listed}")
    return options
