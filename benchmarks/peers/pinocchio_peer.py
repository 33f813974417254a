"""Pinocchio's C++ as a contender: on a free-flyer, its best, and in the project's coordinates."""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_int, c_long, c_void_p
from pathlib import Path
from typing import Any

import numpy as np
from peers import free_flyer
from peers.build import compiled, function, own_copy, package_folder, required
from peers.contender import (
    FORWARD_DYNAMICS,
    MASS_MATRIX_AND_RESIDUAL,
    Contender,
)
from peers.tree import ROOTS, Tree


def headers() -> list[str]:
    """Flags that find Pinocchio, Boost and Eigen in the wheels' common prefix."""
    package = package_folder("pinocchio", "pin")
    prefix = next((p for p in package.parents if p.name == "cmeel.prefix"), package)
    include = prefix / "include"
    required(include / "pinocchio" / "algorithm" / "aba.hpp", "pip install pin")
    required(include / "boost" / "variant.hpp", "pip install cmeel-boost")
    required(include / "eigen3" / "Eigen" / "Core", "pip install cmeel-eigen")
    return [f"-I{include}", f"-I{include / 'eigen3'}"]


def ways(tree: Tree) -> list[tuple[str, str, Any]]:
    """A base that does not move; else a free-flyer, and the robot's coordinates if they are others.

    Each is what it is called, its root, and the layout.
    """
    if tree.root == "fixed":
        return [("Pinocchio", "fixed", tree.layout)]
    is_flyer = tree.root == "quaternion"
    found = [("Pinocchio, free-flyer", "quaternion", tree.layout if is_flyer else free_flyer)]
    if not is_flyer:
        found.append(("Pinocchio, our coordinates", "xyz", tree.layout))
    return found


def loaded(tree: Tree, source: str, folder: Path, root: str) -> ctypes.CDLL:
    """A library of Pinocchio's algorithms, compiled once for all robots, which holds the model."""
    flags = ["-std=c++17", "-w", *headers()]
    name = Path(source).stem
    library = compiled(source, folder.parent / f"{name}.so", flags)
    copy = own_copy(library, folder / f"{name}_{root}.so")
    bodies = np.ascontiguousarray(tree.numbers())
    copy.pinocchio_load.argtypes = [c_void_p, c_long, c_double, c_int]
    copy.pinocchio_load(bodies.ctypes.data, len(bodies), tree.gravity, ROOTS.index(root))
    return copy


def pinocchio_contenders(tree: Tree, folder: Path) -> list[Contender]:
    """Pinocchio in each of its coordinates, both tasks."""
    found = []
    for name, root, layout in ways(tree):
        copy = loaded(tree, "pinocchio_peer.cpp", folder, root)
        found += [
            Contender(
                name,
                MASS_MATRIX_AND_RESIDUAL,
                1,
                function(copy, "pinocchio_mass_matrix_and_effects"),
                layout.inputs,
                layout.matrix_and_residual,
                function(copy, "pinocchio_fetch_mass_matrix_and_effects", 2),
            ),
            Contender(
                name,
                FORWARD_DYNAMICS,
                1,
                function(copy, "pinocchio_forward_dynamics"),
                layout.inputs,
                layout.accelerations,
                function(copy, "pinocchio_fetch_accelerations", 2),
            ),
        ]
    return found
