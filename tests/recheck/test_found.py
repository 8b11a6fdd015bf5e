"""Certificates of claims that IC3 proved: they rest on its invariant, and on nothing else."""

from __future__ import annotations

import json
from functools import cache

import pytest

from koord.recheck.checking import RecheckOutcome
from koord.syntax.diagnostics import KoordError
from koord.syntax.elaboration.settings import Settings
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System
from koord.verify.certificates import Texts, certificate, shown_by
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.bits.abc import installed
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds
from tests.recheck.certificates import Document, rechecked, with_text
from tests.sampling import but_slow, first
from tests.verify.engines.bits.test_invariants import (
    ASKS,
    KINDS,
    PORTS,
    STOPS,
    TOKEN,
    UNSET,
    URGENT,
    alone,
)

pytest.importorskip("cvc5")


@cache
def _made(text: str, kinds: tuple[int, ...], choice: Engine | None) -> str:
    source, settings = Source("test.krd", text), Settings({})
    program = load(source, settings).program
    assert program is not None
    system = System(program, kinds)
    shown = shown_by(verify(system, Bounds(3), choice))
    made = certificate(system, Texts(source, (), settings), shown, Deadline.after(60), "test")
    assert made is not None
    assert made.not_covered == {}
    return json.dumps(made.document)


def made(
    text: str, kinds: tuple[int, ...] = (0, 0, 0), choice: Engine | None = Engine.BITS
) -> Document:
    """A certificate as ``koord verify --engine bits --certificate`` writes it; a copy."""
    return dict(json.loads(_made(text, kinds, choice)))


def task() -> Document:
    return made(alone("task.krd", "Exclusive"))


def conjunct(document: Document, part: str) -> Document:
    """The one conjunct with a text in it."""
    found: list[Document] = [c for c in document["invariant"] if part in c["text"]]
    assert len(found) == 1
    return found[0]


def outcome(document: Document) -> RecheckOutcome:
    return rechecked(document).outcome


@pytest.mark.slow
def test_the_assignment_of_tasks_is_confirmed_by_what_was_found() -> None:
    document = task()
    assert [claim["name"] for claim in document["claims"]] == ["Exclusive", "no fault"]
    assert conjunct(document, "mine@i == k implies list[k].assigned")
    assert outcome(document) is RecheckOutcome.CONFIRMED


@pytest.mark.parametrize(
    ("text", "kinds"),
    first(
        1,
        but_slow(
            [KINDS, PORTS, URGENT, alone("delivery.krd", "Once"), alone("sum_of_ids.krd", "Total")],
            [
                (KINDS, (0, 0, 1)),
                (TOKEN, (0, 0, 0)),
                (UNSET, (0, 0)),
                (URGENT, (0, 0)),
                (PORTS, (0, 0)),
                (STOPS, (0, 0)),
                (alone("delivery.krd", "Once"), (0, 0)),
                (alone("sum_of_ids.krd", "Total"), (0, 0, 0)),
            ],
        ),
    ),
    ids=["kinds", "token", "unset", "urgent", "ports", "stops", "delivery", "sum"],
)
def test_what_ic3_finds_is_confirmed(text: str, kinds: tuple[int, ...]) -> None:
    assert outcome(made(text, kinds)) is RecheckOutcome.CONFIRMED


@pytest.mark.slow
@pytest.mark.skipif(installed() is None, reason="needs abc")
def test_what_abc_finds_is_confirmed() -> None:
    assert (
        outcome(made(alone("task.krd", "Exclusive"), choice=Engine.ABC)) is RecheckOutcome.CONFIRMED
    )


@pytest.mark.slow
def test_without_one_of_its_parts_it_is_refuted() -> None:
    document = task()
    document["invariant"].remove(conjunct(document, "list[k].assigned"))
    assert outcome(document) is RecheckOutcome.REFUTED


@pytest.mark.parametrize(
    ("text", "part", "old", "new"),
    first(
        2,
        [
            (alone("task.krd", "Exclusive"), "list[k]", "mine@i == k", "mine@i <= k"),
            (TOKEN, "holder <= 2", "holder <= 2", "holder <= 1"),
            (alone("task.krd", "Exclusive"), "-1 <= mine@i", "-1 <= mine@i", "0 <= mine@i"),
            (alone("task.krd", "Exclusive"), "list[k]", "list[k]", "not list[k]"),
            (TOKEN, "at@2 == inside", "at@2 == inside", "at@2 != outside"),
        ],
    ),
    ids=["tasks", "token", "none", "unassigned", "inside"],
)
def test_with_a_part_that_says_more_it_is_refuted(text: str, part: str, old: str, new: str) -> None:
    document = made(text)
    found = conjunct(document, part)
    assert old in found["text"]
    found["text"] = found["text"].replace(old, new)
    assert outcome(document) is RecheckOutcome.REFUTED


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new"),
    first(
        1,
        [
            ("assign(list[i], pid)", "pass"),
            ("if not list[i].assigned and not isOnTask", "if not isOnTask"),
            ("else: atomic:", "else:"),
        ],
    ),
)
def test_of_another_program_it_is_refuted(old: str, new: str) -> None:
    document = task()
    with_text(document, old, new)
    assert outcome(document) is not RecheckOutcome.CONFIRMED


def test_a_program_that_is_not_the_one_that_was_certified_is_refused() -> None:
    document = task()
    document["program"]["text"] = document["program"]["text"].replace("stop", "pass")
    with pytest.raises(KoordError):
        rechecked(document)


def test_what_cannot_be_said_is_not_covered_with_its_reason() -> None:
    source = Source("asks.krd", ASKS)
    program = load(source, Settings({})).program
    assert program is not None
    system = System(program, (0, 0))
    shown = shown_by(verify(system, Bounds(3), Engine.BITS))
    found = certificate(system, Texts(source, (), Settings({})), shown, Deadline.after(60), "test")
    assert found is not None
    assert found.not_covered == {
        "Ready": "its invariant is not said in Koord: it is about who asked to stop"
    }
