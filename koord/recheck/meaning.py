"""Meaning of certificates: the program, its claims as texts, and the invariant.

The invariant is parsed as Koord, beside the program; the claims are taken from the program. What is
asked of every program is told by kind and subject, what the program states by its name in the
program's text: a file cannot call a claim what it likes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeGuard, assert_never

from msgspec import Struct
from msgspec.structs import replace

from koord.recheck.certificate import REWRITE, Certificate, Claimed
from koord.recheck.claims import Claim, ClaimKind
from koord.recheck.premises import Premise, contract_text, contracts, premises
from koord.recheck.world import Instance
from koord.syntax import ast, core
from koord.syntax.core import PropertyKind
from koord.syntax.diagnostics import Diagnostic, Severity, refusal
from koord.syntax.elaboration import elaborate
from koord.syntax.parsing.parser import parse
from koord.syntax.printing.program import Stated, stated, with_invariants
from koord.syntax.problem import Problem
from koord.syntax.source import NOWHERE, Source, Span

#: Statements about configurations.
INVARIANTS = (PropertyKind.INVARIANT, PropertyKind.AT_ROUND)


class Statement(Struct, frozen=True):
    """A claim with its text: Koord, or words for claims about every program."""

    claimed: Claimed
    text: str
    span: Span = NOWHERE


#: What no program may do.
NO_FAULT = (
    "no fault: nobody divides by zero, reads what is unset or not there, breaks what a function "
    "requires, or chooses from nothing"
)


#: What programs state is called as they call it.
_BY_NAME = (ClaimKind.STATEMENT, ClaimKind.LIVENESS)


def name_of(kind: ClaimKind, subject: str, name: str) -> str:
    """The name of a claim: ``name`` counts for statements of the program only."""
    match kind:
        case ClaimKind.STATEMENT | ClaimKind.LIVENESS:
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
        subject = claimed.name if claimed.kind in _BY_NAME else claimed.subject
        if (claimed.kind, subject) in found:
            raise _damage(certificate, f"{claimed.name!r} is claimed twice")
        _check_name(certificate, claimed)
        found[claimed.kind, subject] = _statement(certificate, claimed, program, sections)
    _check_left_out(certificate, program)
    return tuple(found.values())


def _check_name(certificate: Certificate, claimed: Claimed) -> None:
    """Check that a claim's name follows from its kind and subject. Raises KoordError."""
    kind, subject = claimed.kind, claimed.subject
    if subject and kind in (*_BY_NAME, ClaimKind.FAULT):
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
        case ClaimKind.LIVENESS:
            for property_, text in _of_runs(program, sections):
                if property_.name == claimed.name:
                    return Statement(claimed, text, property_.span)
            story = f"the program claims no {claimed.name!r} of whole runs"
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
            for module, contract in contracts(program):
                if contract.name == subject and module.environment is not None:
                    text = contract_text(sections, contract)
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


def _is_of_runs(section: ast.Section) -> TypeGuard[ast.Eventually | ast.LeadsTo]:
    """Return whether a section claims something of whole runs."""
    claims = isinstance(section, ast.LeadsTo) and not section.assumed
    return claims or isinstance(section, ast.Eventually)


def _of_runs(
    program: core.Program, sections: Sequence[ast.Section]
) -> Iterator[tuple[core.Property, str]]:
    """The claims of a program about whole runs, each with its text."""
    made = [p for p in program.properties if p.kind not in INVARIANTS]
    blocks = [(None, sections)] + [
        (s.name, s.sections) for s in sections if isinstance(s, ast.Agent)
    ]
    texts = [
        Stated(one, block).text for block, those in blocks for one in those if _is_of_runs(one)
    ]
    yield from zip(made, texts, strict=True)


def _check_left_out(certificate: Certificate, program: core.Program) -> None:
    """Check that claims listed as not covered are claims about the program. Raises KoordError."""
    known = {p.name for p in program.properties} | {name_of(ClaimKind.FAULT, "", "")}
    known |= {name_of(ClaimKind.LOST_UPDATE, d.variable.name, "") for d in program.allwrite}
    known |= {name_of(ClaimKind.CONTRACT, c.name, "") for _, c in contracts(program)}
    claimed = {one.name for one in certificate.claims}
    for name, _ in certificate.not_covered:
        if name not in known or name in claimed:
            why = "and claimed" if name in claimed else "and it is no claim about the program"
            raise _damage(certificate, f"{name!r} is said not to be covered, {why}")


def _damage(certificate: Certificate, story: str) -> Exception:
    return refusal("K941", certificate.name, story, REWRITE)


class CertifiedProblem(Struct, frozen=True):
    """The subject of a certificate: the problem, the claims, and the premises."""

    problem: Problem
    statements: tuple[Statement, ...]
    premises: tuple[Premise, ...]
    sections: tuple[ast.Section, ...]


class InductiveArgument(Struct, frozen=True):
    """Claims that are inductive together, for some robots or any number of them."""

    world: Instance
    #: The invariant's conjuncts, and what is claimed beside statements about configurations.
    claims: tuple[Claim, ...]
    #: Statements that are claimed without being conjuncts: they have to follow.
    consequences: tuple[core.Property, ...]


class CertifiedArguments(Struct, frozen=True):
    """A certificate with its program: the arguments for its robots and for every number."""

    here: InductiveArgument
    everyone: InductiveArgument | None


_OF_PROPERTIES = (ast.Assume, ast.Invariant, ast.FunDef, ast.ParamDecl)


def meant(certificate: Certificate) -> CertifiedProblem:
    """The subject of a certificate. Raises KoordError (K940, K941) for contradictions."""
    name = certificate.name
    sources = (certificate.program, *certificate.properties)
    sections: list[ast.Section] = []
    for number, source in enumerate(sources):
        parsed = parse(source)
        _stop_at_errors(name, source.name, parsed.diagnostics)
        for section in parsed.program.sections:
            if number == 0 or isinstance(section, _OF_PROPERTIES):
                sections.append(section)
    program = elaborated(certificate, sections)
    if any(kind >= len(program.agents) for kind in certificate.kinds):
        raise refusal("K940", name, "kinds names a kind of robot that the program has not")
    if _rests_on(program) != certificate.rests_on:
        raise refusal(
            "K941", name, "rests_on does not name what the program assumes and is promised"
        )
    names = tuple(source.name for source in sources)
    return CertifiedProblem(
        Problem(names, program, certificate.kinds, certificate.delta_s),
        statements(certificate, program, sections),
        premises(certificate, program, sections),
        tuple(sections),
    )


def opened(certificate: Certificate, about: CertifiedProblem) -> CertifiedArguments:
    """Elaborate the program with the invariant. Raises KoordError, and NotRecheckedError."""
    own = [(f"stated {k}", s) for k, s in enumerate(stated(about.sections, ast.Invariant))]
    conjuncts = conjuncts_of(certificate)
    agents = {None, *(agent.name for agent in about.problem.program.agents)}
    for conjunct, one in zip(certificate.invariant, conjuncts, strict=True):
        if (None if one.agent is None else one.agent.name) not in agents:
            story = f"the text of {conjunct.name!r} is of a kind of robot that the program has not"
            raise refusal("K940", certificate.name, story)
    beside = [(f"conjunct {k}", s) for k, s in enumerate(conjuncts)]
    together = with_invariants(about.sections, [*own, *beside])
    program = elaborated(certificate, together)
    _check_given(
        certificate, Instance(about.problem.program, certificate.kinds, certificate.delta_s)
    )
    names = [p.name for p in about.problem.program.properties if p.kind in INVARIANTS]
    here = Instance(program, certificate.kinds, certificate.delta_s)
    found = _argument(certificate, here, names, everyone=False)
    if not any(claimed.everyone for claimed in certificate.claims):
        return CertifiedArguments(found, None)
    anyone = Instance(program, (), certificate.delta_s)
    return CertifiedArguments(found, _argument(certificate, anyone, names, everyone=True))


def _check_given(certificate: Certificate, world: Instance) -> None:
    """Check that the scripts of a proof are complete. Raises KoordError."""
    turns = ["the program turns", "the environment's turn"]
    inside = world.urgent() or (world.asks() and world.mentions(core.Stopped))
    there = {given.name for given in certificate.given}
    for depth in sorted({conjunct.depth for conjunct in certificate.invariant} or {1}):
        over = "" if depth == 1 else f", over {depth} rounds"
        names = [f"initiation{over}"]
        for k in range(1, depth):
            names += [f"base of {turn} in round {k}{over}" for turn in turns]
        names += [f"consecution of {turn}{over}" for turn in turns]
        if inside:
            names.append(f"consecution inside a round{over}")
        for name in names:
            if name not in there:
                raise refusal("K941", certificate.name, f"the obligation {name!r} is missing")


def _argument(
    certificate: Certificate, world: Instance, names: Sequence[str], *, everyone: bool
) -> InductiveArgument:
    """The claims and the invariant; ``everyone``: only those for every number of robots."""
    by_name = {p.name: p for p in world.program.properties}
    own = {given: by_name[f"stated {k}"] for k, given in enumerate(names)}
    conjuncts = [
        (by_name[f"conjunct {k}"], conjunct)
        for k, conjunct in enumerate(certificate.invariant)
        if conjunct.everyone or not everyone
    ]
    depths = [conjunct.depth for _, conjunct in conjuncts]
    claims = [
        Claim(conjunct.name, ClaimKind.STATEMENT, stated, depth=depth)
        for (stated, conjunct), depth in zip(conjuncts, depths, strict=True)
    ]
    kept = {(c.stated.condition, c.stated.kind) for c in claims if c.stated is not None}
    consequences = []
    for claimed in certificate.claims:
        if everyone and not claimed.everyone:
            continue
        if claimed.kind is ClaimKind.LIVENESS:
            continue
        if claimed.kind is not ClaimKind.STATEMENT:
            depth = max(depths, default=1)
            claims.append(Claim(claimed.name, claimed.kind, None, claimed.subject, depth))
        elif (own[claimed.name].condition, own[claimed.name].kind) not in kept:
            consequences.append(replace(own[claimed.name], name=claimed.name))
    return InductiveArgument(world, tuple(claims), tuple(consequences))


def conjuncts_of(certificate: Certificate) -> list[Stated[ast.Invariant]]:
    """The conjuncts of the invariant, parsed. Raises KoordError."""
    return [
        one_invariant(certificate.name, conjunct.name, conjunct.text)
        for conjunct in certificate.invariant
    ]


def one_invariant(name: str, called: str, text: str) -> Stated[ast.Invariant]:
    """Parse the one invariant in a text. Raises KoordError."""
    place = f"{name}: invariant {called}"
    parsed = parse(Source(place, text))
    _stop_at_errors(name, place, parsed.diagnostics)
    found = stated(parsed.program.sections, ast.Invariant)
    whole = (*parsed.program.sections, *_inside(parsed.program.sections))
    if len(found) != 1 or len(whole) != (1 if found[0].agent is None else 2):
        raise refusal("K940", name, f"the text of {called!r} is not one invariant of Koord")
    return found[0]


def _inside(sections: Sequence[ast.Section]) -> list[ast.Section]:
    return [part for s in sections if isinstance(s, ast.Agent) for part in s.sections]


def elaborated(certificate: Certificate, sections: Sequence[ast.Section]) -> core.Program:
    """The core program of some sections. Raises KoordError."""
    tree = ast.Program(tuple(sections), ())
    found = elaborate(tree, certificate.settings)
    _stop_at_errors(certificate.name, certificate.program.name, found.diagnostics)
    if found.program is None:
        raise refusal("K940", certificate.name, "the certificate holds no program")
    return found.program


def _stop_at_errors(name: str, where: str, diagnostics: Sequence[Diagnostic]) -> None:
    for found in diagnostics:
        if found.severity is Severity.ERROR:
            place = f"{where}:{found.span.line}:{found.span.column}"
            raise refusal(
                "K941", name, f"the text has errors: {place}: {found.code}: {found.message}"
            )


def _rests_on(program: core.Program) -> dict[str, tuple[str, ...]]:
    contracts = [
        contract.name
        for agent in program.agents
        for module in agent.modules
        if module.environment is None
        for contract in module.contracts
    ]
    return {
        "assumptions": tuple(assumption.name for assumption in program.assumptions),
        "contracts": tuple(contracts),
        "summaries": tuple(e.name for e in program.externals if e.requires or e.ensures),
    }
