"""Whatever is edited in a certificate, nothing is confirmed that is false.

What counts is what is printed: its statements, of the program in the certificate with the robots, δ
and params that are printed. Whether it is true an explicit search finds out.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from random import Random
from typing import Any

import pytest

from koord.api.recheck import RecheckReport
from koord.recheck.certificate import read
from koord.recheck.checking import recheck
from koord.syntax.core import Program
from koord.syntax.diagnostics import KoordError
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System
from koord.verify.certificates import digest
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, GoalKind
from koord.verify.engines.explicit.search import survey
from tests.recheck.certificates import Document
from tests.recheck.edits import (
    CHANGES,
    FALSE,
    altered,
    edited,
    forged,
    system_printed,
    written,
)
from tests.sampling import first

pytest.importorskip("cvc5")

#: A claim for every number of robots is looked at for so many.
EVERYONE = (1, 2, 3)


def told(document: Document) -> dict[str, Any] | None:
    """What ``koord recheck --json`` prints of a certificate; None if it is refused."""
    try:
        certificate = read(json.dumps(document).encode(), "edited.json")
        found = recheck(certificate, timeout_s=3)
    except KoordError:
        return None
    said: dict[str, Any] = json.loads(RecheckReport(certificate, found, "cvc5").to_json())
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
    found = survey(system, asked, Limits(states=20_000, rounds=12), subjects=frozenset(GoalKind))
    assert isinstance(found.end, Exhausted), found.end
    broken = {(one.claim.subject, one.claim.name) for one in found.violated}
    if asked:
        return (GoalKind.PROPERTY, wanted) not in broken
    what, _, _ = wanted.partition(":")
    match what.split():
        case ["no", "fault"]:
            return all(subject is not GoalKind.FAULT for subject, _ in broken)
        case ["no", "lost", "update", "of", name]:
            return (GoalKind.LOST_UPDATE, name) not in broken
        case ["contract", name]:
            return (GoalKind.CONTRACT, name) not in broken
    raise AssertionError(f"nobody knows what is meant by {wanted!r}")


def judged(documents: Iterable[Document]) -> Counter[str]:
    """What is said of certificates; whatever is said to be shown is true."""
    count: Counter[str] = Counter()
    for number, document in enumerate(documents):
        said = told(document)
        count["refused" if said is None else said["verdict"]] += 1
        if said is None:
            continue
        assert said["sha256"] == document["program"]["sha256"], number
        assert said["sha256"] == digest(document["program"]["text"]), number
        for claim in said["claims"]:
            if claim["shown_for"] is not None:
                assert is_true(said, claim, document), (number, claim)
                count["shown"] += 1
    return count


@pytest.mark.slow
def test_what_is_edited_is_confirmed_before() -> None:
    count = judged([written("count.krd", 1), written("switch.krd", 2)])
    assert count == Counter(confirmed=2, shown=count["shown"])


@pytest.mark.parametrize("count", first(1, [2, len(FALSE)]))
def test_what_is_false_is_not_confirmed(count: int) -> None:
    documents = [forged(*false, everyone=k == 0) for k, false in enumerate(FALSE[:count])]
    assert judged(documents)["confirmed"] <= 1  # the door lets nobody in twice


@pytest.mark.slow
@pytest.mark.parametrize("count", first(1, [2, len(CHANGES)]))
def test_what_was_shown_of_another_program_is_not_confirmed(count: int) -> None:
    assert judged(altered(*change) for change in CHANGES[:count])["refuted"] >= count // 2


@pytest.mark.slow
def test_nothing_false_is_confirmed_of_some_edits() -> None:
    count = judged(edited(Random(seed)) for seed in range(4))
    assert count["refused"] >= 1


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_nothing_false_is_confirmed_of_a_thousand_edits(block: int) -> None:
    count = judged(edited(Random(seed)) for seed in range(100 * block, 100 * block + 100))
    assert min(count["refused"], count["refuted"], count["confirmed"], count["shown"]) >= 2
