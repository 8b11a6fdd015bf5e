"""Vacuous liveness: the goal holds in every initial configuration. [PROP-VACUOUS]"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from koord.semantics.domain import disjunction
from koord.semantics.liveness import responses
from koord.syntax import core
from koord.syntax.system import System
from koord.verify.claims import Claim, ClaimKind
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.encoding.unrolling import Unrolling, violations
from koord.verify.engine_names import Engine
from koord.verify.vacuity.analysis import never_changes
from koord.verify.vacuity.unreachable import few_of
from koord.verify.verdicts import Emptiness, Outcome, Vacuity, Verdict

#: What it may cost to see that something is so at the start, for each property.
_START_S = 0.5


def vacuous_goals(
    system: System, verdicts: Iterable[Verdict], deadline: Deadline, seed: int
) -> Iterator[Vacuity]:
    """The liveness verdicts that hold for every run."""
    for verdict in verdicts:
        stated = verdict.claim.stated
        if stated is None or verdict.outcome is not Outcome.HOLDS:
            continue
        detail = ""
        if never_changes(system.program, stated.condition):
            detail = "nothing that its goal reads changes after the start"
        elif stated.trigger is None and _holds_at_once(
            _looked_at(system, verdict), stated, deadline, seed
        ):
            detail = "its goal is reached at the start already"
        if detail:
            yield Vacuity(Emptiness.UNTOUCHED, stated.name, detail, True, stated.span)


def _looked_at(system: System, verdict: Verdict) -> System:
    """The system whose start shows that a verdict says something: few robots do, if it is for every
    number of them.
    """
    few = few_of(system) if verdict.engine is Engine.EVERY_N else None
    return system if few is None else few


def _holds_at_once(system: System, stated: core.Property, deadline: Deadline, seed: int) -> bool:
    """Return whether a goal holds in every initial configuration."""
    goals = [response.goal for response in responses(system, stated)]
    claims = [Claim(goal.name, ClaimKind.PROPERTY, goal) for goal in goals]
    unrolling = Unrolling(system, seed)
    d, solver = unrolling.encoder.d, unrolling.solver
    missed = []
    for claim in claims:
        for violated, needed in violations(system, d, unrolling.opening.moment, [claim]).values():
            solver.add(needed)
            missed.append(violated)
    answer = solver.check([disjunction(d, missed)], deadline, Effort.of_seconds(_START_S))
    return answer is SolverAnswer.UNSAT and not unrolling.unknowns.limits
