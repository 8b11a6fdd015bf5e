"""Premises of certificates: what a proof uses and does not show, in the words of the program."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import Enum

from msgspec import Struct
from msgspec.structs import replace

from koord.recheck.certificate import Certificate
from koord.recheck.progress_argument import HelpKind
from koord.syntax import ast, core
from koord.syntax.printing.program import print_program, stated
from koord.syntax.source import NOWHERE, Span


class PremiseKind(Enum):
    """The kinds of premises."""

    ASSUMPTION = "assumption"
    CONTRACT = "contract"
    SUMMARY = "summary"
    FAIRNESS = "fairness"  #: of runs, where something is shown of whole ones


class Premise(Struct, frozen=True):
    """A premise; ``text`` is Koord, empty if it is the library's."""

    kind: PremiseKind
    name: str
    text: str
    span: Span = NOWHERE


def premises(
    certificate: Certificate, program: core.Program, sections: Sequence[ast.Section]
) -> tuple[Premise, ...]:
    """All assumptions, contracts and summaries of the program, and of runs what proofs need."""
    found = [
        Premise(PremiseKind.ASSUMPTION, made.name, section.text, made.span)
        for made, section in zip(program.assumptions, stated(sections, ast.Assume), strict=True)
    ]
    found += [
        Premise(PremiseKind.CONTRACT, c.name, contract_text(sections, c), c.span)
        for module, c in contracts(program)
        if module.environment is None
    ]
    texts = {s.name.name: s for s in sections if isinstance(s, ast.FunDef)}
    for external in program.externals:
        if external.requires or external.ensures:
            own = texts.get(external.name)
            text = "" if own is None else _printed(own)
            found.append(Premise(PremiseKind.SUMMARY, external.name, text, external.span))
    return (*found, *_of_fairness(certificate, program, sections))


def _of_fairness(
    certificate: Certificate, program: core.Program, sections: Sequence[ast.Section]
) -> Iterator[Premise]:
    """What proofs about whole runs rest on: fairness, and assumptions about such runs."""
    ways = [way for proof in certificate.progress for way in proof.help]
    if any(way.kind in (HelpKind.ROBOT, HelpKind.AFTER_RUN) for way in ways):
        story = "runs are fair to robots: none is passed over for ever"
        yield Premise(PremiseKind.FAIRNESS, "robots", story)
    if any(one.lock_class is not None for proof in certificate.progress for one in proof.order):
        story = "runs are fair about locks: who asks again and again is granted again and again"
        yield Premise(PremiseKind.FAIRNESS, "locks", story)
    named = {way.assumption for way in ways}
    assumed = [one for one in stated(sections, ast.LeadsTo) if one.section.assumed]
    for expected, one in zip(program.expectations, assumed, strict=True):
        if expected.name in named:
            yield Premise(PremiseKind.ASSUMPTION, expected.name, one.text, expected.span)


def contracts(program: core.Program) -> Iterator[tuple[core.Module, core.Contract]]:
    """The contracts of a program, each with its module."""
    for agent in program.agents:
        for module in agent.modules:
            for contract in module.contracts:
                yield module, contract


def contract_text(sections: Sequence[ast.Section], contract: core.Contract) -> str:
    """A contract in Koord; empty if it is the library's."""
    for used in stated(sections, ast.Using):
        for written in used.section.contracts:
            if written.span == contract.span:
                bare = replace(used.section, sensors=(), actuators=(), environment=None)
                return _printed(replace(bare, contracts=(written,)))
    return ""


def _printed(section: ast.Section) -> str:
    return print_program(ast.Program((section,), (), span=section.span)).rstrip("\n")
