"""The protocol is safe for every number of robots, and the proof of that can fail."""

from __future__ import annotations

from itertools import combinations

import pytest
from msgspec.structs import replace

from koord.refinement.protocol_proof import proving
from koord.refinement.protocol_proof.invariant import CLAIMS, GUIDES, INVARIANT, Guide
from koord.refinement.protocol_proof.logic import Action, Relation, relations
from koord.refinement.protocol_proof.model import (
    ACTIONS,
    AXIOMS,
    START,
    acknowledged,
    among,
    chosen,
    decides,
    earlier,
    left,
    majority,
    no_longer,
    on_roster,
    prefix,
    reached,
)
from koord.refinement.protocol_proof.proving import Prover, majorities_meet
from koord.refinement.protocol_proof.steps import Answer
from koord.runtime.protocol.setup import Setup, Timing

BY_NAME = {one.name: one for one in (START, *ACTIONS)}
GOALS = {one.name: one for one in INVARIANT}
HEART = "a coordinator holds what may be chosen"


def test_every_step_of_the_proof_is_proved() -> None:
    steps = list(Prover().steps())
    assert [step for step in steps if step.answer is not Answer.PROVED] == []
    assert len(steps) == 1 + len(INVARIANT) * (1 + len(ACTIONS)) + len(CLAIMS)


def test_the_claims_are_invariants_of_the_specification() -> None:
    assert {"I-AGREE", "I-ONE-ENTRY", "I-ACT", "I-LASTING"} <= {one.name for one in CLAIMS}


def without(action: str, *about: Relation, place: int = 0) -> Action:
    """An action without a guard: of those that are about exactly these relations, one."""
    one = BY_NAME[action]
    found = [n for n, guard in enumerate(one.guard) if set(relations(guard)) == set(about)]
    n = found[place]
    return replace(one, guard=one.guard[:n] + one.guard[n + 1 :])


@pytest.mark.parametrize(
    ("action", "statement"),
    [
        pytest.param(
            without("vote", acknowledged, reached),
            "a vote knew of what was acknowledged",
            id="votes look at no position",
        ),
        pytest.param(
            without("accept", left),
            "a vote knew of what was acknowledged",
            id="a promise is not kept",
        ),
        pytest.param(
            without("decide", decides, prefix),
            "their decisions are one history",
            id="a coordinator decides twice in an epoch",
        ),
        pytest.param(
            without("decide", earlier, chosen),
            "rounds before were chosen",
            id="a round is decided before the last one is",
        ),
        pytest.param(
            without("decide", on_roster),
            "their decisions are one history",
            id="a robot goes on when another has its pid",
        ),
        pytest.param(
            without("take office", majority, place=0),
            HEART,
            id="votes of incarnations count that do not",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            without("take office", majority, place=1),
            HEART,
            id="who is about to be admitted counts in an election",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            without("take office", reached, no_longer, earlier),
            HEART,
            id="a candidate forgets what it said it holds",
        ),
        pytest.param(
            without("choose", among, acknowledged),
            "a majority acknowledged it",
            id="acknowledgements are not waited for",
        ),
    ],
)
def test_a_mistake_in_an_action_is_found(action: Action, statement: str) -> None:
    step = Prover(20.0).kept(action, GOALS[statement])
    assert step.answer is Answer.REFUTED
    assert (step.action, step.statement) == (action.name, statement)
    assert any(fact.startswith("earlier: ") for fact in step.counterexample)


@pytest.mark.parametrize(
    ("axiom", "action", "statement"),
    [
        pytest.param("majorities meet", "take office", HEART, id="majorities need not meet"),
        pytest.param(
            "counted by the roster before",
            "decide",
            HEART,
            id="acknowledgements of incarnations count that do not",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "none comes back",
            "take office",
            "two coordinators of an epoch",
            id="an incarnation counts again",
        ),
        pytest.param(
            "an epoch has one owner",
            "take office",
            "two coordinators of an epoch",
            id="two robots stand for an epoch",
        ),
    ],
)
def test_an_axiom_is_needed(
    axiom: str, action: str, statement: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(proving, "AXIOMS", tuple(one for one in AXIOMS if one.name != axiom))
    prover = Prover(20.0)
    steps = [prover.kept(BY_NAME[action], GOALS[statement]), *map(prover.follows, CLAIMS)]
    assert any(step.answer is Answer.REFUTED for step in steps)


def test_no_statement_is_taken_for_granted_by_its_own_proof() -> None:
    """What a step uses of the state *after* its action is proved of that action without it."""
    names = {*GOALS, *(one.name for one in CLAIMS)}
    parts = {one.name: set(GUIDES.get(("", one.name), Guide()).only) for one in CLAIMS}
    for one in CLAIMS:
        guide = GUIDES.get(("", one.name), Guide())
        parts[one.name] |= set(guide.claims) | (set() if guide.only else set(GOALS))

    def needs(action: str, name: str, above: tuple[str, ...]) -> None:
        assert name in names
        assert name not in above, (action, *above, name)
        guide = GUIDES.get((action, name), Guide())
        of_it = parts.get(name, guide.after)
        for other in of_it:
            needs(action, other, (*above, name))

    for action in BY_NAME:
        for name in GOALS:
            needs(action, name, ())


def test_a_claim_is_proved_from_those_before_it() -> None:
    order = [one.name for one in CLAIMS]
    for place, name in enumerate(order):
        assert set(GUIDES.get(("", name), Guide()).claims) <= set(order[:place])


def test_majorities_meet_in_numbers() -> None:
    assert majorities_meet().answer is Answer.PROVED


@pytest.mark.parametrize("robots", range(1, 9))
def test_majorities_meet_as_sets(robots: int) -> None:
    """Two sets of as many robots as the protocol asks for have one in common."""
    least = Setup(robots, Timing.zero()).majority
    sets = [set(one) for one in combinations(range(robots), least)]
    assert all(one & other for one in sets for other in sets)
