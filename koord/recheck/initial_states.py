"""Opening of certificates: the program, the claims about it, and the invariant.

The invariant is parsed as Koord, beside the program; the claims are taken from the program.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct
from msgspec.structs import replace

from koord.recheck.certificate import Certificate, Conjunct
from koord.recheck.claim_texts import INVARIANTS, Premise, Statement, premises, statements
from koord.recheck.claims import Claim, ClaimKind
from koord.recheck.world import Instance
from koord.syntax import ast, core
from koord.syntax.diagnostics import Diagnostic, Severity, refusal
from koord.syntax.elaboration import elaborate
from koord.syntax.parsing.parser import parse
from koord.syntax.printing.program import Stated, stated, with_invariants
from koord.syntax.problem import Problem
from koord.syntax.source import Source


class Meant(Struct, frozen=True):
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


class Opened(Struct, frozen=True):
    """A certificate with its program: the arguments for its robots and for every number."""

    here: InductiveArgument
    everyone: InductiveArgument | None


_OF_PROPERTIES = (ast.Assume, ast.Invariant, ast.FunDef, ast.ParamDecl)


def meant(certificate: Certificate) -> Meant:
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
    program = _elaborated(certificate, sections)
    if any(kind >= len(program.agents) for kind in certificate.kinds):
        raise refusal("K940", name, "kinds names a kind of robot that the program has not")
    if _rests_on(program) != certificate.rests_on:
        raise refusal(
            "K941", name, "rests_on does not name what the program assumes and is promised"
        )
    names = tuple(source.name for source in sources)
    return Meant(
        Problem(names, program, certificate.kinds, certificate.delta_s),
        statements(certificate, program, sections),
        premises(program, sections),
        tuple(sections),
    )


def opened(certificate: Certificate, about: Meant) -> Opened:
    """Elaborate the program with the invariant. Raises KoordError, and NotRecheckedError."""
    own = [(f"stated {k}", s) for k, s in enumerate(stated(about.sections, ast.Invariant))]
    conjuncts = [_parsed(certificate.name, conjunct) for conjunct in certificate.invariant]
    agents = {None, *(agent.name for agent in about.problem.program.agents)}
    for conjunct, one in zip(certificate.invariant, conjuncts, strict=True):
        if (None if one.agent is None else one.agent.name) not in agents:
            story = f"the text of {conjunct.name!r} is of a kind of robot that the program has not"
            raise refusal("K940", certificate.name, story)
    beside = [(f"conjunct {k}", s) for k, s in enumerate(conjuncts)]
    together = with_invariants(about.sections, [*own, *beside])
    program = _elaborated(certificate, together)
    _check_given(
        certificate, Instance(about.problem.program, certificate.kinds, certificate.delta_s)
    )
    names = [p.name for p in about.problem.program.properties if p.kind in INVARIANTS]
    here = Instance(program, certificate.kinds, certificate.delta_s)
    found = _argument(certificate, here, names, everyone=False)
    if not any(claimed.everyone for claimed in certificate.claims):
        return Opened(found, None)
    anyone = Instance(program, (), certificate.delta_s)
    return Opened(found, _argument(certificate, anyone, names, everyone=True))


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
    depths = [1 if everyone else conjunct.depth for _, conjunct in conjuncts]
    claims = [
        Claim(conjunct.name, ClaimKind.STATEMENT, stated, depth=depth)
        for (stated, conjunct), depth in zip(conjuncts, depths, strict=True)
    ]
    kept = {(c.stated.condition, c.stated.kind) for c in claims if c.stated is not None}
    consequences = []
    for claimed in certificate.claims:
        if everyone and not claimed.everyone:
            continue
        if claimed.kind is not ClaimKind.STATEMENT:
            depth = max(depths, default=1)
            claims.append(Claim(claimed.name, claimed.kind, None, claimed.subject, depth))
        elif (own[claimed.name].condition, own[claimed.name].kind) not in kept:
            consequences.append(replace(own[claimed.name], name=claimed.name))
    return InductiveArgument(world, tuple(claims), tuple(consequences))


def _parsed(name: str, conjunct: Conjunct) -> Stated[ast.Invariant]:
    """Parse the one invariant in a text."""
    place = f"{name}: invariant {conjunct.name}"
    parsed = parse(Source(place, conjunct.text))
    _stop_at_errors(name, place, parsed.diagnostics)
    found = stated(parsed.program.sections, ast.Invariant)
    whole = (*parsed.program.sections, *_inside(parsed.program.sections))
    if len(found) != 1 or len(whole) != (1 if found[0].agent is None else 2):
        raise refusal("K940", name, f"the text of {conjunct.name!r} is not one invariant of Koord")
    return found[0]


def _inside(sections: Sequence[ast.Section]) -> list[ast.Section]:
    return [part for s in sections if isinstance(s, ast.Agent) for part in s.sections]


def _elaborated(certificate: Certificate, sections: Sequence[ast.Section]) -> core.Program:
    tree = ast.Program(tuple(sections), ())
    elaborated = elaborate(tree, certificate.settings)
    _stop_at_errors(certificate.name, certificate.program.name, elaborated.diagnostics)
    if elaborated.program is None:
        raise refusal("K940", certificate.name, "the certificate holds no program")
    return elaborated.program


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
