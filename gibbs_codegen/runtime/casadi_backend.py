"""The CasADi back end: the functions of a generated module as CasADi's functions of SX symbols.

The emitted code runs on symbols, so they are made of the same operations as the module's. Each is
made when it is first used.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

import casadi

from gibbs_codegen.arrays.evaluation import evaluate_casadi
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.emitted.preparation import real_numbers
from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, Signature, module_signatures
from gibbs_codegen.machine.steps import emitted_step
from gibbs_codegen.runtime.kernels import Kernels
from gibbs_codegen.runtime.loaded_module import LoadedModule

_ELEMENTARY = {
    "sin": casadi.sin,
    "cos": casadi.cos,
    "sqrt": casadi.sqrt,
    "atan": casadi.atan,
    "sign": lambda x: casadi.copysign(1.0, x),  # CasADi's sign of zero is zero.
}
_QUATERNION = ("qx", "qy", "qz", "qw")


class CasadiFunction(casadi.Function):
    """A function of a module with the default parameters; `constants` selects others.

    `with_constants` is the same function with one more input, `constants`, the last.
    """

    def __init__(
        self, function: casadi.Function, with_constants: casadi.Function, doc: str | None
    ) -> None:
        """Take a function with the default constants, and with constants to be given."""
        super().__init__(function)
        self.with_constants = with_constants
        self.__doc__ = doc

    def __call__(self, *arguments: Any, constants: Any = None, **named: Any) -> Any:
        """Call it as CasADi's functions are called, by position or by name.

        Arguments are numbers, DM, SX or MX. `constants` are what the module's `prepare` returned,
        or None for the default parameters; they may be given by position, after the arguments.
        Returns one output or a tuple of them, or where arguments have names, a dictionary. Raises
        `TypeError` if the constants are not this module's, or are given twice.
        """
        function = casadi.Function(self)
        if len(arguments) == self.n_in() + 1:
            if constants is not None:
                raise TypeError(f"{self.name()}() got constants both by position and by name")
            arguments, constants = arguments[:-1], arguments[-1]
        if constants is not None:
            function = self.with_constants
            size = function.size1_in("constants")
            if getattr(constants, "shape", ())[:1] != (size,):
                raise TypeError("constants must be what this module's prepare() returned")
            if named:
                named["constants"] = constants
            else:
                arguments = (*arguments, constants)
        if arguments or named:
            return function(*arguments, **named)
        return function.call([])[0]  # CasADi gives a dictionary where nothing is given.

    def __reduce__(self) -> tuple[Any, ...]:
        return CasadiFunction, (casadi.Function(self), self.with_constants, self.__doc__)

    def __copy__(self) -> CasadiFunction:
        return self  # CasADi's functions do not change.

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> CasadiFunction:
        return self


class CasadiModule(LoadedModule):
    """A module's functions, of the type `CasadiFunction`, and constants, computed by CasADi.

    Functions are made when they are first looked up.
    """

    def __init__(self, module: ModuleType) -> None:
        super().__init__(module, "casadi")
        self._module = module
        self._kernels = Kernels(module, _ELEMENTARY)
        self._default = casadi.DM(module.prepare({}))
        self._signatures = {signature.name: signature for signature in module_signatures(module)}

    def __getattr__(self, name: str) -> Any:
        if name not in self.__dict__.get("_signatures", ()):
            return super().__getattr__(name)
        made = self._made(self._signatures[name])
        setattr(self, name, made)
        return made

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._signatures, "prepare"})

    def prepare(self, parameters: Mapping[str, Any]) -> Any:
        """Constants of the functions for parameters that differ from the defaults, by name.

        These are numbers, or SX or MX symbols, beside which the numbers are not checked. Returns a
        column of the type of the symbols, or a DM where all are numbers. Raises what the NumPy
        module's `prepare` does, and `TypeError` if a value is a vector or a matrix, or both SX and
        MX are among them.
        """
        by_name = {**parameters}
        for name, value in by_name.items():
            symbolic = isinstance(value, casadi.DM | casadi.SX | casadi.MX)
            shape = value.shape if symbolic else real_numbers(name, value).shape
            if shape != ((1, 1) if symbolic else ()):
                raise TypeError(f"{name} must be one number or symbol, not of shape {shape}")
            by_name[name] = float(value) if isinstance(value, casadi.DM) else value
        kinds = {type(value) for value in by_name.values()} & {casadi.SX, casadi.MX}
        if not kinds:
            return casadi.DM(self._module.prepare(by_name))
        if len(kinds) > 1:
            raise TypeError("symbols among the parameters must be all SX or all MX")
        self._module.prepare({name: self.PARAMETERS.get(name, 0.0) for name in by_name})
        if "_prepared" not in self.__dict__:
            symbols = casadi.SX.sym("parameters", len(self.PARAMETERS))
            values = dict(zip(self.PARAMETERS, casadi.vertsplit(symbols), strict=True))
            column = casadi.vertcat(*self._kernels.constants(values))
            self._prepared = casadi.Function(
                "prepare", [symbols], [column], ["parameters"], ["constants"]
            )
        return self._prepared(casadi.vertcat(*{**self.PARAMETERS, **by_name}.values()))

    def _made(self, signature: Signature) -> CasadiFunction:
        name, names = signature.name, [*signature.arguments]
        symbols = [
            casadi.SX.sym(argument, *shape)
            for argument, shape in zip(names, signature.argument_shapes, strict=True)
        ]
        constants = casadi.SX.sym("constants", *self._default.shape)
        values = [
            self._normalised(argument, symbol)
            for argument, symbol in zip(names, symbols, strict=True)
        ]
        if FUNCTIONS[name].composed:
            columns = {x: casadi.vertcat(*value) for x, value in zip(names, values, strict=True)}
            of_calls = {"robot": self}, {"robot": constants}
            step = evaluate_casadi(emitted_step(Functions(self), name), columns, *of_calls)
            outputs = [casadi.sparsify(step[output.name]) for output in FUNCTIONS[name].outputs]
        else:
            computed = self._kernels.outputs(signature, casadi.vertsplit(constants), *values)
            outputs = [*map(_matrix, computed, signature.shapes)]
        results = [output.name for output in FUNCTIONS[name].outputs]
        function = casadi.Function(
            name, [*symbols, constants], outputs, [*names, "constants"], results
        )
        by_default = function.call([*symbols, self._default])
        default = casadi.Function(name, symbols, by_default, names, results)
        return CasadiFunction(default, function, getattr(self._module, name).__doc__)

    def _normalised(self, argument: str, symbol: Any) -> list[Any]:
        """Entries of an argument, row by row, those of a quaternion divided by its length.

        The module's functions expect a unit quaternion. A solver's iterates are none, and its
        derivatives by a quaternion's entries are to be those of what is defined beside them.
        """
        entries = casadi.vertsplit(casadi.vec(symbol.T))
        if self.ATTITUDE == "quaternion" and ARGUMENTS[argument].is_coordinates:
            places = [self.COORDINATES.index(name) for name in _QUATERNION]
            squared = casadi.sumsqr(casadi.vertcat(*(entries[place] for place in places)))
            scale = casadi.sqrt(squared) * (1 / squared)  # Not finite where the square is not.
            for place in places:
                entries[place] = entries[place] * scale
        return entries


def _matrix(entries: Sequence[Any], shape: tuple[int, ...]) -> Any:
    """An output as CasADi's SX: a vector dense, all else without the zeros of every state.

    Blocks of an array of more than two axes are one below the other.
    """
    *above, width = shape if len(shape) > 1 else (*shape, 1)
    # Those that are zero in the emitted code; CasADi may find more than PATTERNS has.
    kept = [
        place
        for place, x in enumerate(entries)
        if len(shape) < 2 or isinstance(x, casadi.SX) or x != 0.0
    ]
    kept.sort(key=lambda place: (place % width, place // width))
    rows, columns = [place // width for place in kept], [place % width for place in kept]
    pattern = casadi.Sparsity.triplet(math.prod(above), width, rows, columns)
    return casadi.SX(pattern, casadi.SX(casadi.vertcat(*(entries[place] for place in kept))))
