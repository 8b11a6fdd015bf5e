"""Reading of certificates: a file is not trusted before it is checked.

What it means, together with its program, is worked out in ``opening.py``.
"""

from __future__ import annotations

import json
import re
from enum import Enum
from fractions import Fraction
from hashlib import sha256
from typing import TypeVar

from msgspec import Struct

from koord.recheck.claims import ClaimKind
from koord.recheck.progress_argument import HelpKind
from koord.syntax.core import MOST_ROBOTS
from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.elaboration.settings import ParamValue, Settings
from koord.syntax.literals import MOST_PLACES
from koord.syntax.source import Source, visible

K = TypeVar("K", bound=Enum)

FORMAT = "koord certificate"

#: The versions that are read: proofs about whole runs came with the second, and what they say of
#: who is the first, and of what nothing moves, with the last.
VERSIONS = (3, 4, 5)

#: The cure for all that is wrong with a certificate.
REWRITE = "write the certificate anew with `koord verify --certificate`"

_MOST_DEPTH = 10
_MOST_CLASSES = 10_000

#: Numbers that are written have so many digits on both sides of the line at most.
_LONGEST_FRACTION = 4 * MOST_PLACES


class Conjunct(Struct, frozen=True):
    """A conjunct of the invariant: its text, and the number of rounds over which it is inductive.

    ``everyone``: it is one of those that are inductive for every number of robots.
    """

    name: str
    depth: int
    text: str
    everyone: bool = False


class Claimed(Struct, frozen=True):
    """A claim in a certificate; ``everyone``: for every number of robots."""

    name: str
    kind: ClaimKind
    subject: str
    everyone: bool


class SettlingText(Struct, frozen=True):
    """What settles in a proof of progress: a measure as an invariant, or a lock class.

    ``every_robot``: it is of each robot by itself. ``number``: it is a number, and not a statement.
    """

    text: str
    every_robot: bool
    number: bool
    lock_class: int | None


class HelpText(Struct, frozen=True):
    """A way to help, as an invariant; ``assumption`` and ``falls`` are empty if it needs none.

    ``unmoved``: it lasts as nothing that it reads changes.
    """

    kind: HelpKind
    state: str
    assumption: str
    falls: str
    unmoved: bool = False


class FirstText(Struct, frozen=True):
    """Robots of whom one is the first: a state as an invariant, and a number behind zero."""

    state: str
    number: str


class ProgressText(Struct, frozen=True):
    """A proof of a claim about whole runs, in Koord."""

    claim: str
    lasting: tuple[str, ...]
    order: tuple[SettlingText, ...]
    help: tuple[HelpText, ...]
    first: tuple[FirstText, ...] = ()


class IncludedScript(Struct, frozen=True):
    """A script of SMT-LIB that came with the certificate."""

    name: str
    smt2: str


class Certificate(Struct, frozen=True):
    """The contents of a certificate."""

    name: str
    program: Source
    properties: tuple[Source, ...]
    settings: Settings
    kinds: tuple[int, ...]
    delta_s: Fraction
    claims: tuple[Claimed, ...]
    invariant: tuple[Conjunct, ...]
    rests_on: dict[str, tuple[str, ...]]
    given: tuple[IncludedScript, ...]
    #: Claims that hold and that it is not about, with the reason: nothing is said of them.
    not_covered: tuple[tuple[str, str], ...] = ()
    progress: tuple[ProgressText, ...] = ()


# --- reading --------------------------------------------------------------------------------------


class _Reader(Struct, frozen=True):
    """A part of the document, with its path."""

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
            if len(text) > _LONGEST_FRACTION or "e" in text.lower():
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

    def kind(self, kinds: type[K]) -> K:
        known = {str(kind.value): kind for kind in kinds}
        if self.text() not in known:
            raise self.wrong("one of " + ", ".join(known))
        return known[self.text()]


def read(raw: bytes, name: str) -> Certificate:
    """Read the certificate in a file. Raises KoordError (K940, K941)."""
    try:
        document = json.loads(raw.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        story = " ".join(str(error).split())[:200]
        raise refusal("K940", name, f"not a JSON document: {story}") from None
    top = _Reader(name, "", document)
    if top.field("format").value != FORMAT:
        raise top.field("format").wrong(repr(FORMAT))
    version = top.field("version")
    if version.value not in VERSIONS:
        raise version.wrong(f"{VERSIONS[0]} to {VERSIONS[-1]}, the versions that this koord reads")
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
        _invariant(top.field("invariant")),
        {
            part: top.field("rests_on").field(part).names()
            for part in ("assumptions", "contracts", "summaries")
        },
        _scripts(top.field("obligations")),
        tuple(
            (part.field("name").text(), part.field("reason").text())
            for part in top.field("not_covered").items()
        ),
        ()
        if version.value == 3
        else _progress(top.field("progress"), version.value == VERSIONS[-1]),
    )


def _source(reader: _Reader) -> Source:
    return Source(visible(reader.field("name").text()), _certified(reader, "text"))


def _certified(reader: _Reader, part: str) -> str:
    """A text whose digest has been checked."""
    text = reader.field(part).text()
    if digest_of(text) != reader.field("sha256").text():
        what = f"{reader.path}.{part}"
        raise refusal(
            "K941",
            reader.file,
            f"{what} is not the text that was certified: its SHA-256 differs",
            REWRITE,
        )
    return text


def digest_of(text: str) -> str:
    """The SHA-256 of a text in UTF-8, in hexadecimal."""
    return sha256(text.encode("utf-8", errors="surrogatepass")).hexdigest()


def _scripts(reader: _Reader) -> tuple[IncludedScript, ...]:
    given: dict[str, IncludedScript] = {}
    for part in reader.items():
        name = part.field("name").text()
        if name in given:
            raise refusal("K941", reader.file, f"there are two obligations {name!r}", REWRITE)
        given[name] = IncludedScript(name, _certified(part, "smt2"))
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
    return Claimed(
        reader.field("name").text(),
        reader.field("kind").kind(ClaimKind),
        reader.field("subject").text(),
        reader.field("every_number").truth(),
    )


def _progress(reader: _Reader, is_new: bool) -> tuple[ProgressText, ...]:
    """The proofs about whole runs; of who is the first only new ones speak."""
    return tuple(
        ProgressText(
            part.field("claim").text(),
            part.field("lasting").names(),
            tuple(_settling(one) for one in part.field("order").items()),
            tuple(_help(one, is_new) for one in part.field("help").items()),
            tuple(_first(one) for one in part.field("first").items()) if is_new else (),
        )
        for part in reader.items()
    )


def _first(reader: _Reader) -> FirstText:
    return FirstText(reader.field("state").text(), reader.field("number").text())


def _settling(reader: _Reader) -> SettlingText:
    lock = reader.field("lock_class")
    return SettlingText(
        reader.field("text").text(),
        reader.field("every_robot").truth(),
        reader.field("number").truth(),
        None if lock.value is None else lock.number(0, _MOST_CLASSES),
    )


def _help(reader: _Reader, is_new: bool) -> HelpText:
    return HelpText(
        reader.field("kind").kind(HelpKind),
        reader.field("state").text(),
        reader.field("assumption").text(),
        reader.field("falls").text(),
        reader.field("unmoved").truth() if is_new else False,
    )


#: What a conjunct may be called: as nothing is that is asked of every program.
_WORD = re.compile(r"[^\W\d]\w*\Z")


def _invariant(reader: _Reader) -> tuple[Conjunct, ...]:
    """The conjuncts, with unique names."""
    conjuncts: dict[str, Conjunct] = {}
    for part in reader.items():
        made = _conjunct(part)
        if made.name in conjuncts:
            raise refusal("K941", reader.file, f"two conjuncts are named {made.name!r}", REWRITE)
        conjuncts[made.name] = made
    return tuple(conjuncts.values())


def _conjunct(reader: _Reader) -> Conjunct:
    name = reader.field("name")
    if not _WORD.match(name.text()):
        raise name.wrong("a name")
    return Conjunct(
        name.text(),
        reader.field("depth").number(1, _MOST_DEPTH),
        reader.field("text").text(),
        reader.field("every_number").truth(),
    )
