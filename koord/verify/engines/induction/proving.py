"""Inductive proofs for a fixed number of robots: one arbitrary step, for all rounds.

Where robots may change places, what breaks ``forall i, j: …`` breaks it for i = 0 and j ≤ 1 under
other names: each robot that a quantifier brings in is one of those that were named before, or the
next. So N² cases become two.

Such a step is no run: nobody knows whether its first configuration can be reached. It shows what an
invariant leaves open, and never passes for a violation.

All claims about configurations are assumed at the start of a step that begins anywhere, and each is
asked for at its middle and its end. Claims that fail are dropped and the rest asked again, until
what is left proves itself (Houdini). With ``depth`` k, k steps follow each other and the claims are
asked of the last.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store
from koord.semantics.domain import Constant, disjunction
from koord.semantics.storage import Cell, Storage, Tree
from koord.syntax import core
from koord.syntax.analysis.symmetry import Symmetry, symmetry_of
from koord.syntax.core import BinaryOp, QuantifierKind, UnaryOp
from koord.syntax.system import System
from koord.syntax.types import INT, Type, part_types
from koord.verify.claims import Claim, ClaimPhase, StepFindings, claims_of
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.moments import SymbolicConfiguration
from koord.verify.encoding.solver import Model, SolverAnswer, cases
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.encoding.terms import Term
from koord.verify.encoding.unrolling import Unrolling, violations
from koord.verify.engine_names import Engine
from koord.verify.verdicts import BrokenStep, Outcome, Verdict

if TYPE_CHECKING:
    from koord.verify.witness import ModelReader


def representatives(system: System) -> Callable[[Claim], Claim]:
    """A claim over representatives that is broken in some configuration if and only if this one is.

    The two are of one configuration only up to the names of its robots, and of sets that are
    closed under renaming: of all that can be reached, or of all in which other claims hold.
    """
    asked = tuple(claim.stated for claim in claims_of(system) if claim.stated is not None)
    symmetry = symmetry_of(system, asked)
    everyone = (tuple(range(system.robots)),)
    if not isinstance(symmetry, Symmetry) or symmetry.groups != everyone:
        return lambda claim: claim
    return lambda claim: _represented(claim, system)


def _represented(claim: Claim, system: System) -> Claim:
    if claim.stated is None:
        return claim
    condition = _narrowed(claim.stated.condition, 1, system)
    return replace(claim, stated=replace(claim.stated, condition=condition))


def _narrowed(e: core.Expr, named: int, system: System) -> core.Expr:
    """Restrict outer quantifiers to ``named`` robots, and inner ones to one more each."""
    everyone = (None, system.kinds[0])  # of another kind than the first robot there are none
    match e:
        case core.Quantified(QuantifierKind.FORALL, domain=core.RobotRange(agent=kind)) if (
            kind in everyone
        ):
            few = core.IntRange(core.Const(0, INT), core.Const(min(named, system.robots), INT))
            return replace(e, domain=few, body=_narrowed(e.body, named + 1, system))
        case core.Binary(op=BinaryOp.AND):
            left, right = (_narrowed(part, named, system) for part in (e.left, e.right))
            return replace(e, left=left, right=right)
        case core.Binary(op=BinaryOp.IMPLIES):
            return replace(e, right=_narrowed(e.right, named, system))
        case _:
            return e


def broken_step(
    reader: ModelReader,
    before: Sequence[Configuration[Term]],
    last: Configuration[Term],
    phase: ClaimPhase,
) -> BrokenStep:
    """The counterexample to induction in a model: from the ends of rounds ``before`` on."""
    read = tuple(_configuration(reader, c) for c in (*before, last))
    events = tuple(tuple(_event(robot.ran) for robot in c.robots) for c in read[1:])
    return BrokenStep(read, events, phase)


def _event(ran: Constant) -> int:
    assert isinstance(ran, int)
    return ran if ran >= 0 else NO_EVENT


def _configuration(reader: ModelReader, c: Configuration[Term]) -> Configuration[Constant]:
    program = reader.system.program
    store = Store(
        _all(reader, c.store.allread, program.allread),
        _all(reader, c.store.allwrite, program.allwrite),
    )
    robots = tuple(_robot(reader, n, robot, store) for n, robot in enumerate(c.robots))
    return Configuration(robots, store, c.round, c.turn)


def _robot(
    reader: ModelReader, number: int, robot: Robot[Term], store: Store[Constant]
) -> Robot[Constant]:
    agent = reader.system.agent(number)
    ports = tuple(port.declaration for port in agent.ports)
    read: Robot[Constant] = replace(
        robot,
        locals=_all(reader, robot.locals, agent.locals),
        ports=_all(reader, robot.ports, ports),
        copy=store,
        status=reader.model.scalar(robot.status, INT),
        ran=reader.model.scalar(robot.ran, INT),
    )
    return read


def _all(
    reader: ModelReader, storages: Sequence[Storage[Term]], declared: Sequence[core.Declaration]
) -> tuple[Storage[Constant], ...]:
    pairs = zip(storages, declared, strict=True)
    return tuple(_storage(reader, storage, d.variable.type) for storage, d in pairs)


def _storage(reader: ModelReader, storage: Storage[Term], type_: Type) -> Storage[Constant]:
    if isinstance(storage, Tree):
        parts = zip(storage.parts, part_types(type_, len(storage.parts)), strict=True)
        return Tree(tuple(_storage(reader, part, below) for part, below in parts))
    assert isinstance(storage, Cell)
    return Cell(reader.truth(storage.is_set), reader.value(storage.value, type_))


#: What a claim may cost as one question (about half a second) before it is asked case by case.
FIRST_TRY = 5_000_000


class Inductive(Struct, frozen=True):
    """The claims that hold in all rounds, and the reasons why others are open."""

    proved: dict[Claim, Verdict]
    reasons: dict[Claim, str]
    steps: dict[Claim, BrokenStep]  #: of those that are not inductive


def prove(
    system: System,
    claims: Sequence[Claim],
    given: Sequence[Claim],
    deadline: Deadline,
    effort: Effort | None = None,
    *,
    depth: int = 1,
    seed: int = 0,
    within_limits: bool = False,
) -> Inductive:
    """Prove the largest inductive subset of the claims; ``given`` ones are proved already.

    The claims must be known to hold after INIT and in the first ``depth - 1`` rounds. With
    ``within_limits`` it need not cover lists and maps of any length: then it is no proof.
    """
    started = time.monotonic()
    candidates = list(claims)
    reasons: dict[Claim, str] = {}
    step = _Step(system, depth, seed, effort)
    while candidates:
        failed = step.failing([*given, *candidates], candidates, deadline)
        if not failed:
            break
        reasons |= failed
        candidates = [claim for claim in candidates if claim not in failed]
    if step.limits and not within_limits:
        reasons |= dict.fromkeys(candidates, f"not covered: {'; '.join(step.limits)}")
        candidates = []
    seconds = time.monotonic() - started
    proved = {
        claim: Verdict(claim, Outcome.HOLDS, Engine.INDUCTION, seconds, depth=depth)
        for claim in candidates
    }
    return Inductive(proved, reasons, {c: s for c, s in step.broken.items() if c in reasons})


def step_scripts(
    system: System, assumed: Sequence[Claim], asked: Sequence[Claim], depth: int
) -> Iterator[tuple[ClaimPhase, str]]:
    """The queries of an inductive step, as scripts of SMT-LIB 2, each to be unsatisfiable."""
    step = _Step(system, depth, 0, None)
    yield from step.scripts(assumed, asked)


class _Step:
    """``depth`` rounds from an arbitrary configuration, with all claims checked in the last."""

    def __init__(self, system: System, depth: int, seed: int, effort: Effort | None) -> None:
        self._system = system
        self._effort = effort
        self._represented = representatives(system)
        # INIT stays part of the question: what never changes is as it was then.
        self._unrolling = Unrolling(system, seed)
        encoder, solver = self._unrolling.encoder, self._unrolling.solver
        self._d = encoder.d
        solver.add([self._d.unary(UnaryOp.NOT, self._unrolling.opening.moment.findings.fault)])
        start = encoder.arbitrary(self._unrolling.opening.moment.configuration, "#")
        checks = SymbolicInputs(self._unrolling.unknowns, "start")
        # As after INIT, all claims about configurations are about this one.
        self.broken: dict[Claim, BrokenStep] = {}
        self._assumed = [
            SymbolicConfiguration(ClaimPhase.INIT, start, [], StepFindings(False), checks)
        ]
        self._asked: list[SymbolicConfiguration] = []
        for number in range(depth):
            taken = encoder.round(self._assumed[-1].configuration, f"step{number}")
            solver.add(taken.middle.constraints)
            if number + 1 < depth:
                self._go_on(taken.middle)
                solver.add(taken.urgency)
                solver.add(taken.end.constraints)
                self._go_on(taken.end)
            else:
                self._last = taken
                self._asked = taken.moments

    @property
    def limits(self) -> list[str]:
        """Descriptions of the values that the step and its queries do not cover."""
        return self._unrolling.unknowns.uncovered

    def _go_on(self, moment: SymbolicConfiguration) -> None:
        self._unrolling.solver.add([self._d.unary(UnaryOp.NOT, moment.findings.fault)])
        self._assumed.append(moment)

    def scripts(
        self, assumed: Sequence[Claim], asked: Sequence[Claim]
    ) -> Iterator[tuple[ClaimPhase, str]]:
        """Yield for each moment the query that one of the claims is broken at it."""
        hypotheses = self._hypotheses(assumed)
        for moment in self._asked:
            broken = disjunction(self._d, list(self._violations(moment, asked).values()))
            question = [*hypotheses, *self._last.until(self._d, moment), broken]
            yield moment.phase, self._unrolling.solver.script(question)

    def failing(
        self, assumed: Sequence[Claim], asked: Sequence[Claim], deadline: Deadline
    ) -> dict[Claim, str]:
        """The claims that one step can break, if all assumed ones hold before."""
        hypotheses = self._hypotheses(assumed)
        failed: dict[Claim, str] = {}
        for moment in self._asked:
            pending = self._violations_up_to_names(moment, asked)
            extra = [*hypotheses, *self._last.until(self._d, moment)]
            for claim in failed:
                pending.pop(claim, None)
            for claim, violated in list(pending.items()):
                if claim in pending:
                    hit = self._broken_by(claim, violated, pending, extra, moment, deadline)
                    failed |= hit
                    for other in hit:
                        del pending[other]
        return failed

    def _broken_by(
        self,
        claim: Claim,
        violated: Term,
        pending: dict[Claim, Term],
        extra: list[Term],
        moment: SymbolicConfiguration,
        deadline: Deadline,
    ) -> dict[Claim, str]:
        """The reasons why claims fail at a moment, case by case, for all that one step breaks."""
        solver = self._unrolling.solver
        whole = solver.check([*extra, violated], deadline, self._effort, at_most=FIRST_TRY)
        if whole is SolverAnswer.SAT:
            return self._seen(claim, pending, moment)
        for case in cases(self._d, violated) if whole is SolverAnswer.UNKNOWN else ():
            answer = solver.check([*extra, case], deadline, self._effort)
            if answer is SolverAnswer.UNKNOWN:
                return {claim: "timeout" if deadline.is_near() else "too much for the solver"}
            if answer is SolverAnswer.SAT:
                return self._seen(claim, pending, moment)
        return {}

    def _seen(
        self, claim: Claim, pending: dict[Claim, Term], moment: SymbolicConfiguration
    ) -> dict[Claim, str]:
        """What the step breaks that the solver found."""
        model = self._unrolling.solver.model()
        also = [other for other, term in pending.items() if model.truth(term)]
        self._keep(model, moment, [claim, *also])
        return dict.fromkeys([claim, *also], "not inductive")

    def _keep(self, model: Model, moment: SymbolicConfiguration, claims: Sequence[Claim]) -> None:
        """Record the step that breaks claims. Assumed moments are middles and ends of rounds."""
        from koord.verify.witness import ModelReader

        ends = [m.configuration for m in self._assumed if m.phase is not ClaimPhase.MIDDLE]
        reader = ModelReader(model, self._system)
        step = broken_step(reader, ends, moment.configuration, moment.phase)
        self.broken |= dict.fromkeys(claims, step)

    def _hypotheses(self, claims: Sequence[Claim]) -> list[Term]:
        state = [claim for claim in claims if claim.is_state_property]
        return [
            self._d.unary(UnaryOp.NOT, violated)
            for moment in self._assumed
            for violated in self._violations(moment, state).values()
        ]

    def _violations_up_to_names(
        self, moment: SymbolicConfiguration, claims: Sequence[Claim]
    ) -> dict[Claim, Term]:
        originals = {self._represented(claim): claim for claim in claims}
        found = self._violations(moment, list(originals))
        return {originals[claim]: violated for claim, violated in found.items()}

    def _violations(
        self, moment: SymbolicConfiguration, claims: Sequence[Claim]
    ) -> dict[Claim, Term]:
        found = {}
        for claim, (violated, needed) in violations(self._system, self._d, moment, claims).items():
            self._unrolling.solver.add(needed)
            found[claim] = violated
        return found
