"""SPIN on generated finite programs against the explicit search: the first round of each violation.

Compared are properties, faults and the contracts of models, through some rounds. Lost updates are
not translated. What is not compared is counted by its reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from random import Random
from textwrap import dedent

import pytest
from msgspec.structs import replace

from koord.refinement.generating.programs import system
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System, dealt
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import GoalKind, OutOfBounds, SearchGoal
from koord.verify.engines.explicit.search import survey
from tests.generators.profiles import FINITE
from tests.generators.staged import STAGES, staged
from tests.peers import model, spin
from tests.peers.shapes import NotCoveredError
from tests.sampling import blocks

ROUNDS = 2

SUBJECTS = frozenset({GoalKind.PROPERTY, GoalKind.FAULT, GoalKind.CONTRACT})

needs_spin = pytest.mark.skipif(
    bool(spin.missing()),
    reason=f"{spin.missing()} not installed (Debian: apt-get install spin gcc)",
)


def searched(made: System, rounds: int = ROUNDS) -> dict[str, int] | str:
    """What the search sees broken, and when; or why it does not know."""
    found = survey(
        made, made.program.properties, Limits(states=20_000, rounds=rounds), subjects=SUBJECTS
    )
    if isinstance(found.end, NotFinite):
        return "search: not finite"
    if isinstance(found.end, OutOfBounds):
        depth = found.end.depth
        if depth is None or depth < rounds:
            return f"search: {found.end.reason}"
    return {_name(violated.claim): violated.rounds for violated in found.violated}


def _name(claim: SearchGoal) -> str:
    match claim.subject:
        case GoalKind.FAULT:
            return model.NO_FAULT
        case GoalKind.CONTRACT:
            return f"contract {claim.name}"
        case _:
            return claim.name


def finite(random: Random) -> System:
    return system(random, FINITE)


def compare(
    seeds: Iterable[int],
    folder: Path,
    make: Callable[[Random], System] = finite,
    rounds: int = ROUNDS,
) -> Counter[str]:
    """Ask both about each program. The counts: agreements, violations, and what was left out."""
    counts: Counter[str] = Counter()
    for seed in seeds:
        made = make(Random(seed))
        expected = searched(made, rounds)
        if isinstance(expected, str):
            counts[expected] += 1
            continue
        try:
            translated = model.translate(made.program, made.kinds, rounds)
            answer = spin.ask(translated, folder)
        except NotCoveredError as reason:
            counts[f"not translated: {reason}"] += 1
            continue
        except spin.UnsureError as reason:
            counts[f"unsure: {reason}"] += 1
            continue
        assert answer.first == expected, f"seed {seed}, robots {made.kinds}: {made.program}"
        counts["agree"] += 1
        counts["violated"] += len(expected)
        counts["violated inside"] += sum(r > 0 for r in expected.values())
        counts["violated late"] += sum(r > 2 for r in expected.values())
        counts["hold"] += len(translated.claims) - len(expected)
    print(dict(counts))  # shown with -s, and where an assertion fails
    return counts


@needs_spin
@pytest.mark.parametrize("seeds", blocks(15, of=30, count=2))
def test_spin_agrees(seeds: range, tmp_path: Path) -> None:
    """Among them faults, broken contracts of models, locks, and assumptions."""
    counts = compare(seeds, tmp_path)
    assert counts["agree"] >= len(seeds) / 2
    assert counts["violated inside"] >= 1
    assert counts["hold"] >= len(seeds) / 2


@needs_spin
@pytest.mark.slow
@pytest.mark.parametrize("seeds", blocks(15, of=30, count=4))
def test_spin_agrees_late(seeds: range, tmp_path: Path) -> None:
    """Programs in stages. With those above all of these are more than a hundred."""
    counts = compare(seeds, tmp_path, staged, STAGES)
    assert counts["agree"] >= len(seeds) / 2
    assert counts["violated late"] >= len(seeds) / 10
    assert counts["hold"] >= len(seeds) / 2


@needs_spin
@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_spin_agrees_on_many(block: int, tmp_path: Path) -> None:
    seeds = range(1_000 + 50 * block, 1_050 + 50 * block)
    assert compare(seeds, tmp_path)["agree"] >= 20
    assert compare(seeds, tmp_path, staged, STAGES + 1)["agree"] >= 20


def test_what_is_not_translated_is_refused_by_name() -> None:
    """A program with floats, one with a list literal that is shorter than its array."""
    refused = Counter[str]()
    for seed in range(100):
        made = system(Random(seed), FINITE)
        try:
            model.translate(made.program, made.kinds, ROUNDS)
        except NotCoveredError as reason:
            refused[str(reason)] += 1
    assert refused["FloatType"] >= 5
    assert sum(refused.values()) <= 40


def test_the_search_for_a_peer_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert spin.missing() == "spin and a C compiler"


#: What a rule decides, a program in which it shows, and a mistake in the C of ``rounds.h``.
RULES = {
    "ATOMIC": (
        """
        local:
            boolean won = false
        allwrite:
            int winner = 0
        Take:
            pre: not won
            eff:
                atomic:
                    won = true
                    winner = pid
        invariant One: not (won@0 and won@1)
        """,
        "if (cx.entered & work.taken) return BLOCKED;",
        "",
    ),
    "SKIP": (
        """
        local:
            int steps = 0
        urgent Step:
            pre: steps < 2
            eff: steps = steps + 1
        invariant Together at round: steps@0 == steps@1
        """,
        "guards_of[kind][e](&cx)) return 0;",
        "0) return 0;",
    ),
    "EVENT-TRANS": (
        """
        allwrite:
            int phase = 0
        Up:
            pre: phase == 0
            eff: phase = 1
        Down:
            pre: phase == 1
            eff: phase = 0
        invariant Alike: not (ran(Up)@0 and ran(Down)@1)
        """,
        "s->robots[i].ran = 0;",
        ";",
    ),
    "END-PROG": (
        """
        local:
            int n = 0
        Ask:
            pre: n == 0
            eff: trystop()
        invariant Runs: not stopped@0
        """,
        "s->robots[i].status = STOPPED;",
        ";",
    ),
    "LOOKUP": (
        """
        local:
            int seen = 0
        allwrite:
            int x = 0
        Look:
            pre: true
            eff:
                seen = x
                x = 1
        invariant Unseen: seen@0 == 0
        """,
        "{ s, me, me, &me->copy, &s->store,",
        "{ s, me, me, &s->store, &s->store,",
    ),
}


@needs_spin
@pytest.mark.parametrize("rule", RULES)
def test_a_mistake_in_the_translation_shows(rule: str, tmp_path: Path) -> None:
    """Agreement means something: each rule has a program of which a wrong model tells."""
    text, right, wrong = RULES[rule]
    program = load(Source("rule.krd", dedent(text))).program
    assert program is not None
    made = dealt(program, 2)
    translated = model.translate(made.program, made.kinds, ROUNDS)
    expected = searched(made)
    assert spin.ask(translated, tmp_path).first == expected
    assert right in translated.rules
    mistaken = replace(translated, rules=translated.rules.replace(right, wrong))
    assert spin.ask(mistaken, tmp_path).first != expected
