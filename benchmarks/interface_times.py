"""Time calls from every language and library: `python benchmarks/interface_times.py`.

What forward dynamics costs, alone and with its Jacobian by q, v and u, for one state and for one of
a thousand, in each of the ways that docs/reference/interfaces.md compares. The program generates
the module that it times. All ways agree to 1e-9 with the NumPy module before they are timed. It
needs the extras `casadi` and `jax`, and gcc; MATLAB's functions are timed under GNU Octave,
where that is installed. A time is the least of several means.

`--robot ROBOT` takes another robot.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import shutil
import subprocess
import sys
import tempfile
import timeit
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import casadi
import jax
import numpy as np
import scipy.io
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "tests")]

from c_times import machine  # noqa: E402
from support.pages import run_python  # noqa: E402

from gibbs_codegen import generate, load  # noqa: E402

Array = NDArray[np.float64]
States = tuple[Array, Array, Array]
Call = Callable[[], Any]

STATES = 1000
ALONE, WITH_JACOBIAN = "forward_dynamics", "forward_dynamics_derivatives"

# One after the other, as a controller calls them.
C_LOOP = """
#include "{name}.h"
void {function}_loop({parameters})
{{
    for (size_t i = 0; i < {states}; i++) {{
        {name}_{function}(&{name}_default_constants, {arguments});
    }}
}}
"""

OCTAVE_SCRIPT = """
addpath('{folder}');
load('{states}');
function t = least(f, times)
  t = Inf;
  f();
  for k = 1:5
    tic; for i = 1:times, f(); end; t = min(t, toc / times);
  end
end
for name = {{'forward_dynamics', 'forward_dynamics_derivatives'}}
  f = str2func(['{name}.' name{{1}}]);
  if strcmp(name{{1}}, 'forward_dynamics'), a = f(q, v, u); save('-6', '{result}', 'a'); end
  printf('%.9g %.9g\\n', least(@() f(q(:, 1), v(:, 1), u(:, 1)), 20), least(@() f(q, v, u), 2));
end
"""


def microseconds(call: Call) -> float:
    """Least of seven means of a call, once it has been called."""
    call()
    timer = timeit.Timer(call)
    number = max(1, int(0.05 / max(timer.timeit(1), 1e-7)))
    return min(timer.repeat(7, number)) / number * 1e6


def of_module(module: ModuleType, states: States) -> Iterator[tuple[Call, Call]]:
    """Calls of a module's functions from Python, for one state and for all."""
    first = tuple(x[0] for x in states)
    for name in (ALONE, WITH_JACOBIAN):
        function = getattr(module, name)
        yield lambda f=function: f(*first), lambda f=function: f(*states)


def of_jax(module: ModuleType, states: States) -> Iterator[tuple[Call, Call]]:
    """Calls of compiled functions of JAX; the Jacobian is by jacfwd."""
    alone = module.forward_dynamics
    both = jax.vmap(lambda *x: (alone(*x), jax.jacfwd(alone, (0, 1, 2))(*x)))
    every = tuple(map(jax.numpy.asarray, states))
    first = tuple(x[:1] for x in every)
    for function in (jax.jit(alone), jax.jit(both)):
        yield (
            lambda f=function: jax.block_until_ready(f(*first)),
            lambda f=function: jax.block_until_ready(f(*every)),
        )


def of_casadi(alone: Any, states: States) -> Iterator[tuple[Call, Call]]:
    """Calls of a casadi.Function, and of one with its Jacobian; a map takes all states."""
    symbols = [casadi.MX.sym(n, x.shape[1]) for n, x in zip("qvu", states, strict=True)]
    value, slope = alone(*symbols), alone.jacobian()
    both = casadi.Function("both", symbols, [value, *slope.call([*symbols, value])])
    first = [casadi.DM(x[0]) for x in states]
    every = [casadi.DM(x.T) for x in states]
    for function in (alone, both):
        mapped = function.map(STATES)
        yield lambda f=function: f(*first), lambda f=mapped: f(*every)


def of_c(module: ModuleType, folder: Path, states: States) -> list[tuple[float, float]]:
    """Microseconds a state of the C functions called in a loop in C, and of their batch forms."""
    nq, nv, nu = (x.shape[1] for x in states)
    sizes = {ALONE: (nv,), WITH_JACOBIAN: (nv, nv * nv, nv * nv, nv * nu)}
    text = ""
    for function, rooms in sizes.items():
        outputs = [f"o{k}" for k in range(len(rooms))]
        text += C_LOOP.format(
            name=module.NAME,
            function=function,
            states=STATES,
            parameters=", ".join(f"double *{name}" for name in [*"qvu", *outputs]),
            arguments=", ".join([f"q + i * {nq}", f"v + i * {nv}", f"u + i * {nu}", *outputs]),
        )
    (folder / "loop.c").write_text(text, encoding="utf-8")
    package = folder / module.NAME
    sources = [package / f"{module.NAME}{ending}.c" for ending in ("", "_batch")]
    command = ["gcc", "-O3", "-march=native", "-fPIC", "-shared", f"-I{package}"]
    subprocess.run(
        [*command, folder / "loop.c", *sources, "-lm", "-o", folder / "loop.so"], check=True
    )
    library = ctypes.CDLL(str(folder / "loop.so"))
    constants = ctypes.addressof(ctypes.c_char.in_dll(library, f"{module.NAME}_default_constants"))
    lanes = [np.ascontiguousarray(x.reshape(-1, 8, x.shape[1]).swapaxes(1, 2)) for x in states]
    found = []
    for function, rooms in sizes.items():
        rows, blocks = ([np.empty(n * size) for size in rooms] for n in (1, STATES))
        one, many = library[f"{function}_loop"], library[f"{module.NAME}_{function}_batch"]
        given = [ctypes.c_void_p(x.ctypes.data) for x in (*states, *rows)]
        batch = [ctypes.c_void_p(constants), ctypes.c_size_t(STATES)]
        batch += [ctypes.c_void_p(x.ctypes.data) for x in (*lanes, *blocks)]
        calls = (lambda f=one, x=given: f(*x), lambda f=many, x=batch: f(*x))
        found.append(tuple(microseconds(call) / STATES for call in calls))
    return found


def of_octave(
    module: ModuleType, folder: Path, states: States, right: Array
) -> list[tuple[float, float]]:
    """Microseconds a state of the functions of the MATLAB package, under GNU Octave."""
    files = {name: folder / f"{name}.mat" for name in ("states", "result")}
    scipy.io.savemat(files["states"], dict(zip("qvu", (x.T for x in states), strict=True)))
    script = OCTAVE_SCRIPT.format(name=module.NAME, folder=folder / module.NAME, **files)
    (folder / "times.m").write_text(script, encoding="utf-8")
    command = ["octave-cli", "--no-gui", "--quiet", folder / "times.m"]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    check("Octave", scipy.io.loadmat(files["result"])["a"].T, right)
    seconds = [tuple(map(float, line.split())) for line in told.split("\n") if line]
    return [(one * 1e6, many / STATES * 1e6) for one, many in seconds]


def check(who: str, value: Any, right: Array) -> None:
    """Refuse to time what computes something else."""
    difference = np.abs(np.asarray(value) - right).max() / np.abs(right).max()
    if not difference < 1e-9:
        raise SystemExit(f"{who} differs from NumPy by {difference:.1e}")


def measured(robot: str, folder: Path, console: Console) -> dict[str, list[tuple[float, float]]]:
    """Microseconds for one state and for a state of many, alone and with Jacobian, by way."""
    targets = ["numpy", "c", "matlab"]
    made = generate(robot, folder, targets=targets, derivatives=True)
    modules = {b: load(made, backend=b) for b in ("numpy", "c", "casadi", "jax")}
    numpy, compiled = modules["numpy"], modules["c"]
    rng = np.random.default_rng(1)
    q, v, u = (
        rng.uniform(-1, 1, (STATES, len(names)))
        for names in (numpy.COORDINATES, numpy.VELOCITIES, numpy.INPUTS)
    )
    # A displacement leads to a unit quaternion.
    q = numpy.integrate(numpy.integrate(q, 0.0 * v), v)
    states, right = (q, v, u), numpy.forward_dynamics(q, v, u)
    with contextlib.chdir(folder):
        page = run_python("docs/howto/casadi.md")
        external = page["compiled"](page["differentiable"](modules["casadi"]))
    ways = {
        "NumPy": of_module(numpy, states),
        "C, called from Python": of_module(compiled, states),
        "CasADi, compiled function": of_casadi(external, states),
        "CasADi, symbolic function": of_casadi(modules["casadi"].forward_dynamics, states),
        "JAX": of_jax(modules["jax"], states),
    }
    times = {}
    for way, calls in ways.items():
        console.print(way)
        both = [*calls]
        value = np.asarray(both[0][1]())
        check(way, value.T if way.startswith("CasADi") else value, right)
        times[way] = [(microseconds(one), microseconds(all_) / STATES) for one, all_ in both]
    times["C"] = of_c(compiled, folder, states)
    if shutil.which("octave-cli"):
        times["MATLAB, under Octave"] = of_octave(numpy, folder, states, right)
    return times


def main() -> None:
    """Print microseconds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", default="hexarotor_3link")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    console = Console(width=None if sys.stdout.isatty() else 110, highlight=False)
    with tempfile.TemporaryDirectory() as folder:
        times = measured(options.robot, Path(folder), console)
    console.print(machine())
    table = Table(title=f"{options.robot}: microseconds a state")
    table.add_column("way")
    for what in ("forward dynamics", "with Jacobian"):
        for count in ("one state", f"one of {STATES}"):
            table.add_column(f"{what}, {count}", justify="right")
    for way, rows in times.items():
        table.add_row(way, *(f"{number:.3g}" for row in rows for number in row))
    console.print(table)


if __name__ == "__main__":
    main()
