"""Contradictory contracts and summaries: rounds that cannot end, and calls without an answer.

What would come after a round that cannot end is not looked at by anybody. First it is asked whether
there are any ports at all that leave a robot's environment no turn, which most often there are not;
if so, a few runs show whether robots get there. That no reading will do is then for a solver to
say. [ENV-CONTRACT] [EXTERNAL]
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import field
from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Robot, Store
from koord.semantics.domain import conjunction
from koord.semantics.environment import environment_turn
from koord.semantics.every_number import NotFiniteError
from koord.semantics.expressions import evaluate, statement
from koord.semantics.machine import Machine
from koord.semantics.oracle import Phase
from koord.semantics.statements import machine
from koord.semantics.storage import held, stored
from koord.semantics.values import Rec, Seq, Table
from koord.syntax import core
from koord.syntax.core import Direction, ExternalKind, UnaryOp
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import Status, System
from koord.syntax.types import BoolType, EnumType, FloatType, IntType, is_flat
from koord.syntax.walk import reached
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.solver import Solver, SolverAnswer
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.encoding.terms import Term, Terms
from koord.verify.encoding.unknowns import Symbolic, Unknowns
from koord.verify.vacuity.reachability import runs_of
from koord.verify.verdicts import Emptiness, Vacuity

#: What it may cost to see whether ports can be such, for each robot that is asked about; what the
#: answer for certain ports may cost; how long runs are, in turns of robots, and what they may cost.
_PORTS_S = 0.005
_READINGS_S = 0.5
_TURNS = 600
_RUNS_S = 1.0


def dead_end(system: System, deadline: Deadline, seed: int) -> Vacuity | None:
    """A run that ends because no readings meet the contracts, if one is found."""
    if not any(_may_end(system, robot, deadline, seed) for robot in _asked(system)):
        return None
    soon = deadline.of_work(_RUNS_S)
    for run, play in runs_of(system, _TURNS // system.robots, seed):
        try:
            for _ in play.parts():
                if soon.passed():
                    return None
        except KoordError:
            for robot, state in enumerate(run.configuration.robots):
                if not _has_readings(system, robot, state, deadline, seed):
                    where = f"robot {robot} in round {run.round + 1} of some run"
                    detail = f"no turn of the environment meets those of {where}, which ends there"
                    return Vacuity(Emptiness.CONTRACTS, "", detail, certain=False)
    return None


def _asked(system: System) -> Iterator[int]:
    """The first robot of each kind, and the last: contracts may mention their numbers."""
    for kind in sorted(set(system.kinds)):
        robots = [robot for robot, other in enumerate(system.kinds) if other == kind]
        yield from sorted({robots[0], robots[-1]})


class _Readings(SymbolicInputs):
    """Symbolic inputs with fixed readings."""

    given: dict[int, Symbolic] = field(default_factory=dict)

    def sensor(self, robot: int, port: core.Port) -> Symbolic:
        return self.given[port.declaration.variable.slot]


def _may_end(system: System, robot: int, deadline: Deadline, seed: int) -> bool:
    """Return whether some ports of a robot, reachable or not, admit no readings."""
    agent = system.agent(robot)
    contracts = [contract for module in agent.modules for contract in module.contracts]
    models = any(module.environment is not None for module in agent.modules)
    types = [port.declaration.variable.type for port in agent.ports]
    below = reached(system.program, tuple(contracts))
    open_ = any(isinstance(node, core.ExternalCall | core.Choose) for node in below)
    if not contracts or models or open_ or not all(map(is_flat, types)):
        return False
    d = Terms(system.budget)
    unknowns = Unknowns(d, system.program, system.robots)
    values = [(x.declaration.variable, x.declaration.length) for x in agent.ports]
    ports = tuple(
        stored(d, v.type, unknowns.value(v.name, v.type, length), system.robots)
        for v, length in values
    )
    store: Store[Term] = Store((), ())
    state = Robot(system.kinds[robot], (), ports, store, int(Status.RUNNING), NO_EVENT)
    sensors = [port for port in agent.ports if port.direction is Direction.SENSOR]
    slots = [port.declaration.variable.slot for port in sensors]

    def unmet(values: Sequence[Symbolic]) -> Term:
        inputs = _Readings(unknowns, "readings", given=dict(zip(slots, values, strict=True)))
        turned = environment_turn(d, system, robot, state, inputs)
        return d.unary(UnaryOp.NOT, conjunction(d, [x.condition for x in turned.legality]))

    ended = unknowns.every([port.declaration.variable.type for port in sensors], unmet)
    effort = Effort.of_seconds(_PORTS_S)
    return Solver(d, unknowns, seed).check([ended], deadline, effort) is SolverAnswer.SAT


def _has_readings(
    system: System, robot: int, state: Robot[Term], deadline: Deadline, seed: int
) -> bool:
    """Return whether some readings meet a robot's contracts, as far as is known."""
    d = Terms(system.budget)
    unknowns = Unknowns(d, system.program, system.robots)
    turned = environment_turn(d, system, robot, state, SymbolicInputs(unknowns, "readings"))
    solver = Solver(d, unknowns, seed)
    question = [needed.condition for needed in turned.legality]
    answer = solver.check(question, deadline, Effort.of_seconds(_READINGS_S))
    return answer is not SolverAnswer.UNSAT or bool(unknowns.limits)


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
        from koord.traces.rendering import show_value

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
