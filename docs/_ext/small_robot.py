"""A small robot in print: M, R and B of its file as LaTeX, and their C.

`python docs/_ext/small_robot.py` prints what the page on equations has of it.
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

import sympy as sp

from gibbs_codegen import chain_equation, generate, parse_robot

# The package's symbols, which have indices of chain and item, in short.
SHORT = {
    r"\theta_{1,3}": r"\theta",
    r"\theta_{1,4}": r"\varphi",
    r"\dot{\theta}_{1,3}": r"\dot\theta",
    r"\dot{\theta}_{1,4}": r"\dot\varphi",
    "m_{b}": "m_b",
    "m_{3}": "m",
    r"\rho_{3,z}": "r",
    "J_{1,3,zz}": "J_b",
    "J_{1,4,zz}": "J",
    "p_{F1,x}": "x_1",
    "p_{F2,x}": "x_2",
    r"\tau_{1,4}": r"\tau",
}
RATES = sp.symbols(r"\dot\theta \dot\varphi")
INPUTS = sp.symbols(r"F_{1} F_{2} \tau")
# Sines and cosines of the sum of the angles, and of θ: names that come last in products.
THETA, BOTH = sp.Symbol(r"\theta"), sp.Symbol(r"\theta") + sp.Symbol(r"\varphi")
TRIGONOMETRY = {
    sp.sin(BOTH): sp.Symbol("zs"),
    sp.cos(BOTH): sp.Symbol("zc"),
    sp.sin(THETA): sp.Symbol("zs0"),
    sp.cos(THETA): sp.Symbol("zc0"),
}
LETTERS = ("s", "c", r"s_\theta", r"c_\theta")


def matrices(text: str) -> str:
    """M, R and B of the robot of a file's text, with one chain, as a formula of Markdown."""
    equation = chain_equation(parse_robot(text), 1, 15)
    values = dict(equation.lines)
    short = {s: sp.Symbol(SHORT.get(n.latex, n.latex)) for s, n in equation.names.items()}

    def value(entry: sp.Expr) -> sp.Expr:
        return sp.sympify(values.get(entry, entry)).xreplace(short).xreplace(TRIGONOMETRY)

    def written(entry: sp.Expr) -> str:
        still = entry.subs(dict.fromkeys(RATES, 0))
        parts = [part for part in (sp.factor(sp.expand(entry - still)), sp.factor(still)) if part]
        names = dict(zip(TRIGONOMETRY.values(), LETTERS, strict=True))
        return " + ".join(sp.latex(part, symbol_names=names) for part in parts) or "0"

    columns = [[value(force).diff(u) for u in INPUTS] for force in equation.forces]
    matrix = [[value(entry) for entry in row] for row in equation.matrix]
    arrays = {"M": matrix, "R": [[value(x)] for x in equation.residual], "B": columns}
    lines = []
    for letter, rows in arrays.items():
        entries = " \\\\\n".join(" & ".join(map(written, row)) for row in rows)
        entries = entries.replace("+ -", "-")
        lines.append(f"{letter} &= \\begin{{bmatrix}}\n{entries}\n\\end{{bmatrix}}")
    return "$$\n\\begin{aligned}\n" + " \\\\[1ex]\n".join(lines) + "\n\\end{aligned}\n$$"


def c_functions(text: str) -> str:
    """The C functions of M and R, and of B, of the robot of a file's text."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "small.toml")
        path.write_text(text, encoding="utf-8")
        made = generate(path, folder, verify=False)
        source = (made / f"{made.name}.c").read_text(encoding="utf-8")
    heads = rf"static INLINE void mass_matrix_and_residual_text|void {made.name}_input_matrix"
    functions = re.findall(rf"^(?:{heads})\(.*?\n}}\n", source, re.S | re.M)
    return "```c\n" + "\n".join(functions) + "```"


if __name__ == "__main__":
    page = Path(__file__).parents[1] / "reference" / "equations.md"
    (robot,) = re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    sys.stdout.write(f"{matrices(robot)}\n\n{c_functions(robot)}\n")
