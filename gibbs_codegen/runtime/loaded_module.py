"""Modules of `load`, whatever the back end: constants of the robot, and functions to come."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from types import ModuleType
from typing import Any, NoReturn

from gibbs_codegen.errors import MissingFunctionError, no_attribute
from gibbs_codegen.interface import DATA, DATA_ON_REQUEST, FUNCTIONS
from gibbs_codegen.interface.choice import options_with

# Functions that bring what is no function of the table.
_BROUGHT_BY = {
    "BASE_PARAMETERS": "base_parameters",
    "PATTERNS": "forward_dynamics_derivatives",
    "step": "step_euler",
    "step_derivatives": "step_euler_derivatives",
}


class LoadedModule(ModuleType):
    """The constants of a module; the error for what it lacks names the option that adds it.

    `backend` computes its functions: "numpy", "c", "casadi", "jax" or "torch".
    """

    backend = "numpy"

    def __init__(self, module: ModuleType, backend: str) -> None:
        """Take the constants of a NumPy module, to which a back end adds its functions."""
        super().__init__(module.__name__, module.__doc__)
        self.__file__ = module.__file__
        self.__path__ = module.__path__
        self.backend, self.in_numpy = backend, module
        for name in (*DATA, *DATA_ON_REQUEST):
            if hasattr(module, name):
                setattr(self, name, getattr(module, name))

    def __getattr__(self, name: str) -> Any:
        """Raise `MissingFunctionError` for what can be generated, else `AttributeError`."""
        if _BROUGHT_BY.get(name, name) in FUNCTIONS:
            require_functions(self, [name])
        raise AttributeError(no_attribute(self.__name__, name, [*vars(self), *FUNCTIONS]))


def gravity_of(module: Any, layout: Any, constants: Any) -> Any:
    """The acceleration of gravity along z (…), m/s², world axes; negative where things fall.

    It is that by default for a base that does not rise, whose functions do not have it.
    """
    import numpy as np  # Late, since it takes long to import.

    along, upwards = layout.own_axes[0], layout.v.position.start
    if 2 not in along:
        return np.array(-module.PARAMETERS.get("gravity", 0.0))
    neutral, upwards = np.array(layout.neutral), upwards + along.index(2)
    pull = module.gravity_forces(neutral, constants=constants)[..., upwards]
    return pull / module.mass_matrix(neutral, constants=constants)[..., upwards, upwards]


class GeneralFunction:
    """A compiled function for any arguments, taken as the function `like` does.

    It has the name and the documentation of `like`.
    """

    def __init__(
        self, evaluate: Callable[[Mapping[str, Any]], Any], like: Callable[..., Any]
    ) -> None:
        functools.update_wrapper(self, like)
        self._name = like.__name__
        self._evaluate = evaluate
        signature = inspect.signature(like)
        self._bind = signature.bind
        self._required = [
            name for name, entry in signature.parameters.items() if entry.default is entry.empty
        ]

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call it as `like` is called."""
        if len(arguments) == len(self._required) and not named:
            return self._evaluate(dict(zip(self._required, arguments, strict=True)))
        try:
            by_name = self._bind(*arguments, **named).arguments
        except TypeError as error:
            raise TypeError(f"{self._name}() {error}") from None
        return self._evaluate(by_name)

    def __repr__(self) -> str:
        return f"<compiled function {self._name}>"

    def __reduce__(self) -> NoReturn:
        # By its name the NumPy function would be found instead.
        raise TypeError(
            f"{self._name}() is compiled code, which cannot be pickled: load the module in every "
            "process and pass arrays and constants"
        )

    def __copy__(self) -> GeneralFunction:
        return self

    def __deepcopy__(self, _: object) -> GeneralFunction:
        return self


def require_functions(module: ModuleType, names: Iterable[str]) -> None:
    """Raise `MissingFunctionError` for functions, or what comes with some, that a module lacks."""
    if missing := [name for name in names if name not in vars(module)]:
        has = [function for function in FUNCTIONS if function in vars(module)]
        options = options_with([_BROUGHT_BY.get(name, name) for name in missing], has)
        raise MissingFunctionError(module.NAME, missing, options)
