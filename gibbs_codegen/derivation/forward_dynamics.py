"""Forward dynamics in two ways, by articulated bodies and by M: each robot gets the shorter one.

The recursion's operations grow with n, those of factors of M with n³. Either way the unknowns are
the joint accelerations, the root's angular acceleration Ω (the sum of θ̈ times their axes) and the
base centre's acceleration, in the root's group frame, where nothing has to be projected. About its
centre the base is balanced, whatever the origin of the coordinates. A flying robot falls freely,
so gravity enters once, at the end: accelerations are relative to free fall.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import sympy as sp

from gibbs_codegen.derivation import tree_dynamics
from gibbs_codegen.derivation.articulated import (
    Articulation,
    accelerations_outward,
    articulated,
    root_in_group_frame,
)
from gibbs_codegen.derivation.forces import forces_of_wrenches, frame_loads, thrust_wrenches
from gibbs_codegen.derivation.inertia import ANGULAR, PAIRS, Inertia
from gibbs_codegen.derivation.motion import Acceleration, Motion, TreeState
from gibbs_codegen.derivation.passive import armatures, passive_forces
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.errors import SingularRobotError
from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.program.lower import operations
from gibbs_codegen.symbolic.ldlt import ZeroPivotError, operations_to_solve, solve_symmetric
from gibbs_codegen.symbolic.tape import Scalars, Vector
from gibbs_codegen.symbolic.vectors import NO_WRENCH, ZERO, Matrix, Wrench, minus, zeros

# Wrenches that act on segments of the reduced tree, by their index: about the joint, or the origin,
# in the segment's own frame (N, N m).
Acting = Callable[[SymbolicRobot], dict[int, Wrench]]
Dynamics = Callable[[SymbolicRobot, Acting], list[sp.Expr]]


def thrusts(symbolic: SymbolicRobot) -> dict[int, Wrench]:
    """Wrenches of the thrusts on segments."""
    return thrust_wrenches(symbolic, symbolic.bodies)


def thrusts_and_wrenches(symbolic: SymbolicRobot) -> dict[int, Wrench]:
    """Wrenches of the thrusts and those on the frames, by segments."""
    acting = thrusts(symbolic)
    for k, load in frame_loads(symbolic).items():
        with symbolic.tape.group("thrusts and wrenches together"):
            acting[k] = acting.get(k, NO_WRENCH).plus(symbolic.tape, load)
    return acting


def shorter_dynamics(
    imported: ImportedTape, symbolic: SymbolicRobot
) -> tuple[Dynamics, list[sp.Expr]]:
    """Articulated or factorised dynamics, whichever takes fewer operations, and a by it.

    It takes fewer with other wrenches too.
    """
    if not symbolic.robot.is_recursive:
        return factorised_dynamics, factorised_dynamics(symbolic)
    articulated = articulated_dynamics(symbolic)
    most = operations(imported, articulated)
    factorised = factorised_dynamics(symbolic, most=most)
    if not factorised or operations(imported, factorised) >= most:
        return articulated_dynamics, articulated
    return factorised_dynamics, factorised


def articulated_dynamics(symbolic: SymbolicRobot, acting: Acting = thrusts) -> list[sp.Expr]:
    """Accelerations a of M a = R + B u, by articulated bodies.

    Raises `SingularRobotError` where a joint moves nothing that has mass or inertia.
    """
    with refused_as_singular(symbolic):
        articulation = articulation_of(symbolic.centred, acting)
        root, joints = accelerations_outward(symbolic.tape, articulation)
    root = root_in_group_frame(symbolic.tape, articulation, root)
    return in_coordinates(symbolic, [joint.relative for joint in joints], root)


def articulation_of(centred: SymbolicRobot, acting: Acting = thrusts) -> Articulation:
    """The solved joints of a robot about its base centre, under forces besides gravity.

    Raises `ZeroPivotError` where a joint moves nothing that has mass or inertia.
    """
    loads = acting(centred)
    return articulated(
        centred.tape,
        centred.reduced_tree,
        free_motions_of(centred),
        loads.pop(0),
        _efforts(centred),
        armatures(centred),
        loads,
        [i for i in range(6) if (i + 3) % 6 not in centred.places.missing],
        centred.parameters.gravity,
    )


def factorised_dynamics(
    symbolic: SymbolicRobot, acting: Acting = thrusts, most: float = math.inf
) -> list[sp.Expr]:
    """Accelerations a of M a = R + B u, by LDLᵀ of M.

    There are none where LDLᵀ alone takes `most` operations or more. The translation is eliminated
    first, since its block of M is m·1₃. Raises `SingularRobotError` where a joint moves nothing
    that has mass or inertia.
    """
    tape, n = symbolic.tape, symbolic.joints
    if not symbolic.robot.base.moves_freely:
        return _by_whole_matrix(symbolic, acting, most)
    centred = symbolic.centred.ungeared
    inertia = tree_dynamics.joint_space_inertia(tape, centred.reduced_tree)
    with tape.group("mass matrix with the armature of the joints"):
        for j, armature in enumerate(armatures(centred)):
            inertia.entries[j, j] = tape.let(inertia.entries[j, j] + armature)
    inertia = _folded_inertia(symbolic, inertia)
    composite = inertia.composite
    with tape.group("mass matrix with the translation eliminated"):
        lightness = tape.let(1 / composite.mass)
        centre = tape.scale(lightness, composite.moment)
        light = [tape.scale(lightness, wrench.force) for wrench in inertia.wrenches]
        matrix = _without_translation(tape, inertia, centre, light)
    # Tip first: the last joint couples to all others, the root is left for the end.
    order = [*range(n - 1, -1, -1), n, n + 1, n + 2]
    if operations_to_solve(matrix, order) >= most:
        return []
    loads = acting(centred)
    thrust, motions = loads.pop(0), free_motions_of(centred)
    bias, rows = tree_dynamics.inward(tape, centred.reduced_tree, motions, loads)
    # The forces less velocity terms, as a wrench about the origin, and likewise for each joint.
    with tape.group("thrusts and joint torques less inertia forces"):
        thrust = thrust.rotated(tape, centred.root.segment_rotation)
        efforts = [tape.let(u - row) for u, row in zip(_efforts(centred), rows, strict=True)]
        efforts = symbolic.folded_joints(efforts) if symbolic.robot.is_geared else efforts
        drive = thrust.plus(tape, bias.opposite)
    with tape.group("driving forces with the translation eliminated"):
        right = [tape.let(e - tape.dot(light[i], drive.force)) for i, e in enumerate(efforts)]
        right.extend(_about(tape, drive, centre))
    with refused_as_singular(symbolic), tape.group("accelerations of joints and base, by LDL^T"):
        solution = solve_symmetric(tape, matrix, right, order)
    angular = tuple(solution[n:])
    with tape.group("acceleration of the base centre"):
        spin = tape.cross(angular, centre)
        shares = [[light[i][k] * solution[i] for i in range(n)] for k in range(3)]
        x, y, z = (
            tape.let(lightness * drive.force[k] - spin[k] - sp.Add(*shares[k])) for k in range(3)
        )
    return in_coordinates(symbolic, solution[:n], Acceleration((x, y, z), angular))


def _folded_inertia(
    symbolic: SymbolicRobot, inertia: tree_dynamics.JointSpaceInertia
) -> tree_dynamics.JointSpaceInertia:
    """Columns and entries of the coordinates, from those of all joints."""
    if not symbolic.robot.is_geared:
        return inertia
    fold, places = symbolic.folded_joints, range(len(inertia.wrenches))
    components = zip(*(wrench.entries for wrench in inertia.wrenches), strict=True)
    wrenches = map(Wrench.of, zip(*map(fold, components), strict=True))
    pairs = [[(min(i, j), max(i, j)) for j in places] for i in places]
    rows = [fold([inertia.entries.get(pair, sp.S.Zero) for pair in row]) for row in pairs]
    columns = enumerate(map(fold, zip(*rows, strict=True)))
    entries = {(i, j): entry for j, column in columns for i, entry in enumerate(column)}
    return tree_dynamics.JointSpaceInertia(inertia.composite, [*wrenches], entries)


def _by_whole_matrix(symbolic: SymbolicRobot, acting: Acting, most: float) -> list[sp.Expr]:
    """Accelerations by LDLᵀ of M of a base that does not move freely, as `factorised_dynamics`."""
    tape, root, geared = symbolic.tape, symbolic.root, symbolic
    symbolic = symbolic.ungeared
    tree, places = symbolic.reduced_tree, symbolic.places
    matrix = tree_dynamics.mass_matrix(tape, root, tree)
    with tape.group("mass matrix with the armature of the joints"):
        for place, armature in zip(places.joint_places, armatures(symbolic), strict=True):
            matrix[place][place] = tape.let(matrix[place][place] + armature)
    matrix = geared.folded_matrix(matrix)
    order = [*reversed(geared.places.joint_places), *places.base]
    if operations_to_solve(matrix, order) >= most:
        return []
    resting = symbolic.state.unaccelerated
    taken = tree_dynamics.generalised_inertia_forces(tape, root, tree, resting)
    active = forces_of_wrenches(symbolic, tree, acting(symbolic))
    efforts = dict(zip(places.joint_places, _efforts(symbolic), strict=True))
    with tape.group("thrusts and joint torques less inertia forces"):
        right = [
            tape.let(force - entry + efforts.get(place, sp.S.Zero))
            for place, (force, entry) in enumerate(zip(active, taken, strict=True))
        ]
    right = geared.folded(right)
    try:
        with tape.group("accelerations of joints and base, by LDL^T"):
            return solve_symmetric(tape, matrix, right, order)
    except ZeroPivotError as error:
        unresisted = geared.description.coordinate_text(error.unknown)
        raise SingularRobotError(symbolic.robot.name, [(unresisted,)]) from None


def _without_translation(
    tape: Scalars, inertia: tree_dynamics.JointSpaceInertia, centre: Vector, light: Sequence[Vector]
) -> Matrix:
    """Mass matrix of the joints and of the root's Ω about the centre of mass, without translation.

    Eliminating that couples joints of different branches too. `centre` is the centre of mass from
    the root, and `light` are forces of the joints' columns over the whole mass, both in its group
    frame.
    """
    n = len(light)
    matrix = zeros(n + 3, n + 3)
    for i, wrench in enumerate(inertia.wrenches):
        for j in range(i, -1, -1):
            entry = inertia.entries.get((j, i), sp.S.Zero)
            matrix[i][j] = matrix[j][i] = tape.less(entry, tape.dot(wrench.force, light[j]))
    for i, wrench in enumerate(inertia.wrenches):
        for k, entry in enumerate(_about(tape, wrench, centre)):
            matrix[i][n + k] = matrix[n + k][i] = entry
    # Second moments about the centre of mass: E − B₀ccᵀ, without mass or first moment.
    whole = inertia.composite
    second = [tape.let(whole.entry(i, j) - centre[i] * whole.moment[j]) for i, j in PAIRS]
    about_centre = Inertia(sp.S.Zero, ZERO, tuple(second))
    for k in range(3):
        for m, entry in enumerate(about_centre.response(tape, ANGULAR + k).moment):
            matrix[n + k][n + m] = entry
    return matrix


@contextmanager
def refused_as_singular(symbolic: SymbolicRobot) -> Iterator[None]:
    """Turn a `ZeroPivotError` into a `SingularRobotError` that names the unknown's coordinate.

    The joints come first, then Ω, then the position.
    """
    moved = symbolic.places
    base, _ = replace(moved, nothing=-1).split(range(moved.size))  # No pivot is of what is missing.
    places = [*moved.joint_places, *base]
    try:
        yield
    except ZeroPivotError as error:
        unresisted = symbolic.description.coordinate_text(places[error.unknown])
        raise SingularRobotError(symbolic.robot.name, [(unresisted,)]) from None


def in_coordinates(
    symbolic: SymbolicRobot, joints: list[sp.Expr], root: Acceleration
) -> list[sp.Expr]:
    """Accelerations in the order of v, by those of the joints and of the root.

    The root's are relative to free fall, in its group frame.
    """
    with symbolic.tape.group("acceleration of the origin from that of the base centre"):
        linear = at_origin(symbolic, root)
    base = symbolic.root.accelerations(symbolic.tape, linear, root.angular, symbolic.base_state)
    return symbolic.places.joined(base, joints)


def at_origin(symbolic: SymbolicRobot, centre: Acceleration) -> Vector:
    """Acceleration of the origin of the coordinates, from that of the base centre (m/s²).

    Both are in the root's group frame, that of the base centre relative to free fall.
    """
    tape, root = symbolic.tape, symbolic.root
    base, _ = TreeState.coasting(symbolic.v).split(symbolic.places)
    still = root.frame_motion(tape, base)
    still = still.spun(tape, root.segment_spin(base.rates), sp.S.Zero)
    omega_dot = tape.add(still.omega_dot, centre.angular)
    moved = Motion.of(tape, still.omega, omega_dot, centre.linear)
    return moved.stepped(tape, root.segment_rotation, minus(symbolic.centre)).acceleration


def free_motions_of(symbolic: SymbolicRobot) -> list[Motion]:
    """Motions without accelerations: the root's B₀r̈, which the recursions leave out, is zero."""
    return tree_dynamics.free_motions(
        symbolic.tape, symbolic.root, symbolic.reduced_tree, symbolic.v
    )


def _efforts(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Torques and forces of the joints, less those of dampers and springs."""
    pairs = zip(symbolic.efforts, passive_forces(symbolic), strict=True)
    with symbolic.tape.group("torques of the joints less those of dampers and springs"):
        return [symbolic.tape.let(effort + passive) for effort, passive in pairs]


def _about(tape: Scalars, wrench: Wrench, centre: Vector) -> Vector:
    """Moment of a wrench about `centre`."""
    return wrench.shifted(tape, minus(centre)).moment
