"""Proof cores: minimal sets of premises with which proofs go through.

Each premise is left out in turn, and what was proved is asked again by the engines that proved it;
if it still holds, the premise was not needed. So what stays is a least set, though there may be
others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax.analysis.premises import Premise, premises, without
from koord.syntax.system import System
from koord.verify.claims import Claim, ClaimKind, ClaimPhase, claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Workers
from koord.verify.ledger import Ledger, VerificationProblem
from koord.verify.processes import Pool
from koord.verify.reduction.abstraction import abstracted
from koord.verify.strategy.table import INFERRING_AGAIN, PROVING_AGAIN, AnyTurn, EngineTurn
from koord.verify.verdicts import Bounds, Counterexample, NotReplayedError, Outcome, Verdict


class ProofCore(Struct, frozen=True):
    """A proof core: the premises that the proofs of ``claims`` need, do not need, or not tried."""

    claims: tuple[str, ...]
    needed: tuple[Premise, ...]
    spare: tuple[Premise, ...]
    untried: tuple[Premise, ...] = ()


def proof_core(
    system: System,
    verdicts: Sequence[Verdict],
    bounds: Bounds,
    *,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> ProofCore:
    """Find the premises that proofs for every round need. The time of ``bounds`` counts anew.

    Verdicts on liveness name the fairness they need themselves.
    """
    proved = [v for v in verdicts if v.outcome is Outcome.HOLDS and v.rounds is None]
    proved = [v for v in proved if v.claim.kind is not ClaimKind.LIVENESS]
    names = tuple(v.claim.name for v in proved)
    asked = premises(system.program)
    if not names:
        return ProofCore((), (), (), asked)
    deadline = Deadline.after(bounds.timeout_s)
    engines = {v.engine for v in proved}
    found = any(v.lemmas and v.engine is Engine.EVERY_N for v in proved)
    spare: list[Premise] = []
    for number, premise in enumerate(asked):
        progress(f"without {premise.kind.value} {premise.name}")
        trial = replace(system, program=without(system.program, [*spare, premise]))
        if deadline.passed():
            needed = tuple(p for p in asked[:number] if p not in spare)
            return ProofCore(names, needed, tuple(spare), asked[number:])
        if _still_proved(trial, names, _turns(engines, found), bounds, deadline, seed):
            spare.append(premise)
    needed = tuple(p for p in asked if p not in spare)
    return ProofCore(names, needed, tuple(spare))


def _still_proved(
    system: System,
    names: Sequence[str],
    turns: Iterable[AnyTurn],
    bounds: Bounds,
    deadline: Deadline,
    seed: int,
) -> bool:
    abstraction = abstracted(system.program)
    program = system.program if abstraction is None else abstraction.program
    subject = VerificationProblem(replace(system, program=program), _unasked, system)
    claims = tuple(c for c in claims_of(subject.system) if c.name in names)
    ledger = Ledger(subject, bounds, deadline, claims, seed)
    for turn in turns:
        if ledger.open() and not ledger.is_violated:
            turn.work(ledger)
    return len(ledger.proved()) == len(names)


def _turns(engines: set[Engine], found: bool) -> Iterator[AnyTurn]:
    """The engines that gave proofs; ``found``: with inferred invariants."""
    workers = Workers(Pool())
    rows = [row for engine, row in PROVING_AGAIN.items() if engine in engines]
    for row in [*rows, INFERRING_AGAIN] if found else rows:
        yield EngineTurn(row.engine, row.task, workers)


def _unasked(recording: object, claim: Claim, phase: ClaimPhase) -> Counterexample:
    """Ignore violations: the program has all its premises, so they are no runs of it."""
    raise NotReplayedError("a premise was left out")
