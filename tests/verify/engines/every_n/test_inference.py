"""Invariants that nobody gave. [T-EVERY-N]"""

from __future__ import annotations

from pathlib import Path

import pytest

from koord.verify.engines.every_n.candidates import candidates
from tests.loading import program_of
from tests.sampling import first
from tests.verify.engines.every_n.asking import inferred, proved, system_of
from tests.verify.engines.every_n.test_proving import LOCK

EXAMPLES = Path(__file__).parents[4] / "specs" / "examples"


def without(text: str, *kept: str) -> str:
    """A program with these of its invariants only."""
    lines, keep = [], True
    for line in text.splitlines():
        if line.startswith("invariant "):
            keep = line.split()[1].rstrip(":") in kept
        elif line and not line.startswith(" "):
            keep = True
        if keep:
            lines.append(line)
    return "\n".join(lines) + "\n"


def names(text: str) -> set[str]:
    return {claim.name for claim in inferred(text).proved}


def test_who_holds_a_lock_is_found_out() -> None:
    text = without(LOCK, "Exclusive")
    assert proved(text) == {"no fault"}
    found = inferred(text)
    assert {claim.name for claim in found.proved} == {"Exclusive", "no fault"}
    assert [claim.name for claim in found.invariants] == ["forall i: inside@i implies holder == i"]


@pytest.mark.slow
def test_fischers_exclusion_without_lemmas() -> None:
    text = without((EXAMPLES / "fischer.krd").read_text(encoding="utf-8"), "Exclusive")
    assert "Exclusive" not in proved(text)
    found = inferred(text)
    assert {claim.name for claim in found.proved} == {"Exclusive", "no fault"}
    # They are Koord, and with them the exclusion is inductive.
    given = "".join(f"invariant L{k}: {c.name}\n" for k, c in enumerate(found.invariants))
    assert proved(text + given) >= {"Exclusive"}


@pytest.mark.slow
def test_what_does_not_hold_is_never_inferred() -> None:
    text = without((EXAMPLES / "fischer.krd").read_text(encoding="utf-8"), "Exclusive")
    unsafe = text.replace("Tk = 3.0", "Tk = 2.0").replace("Td = 2.0", "Td = 3.0")
    assert names(unsafe) == {"no fault"}


def test_candidates_are_koord() -> None:
    program = program_of(LOCK)
    texts = [claim.name for claim in candidates(program)]
    given = "".join(f"invariant C{k}: {text}\n" for k, text in enumerate(texts))
    again = program_of(LOCK + given).properties[2:]
    assert len(again) == len(texts) > 5
    likely = candidates(system_of(LOCK).program)
    for stated, claim in zip(again, likely, strict=True):
        assert claim.stated is not None
        assert stated.condition == claim.stated.condition, claim.name


#: Robots go round a list, one place after the other, from their own places or from a common one.
ROUND = """
param int[] places = [4, 7, 9]
allread:
    int[] at = 0
allwrite:
    int common = 0
local:
    int next = 0
    int seen = 0
Own:
    eff:
        seen = places[next] + places[at[pid]]
        next = (next + 1) % length(places)
        at[pid] = (at[pid] + 2) % 3
Common:
    eff:
        atomic:
            seen = places[common]
            common = (common + 1) % length(places)
"""


def test_remainders_are_smaller_than_what_is_divided_by() -> None:
    assert not proved(ROUND)
    found = inferred(ROUND)
    assert {claim.name for claim in found.proved} == {"no fault"}
    assert {claim.name for claim in found.invariants} == {
        "forall i: 0 <= next@i and next@i < 3",
        "forall i: 0 <= at[i] and at[i] < 3",
        "forall i: 0 <= common and common < 3",
    }


@pytest.mark.parametrize(
    ("old", "new"),
    first(
        1,
        [
            ("(next + 1) % length(places)", "(next + 1) % 4"),
            ("next = (next + 1)", "next = 3 + (next + 1)"),
            ("int next = 0", "int next = 3"),
            ("(at[pid] + 2) % 3", "(at[pid] + 2) % 4"),
        ],
    ),
)
def test_others_are_not(old: str, new: str) -> None:
    assert old in ROUND
    assert not names(ROUND.replace(old, new))
