"""Certificates of examples, made as ``koord verify --certificate`` makes them, and rechecked."""

from __future__ import annotations

import copy
import json
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

from koord.recheck.certificate import read
from koord.recheck.checking import Rechecked, recheck
from koord.syntax.elaboration.settings import ParamValue, Settings
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.verify.certificates import ProvedClaims, Texts, certificate, digest
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

Document = dict[str, Any]


@cache
def _made(
    file: str,
    robots: int,
    delta: Fraction,
    params: tuple[tuple[str, ParamValue], ...],
    everyone: tuple[str, ...],
) -> str:
    source = Source(file, (EXAMPLES / file).read_text(encoding="utf-8"))
    settings = Settings(dict(params))
    program = load(source, settings).program
    assert program is not None
    system = dealt(program, robots, delta)
    shown = ProvedClaims(tuple(claim.name for claim in claims_of(system)), frozenset(everyone))
    texts = Texts(source, (), settings)
    made = certificate(system, texts, shown, Deadline.after(60), "test")
    assert made is not None
    assert made.not_covered == {}
    return json.dumps(made.document)


def document_of(
    file: str,
    robots: int,
    delta: Fraction = Fraction(1, 10),
    everyone: tuple[str, ...] = (),
    **params: ParamValue,
) -> Document:
    """The certificate of an example of which everything is inductive; a copy to be changed.

    ``everyone`` are the claims that it makes for every number of robots.
    """
    given = tuple(params.items())
    made: Document = json.loads(_made(file, robots, delta, given, everyone))
    return copy.deepcopy(made)


def rechecked(document: object) -> Rechecked:
    """The verdict on a document. Raises KoordError if it is damaged."""
    return recheck(read(json.dumps(document).encode(), "certificate.json"), timeout_s=120)


def with_text(document: Document, old: str, new: str) -> None:
    """Change the program, and make it look as if that was what was certified."""
    program = document["program"]
    assert old in program["text"]
    program["text"] = program["text"].replace(old, new)
    program["sha256"] = digest(program["text"])


def conjunct(document: Document, name: str) -> Document:
    found: Document = next(c for c in document["invariant"] if c["name"] == name)
    return found
