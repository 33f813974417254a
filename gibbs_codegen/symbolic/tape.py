"""The tape: a straight-line program that writes itself while the equations are derived.

The recursions run over SymPy scalars. `Tape.let(expr)` names a result as it is made and returns
the new symbol, the same symbol for the same expression, so nothing is ever expanded and common
subexpressions are found by hashing. Numbers, symbols, zeros and signs pass through: nothing is
multiplied by 0 or 1, and x − y and y − x share one name.

Each name belongs to the earliest stage that knows its symbols. Factors and terms of the parameter
stage are combined first, so that whatever depends on parameters alone is a statement of that stage.

The derivation says what it computes with `Tape.group`. These words become the comments of the
emitted code, where a name that several functions share has in each the words of that function.

With an `InlineTape`, whose `let` returns its argument, the same derivation yields closed forms.

SymPy looks through all factors and terms for what can be put together. Where they are different
symbols there is nothing to find: such products and sums are made here, in SymPy's order, in a
fraction of the time.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from enum import IntEnum
from operator import itemgetter

import sympy as sp

_MINUS_ONE = sp.S.NegativeOne


def times(a: sp.Expr, b: sp.Expr) -> sp.Expr:
    """SymPy's a·b."""
    if a is sp.S.Zero or b is sp.S.Zero:
        return sp.S.Zero
    if a.is_Symbol and b.is_Symbol and a is not b:
        factors = (a, b) if a.name < b.name else (b, a)
        return sp.Mul._from_args(factors, is_commutative=True)
    is_number = a.is_Number and a is not sp.S.One and bool(a)
    if (is_number and b.is_Symbol) or (a.is_Symbol and b.is_Add):
        return sp.Mul._from_args((a, b), is_commutative=True)
    if is_number and b.is_Mul and b.args[0].is_Symbol:
        return sp.Mul._from_args((a, *b.args), is_commutative=True)
    if is_minus_symbol(a):
        return negated(times(a.args[1], b))
    if is_minus_symbol(b):
        return negated(times(a, b.args[1]))
    return a * b


def negated(a: sp.Expr) -> sp.Expr:
    """SymPy's −a."""
    factors = a.args if a.is_Mul else (a,)
    if factors[0] is _MINUS_ONE:
        return sp.Mul._from_args(factors[1:], is_commutative=True)
    if factors[0].is_Symbol:
        return sp.Mul._from_args((_MINUS_ONE, *factors), is_commutative=True)
    if a.is_Mul and factors[0].is_Number:
        return sp.Mul._from_args((-factors[0], *factors[1:]), is_commutative=True)
    return -a


def plus(*terms: sp.Expr) -> sp.Expr:
    """SymPy's sum of terms."""
    numbers = [term for term in terms if term.is_Number and term is not sp.S.Zero]
    # By the names of its factors, which no other term may have: what SymPy sorts by, and the term.
    named: dict[tuple[str, ...], tuple[tuple[int, tuple[str, ...]], sp.Expr]] = {}
    for term in terms:
        if term.is_Number:
            continue
        factors = term.args if term.is_Mul else (term,)
        minus = factors[0] is _MINUS_ONE
        names = tuple([factor.name for factor in factors[minus:] if factor.is_Symbol])
        if len(names) != len(factors) - minus or len(names) > 2 or names in named:
            return sp.Add(*terms)
        named[names] = (2 * len(factors) - minus, names), term
    if len(numbers) > 1:
        return sp.Add(*terms)
    ordered = sorted(named.values(), key=itemgetter(0))
    return sp.Add._from_args((*numbers, *[term for _, term in ordered]), is_commutative=True)


def signed(atom: sp.Expr) -> tuple[int, sp.Expr]:
    """Sign, 1 or −1, and magnitude of a result of `let`."""
    if atom.is_Symbol:
        return 1, atom
    if is_minus_symbol(atom):
        return -1, atom.args[1]
    return (-1, -atom) if atom.is_negative else (1, atom)


def is_minus_symbol(term: sp.Expr) -> bool:
    """True if an expression is a symbol with a minus sign."""
    if not term.is_Mul or len(term.args) != 2:
        return False
    sign, rest = term.args
    return sign is sp.S.NegativeOne and bool(rest.is_Symbol)


def whole_power(factor: sp.Expr) -> tuple[sp.Expr, int]:
    """√x and n of a factor x^(n/2), x and n of xⁿ.

    Raises `TypeError` where twice the exponent is not a whole number.
    """
    base, exponent = factor.as_base_exp()
    if exponent.is_Integer:
        return base, int(exponent)
    if (2 * exponent).is_Integer:
        return sp.sqrt(base), int(2 * exponent)
    raise TypeError(f"no program has a power like {factor}: twice its exponent must be whole")


# A sign, 1 or −1, with a symbol or a number.
SignedTerm = tuple[int, sp.Expr]
# The group of what a recursion over the state makes of parameters alone.
WORDS_OF_CONSTANTS = "constant terms and factors of the functions"


class Stage(IntEnum):
    """When a value can be computed: once per parameter set, per configuration, or per motion."""

    PARAMETER = 0
    CONFIGURATION = 1
    MOTION = 2


# Before Python 3.12 members take long to be looked up in their class.
_PARAMETER = Stage.PARAMETER

# Three components in one frame.
Vector = tuple[sp.Expr, ...]
# Entries of a row, a column or an argument.
Values = Sequence[sp.Expr]
# Products in a line of a sum of products.
_PRODUCTS = 3


class Scalars(ABC):
    """The part of a tape that derivations need: names of scalars and of components of vectors."""

    @abstractmethod
    def symbol(self, name: str, stage: Stage) -> sp.Symbol:
        """An input of the program by its name, with the stage at which its value is known."""

    @abstractmethod
    def let(self, expression: sp.Expr) -> sp.Expr:
        """Name a sum of products of earlier results; the result stands for it."""

    @abstractmethod
    def group(
        self, words: str, earliest: Stage = Stage.CONFIGURATION
    ) -> AbstractContextManager[None]:
        """Say what is computed in a `with` block; of nested blocks the innermost counts.

        The words are those of a comment of the emitted code. What is made there of a stage before
        `earliest` belongs to the constants.
        """

    def add(self, *vectors: Vector) -> Vector:
        """Sum of vectors in one frame."""
        return tuple([self.let(plus(*entries)) for entries in zip(*vectors, strict=True)])

    def scale(self, factor: sp.Expr, vector: Vector) -> Vector:
        """Vector times scalar."""
        return tuple([self.let(times(factor, entry)) for entry in vector])

    def cross(self, a: Vector, b: Vector) -> Vector:
        """Vector product a × b, in one frame."""
        return tuple(
            self.less(times(a[i - 2], b[i - 1]), times(a[i - 1], b[i - 2])) for i in range(3)
        )

    def dot(self, a: Vector, b: Vector) -> sp.Expr:
        """Scalar product a·b, in one frame."""
        return self.let(plus(*map(times, a, b)))

    def less(self, first: sp.Expr, *others: sp.Expr) -> sp.Expr:
        """The first value less the others."""
        return self.let(plus(first, *map(negated, others)))

    def sum_of_products(self, a: Values, b: Values, *others: sp.Expr) -> sp.Expr:
        """Σ a_i·b_i, and `others` added.

        It is named after every third product, so that the same sum in another column is written in
        the same lines, and lines that repeat become loops.
        """
        pairs = [(p, q) for p, q in zip(a, b, strict=True) if p != 0 and q != 0]
        products = [self.let(times(p, q)) for p, q in pairs]
        whole: sp.Expr = sp.S.Zero
        for first in range(0, len(products), _PRODUCTS):
            last = first + _PRODUCTS >= len(products)
            part = products[first : first + _PRODUCTS]
            whole = self.let(plus(whole, *part, *(others if last else ())))
        return whole if products else self.let(plus(*others))

    def combination(self, factors: Values, lists: Sequence[Values]) -> list[sp.Expr]:
        """Lists of one length, each times its factor, added up entry by entry."""
        return [self.sum_of_products(factors, entries) for entries in zip(*lists, strict=True)]


@dataclass
class _Returned:
    """A result of `let`, what it was made of, and the words of the last function that let it."""

    result: sp.Expr
    parts: list[sp.Expr]
    words: dict[sp.Symbol, str]


class Tape(Scalars):
    """A tape that names every non-trivial result.

    `statements` maps each temporary to its definition, an expression of one kind of operation in
    earlier symbols, in the order in which they were made; `groups` to the words of the group in
    which it was first made. `stages` has the stage of every input and temporary, oldest first.
    """

    def __init__(self) -> None:
        self.statements: dict[sp.Symbol, sp.Expr] = {}
        self.groups: dict[sp.Symbol, str] = {}
        self._words = self.groups
        self._group = ("", Stage.PARAMETER)
        self.stages: dict[sp.Symbol, Stage] = {}
        self._ranks: dict[sp.Symbol, int] = {}
        # What `let` has returned for an expression; what it has named and let for the present one;
        # the name of each definition.
        self._returned: dict[sp.Expr, _Returned] = {}
        self._parts: list[sp.Expr] = []
        self._names: dict[sp.Expr, sp.Symbol] = {}

    def symbol(self, name: str, stage: Stage) -> sp.Symbol:
        """An input of the program by its name, with the stage at which its value is known."""
        symbol = sp.Symbol(name)
        if symbol not in self.stages:
            self._register(symbol, stage)
        return symbol

    def stage(self, symbol: sp.Symbol) -> Stage:
        """When the value of an input or a temporary is known."""
        return self.stages[symbol]

    @contextmanager
    def group(self, words: str, earliest: Stage = Stage.CONFIGURATION) -> Iterator[None]:
        """Put what is first named in a `with` block into a group, by the words of a comment.

        What is made there of a stage before `earliest` belongs to the constants. The outer group
        counts again after the block.
        """
        outer, self._group = self._group, (words, earliest)
        try:
            yield
        finally:
            self._group = outer

    @contextmanager
    def function(self) -> Iterator[dict[sp.Symbol, str]]:
        """Derive one function: what has a name keeps it, but its words are said anew.

        Yields the words of the groups as they are said in the `with` block.
        """
        outer, self._words = self._words, {}
        try:
            yield self._words
        finally:
            self._words = outer

    def let(self, expression: sp.Expr) -> sp.Expr:
        """Name a result, once for the same expression: a number, or a symbol, maybe with a minus.

        Later passes may regroup sums of what varies: a compensated sum of such does not survive.
        """
        if expression.is_Symbol or expression.is_Number:
            return expression
        self._parts.append(expression)
        returned = self._returned.get(expression)
        if returned is None:
            outer, self._parts = self._parts, []
            result = self._name(expression)
            self._returned[expression] = _Returned(result, self._parts, self._words)
            self._parts = outer
            return result
        # Where another function has named it, only its words are new.
        if returned.words is not self._words:
            returned.words = self._words
            for part in returned.parts:
                if part.is_Symbol:
                    self._say(part)
                else:
                    self.let(part)
        return returned.result

    def _name(self, expression: sp.Expr) -> sp.Expr:
        if expression.is_number:
            return expression
        if expression.is_Add:
            return self._name_sum(expression)
        if expression.is_Pow and expression.exp is sp.S.Half:
            argument = self.let(expression.base)
            return self._define(sp.sqrt(argument), self.stages[signed(argument)[1]])
        if expression.is_Mul or expression.is_Pow:
            return self._name_product(expression)
        if isinstance(expression, (sp.sin, sp.cos, sp.atan, sp.sign)):
            argument = self.let(expression.args[0])
            direct = expression.func(argument)
            # sin(−x) = −sin(x), which SymPy has just applied, is no such function any more.
            same = direct.func is expression.func
            return self._define(direct, self.stages[argument]) if same else self.let(direct)
        raise TypeError(f"the tape has no rule for {type(expression).__name__}: {expression}")

    def _name_product(self, expression: sp.Expr) -> sp.Expr:
        if expression.is_Mul:
            first, second, *rest = expression.args
            if first is _MINUS_ONE:
                return negated(self._name_product(negated(expression)))
            if not rest and first.is_Symbol and second.is_Symbol:  # By far the most frequent.
                return self._define(expression, max(self.stages[first], self.stages[second]))
        number: sp.Expr = sp.S.One
        factors: list[sp.Symbol] = []
        for factor in sp.Mul.make_args(expression):
            if factor.is_number:
                number *= factor
                continue
            base, exponent = whole_power(factor)
            sign, symbol = signed(self.let(base))
            number *= sign ** abs(exponent)
            if exponent < 0:
                symbol = self._define(1 / symbol, self.stages[symbol])
            factors.extend([symbol] * abs(exponent))
        if number.is_negative:
            return -self._product(-number, factors)
        return self._product(number, factors)

    def _product(self, number: sp.Expr, factors: list[sp.Symbol]) -> sp.Expr:
        factors.sort(key=lambda symbol: (self.stages[symbol], self._ranks[symbol]))
        hoisted = [f for f in factors if self.stages[f] is _PARAMETER]
        varying = factors[len(hoisted) :]
        constant = sp.Mul(number, *hoisted)
        if not varying:
            return constant if constant.is_Symbol else self._define(constant, _PARAMETER)
        product = varying[0]
        for factor in varying[1:]:
            product = self._define(times(product, factor), self.stages[factor])
        if constant == 1:
            return product
        if hoisted and not constant.is_Symbol:
            constant = self._define(constant, _PARAMETER)
        return self._define(times(constant, product), self.stages[product])

    def _name_sum(self, expression: sp.Expr) -> sp.Expr:
        terms = []
        for term in expression.args:
            # A signed symbol is its own name, and stays the same object.
            is_atom = term.is_Symbol or is_minus_symbol(term) or term.is_number
            terms.append(signed(term if is_atom else self.let(term)))
        symbols = [term for _, term in terms if term.is_Symbol]
        numbers = [term for _, term in terms if not term.is_Symbol]
        # A symbol may stand there twice, or two numbers, or a zero.
        if len({*symbols}) < len(symbols) or len(numbers) > 1 or 0 in numbers:
            named = sp.Add(*(sign * term for sign, term in terms))
            if not named.is_Add:
                return self.let(named)
            terms = [signed(term) for term in named.args]
        hoisted: list[SignedTerm] = []
        varying: list[SignedTerm] = []
        for sign, term in terms:
            constant = term.is_number or self.stages[term] is _PARAMETER
            (hoisted if constant else varying).append((sign, term))
        if not varying:
            return self._signed_sum(hoisted, _PARAMETER)
        if len(hoisted) > 1:
            hoisted = [signed(self._signed_sum(hoisted, _PARAMETER))]
        stage = max(self.stages[term] for _, term in varying)
        return self._signed_sum(hoisted + varying, stage)

    def _signed_sum(self, terms: list[SignedTerm], stage: Stage) -> sp.Expr:
        """Name a sum up to its sign: fewer minus signs than plus signs, the first term positive."""
        if len(terms) == 1:
            sign, term = terms[0]
            return sign * term
        negative = sum(sign < 0 for sign, _ in terms)
        first, _ = min(terms, key=lambda term: self._ranks.get(term[1], -1))
        if 2 * negative > len(terms) or (2 * negative == len(terms) and first < 0):
            return negated(self._signed_sum([(-sign, term) for sign, term in terms], stage))
        return self._define(plus(*[t if sign > 0 else negated(t) for sign, t in terms]), stage)

    def _define(self, expression: sp.Expr, stage: Stage) -> sp.Expr:
        name = self._names.get(expression)
        if name is None:
            prefix = "k" if stage is _PARAMETER else "t"
            name = self._names[expression] = sp.Symbol(f"{prefix}{len(self.statements)}")
            self._register(name, stage)
            self.statements[name] = expression
        self._parts.append(name)
        self._say(name)
        return name

    def _say(self, name: sp.Symbol) -> None:
        """Put a name into the group of the present block, unless the function has put it before."""
        words, earliest = self._group
        words = words if self.stages[name] >= earliest else WORDS_OF_CONSTANTS
        self.groups.setdefault(name, words)
        self._words.setdefault(name, words)

    def _register(self, symbol: sp.Symbol, stage: Stage) -> None:
        self.stages[symbol] = stage
        self._ranks[symbol] = len(self._ranks)


class InlineTape(Scalars):
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
