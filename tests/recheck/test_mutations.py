"""Certificates and programs with a mistake in them: each is refuted or refused."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import pytest

from koord.recheck.checking import RecheckOutcome
from koord.syntax.diagnostics import KoordError
from koord.verify.certificates import digest
from tests.recheck.certificates import Document, conjunct, document_of, rechecked, with_text
from tests.sampling import first

pytest.importorskip("cvc5")

Change = Callable[[Document], object]


def _text(old: str, new: str) -> Change:
    return lambda document: with_text(document, old, new)


def _invariant(name: str, old: str, new: str) -> Change:
    def change(document: Document) -> None:
        found = conjunct(document, name)
        assert old in found["text"]
        found["text"] = found["text"].replace(old, new)

    return change


def _without(name: str) -> Change:
    def change(document: Document) -> None:
        document["invariant"].remove(conjunct(document, name))

    return change


def _script(position: int, text: str) -> Change:
    def change(document: Document) -> None:
        document["obligations"][position] |= {"smt2": text, "sha256": digest(text)}

    return change


REFUTED = {
    # an invariant that is too weak to prove itself, or says too much
    "lemma left out": ("leader_elect.krd", 2, "1/10", _without("Best")),
    "lemma weakened": (
        "leader_elect.krd",
        2,
        "1/10",
        _invariant("Informed", "!= -1 implies all(voted)", "!= -1 implies any(voted)"),
    ),
    "lemma too strong": (
        "leader_elect.krd",
        2,
        "1/10",
        _invariant("Best", "candidate >= i", "candidate > i"),
    ),
    "not true at the start": (
        "sum_of_ids.krd",
        2,
        "1/10",
        _invariant("PartialCount", "adders ==", "adders + 1 =="),
    ),
    "an interval too small": ("hvac.krd", 1, "40", _invariant("Comfort", "80", "73")),
    "claimed and not implied": (
        "lineform_1d.krd",
        2,
        "10",
        _invariant("Fence", "low <=", "low - 1 <="),
    ),
    # another program
    "no lock": ("sum_of_ids.krd", 2, "1/10", _text("atomic:", "if true:")),
    "decides too early": ("leader_elect.krd", 2, "1/10", _text("all(voted) and", "any(voted) and")),
    "starts elsewhere": ("sum_of_ids.krd", 2, "1/10", _text("int sum = 0", "int sum = 1")),
    "not urgent": ("hvac.krd", 1, "40", _text("urgent Update", "Update")),
    "another guard": ("traffic.krd", 2, "3", _text("crossing == -1 and not passed", "not passed")),
    "another model": ("hvac.krd", 1, "40", _text("float draught = 0.01", "float draught = 0.3")),
    "a contract dropped": (
        "lineform_1d.krd",
        2,
        "10",
        _text("min(psn, target) <= psn' and psn' <= max(psn, target)", "true"),
    ),
    "an assumption dropped": (
        "lineform_1d.krd",
        2,
        "10",
        _text("assume: low <= Rail.psn and Rail.psn <= high", "assume: low <= Rail.psn"),
    ),
    "reads another robot's entry": (
        "sum_of_ids.krd",
        2,
        "1/10",
        _text("pre: not added[pid]", "pre: not added[0]"),
    ),
    "stops alone": ("allstop.krd", 2, "1/10", _text("trystop()", "stop")),
    "a fault": (
        "shortest_path.krd",
        2,
        "1/10",
        _text("best = min(best, known[k] + 1)", "best = min(best, known[k + 1] + 1)"),
    ),
    # another system
    "longer rounds": (
        "hvac.krd",
        1,
        "40",
        lambda document: document.update(delta="100"),
    ),
    # a script that does not say what its name does
    "a script that can be satisfied": (
        "hvac.krd",
        1,
        "40",
        _script(0, "(declare-const x Int) (assert (> x 0)) (check-sat)"),
    ),
}


#: Those that take long, and are like others.
SLOW = {
    "lemma weakened",
    "lemma too strong",
    "not true at the start",
    "another model",
    "a contract dropped",
    "reads another robot's entry",
    "a fault",
    "an interval too small",
    "decides too early",
    "not urgent",
    "another guard",
    "an assumption dropped",
    "stops alone",
    "longer rounds",
}


@pytest.mark.parametrize(
    ("file", "robots", "delta", "change"),
    first(
        2,
        [
            pytest.param(*case, id=name, marks=[pytest.mark.slow] * (name in SLOW))
            for name, case in REFUTED.items()
        ],
    ),
)
def test_a_mistake_is_refuted(file: str, robots: int, delta: str, change: Change) -> None:
    document = document_of(file, robots, Fraction(delta))
    change(document)
    found = rechecked(document)
    assert found.outcome is RecheckOutcome.REFUTED, found.reason


def _claim_more(document: Document) -> None:
    claim = {"name": "Safe", "kind": "property", "subject": "", "every_number": False}
    document["claims"].append(claim)


def _called(name: str, kind: str, subject: str = "") -> Change:
    """The only claim of a certificate without an invariant."""

    def change(document: Document) -> None:
        claim = {"name": name, "kind": kind, "subject": subject, "every_number": True}
        document.update(claims=[claim], invariant=[])

    return change


_LEFT_OUT = {"name": "Discomfort", "reason": "it holds"}
_COMFORT = {"name": "Comfort"}

REFUSED: dict[str, tuple[str, Change]] = {
    "text without its digest": ("K941", lambda d: d["program"].update(text="local:\n    int x\n")),
    "an obligation removed": ("K941", lambda d: d["obligations"].pop(1)),
    "a claim that is nowhere stated": ("K941", _claim_more),
    "a fault called as a property": ("K941", _called("Comfort", "fault")),
    "a fault with a subject": ("K941", _called("no fault", "fault", "Comfort")),
    "a lost update of another": ("K941", _called("no lost update of c", "lost update", "d")),
    "a lost update of nothing": ("K941", _called("no lost update of c", "lost update", "c")),
    "a contract of nothing": ("K941", _called("contract X", "contract", "X")),
    "a property with a subject": ("K941", _called("Comfort", "property", "no fault")),
    "a claim made twice": ("K941", lambda d: d["claims"].append(dict(d["claims"][0]))),
    "two conjuncts of one name": ("K941", lambda d: d["invariant"].append(d["invariant"][0])),
    "a conjunct called as a claim": ("K940", lambda d: d["invariant"][0].update(name="no fault")),
    "left out, and nobody knows": ("K941", lambda d: d["not_covered"].append(_LEFT_OUT)),
    "left out, and claimed": ("K941", lambda d: d["not_covered"].append(_LEFT_OUT | _COMFORT)),
    "nothing claimed": ("K941", lambda d: d["claims"].clear()),
    "an assumption not told": ("K941", lambda d: d["rests_on"]["assumptions"].clear()),
    "a statement that is none": ("K940", _invariant("Comfort", "invariant Comfort:", "assume:")),
    "a statement with a mistake": ("K941", _invariant("Comfort", "HVAC.temp", "HVAC.heat")),
    "a program with a mistake": ("K941", _text("int switch", "in switch")),
    "a kind that there is not": ("K940", lambda d: d.update(kinds=[1])),
    "no robots": ("K940", lambda d: d.update(kinds=[])),
    "no time": ("K940", lambda d: d.update(delta="0")),
    "another version": ("K940", lambda d: d.update(version=1)),
    "another format": ("K940", lambda d: d.update(format="koord trace")),
    "no depth": ("K940", lambda d: d["invariant"][0].update(depth=0)),
}


@pytest.mark.parametrize(("code", "change"), REFUSED.values(), ids=REFUSED)
def test_damage_is_refused(code: str, change: Change) -> None:
    document = document_of("hvac.krd", 1, Fraction(40))
    change(document)
    with pytest.raises(KoordError) as error:
        rechecked(document)
    assert [d.code for d in error.value.diagnostics] == [code]


def test_a_weaker_invariant_that_proves_itself_is_confirmed() -> None:
    """What counts is what is claimed: lemmas may be others than the program's own."""
    document = document_of("hvac.krd", 1, Fraction(40))
    _invariant("Comfort", "60 <= HVAC.temp", "61 <= HVAC.temp")(document)
    assert rechecked(document).outcome is RecheckOutcome.CONFIRMED


def test_a_counterexample_is_told_in_the_words_of_the_program() -> None:
    document = document_of("leader_elect.krd", 2)
    with_text(document, "all(voted) and", "any(voted) and")
    refuted = next(one for one in rechecked(document).settled if one.answer.value == "sat")
    assert refuted.name.startswith("event Decide of robot ")
    assert any(
        line.startswith("voted@0 = ") or line.startswith("voted[0] = ") for line in refuted.state
    )
