"""The C source of a module's rollouts, which is made of what the module says of itself.

It is the same for a module that was generated without it, whose rollouts are compiled when one is
first called, and for those who have it generated to compile it themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from gibbs_codegen.files.templating import render
from gibbs_codegen.files.verbatim import c_source

TEMPLATES = {
    "c_rollout.h.jinja": "{name}_rollout.h",
    "c_rollout.c.jinja": "{name}_rollout.c",
}


@dataclass(frozen=True)
class RolloutText:
    """What depends on the robot, and the source that does not.

    `header` are the lines that open every file. `block` comes before the functions that the
    template makes of the robot's, `run` after them.
    """

    header: list[str]
    name: str
    rotors: int
    is_quaternion: bool
    block: str = c_source("rollout/begin.c")
    run: str = c_source("rollout/rollout.c").rstrip()

    @property
    def functions(self) -> tuple[str, ...]:
        """The functions of the module that the source calls."""
        moved = ("integrate", "difference") if self.is_quaternion else ()
        return ("forward_dynamics", "forward_dynamics_with_wrenches", *moved)


def rollout_text(module: ModuleType) -> RolloutText:
    """What the templates are given of a module that is there."""
    opening = (Path(module.__path__[0]) / f"{module.NAME}.h").read_text(encoding="utf-8")
    header = opening.partition("\n\n")[0].splitlines()
    velocities = len(module.VELOCITIES)
    return RolloutText(
        [line.removeprefix("/* ").removesuffix(" */") for line in header],
        module.NAME,
        # A joint that moves has an input, and the base has six velocities.
        len(module.INPUTS) - (velocities - 6),
        len(module.COORDINATES) != velocities,
    )


def rollout_files(text: RolloutText) -> dict[str, str]:
    """Texts of the header and the source by their names."""
    return {
        file.format(name=text.name): render(template, vars(text))
        for template, file in TEMPLATES.items()
    }
