"""Proofs of progress in certificates, by hand, and the first premise of them that is not met."""

from __future__ import annotations

import json
from collections.abc import Sequence
from fractions import Fraction

from koord.recheck import instances
from koord.recheck.certificate import read
from koord.recheck.every_number import EveryNumber
from koord.recheck.meaning import meant
from koord.recheck.obligations import Settling
from koord.recheck.progress import ProgressObligations
from koord.recheck.progress_meaning import progress_arguments
from koord.recheck.solving import SolverAnswer, SolverSession
from koord.recheck.terms import Terms
from koord.recheck.values import Values
from koord.syntax.elaboration.settings import Settings
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.verify.certificates import ProvedClaims, Texts, certificate
from koord.verify.claims import claims_of, liveness_of
from koord.verify.effort import Deadline
from tests.recheck.certificates import Document


def unmet(document: Document, seconds: float = 0.5) -> str:
    """The first premise about whole runs that is not met; empty if all are."""
    made = read(json.dumps(document).encode(), "certificate.json")
    proofs = progress_arguments(made, meant(made))
    assert proofs is not None
    for proof in proofs.proofs:
        values = Values(Terms(), None, proofs.world.sealed)
        everyone = EveryNumber(proofs.world, proofs.claims, values)
        with SolverSession.start() as session:
            settling = Settling(values, session, lambda: seconds)
            for obligation in ProgressObligations(everyone, proof):
                one = instances.settled(settling, obligation)
                if one.answer is not SolverAnswer.UNSAT:
                    return one.claim
    return ""


def measure(said: str, *, number: bool = False, every: bool = True) -> Document:
    head = "invariant It: forall i: " if every else "invariant It: "
    text = f"{head}0 <= {said}" if number else f"{head}{said}"
    return {"text": text, "every_robot": every, "number": number, "lock_class": None}


def way(said: str, kind: str = "robot", *, unmoved: bool = False, **more: str) -> Document:
    return {"kind": kind, "state": said, "assumption": "", "falls": "", "unmoved": unmoved, **more}


def by_hand(
    text: str,
    lasting: Sequence[str],
    order: Sequence[Document],
    ways: Sequence[Document],
    first: Sequence[Document] = (),
) -> Document:
    """The certificate of a program, with a proof of its claim about whole runs by hand."""
    source = Source("it.krd", text)
    read_ = load(source, Settings({}))
    assert read_.program is not None, read_.diagnostics
    system = dealt(read_.program, 2, Fraction(1, 10))
    names = tuple(claim.name for claim in claims_of(system))
    shown = ProvedClaims(names, frozenset(names))
    made = certificate(system, Texts(source, (), Settings({})), shown, Deadline.after(60), "test")
    assert made is not None
    document: Document = json.loads(json.dumps(made.document))
    (claim,) = liveness_of(system)
    document["claims"].append(
        {"name": claim.name, "kind": "liveness", "subject": "", "every_number": True}
    )
    proof = {"claim": claim.name, "lasting": [*lasting], "order": [*order], "help": [*ways]}
    document["progress"] = [{**proof, "first": list(first)}]
    return document


def found(text: str) -> Document:
    """The certificate of a program, in which what it claims of whole runs is proved by search."""
    source = Source("it.krd", text)
    program = load(source, Settings({})).program
    assert program is not None
    system = dealt(program, 2, Fraction(1, 10))
    shown = ProvedClaims(
        tuple(claim.name for claim in claims_of(system)),
        of_runs=tuple(claim.name for claim in liveness_of(system)),
    )
    made = certificate(system, Texts(source, (), Settings({})), shown, Deadline.after(60), "test")
    assert made is not None
    document: Document = json.loads(json.dumps(made.document))
    return document
