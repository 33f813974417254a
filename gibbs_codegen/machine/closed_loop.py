"""The closed loop dx/dt = f(t, x) as an array program: a plant, a law, motors, surroundings.

The plant has its own parameters, the law those of the robot that it knows: calls have the owners
`plant` and `model`. The state x is that of the machine, with the work of all that acts, and the
integrals of the errors that a law remembers.

Laws say which thrusts and torques they want. Motors and servos of the module's drives are sent the
commands that give them, servos where the joint is to be; without drives inputs are sent.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.labels import labelled
from gibbs_codegen.arrays.nodes import (
    Node,
    Program,
    absolute,
    choose,
    constant,
    coordinates_of,
    entries_of,
    external,
    join,
    mark,
    maximum,
    minimum,
    ordered,
    reshaped,
    variable,
    zeros,
)
from gibbs_codegen.machine import impacts, surroundings
from gibbs_codegen.machine.base import (
    Motion,
    base_of,
    placed,
    pose_motion,
    unit_entries,
)
from gibbs_codegen.machine.laws import (
    LAWS,
    Aim,
    CentrePath,
    Estimates,
    FrameAim,
    Gains,
    Limits,
    PushAim,
    Rotors,
    inputs_of,
    learning,
    memory_size,
    push_shares,
    turns_servos,
    weight_of,
    within_limits,
)
from gibbs_codegen.machine.machine import NO_SURROUNDINGS, Machine, Surroundings
from gibbs_codegen.machine.mechanism import carried
from gibbs_codegen.machine.state import State, StateLayout
from gibbs_codegen.machine.steps import classical_step

# Time, s, over which thrusts are differenced for what makes up for the lag of motors.
AHEAD = 1e-7
# Inputs, N or N m, next to which what makes up for the lag is nothing.
_NO_LEAD = 1e-12
# A velocity, m/s, and a force, N, next to which a frame neither comes to a stop nor leaves it.
STILL = 1e-9


@dataclass(frozen=True)
class AtTime:
    """A time, and the desired motion there; that of the centre of mass where the base leans.

    `felt` (6) is the wrench that the surroundings do to the frame that the law moves, if it does.
    """

    time: Node
    motion: Motion
    centre: CentrePath | None
    curves: Node
    felt: Node | None = None


@dataclass(frozen=True)
class LoopStructure:
    """The parts of a closed loop on which its program depends.

    `law` is one of `LAWS`, "open_loop", "off" or "held"; `integral` laws remember errors,
    `limited` that inputs have limits, `shared` that thrusts have in the allocation, `lags` and
    `compensates` whether motors lag, and commands make up for it, `idles` that motors do not run
    where the input `idle` is 1, `moves` that joints move rotors, `refuses` that wrenches that
    rotors do not produce end a flight. `varying_inputs` are names of inputs that differ from state
    to state; `frames` is the number of the plant's. A law that moves a frame moves that of the
    number `moved`, and pushes along a direction in the axes of the one of the number `axes`, or of
    the world.
    """

    module: object
    law: str
    frames: int
    integral: bool = False
    limited: bool = False
    shared: bool = False
    lags: bool = False
    compensates: bool = False
    idles: bool = False
    moves: bool = False
    refuses: bool = False
    moved: int | None = None
    axes: int | None = None
    around: Surroundings = NO_SURROUNDINGS
    varying_inputs: Collection[str] = ()
    inputs: dict[str, Node] = field(default_factory=dict, compare=False)

    @cached_property
    def plant(self) -> Functions:
        """The robot that flies."""
        return Functions(self.module, "plant")

    @cached_property
    def model(self) -> Functions:
        """The robot that the law knows."""
        model = Functions(self.module, "model")
        model.leading = self.input_node("leading") if model.leads_loops else None
        return model

    @cached_property
    def machine(self) -> Machine:
        """The robot that flies, with its actuators and what is around it."""
        runs = self.law != "off"
        loads = self.plant, self.input_node, self.around
        return Machine(*loads, lags=self.lags, runs=runs, moves=self.moves)

    @cached_property
    def layout(self) -> StateLayout:
        """The layout of the state."""
        return self.machine.layout(work=1, memory=self.memory if self.integral else 0)

    @property
    def memory(self) -> int:
        """Numbers that the law remembers, if it remembers any."""
        return memory_size(self.plant, self.law)

    @property
    def size(self) -> int:
        """Length of the state."""
        return self.layout.size

    def input_node(self, name: str, *shape: int) -> Node:
        """An input by its name, which is made when it is first asked for."""
        if name not in self.inputs:
            self.inputs[name] = variable(name, *shape, uniform=name not in self.varying_inputs)
        return self.inputs[name]

    def step(self) -> Program:
        """A step of the classical method of Runge and Kutta: time, h and x to x_next.

        Where `refused` is not 0 or less, rotors cannot produce what the law asks for; nor can a
        flight go on where `ended` is not after the step. `inputs` (2 nu) are those that are
        commanded at its start and those that act.
        """
        time, h = (variable(name, uniform=True) for name in ("time", "h"))
        x, after = variable("x", self.size), time + h
        times, stages = (time, time + 0.5 * h, after), list[dict[str, Node]]()

        def rate(x: Node, halves: int) -> Node:
            stages.append(self._rates(times[halves], x[: self.size]))
            return join(stages[-1]["rate"], stages[-1].get("effects", zeros(0)))

        contacts = len(self.around.contacts)
        first_effects = zeros(3 + 6 * contacts if contacts else 0)
        whole = classical_step(rate, join(x, first_effects), h)
        after_step = self._passive(x, whole[: self.size], whole[self.size :])
        x_next = impacts.held(self.machine, self.layout, after_step)
        first, *others = stages
        ended = self._ended(self._instant(after, self._curves_at(after)), x_next)
        outputs = {"x_next": x_next, "ended": ended}
        outputs["inputs"] = join(first["commanded"], first["acting"])
        outputs["refused"] = first["refused"]
        for stage in others:
            outputs["refused"] = outputs["refused"] + maximum(stage["refused"], 0.0)
        return self._program("step", (time, h, x), outputs)

    def after(self) -> Program:
        """As `step`, `x_next` and `refused` alone, for which held inputs need no desired motion."""
        step = self.step()
        outputs = {name: step.outputs[name] for name in ("x_next", "refused")}
        return self._program("after", step.inputs[:3], outputs)

    def _passive(self, x: Node, after: Node, done: Node) -> Node:
        """The state after a step, without the energy that contacts gained by what they did."""
        if not self.around.contacts:
            return after
        place = self.layout.places.work.start
        others = after[place] - x[place] - done[0]
        return impacts.without_gains(self.machine, self.layout, (x, after), others, done)

    def slope(self) -> Program:
        """The time derivative `rate` of x at a time, with `refused` and `inputs` as of a step.

        `inside` is more than 0 where no input that is commanded is at a limit.
        """
        time, x = variable("time", uniform=True), variable("x", self.size)
        rates = self._rates(time, x)
        outputs = {name: rates[name] for name in ("rate", "refused")}
        outputs["inputs"] = join(rates["commanded"], rates["acting"])
        outputs["inside"] = self._inside(rates["commanded"]) if self.limited else constant(1.0)
        return self._program("slope", (time, x), outputs)

    def end(self) -> Program:
        """More than 0, or no number, `ended`: where a flight cannot go on from x at a time."""
        time, x = variable("time", uniform=True), variable("x", self.size)
        ended = self._ended(self._instant(time, self._curves_at(time)), x)
        return self._program("end", (time, x), {"ended": ended})

    @labelled
    def stop(self) -> Program:
        """More than 0 `stopped`: where a frame comes to a stop, or a stop would pull."""
        time, x = variable("time", uniform=True), variable("x", self.size)
        return self._program("stop", (time, x), {"stopped": -_least(self._apart(time, x))})

    def _rates(self, time: Node, x: Node) -> dict[str, Node]:
        """Results of the program of rates at a time."""
        rate = self.rate_program
        return rate.results(time, self._curves_at(time), x, *rate.inputs[3:])

    def _program(self, name: str, first: Sequence[Node], outputs: dict[str, Node]) -> Program:
        """A program of some inputs, and of those by names that its outputs need."""
        needed = set(ordered(outputs.values()))
        return Program(name, (*first, *(y for y in self.inputs.values() if y in needed)), outputs)

    @cached_property
    @labelled
    def rate_program(self) -> Program:
        """Time derivative of a state: of time, curves and x, and all else that it needs."""
        time, x = variable("time", uniform=True), variable("x", self.size)
        curves = variable("curves", self.curves.outputs["curves"].size, uniform=True)
        outputs = self.rate(self._instant(time, curves), x)
        return self._program("rate", (time, curves, x), outputs)

    def rate(self, at: AtTime, x: Node) -> dict[str, Node]:
        """Time derivative of a state x, inputs that are commanded and that act (nu), refusal."""
        state, machine = self.parts(x), self.machine
        if self.moved is not None:
            at = replace(at, felt=machine.touching(state)[self.moved])
        wanted, aimed, u, refused = self._inputs(at, state)
        rates = machine.rates(at.time, state, u, aimed)
        power, learnt = machine.power(state, u, rates), zeros(0)
        if self.integral:
            learnt = self._remembered(at, state.q, state.v, state.memory, wanted)
        moved = base_of(self.plant, state.q).rates(state.v, x)
        rate = join(moved, rates.a, power, rates.actuators, learnt, rates.bristles)
        outputs = {"rate": rate, "commanded": wanted, "acting": u, "refused": refused}
        if self.around.contacts:
            outputs["effects"] = impacts.effects(machine, state, rates.touches)
        if self.around.stops:
            outputs["holding"] = rates.holding
        return outputs

    @labelled
    def commands(self) -> Program:
        """Inputs `commanded` and `acting` (nu), and `refused` as of a step.

        Of a time, coordinates and velocities, and of actuators, memory and bristles where they are
        in the state, the last if the law feels them. `aimed` (nu) are the same within limits, or
        commands of motors and servos.
        """
        time, state = variable("time", uniform=True), self._state()
        felt, parts = None, [x for x in (state.actuators, state.memory) if x.size]
        if self.moved is not None:
            felt = self.machine.touching(state)[self.moved]
        if state.bristles.size and (self.compensates or self.moved is not None):
            parts.append(state.bristles)
        at = self._instant(time, self._curves_at(time), felt)
        wanted, aimed, u, refused = self._inputs(at, state)
        outputs = {"commanded": wanted, "aimed": aimed, "acting": u, "refused": refused}
        return self._program("commands", (time, state.q, state.v, *parts), outputs)

    def motion(self) -> Program:
        """Accelerations `a` (nv), `wrenches` (f, 6) of what acts, and of the `contacts` (c, 8).

        `holding` (l) are the forces of constraints, one for each of their rows if any holds.
        `touching` (f, 6) are those of what touches the frames alone: of walls and of the push.
        Of a time, coordinates, velocities, and inputs that act; of rotors in the air also of what
        is aimed for, and of the state of the actuators; of bristles where there are any. Rows of
        contacts are as of `Touch.series`.
        """
        time, state = variable("time", uniform=True), self._state()
        u, aimed = variable("u", self.plant.inputs), variable("aimed", self.plant.inputs)
        rates = self.machine.rates(time, state, u, aimed)
        none = zeros(self.frames, 6)
        outputs = {
            "a": rates.a,
            "holding": rates.holding,
            "wrenches": none if rates.wrenches is None else rates.wrenches,
            "touching": self.machine.touching(state),
            "contacts": join(zeros(0, 8), *(reshaped(x.series, (1, 8)) for x in rates.touches)),
        }
        of_air = [aimed, state.actuators] if self.machine.has_air else []
        parts = [x for x in (*of_air, state.bristles) if x.size]
        return self._program("motion", (time, state.q, state.v, u, *parts), outputs)

    @labelled
    def contact_wrenches(self) -> Program:
        """The `wrenches` (f, 6) of contacts alone: of coordinates, velocities and bristles."""
        state, machine = self._state(), self.machine
        outputs = {"wrenches": machine.contact_wrenches(machine.touches(state))}
        parts = [state.bristles] if state.bristles.size else []
        return self._program("contact_wrenches", (state.q, state.v, *parts), outputs)

    @labelled
    def command(self) -> Program:
        """Inputs `wanted` (nu) of the law alone, `refused`, and `growth` of what it remembers.

        Of a time, coordinates and velocities as it knows them, what it remembers, if it does, and
        what the frame that it moves feels. `wrench` (6) is what it asks of the rotors.
        """
        time, (q, v) = variable("time", uniform=True), self.model.state()
        memory = variable("memory", self.memory)
        at = self._instant(time, self._curves_at(time), self._felt)
        wanted, refused = self.commanded(at, q, v, memory)
        outputs = {"wanted": wanted, "refused": refused}
        if self.integral:
            outputs["growth"] = self._remembered(at, q, v, memory, wanted)
        if self.law not in ("off", "held"):
            outputs["wrench"] = self._wrench(*self._force(at, q, v, memory))
        knowledge = self._knowledge(at, memory)
        return self._program("command", (time, q, v, *knowledge), outputs)

    @labelled
    def sample(self) -> Program:
        """What is commanded by the law when it is sampled: `commands` (nu), and `refused`.

        It takes the `time`, and a state x that has nothing of what it remembers, which
        is `memory` (m) and then `learnt` (m), where errors act for as long as it `learns`, s.
        Sensors are off by `errors`: displacements (nv), velocities (nv), the wrench on the frame.
        """
        time, n = variable("time", uniform=True), self.plant.space.velocities
        layout = self.machine.layout(work=1)
        x, learns = variable("x", layout.size), variable("learns")
        errors, memory = variable("errors", 2 * n + 6), variable("memory", self.memory)
        state = self.machine.parts(x, layout)
        base, places, felt = base_of(self.model, state.q), self.model.layout.v, None

        def off(error: Node) -> Node:
            if not self.model.layout.moves_freely:  # Of what moves.
                return error
            turn = error[places.attitude]
            if not self.model.space.has_quaternion:  # That is about axes of the world.
                turn = base.attitude_entries(zeros(n), base.to_base(turn))
            return placed(self.model, turn, error[places.position], error[places.joints])

        q, v = self.model.integrate(state.q, off(errors[:n])), state.v + off(errors[n : 2 * n])
        if self.moved is not None:
            felt = self.machine.touching(state)[self.moved] + errors[2 * n :]
        at = self._instant(time, self._curves_at(time), felt)
        wanted, refused = self.commanded(at, q, v, memory)
        outputs = {"commands": self._sent(at, q, v, wanted), "learnt": memory, "refused": refused}
        if self.integral:
            outputs["learnt"] = memory + learns * self._remembered(at, q, v, memory, wanted)
        return self._program("sample", (time, x, errors, memory, learns), outputs)

    def required(self) -> Program:
        """Inputs `wanted` (nu) that accelerations need, as of `command`, of q, v and a."""
        (q, v), a = self.model.state(), self.model.velocities("a")
        force = carried(self.model, q, self.model.inverse_dynamics(q, v, a))
        wanted, refused = inputs_of(self.model, q, force, self.rotors)
        outputs = {"wanted": wanted, "refused": refused, "wrench": self._wrench(q, force)}
        return self._program("required", (q, v, a), outputs)

    def _wrench(self, q: Node, force: Node) -> Node:
        """Force and torque (6) about the base centre that a generalised force (nv) asks for."""
        return base_of(self.model, q).wrench(self.rotors.centre, force)

    def _state(self) -> State[Node]:
        """Parts of a state as inputs of a program, but for the work; none of no length."""
        layout = self.layout
        sizes = {"actuators": layout.actuators, "memory": layout.memory}
        sizes["bristles"] = layout.bristles
        parts = {name: variable(name, size) if size else zeros(0) for name, size in sizes.items()}
        return State(*self.plant.state(), zeros(0), **parts)

    def _inputs(self, at: AtTime, state: State[Node]) -> tuple[Node, Node, Node, Node]:
        """Inputs (nu) that are commanded, what is aimed for, inputs that act; refusal."""
        q, v, _, _, memory, _ = state
        wanted, refused = self.commanded(at, q, v, memory)
        sent = self._sent(at, q, v, wanted)
        if self.law == "held":  # What is held are commands.
            wanted = self.plant.inputs_of(q, v, self.plant.actuator_state_of(sent), sent)
        if self.compensates:
            lead, later = self._lead(at, state, wanted, sent)
            sent, refused = sent + lead, refused + maximum(later, 0.0)
            wanted = wanted if self._turns_drives else sent
        aimed = self._within(sent)
        if self.idles:
            count = self.plant.rotors
            thrusts = self._unless_idle(aimed[:count], self.input_node("idling", count))
            aimed = join(thrusts, aimed[count:])
        return wanted, aimed, self.machine.inputs(state, aimed), refused

    @property
    def _turns_drives(self) -> bool:
        """True if a law's inputs are made commands of drives."""
        return self.plant.driven and self.law not in ("off", "held")

    def _unless_idle(self, running: Node, idle: Node | float) -> Node:
        """A value while motors run, or else another."""
        return choose(self.input_node("idle"), 0.5, idle, running)

    def _sent(self, at: AtTime, q: Node, v: Node, wanted: Node) -> Node:
        """Inputs (nu) that are wanted, or the commands for them where drives take such."""
        if not self._turns_drives:
            return wanted
        if not turns_servos(self.law):
            q, v = at.motion.q, at.motion.v
        command: Node = self.model.command_of(q, v, self._possible(wanted))
        return command

    def _possible(self, inputs: Node) -> Node:
        """Inputs (nu) within the limits of those that act, if there are any."""
        return within_limits(inputs, self.limits) if self.limited else inputs

    def _within(self, sent: Node) -> Node:
        """Inputs that are sent, within limits; to what is off 0 is sent, whatever its limits."""
        if self.plant.driven and self.law != "off":
            least, most = (self.input_node(f"{x}_command", sent.size) for x in ("least", "most"))
            return within_limits(sent, Limits(least, most))
        return self._possible(sent)

    def parts(self, x: Node) -> State[Node]:
        """Parts of a state; a quaternion is made of unit length."""
        return self.machine.parts(x, self.layout)

    # The desired motion.

    def _instant(self, time: Node, curves: Node, felt: Node | None = None) -> AtTime:
        """A time with what the law follows there, and feels."""
        n, m = self.plant.space.coordinates, self.plant.space.velocities
        ends = n, n + m, n + 2 * m
        q = coordinates_of(curves[: ends[0]], self.plant.space)
        back = self.input_node("back", 2) if self.plant.space.has_drive else None
        motion = Motion(q, curves[ends[0] : ends[1]], curves[ends[1] : ends[2]], back)
        path = curves[ends[2] :]
        centre = CentrePath(path[:3], path[3:6], path[6:]) if self.leans else None
        return AtTime(time, motion, centre, curves, felt)

    def _curves_at(self, time: Node) -> Node:
        """Desired q, v and a, and where the base leans the centre of mass, at a time."""
        return self.curves(time)[0]

    @cached_property
    def curves(self) -> Program:
        """The same as a program; tables of the curves are outside of it."""
        time, n = variable("time", uniform=True), self.plant.space.coordinates
        curve = external("desired", (3 * n,), time)
        parts: tuple[Node, ...] = (curve[:n], curve[n : 2 * n], curve[2 * n :])
        if not self.plant.space.is_flat:
            parts = pose_motion(self.plant, *parts)
        centre = [external("centre", (9,), time)] if self.leans else []
        return Program("wanted", (time,), {"curves": join(*parts, *centre)})

    # The law.

    @property
    def leans(self) -> bool:
        """True if the base leans under the law."""
        return self.law in LAWS and LAWS[self.law].leans

    @cached_property
    def gains(self) -> Gains:
        """Gains of the law."""
        size = self.plant.space.velocities
        integral = self.input_node("integral") if self.integral else None
        return Gains(self.input_node("stiffness", size), self.input_node("damping", size), integral)

    @cached_property
    def rotors(self) -> Rotors:
        """Rotors as the law knows them, with the limits that allocation keeps."""
        count = len(self.plant.base_inputs)
        return Rotors(
            self.input_node("known_centre", 3),
            self.input_node("distribution", count, 6),
            self.input_node("known_wrenches", count, 6),
            self.input_node("least_shared", count),
            self.input_node("most_shared", count),
            self.shared,
            self.moves,
            self.refuses,
            self.input_node("exact"),
        )

    @cached_property
    def limits(self) -> Limits:
        """Limits of the inputs that act."""
        return Limits(*(self.input_node(name, self.plant.inputs) for name in ("least", "most")))

    def commanded(self, at: AtTime, q: Node, v: Node, memory: Node) -> tuple[Node, Node]:
        """Inputs (nu) that the law wants, and more than 0 where rotors cannot produce them."""
        if self.law == "off":
            return zeros(self.model.inputs), constant(0.0)
        if self.law == "held":
            return self.input_node("held", self.model.inputs), constant(0.0)
        response = self._law_results(at, q, v, memory)
        return response["wanted"], response["refused"]

    def _law_results(self, at: AtTime, q: Node, v: Node, memory: Node) -> dict[str, Node]:
        """Inputs `wanted` (nu), and `free` of limits, of the law, and `refused` as of a step."""
        if not self.compensates:
            return self._law(at, q, v, memory)
        law = self._law_program
        knowledge = self._knowledge(at, memory)
        first = 4 + len(knowledge)
        return law.results(at.time, at.curves, q, v, *knowledge, *law.inputs[first:])

    @cached_property
    @labelled
    def _law_program(self) -> Program:
        """The law as a program of its own, since lag compensation calls it twice."""
        time, (q, v) = variable("time", uniform=True), self.model.state()
        curves = variable("curves", self.curves.outputs["curves"].size, uniform=True)
        memory = variable("memory", self.memory)
        at = self._instant(time, curves, self._felt)
        outputs = self._law(at, q, v, memory)
        return self._program("law", (time, curves, q, v, *self._knowledge(at, memory)), outputs)

    @property
    def _felt(self) -> Node | None:
        """The wrench (6) that the frame feels which the law moves, as an input, if it moves one."""
        return None if self.moved is None else variable("felt", 6)

    def _knowledge(self, at: AtTime, memory: Node) -> list[Node]:
        """Knowledge of the law beside time and state: what it remembers and feels, if it does."""
        return [*([memory] if self.integral else []), *([] if at.felt is None else [at.felt])]

    def _law(self, at: AtTime, q: Node, v: Node, memory: Node) -> dict[str, Node]:
        q, force = self._force(at, q, v, memory)
        wanted, refused = inputs_of(self.model, q, force, self.rotors)
        unlimited = replace(self.rotors, limited=False, refuse=False)
        free, _ = inputs_of(self.model, q, force, unlimited)
        return {"wanted": wanted, "free": free, "refused": refused}

    def _force(self, at: AtTime, q: Node, v: Node, memory: Node) -> tuple[Node, Node]:
        """Coordinates (nq) and the generalised force (nv) that the law wants there."""
        model, desired = self.model, at.motion
        if self.law == "open_loop":
            q, force = desired.q, model.inverse_dynamics(desired.q, desired.v, desired.a)
        else:
            force = LAWS[self.law].force(model, q, v, self._aim(at, q, memory))
        return q, carried(model, q, force)

    def _aim(self, at: AtTime, q: Node, memory: Node) -> Aim:
        """The aim of the law at an instant, with what it knows of the robot there."""
        weight = weight_of(self.model, q, self.input_node, self.rotors) if self.leans else None
        learnt, estimates = memory if self.integral else None, None
        if self.law in LAWS and LAWS[self.law].learns:
            learnt = None
            estimates = Estimates(memory, self.input_node("adaptation", self.memory, self.memory))
        frame = self._frame_aim(at, q)
        return Aim(at.motion, self.gains, learnt, at.centre, weight, frame, estimates)

    def _frame_aim(self, at: AtTime, q: Node) -> FrameAim | None:
        """The aim for the frame that the law moves, if it moves one."""
        if self.moved is None or at.felt is None:
            return None
        stiffness, damping, inertia = (
            self.input_node(f"frame_{x}", 3) for x in ("stiffness", "damping", "inertia")
        )
        aim = FrameAim(self.moved, stiffness, damping, inertia, at.felt)
        if not LAWS[self.law].pushes:
            return aim
        direction, axes = self.input_node("push_direction", 3), None
        if self.axes is not None:
            axes = surroundings.rotation_of(self.model.frame_poses(q)[self.axes])
            direction = axes @ direction
        force, rise, integral = (
            self.input_node(f"push_{x}") for x in ("force", "rise", "integral")
        )
        ends = self.input_node("push_begin"), self.input_node("push_end")
        rising, falling = push_shares(at.time, *ends, rise)
        return replace(aim, push=PushAim(direction, force, rising - falling, integral, axes))

    def _lead(self, at: AtTime, state: State[Node], wanted: Node, sent: Node) -> tuple[Node, Node]:
        """The lead (nu) that makes up for the lag: time constants times rates of what is sent.

        It is differenced along the motion of the plant from its state, back at the end of the
        desired one, after which it stands still.
        More than 0 where rotors cannot produce what comes next.
        """
        q, v, _, _, memory, _ = state
        model, count, aimed = self.model, self.plant.rotors, self._within(sent)
        ahead = choose(at.time, self.input_node("end") - AHEAD, -AHEAD, AHEAD)
        a = self.machine.rates(at.time, state, self.machine.inputs(state, aimed), aimed).a
        entries = entries_of(q)
        moved = entries + ahead * base_of(model, q).rates(v, entries)
        later = coordinates_of(unit_entries(model, moved), model.space)
        learnt = memory + ahead * self._errors(at, q, v) if self.integral else memory
        time = at.time + ahead
        # What will be felt nobody knows.
        then = self._instant(time, self._curves_at(time), at.felt)
        free = self._law_results(at, q, v, memory)["free"]
        response = self._law_results(then, later, v + ahead * a, learnt)
        rates, possible = (response["free"] - free) / ahead, self._possible(wanted)
        if self._turns_drives:
            turning = (
                self._sent(then, later, v + ahead * a, possible + ahead * rates) - sent
            ) / ahead
            up, down = (self.input_node(f"time_{x}", model.inputs) for x in ("up", "down"))
            lag = choose(turning, 0.0, up, down)
        else:
            turning, lag = rates, join(self.input_node("lag", count), zeros(model.inputs - count))
        kept = self._kept(absolute(lag * rates), absolute(free - possible))
        return kept * lag * turning, response["refused"]

    def _kept(self, lead: Node, beyond: Node) -> Node:
        """Share (nu) of the lead that is kept, by its size in units of inputs.

        The less the further inputs are `beyond` limits, so that nothing jumps there, and none
        where the lead would not bring them back; of rotors, which have one wrench, the same.
        """
        if not self.limited and not self.shared:
            return constant(1.0)
        if count := self.plant.rotors:
            lead, beyond = (
                join(_greatest(x[:count]) + zeros(count), x[count:]) for x in (lead, beyond)
            )
        share = maximum(1.0 - beyond / maximum(lead, _NO_LEAD), 0.0)
        return choose(beyond, 0.0, share, 1.0)

    def _errors(self, at: AtTime, q: Node, v: Node) -> Node:
        """Errors (nv) that are integrated."""
        return learning(self.model, q, v, self._aim(at, q, zeros(self.memory)))

    def _remembered(self, at: AtTime, q: Node, v: Node, memory: Node, wanted: Node) -> Node:
        """Rates (nv) of what is remembered, none away from 0 while an input is at a limit."""
        growth = self._errors(at, q, v)
        if self.idles:
            growth = self._unless_idle(growth, 0.0)
        if not self.limited:
            return growth
        wound = choose(0.0, growth * memory, growth, 0.0)
        return choose(self._inside(wanted), 0.0, growth, wound)

    def _inside(self, wanted: Node) -> Node:
        """Distance of inputs (nu) from their limits, to which allocation comes but for rounding."""
        (least, most), margin = self.limits, self.input_node("margin", self.plant.inputs)
        return _least(minimum(wanted - (least + margin), (most - margin) - wanted))

    def _ended(self, at: AtTime, x: Node) -> Node:
        """More than 0, or no number, where a flight cannot go on from a state."""
        q, v, *_ = self.parts(x)
        errors = join(*base_of(self.plant, q).errors(v, at.motion))
        within = self.input_node("bounds", errors.size) - absolute(errors)
        if (middle := self.plant.layout.middle_angle) is not None:
            angle = absolute(x[middle])
            within = join(within, self.input_node("largest_lean") - angle)
        if self.around.stops:
            within = join(within, self._apart(at.time, x))
        return -_least(within) + mark(x)

    def _apart(self, time: Node, x: Node) -> Node:
        """Less than 0 where a frame is beyond a stop and on its way, or would be pulled by it."""
        q, v, *_ = self.parts(x)
        errors, moving = self.plant.constraint_errors(q), self.plant.constraint_jacobian(q) @ v
        away, pressing = self.input_node("stops", 2, errors.size)
        outside = maximum(away * errors, away * moving + STILL)
        return join(outside, pressing * self._rates(time, x)["holding"] + STILL)


def _greatest(x: Node) -> Node:
    """The greatest entry of a vector."""
    return -_least(-x)


def _least(x: Node) -> Node:
    """The least entry of a vector, in pairs, which need not wait for each other."""
    half = x.size // 2
    return minimum(_least(x[:half]), _least(x[half:])) if half else x[0]
