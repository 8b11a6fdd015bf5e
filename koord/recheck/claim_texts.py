"""Claims as texts: every confirmed claim is stated in full, not by its name.

What is asked of every program is told by kind and subject; what the program states by its name in
the program's text. A file cannot call a claim what it likes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import Enum
from typing import assert_never

from msgspec import Struct
from msgspec.structs import replace

from koord.recheck.certificate import REWRITE, Certificate, Claimed
from koord.recheck.claims import ClaimKind
from koord.syntax import ast, core
from koord.syntax.core import PropertyKind
from koord.syntax.diagnostics import refusal
from koord.syntax.printing.program import print_program, stated
from koord.syntax.source import NOWHERE, Span

#: Statements about configurations.
INVARIANTS = (PropertyKind.INVARIANT, PropertyKind.AT_ROUND)


class Statement(Struct, frozen=True):
    """A claim with its text: Koord, or words for claims about every program."""

    claimed: Claimed
    text: str
    span: Span = NOWHERE


class PremiseKind(Enum):
    """The kinds of premises."""

    ASSUMPTION = "assumption"
    CONTRACT = "contract"
    SUMMARY = "summary"


class Premise(Struct, frozen=True):
    """A premise; ``text`` is Koord, empty if it is the library's."""

    kind: PremiseKind
    name: str
    text: str
    span: Span = NOWHERE


#: What no program may do.
NO_FAULT = (
    "no fault: nobody divides by zero, reads what is unset or not there, breaks what a function "
    "requires, or chooses from nothing"
)


def name_of(kind: ClaimKind, subject: str, name: str) -> str:
    """The name of a claim: ``name`` counts for statements of the program only."""
    match kind:
        case ClaimKind.STATEMENT:
            return name
        case ClaimKind.FAULT:
            return "no fault"
        case ClaimKind.LOST_UPDATE:
            return f"no lost update of {subject}"
        case ClaimKind.CONTRACT:
            return f"contract {subject}"
    assert_never(kind)


def statements(
    certificate: Certificate, program: core.Program, sections: Sequence[ast.Section]
) -> tuple[Statement, ...]:
    """The claims of a certificate. Raises KoordError (K941) for claims that cannot be meant."""
    if not certificate.claims:
        raise _damage(certificate, "nothing is claimed")
    found: dict[tuple[ClaimKind, str], Statement] = {}
    for claimed in certificate.claims:
        subject = claimed.name if claimed.kind is ClaimKind.STATEMENT else claimed.subject
        if (claimed.kind, subject) in found:
            raise _damage(certificate, f"{claimed.name!r} is claimed twice")
        _check_name(certificate, claimed)
        found[claimed.kind, subject] = _statement(certificate, claimed, program, sections)
    _check_left_out(certificate, program)
    return tuple(found.values())


def _check_name(certificate: Certificate, claimed: Claimed) -> None:
    """Check that a claim's name follows from its kind and subject. Raises KoordError."""
    kind, subject = claimed.kind, claimed.subject
    if subject and kind in (ClaimKind.STATEMENT, ClaimKind.FAULT):
        about = (
            f"a claim of kind {kind.value!r} has no subject, and {claimed.name!r} has {subject!r}"
        )
        raise _damage(certificate, about)
    right = name_of(kind, subject, claimed.name)
    if claimed.name != right:
        about = f" of {subject!r}" if subject else ""
        story = f"a claim of kind {kind.value!r}{about} is {right!r}, and not {claimed.name!r}"
        raise _damage(certificate, story)


def _statement(
    certificate: Certificate,
    claimed: Claimed,
    program: core.Program,
    sections: Sequence[ast.Section],
) -> Statement:
    subject = claimed.subject
    match claimed.kind:
        case ClaimKind.STATEMENT:
            for property_, text in invariants(program, sections):
                if property_.name == claimed.name:
                    return Statement(claimed, text, property_.span)
            story = f"the program states no invariant {claimed.name!r}"
        case ClaimKind.FAULT:
            return Statement(claimed, NO_FAULT)
        case ClaimKind.LOST_UPDATE:
            for d in program.allwrite:
                if d.variable.name == subject:
                    words = f"in no round somebody writes `{subject}` or a part of it that "
                    words += "another robot updates in that round from what it was"
                    return Statement(claimed, f"{claimed.name}: {words}", d.span)
            story = f"the program has no shared variable {subject!r} to lose an update of"
        case ClaimKind.CONTRACT:
            for module, contract in _contracts(program):
                if contract.name == subject and module.environment is not None:
                    text = _contract_text(sections, contract)
                    words = f"the model of {module.name} keeps it in every round"
                    told = f"{claimed.name}: {words}" + (f"\n{text}" if text else "")
                    return Statement(claimed, told, contract.span)
            story = f"the program has no contract {subject!r} of a module with a model"
    raise _damage(certificate, story)


def invariants(
    program: core.Program, sections: Sequence[ast.Section]
) -> Iterator[tuple[core.Property, str]]:
    """The invariants of a program, each with its text."""
    made = [p for p in program.properties if p.kind in INVARIANTS]
    for property_, section in zip(made, stated(sections, ast.Invariant), strict=True):
        yield property_, section.text


def _check_left_out(certificate: Certificate, program: core.Program) -> None:
    """Check that claims listed as not covered are claims about the program. Raises KoordError."""
    known = {p.name for p in program.properties} | {name_of(ClaimKind.FAULT, "", "")}
    known |= {name_of(ClaimKind.LOST_UPDATE, d.variable.name, "") for d in program.allwrite}
    known |= {name_of(ClaimKind.CONTRACT, c.name, "") for _, c in _contracts(program)}
    claimed = {one.name for one in certificate.claims}
    for name, _ in certificate.not_covered:
        if name not in known or name in claimed:
            why = "and claimed" if name in claimed else "and it is no claim about the program"
            raise _damage(certificate, f"{name!r} is said not to be covered, {why}")


def premises(program: core.Program, sections: Sequence[ast.Section]) -> tuple[Premise, ...]:
    """All assumptions, contracts and summaries of the program."""
    found = [
        Premise(PremiseKind.ASSUMPTION, made.name, section.text, made.span)
        for made, section in zip(program.assumptions, stated(sections, ast.Assume), strict=True)
    ]
    found += [
        Premise(PremiseKind.CONTRACT, c.name, _contract_text(sections, c), c.span)
        for module, c in _contracts(program)
        if module.environment is None
    ]
    texts = {s.name.name: s for s in sections if isinstance(s, ast.FunDef)}
    for external in program.externals:
        if external.requires or external.ensures:
            own = texts.get(external.name)
            text = "" if own is None else _printed(own)
            found.append(Premise(PremiseKind.SUMMARY, external.name, text, external.span))
    return tuple(found)


def _contracts(program: core.Program) -> Iterator[tuple[core.Module, core.Contract]]:
    for agent in program.agents:
        for module in agent.modules:
            for contract in module.contracts:
                yield module, contract


def _contract_text(sections: Sequence[ast.Section], contract: core.Contract) -> str:
    """A contract in Koord; empty if it is the library's."""
    for used in stated(sections, ast.Using):
        for written in used.section.contracts:
            if written.span == contract.span:
                bare = replace(used.section, sensors=(), actuators=(), environment=None)
                return _printed(replace(bare, contracts=(written,)))
    return ""


def _printed(section: ast.Section) -> str:
    return print_program(ast.Program((section,), (), span=section.span)).rstrip("\n")


def _damage(certificate: Certificate, story: str) -> Exception:
    return refusal("K941", certificate.name, story, REWRITE)
