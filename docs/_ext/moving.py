"""Drawings that move: HTML with scripts, which needs no server and no library.

Their equations are never typed in: `program_script` prints functions of the program from which the
modules are printed too, and `sympy_script` prints what a notebook derived.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.derivation.hybrid import Filling, filled_entries
from gibbs_codegen.equations.chain_names import hybrid_names
from gibbs_codegen.equations.show import chain_equation
from gibbs_codegen.equations.typeset import TEXT, Writer, accelerated
from gibbs_codegen.errors import UsageError
from gibbs_codegen.figures.appearance import VIEW, seen_from
from gibbs_codegen.figures.coupling import chain_colour
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.chains import coupling_map, decompose
from gibbs_codegen.robot.description import constrained_coordinate
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.targets.printers import InfixPrinter

SCRIPTS = Path(__file__).parent / "scripts"
# Text, lowest, highest and first value, unit, and digits after the point.
Slider = tuple[str, float, float, float, str, int]


class _Printer(InfixPrinter):
    """Prints nodes as JavaScript."""

    def call(self, function: str, argument: str) -> str:
        """A call of Math."""
        return f"Math.{function}({argument})"


def program_script(model: Model, names: Iterable[str]) -> str:
    """Functions of a model in JavaScript, each from arrays to arrays in C order.

    What the constants are computed from has the values of the robot file.
    """
    program, printer = model.program, _Printer()
    values = program.prepared(model.defaults)
    lines = []
    for name in names:
        function = program.function(name)
        lines.append(f"const {name} = ({', '.join(function.arguments)}) => {{")
        lines += [f"const [{', '.join(program.inputs[x])}] = {x};" for x in function.arguments]
        lines += [f"const {x} = {values[x]!r};" for x in function.constants]
        lines += [f"const {s.name} = {printer.expression(s.value)};" for s in function.statements]
        arrays = [", ".join(map(printer.expression, output.entries)) for output in function.outputs]
        returned = "], [".join(arrays)
        lines.append(
            f"return [{returned}];}};" if len(arrays) == 1 else f"return [[{returned}]];}};"
        )
    return "\n".join(lines)


def sympy_script(name: str, arguments: Sequence[Any], outputs: Sequence[sp.Expr]) -> str:
    """A function in JavaScript from numbers to an array."""
    steps, entries = sp.cse(outputs, sp.numbered_symbols("step_"))
    lines = [f"const {symbol} = {sp.jscode(value)};" for symbol, value in steps]
    returned = ", ".join(map(sp.jscode, entries))
    taken = ", ".join(map(str, arguments))
    return "\n".join([f"const {name} = ({taken}) => {{", *lines, f"return [{returned}];}};"])


def panel(name: str, words: str, size: tuple[int, int], drawing: str, least: int = 20) -> str:
    """A picture, its size in units of its own, beside others where these leave `least` rem."""
    width, height = size
    # What can be moved by the keyboard must be known to who cannot see it.
    role = "group" if "tabindex" in drawing else "img"
    return f"""<svg viewBox="0 0 {width} {height}" role="{role}" aria-label="{words}" font-size="15"
 fill="none" stroke-width="2" style="flex:1 1 {least}rem;max-width:100%;min-width:0"><defs><marker
 id="{name}-head" viewBox="0 0 10 10" refX="8" refY="5" markerWidth="4" markerHeight="4"
 orient="auto"><path d="M0 0L10 5L0 10z" fill="context-stroke"/></marker></defs>{drawing}</svg>"""


def movable(
    name: str,
    inner: str,
    sliders: Iterable[Slider] = (),
    scripts: Sequence[str] = (),
    plays: bool = False,
) -> str:
    """A figure with sliders and, if it plays, a button; without scripts it stands still."""
    ranges = "".join(
        f'<label style="display:inline-block;white-space:nowrap;margin-right:2em">{text} '
        f'<input type="range" min="{low}" max="{high}" step="any" value="{at}" '
        f'data-digits="{digits}" aria-label="{text}, {unit}" style="vertical-align:middle"> '
        f'<output style="display:inline-block;min-width:3.2em;text-align:right">{at:.{digits}f}'
        f"</output> {unit}</label>"
        for text, low, high, at, unit, digits in sliders
    )
    button = '<button class="play" type="button" style="margin-right:2em"></button>' * plays
    text = "\n".join([(SCRIPTS / "shared.js").read_text(encoding="utf-8"), *scripts])
    # An empty line would end the figure where Markdown has HTML.
    lines = "\n".join(line for line in text.splitlines() if line and not line.startswith("//"))
    return f"""<figure id="{name}" style="margin:0"><div
 style="display:flex;flex-wrap:wrap;gap:1rem">{inner}</div>
<div class="controls" hidden>{button}{ranges}</div><script>(() => {{
const figure = document.getElementById("{name}");
{lines}
}})()</script></figure>"""


def frames(
    name: str, inner: str, slider: Slider, drawings: Sequence[dict[str, Any]], pace: float = 0.0
) -> str:
    """A figure in which a slider chooses one of several drawings, and time moves it at a pace.

    A drawing has paths in `d` and texts in `words`, by the class of their part.
    """
    known = f"const frames = {json.dumps(drawings, ensure_ascii=False)}, pace = {pace};"
    return movable(name, inner, [slider], [known, script("frames")], plays=pace > 0.0)


def line(points: Iterable[Sequence[float]]) -> str:
    """A path through places, px."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def discs(places: Iterable[Sequence[float]], radius: float) -> str:
    """A path of circles about places, px."""
    r, d = radius, 2.0 * radius
    return "".join(
        f"M{x - r:.1f} {y:.1f}a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0 {-d} 0" for x, y in places
    )


def script(name: str) -> str:
    """One of the scripts beside this module."""
    return (SCRIPTS / f"{name}.js").read_text(encoding="utf-8")


def hybrid_equation(robot_name: str = "hexarotor_3link") -> str:
    """The hybrid system of a robot of the paper as its arrays, whose entries can be touched.

    An entry shows the chains and links that make it, its expression, and its value while the robot
    moves by this system. Raises `UsageError` for a robot without six rotors, which cannot follow
    a path of all its coordinates.
    """
    robot, _ = read_robot(robot_name)
    model = derive(robot)
    description, names = model.description, hybrid_names(robot)
    if len(description.inputs) != len(description.coordinates):
        raise UsageError(
            f"{robot_name}: the drawing needs as many inputs as free coordinates, so six rotors"
        )
    unknowns = [accelerated(names[c.name]).text for c in description.hybrid_coordinates]
    acting = [names[c.name].text for c in description.inputs]
    filled = filled_entries(robot)
    parts, letters = _parts_of_entries(robot, [c.name for c in description.inputs])
    arrays = "".join(
        _array(letter, entries, rows, columns)
        for letter, entries, rows, columns in (
            ("I", filled.matrix, unknowns, unknowns),
            ("R", filled.residual, unknowns, [""]),
            ("B", filled.inputs, unknowns, acting),
        )
    )
    points = list(model.lists["POINTS"])
    arms = [("O2", f"motor{k}") for k in range(1, robot.rotors + 1)]
    arms += pairwise(points[-1 - len(robot.links) :])
    angles = np.radians([float(robot.base.arm_angle_deg(k)) for k in range(1, robot.rotors + 1)])
    known: dict[str, Any] = {
        "parts": parts,
        "letters": letters,
        "unknowns": unknowns,
        "acting": acting,
        "thrusts": robot.rotors,
        "units": [c.unit for c in description.hybrid_coordinates],
        "free": [description.hybrid_coordinates.index(c) for c in description.coordinates],
        "arms": arms,
        "angles": angles.tolist(),
        "points": points,
        "colours": [chain_colour(chain.number) for chain in decompose(robot)],
        "view": seen_from(VIEW)[:2].tolist(),
    }
    lines = "".join(f'<path class="arm-{k}"/>' for k in range(1, len(arms) + 1))
    for k, angle in enumerate(known["angles"], start=1):
        tip = np.array([90.0, 255.0]) + 72.0 * np.array([np.cos(angle), -np.sin(angle)])
        lines += f'<path d="{line([(90.0, 255.0), tip])}" stroke="#999" stroke-width="4"/>'
        if k > 1:
            lines += (
                f'<path class="torque-{k}" stroke="{known["colours"][k - 2]}" '
                'marker-end="url(#hybrid-equation-head)"/>'
            )
    lines += '<text x="8" y="345" fill="currentColor">torques in the base</text>'
    words = (
        "The robot, moved by its hybrid system; the arms whose mass makes the entry are coloured. "
        "Below, the base from above, with arcs for the torques that keep its arms from turning."
    )
    machine = panel("hybrid-equation", words, (180, 350), lines, least=8)
    told = (
        '<div style="flex:3 1 12rem;min-width:0"><p class="entry" aria-live="polite"></p>'
        '<div class="terms" tabindex="0" style="height:9em;overflow:auto"></div>'
        '<p class="value" style="font-variant-numeric:tabular-nums"></p><p class="torques" '
        'style="font-variant-numeric:tabular-nums"></p></div>'
    )
    functions = ("hybrid_mass_matrix", "hybrid_residual", "hybrid_input_matrix", "positions")
    scripts = [
        f"const known = {json.dumps(known, ensure_ascii=False)};",
        program_script(model, functions),
        script("equation"),
    ]
    look = (SCRIPTS / "equation.css").read_text(encoding="utf-8")
    inner = f"<style>{look}</style>{machine}{told}{arrays}"
    return movable("hybrid-equation", inner, (), scripts, plays=True)


def _array(letter: str, entries: Filling, rows: Sequence[str], columns: Sequence[str]) -> str:
    """An array as a grid of cells in the colours of the chains that add to them."""
    # Beside I_H the rows of the others have their names already.
    aside = ' class="aside"' * (letter != "I")
    lines = [f"<span{aside}></span>" + "".join(f"<span>{_set(x)}</span>" for x in columns)]
    for i, (row, name) in enumerate(zip(entries, rows, strict=True)):
        cells = [f"<span{aside}>{_set(name)}</span>"]
        for k, chains in enumerate(row):
            colours = [chain_colour(j) for j in chains]
            stops = [
                f"{c} {100 * n / len(colours):.0f}% {100 * (n + 1) / len(colours):.0f}%"
                for n, c in enumerate(colours)
            ]
            fill = colours[0] if len(colours) == 1 else f"linear-gradient(90deg,{','.join(stops)})"
            cells.append(
                f'<b role="gridcell" tabindex="-1" data-at="{letter} {i} {k}" '
                f'style="background:{fill}"></b>'
                if chains
                else "<i></i>"
            )
        lines.append("".join(cells))
    inner = "".join(f'<div role="row">{line}</div>' for line in lines)
    head = f"<strong>{letter}<sub>H</sub></strong>"
    return f'<div class="array" role="grid" aria-label="{letter}_H">{head}{inner}</div>'


def _set(text: str) -> str:
    """A symbol in plain text with its index as HTML has it."""
    return re.sub(r"_\{([^}]*)\}|_(\w)", r"<sub>\1\2</sub>", text).replace("-", "−")


# Lists of a chain, its item, its expression and the arms whose mass it has, by array, row, column.
Parts = dict[str, list[list[Any]]]


def _parts_of_entries(robot: Robot, inputs: Sequence[str]) -> tuple[Parts, list[dict[str, str]]]:
    """What each chain adds to each entry, and what the letters stand for, by chains."""
    parts: Parts = {}
    letters = []
    for chain, where in zip(decompose(robot), coupling_map(robot), strict=True):
        equation = chain_equation(robot, chain.number, 15, most_terms=10_000)
        writer, lines = Writer(equation.names, TEXT), dict(equation.lines)
        mass = {arm for arm in chain.massive if _mass(robot, arm)}
        moved = [mass & set(chain.links[i:] or chain.links) for i in range(len(equation.matrix))]

        def add(
            key: str,
            name: str,
            value: sp.Expr,
            arms: Iterable[int] = (),
            write: Writer = writer,
            number: int = chain.number,
        ) -> None:
            entry = [number, name, write.line(value), sorted(arms)]
            parts.setdefault(key, []).append(entry)

        # The border: the joint that is held, and its torque.
        for torque, arm in zip(where[len(equation.matrix) :], chain.constrained, strict=True):
            item = chain.coordinates.index(constrained_coordinate(robot, arm).name)
            zeta = f"ζ_{{{chain.number},{item + 1}}}"
            add(f"I {where[item]} {torque}", f"-{zeta}", sp.Integer(-1))
            add(f"I {torque} {where[item]}", f"{zeta}", sp.Integer(1))
        for i, row in enumerate(equation.matrix):
            for k, symbol in enumerate(row[: i + 1]):
                if symbol != 0:
                    low, high = sorted((where[i], where[k]))
                    arms = moved[i] & moved[k]
                    add(f"I {low} {high}", writer.line(symbol), lines[symbol], arms)
            if (symbol := equation.residual[i]) != 0:
                add(f"R {where[i]} 0", writer.line(symbol), lines[symbol], moved[i])
            if (symbol := equation.forces[i]) != 0:
                for column, name in enumerate(inputs):
                    by = lines[symbol].coeff(sp.Symbol(name))
                    if by != 0:
                        add(f"B {where[i]} {column}", writer.line(symbol), by)
        entries = {*sum(equation.matrix, ()), *equation.residual, *equation.forces}
        defined = [line for line in equation.lines if line[0] not in entries]
        letters.append({writer.line(symbol): writer.line(value) for symbol, value in defined})
    return parts, letters


def _mass(robot: Robot, arm: int) -> float:
    """Mass of an arm by its number, kg."""
    if arm <= robot.rotors:
        return robot.base.arm(arm).total_mass
    return robot.links[arm - robot.rotors - 1].body.total_mass
