"""Invariants at every instant of the environment's turn, not only at its end. [ENV-INSTANT]

A program is joined with *shadows*: for each module another one, whose sensors show at the end of
each round what those of the module were at some instant of the turn just over. The instant is an
unknown constant, the same for all robots and rounds, so that what is shown of the shadows at the
ends of rounds is shown of all instants. Everything else stays as it is: each engine can be asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.domain import disjunction
from koord.semantics.environment import environment_turn
from koord.semantics.every_number import NotFiniteError
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.recordings import Answer, Recording
from koord.semantics.storage import same_storage
from koord.syntax import core
from koord.syntax.core import BinaryOp, Direction, Home, UnaryOp
from koord.syntax.source import NOWHERE, Span
from koord.syntax.system import System
from koord.syntax.types import FLOAT, FloatType, Type, within
from koord.syntax.walk import last_site, statements, written
from koord.verify.claims import Claim, ClaimKind
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.solver import SolverAnswer as Solved
from koord.verify.encoding.symbols import SymbolicInputs, SymbolicOracle
from koord.verify.encoding.terms import Term
from koord.verify.encoding.unknowns import Symbolic
from koord.verify.encoding.unrolling import Unrolling
from koord.verify.engine_names import Engine
from koord.verify.helpers import Helpers
from koord.verify.job_process import was_interrupted
from koord.verify.obstacles import SHADOWS, Failure, Unshown, failure_of
from koord.verify.reduction.shadows import (
    BETWEEN,
    INSTANT,
    Shadows,
    between,
    is_asked_between,
    ports_of,
    with_primed,
)
from koord.verify.strategy.time_limits import verify_apart
from koord.verify.verdicts import Bounds, Outcome, Report, Verdict


class Unsaid(Struct, frozen=True):
    """A module whose model does not define its sensors between the ends of rounds."""

    module: str
    reason: str
    span: Span


class Shadowed(Struct, frozen=True):
    """A system with shadow modules, and the claims about it.

    ``unsaid`` says of claims why nobody knows: they are not among those of the system.
    ``failures``: what making the shadows ran into.
    """

    original: System
    system: System
    names: tuple[str, ...]
    unsaid: tuple[tuple[Claim, Unsaid], ...]
    failures: tuple[Failure, ...] = ()

    def unshadowed(self, recording: Recording) -> Recording:
        """The run of the original system that a run of the shadowed system projects to."""
        program, kinds = self.original.program, self.original.kinds
        known = {None, *(external.name for external in program.externals)}
        last = last_site(program)

        def is_own(robot: int | None, slot: int) -> bool:
            return robot is None or slot < len(program.agents[kinds[robot]].ports)

        def own(answers: Iterable[Answer]) -> tuple[Answer, ...]:
            return tuple(a for a in answers if a.function in known and a.key[0] <= last)

        opening = recording.opening
        starts = (s for s in opening.starts if s.home is not Home.PORT or is_own(s.robot, s.slot))
        rounds = (
            replace(
                r,
                readings=tuple(x for x in r.readings if is_own(x.robot, x.slot)),
                answers=own(r.answers),
            )
            for r in recording.rounds
        )
        return Recording(
            replace(opening, starts=tuple(starts), answers=own(opening.answers)),
            tuple(rounds),
            recording.loop,
        )


def instant_of(recording: Recording) -> Fraction | None:
    """The instant in a run with shadows, in seconds from the start of each turn."""
    for round_ in reversed(recording.rounds):
        for answer in round_.answers:
            if answer.function == INSTANT:
                assert isinstance(answer.value, int | Fraction)
                return Fraction(answer.value)
    return None


def verified(
    shadows: Shadowed,
    bounds: Bounds,
    choice: Engine | None,
    *,
    wanted: Callable[[str], bool] = lambda name: True,
    seed: int = 0,
    jobs: int = 1,
    helpers: Helpers | None = None,
    progress: Callable[[str], None] = lambda text: None,
    interrupted: Callable[[], bool] = lambda: False,
) -> Report:
    """Decide claims about instants, restricted to the ``wanted`` names.

    What the claims rest on in turn, the invariants at the ends of rounds, is shown on the way.
    """
    names = [name for name in shadows.names if wanted(name)]
    report = Report((), (), 0.0)
    if names:
        report = verify_apart(
            shadows.system,
            bounds,
            choice,
            names=names,
            seed=seed,
            jobs=jobs,
            helpers=helpers,
            progress=lambda text: progress(f"{BETWEEN}: {text}"),
            interrupted=interrupted,
        )
    unsaid = tuple(
        Verdict(
            claim,
            Outcome.UNKNOWN,
            Engine.NONE,
            0.0,
            reason=hidden.reason,
            obstacles=(Unshown(Engine.NONE, hidden.reason),),
        )
        for claim, hidden in shadows.unsaid
        if wanted(claim.name)
    )
    # What is empty is so at the ends of rounds as well, and told there.
    verdicts, failures = report.verdicts + unsaid, report.failures + shadows.failures
    return replace(report, verdicts=verdicts, vacuities=(), failures=failures)


def shadowed(system: System, deadline: Deadline, seed: int = 0) -> Shadowed:
    """The system with shadows of all modules that its invariants read.

    Where they cannot be made, nobody knows of any of these invariants, and the rest is as it is.
    """
    try:
        return _shadowed(system, deadline, seed)
    except Exception as error:
        if was_interrupted():
            raise KeyboardInterrupt from error
        failure = failure_of(SHADOWS, error)
    read = [p for p in system.program.properties if is_asked_between(p)]
    hidden = Unsaid("", str(failure), NOWHERE)
    claims = (Claim(between(p.name), ClaimKind.PROPERTY, p) for p in read)
    unsaid = tuple((claim, hidden) for claim in claims)
    return Shadowed(system, system, (), unsaid, (failure,))


def _shadowed(system: System, deadline: Deadline, seed: int) -> Shadowed:
    program = system.program
    asked = [p for p in program.properties if is_asked_between(p)]
    read = {p: ports_of(p.condition) for p in asked}
    wanted = with_primed(program, {slot for slots in read.values() for slot in slots})
    shadows = Shadows.of(program, wanted)
    if not shadows.slots:
        return Shadowed(system, system, (), ())
    joined = replace(system, program=shadows.program())
    unsaid = _unsaid(joined, shadows, deadline, seed)
    lost = {slot for module in unsaid for slot in shadows.modules[module.module]}
    said, silent = [], []
    for p in asked:
        stated = shadows.statement(p)
        if stated is None:
            continue
        hidden = next((u for u in unsaid if read[p] & set(shadows.modules[u.module])), None)
        if hidden is None:
            said.append(stated)
        else:
            silent.append((Claim(stated.name, ClaimKind.PROPERTY, stated), hidden))
    made = replace(joined.program, properties=(*program.properties, *said))
    return Shadowed(
        system,
        replace(joined, program=made),
        (*(p.name for p in said), *shadows.promises(lost)),
        tuple(silent),
    )


# --- what models say ------------------------------------------------------------------------------


def _unsaid(system: System, shadows: Shadows, deadline: Deadline, seed: int) -> list[Unsaid]:
    """The modules with models that do not define instants."""
    found = []
    for kind, agent in enumerate(system.program.agents):
        originals = {m.name: m for m in shadows.original.agents[kind].modules}
        for name, module in originals.items():
            if module.environment is None or name not in shadows.modules:
                continue
            reason = _hides(agent, module) or _jumps(system, kind, shadows, module, deadline, seed)
            if reason:
                found.append(Unsaid(name, f"{name} {reason}", module.span))
    return found


def _hides(agent: core.Agent, module: core.Module) -> str:
    """The reason why a model cannot be run for a part of its turn; empty if it can."""
    for statement in statements(module.environment or ()):
        for place in written(statement):
            if place.variable.home is not Home.PORT:
                continue
            if agent.ports[place.variable.slot].direction is Direction.ACTUATOR:
                return f"changes an actuator, {place.variable.name}"
            if not isinstance(statement, core.Assign):
                return f"makes {place.variable.name} longer or shorter"
    return ""


def _jumps(
    system: System,
    kind: int,
    shadows: Shadows,
    module: core.Module,
    deadline: Deadline,
    seed: int,
) -> str:
    """The number that a model may change in no time (a discontinuity); empty if there is none.

    Where it chooses, it may choose nothing (0, or what is nearest to it).
    """
    robots = [k for k, its_kind in enumerate(system.kinds) if its_kind == kind]
    if not robots:
        return ""
    robot = robots[0]
    unrolling = Unrolling(system, seed)
    d, inputs = unrolling.encoder.d, _Still(unrolling.unknowns, "still")
    start = unrolling.encoder.arbitrary(unrolling.opening.moment.configuration, "any")
    state = start.robots[robot]
    try:
        whole = environment_turn(d, replace(system, program=shadows.original), robot, state, inputs)
        turned = environment_turn(d, system, robot, state, inputs)
    except NotFiniteError as error:
        return f"is not understood: {error}"
    sound = [d.unary(UnaryOp.NOT, fault) for fault, _ in whole.faults]
    faults = disjunction(d, [fault for fault, _ in turned.faults])
    for slot in shadows.modules[module.name]:
        variable = system.program.agents[kind].ports[slot].declaration.variable
        if not any(isinstance(t, FloatType) for t in within(variable.type)):
            continue
        same = same_storage(d, state.ports[slot], turned.ports[shadows.slots[slot]])
        question = [*sound, d.binary(BinaryOp.OR, faults, d.unary(UnaryOp.NOT, same))]
        solved = unrolling.solver.check(question, deadline, Effort.of_seconds(5))
        if solved is not Solved.UNSAT:
            return f"jumps: {variable.name} may change in no time"
    return ""


class _StillOracle(SymbolicOracle):
    """The oracle of a turn of length zero, which changes nothing unless it has to."""

    def choose(self, key: Key, low: Term, high: Term, type_: Type) -> Term:
        d = self.inputs.unknowns.d
        nothing = d.const(0, type_)
        nearest = d.binary(BinaryOp.MIN, high, nothing)
        return d.binary(BinaryOp.MAX, low, nearest)

    def external(
        self, function: core.External, key: Key, arguments: tuple[Symbolic, ...]
    ) -> Symbolic:
        if function.name == INSTANT:
            return self.inputs.unknowns.d.const(0, FLOAT)
        return SymbolicOracle.external(self, function, key, arguments)


class _Still(SymbolicInputs):
    """The inputs of a turn of length zero."""

    def oracle(self, phase: Phase, robot: int) -> Oracle[Term]:
        return _StillOracle(self, phase, robot)
