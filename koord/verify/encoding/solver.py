"""The Z3 solver: incremental, with deadlines, effort limits, cores and models."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Iterator, Sequence
from enum import Enum
from fractions import Fraction
from functools import cached_property
from math import ceil

from msgspec import Struct

from koord.semantics.domain import Constant
from koord.syntax.types import BoolType, OpaqueType, StreamType, StringType, Type
from koord.verify.effort import PER_SECOND, Deadline, Effort
from koord.verify.encoding.terms import Term, Terms
from koord.verify.encoding.unknowns import Unknowns
from koord.verify.encoding.z3_builder import require, spent_by
from koord.verify.encoding.z3_loading import z3

#: Why Z3 stops on Ctrl-C. It says "canceled" of some deadlines too.
_INTERRUPTED = frozenset({"interrupted from keyboard", "interrupted", "canceled"})

#: What Z3 takes for no limit of time, in its milliseconds.
_FOR_EVER = 2**32 - 1


class SolverAnswer(Enum):
    """The answer of a solver to a query."""

    SAT = "sat"
    UNSAT = "unsat"
    UNKNOWN = "unknown"


#: How many times longer a question may take than its effort is meant for. Reals that are multiplied
#: keep a solver busy for minutes that it counts as a second of work.
AT_MOST_TIMES = 10

#: How long a single question may take where there are others to ask, and where nobody said how long
#: all may take: then nobody would hear of anything else.
LONGEST_S, LONGEST_UNLIMITED_S = 10.0, 60.0


#: How often Z3 is asked again, each time for twice as long, as its clock was faster than its work.
_LOOKS = 6


#: Functions of theories beyond the standard, which some solvers do not let a script declare.
_OF_THEORIES = frozenset(
    f"{inverse}{name}"
    for inverse in ("", "arc")
    for name in ("sin", "cos", "tan", "cot", "sec", "csc")
) | {"exp", "sqrt", "log", "pi", "pow"}

#: Patterns that are compiled when they are first looked for: most solvers write no scripts.
_DECLARED = r"\((?:declare-fun|declare-const|define-fun) ([^\s()|]+)"
_TOKEN = r'"[^"]*"|\|[^|]*\||[^\s()"|]+'


def portable(script: str) -> str:
    """The same script, in which functions that it declares have names of no solver's theories."""
    taken = _OF_THEORIES.intersection(re.findall(_DECLARED, script))
    if not taken:
        return script

    def renamed(token: re.Match[str]) -> str:
        word = token.group()
        return f"|{word} of the program|" if word in taken else word

    return re.sub(_TOKEN, renamed, script)


class Layer(Struct, frozen=True):
    """A query on the first ``required`` of a solver's constraints."""

    required: int
    asked: Term


class Solver:
    """An incremental solver over the terms of one domain.

    Constraints of fresh terms are taken from ``unknowns`` as they appear.
    """

    def __init__(self, d: Terms, unknowns: Unknowns, seed: int = 0) -> None:
        self.d = d
        self.unknowns = unknowns
        self.seed = seed
        self._taken = 0
        self._model: z3.ModelRef | None = None
        self._core: frozenset[int] = frozenset()
        self._limits: tuple[int, int] | None = None

    @cached_property
    def _solver(self) -> z3.Solver:
        """Z3's solver, made for the first formula that is no constant."""
        solver = z3.Solver(ctx=self.d.context)
        if self.seed:  # Z3's own is 0
            solver.set("random_seed", self.seed)
        return solver

    @property
    def _is_in_use(self) -> bool:
        """Whether a formula was required or asked."""
        return "_solver" in vars(self)

    def add(self, constraints: Iterable[Term]) -> None:
        """Add constraints."""
        self._take()
        for constraint in constraints:
            known = self.d.known(constraint)
            if known is not True:
                require(self._solver, self.d.boolean(constraint))

    def check(
        self,
        question: Iterable[Term],
        deadline: Deadline,
        effort: Effort | None = None,
        *,
        at_most: int = 0,
        for_model: bool = True,
    ) -> SolverAnswer:
        """Check whether the query is satisfiable together with the constraints.

        ``effort`` is what this question may use up, and ``at_most`` how much of that at once
        (0: all of it). Z3 takes as long for a model as for many an answer: where it is not asked
        ``for_model`` there is none afterwards.
        """
        self._take()
        question = list(question)
        asked = [k for k, term in enumerate(question) if self.d.known(term) is not True]
        terms = [self.d.boolean(question[k]) for k in asked]
        limit = 0 if effort is None else effort.limit(at_most)
        if deadline.passed() or (effort is not None and limit <= 0):
            return SolverAnswer.UNKNOWN
        if not terms and not self._is_in_use:
            self._model = None
            return SolverAnswer.SAT
        if effort is not None:
            meant = deadline.sooner(_longest_s(limit))
        elif deadline.left_s() is None:
            meant = deadline.sooner(LONGEST_UNLIMITED_S)
        else:
            meant = deadline
        literals, once = [], []
        for term in terms:
            literal = term
            if not self.d.is_constant(term):
                literal = self.d.label("q")
                require(self._solver, self.d.implication(literal, term))
                once.append(literal)
            literals.append(literal)
        spent = spent_by(self._solver)
        result, given = self._checked(literals, limit, meant, deadline, spent)
        spent = spent_by(self._solver) - spent
        self.d.report(spent)
        if result == z3.unsat:
            core = {literal.get_id() for literal in self._solver.unsat_core()}
            pairs = zip(asked, literals, strict=True)
            self._core = frozenset(k for k, literal in pairs if literal.get_id() in core)
        exhausted = bool(limit) and (spent >= limit or (result == z3.unknown and given.is_near()))
        if effort is not None:
            # One that was cut short by the clock leaves something for others.
            cost = min(limit, int(LONGEST_S * PER_SECOND))
            effort.left -= max(spent, cost) if exhausted else spent
        self._model = self._solver.model() if result == z3.sat and for_model else None
        # Asked for now: the next assertion makes Z3 forget why it stopped.
        reason = self._solver.reason_unknown() if result == z3.unknown else ""
        # The question is not asked again, so the solver may forget it.
        for literal in once:
            require(self._solver, self.d.denial(literal))
        if result == z3.unsat:
            return SolverAnswer.UNSAT
        if result == z3.sat:
            return SolverAnswer.SAT
        if reason in _INTERRUPTED and not exhausted and not given.is_near():
            raise KeyboardInterrupt
        return SolverAnswer.UNKNOWN

    def _checked(
        self,
        literals: Sequence[z3.BoolRef],
        limit: int,
        meant: Deadline,
        deadline: Deadline,
        spent: int,
    ) -> tuple[z3.CheckSatResult, Deadline]:
        """Check under literals; the answer, and when it was to come. So much is ``spent`` before.

        What is meant is time of this process. Z3 looks at the clock, which is faster where others
        work as well: then it is asked again, for longer, so that answers do not hang on them.
        """
        meant_s, begun = meant.left_s(), time.process_time()
        lasts_s, left = meant_s, limit
        for _ in range(_LOOKS):
            given = Deadline.after(lasts_s)  # Z3 has a clock of its own
            self._limit(_FOR_EVER if lasts_s is None else _milliseconds(lasts_s), left)
            result = self._solver.check(*literals)
            if result != z3.unknown or meant_s is None or lasts_s is None:
                return result, given
            if not given.is_near() or deadline.is_near():
                return result, given
            left = limit and limit - (spent_by(self._solver) - spent)
            if time.process_time() - begun > meant_s / 2 or left < 0 or (limit and not left):
                return result, given
            lasts_s *= 2
            if (ends_s := deadline.left_s()) is not None:
                lasts_s = min(lasts_s, ends_s)
        return result, given

    def _limit(self, lasts_ms: int, units: int) -> None:
        """Set limits of the questions to come, unless they are those of the last one.

        Z3 looks through all of its parameters to set some.
        """
        if (lasts_ms, units) != self._limits:
            self._limits = lasts_ms, units
            self._solver.set(timeout=lasts_ms, rlimit=units)

    def script(self, question: Iterable[Term]) -> str:
        """The query with the constraints, as a script of SMT-LIB 2."""
        self._take()
        asked = z3.Solver(ctx=self.d.context)
        asked.add(self._solver.assertions())
        asked.add(*(self.d.boolean(term) for term in question))
        return portable(str(asked.to_smt2()))

    @property
    def required(self) -> int:
        """The number of constraints so far."""
        self._take()
        return len(self._solver.assertions())

    def layered(self, layers: Sequence[Layer]) -> str:
        """A script of SMT-LIB 2: one layer's query is satisfiable with the constraints up to it.

        A script of SMT-LIB 2.
        """
        required = list(self._solver.assertions())
        whole = z3.BoolVal(False, self.d.context)
        starts = [0, *(layer.required for layer in layers)]
        for start, layer in zip(reversed(starts[:-1]), reversed(layers), strict=True):
            here = z3.Or(self.d.boolean(layer.asked), whole)
            whole = z3.And(*required[start : layer.required], here)
        asked = z3.Solver(ctx=self.d.context)
        asked.add(whole)
        return portable(str(asked.to_smt2()))

    def core(self) -> frozenset[int]:
        """The unsatisfiable core of the last query, as positions in it."""
        return self._core

    def model(self) -> Model:
        """The model of the last query, which was satisfiable."""
        if self._model is None:
            assert not self._is_in_use, "the last query has no model"
            self._solver.check()
            self._model = self._solver.model()
        return Model(self.d, self._model)

    def _take(self) -> None:
        new = self.unknowns.constraints[self._taken :]
        self._taken = len(self.unknowns.constraints)
        for constraint in new:
            if self.d.known(constraint) is not True:
                require(self._solver, self.d.boolean(constraint))


def _milliseconds(seconds: float) -> int:
    """A limit of time for Z3: beyond a second in tenths, so that most questions have the same."""
    if seconds < 1:
        return max(1, int(seconds * 1000))
    return 100 * ceil(seconds * 10)


def _longest_s(limit: int) -> float:
    """The time limit in seconds of a query with an effort limit."""
    return min(LONGEST_S, max(1.0, AT_MOST_TIMES * limit / PER_SECOND))


def cases(d: Terms, term: Term) -> list[Term]:
    """Split a formula into cases: several small queries in place of a large one.

    Splits where the term is a disjunction by how it is built (a quantifier over robots that is
    denied, say), which no solver does as well by itself.
    """
    if not isinstance(term, z3.ExprRef):
        return [term] if term else []
    return [*_split(term, _DEEPEST)]


#: So many conjunctions inside of each other are split: what lies deeper, as of choices among the
#: elements of a long array, stays one case. So many cases would be too many to be asked anyway.
_DEEPEST = 100


def _split(term: z3.ExprRef, depth: int) -> Iterator[z3.ExprRef]:
    """Split a term, as deep as conjunctions are inside of each other; disjunctions in any depth."""
    waiting: list[tuple[tuple[z3.ExprRef, ...], z3.ExprRef]] = [((), term)]
    while waiting:
        given, part = waiting.pop()
        inside = part.arg(0) if z3.is_not(part) else None
        found: Iterable[z3.ExprRef] = (part,)
        if z3.is_or(part):
            waiting += [(given, each) for each in reversed(part.children())]
            continue
        if inside is not None and z3.is_and(inside):
            waiting += [(given, z3.Not(each)) for each in reversed(inside.children())]
            continue
        if inside is not None and z3.is_not(inside):
            waiting.append((given, inside.arg(0)))
            continue
        if inside is not None and z3.is_implies(inside):
            premise, then = inside.children()
            waiting.append(((*given, premise), z3.Not(then)))
            continue
        if z3.is_and(part):
            found = _split_one(part, depth)
        elif inside is not None and z3.is_or(inside):
            found = _split_one(z3.And(*(z3.Not(each) for each in inside.children())), depth)
        yield from (z3.And(*given, case) if given else case for case in found)


def _split_one(conjunction: z3.ExprRef, depth: int) -> Iterator[z3.ExprRef]:
    """Split the part of a conjunction with most cases; the other parts stay with each case."""
    if depth == 0:
        yield conjunction
        return
    parts = conjunction.children()
    splits = [list(_split(part, depth - 1)) for part in parts]
    most = max(range(len(parts)), key=lambda position: len(splits[position]))
    if len(splits[most]) == 1:
        yield conjunction
        return
    rest = parts[:most] + parts[most + 1 :]
    yield from (z3.And(case, *rest) for case in splits[most])


class Model(Struct, frozen=True):
    """A model of a solver, read as Python numbers. Terms it leaves open get some value."""

    d: Terms
    model: z3.ModelRef

    def truth(self, condition: Term) -> bool:
        return self.d.is_true_in(self.model, condition)

    def scalar(self, value: Term, type_: Type) -> Constant:
        """A scalar of a type. An opaque value is the name of its element in the model."""
        if not isinstance(value, z3.ExprRef):
            return value
        found = self.model.eval(value, model_completion=True)
        match type_:
            case BoolType():
                return bool(z3.is_true(found))
            case StringType() | StreamType():
                return self.d.text_of(found.as_long())
            case OpaqueType():
                return str(found)
            case _:
                return self.number(found)

    def number(self, value: Term | object) -> Constant:
        """An int or a rational; an irrational algebraic number is rounded to 2^-40 of itself."""
        if not isinstance(value, z3.ExprRef):
            assert isinstance(value, int | Fraction)
            return value
        found = self.model.eval(value, model_completion=True)
        if z3.is_int_value(found):
            return int(found.as_long())
        if z3.is_algebraic_value(found):
            found = found.approx(40)
        return Fraction(found.numerator_as_long(), found.denominator_as_long())
