"""The errors that users meet: each says what is wrong, where, and what would be right."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from importlib import import_module
from typing import NamedTuple

# More than a person will read at a time.
_SHOWN = 50
_MOTIONS = 4
_LONGEST = 160
# Digits of a number that a person writes, with its sign and point.
_LONGEST_NUMBER = 17


def printable(text: object, most: int = _LONGEST) -> str:
    """A text from outside, such as a path, on one line that is safe in a message.

    It is abbreviated in its middle to `most` characters; control characters are escapes.
    """
    escaped = "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in str(text)
    )
    if len(escaped) <= most:
        return escaped
    end = (most - 3) // 2  # A path tells most at its end, where its name is.
    return f"{escaped[: most - 3 - end]}...{escaped[-end:]}"


def written(value: object, most: int = 60) -> str:
    """A value as a person writes it, of a number without the digits that rounding makes."""
    if isinstance(value, float):  # NumPy's are such, too.
        exact = repr(float(value))
        return exact if len(exact) <= _LONGEST_NUMBER else f"{value:.15g}"
    return printable(repr(value), most)


def near(name: str, names: Iterable[str]) -> str:
    """A hint at the known name that may have been meant, empty if none is near."""
    close = get_close_matches(name[:80], list(names)[:2000], n=1)
    return f"; did you mean {printable(close[0], 60)}?" if close else ""


def no_attribute(module: str, name: str, names: Iterable[str]) -> str:
    """The words for an attribute that a module lacks, with that which may be meant."""
    # Names of constants are asked for to learn whether they are there.
    hint = near(name, names) if name.islower() and name[0] != "_" else ""
    return f"module {module!r} has no attribute {name!r}{hint}"


def cause_of(error: OSError) -> str:
    """Why the system refused something; not every error has the system's own words."""
    return error.strerror or printable(error)


class GibbsCodegenError(Exception):
    """Base of every error that this package raises on purpose.

    `exit_code` is what the command line returns for it: 2 for wrong usage or a rejected file, 1
    for work that was accepted and then failed.
    """

    exit_code = 2


class Fault(NamedTuple):
    """One thing wrong with a file, and what would be right.

    `path` is that of the key, which counts as Python does: `link[0].mass`. The text of the fault
    counts from 1, as PARAMETERS and the comments of robot files do: `link 1: mass`. `line` is that
    of the file, if it is known.
    """

    path: str
    message: str
    line: int | None = None

    def text(self, source: str) -> str:
        """The fault in one line, `source:line: key: message`, of a file."""
        place = source if self.line is None else f"{source}:{self.line}"

        def number(match: re.Match[str]) -> str:
            # Text in quotes is a key of the file as it is.
            if match[1] is None:
                return match[0]
            return f" {int(match[1]) + 1}" + (": " if match[2] else "")

        path = re.sub(r"""\[(\d+)\](\.)?|['"].*""", number, self.path)
        where = f"{place}: {path}" if self.path else place
        return f"{where}: {self.message}"


class RefusedFileError(GibbsCodegenError):
    """A file that is rejected.

    Attributes:
        kind: what kind of file it is.
        source: its name.
        faults: every reason, in the order of the file.
    """

    kind = "file"

    def __init__(self, source: str, faults: Sequence[Fault]) -> None:
        self.source = source
        self.faults = tuple(faults)
        shown = printable(source)
        lines = [fault.text(shown) for fault in self.faults[:_SHOWN]]
        if len(self.faults) > _SHOWN:
            lines.append(f"{shown}: and {len(self.faults) - _SHOWN} more")
        super().__init__("\n".join(lines))


class RobotFileError(RefusedFileError):
    """A robot file that is rejected."""

    kind = "robot file"


class ScenarioFileError(RefusedFileError):
    """A scenario that is rejected."""

    kind = "scenario"


class SingularRobotError(GibbsCodegenError):
    """A robot whose mass matrix is singular, or too ill-conditioned, at every configuration.

    Attributes:
        robot: the robot's name.
        motions: the coordinates of each massless degree of freedom: one, or several that move
            together.
        ill_conditioned: whether these degrees of freedom have inertia, but so little beside the
            rest that rounding hides it.
    """

    def __init__(
        self, robot: str, motions: Sequence[tuple[str, ...]], ill_conditioned: bool = False
    ) -> None:
        self.robot = robot
        self.motions = tuple(motions)
        self.ill_conditioned = ill_conditioned
        listed = [
            f"{', '.join(others)} and {last} moving together" if others else last
            for *others, last in self.motions[:_MOTIONS]
        ]
        if len(self.motions) > _MOTIONS:
            listed.append(f"and {len(self.motions) - _MOTIONS} more")
        moving = "; ".join(listed)
        if ill_conditioned:
            super().__init__(
                f"{robot}: the mass matrix is ill-conditioned: the inertia that {moving} moves is "
                "lost in the rounding of the rest, so its acceleration is not determined; give "
                "what it moves more mass or inertia, or the rest less"
            )
            return
        noun = "degree" if len(self.motions) == 1 else "degrees"
        advice = "give what it moves mass, or inertia about its axis"
        if any(len(motion) > 1 for motion in self.motions):
            advice += "; where coordinates move together, give it to what lies between them"
        super().__init__(
            f"{robot}: massless {noun} of freedom, whose acceleration is not determined: "
            f"{moving}; {advice}"
        )

    @property
    def joints(self) -> tuple[str, ...]:
        """Every coordinate of these degrees of freedom, once."""
        return tuple(dict.fromkeys(name for motion in self.motions for name in motion))


class UsageError(GibbsCodegenError):
    """A request that cannot be met as it was put: an unknown name, target or folder."""


def check_all(checks: Iterable[Callable[[], object]]) -> None:
    """Run checks, and raise what the only one raises that fails, or all of their messages."""
    faults = dict[str, UsageError]()
    for check in checks:
        try:
            check()
        except UsageError as fault:
            faults[str(fault)] = fault
    if len(faults) > 1:
        raise UsageError("\n".join(faults))
    if faults:
        raise next(iter(faults.values()))


def require(library: str, for_what: str, extra: str = "") -> None:
    """Raise `UsageError` if a package is missing that `extra`, or the extra of its name, installs.

    `for_what` needs it.
    """
    try:
        import_module(library)
    except ModuleNotFoundError as error:
        if error.name != library:
            raise
        raise UsageError(
            f"{for_what}: the package {library} is not installed; "
            f"install {library}, or gibbs_codegen with its extra {extra or library}"
        ) from None


class MissingFunctionError(UsageError, AttributeError):
    """A module lacks a function, since it was generated without it.

    Args:
        module: Name of the module.
        missing: Names of what it lacks.
        options: Words of the options "functions" and "derivatives" with which it is there, and what
            the module has already.
    """

    def __init__(
        self, module: str, missing: Sequence[str], options: Mapping[str, Sequence[str]]
    ) -> None:
        flags = " ".join(f"--{option}={','.join(words)}" for option, words in options.items())
        listed = {option: ", ".join(f'"{x}"' for x in words) for option, words in options.items()}
        python = ", ".join(f"{option}=[{words}]" for option, words in listed.items())
        lacks = ", ".join([*missing[:3], *([f"{len(missing) - 3} more"] if missing[3:] else [])])
        super().__init__(
            f"{module}: has no {lacks}, which a module has on request only; run gibbs-codegen "
            f"generate {module} {flags}, or give {python} in Python"
        )


class WrongModuleError(GibbsCodegenError):
    """Emitted functions that fail their checks; `failures` names the checks."""

    exit_code = 1

    def __init__(self, robot: str, failures: Sequence[str], count: int) -> None:
        self.failures = tuple(failures)
        shown = "; ".join(printable(failure) for failure in self.failures[:3])
        more = f"; and {len(self.failures) - 3} more" if len(self.failures) > 3 else ""
        super().__init__(
            f"{robot}: the emitted functions fail {len(self.failures)} of {count} checks, so "
            f"nothing was written: {shown}{more}. Please report this with the robot file; "
            "--no-verify (verify=False in Python) writes the module anyway"
        )


class OutputError(GibbsCodegenError):
    """Output that could not be written: a full disk, a folder without permission."""

    exit_code = 1
