"""Claims that a deployed run did not keep, with their text and the verdicts that rested on them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import PurePath
from textwrap import dedent

import msgspec
from msgspec import Struct, to_builtins

from koord.api.files import read_bytes
from koord.api.programs import Program
from koord.api.verdict_forms import Premise, Verdicts
from koord.runtime.deploy.watching import Breach
from koord.syntax.diagnostics import refusal
from koord.syntax.source import counted, visible


class BrokenStatement(Struct, frozen=True):
    """A claim that did not hold in a run. Rounds count from 0; -1 is INIT."""

    claim: str  #: its kind and its name
    place: str  #: file, line and column
    text: str  #: the lines of the program in which it stands
    robots: tuple[int, ...]
    round: int  #: the first
    times: int
    detail: str
    rested: tuple[str, ...] = ()  #: the claims whose proofs need it, as far as that was said

    @property
    def key(self) -> tuple[str, tuple[int, ...]]:
        """What tells statements apart."""
        return self.claim, self.robots

    def __str__(self) -> str:
        many = "robots " if len(self.robots) > 1 else "robot "
        who = f" of {many}{' and '.join(map(str, self.robots))}" if self.robots else ""
        when = "at the start" if self.round < 0 else f"in round {self.round + 1}"
        often = f", {counted(self.times, 'time')} in all" if self.times > 1 else ""
        return f"{self.claim}{who} did not hold {when}{often}"

    def to_dict(self) -> dict[str, object]:
        """The statement as plain data."""
        return dict(to_builtins(self))


class Grounds(Struct, frozen=True):
    """What proofs rest on, of a report of verdicts."""

    claims: tuple[str, ...]
    needed: tuple[Premise, ...]

    def rested_on(self, breach: Breach) -> tuple[str, ...]:
        """The claims whose proofs need a premise that was broken."""
        kind, _, name = breach.claim.partition(" ")
        for premise in self.needed:
            same_name = premise.name == name or premise.name.endswith(f".{name}")
            if (
                premise.kind.value == kind
                and same_name
                and _is_one(premise.place, str(breach.span))
            ):
                return self.claims
        return ()


def grounds_of(path: str, program: Program) -> Grounds:
    """Read what the proofs of a program rest on. Raises KoordError. (K911)"""
    name = visible(path)
    cure = "write one with `koord verify` and `rests_on=`, as JSON"
    try:
        verdicts = msgspec.json.decode(read_bytes(path), type=Verdicts)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise refusal("K911", name, f"it is no report of verdicts: {error}", cure) from None
    reports = [one for one in verdicts.reports if _name(one.program) == _name(program.name)]
    if not reports:
        raise refusal("K911", name, f"it has no report on {program.name}", cure)
    rests = [one.rests_on for one in reports if isinstance(one.rests_on, Struct)]
    if not rests:
        raise refusal("K911", name, "it does not say what proofs rest on", cure)
    claims = dict.fromkeys(claim for one in rests for claim in one.claims)
    needed = [premise for one in rests for premise in (*one.needed, *one.untried)]
    return Grounds(tuple(claims), tuple(needed))


def broken_statements(
    program: Program, breaches: Iterable[Breach], grounds: Grounds | None
) -> Iterator[BrokenStatement]:
    """What is to be told of breaches."""
    texts = {source.name: source.text.splitlines() for source in program.sources}
    for one in breaches:
        span = one.span
        text = dedent("\n".join(texts.get(span.file, [])[span.line - 1 : span.end_line]))
        rested = () if grounds is None else grounds.rested_on(one)
        yield BrokenStatement(
            one.claim, str(span), text, one.robots, one.round, one.times, one.detail, rested
        )


def _is_one(place: str, other: str) -> bool:
    """Return whether two places are one, whatever the way to the file."""
    return _name(place) == _name(other)


def _name(path: str) -> str:
    return PurePath(path).name
