"""The target web: functions as WebAssembly, with the C that they are made of, and an ES module."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

from gibbs_codegen.files.line_breaks import WIDTH
from gibbs_codegen.files.templating import render
from gibbs_codegen.interface import FUNCTIONS, Signature
from gibbs_codegen.machine.laws import LAWS
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.description import Description
from gibbs_codegen.runtime.c_library import RUNTIME
from gibbs_codegen.runtime.web import TEMPLATE, assembled, script_context
from gibbs_codegen.targets import documentation
from gibbs_codegen.targets.c import target as c_target
from gibbs_codegen.targets.c.laws import law_files
from gibbs_codegen.targets.printers import Context, CPrinter, InfixPrinter, Lines

COMPILED = {
    "c_runtime.h.jinja": RUNTIME,
    "c_header.h.jinja": "{name}.h",
    "c_source.c.jinja": "{name}.c",
}
_ABOUT = """\
Emitted functions of {name} as WebAssembly, for node from 20.16 on, browsers and bundlers:

    import {{ load }} from "./{name}.mjs";
    const robot = await load();
    robot.q[0] = 0.1;
    const results = robot.{first};

The robot has an array of doubles for each argument, which a call reads where an argument is left
out, and to which it copies others, unless `robot.array(entries)` made them. The last argument of
each function are constants, which `robot.prepare(parameters, constants)` makes anew. Results are
arrays, row by row, and a list of them where there are several; the next call of the function writes
them again. Lists of names are there as COORDINATES, VELOCITIES, INPUTS, POINTS, FRAMES, BODIES and
PARAMETERS. SI units, radians, world axes with z up.
"""


def contexts(model: Model, printer: InfixPrinter, header: Lines) -> Mapping[str, Any]:
    """Contexts of the templates: those of C, and of the ES module."""
    shared = {"": c_target.module_text(model, printer, header)}
    return defaultdict(lambda: shared, {TEMPLATE: {"": script_text(model, header)}})


def script_text(model: Model, header: Lines) -> Context:
    """Context of the ES module, with the documentation of its functions."""
    laws, description = _laws(model), model.description
    module = SimpleNamespace(**model.lists, NAME=model.robot.name)
    headers = f"_CONSTANTS {len(model.program.constants)}\n"
    headers += law_files(model, header).get(f"{module.NAME}_laws.h", "")
    first = next(f"{s.name}()" for s in model.signatures)
    lines = _ABOUT.format(name=module.NAME, first=first).splitlines()
    tables = documentation.state_tables(description)
    tables["Inputs u, in order"] = documentation.coordinate_table(description.inputs)
    lines += ["", *documentation.entry_lines(tables)]
    for signature in model.signatures:
        lines += ["", *_explained(description, signature)]
    for law in laws:
        lines += ["", f"{law}(): u, as {module.NAME}_laws.h tells it, which has its structures"]
    context = script_context(module, model.signatures, headers, laws)
    return context | {"header": header, "lines": lines}


def _laws(model: Model) -> list[str]:
    """Laws of a model that take structures alone."""
    return [law for law in model.laws if law in LAWS]


def _explained(description: Description, signature: Signature) -> list[str]:
    row = FUNCTIONS[signature.name]
    items = [
        f"{name}: {documentation.meaning(description, name)}"
        for name in signature.arguments
        if name not in ("q", "v", "a", "u")
    ]
    for output, shape in zip(row.outputs, signature.shapes, strict=True):
        size = " x ".join(map(str, shape)) or "1"
        items.append(f"{output.name}, {size}: {documentation.output_text(description, output)}")
    results = ", ".join(output.name for output in row.outputs)
    return [
        f"{signature.name}({', '.join(signature.arguments)}): {results}",
        *(f"    {x}" for x in documentation.wrapped([row.summary, *items], WIDTH - 8, "    ")),
    ]


def archives(model: Model, header: Lines) -> dict[str, bytes]:
    """The WebAssembly of a model, by the name of its file."""
    name, values = model.robot.name, c_target.module_text(model, CPrinter(), header)
    texts = {file.format(name=name): render(x, values) for x, file in COMPILED.items()}
    texts |= law_files(model, header) if _laws(model) else {}
    functions = [*(signature.name for signature in model.signatures), *_laws(model)]
    sources = {file: text.encode() for file, text in texts.items()}
    return {f"{name}.wasm": assembled(name, sources, functions)}
