"""Archives of FMUs: descriptions, sources, and a library for the machine at hand.

One library has the functions of FMI 3.0 and 2.0, so that both archives hold the same sources.
"""

from __future__ import annotations

import hashlib
import io
import logging
import platform
import sys
import uuid
import zipfile
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from gibbs_codegen.arrays.c_file import CFunction, c_files
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.templating import render
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.machine.first_order import System
from gibbs_codegen.program.choice import chosen_functions
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.layout import frames_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.placement import mounted_rotors
from gibbs_codegen.robot.posture import robot_frames
from gibbs_codegen.runtime.c_library import RUNTIME, CompilerError, portable_library
from gibbs_codegen.runtime.cache import CacheError
from gibbs_codegen.targets.c import target as c_target
from gibbs_codegen.targets.c.target import in_braces
from gibbs_codegen.targets.fmu.variables import STEP, Variable, base_units, variables_of
from gibbs_codegen.targets.printers import Context, CPrinter, Lines
from gibbs_codegen.version import __version__

# What its programs call, where the robot has it, and what else they do by what is to act.
_CALLED = (
    "forward_dynamics_with_wrenches",
    "forward_dynamics_with_wrenches_jvp",
    "frame_poses",
    *(f"frame_velocities{y}" for y in ("", "_derivatives")),
    *(f"frame_bias_accelerations{y}" for y in ("", "_derivatives")),
    *(f"joint_wrenches_with_wrenches{y}" for y in ("", "_jvp")),
    *(f"{x}{y}" for x in ("inputs_of", "actuator_rates") for y in ("", "_derivatives")),
    *(f"rotor_speeds{y}" for y in ("", "_derivatives")),
)
_ACTING = {
    "walls": ("kinetic_energy", "potential_energy", "inverse_dynamics", "forward_dynamics"),
    "constraints": (
        *(f"constrained_forward_dynamics{y}" for y in ("", "_derivatives")),
        *(f"impact{y}" for y in ("", "_derivatives")),
        *("forward_dynamics", "forward_dynamics_jvp"),
    ),
}
# Folders of libraries by system and processor: those of FMI 3.0, and those of 2.0 that there are.
_FOLDERS = {
    ("linux", "x86_64"): ("x86_64-linux", "linux64"),
    ("linux", "aarch64"): ("aarch64-linux", ""),
    ("darwin", "x86_64"): ("x86_64-darwin", "darwin64"),
    ("darwin", "arm64"): ("aarch64-darwin", ""),
}
_CAUSALITY = {
    "state": 'causality="local" variability="continuous" initial="exact"',
    "rate": 'causality="local" variability="continuous"',
    "input": 'causality="input" variability="continuous"',
    "figure": 'causality="parameter" variability="tunable"',
    "step": 'causality="parameter" variability="tunable"',
    "parameter": 'causality="parameter" variability="tunable"',
    "output": 'causality="output" variability="continuous"',
}
# Archives keep no time, so that they are the same whenever they are made.
_TIME = (1980, 1, 1, 0, 0, 0)

_log = logging.getLogger("gibbs_codegen")


def called(acting: Iterable[str] = ()) -> tuple[str, ...]:
    """Names of the functions that an FMU calls in which some of `ACTING` acts."""
    return (*_CALLED, *(name for part in acting for name in _ACTING.get(part, ())))


def archives(model: Model, header: Lines, acting: tuple[str, ...] = ()) -> dict[str, bytes]:
    """The FMUs of a model by the names of their files: of FMI 3.0, and of FMI 2.0.

    `acting` are some of `ACTING`. Raises `UsageError` for constraints that there are not.
    """
    name = model.robot.name
    carried = {f"frame {frame.name}": frame.on for frame in model.robot.frames}
    carried |= {f"rotor {k}": x.on for k, x in enumerate(model.robot.thrusters, start=1)}
    of_wheels = [part for part, on in carried.items() if on in model.robot.wheels]
    if of_wheels:
        raise UsageError(
            f"--target fmu: {of_wheels[0]} of {name} turns with a wheel, and FMUs have no "
            f"derivatives by angles of wheels; leave out fmu, or {of_wheels[0]}"
        )
    if "constraints" in acting and model.robot.base.drive:
        raise UsageError(
            f"--target fmu:constraints: constraints of {name} have no derivatives, because its "
            "base has a drive; leave constraints out"
        )
    if "constraints" in acting and not model.lists.get("CONSTRAINTS"):
        raise UsageError(
            f"--target fmu:constraints: {name} has no [[constraint]]; leave constraints out"
        )
    model = _reduced(model, acting)
    times = {} if model.robot.has_actuators else model.description.constants["TIME_CONSTANTS"]
    places = {entry.name: place for place, entry in enumerate(model.description.inputs)}
    lags = {places[k]: time for k, time in times.items()}
    spins = _spins(model.robot, model.description)
    wheels = sum(link.rolling is not None for link in model.robot.links)
    system = System(Functions(model.listing), lags, *spins, acting, wheels)
    module = c_target.module_text(model, CPrinter(), header, blocks=False)
    module |= {"patterns": [], "sparse": []}
    programs = [CFunction(program, words) for words, program in system.programs().items()]
    sources = {
        RUNTIME: render("c_runtime.h.jinja", module),
        f"{name}.h": render("c_header.h.jinja", module),
        f"{name}.c": render("c_source.c.jinja", module),
        **c_files(system.robot, f"{name}_system", f"{name} as a system.", programs, header),
    }
    variables = variables_of(model, system)
    token = _token([*sources.values(), *map(str, variables)])
    context = {"name": name, "header": header, "token": token, **_numbers(variables)}
    sources[f"{name}_fmu.c"] = render("fmu_source.c.jinja", context)
    context |= {"sources": [file for file in sources if file.endswith(".c")]}
    context |= _described(model, variables)
    files = {f"sources/{file}": text.encode() for file, text in sources.items()}
    first, second = _libraries(name, sources)
    build = render("fmi3_build.xml.jinja", context).encode()
    return {
        f"{name}.fmu": _archive(
            {
                "modelDescription.xml": render("fmi3_model.xml.jinja", context).encode(),
                **files,
                "sources/buildDescription.xml": build,
                **first,
            }
        ),
        f"{name}_fmi2.fmu": _archive(
            {
                "modelDescription.xml": render("fmi2_model.xml.jinja", context).encode(),
                **files,
                **second,
            }
        ),
    }


def _spins(
    robot: Robot, description: Description
) -> tuple[tuple[tuple[int, int], ...], tuple[tuple[float, ...], ...]]:
    """Rotor and frame of each that spins, and its axis in the frame with its momentum.

    Raises `UsageError` for a rotor on a link that has no frame.
    """
    spins, momenta, rotors = [], [], mounted_rotors(robot)
    posed, names = robot_frames(robot, description.layout.neutral), description.constants["SPINS"]
    for k, entry in enumerate(description.inputs):
        if entry.name not in names:
            continue
        carrier = robot.rigid[rotors[k].on]
        frames = [x.name for x in frames_of(robot) if robot.rigid[x.on] == carrier]
        if not frames:
            raise UsageError(
                f"{robot.name}: rotor {k + 1} has a spin_inertia, but no frame moves with it: add "
                "a [[frame]] on the link that carries it"
            )
        axis = posed.named[frames[0]].axes.T @ posed.thrusts[k]
        spins.append((k, [*posed.named].index(frames[0])))
        momenta.append((*axis.tolist(), names[entry.name]))
    return tuple(spins), tuple(momenta)


def _reduced(model: Model, acting: tuple[str, ...]) -> Model:
    """A model with the functions that an FMU calls."""
    rolling = ("coordinate_rates",) * bool(model.robot.wheels)
    chosen = {*chosen_functions((*called(acting), *rolling))}
    pairs = [(function, s.name) for function, s in model.derived if s.name in chosen]
    functions, names = zip(*pairs, strict=True)
    program = replace(model.program, functions=functions)
    return replace(model, functions=names, program=program, laws=())


def _token(texts: Iterable[str]) -> str:
    """A mark that tells one model from another."""
    digest = hashlib.sha256("\n".join(texts).encode()).digest()
    return f"{{{uuid.UUID(bytes=digest[:16])}}}"


def _numbers(variables: Sequence[Variable]) -> Context:
    """Context of the source: how many values there are, starts, lengths."""
    sizes, start, lengths = Counter[str](), ["0.0"], ["1"]
    places, gravity = {x.name: x.place for x in variables}, "parameters.gravity"
    for variable in variables:
        sizes[variable.kind] += variable.size
        lengths += [str(variable.size), *["0"] * (variable.size - 1)]
        if variable.kind != "output":
            start += map(repr, variable.start or (0.0,) * variable.size)
    return {
        "states": sizes["state"],
        "inputs": sizes["input"] + sizes["figure"],
        "parameters": sizes["parameter"],
        "outputs": sizes["output"],
        "gravity": f"values[{places[gravity]}]" if gravity in places else "0.0",
        "holds": places.get("active", 0),
        "eases": places.get("wall.bristle_damping", 0),
        "start": in_braces(start),
        "lengths": in_braces(lengths),
        "source": "\n".join(map(c_source, ("fmu.c", "fmi3.c", "fmi2.c"))),
    }


def _described(model: Model, variables: Sequence[Variable]) -> Context:
    """Context of the descriptions."""
    numbers = [entry for variable in variables for entry in variable.entries]
    units = base_units(["s", *(variable.unit for variable in variables)])
    return {
        "version": __version__,
        "words": _quoted(f"Dynamics of {model.robot.name}: SI units, world axes with z up"),
        "step": STEP,
        "units": [{"name": unit, "base": _base_unit(base)} for unit, base in units.items()],
        "arrays": [
            {
                "attributes": f"{_attributes(variable)} {_real(variable, variable.of)}",
                "lengths": [len(axis) for axis in variable.axes],
            }
            for variable in variables
        ],
        "numbers": [
            {"attributes": _attributes(entry), "real": _real(entry, entry.of)} for entry in numbers
        ],
        **{
            f"{form}_{kind}s": [variable.place for variable in listed if variable.kind == kind]
            for form, listed in (("array", variables), ("number", numbers))
            for kind in ("rate", "output")
        },
    }


def _quoted(text: str) -> str:
    """The value of an attribute."""
    from xml.sax.saxutils import quoteattr  # Late: it imports what reads from networks.

    return quoteattr(text)


def _attributes(variable: Variable) -> str:
    """Attributes that both versions have alike."""
    return (
        f'name={_quoted(variable.name)} valueReference="{variable.place}" '
        f"{_CAUSALITY[variable.kind]} description={_quoted(variable.words)}"
    )


def _real(variable: Variable, of: int) -> str:
    """Attributes that belong to numbers: unit, values at the start, and of a rate its state."""
    attributes = f'unit="{variable.unit}"'
    if variable.start:
        attributes += f' start="{" ".join(map(repr, variable.start))}"'
    return f'{attributes} derivative="{of}"' if variable.kind == "rate" else attributes


def _base_unit(exponents: Mapping[str, int] | None) -> str:
    if exponents is None:
        return ""
    powers = "".join(f' {unit}="{power}"' for unit, power in exponents.items())
    return f"<BaseUnit{powers}/>"


def _libraries(name: str, sources: Mapping[str, str]) -> tuple[dict[str, bytes], dict[str, bytes]]:
    """The library in the places that FMI 3.0 and 2.0 have for it; none where none can be made."""
    folders = _FOLDERS.get((sys.platform, platform.machine()))
    if folders is None:
        _log.warning("%s: the FMUs contain sources only: FMI has no name for this platform", name)
        return {}, {}
    try:
        library = portable_library(name, sources).read_bytes()
    except (CompilerError, CacheError) as error:
        _log.warning("%s: the FMUs contain sources only: %s", name, error)
        return {}, {}
    ending = "dylib" if sys.platform == "darwin" else "so"
    first, second = (
        {f"binaries/{folder}/{name}.{ending}": library} if folder else {} for folder in folders
    )
    return first, second


def _archive(files: Mapping[str, bytes]) -> bytes:
    room = io.BytesIO()
    with zipfile.ZipFile(room, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            info = zipfile.ZipInfo(name, _TIME)
            info.external_attr = 0o100644 << 16  # A plain file, for all to read.
            archive.writestr(info, content, zipfile.ZIP_DEFLATED)
    return room.getvalue()
