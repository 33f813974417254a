"""Models for acados: expressions of CasADi, or C that calls the module's functions and derivatives.

In C they are one file, which needs nothing but acados' headers.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from numbers import Real
from pathlib import Path
from types import ModuleType
from typing import Any

from gibbs_codegen.arrays.c_file import CFunction, c_files, opening
from gibbs_codegen.arrays.c_text import literal
from gibbs_codegen.arrays.evaluation import evaluate_casadi
from gibbs_codegen.arrays.forward import jacobian
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.files.line_breaks import broken
from gibbs_codegen.files.staging import writing
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.machine.transition import STEPS, Transition, steadied
from gibbs_codegen.runtime.c_library import c_files as module_files
from gibbs_codegen.runtime.c_library import module_texts, some_functions
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.programs import called

# Functions that a module needs for the discrete form, the last ones where the air acts on rotors.
DERIVATIVES = (
    *("forward_dynamics_derivatives", "integrate_derivatives"),
    *("inputs_of_derivatives", "actuator_rates_derivatives"),
    "constrained_forward_dynamics_derivatives",
    *("forward_dynamics_with_wrenches_derivatives", "frame_poses_derivatives"),
    *("frame_velocities_derivatives", "rotor_speeds_derivatives"),
)
FORMS = ("explicit", "implicit", "discrete")
_INCLUDE = re.compile(r'^#include "(\w+\.h)"\n', re.MULTILINE)


def acados_model(
    robot: ModuleType,
    form: str = "explicit",
    *,
    step: float | None = None,
    method: str | None = None,
    parameters: bool = False,
    lags: bool = False,
    constraints: Sequence[str] | None = None,
    folder: str | os.PathLike[str] | None = None,
) -> Any:
    """The dynamics of a robot for acados.

    The state x is q, but for angles of wheels, on which nothing depends, then v, and
    ACTUATOR_STATES where there are such; u are INPUTS, or COMMANDS where there are such. Of a
    quaternion x has the entries, of any length, so that x is the same in all forms, and no
    attitude out of reach. Derivatives by x are by these entries.

    Args:
        robot: What `load` returned, with any back end.
        form: "explicit", x' = f(x, u, p) for the integrator ERK, or "implicit", which inverts no
            mass matrix, f(x', x, u, p) = 0 for IRK, both in expressions of CasADi; or "discrete",
            which is a file of C, `<robot>_acados.c`, that calls the module's functions and
            derivatives, those that are `DERIVATIVES` of this Python module.
        step: The length of a step of the discrete form, s.
        method: That of the discrete form, "rk4", which it is if left out, or "euler", as the
            module's steps, or "trapezoidal", as `Predictive` predicts joints with dampers and
            servos; states of actuators go on with their rates at its start.
        parameters: Whether p are all PARAMETERS, in their order; if not, there is no p.
        lags: Whether thrusts, N, of rotors with TIME_CONSTANTS follow u, and end x, in the order of
            the rotors; if not, they are u at once. With actuators ACTUATOR_STATES do so always.
        constraints: Names of CONSTRAINTS that hold; loops of mechanisms if left out. Steps do not
            bring x back to where they are met, unless they have a frequency.
        folder: Where the file of the discrete form is written; the current one if left out.

    Returns:
        An `AcadosModel` with the robot's name.

    Raises:
        UsageError: Arguments are wrong, the form cannot have what acts on the robot, or CasADi or
            acados' package is missing.
        MissingFunctionError: The module was generated without functions that it needs.
        OutputError: The file cannot be written.
    """
    try:
        from acados_template import AcadosModel
    except ModuleNotFoundError:
        raise UsageError(
            "acados_model: the package acados_template is not installed; it is part of acados"
        ) from None
    if not isinstance(robot, ModuleType) or not hasattr(robot, "COORDINATES"):
        raise UsageError(f"acados_model: robot must be a module, not {printable(robot)}")
    module: Any = load(robot.__path__[0], "casadi")
    import casadi

    functions, names = Functions(module), [*getattr(module, "CONSTRAINTS", ())]
    held = [*getattr(module, "LOOPS", ())] if constraints is None else constraints
    active = tuple(float(name in held) for name in names)
    times = module.TIME_CONSTANTS if lags and not functions.driven else {}
    lagging = tuple([*module.INPUTS].index(name) for name in times)
    machine = Transition(functions, active, lagging, tuple(times.values()))
    # No implicit form has the forces of constraints, or of the air on rotors.
    forced = any(machine.active) or machine.machine.has_air
    forms = [x for x in FORMS if x != "implicit" or not forced]
    has_step, alone = form == "discrete", "in the discrete form, and left out in others"
    lengths = (isinstance(step, Real) and 0.0 < step < math.inf) if has_step else step is None
    methods, is_path = [*STEPS][: None if has_step else 0], isinstance(folder, str | os.PathLike)
    named = not isinstance(held, str) and all(x in names for x in held)
    wanted = {
        "form": (form in forms, f"{' or '.join(forms)} for {module.NAME}", form),
        "step": (lengths, f"above 0 s {alone}", step),
        "method": (method in [None, *methods], f"{' or '.join(STEPS)} {alone}", method),
        "constraints": (named, f"a list of {', '.join(names) or 'no names'}", held),
        "folder": (folder is None or (has_step and is_path), f"a path {alone}", folder),
    }
    for name, (is_right, words, value) in wanted.items():
        if not is_right:
            raise UsageError(f"acados_model: {name} must be {words}, not {printable(value)}")
    model = AcadosModel()
    model.name = name = module.NAME
    model.x, model.xdot = (casadi.SX.sym(x, machine.size) for x in ("x", "xdot"))
    model.u = casadi.SX.sym("u", functions.inputs)
    model.p = casadi.SX.sym("p", len(module.PARAMETERS) if parameters else 0)
    if step is not None:
        path = Path(folder or "") / f"{name}_acados.c"
        text = _source(module, machine, method or "rk4", float(step), parameters)
        with writing(path):
            path.write_text(text, encoding="utf-8")
        model.dyn_ext_fun_type, model.dyn_generic_source = "generic", str(path)
        model.dyn_disc_fun, model.dyn_disc_fun_jac = f"{name}_acados", f"{name}_acados_derivatives"
        return model
    symbols = zip(module.PARAMETERS, casadi.vertsplit(model.p), strict=parameters)
    constants = module.prepare(dict(symbols))
    inputs, robots = (
        {"x": model.x, machine.sent: model.u},
        ({"robot": module}, {"robot": constants}),
    )
    rates = evaluate_casadi(machine.rates(), inputs, *robots)
    if form == "explicit":
        model.f_expl_expr = rates["x_dot"]
        return model
    ends = [0, machine.entries, machine.entries + functions.space.velocities, machine.size]
    q, v, _ = casadi.vertsplit(model.x, ends)
    q_dot, a, others = casadi.vertsplit(model.xdot, ends)
    q = casadi.vertcat(q, casadi.SX(functions.space.coordinates - machine.entries, 1))
    force = module.inverse_dynamics(q, v, a, constants=constants)
    force -= module.input_matrix(q, constants=constants) @ rates["inputs"]
    q_rates, _, other_rates = casadi.vertsplit(rates["x_dot"], ends)
    model.f_impl_expr = casadi.vertcat(q_dot - q_rates, force, others - other_rates)
    return model


def _source(module: Any, machine: Transition, method: str, h: float, has_parameters: bool) -> str:
    """The file of a step of h, s: itself, and the functions of the module that it calls."""
    robot, name, stem = machine.robot, module.NAME, f"{module.NAME}_acados"
    after = replace(machine.step(method, h), name="acados_step")
    slopes = replace(jacobian(after, after.names), name="acados_slopes")
    functions = called([after, slopes])
    texts = module_texts(Path(module.__path__[0]), module_files(name, blocks=False))
    texts[f"{name}.c"] = some_functions(texts[f"{name}.c"], functions)
    programs = [CFunction(x, "") for x in (after, slopes)]
    sources = {x: text.decode() for x, text in texts.items()}
    sources |= c_files(robot, stem, f"A step of {name}.", programs, opening(robot))

    def whole(file: str) -> str:
        """A file with those that it includes, each once."""
        return _INCLUDE.sub(lambda match: whole(match[1]), sources.pop(file, ""))

    values, places = [*module.PARAMETERS.values()], [*module.PARAMETERS]
    chosen = ["for (int k = 0; k < NP; ++k) values[k] = ((const double *)p)[k];"]
    steady = steadied(module, h) if method == "trapezoidal" else {}
    for changed, (factor, least, shares) in steady.items():
        k, others = places.index(changed), {places.index(x): y for x, y in shares.items()}
        values[k] = max(factor * values[k], least) + sum(y * values[x] for x, y in others.items())
        chosen.append(f"values[{k}] = fmax({factor!r} * values[{k}], {least!r});")
        chosen += [f"values[{k}] += {y!r} * values[{x}];" for x, y in others.items()]
    numbers = module.in_numpy.prepare(dict(zip(places, values, strict=True)))
    if has_parameters:
        chosen += [f"{name}_init_constants(values, room);", "return room;"]
        chosen.insert(0, f"double values[{len(places)}];")
    else:
        chosen = [f"static const Constants values = {{{', '.join(map(literal, numbers))}}};"]
        chosen += ["(void)p, (void)room;", "return &values;"]
    lines = [
        '#include "blasfeo/include/blasfeo_d_aux.h"',
        '#include "blasfeo/include/blasfeo_d_aux_ext_dep.h"',
        '#include "acados/utils/external_function_generic.h"',
        "",
        f"#define MODULE(name) {name}_##name",
        f"enum {{ NX = {machine.size}, NU = {robot.inputs}, NP = {len(places)} }};",
        "",
        "static const Constants *constants_at(const void *p, Constants *room)",
        "{",
        *(f"    {line}" for line in chosen),
        "}",
    ]
    lines = [part for line in lines for part in broken(line)]
    return "\n".join([whole(f"{name}.c"), whole(f"{stem}.c"), *lines, "", c_source("acados.c")])
