"""Certificates about every number of robots: confirmed, and refused belief. [T-EVERY-N]"""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import pytest

from koord.cli.main import main
from koord.recheck.checking import RecheckOutcome
from koord.syntax.elaboration.settings import Settings
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.verify.certificates import ProvedClaims, Texts, certificate
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from tests.loading import program_of
from tests.recheck.certificates import Document, conjunct, document_of, rechecked, with_text
from tests.recheck.proving import confirmed, settled_for_everyone, settled_soon
from tests.recheck.test_generated import compared
from tests.sampling import first, sampled
from tests.verify.engines.every_n import test_shared_arrays as shared_arrays
from tests.verify.engines.every_n import test_sums as sums
from tests.verify.engines.every_n.asking import system_of

pytest.importorskip("cvc5")

QUICK = [
    ("allstop.krd", 2, "1/10"),
    ("hvac.krd", 1, "40"),
    ("lineform_1d.krd", 3, "10"),
]

SLOW = [
    ("leader_elect.krd", 3, "1/10"),
    ("traffic.krd", 2, "3"),
    ("fischer.krd", 2, "1"),
    ("cars_and_drones.krd", 3, "1/10"),
    ("delivery.krd", 2, "1/10"),
    ("fischer_drift.krd", 2, "1"),
    ("follow_path.krd", 2, "1/10"),
    ("mapping.krd", 2, "1/10"),
    ("sats.krd", 2, "50"),
    ("sum_of_ids.krd", 3, "1/10"),
    ("task.krd", 2, "1/10"),
    ("waypoints.krd", 2, "50"),
]


def everyone_of(file: str, robots: int, delta: str) -> Document:
    """The certificate in which all that is claimed is claimed for every number of robots."""
    seconds = Fraction(delta)
    names = tuple(claim["name"] for claim in document_of(file, robots, seconds)["claims"])
    return document_of(file, robots, seconds, everyone=names)


def _cases() -> list[object]:
    quick = [pytest.param(*case, id=case[0]) for case in QUICK]
    return [*quick, *(pytest.param(*case, id=case[0], marks=pytest.mark.slow) for case in SLOW)]


@pytest.mark.parametrize(("file", "robots", "delta"), first(1, _cases()))
def test_a_proof_for_every_number_is_confirmed(file: str, robots: int, delta: str) -> None:
    found = rechecked(everyone_of(file, robots, delta))
    assert found.outcome is RecheckOutcome.CONFIRMED, found.reason
    assert found.everyone is not None
    assert found.here is None, "all that is claimed is shown for every number"


# --- mistakes -------------------------------------------------------------------------------------


def _changed(file: str, robots: int, delta: str, old: str, new: str) -> Document:
    document = everyone_of(file, robots, delta)
    with_text(document, old, new)
    return document


MISTAKES = {
    "another model": ("hvac.krd", 1, "40", "draught = 0.01", "draught = 0.3"),
    "starts elsewhere": ("sum_of_ids.krd", 2, "1/10", "int sum = 0", "int sum = 1"),
    "not urgent": ("hvac.krd", 1, "40", "urgent Update", "Update"),
    "an assumption dropped": ("lineform_1d.krd", 2, "10", "Rail.psn <= high\n\ninv", "true\n\ninv"),
}


@pytest.mark.parametrize("change", first(1, ((m,) for m in MISTAKES.values())), ids=MISTAKES)
def test_a_mistake_is_refuted(change: tuple[str, int, str, str, str]) -> None:
    found = rechecked(_changed(*change))
    assert found.outcome is RecheckOutcome.REFUTED, found.reason


#: A value that is left in the first round, if that begins with 0.
LEFT = """\
local:
    int x = 5

urgent Step:
    pre: x == 0
    eff: x = 1

invariant NotOne: forall i: x@i != 1
"""


@pytest.mark.slow
def test_over_two_rounds_the_first_counts() -> None:
    """From a round between two in which it holds it would go on, but it begins otherwise."""
    source, settings = Source("left.krd", LEFT), Settings({})
    system = dealt(program_of(LEFT), 2, Fraction(1, 10))
    names = tuple(claim.name for claim in claims_of(system))
    shown = ProvedClaims(names, frozenset(names))
    made = certificate(system, Texts(source, (), settings), shown, Deadline.after(60), "test")
    assert made is not None
    document = json.loads(json.dumps(made.document))
    assert conjunct(document, "NotOne")["depth"] == 2
    assert rechecked(document).outcome is RecheckOutcome.CONFIRMED
    with_text(document, "int x = 5", "int x = 0")
    assert rechecked(document).outcome is RecheckOutcome.REFUTED


SLOW_MISTAKES = {
    "another guard": ("traffic.krd", 2, "3", "crossing == -1 and not passed", "not passed"),
    "decides too early": ("leader_elect.krd", 2, "1/10", "all(voted) and", "any(voted) and"),
    "no lock": ("sum_of_ids.krd", 2, "1/10", "atomic:", "if true:"),
    "another's entry": ("sum_of_ids.krd", 2, "1/10", "not added[pid]", "not added[0]"),
    "no deadline": ("fischer.krd", 2, "1", "urgent SetAtLast", "SetAtLast"),
    "looks too early": ("fischer.krd", 2, "1", "float Tk = 3.0", "float Tk = 2.5"),
    "no reservation": ("traffic.krd", 2, "3", "crossing = pid", "crossing = 0"),
}


@pytest.mark.slow
@pytest.mark.parametrize("change", SLOW_MISTAKES.values(), ids=SLOW_MISTAKES)
def test_a_deeper_mistake_is_not_confirmed(change: tuple[str, int, str, str, str]) -> None:
    found = rechecked(_changed(*change))
    assert found.outcome is not RecheckOutcome.CONFIRMED


@pytest.mark.slow
def test_what_holds_for_some_numbers_is_refuted_for_every_number() -> None:
    """A certificate that says more than was shown: two robots are not any number of them."""
    document = document_of("leader_elect.krd", 2)
    highest = conjunct(document, "Highest")
    highest["text"] = highest["text"].replace("numAgents - 1", "1")
    with_text(document, "leader@i == numAgents - 1", "leader@i == 1")
    assert rechecked(document).outcome is RecheckOutcome.CONFIRMED
    for part in (*document["claims"], *document["invariant"]):
        part["every_number"] = True
    found = rechecked(document)
    assert found.outcome is RecheckOutcome.REFUTED
    assert found.reason.startswith("with 1 robot, ")


@pytest.mark.slow
def test_claims_for_every_number_need_their_own_invariant() -> None:
    """What is inductive for the robots here is not supposed of any number of them."""
    document = everyone_of("leader_elect.krd", 2, "1/10")
    for name in ("Best", "Real", "Informed"):
        conjunct(document, name)["every_number"] = False
    found = rechecked(document)
    assert found.everyone is not None
    assert found.everyone.outcome is not RecheckOutcome.CONFIRMED


# --- invariants that were found -------------------------------------------------------------------

BARE = """\
enum Phase: out, inside

allwrite:
    int holder = -1

local:
    Phase phase = out

Enter:
    pre: phase == out and holder == -1
    eff:
        atomic:
            holder = pid
            phase = inside

Leave:
    pre: phase == inside
    eff:
        atomic:
            holder = -1
            phase = out

invariant Exclusive: forall i, j: i != j implies not (phase@i == inside and phase@j == inside)
"""


def with_found(folder: Path) -> tuple[Document, list[Document]]:
    """A certificate, and the conjuncts in it that were found."""
    program, path = folder / "bare.krd", folder / "proof.json"
    program.write_text(BARE)
    arguments = ["verify", str(program), "--robots", "2", "--certificate", str(path)]
    assert main(arguments) == 0
    document = json.loads(path.read_text())
    return document, [c for c in document["invariant"] if c["name"].startswith("Found")]


def test_found_invariants_are_in_the_certificate(tmp_path: Path) -> None:
    document, found = with_found(tmp_path)
    assert found
    assert not any(claim["name"].startswith("Found") for claim in document["claims"])
    said = rechecked(document)
    assert said.outcome is RecheckOutcome.CONFIRMED, said.reason
    assert said.everyone is not None


@pytest.mark.slow
def test_without_found_invariants_it_is_not_confirmed(tmp_path: Path) -> None:
    document, found = with_found(tmp_path)
    document["invariant"] = [c for c in document["invariant"] if c not in found]
    assert rechecked(document).outcome is not RecheckOutcome.CONFIRMED


# --- against a search -----------------------------------------------------------------------------


@pytest.mark.parametrize("last", sampled(5, [20]))
def test_nothing_is_confirmed_for_every_number_that_a_search_breaks(last: int) -> None:
    count = compared(0, last, settled_for_everyone)
    assert count["systems"] >= last // 4
    assert count["broken"] >= last // 4
    assert count["confirmed"] >= last // 2


@pytest.mark.slow
@pytest.mark.parametrize("block", range(6))
def test_nothing_is_confirmed_that_a_search_breaks_in_many(block: int) -> None:
    assert compared(20 + 300 * block, 320 + 300 * block, settled_for_everyone)["systems"] >= 50


# --- what is not so for any number ---------------------------------------------------------------

NOT_SO = {
    "a flag that a trip clears": """\
allread:
    bool[] up = false

def fun none(bool[] x) -> bool:
    bool clear = true
    for k = 0, numAgents:
        if x[k]:
            clear = false
    return clear

Raise:
    eff:
        up[pid] = true

invariant Wrong: none(up)
""",
    "a sum that goes the other way": """\
allwrite:
    int sum = 0

allread:
    bool[] added = false

def fun sumOf(bool[] who) -> int:
    int total = 0
    for k = 0, numAgents:
        if who[k]:
            total = total + 2 * k
    return total

Add:
    pre: not added[pid]
    eff:
        atomic:
            sum = sum - 2 * pid
            added[pid] = true

invariant Wrong: sum == sumOf(added)
""",
    "a write in a race": """\
allwrite:
    int x = 0

Write:
    eff:
        x = pid + 1

invariant Wrong at round: x == 0
""",
    "a skip that nothing forbids": """\
using Watch:
    sensors:
        int t = 0
    environment:
        t = t + 1

local:
    bool go = false
    bool done = false

urgent Act:
    pre: go
    eff:
        done = true

invariant Wrong at round: forall i: t@i == 0 or done@i
""",
    "a number of robots": """\
allread:
    int[] x = 0

Step:
    eff:
        x[pid] = pid

assume: forall i: x[i] == 0

invariant Wrong: forall i: x[i] <= 1
""",
    "a robot of another number": """\
allread:
    int[] x = 0

Step:
    pre: pid > 0
    eff:
        x[pid] = x[pid - 1] + 1

invariant Wrong: forall i: x[i] <= 2
""",
}


def _texts() -> list[object]:
    """Without a proof all names are tried, which takes its time where there are sums."""
    slow = ("a sum that goes the other way", "a robot of another number")
    return [
        pytest.param(text, id=name, marks=[pytest.mark.slow] if name in slow else [])
        for name, text in NOT_SO.items()
    ]


@pytest.mark.parametrize("text", _texts())
def test_what_is_not_so_is_not_confirmed(text: str) -> None:
    program = program_of(text)
    names = confirmed(dealt(program, 2, Fraction(1, 10)), settled_for_everyone)
    assert names is not None
    assert "Wrong" not in names
    assert "no fault" in names


# --- elements that any robot may write ------------------------------------------------------------


@pytest.mark.slow
def test_an_element_that_robots_race_for_is_as_one_of_them_left_it() -> None:
    found = confirmed(system_of(shared_arrays.RACE), settled_for_everyone)
    assert found == {"Somebody", "Own", "no fault"}


@pytest.mark.slow
def test_a_token_in_a_ring_is_shown_again() -> None:
    token = shared_arrays.TOKEN
    names = {"Exclusive", "Alone", "OnlyOne", "Mine", "no fault"}
    assert confirmed(system_of(token), settled_for_everyone) == names
    stays = token.replace("      holds = false\n", "      holds = holds\n")
    assert confirmed(system_of(stays), settled_for_everyone) == {"no fault"}


@pytest.mark.slow
@pytest.mark.parametrize("block", range(4))
def test_what_is_shown_again_of_shared_arrays_is_refuted_for_none(block: int) -> None:
    shown = 0
    for seed in range(2 * block, 2 * block + 2):
        text = shared_arrays.generated(seed)
        names = confirmed(system_of(text), settled_soon)
        assert names is not None
        shown += len(names)
        for robots in (1, 2, 3):
            bad, _ = shared_arrays.seen(text, robots)
            assert not bad & names, (seed, robots)
    assert shown >= 1


# --- sums that are asked of any robot -------------------------------------------------------------


@pytest.mark.slow
def test_votes_for_two_robots_are_no_more_than_robots() -> None:
    found = confirmed(system_of(sums.ELECTION), settled_for_everyone)
    assert found == {"Seen", "One", "no fault"}


WRONG_SUMS = [
    (sums.APART.replace("<= numAgents", "< numAgents"), "Both"),
    (sums.ROOM.replace("      n = n + 1", "      n = n + 1\n    else:\n      n = n - 1"), "Mine"),
    (sums.ELECTION.replace("> numAgents", ">= numAgents"), "One"),
    (sums.ELECTION.replace("n = n + 1", "n = n + 2"), "One"),
    (sums.ROOM.replace("many(inside) <= many(near)", "many(near) <= many(inside)"), "Fewer"),
    (sums.ROOM.replace("many(near) >= 1", "many(near) >= 2"), "Mine"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("text", "wrong"), WRONG_SUMS)
def test_sums_whose_parts_are_not_so_are_not_confirmed(text: str, wrong: str) -> None:
    found = confirmed(system_of(text), settled_soon)
    assert found is not None
    assert wrong not in found
    assert "no fault" in found
