"""MuJoCo as a contender: three slides and three hinges carry a base that moves."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
from peers.build import BuildError, compiled, function, own_copy, package_folder, required
from peers.contender import (
    FORWARD_DYNAMICS,
    MASS_MATRIX_AND_RESIDUAL,
    Array,
    Contender,
)
from peers.tree import Body, Tree

BASE_JOINTS = [("slide", axis) for axis in np.eye(3)] + [("hinge", axis) for axis in np.eye(3)]


def numbers(values: Array) -> str:
    """Numbers as MJCF writes them, none of their digits lost."""
    return " ".join(repr(float(value)) for value in values)


def joint(kind: str, axis: Array, place: Array) -> str:
    """A joint of a body."""
    return f'<joint type="{kind}" axis="{numbers(axis)}" pos="{numbers(place)}"/>'


def inertial(body: Body) -> str:
    """Mass and inertia; a diagonal one is given as such, which saves MuJoCo a rotation."""
    diagonal, products = np.diag(body.inertia), body.inertia[[0, 0, 1], [1, 2, 2]]
    tensor = (
        f'fullinertia="{numbers(np.concatenate([diagonal, products]))}"'
        if products.any()
        else f'diaginertia="{numbers(diagonal)}"'
    )
    return f'<inertial pos="{numbers(body.com)}" mass="{body.mass!r}" {tensor}/>'


def model_text(tree: Tree) -> str:
    """The tree in MJCF.

    MuJoCo refuses a body without mass that moves: its joint is given to the next body instead,
    where the coordinates stay the same.
    """
    base, *arm = tree.bodies
    here = np.zeros(3)
    lines = ["<body>", inertial(base), *(joint(kind, axis, here) for kind, axis in BASE_JOINTS)]
    if tree.root == "fixed":
        lines = []
    turn, step, axes = np.eye(3), here, []
    for body in arm:
        turn, step = turn @ body.turn, step + turn @ body.step
        axes = [(body.turn.T @ axis, body.turn.T @ (place - body.step)) for axis, place in axes]
        axes.append((np.array([0.0, 0.0, 1.0]), here))
        if body.mass == 0:
            continue
        placed = f'pos="{numbers(step)}" xyaxes="{numbers(turn.T[:2].ravel())}"'
        lines += [f"<body {placed}>", inertial(body), *(joint("hinge", *pair) for pair in axes)]
        turn, step, axes = np.eye(3), here, []
    bodies = "\n".join(lines)
    bodies += "</body>" * bodies.count("<body")
    return (
        '<mujoco><compiler angle="radian"/>'
        f'<option gravity="{numbers(np.array([0.0, 0.0, -tree.gravity]))}">'
        '<flag contact="disable" constraint="disable"/></option>'
        f"<worldbody>{bodies}</worldbody></mujoco>\n"
    )


def mujoco_contenders(tree: Tree, folder: Path) -> list[Contender]:
    """MuJoCo, both tasks."""
    package = package_folder("mujoco", "mujoco")
    binaries = sorted(package.glob("libmujoco.so*"))
    if not binaries:
        raise BuildError(f"no libmujoco.so in {package}: pip install mujoco (Linux)")
    headers = required(package / "include" / "mujoco" / "mujoco.h", "pip install mujoco")
    arguments = [f"-I{headers.parent.parent}", binaries[0], f"-Wl,-rpath,{package}"]
    library = own_copy(
        compiled("mujoco_peer.c", folder.parent / "mujoco.so", arguments), folder / "mujoco.so"
    )
    model = folder / "mujoco.xml"
    model.write_text(model_text(tree), encoding="utf-8")
    error = ctypes.create_string_buffer(1000)
    if library.mujoco_load(str(model).encode(), error, len(error)):
        raise BuildError(f"MuJoCo refuses {model}: {error.value.decode()}")
    layout = tree.layout
    return [
        Contender(
            "MuJoCo",
            MASS_MATRIX_AND_RESIDUAL,
            1,
            function(library, "mujoco_mass_matrix_and_effects"),
            layout.inputs,
            layout.matrix_and_residual,
            function(library, "mujoco_fetch_mass_matrix", 2),
        ),
        Contender(
            "MuJoCo",
            FORWARD_DYNAMICS,
            1,
            function(library, "mujoco_forward_dynamics"),
            layout.inputs,
            layout.accelerations,
        ),
    ]
