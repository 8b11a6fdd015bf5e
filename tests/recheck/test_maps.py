"""Certificates of programs with maps: of any size, with any keys."""

from __future__ import annotations

import pytest

from koord.recheck import maps, terms
from koord.recheck.checking import RecheckOutcome
from koord.recheck.sorts import Sorts
from koord.recheck.terms import Terms
from koord.syntax.types import BOOL, INT, MapType
from koord.verify.engine_names import Engine
from tests.recheck.certificates import rechecked, with_text
from tests.recheck.test_found import made
from tests.sampling import first

pytest.importorskip("cvc5")

LOCKERS = """
def Locker:
    int owner = -1
    bool open = false

allwrite:
    Map<int, Locker> lockers = {}
    Map<int, int> visits = {1: 0}
local:
    int mine = -1

Take:
    pre: mine == -1
    eff:
        atomic:
            if not contains(lockers, pid + 10):
                lockers[pid + 10] = Locker(pid, true)
                mine = pid + 10
Close:
    pre: mine != -1
    eff:
        atomic:
            lockers[mine].open = false
Free:
    pre: mine != -1
    eff:
        atomic:
            lockers.remove(mine)
            mine = -1

invariant Here: forall i: mine@i == -1 or mine@i == i + 10
invariant Owner:
    forall i: mine@i != -1
        implies contains(lockers, mine@i) and lockers[mine@i].owner == i
invariant Visits: visits == {1: 0} and length(visits) == 1
"""

KINDS = (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("choice", first(1, [Engine.BITS, None]), ids=["bits", "auto"])
def test_claims_about_maps_are_confirmed(choice: Engine | None) -> None:
    document = made(LOCKERS, KINDS, choice)
    assert [c["name"] for c in document["claims"]] == ["Here", "Owner", "Visits", "no fault"]
    assert rechecked(document).outcome is RecheckOutcome.CONFIRMED


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new"),
    first(
        1,
        [
            ("lockers.remove(mine)", "lockers.remove(mine + 1)"),
            ("lockers[mine].open = false", "lockers[mine].owner = 0"),
            ("lockers[mine].open = false", "visits[2] = 0"),
            ("Locker(pid, true)", "Locker(0, true)"),
            ("lockers[mine].open = false", "lockers[10] = Locker(1, false)"),
            ("            mine = -1\n", "            pass\n"),
            ("visits == {1: 0}", "visits == {2: 0}"),
        ],
    ),
)
def test_what_another_program_does_to_maps_is_refuted(old: str, new: str) -> None:
    document = made(LOCKERS, KINDS)
    with_text(document, old, new)
    found = rechecked(document)
    assert found.outcome is RecheckOutcome.REFUTED, found.reason


RACED = """
allwrite:
    Map<int, int> m = {1: 0}
local:
    int n = 0
Step:
    pre: n < 2
    eff: n = n + 1

invariant Kept at round: m[1] == 0
"""


def test_a_map_that_several_robots_write_is_not_as_it_was() -> None:
    document = made(RACED, KINDS)
    assert rechecked(document).outcome is RecheckOutcome.CONFIRMED
    with_text(document, "eff: n = n + 1", "eff: m[1] = n + 1")
    assert rechecked(document).outcome is RecheckOutcome.REFUTED


def test_the_order_of_keys_is_not_rechecked() -> None:
    document = made(LOCKERS, KINDS)
    with_text(
        document,
        "        atomic:\n            lockers[mine].open = false\n",
        "        for k, v in visits: mine = mine\n",
    )
    found = rechecked(document)
    assert found.outcome is RecheckOutcome.UNKNOWN
    assert found.reason.startswith("going through a map")
    assert found.span.line > 0


def test_entries_under_different_keys_lose_nothing() -> None:
    """Robots add them in one round, with values computed from the map. [LOST-UPDATE]"""
    text = """
allwrite:
    Map<int, int> came = {}
local:
    bool here = false

Come:
    pre: not here
    eff:
        came[pid] = length(came)
        here = true

invariant Noted: forall i: here@i implies contains(came, i)
"""
    document = made(text, KINDS, None)
    assert "no lost update of came" in [c["name"] for c in document["claims"]]
    assert rechecked(document).outcome is RecheckOutcome.CONFIRMED


MERGED = """
def fun isWall(int cell) -> bool: extern

def fun look(int place) -> Map<int, bool>: extern
    ensures: forall c in 0, 1: contains(result, c) implies result[c] == isWall(c)

def fun both(Map<int, bool> old, Map<int, bool> new) -> Map<int, bool>:
    Map<int, bool> all = old
    for cell, occupied in new:
        all[cell] = occupied
    return all

allwrite:
    Map<int, bool> known = {}
local:
    Map<int, bool> seen = {}

Look:
    pre: true
    eff:
        seen = look(pid)
        atomic:
            known = both(known, seen)

invariant Right: forall c in 0, 1: contains(known, c) implies known[c] == isWall(c)
invariant Kept:
    forall i: forall c in 0, 2:
        ran(Look)@i and contains(seen@i, c)
            implies contains(known, c) and known[c] == seen@i[c]
"""


@pytest.mark.parametrize(
    ("old", "new", "outcome"),
    [
        ("", "", RecheckOutcome.CONFIRMED),
        pytest.param("in new:", "in old:", RecheckOutcome.REFUTED, marks=pytest.mark.slow),
        ("all = old", "all = new", RecheckOutcome.CONFIRMED),
        pytest.param(
            "both(known, seen)",
            "both(seen, known)",
            RecheckOutcome.REFUTED,
            marks=pytest.mark.slow,
        ),
        pytest.param("return all", "return old", RecheckOutcome.REFUTED, marks=pytest.mark.slow),
        pytest.param(
            "== isWall(c)\n\ndef",
            "!= isWall(c)\n\ndef",
            RecheckOutcome.REFUTED,
            marks=pytest.mark.slow,
        ),
        ("all[cell] = occupied", "all[cell] = not occupied", RecheckOutcome.UNKNOWN),
        (
            "    for cell, occupied in new:\n        all[cell] = occupied\n",
            "    bool no = false\n    for cell, occupied in new:\n        all[cell] = no\n",
            RecheckOutcome.UNKNOWN,
        ),
    ],
)
def test_maps_of_external_functions_are_merged(old: str, new: str, outcome: RecheckOutcome) -> None:
    """[S-FOREACH] [EXTERNAL]"""
    document = made(MERGED, KINDS, None)
    with_text(document, old, new)
    found = rechecked(document)
    assert found.outcome is outcome, found.reason


#: What the summary says is so of all maps. Of an array with an entry, and no keys, it cannot be.
ASKED = """
def fun holds(Map<int, bool> m) -> bool: extern
    ensures: result == contains(m, 0) and (result implies length(m) > 0)

allwrite:
    Map<int, bool> m = {}
    int n = 0

Ask:
    pre: true
    eff:
        atomic:
            m[pid + 1] = true
            if not holds(m):
                n = 1

invariant Never: n == 0 or n == 1
"""


def test_what_is_supposed_of_all_maps_is_not_supposed_of_what_is_none() -> None:
    """[EXTERNAL]"""
    document = made(ASKED, KINDS, None)
    assert rechecked(document).outcome is RecheckOutcome.CONFIRMED
    with_text(document, "n = 1\n", "n = 2\n")
    assert rechecked(document).outcome is RecheckOutcome.REFUTED


def test_a_chain_of_maps_that_may_be_merged_is_looked_into_once_a_link() -> None:
    """What is behind a choice is the same on both sides."""
    type_ = MapType(INT, BOOL)
    v = Sorts(Terms(), 1)
    map_ = v.t.symbol("m", v.sort(type_))
    for link in range(60):
        other = v.t.symbol(f"m{link}", v.sort(type_))
        merged = maps.overwritten(v, map_, other, type_)
        map_ = v.t.ite(v.t.symbol(f"c{link}", terms.BOOL), merged, map_)
    asked = maps.has(v, map_, v.t.integer(0), type_)
    assert len(list(terms.subterms([asked]))) < 60 * 12
