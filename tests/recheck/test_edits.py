"""Whatever is edited in a certificate, nothing is confirmed that is false.

What counts is what is printed: its statements, of the program in the certificate with the robots, δ
and params that are printed. Whether it is true an explicit search finds out.
"""

from __future__ import annotations

import json
from collections import Counter
from random import Random
from typing import Any

import pytest

from koord.cli.recheck import _as_json
from koord.recheck.certificate import read
from koord.recheck.checking import recheck
from koord.semantics.configurations import System
from koord.semantics.search.engine import survey
from koord.semantics.search.findings import Exhausted, Subject
from koord.semantics.search.limits import Limits
from koord.syntax.core import Program
from koord.syntax.diagnostics import KoordError
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.verify.certificates import digest
from tests.recheck.certificates import Document
from tests.recheck.edits import edited, pool, system_printed

pytest.importorskip("cvc5")

#: A claim for every number of robots is looked at for so many.
EVERYONE = (1, 2, 3)


def told(document: Document) -> dict[str, Any] | None:
    """What ``koord recheck --json`` prints of a certificate; None if it is refused."""
    try:
        certificate = read(json.dumps(document).encode(), "edited.json")
        found = recheck(certificate, timeout_s=5)
    except KoordError:
        return None
    said: dict[str, Any] = json.loads(json.dumps(_as_json(certificate, found, "cvc5")))
    return said


def is_true(said: dict[str, Any], claim: dict[str, Any], document: Document) -> bool:
    """Whether what is printed of a claim holds, as the search says."""
    params, delta_s, kinds = system_printed(said)
    fleets = [(0,) * n for n in EVERYONE] if claim["shown_for"].startswith("every") else [kinds]
    text = document["program"]["text"]
    files = [Source(f"{k}.krd", p["text"]) for k, p in enumerate(document["properties"])]
    wanted = claim["statement"].splitlines()[0]
    if claim["kind"] == "property":
        files.append(Source("printed.krd", claim["statement"].replace(claim["name"], "Printed", 1)))
        wanted = "Printed"
    program = load(Source("program.krd", text), params, tuple(files)).program
    assert program is not None, claim
    return all(_holds(System(program, fleet, delta_s), program, wanted) for fleet in fleets)


def _holds(system: System, program: Program, wanted: str) -> bool:
    asked = [p for p in program.properties if p.name == wanted]
    found = survey(system, asked, Limits(states=20_000, rounds=12), subjects=frozenset(Subject))
    assert isinstance(found.end, Exhausted), found.end
    broken = {(one.claim.subject, one.claim.name) for one in found.violated}
    if asked:
        return (Subject.PROPERTY, wanted) not in broken
    what, _, _ = wanted.partition(":")
    match what.split():
        case ["no", "fault"]:
            return all(subject is not Subject.FAULT for subject, _ in broken)
        case ["no", "lost", "update", "of", name]:
            return (Subject.LOST_UPDATE, name) not in broken
        case ["contract", name]:
            return (Subject.CONTRACT, name) not in broken
    raise AssertionError(f"nobody knows what is meant by {wanted!r}")


def judged(first: int, last: int) -> Counter[str]:
    count: Counter[str] = Counter()
    for seed in range(first, last):
        document = edited(Random(seed))
        said = told(document)
        count["refused" if said is None else said["verdict"]] += 1
        if said is not None:
            assert said["sha256"] == document["program"]["sha256"], seed
            assert said["sha256"] == digest(document["program"]["text"]), seed
        for claim in () if said is None else said["claims"]:
            if claim["shown_for"] is not None:
                assert is_true(said or {}, claim, document), (seed, claim)
                count["shown"] += 1
    return count


def test_the_certificates_that_are_edited_are_confirmed_and_true() -> None:
    for document in pool()[1:4:2]:
        said = told(document)
        assert said is not None
        assert said["verdict"] == "confirmed"
        assert all(is_true(said, claim, document) for claim in said["claims"])


def test_nothing_false_is_confirmed_of_some_edits() -> None:
    count = judged(0, 30)
    assert count["refused"] >= 10
    assert count["shown"] >= 5


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_nothing_false_is_confirmed_of_a_thousand_edits(block: int) -> None:
    count = judged(100 * block, 100 * block + 100)
    assert min(count["refused"], count["refuted"], count["confirmed"], count["shown"]) >= 5
