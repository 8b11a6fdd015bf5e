"""Export of a program's claims as a circuit, or as one SMT-LIB query.

The question can be satisfied if and only if a claim breaks in INIT or within a bound. Opaque values
are of uninterpreted sorts.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.domain import disjunction
from koord.semantics.every_number import NotFiniteError
from koord.syntax.system import System
from koord.verify.claims import Claim, ClaimPhase, claims_of
from koord.verify.encoding.solver import Layer
from koord.verify.encoding.unrolling import Unrolling, violations
from koord.verify.engines.bits.circuit import circuit_of
from koord.verify.engines.bits.circuit_files import Format, exported
from koord.verify.reduction.abstraction import abstracted


class Script(Struct, frozen=True):
    """A script of SMT-LIB 2, and the values that it does not cover."""

    text: str
    limits: tuple[str, ...]


def script(system: System, claims: Sequence[Claim], rounds: int) -> Script:
    """The query about some claims, within so many rounds.

    Raises NotFiniteError for what formulas cannot say, and OutOfBudgetError.
    """
    unrolling = Unrolling(system)
    d, layers = unrolling.encoder.d, list[Layer]()
    for moment in unrolling.moments():
        broken = list(violations(system, d, moment, claims).values())
        for _, needed in broken:
            unrolling.solver.add(needed)
        asked = disjunction(d, [violated for violated, _ in broken])
        layers.append(Layer(unrolling.solver.required, asked))
        is_end = moment.phase in (ClaimPhase.INIT, ClaimPhase.END)
        if is_end and moment.configuration.round >= rounds:
            break
    limits = tuple(unrolling.unknowns.uncovered)
    return Script(unrolling.solver.layered(layers), limits)


class Export(Struct, frozen=True):
    """A problem as a file, and where it over-approximates the program."""

    content: bytes
    notes: tuple[str, ...]


def problem(
    system: System, names: Sequence[str], format_: Format, rounds: int, comment: str
) -> Export:
    """Export the claims about a system, or the named ones.

    Values that merely flow are opaque. SMT-LIB has Booleans alone where these say everything, and
    else integers and reals. Raises NotFiniteError for what cannot be said, and OutOfBudgetError.
    """
    abstraction = abstracted(system.program)
    if abstraction is not None:
        system = replace(system, program=abstraction.program)
    claims = [claim for claim in claims_of(system) if not names or claim.name in names]
    try:
        circuit = circuit_of(system, claims)
    except NotFiniteError:
        if format_ is not Format.SMT2:
            raise
        return _question(system, claims, rounds, comment)
    if format_ is Format.SMT2 and (circuit.d.looser or circuit.strays or circuit.limits):
        with suppress(NotFiniteError):  # what formulas cannot say, a circuit leaves open
            return _question(system, claims, rounds, comment)
    better = "" if format_ is Format.SMT2 else " (--export smt2 has integers and reals)"
    notes = [f"not covered: {limit}" for limit in circuit.limits]
    if circuit.d.looser:
        notes.append(
            "of infinitely many values, so a violation need not be one of the program"
            f"{better}: {_listed(circuit.d.looser)}"
        )
    if circuit.strays:
        notes.append(
            "followed in a range only, so a violation with a value beyond need not be one of the "
            f"program{better}: {_listed(circuit.strays)}"
        )
    return Export(exported(circuit, format_, rounds, comment), tuple(notes))


def _listed(names: Iterable[str]) -> str:
    """The names of variables without their robots."""
    return ", ".join(sorted({name.split("@")[0] for name in names}))


def _question(system: System, claims: Sequence[Claim], rounds: int, comment: str) -> Export:
    found = script(system, claims, rounds)
    notes = tuple(f"not covered: {limit}" for limit in found.limits)
    return Export(f"; {comment}\n{found.text}".encode(), notes)
