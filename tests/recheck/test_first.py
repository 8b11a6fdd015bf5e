"""Certificates in which one of those who wait is the first, and nothing moves. [T-PROGRESS]"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from koord.recheck.certificate import VERSIONS
from koord.recheck.sorts import NotRecheckedError
from koord.syntax.diagnostics import KoordError
from tests.recheck.by_hand import by_hand, found, measure, unmet, way
from tests.recheck.certificates import Document
from tests.sampling import first

pytest.importorskip("cvc5")

#: Who has the smallest number goes, and of several the one with the smallest pid.
QUEUE = """
allread:
    bool[] waits = true
    int[] number = 1

def fun first(bool[] waiting, int[] numbers, int who) -> bool:
    for k = 0, numAgents:
        if waiting[k] and (numbers[k] < numbers[who] or numbers[k] == numbers[who] and k < who):
            return false
    return true

Go:
    pre: waits[pid] and first(waits, number, pid)
    eff:
        waits[pid] = false
        number[pid] = 0

eventually D: forall i: not waits[i]
"""

#: Robots draw other numbers as often as they like.
DRAWN = (
    QUEUE
    + """
Draw:
    pre: waits[pid]
    eff:
        number[pid] = 1 - number[pid]
"""
)

#: Nobody ever goes, though one can always run.
IDLE = QUEUE.replace("waits[pid] = false\n        number[pid] = 0", "waits[pid] = true")

#: Who waits without a great number waits for ever.
GREAT = QUEUE.replace("first(waits, number, pid)\n", "number[pid] > 7\n")

#: Those who wait are shown by a sensor.
SHOWN = """
using S:
    sensors:
        bool ready
local:
    bool done = false
Go:
    pre: not done and S.ready
    eff:
        done = true
eventually D: forall i: done@i
"""

#: What is no proof is asked about for so many seconds.
_BRIEFLY = 0.1

_EVERY = "invariant It: forall i: "
_WAITS = measure("waits[i]")
_GOES = way(f"{_EVERY}waits[i] and first(waits, number, i)", unmoved=True)
_FIRST = {"state": f"{_EVERY}waits[i]", "number": f"{_EVERY}0 <= number[i]"}


def queue(text: str = QUEUE, help_: Document = _GOES, first: Document | None = _FIRST) -> Document:
    """The certificate of a queue."""
    return by_hand(text, [], [_WAITS], [help_], [] if first is None else [first])


def test_who_is_the_first_goes() -> None:
    assert unmet(queue()) == ""


def test_it_is_found_and_written_down() -> None:
    document = found(QUEUE)
    (proof,) = document["progress"]
    assert [set(one) for one in proof["first"]] == [{"state", "number"}]
    assert [way_["unmoved"] for way_ in proof["help"]] == [True]
    assert unmet(document) == ""


#: Certificates that are no proofs, and the premise that fails.
UNMET: dict[str, tuple[Callable[[], Document], str]] = {
    "nobody is said to be the first": (lambda: queue(first=None), "somebody helps"),
    "the first of others": (
        lambda: queue(first={**_FIRST, "state": f"{_EVERY}not waits[i]"}),
        "somebody helps",
    ),
    "the last": (
        lambda: queue(first={**_FIRST, "number": f"{_EVERY}0 <= 0 - number[i]"}),
        "somebody helps",
    ),
    "the first helps if it has another number": (
        lambda: queue(
            help_=way(
                f"{_EVERY}waits[i] and first(waits, number, i) and number[i] > 7", unmoved=True
            )
        ),
        "somebody helps",
    ),
    "nobody is there who would be the first": (
        lambda: queue(
            GREAT,
            way(f"{_EVERY}waits[i] and number[i] > 7", unmoved=True),
            {**_FIRST, "state": f"{_EVERY}waits[i] and number[i] > 7"},
        ),
        "somebody helps",
    ),
    "numbers are drawn anew": (lambda: queue(DRAWN), "it is as it was"),
    "nothing settles": (
        lambda: by_hand(QUEUE, [], [], [_GOES], [_FIRST]),
        "it is as it was",
    ),
    "nobody goes": (lambda: queue(IDLE), "it runs nothing"),
    "nobody is ready": (
        lambda: queue(QUEUE.replace("pre: waits", "pre: number[pid] > 1 and waits")),
        "it is ready",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", first(1, [(case,) for case in UNMET.values()]), ids=[n.replace(" ", "_") for n in UNMET]
)
def test_a_premise_that_is_left_out_is_missed(case: tuple[Callable[[], Document], str]) -> None:
    made, premise = case
    assert unmet(made(), _BRIEFLY).endswith(f": {premise}")


#: Who is the first has to be a function of robots, by what stands in variables.
DAMAGED: dict[str, Callable[[], Document]] = {
    "a function": lambda: queue(first={**_FIRST, "state": f"{_EVERY}first(waits, number, i)"}),
    "a remainder": lambda: queue(first={**_FIRST, "number": f"{_EVERY}0 <= number[i] % 2"}),
    "no number": lambda: queue(first={**_FIRST, "number": f"{_EVERY}waits[i]"}),
    "of nobody": lambda: queue(first={**_FIRST, "state": "invariant It: true"}),
    "a wish": lambda: by_hand(
        SHOWN + "assume Ready: not done leadsto S.ready\n",
        [],
        [measure("not done@i")],
        [way(f"{_EVERY}not done@i", "expected", unmoved=True, assumption="Ready")],
    ),
}


@pytest.mark.parametrize("made", DAMAGED.values(), ids=[n.replace(" ", "_") for n in DAMAGED])
def test_what_is_no_order_of_robots_is_damage(made: Callable[[], Document]) -> None:
    document = made()
    with pytest.raises(KoordError) as caught:
        unmet(document)
    assert [d.code for d in caught.value.diagnostics] == ["K941"]


#: What help may read of which it is not known that it stays.
UNSEEN = {
    "a sensor": "not done@i and S.ready@i",
    "who ran": "not done@i and not ran(Go)@i",
    "who stopped": "not done@i and not stopped@i",
}


@pytest.mark.parametrize("said", UNSEEN.values(), ids=[n.replace(" ", "_") for n in UNSEEN])
def test_what_is_no_variable_may_move(said: str) -> None:
    help_ = way(f"{_EVERY}{said}", unmoved=True)
    document = by_hand(SHOWN, [], [measure("not done@i")], [help_])
    with pytest.raises(NotRecheckedError):
        unmet(document)


@pytest.mark.slow
def test_older_certificates_say_nothing_of_it() -> None:
    document = queue()
    document["version"] = VERSIONS[-2]
    assert unmet(document)
