"""Programs as text, asked about for every number of robots and for a few."""

from __future__ import annotations

from fractions import Fraction

from koord.syntax.system import System, dealt
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline, Effort
from koord.verify.engines.every_n.candidates import candidates
from koord.verify.engines.every_n.proving import Inferred, Proof, infer, prove
from koord.verify.engines.every_n.questions import SPARING, ProofBudget
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import GoalKind
from koord.verify.engines.explicit.search import survey
from koord.verify.reduction.abstraction import abstracted
from tests.loading import program_of

#: The length of rounds where a text states none.
DELTA = Fraction(1)


def system_of(text: str, robots: int = 2) -> System:
    """A system of that many robots, with what merely flows made opaque."""
    program = program_of(text)
    abstraction = abstracted(program)
    delta_s = program.instance.delta_s or DELTA
    return dealt(program if abstraction is None else abstraction.program, robots, delta_s)


def asked(text: str, thrift: ProofBudget = SPARING, seed: int = 0) -> Proof:
    """What is proved of a program, and why the rest is not."""
    system = system_of(text, max(2, len(program_of(text).agents)))
    effort = Effort.of_seconds(thrift.seconds)
    return prove(system, claims_of(system), Deadline(), effort, thrift, seed)


def proved(text: str) -> set[str]:
    """The names of the claims that hold for every number of robots."""
    return {claim.name for claim in asked(text).proved}


def reason(text: str, name: str) -> str:
    """Why a claim is open."""
    return next(why for claim, why in asked(text).reasons.items() if claim.name == name)


def inferred(text: str) -> Inferred:
    """What is proved of a program with invariants that are found for it."""
    system = system_of(text)
    likely = candidates(system.program)
    return infer(system, claims_of(system), likely, Deadline(), Effort.of_seconds(60))


def broken(text: str, robots: int, rounds: int = 4) -> set[str]:
    """The properties that some run of so many robots breaks."""
    system = system_of(text, robots)
    properties = [claim.stated for claim in claims_of(system) if claim.stated is not None]
    limits = Limits(states=5_000, rounds=rounds)
    found = survey(system, properties, limits, subjects=frozenset(GoalKind))
    return {v.claim.name or "no fault" for v in found.violated}
