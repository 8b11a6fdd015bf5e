"""The domain of Z3 terms: the third number domain of the semantics.

A scalar is one of Python's own constants where it is known, and a Z3 term elsewhere; operators on
constants are those of the exact domain, so a run on constants never leaves Python. Enumeration
members and strings are Z3 integers (a string by its number in a table), opaque values are of an
uninterpreted sort each.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from fractions import Fraction
from functools import cached_property
from typing import TypeAlias, assert_never

from koord.semantics.domain import Constant, binary_of_numbers, unary_of_numbers
from koord.syntax.budget import ENDLESS, Budget
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import (
    BoolType,
    EnumType,
    FloatType,
    IntType,
    OpaqueType,
    StreamType,
    StringType,
    Type,
)
from koord.verify.encoding.contexts import new_context
from koord.verify.encoding.z3_builder import TermBuilder, require, same, spent_by
from koord.verify.encoding.z3_loading import z3

Term: TypeAlias = "Constant | z3.ExprRef"

#: A term that is no constant of Python's.
Made: TypeAlias = z3.ExprRef
Sort: TypeAlias = z3.SortRef

#: What a quick look at a formula costs, in steps of evaluation.
_QUICK_LOOK = 25

#: What a solver may spend on it, in its own units.
_QUICK_LIMIT = 200_000

#: So many of a solver's own units of work take as long as a step of evaluation, or less: what asks
#: for little takes half as long again for each of them, and what multiplies unknowns several times.
_PER_STEP = 100


class Terms:
    """The number domain of Z3 terms. One instance per solver run: it owns the string table.

    It has a Z3 context of its own too: what a solver answers depends on the names and the age of
    all terms of its context, so with a shared one answers would depend on what was asked before.
    It is made with the first term, as it takes longer than many a run on constants. Building terms
    spends the ``budget``: formulas can take longer to write than to decide.
    """

    def __init__(self, budget: Budget = ENDLESS) -> None:
        self._budget = budget
        self._strings: dict[str, int] = {}
        self._sorts: dict[str, z3.SortRef] = {}
        self._lists: dict[str, z3.DatatypeSortRef] = {}
        self._counter = 0
        self._nowhere: dict[int, z3.ExprRef] = {}
        self._quick: z3.Solver | None = None
        #: whether unknown reals were multiplied, which solvers rarely come to an end with
        self.has_products = False

    @cached_property
    def context(self) -> z3.Context:
        """The Z3 context of all terms."""
        return new_context(z3.Context)

    def follow(self, other: Terms) -> None:
        """Take over the context of other terms, if they needed one.

        Nothing is asked of them any more, so that it is always the same that was asked before.
        """
        if "context" in vars(other):
            self.context = other.context
            self._sorts, self._lists = other._sorts, other._lists

    @cached_property
    def _make(self) -> TermBuilder:
        return TermBuilder(self.context)

    @cached_property
    def _bool(self) -> z3.SortRef:
        return z3.BoolSort(self.context)

    @cached_property
    def _int(self) -> z3.SortRef:
        return z3.IntSort(self.context)

    @cached_property
    def _real(self) -> z3.SortRef:
        return z3.RealSort(self.context)

    # --- the five methods of a domain -----------------------------------------------------------

    def const(self, value: Constant, type_: Type) -> Term:
        if isinstance(type_, FloatType):
            return Fraction(value)
        if isinstance(type_, OpaqueType):
            return self._make.constant(str(value), self.sort(type_))
        return value

    def known(self, value: Term) -> Constant | None:
        return None if isinstance(value, z3.ExprRef) else value

    def unary(self, op: UnaryOp, operand: Term) -> Term:
        if not isinstance(operand, z3.ExprRef):
            return unary_of_numbers(op, operand, exact=True)
        self._budget.spend()
        match op:
            case UnaryOp.NOT:
                return self._make.negation(operand)
            case UnaryOp.NEG:
                return self._make.opposite(operand)
            case UnaryOp.ABS:
                below = self._make.less(operand, self._like(0, operand))
                return self._make.choice(below, self._make.opposite(operand), operand)
            case UnaryOp.WIDEN:
                return self._make.widened(operand)
        assert_never(op)

    def binary(self, op: BinaryOp, left: Term, right: Term) -> Term:
        if not isinstance(left, z3.ExprRef) and not isinstance(right, z3.ExprRef):
            return binary_of_numbers(op, left, right)
        self._budget.spend()
        if op is BinaryOp.AND or op is BinaryOp.OR or op is BinaryOp.IMPLIES:
            return self._connective(op, left, right)
        return self._operation(op, *self._alike(left, right))

    def ite(self, condition: Term, then: Term, other: Term) -> Term:
        if not isinstance(condition, z3.ExprRef):
            return then if condition else other
        self._budget.spend()
        if self._same(then, other):
            return then
        if isinstance(then, bool) or isinstance(other, bool):
            return self._boolean_ite(condition, then, other)
        return self._make.choice(condition, *self._alike(then, other))

    # --- terms ----------------------------------------------------------------------------------

    def report(self, units: int) -> None:
        """Tell of so many units of work that a solver did on terms."""
        self._budget.report(units // _PER_STEP)

    def sort(self, type_: Type) -> z3.SortRef:
        """The Z3 sort of a scalar type."""
        match type_:
            case IntType() | EnumType() | StringType() | StreamType():
                return self._int
            case FloatType():
                return self._real
            case BoolType():
                return self._bool
            case OpaqueType(name=name):
                if name not in self._sorts:
                    self._sorts[name] = z3.DeclareSort(name, self.context)
                return self._sorts[name]
            case _:
                raise AssertionError(f"{type_} is no scalar type")

    def lifted(self, value: Term, sort: z3.SortRef) -> z3.ExprRef:
        """Convert a constant to a term of a sort; terms stay as they are."""
        if isinstance(value, z3.ExprRef):
            return value
        if isinstance(value, bool):
            return self._make.truth(value=value)
        if isinstance(value, str):
            value = self._strings.setdefault(value, len(self._strings))
            return self._make.numeral(value, real=False)
        return self._number(value, real=sort.kind() == z3.Z3_REAL_SORT)

    def _number(self, value: int | float | Fraction, *, real: bool) -> z3.ExprRef:
        return self._make.numeral(Fraction(value) if real else int(value), real=real)

    def _like(self, value: Term, term: z3.ExprRef) -> z3.ExprRef:
        """Convert a constant to a term of the sort of another; terms stay as they are."""
        if isinstance(value, int | float | Fraction) and not isinstance(value, bool):
            return self._number(value, real=self._make.sort_kind(term) == z3.Z3_REAL_SORT)
        return self.lifted(value, self._int)  # no number: its sort is known

    def boolean(self, value: Term) -> z3.BoolRef:
        """Convert a Boolean scalar to a formula."""
        lifted = self.lifted(value, self._bool)
        assert isinstance(lifted, z3.BoolRef)
        return lifted

    def fresh(self, name: str, type_: Type) -> z3.ExprRef:
        """A fresh constant of a scalar type."""
        self._counter += 1
        return self._make.constant(f"{name}!{self._counter}", self.sort(type_))

    def applied(self, name: str, arguments: Sequence[Term], result: Type) -> z3.ExprRef:
        """Apply the uninterpreted function of a name to arguments."""
        lifted = [
            self.lifted(a, self._real if isinstance(a, Fraction | float) else self._int)
            for a in arguments
        ]
        if not lifted:
            return self._make.constant(name, self.sort(result))
        return self._make.applied(name, lifted, self.sort(result))

    def list_sort(self, element: Sequence[Sort]) -> z3.DatatypeSortRef:
        """The sort of lists whose elements consist of parts of these sorts."""
        name = f"list({', '.join(map(str, element))})"
        if name not in self._lists:
            made = z3.Datatype(name, self.context)
            made.declare("nil")
            parts = [(f"part{k}", sort) for k, sort in enumerate(element)]
            made.declare("cons", *parts, ("rest", made))
            self._lists[name] = made.create()
        return self._lists[name]

    def list_term(
        self, element: Sequence[Sort], rows: Sequence[Sequence[Term]], length: Term
    ) -> z3.ExprRef:
        """A list as one term, of the rows below its length; each row has an element's parts."""
        sort = self.list_sort(element)
        nil, cons = sort.constructor(0)(), sort.constructor(1)
        built: Term = nil
        for position in reversed(range(len(rows))):
            parts = [self.lifted(p, s) for p, s in zip(rows[position], element, strict=True)]
            there = self.binary(BinaryOp.LT, position, length)
            built = self.ite(there, cons(*parts, built), nil)
        assert isinstance(built, z3.ExprRef)
        return built

    def for_all(self, variables: Sequence[Term], body: Term) -> Term:
        """Universal quantification of a Boolean over variables."""
        terms = [variable for variable in variables if isinstance(variable, z3.ExprRef)]
        if not isinstance(body, z3.ExprRef) or not terms:
            return body
        return z3.ForAll(terms, body)

    def text_of(self, number: int) -> str:
        """The string with a number in the table; a made-up one for an unknown number."""
        for text, its_number in self._strings.items():
            if its_number == number:
                return text
        return f"string{number}"

    # --- looking at terms -----------------------------------------------------------------------

    def key(self, term: Term) -> object:
        """A hashable key that two scalars share if and only if they are the same term.

        It is valid as long as the term is kept.
        """
        if isinstance(term, z3.ExprRef):
            return self._make.number_of(term)
        return type(term), term

    def with_values(self, term: Term, values: Sequence[tuple[Term, Term]]) -> Term:
        """Substitute terms for constants, and simplify."""
        if not isinstance(term, z3.ExprRef):
            return term
        self._budget.spend()
        pairs = [
            (old, self.lifted(new, old.sort()))
            for old, new in values
            if isinstance(old, z3.ExprRef)
        ]
        return self.constant(z3.simplify(z3.substitute(term, *pairs)))

    def put(self, term: Term, values: Sequence[tuple[Term, Term]]) -> Term:
        """Substitute integers for integer constants in a term."""
        if not isinstance(term, z3.ExprRef) or not values:
            return term
        old = [term for term, _ in values if isinstance(term, z3.ExprRef)]
        assert len(old) == len(values)
        self._budget.report(1)
        return self._make.put(term, old, [self.lifted(new, self._int) for _, new in values])

    def symbol(self, term: Term) -> str:
        """The name of the function symbol that a term applies."""
        assert isinstance(term, z3.ExprRef)
        return str(term.decl().name())

    def leanings(
        self, term: Term, seen: set[int], before: Collection[int] = ()
    ) -> Iterator[tuple[str, bool]]:
        """The symbols of Booleans below a formula, each with its polarity.

        True: the formula may need the Boolean to hold; False: not to hold. What is in ``seen`` or
        was seen ``before`` is left out, and everything looked at is put into ``seen``.
        """
        return self._make.leanings(term, seen, before) if isinstance(term, z3.ExprRef) else iter(())

    def is_constant(self, term: Term) -> bool:
        """Return whether a scalar is a single uninterpreted constant."""
        return isinstance(term, z3.ExprRef) and self._make.is_constant(term)

    def is_boolean(self, term: Term) -> bool:
        """Return whether a scalar is a Boolean."""
        return isinstance(term, bool | z3.BoolRef)

    def is_integer(self, term: Term) -> bool:
        """Return whether a scalar is an integer."""
        if isinstance(term, z3.ExprRef):
            return bool(term.sort() == self._int)
        return isinstance(term, int) and not isinstance(term, bool)

    def unused(self, name: str) -> str:
        """A name that no symbol has yet."""
        self._counter += 1
        return f"{name}!{self._counter}"

    def function_like(self, like: z3.ExprRef, arguments: Sequence[Term]) -> z3.ExprRef:
        """Apply the function symbol of a constant's name and sort to arguments."""
        lifted = [self.lifted(a, self._int) for a in arguments]
        return self._make.applied(str(like), lifted, like.sort())

    def mentions(self, term: Term, constants: Sequence[Term]) -> bool:
        """Return whether one of some constants occurs in a term."""
        wanted = [c for c in constants if isinstance(c, z3.ExprRef)]
        if not isinstance(term, z3.ExprRef) or not wanted:
            return False
        self._budget.spend()
        # Putting others in their place changes a term that has them, and is quicker than looking.
        others = [self._elsewhere(constant) for constant in wanted]
        return bool(self._make.substituted(term, wanted, others).value != term.ast.value)

    def _elsewhere(self, like: z3.ExprRef) -> z3.ExprRef:
        """A constant of another's sort that occurs in no term."""
        key = self._make.sort_number(like)
        if key not in self._nowhere:
            self._nowhere[key] = self._make.constant(self.unused("elsewhere"), like.sort())
        return self._nowhere[key]

    def parts_like(self, term: Term) -> Iterator[Term]:
        """The subterms of a term that have its sort, each once, itself first."""
        if isinstance(term, z3.ExprRef):
            for part in self._make.parts_like(term):
                self._budget.spend()
                yield self.constant(part)

    def fresh_like(self, name: str, term: Term) -> z3.ExprRef:
        """A fresh constant of a scalar's sort."""
        self._counter += 1
        if isinstance(term, z3.ExprRef):
            sort = term.sort()
        elif isinstance(term, bool):
            sort = self._bool
        else:
            sort = self._real if isinstance(term, Fraction) else self._int
        return self._make.constant(f"{name}!{self._counter}", sort)

    def is_valid(self, claim: Term) -> bool:
        """Return whether a Boolean is valid, as far as a quick query tells."""
        if not isinstance(claim, z3.ExprRef):
            return bool(claim)
        self._budget.spend(_QUICK_LOOK)
        denied = self._make.negation(claim)
        answer = self._looked_at(denied)
        if answer == z3.unknown:
            # One that prepares its questions is slower, and knows more of products.
            thorough = z3.Solver(ctx=self.context)
            thorough.set("rlimit", _QUICK_LIMIT)
            answer = self._checked(thorough, denied)
        return bool(answer == z3.unsat)

    def _looked_at(self, formula: z3.BoolRef) -> z3.CheckSatResult:
        """Ask whether a formula is satisfiable, by itself.

        All are asked of one solver, one after the other: to make another one takes several times
        as long as most answers do.
        """
        if self._quick is None:
            self._quick = z3.Solver(ctx=self.context)
            self._quick.set("rlimit", _QUICK_LIMIT)
        self._quick.push()
        try:
            return self._checked(self._quick, formula)
        finally:
            self._quick.pop()

    def _checked(self, solver: z3.Solver, formula: z3.BoolRef) -> z3.CheckSatResult:
        """Ask a solver whether a formula is satisfiable, and spend what that took."""
        before = spent_by(solver)
        require(solver, formula)
        answer = solver.check()
        self._budget.spend((spent_by(solver) - before) // _PER_STEP)
        return answer

    def constant(self, term: z3.ExprRef) -> Term:
        """The Python constant that a term denotes, or the term."""
        kind = self._make.kind(term)
        if kind == z3.Z3_OP_TRUE or kind == z3.Z3_OP_FALSE:
            return bool(kind == z3.Z3_OP_TRUE)
        if kind != z3.Z3_OP_ANUM:
            return term
        if z3.is_int_value(term):
            return int(term.as_long())
        return Fraction(term.numerator_as_long(), term.denominator_as_long())

    def implication(self, when: z3.BoolRef, then: z3.BoolRef) -> z3.BoolRef:
        """An implication as it stands, which is not simplified."""
        return self._make.implication(when, then)

    def denial(self, formula: z3.BoolRef) -> z3.BoolRef:
        """The negation of a formula, which a solver is told besides what is worked out."""
        return self._make.negation(formula)

    def label(self, prefix: str) -> z3.BoolRef:
        """A Boolean constant that occurs in no term."""
        return self._make.label(prefix)

    def is_true_in(self, model: z3.ModelRef, condition: Term) -> bool:
        """Return whether a Boolean is true in a model, where what that leaves open has values."""
        if not isinstance(condition, z3.ExprRef):
            return bool(condition)
        return self._make.is_true_in(model, condition)

    # --- how they are built ---------------------------------------------------------------------

    def _connective(self, op: BinaryOp, left: Term, right: Term) -> Term:
        """Build a connective of two Booleans, one of them a term, simplified for constants."""
        if op is BinaryOp.IMPLIES:
            return self._connective_or(self.unary(UnaryOp.NOT, left), right)
        if op is BinaryOp.OR:
            return self._connective_or(left, right)
        if not isinstance(left, z3.ExprRef):
            return right if left else False
        if not isinstance(right, z3.ExprRef):
            return left if right else False
        return left if same(left, right) else self._make.conjunction(left, right)

    def _connective_or(self, left: Term, right: Term) -> Term:
        if not isinstance(left, z3.ExprRef):
            return True if left else right
        if not isinstance(right, z3.ExprRef):
            return True if right else left
        return left if same(left, right) else self._make.disjunction(left, right)

    def _operation(self, op: BinaryOp, left: z3.ExprRef, right: z3.ExprRef) -> Term:
        match op:
            case BinaryOp.EQ:
                return True if same(left, right) else self._equation(left, right)
            case BinaryOp.NE:
                if same(left, right):
                    return False
                return self._make.negation(self._make.equation(left, right))
            case BinaryOp.ADD:
                return self._make.total(left, right)
            case BinaryOp.SUB:
                return self._make.difference(left, right)
            case BinaryOp.MUL:
                plain = left.sort() == self._int or _is_value(left) or _is_value(right)
                self.has_products = self.has_products or not plain
                return self._make.product(left, right)
            case BinaryOp.LT:
                return self._make.less(left, right)
            case BinaryOp.LE:
                return True if same(left, right) else self._make.at_most(left, right)
            case BinaryOp.MIN:
                return self._make.choice(self._make.less(right, left), right, left)
            case BinaryOp.MAX:
                return self._make.choice(self._make.more(right, left), right, left)
            case BinaryOp.DIV:
                return self._quotient(left, right)
            case BinaryOp.MOD:
                return self._remainder(left, right)
        raise AssertionError(op)

    def _equation(self, left: z3.ExprRef, right: z3.ExprRef) -> Term:
        """Build an equation; with a Boolean constant it simplifies to a literal."""
        for one, other in ((left, right), (right, left)):
            kind = self._make.kind(one)
            if kind == z3.Z3_OP_TRUE:
                return other
            if kind == z3.Z3_OP_FALSE:
                return self.unary(UnaryOp.NOT, other)
        return self._make.equation(left, right)

    def _quotient(self, left: z3.ExprRef, right: z3.ExprRef) -> Term:
        """Divide as :func:`binary_of_numbers` does: ints rounded down, zero for a zero divisor."""
        make, zero = self._make, self._like(0, left)
        if make.sort_kind(left) == z3.Z3_REAL_SORT:
            quotient = make.quotient(left, right)
            if z3.is_rational_value(right) and not _is_zero(right):
                return z3.simplify(quotient)
            return make.choice(make.equation(right, zero), zero, quotient)
        opposite = make.quotient(make.opposite(left), make.opposite(right))
        # Z3 rounds down for positive divisors only.
        if z3.is_int_value(right) and right.as_long() != 0:
            return make.quotient(left, right) if right.as_long() > 0 else opposite
        down = make.choice(make.less(zero, right), make.quotient(left, right), opposite)
        return make.choice(make.equation(right, zero), zero, down)

    def _remainder(self, left: z3.ExprRef, right: z3.ExprRef) -> Term:
        make = self._make
        if z3.is_int_value(right) and right.as_long() > 0:
            return make.remainder(left, right)
        quotient = self._quotient(left, right)
        assert isinstance(quotient, z3.ExprRef)
        rest: z3.ExprRef = make.difference(left, make.product(right, quotient))
        if z3.is_int_value(right) and right.as_long() != 0:
            return rest
        zero = self._like(0, left)
        rest = make.choice(make.equation(right, zero), zero, rest)
        # What goes round once is the usual case, and is no product of unknowns.
        for low, high, turned in (
            (make.opposite(right), zero, make.total(left, right)),
            (right, make.total(right, right), make.difference(left, right)),
            (zero, right, left),
        ):
            within = make.conjunction(make.at_most(low, left), make.less(left, high))
            rest = make.choice(within, turned, rest)
        return rest

    def _boolean_ite(self, condition: z3.ExprRef, then: Term, other: Term) -> Term:
        """Build an if-then-else of Booleans; with a constant side it is a connective."""
        if isinstance(then, bool) and isinstance(other, bool):
            return condition if then else self.unary(UnaryOp.NOT, condition)
        if isinstance(then, bool):
            if then:
                return self._connective_or(condition, other)
            return self._connective(BinaryOp.AND, self.unary(UnaryOp.NOT, condition), other)
        if other:
            return self._connective_or(self.unary(UnaryOp.NOT, condition), then)
        return self._connective(BinaryOp.AND, condition, then)

    def _alike(self, then: Term, other: Term) -> tuple[z3.ExprRef, z3.ExprRef]:
        if isinstance(then, z3.ExprRef):
            return then, other if isinstance(other, z3.ExprRef) else self._like(other, then)
        if isinstance(other, z3.ExprRef):
            return self._like(then, other), other
        sort = self._real if isinstance(then, Fraction) else self._int
        return self.lifted(then, sort), self.lifted(other, sort)

    def _same(self, then: Term, other: Term) -> bool:
        if isinstance(then, z3.ExprRef):
            return isinstance(other, z3.ExprRef) and same(then, other)
        return not isinstance(other, z3.ExprRef) and then == other


def _is_value(term: z3.ExprRef) -> bool:
    return bool(z3.is_int_value(term) or z3.is_rational_value(term))


def _is_zero(value: z3.ExprRef) -> bool:
    return bool(z3.is_rational_value(value) and value.numerator_as_long() == 0)


def parts_of(terms: Iterable[z3.ExprRef]) -> Iterator[z3.ExprRef]:
    """Terms and all their subterms, each once."""
    seen: set[int] = set()
    waiting = list(terms)
    while waiting:
        part = waiting.pop()
        if part.get_id() not in seen:
            seen.add(part.get_id())
            yield part
            waiting += part.children()
