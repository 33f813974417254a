"""The map of the generator: from a robot file to a generated module, stage by stage.

    read_robot         robot file      → Robot, plain checked data       (robot/file)
    derive             Robot           → Model: the derivation, lowered  (derivation/derive)
      SymbolicRobot.of Robot           → symbols, root and chains        (derivation/symbolic_robot)
      reduced_system   chains          → M, R, B of the reduced system   (derivation/hybrid)
      hybrid_system    chains, M, R, B → I_H, R_H, B_H (coupling map)    (derivation/hybrid)
      ImportedTape     tape            → graph, for derivatives          (graph/from_tape)
      lower            graph, outputs  → Program: statements by stage    (program/lower)
    render_module      Model           → text of each file               (targets/registry)
    render_archives    Model           → FMUs, of sources compiled       (targets/fmu)
    refuse_wrong       text, Robot     → checks passed, or an error      (verification/verify)
    write_module       text            → generated/<name>/, or nothing   (files/module_writer)

Robot files are made from URDF, MJCF and SDF by exchange/importing, and exported by
exchange/exporting.

The other wing, `flight`, loads a generated module (runtime/load), reads a scenario
(flight/scenario/file) and flies it (flight/simulation); it knows nothing of the derivation.

Left of the program everything is a SymPy value; right of it everything is a string; right of
`generated/` everything is a float.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gibbs_codegen.arrays.functions import LEADING
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.files.module_writer import check_replaceable, differing_files, write_module
from gibbs_codegen.files.staging import check_output_folder
from gibbs_codegen.machine.laws import LAWS
from gibbs_codegen.program.choice import Derivatives, Functions, chosen_derivatives
from gibbs_codegen.program.model import Model, Progress
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.posture import closed_loops as closed_loops
from gibbs_codegen.runtime.c_library import announced
from gibbs_codegen.targets import registry
from gibbs_codegen.targets.c.laws import check_laws
from gibbs_codegen.targets.c.laws import tracking_law as tracking_law
from gibbs_codegen.verification.verify import refuse_wrong

StrPath = str | os.PathLike[str]


def generate(
    robot_file: StrPath,
    out: StrPath = "generated",
    targets: Sequence[str] = registry.DEFAULT_TARGETS,
    keep_zeros: bool = False,
    verify: bool = True,
    force: bool = False,
    derivatives: Derivatives = False,
    functions: Functions = None,
    laws: Sequence[str] = (),
) -> Path:
    """Generate the module of a robot file, or of a robot that ships: all of it, or nothing.

    Args:
        robot_file: Path of a robot file, or the name of a robot that ships.
        out: Folder of modules; the module is `out`/<name>.
        targets: What to emit.
        keep_zeros: Whether parameters that are zero in the file stay parameters.
        verify: Whether to check the functions first, in a moment, against Newton–Euler equations
            that share no code with the derivation, and with each other.
        force: Whether to rename a folder of the module that holds other or changed files, instead
            of refusing; the log `gibbs_codegen` has the name.
        derivatives: Which derivatives are there: with True all that are not long, or none of them;
            one name, or several; "all" stands for the long ones too.
        functions: Which other functions are there: names, or groups as "dynamics" and "hybrid";
            those by default if None, which "default" stands for too.
        laws: Which laws of control are written in C beside the functions, such as
            "computed_torque".

    Returns:
        The module's folder.

    Raises:
        RobotFileError: If the file is faulty.
        SingularRobotError: If the robot has a massless degree of freedom.
        UsageError: If there is no such robot, target, function or law, the robot's rotors do not
            serve a law, or the folder is refused.
        WrongModuleError: If a check fails.
        OutputError: If the module cannot be written.
    """
    robot, text = read_robot(os.fspath(robot_file))
    with announced(f"{robot.name}: deriving its equations, and writing its module"):
        return generate_robot(
            *(robot, text, out, targets, keep_zeros, _silent),
            *(verify, force, derivatives, functions, laws),
        )[1]


def _silent(step: str) -> None:
    """Report no progress."""


def generate_robot(
    robot: Robot,
    text: str,
    out: StrPath,
    targets: Sequence[str] = registry.DEFAULT_TARGETS,
    keep_zeros: bool = False,
    progress: Progress = _silent,
    verify: bool = True,
    force: bool = False,
    derivatives: Derivatives = False,
    functions: Functions = None,
    laws: Sequence[str] = (),
) -> tuple[Model, Path]:
    """Generate the module of a robot that has been read, and keep `text`, its file, in it.

    The rest is as of `generate`. Returns the derived model and the module's folder.
    """
    check_output_folder(out)
    folder = Path(out) / robot.name
    check_replaceable(folder, text, force)
    model, files = module_files(
        robot, text, targets, keep_zeros, progress, derivatives, functions, laws
    )
    if verify:
        if "numpy" in targets:
            readable = files
        else:  # Every target prints the same program.
            readable = registry.render_module(model, text, registry.find_targets(["numpy"]))
        refuse_wrong(robot, readable["numpy_module.py"], progress)
    progress("compiling")
    archives = registry.render_archives(model, text, registry.find_targets(targets))
    progress("writing")
    write_module(folder, {**files, **archives}, force, _options(model, targets))
    return model, folder


def check_robot(
    robot: Robot,
    text: str,
    out: StrPath,
    targets: Sequence[str] = registry.DEFAULT_TARGETS,
    keep_zeros: bool = False,
    progress: Progress = _silent,
    derivatives: Derivatives = False,
    functions: Functions = None,
    laws: Sequence[str] = (),
) -> tuple[Path, list[str]]:
    """The folder of a module, and names of its files that `generate` would write otherwise."""
    check_output_folder(out)
    folder = Path(out) / robot.name
    model, files = module_files(
        robot, text, targets, keep_zeros, progress, derivatives, functions, laws
    )
    archives = registry.render_archives(model, text, registry.find_targets(targets))
    return folder, differing_files(folder, {**files, **archives}, _options(model, targets))


def _options(model: Model, targets: Sequence[str]) -> str:
    """Options of a module's generation, for the manifest."""
    return " ".join(registry.generating_options(registry.find_targets(targets), model))


def module_files(
    robot: Robot,
    text: str,
    targets: Sequence[str],
    keep_zeros: bool,
    progress: Progress,
    derivatives: Derivatives = False,
    functions: Functions = None,
    laws: Sequence[str] = (),
) -> tuple[Model, dict[str, str]]:
    """Derive a robot, and render the files of its module by name.

    `keep_zeros` is whether parameters that are zero in the file stay parameters. Raises
    `SingularRobotError` if the robot has a massless degree of freedom, and `UsageError` if there is
    no such target, function or law, or the rotors do not serve a law.
    """
    emitted = registry.find_targets(targets)
    chosen = check_laws(laws, targets)
    names = [*registry.called(emitted, functions, chosen), *chosen_derivatives(derivatives)]
    if closed_loops(robot) and not LAWS.keys().isdisjoint(chosen):
        names += sorted(LEADING)
    model = replace(derive(robot, keep_zeros, progress, functions=names), laws=chosen)
    progress("rendering")
    return model, registry.render_module(model, text, emitted)
