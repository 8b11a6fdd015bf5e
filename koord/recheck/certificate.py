"""Certificates as they are read: nothing in a file is believed before it is looked at.

The invariant is parsed as Koord, beside the program; the claims are taken from the program.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from hashlib import sha256

from koord.recheck.claims import Claim, Kind
from koord.recheck.world import World
from koord.syntax import ast, core
from koord.syntax.core import PropertyKind
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity, refusal
from koord.syntax.elaborate import elaborate
from koord.syntax.elaborate.settings import ParamValue, Settings
from koord.syntax.parser import parse
from koord.syntax.source import Source

FORMAT = "koord certificate"
VERSION = 3

#: The cure for all that is wrong with a certificate.
REWRITE = "write the certificate anew with `koord verify --certificate`"

#: More robots than this no certificate is about: obligations grow with their number.
MOST_ROBOTS = 1000

_INVARIANTS = (PropertyKind.INVARIANT, PropertyKind.AT_ROUND)
_MOST_DEPTH = 10


@dataclass(frozen=True, slots=True)
class Conjunct:
    """A part of the invariant: its text, and over how many rounds it is inductive.

    ``everyone``: it is one of those that are inductive for every number of robots.
    """

    name: str
    depth: int
    text: str
    everyone: bool = False


@dataclass(frozen=True, slots=True)
class Claimed:
    """What a certificate says to hold; ``everyone``: for every number of robots."""

    name: str
    kind: Kind
    subject: str
    everyone: bool


@dataclass(frozen=True, slots=True)
class Given:
    """A script that came with the certificate."""

    name: str
    smt2: str


@dataclass(frozen=True, slots=True)
class Certificate:
    """What a certificate says."""

    name: str
    program: Source
    properties: tuple[Source, ...]
    settings: Settings
    kinds: tuple[int, ...]
    delta_s: Fraction
    claims: tuple[Claimed, ...]
    invariant: tuple[Conjunct, ...]
    rests_on: dict[str, tuple[str, ...]]
    given: tuple[Given, ...]
    #: Claims that hold and that it is not about, with the reason: nothing is said of them.
    not_covered: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Argument:
    """Claims that prove themselves, about some robots or any number of them."""

    world: World
    #: The invariant's conjuncts, and what is claimed beside statements about configurations.
    claims: tuple[Claim, ...]
    #: Statements that are claimed without being conjuncts: they have to follow.
    consequences: tuple[core.Property, ...]


@dataclass(frozen=True, slots=True)
class Opened:
    """A certificate with its program: what to recheck, for its robots and for every number."""

    here: Argument
    everyone: Argument | None


# --- reading --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Reader:
    """A part of the document, with its place in it."""

    file: str
    path: str
    value: object

    def wrong(self, wanted: str) -> KoordError:
        return refusal("K940", self.file, f"{self.path or 'the document'} is not {wanted}")

    def field(self, name: str) -> _Reader:
        if not isinstance(self.value, dict):
            raise self.wrong("an object")
        if name not in self.value:
            raise refusal("K940", self.file, f"{self.path or 'the document'} has no {name!r}")
        path = f"{self.path}.{name}" if self.path else name
        return _Reader(self.file, path, self.value[name])

    def items(self) -> list[_Reader]:
        if not isinstance(self.value, list):
            raise self.wrong("a list")
        return [
            _Reader(self.file, f"{self.path}[{k}]", value) for k, value in enumerate(self.value)
        ]

    def text(self) -> str:
        if not isinstance(self.value, str):
            raise self.wrong("a text")
        return self.value

    def number(self, low: int, high: int) -> int:
        value = self.value
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise self.wrong(f"an integer from {low} to {high}")
        return value

    def fraction(self) -> Fraction:
        text = self.text()
        try:
            if len(text) > 200 or "e" in text.lower():
                raise ValueError
            return Fraction(text)
        except (ValueError, ZeroDivisionError):
            raise self.wrong("a fraction such as 1/10") from None

    def truth(self) -> bool:
        if not isinstance(self.value, bool):
            raise self.wrong("true or false")
        return self.value

    def names(self) -> tuple[str, ...]:
        return tuple(item.text() for item in self.items())


def read(raw: bytes, name: str) -> Certificate:
    """The certificate in a file. Raises KoordError (K940, K941)."""
    try:
        document = json.loads(raw.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        story = " ".join(str(error).split())[:200]
        raise refusal("K940", name, f"not a JSON document: {story}") from None
    top = _Reader(name, "", document)
    if top.field("format").value != FORMAT:
        raise top.field("format").wrong(repr(FORMAT))
    if top.field("version").value != VERSION:
        raise top.field("version").wrong(f"{VERSION}, the version that this koord reads")
    program = _source(top.field("program"))
    properties = tuple(_source(part) for part in top.field("properties").items())
    delta = top.field("delta").fraction()
    if delta <= 0:
        raise top.field("delta").wrong("positive")
    kinds = tuple(k.number(0, MOST_ROBOTS) for k in top.field("kinds").items())
    if not 0 < len(kinds) <= MOST_ROBOTS:
        raise top.field("kinds").wrong(f"a list of 1 to {MOST_ROBOTS} robots")
    return Certificate(
        name,
        program,
        properties,
        Settings(_parameters(top.field("parameters")), _tasks(top.field("tasks"))),
        kinds,
        delta,
        tuple(_claim(part) for part in top.field("claims").items()),
        tuple(_conjunct(part) for part in top.field("invariant").items()),
        {
            part: top.field("rests_on").field(part).names()
            for part in ("assumptions", "contracts", "summaries")
        },
        _scripts(top.field("obligations")),
        tuple(
            (part.field("name").text(), part.field("reason").text())
            for part in top.field("not_covered").items()
        ),
    )


def _source(reader: _Reader) -> Source:
    return Source(reader.field("name").text(), _certified(reader, "text"))


def _certified(reader: _Reader, part: str) -> str:
    """A text that its digest is of."""
    text = reader.field(part).text()
    found = sha256(text.encode("utf-8", errors="surrogatepass")).hexdigest()
    if found != reader.field("sha256").text():
        what = f"{reader.path}.{part}"
        raise refusal(
            "K941",
            reader.file,
            f"{what} is not the text that was certified: its SHA-256 differs",
            REWRITE,
        )
    return text


def _scripts(reader: _Reader) -> tuple[Given, ...]:
    given: dict[str, Given] = {}
    for part in reader.items():
        name = part.field("name").text()
        if name in given:
            raise refusal("K941", reader.file, f"there are two obligations {name!r}", REWRITE)
        given[name] = Given(name, _certified(part, "smt2"))
    return tuple(given.values())


def _parameters(reader: _Reader) -> dict[str, ParamValue]:
    if not isinstance(reader.value, dict):
        raise reader.wrong("an object")
    return {str(name): _parameter(reader.field(str(name))) for name in reader.value}


def _parameter(reader: _Reader) -> ParamValue:
    value = reader.value
    if isinstance(value, bool | int | str):
        return value
    if isinstance(value, list):
        return tuple(_parameter(part) for part in reader.items())
    return reader.field("fraction").fraction()


def _tasks(reader: _Reader) -> tuple[tuple[Fraction, Fraction, Fraction], ...] | None:
    if reader.value is None:
        return None
    tasks = []
    for task in reader.items():
        numbers = [part.fraction() for part in task.items()]
        if len(numbers) != 3:
            raise task.wrong("a point of three numbers")
        tasks.append((numbers[0], numbers[1], numbers[2]))
    return tuple(tasks)


def _claim(reader: _Reader) -> Claimed:
    kind = reader.field("kind")
    known = {k.value: k for k in Kind}
    if kind.text() not in known:
        raise kind.wrong("one of " + ", ".join(known))
    return Claimed(
        reader.field("name").text(),
        known[kind.text()],
        reader.field("subject").text(),
        reader.field("every_number").truth(),
    )


def _conjunct(reader: _Reader) -> Conjunct:
    return Conjunct(
        reader.field("name").text(),
        reader.field("depth").number(1, _MOST_DEPTH),
        reader.field("text").text(),
        reader.field("every_number").truth(),
    )


# --- the program, with the invariant beside it ----------------------------------------------------


def opened(certificate: Certificate) -> Opened:
    """The program with the invariant. Raises KoordError, and NotRecheckedError."""
    name = certificate.name
    sources = (certificate.program, *certificate.properties)
    sections: list[ast.Section] = []
    for number, source in enumerate(sources):
        parsed = parse(source)
        _stop_at_errors(name, source.name, parsed.diagnostics)
        for section in parsed.program.sections:
            if number == 0 or isinstance(section, _OF_PROPERTIES):
                sections.append(section)
    stated = [section for section in sections if isinstance(section, ast.Invariant)]
    conjuncts = [_parsed(name, conjunct) for conjunct in certificate.invariant]
    rest = [s for s in sections if not isinstance(s, ast.Invariant | ast.Eventually | ast.LeadsTo)]
    own = [replace(s, name=ast.Ident(f"stated {k}", span=s.span)) for k, s in enumerate(stated)]
    beside = [
        replace(s, name=ast.Ident(f"conjunct {k}", span=s.span)) for k, s in enumerate(conjuncts)
    ]
    core_program = _elaborated(certificate, [*rest, *own, *beside])
    whole = _elaborated(certificate, sections)
    if any(kind >= len(core_program.agents) for kind in certificate.kinds):
        raise refusal("K940", name, "kinds names a kind of robot that the program has not")
    if _rests_on(whole) != certificate.rests_on:
        raise refusal(
            "K941", name, "rests_on does not name what the program assumes and is promised"
        )
    names = [p.name for p in whole.properties if p.kind in _INVARIANTS]
    if not certificate.claims:
        raise refusal("K941", name, "nothing is claimed")
    _check_given(certificate, World(whole, certificate.kinds, certificate.delta_s))
    return _joined(certificate, core_program, names)


def _check_given(certificate: Certificate, world: World) -> None:
    """The scripts that belong to a proof are all there."""
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


_OF_PROPERTIES = (ast.Assume, ast.Invariant, ast.FunDef, ast.ParamDecl)


def _joined(certificate: Certificate, program: core.Program, names: list[str]) -> Opened:
    """What is claimed, in terms of the program that holds the invariant as well."""
    world = World(program, certificate.kinds, certificate.delta_s)
    here = _argument(certificate, world, names, everyone=False)
    if not any(claimed.everyone for claimed in certificate.claims):
        return Opened(here, None)
    anyone = World(program, (), certificate.delta_s)
    return Opened(here, _argument(certificate, anyone, names, everyone=True))


def _argument(
    certificate: Certificate, world: World, names: list[str], *, everyone: bool
) -> Argument:
    """The claims and the invariant; ``everyone``: those for every number of robots alone."""
    name, program = certificate.name, world.program
    by_name = {p.name: p for p in program.properties}
    own = {given: by_name[f"stated {k}"] for k, given in enumerate(names)}
    conjuncts = [
        (by_name[f"conjunct {k}"], conjunct)
        for k, conjunct in enumerate(certificate.invariant)
        if conjunct.everyone or not everyone
    ]
    depths = [1 if everyone else conjunct.depth for _, conjunct in conjuncts]
    claims = [
        Claim(conjunct.name, Kind.STATEMENT, stated, depth=depth)
        for (stated, conjunct), depth in zip(conjuncts, depths, strict=True)
    ]
    kept = {(c.stated.condition, c.stated.kind) for c in claims if c.stated is not None}
    consequences = []
    for claimed in certificate.claims:
        if everyone and not claimed.everyone:
            continue
        if claimed.kind is not Kind.STATEMENT:
            _check_subject(name, program, claimed.kind, claimed.subject)
            depth = max(depths, default=1)
            claims.append(Claim(claimed.name, claimed.kind, None, claimed.subject, depth))
        elif claimed.name not in own:
            raise refusal("K941", name, f"the program states no invariant {claimed.name!r}")
        elif (own[claimed.name].condition, own[claimed.name].kind) not in kept:
            consequences.append(replace(own[claimed.name], name=claimed.name))
    return Argument(world, tuple(claims), tuple(consequences))


def _check_subject(name: str, program: core.Program, kind: Kind, subject: str) -> None:
    known = {
        Kind.LOST_UPDATE: {d.variable.name for d in program.allwrite},
        Kind.CONTRACT: {c.name for a in program.agents for m in a.modules for c in m.contracts},
    }
    if kind in known and subject not in known[kind]:
        raise refusal("K941", name, f"the program has no {subject!r} to claim a {kind.value} of")


def _parsed(name: str, conjunct: Conjunct) -> ast.Invariant:
    """The one invariant that a text holds."""
    place = f"{name}: invariant {conjunct.name}"
    parsed = parse(Source(place, conjunct.text))
    _stop_at_errors(name, place, parsed.diagnostics)
    sections = parsed.program.sections
    if len(sections) != 1 or not isinstance(sections[0], ast.Invariant):
        raise refusal("K940", name, f"the text of {conjunct.name!r} is not one invariant of Koord")
    return sections[0]


def _elaborated(certificate: Certificate, sections: list[ast.Section]) -> core.Program:
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
