"""Array programs: calls of emitted functions, vectors and matrices, written once.

A program is a few nodes: inputs, constants, calls of a module's functions, sums, products, parts.
NumPy, JAX and CasADi evaluate it as it stands, and its derivatives are programs again. The machine
`quadrotor` under a spring and a damper on each of its motions is

    robot = Functions(load(generate("quadrotor", derivatives=True)))
    q, v = robot.state()
    rest, gain = robot.coordinates("rest", uniform=True), variable("gain", uniform=True)
    force = gain * (robot.difference(q, rest) - v)
    acceleration = solve(robot.mass_matrix(q), robot.residual(q, v) + force)
    program = Program("spring", (q, v, rest, gain), {"acceleration": acceleration})

and `jacobian(program, ("gain",))` a program with one more result, `acceleration_by_gain`. Values
are those of one state; evaluation takes any number of states, in leading axes.
"""

from gibbs_codegen.arrays.backward import gradient
from gibbs_codegen.arrays.c_file import write_c
from gibbs_codegen.arrays.evaluation import evaluate, evaluate_casadi
from gibbs_codegen.arrays.forward import jacobian
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.matlab_text import write_matlab
from gibbs_codegen.arrays.nodes import (
    Node,
    Program,
    absolute,
    arctan2,
    choose,
    clip,
    constant,
    cosine,
    cross,
    dot,
    external,
    join,
    maximum,
    minimum,
    sine,
    solve,
    square_root,
    total,
    variable,
)

__all__ = [
    "Functions",
    "Node",
    "Program",
    "absolute",
    "arctan2",
    "choose",
    "clip",
    "constant",
    "cosine",
    "cross",
    "dot",
    "evaluate",
    "evaluate_casadi",
    "external",
    "gradient",
    "jacobian",
    "join",
    "maximum",
    "minimum",
    "sine",
    "solve",
    "square_root",
    "total",
    "variable",
    "write_c",
    "write_matlab",
]
