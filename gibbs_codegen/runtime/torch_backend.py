"""The PyTorch back end: a module's functions, and array programs, as functions of tensors.

All are programs, compiled in C: a function of a module is a program that calls it once, with a
quaternion that it brings to unit length. Backward is the program's gradient, forward its derivative
along a direction, both programs again; so they are differentiated as often as the module has
functions for it. Memory of doubles is shared; single precision is computed in double precision.

autograd and `torch.func` take an `autograd.Function`, which `torch.compile` does not where it has
forward derivatives. That takes the operator `gibbs_codegen::call`, which `torch.func` does not.
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from types import ModuleType
from typing import Any, NamedTuple, TypeAlias
from weakref import WeakValueDictionary

import numpy as np
import torch
from torch.nn.functional import pad

from gibbs_codegen.arrays.backward import gradient
from gibbs_codegen.arrays.c_text import c_functions
from gibbs_codegen.arrays.contents import owners_of
from gibbs_codegen.arrays.forward import along
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import (
    Call,
    Entries,
    Invocation,
    Node,
    Program,
    Space,
    coordinates_of,
    entries_of,
    join,
    node,
    square_root,
    substituted,
    total,
    variable,
)
from gibbs_codegen.emitted.evaluation import state_array
from gibbs_codegen.emitted.preparation import common_shape, real_numbers
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, Signature
from gibbs_codegen.machine.steps import emitted_step
from gibbs_codegen.runtime.c_backend import default_constants, numbers
from gibbs_codegen.runtime.loaded_module import GeneralFunction, LoadedModule
from gibbs_codegen.runtime.program_blocks import BlockProgram

Tensors = Sequence[torch.Tensor]
# What computes a program of operands.
Called: TypeAlias = "Callable[[TensorProgram, Tensors], Tensors]"
# Programs by what stands for them in what `torch.compile` keeps, for this process or another.
_KNOWN: WeakValueDictionary[str, Any] = WeakValueDictionary()
_DOUBLE = torch.float64
_MOST_PLANS = 256


class _Plan(NamedTuple):
    """What a computation takes from the shapes of operands."""

    states: int
    by_state: Any
    # Shapes of operands that are repeated, if any are; of results; of those that states share.
    repeated: tuple[tuple[int, ...] | None, ...]
    made: list[tuple[int, ...]]
    shared: list[tuple[int, ...]]


class TensorProgram:
    """A program of entries, each of which may differ from state to state, on tensors.

    Operands are its inputs (..., *shape), then constants (..., size) of the owners that have given
    them, as `prepare` returns them.
    """

    def __init__(
        self, program: Program, module: ModuleType, owners: tuple[str, ...], key: str
    ) -> None:
        self._program, self._module = program, module
        self._owners, self.key = owners, key
        self._default = default_constants(module)
        self._address, self._states = self._default.ctypes.data, len(program.inputs)
        size = self._default.size + len(module.PARAMETERS)
        self.names = [*program.names, *(f"constants of {owner}" for owner in owners)]
        self.shapes = [x.shape for x in program.inputs] + [(size,)] * len(owners)
        self.made = [x.shape for x in program.outputs.values()]
        self._plans: dict[tuple[torch.Size, ...], _Plan] = {}
        self._rules: dict[str, TensorProgram] = {}
        self._gradients: dict[tuple[bool, ...], tuple[list[int], TensorProgram]] = {}
        _KNOWN[key] = self

    @cached_property
    def _compiled(self) -> BlockProgram:
        return BlockProgram(self._program, self._module, per_state=bool(self._owners))

    def batch(self, operands: Tensors) -> tuple[int, ...]:
        """The leading axes of operands together. Raises what the NumPy module does."""
        leads = {}
        for name, x, shape in zip(self.names, operands, self.shapes, strict=True):
            axes = x.ndim - len(shape)
            if axes < 0 or x.shape[axes:] != shape:
                state_array(name, np.broadcast_to(0.0, x.shape), *shape)
            leads[name] = x.shape[:axes]
        return broadcast("leading axes", leads)

    def compute(self, operands: Tensors) -> list[torch.Tensor]:
        """Results (..., *shape) in the precision of the operands."""
        if operands and (dtype := operands[0].dtype) is not _DOUBLE:
            return [x.to(dtype) for x in self.compute([x.to(_DOUBLE) for x in operands])]
        plan = self._plans.get(shapes := tuple([x.shape for x in operands]))
        if plan is None:
            plan = self._plans[shapes] = self._plan(operands)
        if plan.repeated:
            pairs = zip(operands, plan.repeated, strict=True)
            operands = [x.expand(shape) if shape else x for x, shape in pairs]
        tensors = [x if x.is_contiguous() else x.contiguous() for x in operands]
        results = [torch.empty(shape, dtype=_DOUBLE) for shape in plan.made]
        addresses = [x.data_ptr() for x in tensors]
        addresses[self._states :] = [
            addresses[self._states + self._owners.index(owner)]
            if owner in self._owners
            else self._address
            for owner in self._compiled.owners
        ]
        addresses += [x.data_ptr() for x in results]
        self._compiled.run(plan.states, plan.by_state, addresses)
        if plan.shared:
            pairs = zip(results, plan.shared, strict=True)
            results = [x.expand(shape).contiguous() for x, shape in pairs]
        return results

    def _plan(self, operands: Tensors) -> _Plan:
        """The plan for operands of these shapes: for one state it takes longer than all else."""
        if len(self._plans) > _MOST_PLANS:
            self._plans.clear()
        batch = self.batch(operands)
        count, compiled = math.prod(batch), self._compiled
        repeated, widths = [], []
        for x, shape in zip(operands, self.shapes, strict=True):
            size = math.prod(shape)
            is_whole = x.numel() in (size, size * count)
            repeated.append(None if is_whole else (*batch, *shape))
            widths.append(0 if x.numel() == size else size)
        of_owners = dict(zip(self._owners, widths[self._states :], strict=True))
        widths[self._states :] = [of_owners.get(owner, 0) for owner in compiled.owners]
        shared = compiled.shared
        return _Plan(
            count,
            compiled.distances(widths),
            tuple(repeated) if any(repeated) else (),
            [
                s if is_shared else (*batch, *s)
                for s, is_shared in zip(self.made, shared, strict=True)
            ],
            [(*batch, *shape) for shape in self.made] if any(shared) else [],
        )

    def rule(self, kind: str, by: str) -> TensorProgram:
        """The program of the gradient, or along a direction, by operands whose places are given.

        Its operands are the inputs, weights or directions, and constants.
        """
        name = f"{kind} {by}"
        if name not in self._rules:
            names = [*self._program.names, *(f"{owner}_parameters" for owner in self._owners)]
            chosen = [names[int(place)] for place in by.split()]
            if kind == "gradient":
                program = gradient(self._program, chosen)
            elif {*chosen} <= {*self._program.names}:
                program = along(self._program, chosen, f"{self._program.name}_along")
            else:
                raise UsageError(
                    f"{self._program.name}: derivatives by parameters are taken in reverse alone; "
                    "use torch.func.jacrev, or backward"
                )
            key = f"{self.key}|{name}"
            self._rules[name] = TensorProgram(program, self._module, self._owners, key)
        return self._rules[name]

    def backward(
        self, called: Called, operands: Tensors, weights: Tensors, needed: Sequence[bool]
    ) -> list[Any]:
        """Gradients by the operands that need them, None by others."""
        count, needed = self._states, tuple(needed)
        if needed not in self._gradients:
            places = [place for place, needs in enumerate(needed) if needs]
            self._gradients[needed] = places, self.rule("gradient", " ".join(map(str, places)))
        places, rule = self._gradients[needed]
        slopes = called(rule, [*operands[:count], *weights, *operands[count:]])
        gradients: list[Any] = [None] * len(operands)
        for place, x in zip(places, slopes, strict=True):
            whole = pad(x, (self._default.size, 0)) if place >= count else x
            shape = operands[place].shape
            gradients[place] = whole if whole.shape == shape else whole.sum_to_size(shape)
        return gradients

    def forward(
        self, called: Called, operands: Tensors, changes: Sequence[Any]
    ) -> tuple[torch.Tensor, ...]:
        """Changes of the results with those of operands, None for no change."""
        count = self._states
        places = [place for place, change in enumerate(changes) if change is not None]
        rule = self.rule("along", " ".join(map(str, places)))
        moved = [changes[place] for place in places]
        return tuple(called(rule, [*operands[:count], *moved, *operands[count:]]))


class Preparation:
    """Constants (..., constants) of the C module of parameters (..., parameters)."""

    def __init__(self, module: ModuleType, key: str) -> None:
        self._module, self.key = module, key
        self.names, self.shapes = ["parameters"], [(len(module.PARAMETERS),)]
        self.made = [(default_constants(module).size,)]
        _KNOWN[key] = self

    def batch(self, operands: Tensors) -> tuple[int, ...]:
        """The leading axes of the operand."""
        return tuple(operands[0].shape[:-1])

    def compute(self, operands: Tensors) -> list[torch.Tensor]:
        """The constants of the C module."""
        values = operands[0].double().numpy()
        by_name = dict(zip(self._module.PARAMETERS, np.moveaxis(values, -1, 0), strict=True))
        constants = torch.from_numpy(np.array(numbers(self._module.prepare(by_name))))
        return [constants.to(operands[0].dtype)]


class _Eager(torch.autograd.Function):  # type: ignore[misc]
    """A program of which autograd knows the derivatives."""

    @staticmethod
    def forward(ctx: Any, program: Any, *operands: Any) -> Any:
        _save(ctx, program, operands)
        return tuple(program.compute(operands))

    @staticmethod
    def backward(ctx: Any, *weights: Any) -> Any:
        needed = ctx.needs_input_grad[1:]
        return None, *ctx.program.backward(_called, ctx.saved_tensors, weights, needed)

    @staticmethod
    def jvp(ctx: Any, _: Any, *changes: Any) -> Any:
        return ctx.program.forward(_called, ctx.saved_tensors, changes)


class _Transformed(_Eager):
    """The same for the transformations of `torch.func`, which takes four times as long."""

    @staticmethod
    def forward(program: Any, *operands: Any) -> Any:  # type: ignore[override]
        return tuple(program.compute(operands))

    @staticmethod
    def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
        _save(ctx, inputs[0], inputs[1:])

    @staticmethod
    def vmap(info: Any, axes: Any, program: Any, *operands: Any) -> Any:
        results = _called(program, _with_batch_first(program, operands, axes[1:]))
        return tuple(results), (0,) * len(results)


# Its own looks in every operand for what torch.func has left behind, as long as all else takes.
_apply = super(torch.autograd.Function, _Eager).apply


def _save(ctx: Any, program: Any, operands: Tensors) -> None:
    ctx.program = program
    ctx.save_for_backward(*operands)
    ctx.save_for_forward(*operands)


def _called(program: Any, operands: Tensors) -> Sequence[torch.Tensor]:
    """Results of a program, which PyTorch can differentiate if gradients are required."""
    if torch.compiler.is_compiling():
        return call([*operands], program.key)
    if torch._C._are_functorch_transforms_active():
        return _Transformed.apply(program, *operands)
    if torch.is_grad_enabled() or torch.autograd.forward_ad._current_level >= 0:
        return _apply(program, *operands)
    return program.compute(operands)


def _with_batch_first(program: Any, operands: Tensors, axes: Sequence[int | None]) -> Tensors:
    """Operands with one more leading axis, the first, where they have it at `axes`."""
    moved = [
        x if axis is None else x.movedim(axis, 0) for x, axis in zip(operands, axes, strict=True)
    ]
    shapes = program.shapes
    most = max(
        x.ndim - len(s) - (a is not None) for x, s, a in zip(moved, shapes, axes, strict=True)
    )
    return [
        x if a is None else x.reshape(x.shape[0], *[1] * (most + 1 + len(s) - x.ndim), *x.shape[1:])
        for x, s, a in zip(moved, shapes, axes, strict=True)
    ]


@torch.library.custom_op("gibbs_codegen::call", mutates_args=())  # type: ignore[untyped-decorator]
def call(operands: list[torch.Tensor], key: str) -> list[torch.Tensor]:
    """Results of a program that has a key."""
    return _known(key).compute(operands)


def _known(key: str) -> Any:
    """The program of a key; its rules are made where they are not there yet."""
    program = _KNOWN.get(key)
    if program is None:
        base, bar, rule = key.rpartition("|")
        if not bar:
            raise UsageError(
                f"{key}: unknown in this process; load the module or make the program before "
                "calling a graph that torch.compile has cached"
            )
        kind, _, by = rule.partition(" ")
        return _known(base).rule(kind, by)
    return program


@call.register_fake  # type: ignore[untyped-decorator]
def _(operands: Any, key: str) -> Any:
    program = _known(key)
    batch = program.batch(operands)
    like = operands[0] if operands else torch.empty(0, dtype=_DOUBLE)
    return [like.new_empty((*batch, *shape)) for shape in program.made]


@call.register_vmap  # type: ignore[untyped-decorator]
def _(_: Any, axes: Any, operands: Any, key: str) -> Any:
    results = call(_with_batch_first(_known(key), operands, axes[0]), key)
    return results, [0] * len(results)


def _setup(ctx: Any, inputs: Any, output: Any) -> None:
    operands, ctx.key = inputs
    ctx.save_for_backward(*operands)


def _backward(ctx: Any, weights: Any) -> Any:
    operands = ctx.saved_tensors
    needed = [x.requires_grad for x in operands]
    return _known(ctx.key).backward(_by_operator, operands, weights, needed), None


def _by_operator(program: Any, operands: Tensors) -> Sequence[torch.Tensor]:
    return call([*operands], program.key)


call.register_autograd(_backward, setup_context=_setup)


@lru_cache(maxsize=64)
def of_entries(program: Program, *, is_inner: bool = False) -> Program:
    """The same of entries alone, each of which may differ from state to state.

    Those of a quaternion are brought to unit length, where it is not called by another of entries.
    """
    inputs, arguments = [], {}
    for name, x in zip(program.names, program.inputs, strict=True):
        entries = variable(name, *x.shape, uniform=is_inner and x.is_uniform)
        inputs.append(entries)
        if x.space:
            coordinates = entries if is_inner else _unit(entries, x.space)
            arguments[x] = coordinates_of(coordinates, x.space)
        else:
            arguments[x] = entries
    outputs = substituted(program, arguments, _with_wheels)
    entries_by_name = {name: entries_of(x) for name, x in outputs.items()}
    return Program(program.name, tuple(inputs), entries_by_name)


def _with_wheels(x: Node) -> Node:
    """The same node; angles of wheels, which displacements do not have, by their rates."""
    call = x.operation
    if isinstance(call, Invocation):
        call = replace(call, program=of_entries(call.program, is_inner=True))
        made = node(call, map(entries_of, x.arguments), x.shape, None, x.is_uniform)
        return coordinates_of(made, x.space) if x.space else made
    if isinstance(call, Entries):
        return entries_of(x.arguments[0])
    if not (isinstance(call, Call) and call.name == "integrate"):
        return x
    wheels = call.functions.layout.q.angles
    if wheels.start == wheels.stop or "coordinate_rates" not in call.functions.signatures:
        return x
    q, displacement = x.arguments
    turned = entries_of(q)[wheels] + call.functions.wheel_rates(q, displacement)
    assert x.space is not None  # noqa: S101 - of coordinates
    return coordinates_of(join(entries_of(x)[: wheels.start], turned), x.space)


def _unit(entries: Node, space: Space) -> Node:
    """Entries of coordinates with a quaternion in them of unit length."""
    if not space.has_quaternion:
        return entries
    turn = entries[3:7]
    return join(entries[:3], turn / square_root(total(turn * turn)), entries[7:])


class TensorFunction:
    """A program as a function of tensors, whose constants may be given."""

    def __init__(self, program: Program, module: ModuleType, key: str) -> None:
        """Take a program of entries."""
        shapes = [x.shape for x in (*program.inputs, *program.outputs.values())]
        text = "\n".join(c_functions([program])) + f"{shapes} {module.compiled.digest}"
        digest = hashlib.sha256(text.encode()).hexdigest()[:16]
        key = f"{module.NAME} {key} {digest}"
        self._name, self._names, owners = program.name, program.names, owners_of(program)
        # torch.compile makes none.
        self._by_owners = {
            some: _KNOWN.get(whole) or TensorProgram(program, module, some, whole)
            for count in range(len(owners) + 1)
            for some in itertools.combinations(owners, count)
            for whole in [f"{key} of {' '.join(some)}"]
        }

    def __call__(
        self, *inputs: Any, constants: Mapping[str, Any] | None = None, **named: Any
    ) -> Any:
        """Results of inputs in their order or by name."""
        if named or len(inputs) != len(self._names):
            names = self._names[len(inputs) :]
            if {*names} != {*named} or len(inputs) > len(self._names):
                raise TypeError(f"{self._name} takes {', '.join(self._names)}")
            inputs = (*inputs, *(named[name] for name in names))
        return self.of_owners(inputs, constants or {})

    def of_owners(self, inputs: Sequence[Any], constants: Mapping[str, Any]) -> Any:
        """Results of inputs, with constants of some owners."""
        owners = tuple(sorted(constants))
        if owners not in self._by_owners:
            known = ", ".join([*self._by_owners][-1]) or "none"
            raise UsageError(f"{self._name}: constants are of {known}, not of {', '.join(owners)}")
        program = self._by_owners[owners]
        results = _called(
            program, tensors(program.names, [*inputs, *map(constants.__getitem__, owners)])
        )
        return results[0] if len(results) == 1 else tuple(results)


def tensors(names: Sequence[str], values: Sequence[Any]) -> list[torch.Tensor]:
    """Real numbers as tensors of one precision, which is that of the tensors among them.

    It is float64 where these differ, or there is none. Raises `TypeError` for other types and other
    devices, and what `real_numbers` does.
    """
    if all(type(x) is torch.Tensor and x.dtype is _DOUBLE and x.is_cpu for x in values):
        return [*values]
    dtype = None
    for name, x in zip(names, values, strict=True):
        if isinstance(x, torch.Tensor):
            if x.dtype not in (_DOUBLE, torch.float32):
                raise TypeError(f"{name} must be float64 or float32, not {str(x.dtype)[6:]}")
            if not x.is_cpu:
                raise TypeError(f"{name} must be on the CPU, not on {x.device}")
            dtype = x.dtype if dtype is None or dtype is x.dtype else _DOUBLE
    dtype = dtype or _DOUBLE
    return [
        x.to(dtype)
        if isinstance(x, torch.Tensor)
        else torch.tensor(x, dtype=dtype)
        if type(x) in (float, int)
        else torch.as_tensor(np.asarray(real_numbers(name, x), dtype=float), dtype=dtype)
        for name, x in zip(names, values, strict=True)
    ]


def broadcast(noun: str, shapes: Mapping[str, torch.Size]) -> tuple[int, ...]:
    """The shape that shapes broadcast to, also where they are symbols; else as `common_shape`."""
    try:
        return torch.broadcast_shapes((), *shapes.values())
    except RuntimeError:
        return common_shape(noun, {name: (*shape,) for name, shape in shapes.items()})


def torch_module(in_c: ModuleType) -> ModuleType:
    """The functions and constants of a module that is loaded for C, on tensors."""
    made = LoadedModule(in_c.in_numpy, "torch")
    made.in_c = in_c  # type: ignore[attr-defined]
    made.prepare = _prepare(in_c)  # type: ignore[attr-defined]
    robot = Functions(in_c)
    for signature in robot.signatures.values():
        setattr(made, signature.name, _ModuleFunction(in_c, robot, signature))
    return made


class _ModuleFunction(GeneralFunction):
    """A function of a module that takes what that of the NumPy module does."""

    def __init__(self, in_c: ModuleType, robot: Functions, signature: Signature) -> None:
        name = signature.name
        self._on_tensors = TensorFunction(of_entries(_program(robot, name)), in_c, name)
        self._size = default_constants(in_c).size + len(in_c.PARAMETERS)
        self._owner, self._arguments = robot.owner, signature.arguments
        super().__init__(self._by_name, getattr(in_c, name))

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call it as the NumPy function is called."""
        if len(arguments) == len(self._arguments) and not named:
            return self._on_tensors.of_owners(arguments, {})
        return super().__call__(*arguments, **named)

    def _by_name(self, by_name: Mapping[str, Any]) -> Any:
        constants = by_name.get("constants")
        if constants is None:
            owners = {}
        elif isinstance(constants, torch.Tensor) and constants.shape[-1:] == (self._size,):
            owners = {self._owner: constants}
        else:
            raise TypeError("constants must be what this module's prepare() returned")
        return self._on_tensors.of_owners([by_name[x] for x in self._arguments], owners)


def _program(robot: Functions, name: str) -> Program:
    """A program of one call of a function; those that call others are programs themselves."""
    if FUNCTIONS[name].composed:
        return emitted_step(robot, name)
    row, signature = FUNCTIONS[name], robot.signatures[name]
    pairs = zip(row.arguments, signature.argument_shapes, strict=True)
    inputs = [
        robot.coordinates(x) if ARGUMENTS[x].is_coordinates else variable(x, *shape)
        for x, shape in pairs
    ]
    outputs = robot.outputs(name, *inputs)
    names = (output.name for output in row.outputs)
    return Program(name, tuple(inputs), dict(zip(names, outputs, strict=True)))


def _prepare(in_c: ModuleType) -> Callable[[Mapping[str, Any]], Any]:
    """The function `prepare` of a module."""
    key = f"{in_c.NAME} constants {in_c.compiled.digest}"
    program = _KNOWN.get(key) or Preparation(in_c, key)

    def prepare(parameters: Mapping[str, Any]) -> Any:
        if unknown := {**parameters}.keys() - in_c.PARAMETERS.keys():
            in_c.prepare(dict.fromkeys(unknown, 0.0))
        values = tensors([*parameters], [*parameters.values()])
        dtype = values[0].dtype if values else _DOUBLE
        changes = dict(zip(parameters, values, strict=True))
        shape = broadcast("values", {name: x.shape for name, x in changes.items()})
        rows = torch.stack(
            [
                (changes[name] if name in changes else torch.tensor(x, dtype=dtype)).expand(shape)
                for name, x in in_c.PARAMETERS.items()
            ],
            -1,
        )
        return torch.cat([*_called(program, [rows.detach()]), rows], -1)

    prepare.__doc__ = """Constants of the other functions for given parameters.

    `parameters` maps names of PARAMETERS to numbers or to tensors, which broadcast; a name that is
    left out keeps its default. The constants are a tensor (..., size), to be passed on as it is,
    which PyTorch differentiates by the parameters. Raises TypeError and ValueError as the NumPy
    module does.
    """
    prepare.__module__ = in_c.__name__
    return prepare
