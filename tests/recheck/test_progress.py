"""Certificates about whole runs: confirmed, and refused belief. [T-PROGRESS]"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Collection
from fractions import Fraction
from functools import cache

import pytest

from koord.recheck.checking import RecheckOutcome
from koord.syntax.diagnostics import KoordError
from koord.syntax.elaboration.settings import Settings
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.verify.certificates import ProvedClaims, Texts, certificate
from koord.verify.claims import claims_of, liveness_of
from koord.verify.effort import Deadline
from tests.loading import PROTOCOLS, protocol_text
from tests.recheck.by_hand import by_hand, measure, unmet, way
from tests.recheck.certificates import EXAMPLES, Document, rechecked, with_text
from tests.sampling import but_slow, first

pytest.importorskip("cvc5")


def _text(name: str) -> str:
    if (PROTOCOLS / f"{name}.krd").exists():
        return protocol_text(name)
    return (EXAMPLES / f"{name}.krd").read_text(encoding="utf-8")


@cache
def _made(name: str, text: str) -> str:
    source = Source(f"{name}.krd", text)
    program = load(source, Settings({})).program
    assert program is not None
    system = dealt(program, 2, Fraction(1, 10))
    names = tuple(claim.name for claim in claims_of(system))
    shown = ProvedClaims(
        names,
        everyone=frozenset(names) if name in OPEN else frozenset(),
        of_runs=tuple(claim.name for claim in liveness_of(system)),
    )
    texts = Texts(source, (), Settings({}))
    made = certificate(system, texts, shown, Deadline.after(120), "test")
    assert made is not None
    return json.dumps(made.document)


def document_of(name: str) -> Document:
    """The certificate of a program, in which all that it claims of whole runs is proved."""
    made: Document = json.loads(_made(name, _text(name)))
    return copy.deepcopy(made)


def _ids(cases: Collection[str]) -> list[str]:
    return [name.replace(" ", "_") for name in cases]


#: Those with lemmas over ranges that no number of robots makes finite: all is for every number.
OPEN = {"ticket"}

FAST = {"lock_server", "leader_elect"}
ALL = sorted(
    {
        *FAST,
        "bakery",
        "decentralized_lock",
        "fischer_enters",
        "gate",
        "landing_pad",
        "lockserv",
        "readers_writers",
        "semaphore",
        "sum_of_ids",
        "task",
        "ticket",
        "token_ring",
    }
)


@pytest.mark.parametrize("name", first(1, but_slow(set(ALL) - FAST, ALL)))
def test_progress_of_every_number_is_confirmed(name: str) -> None:
    document = document_of(name)
    claimed = {claim["name"] for claim in document["claims"] if claim["kind"] == "liveness"}
    assert claimed == {proof["claim"] for proof in document["progress"]} != set()
    found = rechecked(document)
    assert found.outcome is RecheckOutcome.CONFIRMED, found.reason
    assert found.runs is not None
    shown = {statement.claimed.name for statement in found.shown()[0]}
    assert shown >= claimed


# --- proofs that are none -------------------------------------------------------------------------


def _order(document: Document) -> list[Document]:
    found: list[Document] = document["progress"][0]["order"]
    return found


def _ways(document: Document) -> list[Document]:
    found: list[Document] = document["progress"][0]["help"]
    return found


def _measures(document: Document) -> list[Document]:
    return [part for part in _order(document) if part["lock_class"] is None]


def _turned(part: Document, key: str) -> None:
    """Say the contrary of a text."""
    head, said = part[key].rsplit(": ", 1)
    part[key] = f"{head}: not ({said})"


def _all_gone(document: Document) -> None:
    _order(document).clear()


def _first_turned(document: Document) -> None:
    _turned(_measures(document)[0], "text")


def _first_help_gone(document: Document) -> None:
    del _ways(document)[0]


def _last_help_gone(document: Document) -> None:
    del _ways(document)[-1]


def _anyone_helps(document: Document) -> None:
    _ways(document)[0]["state"] = "invariant It: forall i: true"


def _locks_gone(document: Document) -> None:
    order = _order(document)
    order[:] = [part for part in order if part["lock_class"] is None]


def _invariant_gone(document: Document) -> None:
    document["invariant"] = []


def _nobody_leaves(document: Document) -> None:
    with_text(document, "pre: holds", "pre: holds and false")


def _nobody_votes(document: Document) -> None:
    with_text(document, "pre: not voted[pid]", "pre: not voted[pid] and pid != 0")


TAMPERED: dict[str, tuple[str, Callable[[Document], None]]] = {
    "nothing settles": ("leader_elect", _all_gone),
    "a measure turned round": ("leader_elect", _first_turned),
    "the first help gone": ("leader_elect", _first_help_gone),
    "the last help gone": ("leader_elect", _last_help_gone),
    "anyone helps": ("leader_elect", _anyone_helps),
    "somebody does not vote": ("leader_elect", _nobody_votes),
    "no lock": ("lock_server", _locks_gone),
    "no invariant": ("lock_server", _invariant_gone),
    "nobody leaves": ("lock_server", _nobody_leaves),
}


@pytest.mark.parametrize("case", first(2, ((c,) for c in TAMPERED.values())), ids=_ids(TAMPERED))
def test_what_was_tampered_with_is_not_confirmed(
    case: tuple[str, Callable[[Document], None]],
) -> None:
    name, change = case
    document = document_of(name)
    change(document)
    assert unmet(document)


# --- premises, one by one -------------------------------------------------------------------------


_LOCK: Document = {"text": "", "every_robot": False, "number": False, "lock_class": 0}

STEP = """\
local:
    bool done = false
    bool b = false
    int x = 0
    float y = 1.0

Step:
    pre: PRE
    eff:
        EFF

invariant Nat: forall i: x@i >= 0
eventually D: forall i: done@i
"""

TOGGLED = """\
allwrite:
    bool flag = false

agent Other:
    Toggle:
        pre: true
        eff: flag = not flag

agent Stepper:
    local:
        bool done = false

    One:
        pre: flag and not done
        eff: done = true

    Two:
        pre: not flag and not done
        eff: done = true

eventually D: forall Stepper i: done@i
"""

IN_VAIN = """\
allwrite:
    int n = 0

local:
    bool done = false

Try:
    pre: not done
    eff:
        atomic:
            n = 0

eventually D: done
"""

LOST = """\
local:
    bool a = true
    bool done = false

Drop:
    pre: a
    eff: a = false

eventually D: a leadsto done
"""

EXPECTED = "assume Arrives: b leadsto done\n"


def _step(pre: str, eff: str) -> str:
    return STEP.replace("PRE", pre).replace("EFF", eff)


_EVERY = "invariant It: forall i: "
_BOTH = "invariant It: forall i, me: "

#: Programs, what lasts, what settles, who helps, and the only premise that fails.
PREMISES: dict[str, tuple[str, list[str], list[Document], list[Document], str]] = {
    "runs for ever": (
        _step("not done", "done = done"),
        [],
        [],
        [way(f"{_EVERY}not done@i")],
        "it runs nothing",
    ),
    "is not ready": (
        _step("not done and b", "done = true"),
        [],
        [measure("not done@i")],
        [way(f"{_EVERY}not done@i")],
        "it is ready",
    ),
    "is lost": (
        TOGGLED,
        [],
        [
            {
                "text": "invariant It: forall Stepper i: not done@i",
                "every_robot": True,
                "number": False,
                "lock_class": None,
            }
        ],
        [
            way("invariant It: forall Stepper i: flag and not done@i"),
            way("invariant It: forall Stepper i: not flag and not done@i"),
        ],
        "it lasts",
    ),
    "falls for ever": (
        _step("not done", "x = x - 1").replace("invariant Nat: forall i: x@i >= 0\n", ""),
        [],
        [measure("x@i", number=True)],
        [way(f"{_EVERY}not done@i")],
        "it does not grow",
    ),
    "grows": (
        _step("not done", "x = x + 1"),
        [],
        [measure("x@i", number=True)],
        [way(f"{_EVERY}not done@i")],
        "it does not grow",
    ),
    "comes again": (
        _step("not done", "b = not b"),
        [],
        [measure("b@i")],
        [way(f"{_EVERY}not done@i")],
        "it falls only",
    ),
    "is no class of the order": (IN_VAIN, [], [], [], "somebody helps"),
    "is granted in vain": (IN_VAIN, [], [_LOCK], [], "it is not granted in vain"),
    "does not last": (
        LOST,
        ["invariant It: forall me: a@me"],
        [{**measure("a@i"), "text": f"{_BOTH}a@i"}],
        [way(f"{_BOTH}a@i")],
        "what lasts",
    ),
    "does not follow": (LOST, ["invariant It: forall me: false"], [], [], "what lasts"),
    "nobody": (
        _step("not done", "done = true"),
        [],
        [measure("not done@i")],
        [way(f"{_EVERY}not done@i and b@i")],
        "somebody helps",
    ),
    "no time passes": (
        _step("b and not done", "done = true"),
        [],
        [],
        [way(f"{_EVERY}not done@i and not b@i", "time", falls=f"{_EVERY}0.0 <= y@i")],
        "time passes",
    ),
    "nothing is owed": (
        _step("b and not done", "done = true") + EXPECTED,
        [],
        [measure("not done@i")],
        [way(f"{_EVERY}not done@i", "expected", assumption="Arrives")],
        "what is expected is owed",
    ),
    "what is owed is so": (
        _step("not done", "x = x + 1") + "assume Arrives: x >= 1 leadsto x >= 2\n",
        [],
        [],
        [way(f"{_EVERY}x@i >= 1", "expected", assumption="Arrives")],
        "what is expected is not so",
    ),
    "is owed after no run": (
        _step("not done", "x = x") + EXPECTED,
        [],
        [],
        [way(f"{_EVERY}not done@i", "after a run", assumption="Arrives")],
        "what is expected is owed",
    ),
}


@pytest.mark.parametrize(
    "case", first(2, [(case,) for case in PREMISES.values()]), ids=_ids(PREMISES)
)
def test_each_premise_counts(
    case: tuple[str, list[str], list[Document], list[Document], str],
) -> None:
    text, lasting, order, ways, premise = case
    assert unmet(by_hand(text, lasting, order, ways)).endswith(f": {premise}")


# --- proofs that mean nothing ---------------------------------------------------------------------


def _for_these_robots(document: Document) -> None:
    document["claims"][-1]["every_number"] = False


def _not_proved(document: Document) -> None:
    document["progress"] = []


def _not_claimed(document: Document) -> None:
    del document["claims"][-1]


def _no_such_lock(document: Document) -> None:
    _order(document)[0].update(text="", lock_class=99)


def _no_number(document: Document) -> None:
    said = {**measure("free", number=True), "text": "invariant It: forall i, me: free"}
    _order(document).append(said)


def _of_nobody(document: Document) -> None:
    _ways(document)[0]["state"] = "invariant It: free"


def _waits_for_nothing(document: Document) -> None:
    _ways(document)[0]["kind"] = "time"


def _expects_nothing(document: Document) -> None:
    _ways(document)[0]["kind"] = "expected"


def _expects_what_nobody_assumes(document: Document) -> None:
    _ways(document)[0].update(kind="expected", assumption="Arrives")


def _older(document: Document) -> None:
    document["version"] = 3


DAMAGED = {
    "for these robots": _for_these_robots,
    "not proved": _not_proved,
    "not claimed": _not_claimed,
    "no such lock": _no_such_lock,
    "no number": _no_number,
    "of nobody": _of_nobody,
    "waits for nothing": _waits_for_nothing,
    "expects nothing": _expects_nothing,
    "expects what nobody assumes": _expects_what_nobody_assumes,
    "an older version": _older,
}


@pytest.mark.parametrize("change", DAMAGED.values(), ids=_ids(DAMAGED))
def test_what_means_no_proof_is_damage(change: Callable[[Document], None]) -> None:
    document = document_of("lock_server")
    change(document)
    with pytest.raises(KoordError) as caught:
        unmet(document)
    assert [d.code for d in caught.value.diagnostics] == ["K941"]


def test_locks_are_granted_to_nobody_where_nobody_is_meant() -> None:
    document = document_of("leader_elect")
    _order(document)[0].update(text="", lock_class=0)
    with pytest.raises(KoordError, match="no robot is meant"):
        unmet(document)
