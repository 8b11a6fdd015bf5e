"""Lemmas of proofs on circuits, as statements in Koord: for people, engines and certificates."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from koord.syntax.analysis.symmetry import Symmetry, symmetry_of
from koord.syntax.system import System
from koord.verify.claims import Claim
from koord.verify.effort import Deadline
from koord.verify.engines.bits.circuit import Circuit
from koord.verify.engines.bits.clauses import NoAnswerError
from koord.verify.engines.bits.ic3 import Cube, SafetyQuery
from koord.verify.engines.bits.invariant_core import needed
from koord.verify.engines.bits.invariant_printer import InvariantText, invariant_texts
from koord.verify.engines.bits.prime_implicants import PlaceTable, Primes, UnsaidError
from koord.verify.engines.bits.robot_permutations import speaking_last
from koord.verify.engines.bits.state_decoder import places_of
from koord.verify.verdicts import AT_ROUND


class Lemmas(Struct, frozen=True):
    """Statements that make claims inductive, or the reason why there are none."""

    statements: tuple[str, ...] = ()
    unsaid: str = ""


def _text(statement: InvariantText) -> str:
    return (AT_ROUND if statement.at_round else "") + statement.text


def lemmas(
    system: System,
    circuit: Circuit,
    question: SafetyQuery,
    cubes: Sequence[Cube],
    claims: Sequence[Claim],
    given: Sequence[Claim],
    deadline: Deadline,
) -> Lemmas:
    """Find an inductive invariant for the claims, if ``given`` ones hold, as statements in Koord.

    Robots that may change places are spoken of together, unless the invariant sets them apart.
    """
    properties = tuple(c.stated for c in (*claims, *given) if c.stated is not None)
    symmetry = symmetry_of(speaking_last(system), properties)
    alike = symmetry if isinstance(symmetry, Symmetry) else None
    reason = ""
    for each in (alike, None) if alike else (None,):
        places = places_of(system, circuit, each)
        table = PlaceTable(circuit.d, places, each.groups if each else ())
        primes = Primes(table, question, cubes, deadline)
        try:
            found = needed(circuit, table, primes.orbits(), claims, given, deadline)
            return Lemmas(tuple(map(_text, invariant_texts(system, table, found))))
        except UnsaidError as error:
            reason = primes.unsaid or str(error)
        except NoAnswerError:
            return Lemmas((), "there was no time to say it in Koord")
    return Lemmas((), reason)
