"""The tape of closed forms: it names nothing, so results are expressions in the inputs."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext

import sympy as sp

from gibbs_codegen.symbolic.tape import Stage


class InlineTape:
    """A tape that names nothing: the derivation's results are closed-form expressions."""

    def symbol(self, name: str, stage: Stage) -> sp.Symbol:
        """An input; its stage is not used."""
        return sp.Symbol(name)

    def let(self, expression: sp.Expr) -> sp.Expr:
        """The expression itself."""
        return expression

    def group(
        self, words: str, earliest: Stage = Stage.CONFIGURATION
    ) -> AbstractContextManager[None]:
        """A context that does nothing: nothing is named, so there is nothing to say of it."""
        return nullcontext()
