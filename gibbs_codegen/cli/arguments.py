"""The parser of the command line: every command with its arguments, each declared once.

Nothing here takes time to import, so that `--help` and wrong usage are answered at once.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any, NoReturn

from gibbs_codegen.errors import printable
from gibbs_codegen.figures import FORMATS
from gibbs_codegen.files.shipped import shipped_names
from gibbs_codegen.version import __version__

# Names that may stand before brackets in --vary; the functions of these names in `sweeps.cases`.
DISTRIBUTIONS = ("uniform", "normal", "log_uniform", "scaled", "together")

_PLACES = (
    "a robot file, the name of a robot that ships, or a generated module, given by its folder or "
    "by its name in generated/"
)
_DERIVES = f"{_PLACES}; if a name is both, the robot that ships is taken"
_SCENARIOS = f"{', '.join(shipped_names('scenarios'))} or a scenario file"
_USUAL = "default: paper, or hold where the base does not fly freely"
_LOG = (
    "a bag of ROS 1 or 2, an MCAP file, a ULog, a folder with tables of one, or a file of a "
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
        """Add an argument that has a value; a default of one word or number is told."""
        if isinstance(default := settings.get("default"), str | int):
            meaning = f"{meaning} (default: {default})"
        self.add_argument(name, metavar=metavar, help=meaning, **settings)

    def flag(self, name: str, meaning: str, **settings: Any) -> None:
        """Add an option without a value."""
        self.add_argument(name, action="store_true", help=meaning, **settings)


def _add_robot(parser: Parser) -> None:
    """Add ROBOT, or --rotors and --links, to a command that derives."""
    parser.add("robot", "ROBOT", _DERIVES, nargs="?")
    family = "of a member of the paper's family, whose base arms and links are those of its Table 1"
    meaning = f"number of rotors, 2 to 256, {family}; requires --links"
    parser.add("--rotors", "N", meaning, type=int)
    parser.add("--links", "n", "number of links of its arm, 0 to 64; requires --rotors", type=int)


def _add_module(parser: Parser) -> None:
    """Add ROBOT to a command that runs a module."""
    which = "if a name is both, the module is taken; if there is no module, one is generated"
    parser.add("robot", "ROBOT", f"{_PLACES}; {which} and not kept")


def _add_choice(parser: Parser, meaning: str) -> None:
    """Add --functions and --derivatives to a command; their meaning there has {which} for them."""
    functions = (
        "the functions of those names and groups (default, dynamics, hybrid, kinematics, energies, "
        "actuators, constraints, loads, passivity, tip, derivatives, parameters, steps), with what "
        "they are composed of"
    )
    derivatives = (
        "the derivatives of those names, too, or without a name all but the Hessians, which are "
        "long; the name all stands for every one, none for none"
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
        "numpy, c, rollout, which needs c, cuda, matlab, fmu, or web; fmu:walls,drag names what "
        "acts in it"
    )
    meaning = f"a target to emit: {targets}; may be repeated (default: numpy and c)"
    parser.add("--target", "TARGET", meaning, action="append")
    parser.add_argument(
        "--all-parameters",
        action=argparse.BooleanOptionalAction,
        help="keep parameters that are zero in the robot file, so that they can be changed at run "
        "time",
    )
    laws = "laws of control, momentum_observer, state_filter and imu_filter, to write in C; or none"
    parser.add(
        *("--laws", "NAME,...", laws),
        type=lambda names: [] if names == "none" else names.split(","),
    )
    _add_choice(parser, "emit {which}")


def _add_json(parser: Parser) -> None:
    parser.flag("--json", "print JSON instead of tables")


def _add_backend(parser: Parser) -> None:
    parser.add(
        *("--backend", None),
        "back end to compute with; c is compiled once, and replaced by numpy if that is not "
        "possible",
        choices=("numpy", "c"),
        default="c",
    )


def _add_changes(parser: Parser, flights: str) -> None:
    """Add --set; `flights` says of which flights."""
    meaning = f"replace an entry of the scenario{flights}, such as start.offset=[0.2,0,0]; may be"
    parser.add("--set", "KEY=VALUE", f"{meaning} repeated", action="append", default=[])


def _add_names(parser: Parser) -> None:
    parser.add(
        *("--name", "KEY=NAME"),
        "what LOG calls a coordinate, an input or a command, or one of the topics odometry, "
        "joints, inputs, imu, actuators of a bag or position, attitude, spin, imu of a ULog; or "
        "the number at which a joint stands; may be repeated",
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


def _number(text: str) -> float:
    try:
        if math.isfinite(value := float(text)):
            return value
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"must be a finite number, not {printable(text, 40)}")


def _not_negative(text: str) -> float:
    if (value := _number(text)) >= 0.0:
        return value
    raise argparse.ArgumentTypeError(f"must be 0 or more, not {printable(text, 40)}")


# Of each command, in the order of the help, its meaning and what adds its arguments.
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
            parser.error(f"{option_string} says something of an arm: give --attach ARM before it")
        namespace.attach[-1][self.dest] = values


@_command("derive a robot's equations of motion and write its module")
def _generate(parser: Parser) -> None:
    _add_robot(parser)
    add_kept(parser)
    parser.add("--out", "DIR", "folder in which modules are written", default="generated")
    parser.flag(
        "--check",
        "write nothing, and exit with 1 if the module on disk differs from what would be written",
    )
    parser.flag(
        "--force",
        "if the module's folder holds files that were not generated, or were changed since, keep "
        "it under another name instead of refusing",
    )
    parser.flag("--no-verify", "write the module without checking its functions first")
    parser.flag(
        "--compile",
        "compile the functions that flights need, side by side, so that the first does not wait "
        "for them; left out, it does that when it begins",
    )


@_command("show a robot's base, chains, coordinates and motors; on request operation counts")
def _info(parser: Parser) -> None:
    _add_robot(parser)
    _add_json(parser)
    parser.flag(
        "--operations",
        "also derive the equations: rows of the hybrid system, which chain fills its entries, and "
        "the operations of each function, of a module those that it has",
    )
    _add_choice(parser, "as --operations, and count those of {which}")


@_command("print the paper's equations of one chain as text or LaTeX")
def _show(parser: Parser) -> None:
    _add_robot(parser)
    meaning = "number of the chain, as `info` lists them (default: 1)"
    parser.add("--chain", "J", meaning, type=int, default=1)
    parser.add(
        *("--equation", "E"),
        "number of an equation: 2 (Gibbs function), 5 (its partial derivatives), 6 (the two "
        "vectors of a link), 15 (equations of motion) or 18 (places in the hybrid system); may be "
        "repeated (default: 15 and 18)",
        action="append",
        type=int,
    )
    formats = ("text", "latex")
    parser.add("--format", None, "how to print the equations", choices=formats, default="text")


@_command("compare a module with formulations that share no code with the derivation")
def _verify(parser: Parser) -> None:
    _add_module(parser)
    parser.add("--states", "K", "number of random states to compare at", type=int, default=20)
    parser.add("--seed", None, "seed of the states", type=int, default=0)
    meaning = "a back end to verify; may be repeated (default: both)"
    parser.add("--backend", None, meaning, choices=("numpy", "c"), action="append")
    _add_json(parser)


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


@_command("fly a scenario under an autopilot, in step with it")
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
    meaning = f"motion of the arm, wind, loads and walls: {_SCENARIOS}"
    parser.add("--scenario", "NAME|FILE", meaning, default="hover")
    parser.add("--out", "DIR", "folder in which the results are written", default="flight")
    meaning = "seconds to fly in a second at most; 0: as fast as the autopilot follows"
    parser.add("--speed", "N", meaning, type=_not_negative, default=1)
    parser.add(
        *("--joints", None),
        "what moves the joints: the scenario, or servo outputs of the autopilot after those of the "
        "rotors, from -1 to 1 over the limits of each joint",
        choices=("scenario", "autopilot"),
        default="scenario",
    )
    meaning = "number of the autopilot's instance, which its ports depend on"
    parser.add("--instance", "I", meaning, type=int, default=0)
    meaning = "lines of a time and pulse widths of channels, which Betaflight is told as sticks"
    parser.add("--sticks", "FILE.csv", meaning)
    meaning = "address to listen at; other machines reach 0.0.0.0"
    parser.add("--host", "ADDRESS", meaning, default="127.0.0.1")
    meaning = "seconds that the autopilot may be silent, at first as well"
    parser.add("--timeout", "S", meaning, type=_not_negative, default=30)
    _add_backend(parser)
    _add_changes(parser, "")
    _add_figures(parser, "write the time series only")


@_command("move robots through many variants of scenarios, and measure every flight")
def _sweep(parser: Parser) -> None:
    meaning = f"{_PLACES}, which comes first; of others a module is generated"
    parser.add("robots", "ROBOT", meaning, nargs="+")
    meaning = f"a scenario: {_SCENARIOS}; may be repeated ({_USUAL}, as the first robot does)"
    parser.add("--scenario", "NAME|FILE", meaning, action="append")
    parser.add(
        *("--vary", "KEY=VALUES"),
        "what an entry of the scenario takes on: values with commas between them, which cross with "
        f"those of other keys, or one of {', '.join(DISTRIBUTIONS)} of numbers in brackets, such "
        "as uniform(0.8,1.2); may be repeated",
        action="append",
        default=[],
    )
    meaning = "how many times numbers are drawn for each combination of values"
    parser.add("--samples", "N", meaning, type=int, default=1)
    parser.add("--seed", "N", "of what is drawn", type=int, default=0)
    _add_changes(parser, " in all flights")
    parser.add(
        *("--measure", "NAME=SERIES.STATISTIC"),
        "what is measured of a flight, such as worst=tip_error.max; may be repeated (default: "
        "worst and last errors of base centre and tip)",
        action="append",
        default=[],
    )
    meaning = "processes that compute (default: one for each processor)"
    parser.add("--workers", "N", meaning, type=int)
    meaning = "folder in which the results are kept; the same command goes on with what is there"
    parser.add("--out", "DIR", meaning, default="sweep")
    _add_figures(parser, "draw no figures")


@_command("find numbers of a robot file from logs, with deviations and what logs cannot tell")
def _identify(parser: Parser) -> None:
    _add_module(parser)
    meaning = f"{_FLIGHT}, or {_LOG}; several are taken together"
    parser.add("logs", "LOG", meaning, nargs="*", default=[])
    _add_names(parser)
    meaning = "seconds of LOG that are taken, such as those in the air (default: all)"
    parser.add(
        "--between", ("BEGIN", "END"), meaning, type=_number, nargs=2, default=(0.0, math.inf)
    )
    parser.add(
        *("--free", "PATTERN"),
        "parameters that are free, such as forearm_mass or '*_com_?', and rotors.drag of all "
        "rotors alike, payload.LINK of a load; may be repeated (default: all but lengths and "
        "places of frames)",
        action="append",
        default=[],
    )
    meaning = "deviation of numbers from the robot file, as a share (default: 0.3)"
    parser.add("--prior", "SHARE", meaning, type=_number, default=0.3)
    meaning = "share of each log, at its end, that is predicted instead (default: 0)"
    parser.add("--hold-out", "SHARE", meaning, type=_not_negative, default=0.0)
    meaning = "folder for robot file and report, which must not exist yet"
    parser.add("--out", "DIR", meaning, default="identified")
    parser.add(
        *("--design", "FILE"),
        "instead of reading a LOG write a scenario whose motion tells the numbers, and print how "
        "well it will; FILE must not exist yet",
    )
    meaning = "scenario file of which the design has all but the motion (default: 12 s with an IMU)"
    parser.add("--scenario", "FILE", meaning)
    meaning = "how far the designed motion takes the base along each axis, m (default: 1)"
    parser.add("--room", "M", meaning, type=_number, default=1.0)


@_command("write a flight as a log of ROS 2 or PX4")
def _log(parser: Parser) -> None:
    parser.add("flight", "FLIGHT", _FLIGHT)
    meaning = "mcap for a bag of ROS 2, csv for tables of the topics of PX4"
    parser.add("--format", None, meaning, choices=("mcap", "csv"), default="mcap")
    meaning = "folder to write, which must not exist yet"
    parser.add("--out", "DIR", meaning, default="log")


@_command("make a flight of a log of ROS or PX4, with time series and figures")
def _replay(parser: Parser) -> None:
    _add_module(parser)
    parser.add("log", "LOG", _LOG)
    parser.add("--out", "DIR", "folder in which the results are written", default="flight")
    _add_names(parser)
    meaning = "samples per second (default: the times of LOG)"
    parser.add("--rate", "HZ", meaning, type=_number)
    meaning = "keep what is slower, by a filter without delay (default: no filter)"
    parser.add("--cutoff", "HZ", meaning, type=_number)
    meaning = "estimate the state as a scenario says, by its sensors: its name or file"
    parser.add("--estimate", "NAME|FILE", meaning)
    _add_figures(parser, "write the time series only")


@_command("show a robot or a flight in the browser, live or as one file")
def _view(parser: Parser) -> None:
    parser.add("what", "ROBOT|FLIGHT", f"a robot, as for `simulate`; or {_FLIGHT}")
    meaning = "write one file that any browser opens without a request, instead of serving"
    parser.add("--html", "FILE", meaning)
    parser.add("--port", "P", "port of the server, or the next free one", type=_port, default=8080)
    parser.flag("--no-browser", "do not open the browser")


@_command("reproduce the paper: its table, equations and figures, with residuals in digits")
def _paper(parser: Parser) -> None:
    meaning = "folder to write, which must not exist yet"
    parser.add("--out", "DIR", meaning, default="paper")


@_command("write one page on which a robot flies in any browser, by its own emitted C and law")
def _fly(parser: Parser) -> None:
    parser.add("robot", "ROBOT", _PLACES)
    parser.add("--html", "FILE", "page to write (default: ROBOT.html)")


@_command("write a commented robot file to start from")
def _new(parser: Parser) -> None:
    parser.add("file", "ROBOT.toml", "robot file to write, which must not exist yet")
    parser.flag(
        "--placed",
        "place rotors by radius, azimuth and tilt, and joints by positions and axes; without it "
        "the base has rods with a rotor at the end of each, and links have Denavit-Hartenberg "
        "parameters, as in the paper",
    )
    meaning = "number of rotors (default: 4 with --placed, else 6)"
    parser.add("--rotors", "N", meaning, type=int)
    meaning = "begin with its file: ur5e, an arm that is held, rover_arm, on wheels, or another"
    parser.add("--like", "ROBOT", meaning)


@_command("write a robot file from a robot in URDF, xacro, MJCF or SDF, or join arms to a drone")
def _import(parser: Parser) -> None:
    extras = "xacro needs the extra xacro, and MJCF the extra mujoco"
    also = "with --attach also a robot file, or the name of a robot that ships"
    parser.add("file", "FILE", f"a .urdf, .xacro, .xml or .sdf file; {extras}; {also}")
    meaning = "value of an <xacro:arg> of FILE, such as mass:=2.0"
    parser.add("arguments", "NAME:=VALUE", meaning, nargs="*")
    parser.takes_named = True
    parser.add(
        *("--attach", "ARM"),
        "file of an arm, as FILE may be, that is joined to the robot: its root becomes part of "
        "what carries it; may be repeated, each with --on, --xyz, --rpy_deg and --prefix after it",
        action=_OfAttachment,
    )
    meaning = "link or frame that carries the arm (default: the base)"
    parser.add("--on", "LINK", meaning, action=_OfAttachment)
    meaning = "place of the arm's root in the frame of LINK, m (default: 0 0 0)"
    parser.add("--xyz", ("X", "Y", "Z"), meaning, action=_OfAttachment, nargs=3, type=_number)
    meaning = "roll, pitch and yaw of the arm's root there, as in URDF, degrees (default: 0 0 0)"
    parser.add("--rpy_deg", ("R", "P", "Y"), meaning, action=_OfAttachment, nargs=3, type=_number)
    meaning = "what comes before the names of the arm's links, joints and frames, such as left_"
    parser.add("--prefix", "NAME_", meaning, action=_OfAttachment)
    parser.add(
        *("--rotors", "ROTORS"),
        "file that says where the rotors are, in place of those found: [[rotor]] tables in TOML as "
        "in a robot file, `on` a link of FILE; or a platform of eagle_mpc in YAML",
    )
    parser.add(
        *("--command", None),
        "what motors of Gazebo in FILE are commanded: a thrust (default) or, as there, a speed, "
        "with time constants of speeding up and slowing down and the drag of the hub",
        choices=("thrust", "speed"),
    )
    parser.add(
        *("--attitude", "WORD"),
        "what describes the attitude of the base: quaternion (default), or a sequence of angles "
        "such as xyz",
    )
    parser.add(
        *("--base", "MOTION|LINK"),
        "what moves of the base: free, fixed, planar, upright, or a list such as x,z,pitch "
        "(default: as FILE says, else free); or the link that is to be the base (default: the root "
        "of FILE); may be given twice, for both",
        action="append",
        default=[],
    )
    meaning = "robot file to write (default: the robot's name and .toml)"
    parser.add("--out", "ROBOT.toml", meaning)
    meaning = "hold a joint fast, at 0 or at VALUE in rad or m; may be repeated"
    parser.add("--lock", "JOINT[=VALUE]", meaning, action="append", default=[])
    parser.flag(
        "--no-snap",
        "keep angles as they are, even within 2e-5 rad of a multiple of 15 degrees, and numbers "
        "that are rounding",
    )
    parser.flag("--friction", "take the dry friction of joints, which is left out otherwise")
    parser.flag("--force", "replace ROBOT.toml if it exists")


@_command("write a robot in URDF, MJCF or SDF, or parameters for an autopilot")
def _export(parser: Parser) -> None:
    parser.add("robot", "ROBOT", _DERIVES)
    kinds = ("urdf", "mjcf", "sdf", "px4", "ardupilot")
    parser.add("--format", None, "format of the file", choices=kinds, required=True)
    meaning = (
        "file to write (default: the robot's name and .urdf, .xml, .sdf or .param, or after 22000_)"
    )
    parser.add("--out", "FILE", meaning)
    parser.flag("--force", "replace FILE if it exists")


@_command("print the JSON schema of robot or scenario files, with which editors complete keys")
def _schema(parser: Parser) -> None:
    parser.add("file", None, "kind of file that the schema is for", choices=("robot", "scenario"))


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
