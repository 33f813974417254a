"""The parser of the command line: every command with its arguments, each declared once.

Nothing here takes time to import, so that `--help` and wrong usage are answered at once.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn

from gibbs_codegen.errors import printable
from gibbs_codegen.figures import FORMATS
from gibbs_codegen.files.shipped import shipped_names
from gibbs_codegen.version import __version__

# Names that may stand before brackets in --vary; functions of `flight/distributions.py`.
DISTRIBUTIONS = ("uniform", "normal", "log_uniform", "scaled", "together")

_PLACES = (
    "a robot file, a generated module (its folder, or its name in generated/), or the name of a "
    "robot that ships"
)
_DERIVES = f"{_PLACES}; for a NAME, NAME.toml and a robot that ships go before a module"
_RUNS = f"{_PLACES}; for a NAME, a module goes before NAME.toml and a robot that ships"
_SCENARIOS = f"{', '.join(shipped_names('scenarios'))} or a scenario file"
_USUAL = "default: paper, or hold where the base does not fly freely"
_LOG = (
    "a ROS 1 or 2 bag, an MCAP file, a PX4 ULog or a folder of its CSV tables, or a file from a "
    "Crazyflie's memory card"
)
_FLIGHT = "a folder that `simulate` wrote, or its flight.npz"


class Parser(argparse.ArgumentParser):
    """A parser that wants options in full, and shows printably what it does not understand."""

    takes_named = False

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, **options)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; where they are taken, words NAME:=VALUE may stand anywhere, as in ROS."""
        named = [word for word in args or () if self.takes_named and ":=" in word]
        others = args if args is None else [word for word in args if word not in named]
        options, unknown = super().parse_known_args(others, namespace)
        if self.takes_named:
            options.arguments += named
        return options, unknown

    def error(self, message: str) -> NoReturn:
        """Print the usage and the message, and exit with 2."""
        super().error(printable(message, 400))

    def add(
        self, name: str, metavar: str | tuple[str, ...] | None, meaning: str, **settings: Any
    ) -> None:
        """Add an argument that has a value; its help states a default of one word or number."""
        if isinstance(default := settings.get("default"), str | int):
            meaning = f"{meaning} (default: {default})"
        self.add_argument(name, metavar=metavar, help=meaning, **settings)

    def flag(self, name: str, meaning: str, **settings: Any) -> None:
        """Add an option without a value."""
        self.add_argument(name, action="store_true", help=meaning, **settings)


def _add_robot(parser: Parser) -> None:
    """Add ROBOT, or --rotors and --links, to a command that derives."""
    parser.add("robot", "ROBOT", _DERIVES, nargs="?")
    family = "for a robot of the paper's family (its Table 1) instead of ROBOT"
    meaning = f"number of rotors, 2 to 256, {family}; requires --links"
    parser.add("--rotors", "N", meaning, type=int)
    parser.add("--links", "n", "number of arm links, 0 to 64; requires --rotors", type=int)


def _add_module(parser: Parser) -> None:
    """Add ROBOT to a command that runs a module."""
    which = "where there is no module, one is generated and not kept"
    parser.add("robot", "ROBOT", f"{_RUNS}; {which}")


def _add_choice(parser: Parser, meaning: str) -> None:
    """Add --functions and --derivatives to a command; their meaning there has {which} for them."""
    functions = (
        "these functions and groups (default, dynamics, hybrid, kinematics, energies, "
        "actuators, constraints, loads, passivity, tip, derivatives, parameters, steps), and "
        "the functions that they call"
    )
    derivatives = (
        "these derivatives too; without NAME: all but the Hessians, which are long; all: every "
        "one; none: no derivatives"
    )
    parser.add(
        *("--functions", "NAME,...", meaning.format(which=functions)),
        type=lambda names: names.split(","),
    )
    parser.add(
        *("--derivatives", "NAME,...", meaning.format(which=derivatives)),
        nargs="?",
        const=True,
        type=lambda names: True if not names else [] if names == "none" else names.split(","),
    )


def add_kept(parser: Parser) -> None:
    """Add the options that choose what is generated, which a module keeps."""
    targets = (
        "numpy, c, rollout (needs c), cuda, matlab, fmu or web; fmu:walls,drag adds walls and "
        "drag to the FMU"
    )
    meaning = f"what to write: {targets}; may be repeated (default: numpy and c)"
    parser.add("--target", "TARGET", meaning, action="append")
    parser.add_argument(
        "--all-parameters",
        action=argparse.BooleanOptionalAction,
        help="keep parameters that are zero in the robot file, so that they can be set at run time",
    )
    laws = (
        "control laws, momentum_observer, state_filter or imu_filter to write in C; none: no laws"
    )
    parser.add(
        *("--laws", "NAME,...", laws),
        type=lambda names: [] if names == "none" else names.split(","),
    )
    _add_choice(parser, "emit {which}")


def _add_json(parser: Parser | argparse._MutuallyExclusiveGroup) -> None:
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def _add_backend(parser: Parser) -> None:
    parser.add(
        *("--backend", None),
        "what computes: c, which is compiled once, or numpy, which also stands in where there "
        "is no C compiler",
        choices=("numpy", "c"),
        default="c",
    )


def _add_changes(parser: Parser, flights: str) -> None:
    """Add --set; `flights` says of which flights."""
    meaning = (
        f"replace an entry of the scenario{flights}, for example start.offset=[0.2,0,0]; may be"
    )
    parser.add("--set", "KEY=VALUE", f"{meaning} repeated", action="append", default=[])


def _add_names(parser: Parser) -> None:
    parser.add(
        *("--name", "KEY=NAME"),
        "the name in LOG of KEY: a coordinate, an input, a command, or a topic (of a bag: "
        "odometry, joints, inputs, imu, actuators; of a ULog: position, attitude, spin, imu); "
        "if the joint KEY stands still, NAME may be a number, its coordinate; may be repeated",
        action="append",
        default=[],
    )


def _add_figures(parser: Parser, without: str) -> None:
    """Add --format, or --no-figures, which leaves no format."""
    meaning = f"formats of the figures: {', '.join(FORMATS)} (default: {FORMATS[0]})"
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        "--format", metavar="NAME,...", help=meaning, type=_formats, default=FORMATS[:1]
    )
    group.add_argument("--no-figures", action="store_const", const=(), dest="format", help=without)


def _formats(text: str) -> list[str]:
    names = text.split(",")
    if unknown := [name for name in names if name not in FORMATS]:
        choices = ", ".join(FORMATS)
        raise argparse.ArgumentTypeError(f"unknown format {unknown[0]!r}; known: {choices}")
    return names


def _port(text: str) -> int:
    if not (text.isascii() and text.isdigit() and 1 <= int(text) <= 65535):
        raise argparse.ArgumentTypeError(f"{printable(text)}: a port is a number from 1 to 65535")
    return int(text)


def _number(text: str, what: str = "a finite number", least: float = -math.inf) -> float:
    with suppress(ValueError):
        if math.isfinite(value := float(text)) and value >= least:
            return value
    raise argparse.ArgumentTypeError(f"must be {what}, not {printable(text, 40)}")


def _prior(text: str) -> tuple[str, float]:
    name, equals, share = text.rpartition("=")
    number = share if not equals or (name and share) else text
    return name or "*", _positive(number, "SHARE or NAME=SHARE, above 0")


def _positive(text: str, what: str = "above 0") -> float:
    return _number(text, what, math.ulp(0.0))


def _not_negative(text: str) -> float:
    return _number(text, "0 or more", 0.0)


# Commands in the order of the help: the meaning, and what adds arguments.
_Adds = Callable[[Parser], None]
_COMMANDS: dict[str, tuple[str, _Adds]] = {}


def _command(meaning: str) -> Callable[[_Adds], _Adds]:
    """Make a command by the name of the function that adds its arguments."""

    def listed(adds: _Adds) -> _Adds:
        _COMMANDS[adds.__name__.removeprefix("_")] = meaning, adds
        return adds

    return listed


class _OfAttachment(argparse.Action):
    """Gathers --attach, and each option that follows, in a dictionary of that arm."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        if self.dest == "attach":
            namespace.attach = [*(namespace.attach or ()), {}]
        elif not namespace.attach:
            parser.error(f"{option_string} describes an attached arm; give --attach ARM before it")
        namespace.attach[-1][self.dest] = values


@_command("derive a robot's equations of motion and write its module")
def _generate(parser: Parser) -> None:
    _add_robot(parser)
    add_kept(parser)
    parser.add("--out", "DIR", "folder in which modules are written", default="generated")
    parser.flag(
        "--check",
        "write nothing; exit with 1 if the module on disk is not up to date",
    )
    parser.flag(
        "--force",
        "if the folder of the module holds files of yours or changed files, rename it and go on "
        "instead of stopping",
    )
    parser.flag("--no-verify", "write the module without checking its functions")
    parser.flag(
        "--compile",
        "compile now what flights need; otherwise the first flight compiles it",
    )


@_command("show a robot's base, chains, coordinates, motors and, on request, operation counts")
def _info(parser: Parser) -> None:
    _add_robot(parser)
    _add_json(parser)
    parser.flag(
        "--operations",
        "also derive the equations: show the hybrid system's rows, which chain fills each "
        "entry, and the operations of each function (of a module: those it has)",
    )
    _add_choice(parser, "as --operations, and also count {which}")


@_command("print the paper's equations of one chain as text or LaTeX")
def _show(parser: Parser) -> None:
    _add_robot(parser)
    meaning = "number of the chain in `gibbs-codegen info`"
    parser.add("--chain", "J", meaning, type=int, default=1)
    parser.add(
        *("--equation", "E"),
        "number of an equation of the paper: 2 (Gibbs function), 5 (its partial derivatives), 6 "
        "(the two vectors of a link), 15 (equations of motion) or 18 (hybrid system); may be "
        "repeated (default: 15 and 18)",
        action="append",
        type=int,
    )
    formats = ("text", "latex")
    parser.add("--format", None, "how to print the equations", choices=formats, default="text")


@_command("compare a module with independent formulations of the dynamics")
def _verify(parser: Parser) -> None:
    _add_module(parser)
    parser.add("--states", "K", "number of random states to compare at", type=int, default=20)
    parser.add("--seed", None, "seed of the states", type=int, default=0)
    meaning = "a back end to verify; may be repeated (default: both)"
    parser.add("--backend", None, meaning, choices=("numpy", "c"), action="append")
    either = parser.add_mutually_exclusive_group()
    either.add_argument("--rows", action="store_true", help="print every comparison")
    _add_json(either)


@_command("move a robot through a scenario, and write time series and figures")
def _simulate(parser: Parser) -> None:
    _add_module(parser)
    parser.add("--scenario", "NAME|FILE", f"the scenario: {_SCENARIOS} ({_USUAL})")
    parser.add("--out", "DIR", "folder in which the results are written", default="flight")
    _add_backend(parser)
    _add_changes(parser, "")
    _add_figures(parser, "write the time series only")
    meaning = "write an animation as well, in this format"
    parser.add("--animate", None, meaning, choices=("gif", "mp4"))


@_command("fly a scenario under an autopilot (software in the loop)")
def _sitl(parser: Parser) -> None:
    _add_module(parser)
    autopilots = parser.add_mutually_exclusive_group(required=True)
    for word, meaning in (
        ("px4", "PX4, in lockstep over MAVLink: TCP port 4560"),
        ("ardupilot", "ArduPilot, by its JSON interface: UDP port 9002"),
        ("betaflight", "Betaflight's SITL, by its own clock: UDP ports 9002 to 9004"),
    ):
        autopilots.add_argument(
            *(f"--{word}",), dest="autopilot", action="store_const", const=word, help=meaning
        )
    meaning = f"gives the motion of the arm, wind, loads and walls: {_SCENARIOS}"
    parser.add("--scenario", "NAME|FILE", meaning, default="hover")
    parser.add("--out", "DIR", "folder in which the results are written", default="flight")
    meaning = "greatest speed as a multiple of real time; 0: as fast as the autopilot follows"
    parser.add("--speed", "N", meaning, type=_not_negative, default=1)
    parser.add(
        *("--joints", None),
        "what moves the joints: the scenario, or the autopilot's servo outputs (after those of "
        "the rotors; -1 to 1 spans the limits of the joint)",
        choices=("scenario", "autopilot"),
        default="scenario",
    )
    meaning = "number of the autopilot's instance, which sets its ports"
    parser.add("--instance", "I", meaning, type=int, default=0)
    meaning = (
        "stick positions for Betaflight: in each line a time, s, and the channels' pulse widths, µs"
    )
    parser.add("--sticks", "FILE.csv", meaning)
    meaning = "address to listen at; 0.0.0.0 admits other machines"
    parser.add("--host", "ADDRESS", meaning, default="127.0.0.1")
    meaning = "seconds to wait for the autopilot before giving up"
    parser.add("--timeout", "S", meaning, type=_not_negative, default=30)
    _add_backend(parser)
    _add_changes(parser, "")
    _add_figures(parser, "write the time series only")


@_command("move robots through many variants of scenarios, and measure every flight")
def _sweep(parser: Parser) -> None:
    meaning = f"{_RUNS}; other robots get a module"
    parser.add("robots", "ROBOT", meaning, nargs="+")
    meaning = f"a scenario: {_SCENARIOS}; may be repeated ({_USUAL} of the first robot)"
    parser.add("--scenario", "NAME|FILE", meaning, action="append")
    parser.add(
        *("--vary", "KEY=VALUES"),
        "values of an entry of the scenario: a list such as 0.1,0.2, which is combined with the "
        f"lists of other keys, or a distribution ({', '.join(DISTRIBUTIONS)}) such as "
        "uniform(0.8,1.2); may be repeated",
        action="append",
        default=[],
    )
    meaning = "flights for each combination of values, with numbers drawn anew"
    parser.add("--samples", "N", meaning, type=int, default=1)
    parser.add("--seed", "N", "seed of the random numbers", type=int, default=0)
    _add_changes(parser, " in all flights")
    parser.add(
        *("--measure", "NAME=SERIES.STATISTIC"),
        "a number to take from each flight, such as worst=tip_error.max; may be repeated "
        "(default: worst and last errors of base centre and tip)",
        action="append",
        default=[],
    )
    meaning = "number of processes (default: one for each processor)"
    parser.add("--workers", "N", meaning, type=int)
    meaning = "folder for the results; the same command again continues an interrupted sweep"
    parser.add("--out", "DIR", meaning, default="sweep")
    _add_figures(parser, "draw no figures")


@_command("estimate parameters of a robot file from logs, with their standard deviations")
def _identify(parser: Parser) -> None:
    _add_module(parser)
    meaning = f"{_FLIGHT}, or {_LOG}; several logs are used together"
    parser.add("logs", "LOG", meaning, nargs="*", default=[])
    _add_names(parser)
    meaning = "part of LOG to use, s, such as the time in the air (default: all)"
    parser.add("--between", ("BEGIN", "END"), meaning, type=_number, nargs=2)
    parser.add(
        *("--free", "PATTERN"),
        "parameters to estimate, such as forearm_mass or '*_com_?'; rotors.drag is one number "
        "for all rotors, payload.LINK a load on a link; may be repeated (default: what a "
        "drawing does not tell, such as masses and dampings)",
        action="append",
        default=[],
    )
    meaning = (
        "standard deviation of the robot file's numbers, as a share of each (default: 0.3); or "
        "NAME=SHARE for some, such as base_mass=0.01; may be repeated"
    )
    parser.add("--prior", "SHARE", meaning, type=_prior, action="append", default=[])
    meaning = "share of each log, at its end, kept for testing the predictions (default: 0)"
    parser.add("--hold-out", "SHARE", meaning, type=_not_negative, default=0.0)
    meaning = "folder for robot file and report, which must not exist yet (default: identified)"
    parser.add("--out", "DIR", meaning)
    parser.add(
        *("--design", "FILE"),
        "read no LOG; write a scenario whose motion identifies the parameters, and print the "
        "expected standard deviations; FILE must not exist yet",
    )
    meaning = "scenario file with everything but the motion of --design (default: 12 s)"
    parser.add("--scenario", "FILE", meaning)
    meaning = "how far the motion of --design takes the base along each axis, m (default: 1)"
    parser.add("--room", "M", meaning, type=_positive)


@_command("write a flight as a log of ROS 2 or PX4")
def _log(parser: Parser) -> None:
    parser.add("flight", "FLIGHT", _FLIGHT)
    meaning = "mcap: a ROS 2 bag; csv: tables of PX4 topics"
    parser.add("--format", None, meaning, choices=("mcap", "csv"), default="mcap")
    meaning = "folder to write, which must not exist yet"
    parser.add("--out", "DIR", meaning, default="log")


@_command("convert a log of ROS, PX4 or a Crazyflie to a flight, with time series and figures")
def _replay(parser: Parser) -> None:
    _add_module(parser)
    parser.add("log", "LOG", _LOG)
    parser.add("--out", "DIR", "folder in which the results are written", default="flight")
    _add_names(parser)
    meaning = "samples per second (default: the times of LOG)"
    parser.add("--rate", "HZ", meaning, type=_number)
    meaning = "cut-off frequency of a low-pass filter without delay (default: no filter)"
    parser.add("--cutoff", "HZ", meaning, type=_number)
    meaning = "estimate the state by the sensors and the filter of this scenario"
    parser.add("--estimate", "NAME|FILE", meaning)
    _add_figures(parser, "write the time series only")


@_command("show a robot or a flight in the browser, live or as one file")
def _view(parser: Parser) -> None:
    parser.add("what", "ROBOT|FLIGHT", f"a robot, as for `simulate`; or {_FLIGHT}")
    meaning = "write one self-contained new HTML file instead of starting a server"
    parser.add("--html", "FILE", meaning)
    parser.add(
        "--port",
        "P",
        "port of the server; if it is taken, the next free one",
        type=_port,
        default=8080,
    )
    parser.flag("--no-browser", "do not open the browser")


@_command("reproduce the paper: its table, equations and figures, with residuals in digits")
def _paper(parser: Parser) -> None:
    meaning = "folder to write, which must not exist yet"
    parser.add("--out", "DIR", meaning, default="paper")


@_command("write one page on which a robot flies in any browser, by its own emitted C and law")
def _fly(parser: Parser) -> None:
    parser.add("robot", "ROBOT", _RUNS)
    parser.add("--html", "FILE", "page to write, which must not exist yet (default: ROBOT.html)")


@_command("write a commented robot file to start from")
def _new(parser: Parser) -> None:
    parser.add("file", "ROBOT.toml", "robot file to write, which must not exist yet")
    parser.flag(
        "--placed",
        "give rotors by radius, azimuth and tilt, and joints by position and axis (default, as "
        "in the paper: rods with a rotor at each end, and Denavit-Hartenberg parameters)",
    )
    meaning = "number of rotors (default: 4 with --placed, else 6)"
    parser.add("--rotors", "N", meaning, type=int)
    meaning = (
        "copy the file of a robot that ships, such as ur5e (an arm with a fixed base) or "
        "rover_arm (wheels)"
    )
    parser.add("--like", "ROBOT", meaning)


@_command("write a robot file from URDF, xacro, MJCF or SDF, or attach arms to a drone")
def _import(parser: Parser) -> None:
    extras = "xacro needs the extra xacro, and MJCF the extra mujoco"
    also = "with --attach also a robot file or the name of a robot that ships"
    parser.add("file", "FILE", f"a .urdf, .xacro, .xml or .sdf file; {extras}; {also}")
    meaning = "value of an <xacro:arg> of FILE, such as mass:=2.0"
    parser.add("arguments", "NAME:=VALUE", meaning, nargs="*")
    parser.takes_named = True
    parser.add(
        *("--attach", "ARM"),
        "file of an arm (a kind that FILE may be) to fix to the robot; may be repeated, each "
        "with its --on, --xyz, --rpy_deg and --prefix after it",
        action=_OfAttachment,
    )
    meaning = "link or frame that the arm is fixed to (default: the base)"
    parser.add("--on", "LINK", meaning, action=_OfAttachment)
    meaning = "position of the arm's root in the frame of LINK, m (default: 0 0 0)"
    parser.add("--xyz", ("X", "Y", "Z"), meaning, action=_OfAttachment, nargs=3, type=_number)
    meaning = (
        "roll, pitch and yaw of the arm's root in that frame, as in URDF, degrees (default: 0 0 0)"
    )
    parser.add("--rpy_deg", ("R", "P", "Y"), meaning, action=_OfAttachment, nargs=3, type=_number)
    meaning = "prefix for the names of the arm's links, joints and frames, such as left_"
    parser.add("--prefix", "NAME_", meaning, action=_OfAttachment)
    parser.add(
        *("--rotors", "ROTORS"),
        "file with the rotors, which replace those found in FILE: TOML with [[rotor]] tables as "
        "in a robot file (`on` is a link of FILE), or a platform file of eagle_mpc in YAML",
    )
    parser.add(
        *("--command", None),
        "command of Gazebo motors in FILE: a thrust (default), or a speed as in Gazebo, with "
        "their time constants and hub drag",
        choices=("thrust", "speed"),
    )
    parser.add(
        *("--attitude", "WORD"),
        "attitude of the base: quaternion (default), or a sequence of angles such as xyz",
    )
    parser.add(
        *("--base", "MOTION|LINK"),
        "motion of the base: free, fixed, planar, upright, or a list such as x,z,pitch "
        "(default: that of FILE, else free); or the name of the base link (default: the root of "
        "FILE); may be given twice, for both",
        action="append",
        default=[],
    )
    meaning = "robot file to write (default: NAME.toml)"
    parser.add("--out", "ROBOT.toml", meaning)
    meaning = "fix a joint at 0 or at VALUE, rad or m; may be repeated"
    parser.add("--lock", "JOINT[=VALUE]", meaning, action="append", default=[])
    parser.flag(
        "--no-snap",
        "keep all digits; otherwise angles within 2e-5 rad of a multiple of 15 degrees become "
        "that multiple, and rounding errors become 0",
    )
    parser.flag("--friction", "import the dry friction of joints")
    parser.flag("--force", "replace ROBOT.toml if it exists")


@_command("write a robot as URDF, MJCF or SDF, or as parameters of an autopilot")
def _export(parser: Parser) -> None:
    parser.add("robot", "ROBOT", _RUNS)
    kinds = ("urdf", "mjcf", "sdf", "px4", "ardupilot")
    parser.add("--format", None, "format of the file", choices=kinds, required=True)
    meaning = "file to write (default: NAME.urdf, .xml, .sdf or .param; for PX4 22000_NAME)"
    parser.add("--out", "FILE", meaning)
    parser.flag("--force", "replace FILE if it exists")


@_command("print the JSON schema of robot or scenario files, for completion in editors")
def _schema(parser: Parser) -> None:
    parser.add("file", None, "kind of file", choices=("robot", "scenario"))


def argument_parser() -> Parser:
    """Parser of the command line; `module` of what it returns is that of the command."""
    whole = Parser(
        prog="gibbs-codegen",
        description="Derive the equations of motion of robots with arms, flying or on the ground, "
        "and write them as fast functions in NumPy and C.",
    )
    whole.add_argument("--version", action="version", version=f"gibbs_codegen {__version__}")
    commands = whole.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name, (meaning, add_arguments) in _COMMANDS.items():
        parser = commands.add_parser(name, help=meaning)
        parser.set_defaults(module="import_robot" if name == "import" else name)
        add_arguments(parser)
    return whole
