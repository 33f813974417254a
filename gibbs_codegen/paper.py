"""The paper, reproduced: its table, equations, figures and flight on one page, with residuals."""

from __future__ import annotations

import base64
import csv
import html
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numpy as np
from markdown_it import MarkdownIt
from matplotlib.figure import Figure

from gibbs_codegen.equations.pages import as_markdown
from gibbs_codegen.equations.show import chain_equation
from gibbs_codegen.figures.chains import chains_figure
from gibbs_codegen.figures.coupling import coupling_figure, hybrid_pattern_figure
from gibbs_codegen.figures.machine import machine_figure
from gibbs_codegen.figures.style import FULL, new_figure, save_figures, style
from gibbs_codegen.files.staging import new_place
from gibbs_codegen.files.templating import render
from gibbs_codegen.flight.figures import curves
from gibbs_codegen.flight.figures.snapshots import INSTANTS, snapshots
from gibbs_codegen.flight.record.extent import samples_at
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import Rod
from gibbs_codegen.robot.rotations import Array
from gibbs_codegen.runtime.load import load
from gibbs_codegen.verification.formulation import formulated
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree

ROBOT, SCENARIO = "hexarotor_3link", "paper"
SETS_FORMULAS = find_spec("latex2mathml") is not None
_STEP = 1e-6  # Of central differences, rad and m.


@dataclass(frozen=True)
class Residual:
    """The largest error of a statement in the flight, its unit, and the size of what it is of."""

    what: str
    unit: str
    error: float
    size: float

    @property
    def text(self) -> str:
        """The error with its unit."""
        return f"{self.error:.1e} {self.unit}" if self.error else f"0 {self.unit}"

    @property
    def digits(self) -> float:
        """Digits that agree, at most those of a double."""
        return float(-np.log10(max(self.error / self.size, np.finfo(float).eps)))


def write_paper(
    folder: str | os.PathLike[str],
    progress: Callable[[str], None] = lambda step: None,
    linked: bool = False,
) -> list[Residual]:
    """Write the pages `index.md` and `index.html`, figures and `residuals.csv` to a new folder.

    The second needs nothing else. `linked` keeps links to notebooks and other pages, and has
    figures in paper/, as on the site, without `index.html`.
    Raises `UsageError` if the folder is there already, and `OutputError` if it cannot be written;
    nothing is left then.
    """
    with new_place(folder) as new:
        new.mkdir()
        progress("flying the paper's scenario")
        robot, module = read_robot(ROBOT)[0], load(ROBOT, "c")
        flight = simulate(module, read_scenario(SCENARIO))
        errors = path_errors(flight)
        off = base_arm_angles_off(module, flight)
        found = residuals(robot, module, flight, errors, off)
        progress("drawing the figures")
        figures: dict[str, Callable[[], Figure]] = {
            "fig_01": lambda: machine_figure(robot),
            "fig_02": lambda: chains_figure(robot),
            "fig_06": lambda: coupling_figure(robot),
            "fig_07_to_09": lambda: hybrid_pattern_figure(robot),
            "fig_10": lambda: curves.coordinates(flight, "ACD"),
            "fig_10_residuals": lambda: residual_figure(flight, errors, off),
            "fig_11": lambda: snapshots(flight),
        }
        save_figures(((name, draw()) for name, draw in figures.items()), new)
        given = context(robot, flight, errors, found) | {"folder": "paper/" if linked else ""}
        page = render("paper.md.jinja", given)
        page = f"# The paper, reproduced\n\n{page}"
        if not linked:
            page = re.sub(r"(?<!!)\[([^]]+)\]\([^)]+\)", r"\1", page)
            (new / "index.html").write_text(_as_html(page, new), encoding="utf-8")
        (new / "index.md").write_text(page, encoding="utf-8")
        with (new / "residuals.csv").open("w", encoding="utf-8", newline="") as file:
            rows = [(r.what, r.unit, r.error, r.size, r.digits) for r in found]
            csv.writer(file).writerows([("what", "unit", "error", "size", "digits"), *rows])
    return found


def _as_html(page: str, folder: Path) -> str:
    """A page in Markdown as one file, with its pictures, of a folder, and its formulas.

    These are MathML or, without the extra paper, as LaTeX writes them.
    """
    formulas: list[str] = []

    def kept(match: re.Match[str]) -> str:
        formulas.append(f"<code>{html.escape(match[2])}</code>")
        if SETS_FORMULAS:
            from latex2mathml.converter import convert

            display = "block" if match[1] == "$$" else "inline"
            formulas[-1] = convert(match[2].replace("{aligned}", "{align*}"), display=display)
        return f"\ue000{len(formulas) - 1}\ue000"

    def embedded(match: re.Match[str]) -> str:
        picture = base64.b64encode((folder / match[1]).read_bytes()).decode()
        return f'src="data:image/png;base64,{picture}"'

    text = re.sub(r"(\$\$?)(.+?)\1", kept, page, flags=re.DOTALL)
    body = MarkdownIt("commonmark").enable("table").render(text)
    body = re.sub(r'src="([^"]+)"', embedded, body)
    body = re.sub("\ue000(\\d+)\ue000", lambda match: formulas[int(match[1])], body)
    return render("paper.html.jinja", {"body": body})


def desired_paths(t: Array) -> tuple[Array, Array]:
    """Places (s, 3) of the base centre by eq. 20 and of the tip by eq. 21, m, at times (s)."""
    shrinking = 2.0 * np.exp(-0.05 * t)
    base = shrinking * np.cos(t), shrinking * np.sin(t), np.exp(0.1 * t)
    tip = -2.0 * np.cos(np.pi / 2.0 + t), np.full_like(t, -2.0), -2.0 * np.sin(2.0 * t)
    return np.stack(base, axis=-1), np.stack(tip, axis=-1)


def path_errors(flight: Flight) -> dict[str, Array]:
    """How far (s) base centre and tip are off eqs. 20 and 21, m, and the attitude off its rule.

    Base arm 2 is along the path, and the base normal as near to the vertical as that allows: these
    are lengths of differences of unit vectors.
    """
    x, y, z = np.moveaxis(desired_paths(flight.time)[0], -1, 0)
    tangent = _unit(np.stack([-0.05 * x - y, -0.05 * y + x, 0.1 * z], axis=-1))
    wanted = *desired_paths(flight.time), tangent, _unit((0.0, 0.0, 1.0) - tangent[:, 2:] * tangent)
    centre, tip = flight.point("O2"), flight.point("tip")
    found = centre, tip, _unit(flight.point("motor2") - centre), flight.base_rotation[:, :, 2]
    off = [np.linalg.norm(x - y, axis=-1) for x, y in zip(found, wanted, strict=True)]
    return dict(zip(("base centre", "tip", "base arm 2", "base normal"), off, strict=True))


def _unit(vectors: Array) -> Array:
    """Vectors (s, 3) with length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def base_arm_angles_off(module: ModuleType, flight: Flight) -> Array:
    """How far (s, N-1) the flown torques turn loose arms 2 … N in eq. 18, rad, from rest."""
    matrix, held = module.hybrid_mass_matrix(flight.q), _constrained(module)
    above = matrix.shape[1] - len(held)
    right = module.hybrid_residual(flight.q, flight.v)
    right = right + np.einsum("sij,sj->si", module.hybrid_input_matrix(flight.q), flight.applied)
    right -= np.einsum("sij,sj->si", matrix[:, :, above:], flight.constraint_torques)
    solved = np.linalg.solve(matrix[:, :above, :above], right[:, :above, None])[..., 0]
    steps = np.diff(flight.time)[:, None]

    def integrated(rates: Array) -> Array:
        means = (rates[1:] + rates[:-1]) / 2.0
        return np.concatenate([np.zeros_like(rates[:1]), np.cumsum(steps * means, axis=0)])

    return integrated(integrated(solved[:, held]))


def _constrained(module: ModuleType) -> list[int]:
    """Places of θ₂ … θ_N among the unknowns of the hybrid system."""
    held = [k for k, x in enumerate(module.HYBRID_COORDINATES) if x not in module.COORDINATES]
    return held[: len(held) // 2]  # Their torques follow.


def residuals(
    robot: Robot, module: ModuleType, flight: Flight, errors: dict[str, Array], off: Array
) -> list[Residual]:
    """What the paper says, and how far the flight is off it."""
    held = _constrained(module)
    every = np.zeros((len(flight.time), len(module.HYBRID_COORDINATES)))
    every[:, [module.HYBRID_COORDINATES.index(name) for name in module.COORDINATES]] = flight.a
    every[:, -len(held) :] = flight.constraint_torques
    inertia = np.einsum("sij,sj->si", module.hybrid_mass_matrix(flight.q), every)
    acting = np.einsum("sij,sj->si", module.hybrid_input_matrix(flight.q), flight.applied)
    left = inertia - module.hybrid_residual(flight.q, flight.v) - acting
    wrenches = np.zeros((len(flight.time), len(module.FRAMES), 6))
    states = States(flight.q, flight.v, flight.a, flight.applied, wrenches)
    balance = formulated(NewtonEuler(Tree(robot))).at(states).inverse_dynamics
    balance = balance - acting[:, : balance.shape[1]]
    balance[:, held] -= flight.constraint_torques
    ways = np.eye(len(module.COORDINATES)) * _STEP
    ahead, behind = (module.positions(flight.q[::100, None] + s * ways) for s in (1.0, -1.0))
    moved = (ahead - behind)[:, :, module.POINTS.index("tip")].swapaxes(1, 2) / (2.0 * _STEP)
    jacobian = module.frame_jacobians(flight.q[::100])[:, module.FRAMES.index("tip"), :3]
    apart, size = np.abs(flight.errors), np.abs(flight.q_desired)
    reach, forces = np.abs(flight.tip_desired).max(), np.abs(acting).max()
    places = np.maximum(errors["base centre"], errors["tip"])
    rows = [
        ("Eq. 18 against the module's reduced functions", "N, N m", left, forces),
        ("Eq. 18 against Newton and Euler, body by body", "N, N m", balance, forces),
        ("Fig. 3: Jacobian of the tip against differences", "m", jacobian - moved, reach),
        ("Place of the base centre against eq. 20", "m", errors["base centre"], reach),
        ("Place of the tip against eq. 21", "m", errors["tip"], reach),
        ("Base arm 2 against the tangent of eq. 20", "rad", errors["base arm 2"], 1),
        ("Base normal against Z less its part along the path", "rad", errors["base normal"], 1),
        ("Fig. 10 A, C: free angles against desired ones", "rad", apart[:, :6], size[:, :6].max()),
        ("Fig. 10 B: arms on flown torques against held arms", "rad", off, np.pi),
        ("Fig. 10 D: place of O₁ against the desired one", "m", apart[:, 6:], size[:, 6:].max()),
        ("Fig. 11: both places against eqs. 20 and 21", "m", places[_instants(flight)], reach),
        ("Energy against work of the inputs", "J", flight.energy_error, np.abs(flight.work).max()),
    ]
    return [Residual(what, unit, float(np.abs(x).max()), float(s)) for what, unit, x, s in rows]


def residual_figure(flight: Flight, errors: dict[str, Array], off: Array) -> Figure:
    """Draw panel B of Fig. 10, and errors of paths, m, and of angles, rad, over time."""
    named = [curves.symbol(f"theta_{k}") for k in range(2, off.shape[1] + 2)]
    desired = np.broadcast_to(flight.base_arm_angles_desired, off.shape)
    with style():
        figure = new_figure(FULL, 2.9)
        left, middle, right = figure.subplots(1, 3)
        left.set_title("B", loc="left")
        shown = curves.Curves("base arms (deg)", named, *np.degrees((desired + off, desired)))
        curves.plot(left, flight, shown)
        lengths = {name: errors[name] for name in ("base centre", "tip")}
        angles = {"base arm 2": errors["base arm 2"], "constrained": np.abs(off).max(axis=1)}
        for axes, unit, series in ((middle, "m", lengths), (right, "rad", angles)):
            curves.plot_logarithms(axes, flight, f"error ({unit})", series)
            curves.add_key(axes)
        return curves.finished(figure, flight)


def _instants(flight: Flight) -> list[int]:
    """Samples at the instants of Fig. 11."""
    return samples_at(flight, np.linspace(flight.time[0], flight.time[-1], INSTANTS))


def _rod(body: Rod) -> str:
    """Length and mass of a rod, as the robot file has them."""
    return f"{body.length:g} m, {body.mass_per_length or 0:g} kg/m"


def context(
    robot: Robot, flight: Flight, errors: dict[str, Array], found: list[Residual]
) -> dict[str, object]:
    """What the template of the page is given."""
    arms = [arm for k in range(1, robot.rotors + 1) if isinstance(arm := robot.base.arm(k), Rod)]
    links = [link.body for link in robot.links if isinstance(link.body, Rod)]
    rods = {tuple(rod.section_inertia) for rod in (*arms, *links) if rod.total_mass > 0.0}
    equations = [
        as_markdown(replace(chain_equation(robot, chain, 15), lines=(), closed=True))
        for chain in (robot.rotors - 1, robot.rotors)
    ]
    samples = _instants(flight)
    instants = zip(*(x[samples] for x in (flight.time, *list(errors.values())[:2])), strict=True)
    return {
        "base": "; ".join(dict.fromkeys(_rod(arm) for arm in arms)),
        "links": "; ".join(_rod(link) for link in links),
        "gravity": f"{robot.gravity:g}",
        "sections": "; ".join(", ".join(f"{1e8 * x:.4g}" for x in rod) for rod in sorted(rods)),
        "five": equations[0].partition("**Symbols**")[0].partition("\n")[2].strip(),
        "six": equations[1].partition("**Symbols**")[0].partition("\n")[2].strip(),
        "residuals": [(*r.what.split(" against "), r.text, f"{r.digits:.1f}") for r in found],
        "instants": [(f"{t:.2f}", f"{base:.1e}", f"{tip:.1e}") for t, base, tip in instants],
    }
