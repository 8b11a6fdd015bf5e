"""Asking one engine, or all of them, about a core program; and looking at the answers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import partial

from koord.semantics.configurations import Configuration
from koord.semantics.domain import EXACT, Constant
from koord.semantics.recordings import Recording, execute
from koord.syntax import core
from koord.syntax.system import System, dealt
from koord.verify.bounded_check import BoundedCheck
from koord.verify.claims import Claim, ClaimPhase, claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.explicit.property_checks import GoalKind, SearchGoal
from koord.verify.engines.induction.proving import prove
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Counterexample, Outcome, Report, Verdict
from koord.verify.witness import replayed
from tests.loading import program_of

SECONDS = 60.0


@dataclass(frozen=True)
class Checked:
    """What bounded model checking said, by name of the claim."""

    violated: dict[str, Counterexample]
    bounded: BoundedCheck
    system: System

    @property
    def rounds(self) -> dict[str, int]:
        """The round in which each violated claim breaks."""
        return {name: shown.round for name, shown in self.violated.items()}

    def last(self, name: str) -> Configuration[Constant]:
        """The configuration in which a counterexample ends."""
        return list(execute(EXACT, self.system, self.violated[name].recording))[-1].configuration


def of_text(text: str, robots: int = 2, delta: Fraction = Fraction(1)) -> System:
    """The system of a text without mistakes."""
    return dealt(program_of(text), robots, delta)


def system_of(program: core.Program | System, robots: int = 2) -> System:
    return program if isinstance(program, System) else dealt(program, robots, Fraction(1, 10))


def bounded(
    program: core.Program | System, robots: int = 2, rounds: int = 3, seed: int = 0
) -> Checked:
    """Bounded model checking of all claims, without simplifying what it finds."""
    system = system_of(program, robots)
    check = BoundedCheck(system, partial(judged, system), seed)
    found = check.check(claims_of(system), (), rounds, Deadline.after(SECONDS))
    shown = {}
    for claim, verdict in found.items():
        assert verdict.counterexample is not None
        shown[claim.name] = verdict.counterexample
    return Checked(shown, check, system)


def judged(system: System, recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
    return replayed(system, recording, claim, phase)


def inductive(
    program: core.Program | System, robots: int = 2, depth: int = 1
) -> tuple[set[str], dict[str, str]]:
    """The claims that a step of so many rounds proves, and why it does not prove the others.

    Only claims that hold in the rounds before are put to it, as the portfolio does.
    """
    system = system_of(program, robots)
    base = bounded(system, rounds=depth - 1)
    claims = [c for c in claims_of(system) if c.name not in base.violated]
    claims = [c for c in claims if c not in base.bounded.unreplayed]
    result = prove(system, claims, (), Deadline.after(SECONDS), depth=depth)
    return {c.name for c in result.proved}, {c.name: why for c, why in result.reasons.items()}


def ask(
    program: core.Program | System,
    robots: int = 2,
    rounds: int = 5,
    choice: Engine | None = None,
    *,
    seed: int = 0,
    seconds: float = SECONDS,
) -> Answers:
    """Everything that ``koord verify`` says."""
    return Answers(verify(system_of(program, robots), Bounds(rounds, seconds), choice, seed=seed))


@dataclass(frozen=True)
class Answers:
    """A report, by name of the claim."""

    report: Report

    def __getitem__(self, name: str) -> Verdict:
        (found,) = [v for v in self.report.verdicts if v.claim.name == name]
        return found

    def __iter__(self) -> Iterator[Verdict]:
        return iter(self.report.verdicts)

    def outcome(self, name: str) -> Outcome:
        return self[name].outcome

    @property
    def empty(self) -> list[str]:
        """What makes the verdicts say less than they seem to."""
        return [
            f"{v.what.value} {v.subject}".rstrip() + f": {v.detail}" for v in self.report.vacuities
        ]


def name_of(goal: SearchGoal) -> str:
    """What the verifier calls a goal of the search."""
    match goal.subject:
        case GoalKind.FAULT:
            return "no fault"
        case GoalKind.CONTRACT:
            return f"contract {goal.name}"
        case GoalKind.LOST_UPDATE:
            return f"no lost update of {goal.name}"
        case GoalKind.PROPERTY:
            return goal.name
