"""Elements that nobody tells apart: as a search that keeps all states. [ELEMENTS] [SYMMETRY]"""

from __future__ import annotations

from collections import Counter
from itertools import permutations
from random import Random
from typing import Any

import pytest

from koord.semantics.liveness import LIVENESS
from koord.syntax.analysis.symmetry import Symmetry, reachable_symmetry
from koord.syntax.system import System, dealt
from koord.verify.engines.explicit.compiled import is_installed
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, OutOfBounds
from koord.verify.engines.explicit.search import Search, begun
from tests.agreement.test_search import shows
from tests.environments import ROOT
from tests.loading import program_of
from tests.sampling import blocks

CLAIMING = "".join(
    (ROOT / "benchmarks" / "programs" / f"{name}.krd").read_text("utf-8")
    for name in ("claiming", "claiming_owned")
)

#: Conditions on the element i, of which some tell elements apart.
CONDITIONS = (
    "owner[i] == -1",
    "mark[i] < 2",
    "mark[i] == 0",
    "best != i",
    "mine != i",
    "i != 1",
    "best < i",
    "owner[i] != pid",
)

#: Conditions that a block of the same place makes false, and such that it does not.
LATCHES = (
    ("not busy", "busy = true"),
    ("mine == -1", "mine = i"),
    ("best == -1", "best = i"),
    ("not busy", "busy = not busy"),
    ("mine == -1", "mine = 0"),
    ("mine < 2", "mine = i"),
    ("true", "break"),
    ("true", "busy = true"),
)

#: What a block does with the element i.
DEEDS = (
    "owner[i] = pid",
    "mark[i] = 1",
    "mark[i] = mark[i] + 1",
    "best = i",
    "owner[i] = -1",
    "mark[0] = 1",
    "best = i + 0",
)

#: Other effects of whole events, with what they ask first.
EFFECTS = (
    ("mine >= 0", "owner[mine] = -1\n        mine = -1\n        busy = false"),
    ("busy", "busy = false"),
    ("best >= 0", "mark[best] = 0\n        best = -1"),
    ("not busy", "best = pick(0)\n        busy = true"),
    ("best == -1", "for k = 0, 3:\n            mark[k] = 0"),
    ("best == -1", "best = mine"),
    ("mine >= 1", "mine = -1\n        busy = false"),
    ("not busy", "best = few(0)\n        busy = true"),
    ("best == -1", "for k = 0, 2:\n            mark[k] = 0"),
    ("best == -1", "for k = 0, 3:\n            if mark[k] == 0:\n                best = k"),
    ("mine <= 2", "mine = best"),
)

CLAIMS = (
    "forall i: mine@i >= 0 implies owner[mine@i] == i",
    "forall i, j: i != j and mine@i >= 0 implies mine@i != mine@j",
    "best < 3",
    "forall k in 0, 3: mark[k] < 2",
    "exists k in 0, 3: mark[k] == 0",
    "best >= 0 implies mark[best] == 0",
    "best != 2",
    "forall i: mine@i != 1",
    "best < 1",
    "mark[2] == 0",
)


def generated(seed: int) -> str:
    """A program with three elements, that its text tells apart or not."""
    random = Random(seed)
    latch, release = random.choice(LATCHES[: random.choice((3, 3, 3, len(LATCHES)))])
    condition = random.choice(CONDITIONS[: random.choice((5, 5, 5, len(CONDITIONS)))])
    asked = random.choice((*5 * ("clear(i)",), "not clear(i)", "true", "likely(i)"))
    deeds = random.sample(DEEDS[: random.choice((5, 5, 5, len(DEEDS)))], random.randint(1, 2))
    block = "\n                    ".join([*deeds, release])
    events = random.sample(EFFECTS[: random.choice((6, 6, len(EFFECTS)))], 2)
    claims = random.sample(CLAIMS[: random.choice((6, 6, len(CLAIMS)))], 3)
    text = f"""\
def fun clear(int k) -> bool: extern fresh

def fun likely(int k) -> bool: extern fresh
    ensures:
        k == 1 implies result

def fun pick(int k) -> int: extern fresh
    ensures:
        0 <= result and result < 3

def fun few(int k) -> int: extern fresh
    ensures:
        0 <= result and result < 2

local:
    bool busy = false
    int mine = -1

allwrite:
    int[3] owner
    int[3] mark
    int best = -1

init:
    for i = 0, 3:
        owner[i] = -1
        mark[i] = 0

Take:
    pre: not busy
    eff:
        atomic:
            for i = 0, 3:
                if {condition} and {latch} and {asked}:
                    {block}
"""
    for name, (pre, eff) in zip("AB", events, strict=True):
        text += f"\n{name}:\n    pre: {pre}\n    eff:\n        {eff}\n"
    for number, claim in enumerate(claims):
        text += f"\ninvariant C{number}: {claim}\n"
    return text


def searched(of: System, *, symmetry: bool, compiled_from: int | None) -> Search:
    properties = tuple(p for p in of.program.properties if p.kind not in LIVENESS)
    made = begun(
        of, properties, Limits(states=2_500), symmetry=symmetry, compiled_from=compiled_from
    )
    assert not isinstance(made, NotFinite)
    return made


def compare(of: System, seed: object = None, *, compiled: bool = True) -> tuple[int, int]:
    """Compare searches with symmetry with one without: how many states these see."""
    ends = []
    roads: list[tuple[bool, int | None]] = [(False, None), (True, None)]
    roads += [(True, 0)] if compiled and is_installed() else []
    for symmetry, compiled_from in roads:
        search = searched(of, symmetry=symmetry, compiled_from=compiled_from)
        found = list(search.violations())
        assert all(shows(of, violated) for violated in found), seed
        assert compiled_from is None or search.is_compiled, (seed, search.left)
        ends.append(({(v.claim, v.rounds) for v in found}, search.end))
    (expected, end), *others = ends
    assert isinstance(end, Exhausted | OutOfBounds)
    for told, its_end in others:
        assert isinstance(its_end, Exhausted | OutOfBounds)
        if isinstance(end, Exhausted):
            assert told == expected, seed
            assert isinstance(its_end, Exhausted), seed
            # States that stay apart though they differ by names alone may be found later.
            assert its_end.depth >= end.depth, seed
            assert its_end.states <= end.states, seed
        else:
            assert told >= expected, seed
    kept = others[0][1]
    assert isinstance(kept, Exhausted | OutOfBounds)
    return end.states, kept.states


@pytest.mark.slow
@pytest.mark.parametrize("seeds", blocks(12, of=400, count=2))
def test_generated_programs_as_without_symmetry(seeds: range) -> None:
    count: Counter[str] = Counter()
    for seed in seeds:
        of = dealt(program_of(generated(seed)), 2)
        properties = tuple(of.program.properties)
        symmetry = reachable_symmetry(of, properties)
        is_used = isinstance(symmetry, Symmetry) and bool(symmetry.elements)
        # Making machine code takes longer than both searches.
        every, kept = compare(of, seed, compiled=is_used and seed % 8 == 0)
        count["alike" if is_used else "told apart"] += 1
        count["fewer"] += is_used and kept < every
    assert count["alike"] > len(seeds) // 20, count
    assert count["told apart"] > len(seeds) // 4, count
    assert count["fewer"], count


@pytest.mark.slow
def test_tasks_are_claimed_by_any_robot_alike() -> None:
    """As many states as there are under all renamings, counted by hand."""
    of = dealt(program_of(CLAIMING), 3)
    every, kept = compare(of)
    assert (every, kept) == (2_257, 33)


def test_what_stands_for_a_state_stands_for_all_that_differ_by_names() -> None:
    """Of all states that search finds, with all ways to rename them."""
    of = dealt(program_of(CLAIMING.replace("int tasks = 4", "int tasks = 3")), 2)
    search = searched(of, symmetry=False, compiled_from=None)
    assert not list(search.violations())
    orbits = set()
    for state in search.seen:
        made: Any = search.vault.configuration(state)
        robots = [tuple(part.value for part in robot.locals) for robot in made.robots]
        owner = [part.value for part in made.store.allwrite[0].parts]
        orbits.add(min(_renamed(robots, owner)))
    assert compare(of)[1] == len(orbits)


def _renamed(robots: list[Any], owner: list[int]) -> list[tuple[object, ...]]:
    found: list[tuple[object, ...]] = []
    for p in permutations(range(len(robots))):
        for q in permutations(range(len(owner))):
            mine = sorted(
                (p[i], busy, q[task] if task >= 0 else task)
                for i, (busy, task) in enumerate(robots)
            )
            held = sorted((q[k], p[i] if i >= 0 else i) for k, i in enumerate(owner))
            found.append((*mine, *held))
    return found


def alike(text: str, robots: int = 2) -> bool:
    of = dealt(program_of(text), robots)
    found = reachable_symmetry(of, tuple(of.program.properties))
    return isinstance(found, Symmetry) and bool(found.elements)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("mine = i", "mine = i + 1"),
        ("owner[i] == -1", "owner[i] == -1 and i != 0 and i != 1 and i != 2"),
        ("owner[i] == -1", "owner[i] == -1 and i < 2"),
        ("owner[i] == -1", "owner[i] == -1 and mine < i"),
        ("owner[i] == -1 and not onTask", "owner[i] == -1"),
        ("wayIsClear(i)", "not wayIsClear(i)"),
        ("extern fresh", "extern fresh\n    ensures:\n        result"),
        ("extern fresh", "extern"),
        ("onTask = true", "onTask = not onTask"),
        ("    for i = 0, tasks:\n        owner[i] = -1", "    owner[0] = -1"),
        ("mine@i >= 0 implies owner", "mine@i >= 1 implies owner"),
    ],
)
def test_what_tells_elements_apart(old: str, new: str) -> None:
    """[ELEMENTS]: in each case one use of an element is not one of those that are allowed."""
    assert alike(CLAIMING)
    assert old in CLAIMING
    assert not alike(CLAIMING.replace(old, new))
