"""Time PyTorch's functions beside other ways: `python benchmarks/torch_times.py`.

Forward dynamics of `quadrotor_arm_2link`, and it with backward of its sum, in float64 on one
thread: those of `load(…, backend="torch")`, the same emitted expressions on tensors, and, where
`adam-robotics` is installed, its articulated-body algorithm, which has no thrusts. The first two
must agree to 1e-9, with their gradients, before any is timed. Rounds go through all in turn; times
are of the processor, the median of the rounds, and ratios are to the first row, round by round.
"""

from __future__ import annotations

import argparse
import contextlib
import statistics
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import torch
from rich.console import Console
from rich.table import Table

from gibbs_codegen import generate, load
from gibbs_codegen.arrays import Functions
from gibbs_codegen.exchange.exporting import export_robot
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.runtime.kernels import Kernels

ROBOT = "quadrotor_arm_2link"
ROUNDS = 9
SECONDS = 0.05
Function = Callable[..., Any]


def emitted_on_tensors(module: ModuleType) -> Function:
    """The module's expressions, evaluated by PyTorch's own operations."""
    numpy, robot = module.in_c.in_numpy, Functions(module)
    names = {"sin": torch.sin, "cos": torch.cos, "sqrt": torch.sqrt, "atan": torch.atan}
    elementary = names | {"sign": lambda x: torch.copysign(torch.ones_like(x), x)}
    kernels, constants = Kernels(numpy, elementary), numpy.prepare({})
    place = robot.layout.q.attitude

    def function(q: Any, v: Any, u: Any) -> Any:
        turn = q[..., place] / q[..., place].norm(dim=-1, keepdim=True)
        q = torch.cat([q[..., : place.start], turn, q[..., place.stop :]], -1)
        signature = robot.signatures["forward_dynamics"]
        entries = kernels.outputs(signature, constants, q.unbind(-1), v.unbind(-1), u.unbind(-1))
        return torch.stack(entries[0], -1)

    return function


def adam(module: ModuleType, folder: Path) -> Function:
    """Its algorithm, for the base at rest's attitude: what that is costs nothing there."""
    from adam import Representations
    from adam.pytorch import KinDynComputations

    urdf = folder / "robot.urdf"
    urdf.write_text(export_robot(read_robot(ROBOT)[0], "urdf")[0], encoding="utf-8")
    moving = ("revolute", "continuous")
    every = ET.parse(urdf).getroot().findall("joint")  # noqa: S314 - of this program
    computed = KinDynComputations(
        str(urdf), [j.attrib["name"] for j in every if j.attrib["type"] in moving]
    )
    computed.set_frame_velocity_representation(Representations.BODY_FIXED_REPRESENTATION)
    robot = Functions(module)

    def function(q: Any, v: Any, u: Any) -> Any:
        pose = torch.eye(4, dtype=q.dtype).repeat(len(q), 1, 1)
        joints = q[:, robot.layout.q.joints], v[:, :6], v[:, robot.layout.v.joints]
        return computed.aba(pose, *joints, u[:, robot.rotors :])

    return function


def with_backward(function: Function) -> Function:
    """A function, and backward of the sum of its results."""

    def both(*given: Any) -> None:
        for x in given:
            x.grad = None
        function(*given).sum().backward()

    return both


def seconds(function: Function, given: list[Any], calls: int) -> float:
    """Processor time of a call."""
    begun = time.process_time()
    for _ in range(calls):
        function(*given)
    return (time.process_time() - begun) / calls


def state(module: ModuleType, count: int) -> list[Any]:
    """Random q, v and u of so many states."""
    sizes = map(len, (module.COORDINATES, module.VELOCITIES, module.INPUTS))
    return [torch.randn(count, n, dtype=torch.float64, requires_grad=True) for n in sizes]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--states", type=int, nargs="+", default=[1, 1000, 100_000])
    options = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    with tempfile.TemporaryDirectory() as folder:
        made = generate(ROBOT, folder, derivatives=["forward_dynamics_vjp"])
        module = load(made, backend="torch")
        ours, theirs = module.forward_dynamics, emitted_on_tensors(module)
        rows = {"backend torch": ours, "emitted expressions on tensors": theirs}
        given = state(module, 7)
        results = [function(*given) for function in rows.values()]
        for found in zip(*(torch.autograd.grad(y.sum(), given) for y in results), strict=True):
            torch.testing.assert_close(*found, rtol=1e-9, atol=1e-9)
        with contextlib.suppress(ModuleNotFoundError):
            rows["adam, without thrusts"] = adam(module, Path(folder))
        table = Table("", "states", "forward, µs", "with backward, µs", "ratio")
        for count in options.states:
            given = state(module, count)
            both = {name: with_backward(function) for name, function in rows.items()}
            tasks = {(name, k): f for k, fs in enumerate((rows, both)) for name, f in fs.items()}
            calls = {
                key: max(1, int(SECONDS / max(seconds(f, given, 2), 1e-6)))
                for key, f in tasks.items()
            }
            times = {key: [] for key in tasks}
            for _ in range(ROUNDS):
                for key, f in tasks.items():
                    times[key].append(seconds(f, given, calls[key]))
            for name in rows:
                forward, whole = (statistics.median(times[name, k]) * 1e6 for k in (0, 1))
                pairs = zip(times[name, 1], times["backend torch", 1], strict=True)
                ratio = statistics.median(one / other for one, other in pairs)
                table.add_row(name, f"{count}", f"{forward:.0f}", f"{whole:.0f}", f"{ratio:.1f}")
    Console().print(table)


if __name__ == "__main__":
    main()
