"""Contradictory summaries: external functions without a possible answer. [EXTERNAL]"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from koord.semantics.domain import conjunction
from koord.semantics.every_number import NotFiniteError
from koord.semantics.expressions import evaluate, statement
from koord.semantics.machine import Machine
from koord.semantics.oracle import Phase
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.semantics.values import Rec, Seq, Table
from koord.syntax import core
from koord.syntax.core import ExternalKind, UnaryOp
from koord.syntax.system import System
from koord.syntax.types import BoolType, EnumType, FloatType, IntType
from koord.syntax.walk import reached
from koord.traces.rendering import show_value
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.solver import Solver, SolverAnswer
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.encoding.terms import Term, Terms
from koord.verify.encoding.unknowns import Symbolic, Unknowns

#: What it may cost to look for arguments of a function that have no answer: they are found at once,
#: or a solver tries values for long.
_ARGUMENTS_S = 0.003


def unanswerable(
    system: System, seed: int, deadline: Deadline, effort: Effort
) -> Iterator[tuple[core.External, str]]:
    """The functions whose summaries are unsatisfiable, and the reasons.

    One that is answered anew each time may lack answers that nobody asks for.
    """
    for external in system.program.externals:
        if not external.ensures:
            continue
        asking = _Asking(system, external, seed, deadline)
        if asking.is_never_answered(effort):
            alone = _Asking(_unpromised(system), external, seed, deadline)
            uncalled = alone.is_never_answered(effort)
            what, part = ("arguments", "requires") if uncalled else ("answer", "ensures")
            yield external, f"no {what} of {external.name} can meet its `{part}`"
        elif external.kind is ExternalKind.FUNCTION and not _hangs_on_others(system, external):
            lost = asking.unanswered()
            if lost:
                yield external, f"no answer of {external.name} for {lost} can meet its `ensures`"


def _hangs_on_others(system: System, external: core.External) -> bool:
    """Return whether a summary is about other calls, or about every value of a type."""
    below = reached(system.program, (external.requires, external.ensures))
    return any(isinstance(node, core.ExternalCall | core.AllValues) for node in below)


def _unpromised(system: System) -> System:
    """The system with summaries that promise nothing."""
    externals = tuple(replace(external, ensures=()) for external in system.program.externals)
    return replace(system, program=replace(system.program, externals=externals))


class _Asking:
    """A call of a function with arbitrary arguments."""

    def __init__(
        self, system: System, external: core.External, seed: int, deadline: Deadline
    ) -> None:
        self._system = system
        self._external = external
        self._deadline = deadline
        self._d = Terms()
        self._unknowns = Unknowns(self._d, system.program, system.robots)
        self._arguments = [self._unknowns.value(p.name, p.type) for p in external.parameters]
        self._solver = Solver(self._d, self._unknowns, seed)

    def is_never_answered(self, effort: Effort) -> bool:
        """Return whether no call that meets the duties has an answer."""
        m = self._machine()
        m.memory.bound = [held(self._d, value) for value in self._arguments]
        external = self._external
        reads = tuple(core.Read(core.Place(p)) for p in external.parameters)
        try:
            evaluate(m, core.ExternalCall(external.name, reads, external.result.type, 0))
        except NotFiniteError:
            return False
        question = [needed.condition for needed in m.legality]
        question += [self._d.unary(UnaryOp.NOT, fault) for fault, _ in m.faults]
        # Where only short lists were looked at, a longer one may do.
        answer = self._solver.check(question, self._deadline, effort)
        return answer is SolverAnswer.UNSAT and not self._unknowns.limits

    def unanswered(self) -> str:
        """Arguments without an answer, in words; empty if there are none, or it is unknown."""
        external = self._external
        if not all(isinstance(v.type, _SCALARS) for v in (external.result, *external.parameters)):
            return ""
        d = self._d

        def unkept(values: tuple[Symbolic, ...]) -> Term:
            m = self._bound(values[0])
            kept = conjunction(d, [statement(m, promise) for promise in external.ensures])
            return d.unary(UnaryOp.NOT, kept)

        lost = self._unknowns.every((external.result.type,), unkept)
        effort = Effort.of_seconds(_ARGUMENTS_S)
        if self._solver.check([self._met(), lost], self._deadline, effort) is not SolverAnswer.SAT:
            return ""
        model = self._solver.model()
        shown = []
        for parameter, value in zip(external.parameters, self._arguments, strict=True):
            assert not isinstance(value, Rec | Seq | Table)
            read = model.scalar(value, parameter.type)
            shown.append(f"{parameter.name} = {show_value(read, parameter.type)}")
        return ", ".join(shown) or "no arguments"

    def _met(self) -> Term:
        m = self._bound()
        return conjunction(self._d, [statement(m, duty) for duty in self._external.requires])

    def _bound(self, *answer: Symbolic) -> Machine[Term]:
        """A machine with the arguments, and the answer if there is one, in bound slots."""
        m = self._machine()
        m.in_summary = True
        known = [held(self._d, value) for value in (*self._arguments, *answer)]
        m.memory.bound = [*known, *[None] * (self._external.bound - len(known))]
        return m

    def _machine(self) -> Machine[Term]:
        inputs = SymbolicInputs(self._unknowns, "asked")
        return machine(self._d, self._system, inputs.oracle(Phase.PROG, 0), robot=0)


_SCALARS = (BoolType, EnumType, FloatType, IntType)
