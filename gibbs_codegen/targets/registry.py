"""Targets: from a derived model to the text of the files of a generated module.

A target is a printer, a function that prepares what the templates are given, and the templates: one
row of `TARGETS`.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.files.line_breaks import broken
from gibbs_codegen.files.templating import render
from gibbs_codegen.interface import FUNCTIONS, options_for
from gibbs_codegen.machine.first_order import ACTING
from gibbs_codegen.program.choice import Functions, chosen_functions
from gibbs_codegen.program.model import Model
from gibbs_codegen.runtime.rollout_source import TEMPLATES as ROLLOUT_TEMPLATES
from gibbs_codegen.runtime.web import TEMPLATE as WEB_TEMPLATE
from gibbs_codegen.targets import web as web_target
from gibbs_codegen.targets.c import target as c_target
from gibbs_codegen.targets.c.laws import calls, law_files
from gibbs_codegen.targets.cuda import target as cuda_target
from gibbs_codegen.targets.fmu import target as fmu_target
from gibbs_codegen.targets.matlab import target as matlab_target
from gibbs_codegen.targets.matlab.statements import MatlabPrinter
from gibbs_codegen.targets.numpy import target as numpy_target
from gibbs_codegen.targets.printers import Context, CPrinter, InfixPrinter, Lines
from gibbs_codegen.version import HEADER_START, __version__

# Width of a line with the signs of a comment.
_WIDTH = 90
# By template, and by what stands for {part} in the file's name.
Contexts = Mapping[str, Mapping[str, Context]]


def _shared(
    text: Callable[[Model, InfixPrinter, Lines], Context],
) -> Callable[[Model, InfixPrinter, Lines], Contexts]:
    """The context of templates that make one file each, all from the same values."""

    def context(model: Model, printer: InfixPrinter, opening: Lines) -> Contexts:
        values = text(model, printer, opening)
        return defaultdict(lambda: {"": values})

    return context


@dataclass(frozen=True)
class Target:
    """A language to emit: its printer, its templates' context, and a file name per template.

    `context` takes the model, the printer, and the lines that open every file; it returns what the
    template reads by name, for every file. What is not `by_default` is emitted only if it is asked
    for by name. Its files need those of the targets that it `needs`. What is no text comes of
    `archives`, and of what it is made, modules have the functions that it `calls`.
    """

    printer: InfixPrinter
    context: Callable[[Model, InfixPrinter, Lines], Contexts]
    files: Mapping[str, str]
    by_default: bool = True
    needs: tuple[str, ...] = ()
    archives: Callable[[Model, Lines], Mapping[str, bytes]] = lambda model, opening: {}
    calls: tuple[str, ...] = ()


TARGETS: dict[str, Target] = {
    "numpy": Target(
        InfixPrinter(),
        _shared(numpy_target.module_text),
        {"numpy_module.py.jinja": "numpy_module.py", "package_init.py.jinja": "__init__.py"},
    ),
    "c": Target(
        CPrinter(),
        _shared(c_target.module_text),
        {
            **web_target.COMPILED,
            "c_batch.c.jinja": "{name}_batch.c",
            "c_each.c.jinja": "{name}_each.c",
        },
    ),
    "rollout": Target(
        CPrinter(),
        _shared(c_target.rollout_text),
        ROLLOUT_TEMPLATES,
        by_default=False,
        needs=("c",),
    ),
    "cuda": Target(
        CPrinter(),
        _shared(cuda_target.module_text),
        {"cuda_header.cuh.jinja": "{name}.cuh", "cuda_source.cu.jinja": "{name}.cu"},
        by_default=False,
    ),
    "matlab": Target(
        MatlabPrinter(),
        matlab_target.package_text,
        dict.fromkeys(matlab_target.TEMPLATES, "+{name}/{part}.m"),
        by_default=False,
    ),
    "fmu": Target(
        CPrinter(),
        lambda *_: {},
        {},
        by_default=False,
        archives=fmu_target.archives,
        calls=fmu_target.called(),
    ),
    "web": Target(
        CPrinter(),
        web_target.contexts,
        {**web_target.COMPILED, WEB_TEMPLATE: "{name}.mjs"},
        by_default=False,
        archives=web_target.archives,
    ),
}
# What needs no files of its own, and how it comes.
_LOADED = {
    "jax": "load(…, backend='jax')",
    "casadi": "load(…, backend='casadi'), and docs/howto/casadi.md compiles its functions",
    "acados": "acados_model(load(…)), as docs/howto/own-nmpc.md shows",
}
DEFAULT_TARGETS = tuple(name for name, target in TARGETS.items() if target.by_default)


def find_targets(names: Sequence[str] = DEFAULT_TARGETS) -> dict[str, Target]:
    """Rows of `TARGETS` by their names, in that order; without names those by default.

    Raises `UsageError` where a name is unknown, or a target is missing that another needs.
    """
    rows: dict[str, Target] = {}
    for word in names:
        name, colon, acting = word.partition(":")
        if name not in TARGETS:
            message = f"--target {printable(name)}: unknown; known targets: {', '.join(TARGETS)}"
            if name in _LOADED:
                message += f". No target is needed for it: {_LOADED[name]}"
            raise UsageError(message)
        if others := [x for x in rows if x != word and x.partition(":")[0] == name]:
            raise UsageError(
                f"--target {printable(word)}: {others[0]} writes the same files; leave one of "
                "them out"
            )
        rows[word] = _with_acting(word, tuple(acting.split(","))) if colon else TARGETS[name]
    for name, target in rows.items():
        if missing := [needed for needed in target.needs if needed not in rows]:
            raise UsageError(
                f"--target {name}: needs files of the target {missing[0]}; add --target "
                f"{missing[0]}"
            )
    return rows


def _with_acting(name: str, acting: tuple[str, ...]) -> Target:
    """The target of FMUs in which more acts. Raises `UsageError` for what cannot."""
    if not name.startswith("fmu:"):
        raise UsageError(
            f"--target {printable(name)}: only fmu takes a colon with what acts on the robot"
        )
    if unknown := [part for part in acting if part not in ACTING]:
        raise UsageError(
            f"--target {printable(name)}: {printable(unknown[0]) or 'nothing'} cannot act in an "
            f"FMU; after the colon give a list, with commas, of: {', '.join(ACTING)}"
        )
    archives = partial(fmu_target.archives, acting=acting)
    return replace(TARGETS["fmu"], archives=archives, calls=fmu_target.called(acting))


def called(
    targets: Mapping[str, Target], functions: Functions, laws: Sequence[str] = ()
) -> tuple[str, ...]:
    """Functions that a module must have for a choice of a user, and for what is made of them.

    By default there are none where no target has a text of them.
    """
    has_text = any(target.files for target in targets.values())
    chosen = chosen_functions(functions) if has_text or functions is not None else ()
    brought = *(target.calls for target in targets.values()), *(calls()[law] for law in laws)
    return (*chosen, *(name for names in brought for name in names))


def render_module(model: Model, robot_text: str, targets: Mapping[str, Target]) -> dict[str, str]:
    """Texts of a generated module's files by name; the robot file is one of them."""
    files = {"robot.toml": robot_text}
    opening = header(model, robot_text, targets)
    for target in targets.values():
        context = target.context(model, target.printer, opening)
        for template, file_name in target.files.items():
            for part, of_part in context[template].items():
                name = file_name.format(name=model.robot.name, part=part)
                files[name] = render(template, of_part)
    return files | law_files(model, opening)


def render_archives(
    model: Model, robot_text: str, targets: Mapping[str, Target]
) -> dict[str, bytes]:
    """Contents by name of those files of a generated module that are no text."""
    opening = header(model, robot_text, targets)
    files: dict[str, bytes] = {}
    for target in targets.values():
        files |= target.archives(model, opening)
    return files


def header(model: Model, robot_text: str, targets: Mapping[str, Target]) -> list[str]:
    """Lines that open every emitted file: what it is, what it was made from, whose it is.

    They are without the signs of a comment.
    """
    options = generating_options(targets, model)
    command = " ".join(["gibbs-codegen generate THIS_FOLDER/robot.toml --out .", *options])
    return [
        f"{HEADER_START} {__version__}; do not edit.",
        f"Robot: {model.robot.name}",
        f"Robot file SHA-256: {hashlib.sha256(robot_text.encode()).hexdigest()}",
        *broken(f"From the folder above: {command}", _WIDTH),
        "SPDX-License-Identifier: MIT-0 (yours to use, change and pass on without conditions)",
    ]


def generating_options(targets: Mapping[str, Target], model: Model) -> list[str]:
    """Options of `generate` that choose these targets, and a model's parameters and functions.

    Functions that the targets bring are not chosen.
    """
    options = ["--all-parameters"] if model.keeps_zeros else []
    if set(targets) != set(DEFAULT_TARGETS):
        options += [f"--target {name}" for name in targets]
    options += [f"--laws={','.join(model.laws)}"] if model.laws else []
    if model.functions == chosen_functions(called(targets, None, model.laws)):
        return options
    brought = chosen_functions(called(targets, (), model.laws))
    chosen = [x for x in model.functions if x not in brought or not FUNCTIONS[x].on_request]
    return [*options, *options_for(chosen)]
