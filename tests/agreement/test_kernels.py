"""Machine code against the road of Python: verdicts, numbers of states, successors of states.
[T-SNAPSHOT] [T-ONE-WINNER] [T-COMMIT] [SYMMETRY]
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from itertools import islice
from random import Random

import pytest

from koord.refinement.generating.programs import system
from koord.semantics.liveness import LIVENESS
from koord.syntax import core
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System, dealt
from koord.syntax.types import BoolType, EnumType, IntType, atoms
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, OutOfBounds
from koord.verify.engines.explicit.search import Search, begun
from tests.agreement.test_search import EVERYTHING, searched
from tests.environments import ROOT
from tests.generators.profiles import FINITE, SYMMETRIC
from tests.generators.staged import staged

pytest.importorskip("llvmlite")

from koord.kernels.context import Goals
from koord.kernels.exploration import Exploration
from koord.kernels.layout import Layout, unset_somewhere
from koord.kernels.rounds import Rounds
from koord.verify.engines.explicit.second_look import DisagreementError
from tests.sampling import first

Rounded = dict[tuple[str, str], int]


def properties_of(of: System) -> tuple[core.Property, ...]:
    return tuple(p for p in of.program.properties if p.kind not in LIVENESS)


def shown(
    of: System, compiled_from: int | None, *, symmetry: bool
) -> tuple[Search, Rounded, Exhausted | OutOfBounds | NotFinite]:
    """A search to its end, or for some rounds, and the rounds of each violation."""
    search = begun(
        of,
        properties_of(of),
        Limits(states=3_000, rounds=4),
        subjects=EVERYTHING,
        symmetry=symmetry,
        compiled_from=compiled_from,
    )
    assert not isinstance(search, NotFinite)
    found = {(v.claim.subject.value, v.claim.name): v.rounds for v in search.violations()}
    return search, found, search.end


def compare(seed: int, of: System, *, symmetry: bool) -> str:
    if searched(of, symmetry=symmetry, states=400) is None:
        return "too large, or not finite"
    plain, expected, end = shown(of, None, symmetry=symmetry)
    assert not plain.is_compiled
    compiled, found, its_end = shown(of, 0, symmetry=symmetry)
    assert not isinstance(compiled.left, DisagreementError), (seed, compiled.left)
    if not compiled.is_compiled:
        return "no machine code"
    assert found == expected, seed
    assert its_end == end, seed
    return "violated" if found else "holds"


def is_packable(of: System) -> bool:
    """Whether all variables are numbers, Booleans and members, or records and arrays of them."""
    program = of.program
    types = [x.variable.own_type for x in (*program.allread, *program.allwrite)]
    for agent in program.agents:
        types += [x.variable.type for x in agent.locals]
        types += [p.declaration.variable.type for p in agent.ports]
    scalars = (IntType, BoolType, EnumType)
    return all(isinstance(atom, scalars) for type_ in types for atom in atoms(type_))


def packable(
    made: Callable[[Random], System], seeds: range, most: int
) -> Iterator[tuple[int, System]]:
    """The first few generated systems that may have machine code."""
    systems = ((seed, made(Random(seed))) for seed in seeds)
    return islice(((seed, of) for seed, of in systems if is_packable(of)), most)


KINDS: dict[str, tuple[Callable[[Random], System], bool]] = {
    "finite": (lambda random: system(random, FINITE), False),
    "staged": (staged, False),
    "symmetric": (lambda random: system(random, SYMMETRIC), True),
}


@pytest.mark.parametrize("block", first(1, range(2)))
@pytest.mark.parametrize("kind", KINDS)
def test_as_the_road_of_python(kind: str, block: int) -> None:
    """Verdicts, shortest runs, which replay, and how many states there are."""
    made, symmetry = KINDS[kind]
    seeds = range(1_000 * block, 1_000 * block + 1_000)
    found = packable(made, seeds, 12)
    count = Counter(compare(seed, of, symmetry=symmetry) for seed, of in found)
    assert count["violated"] + count["holds"] >= 2, count


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_as_the_road_of_python_on_many(kind: str) -> None:
    made, symmetry = KINDS[kind]
    found = packable(made, range(10_000, 30_000), 150)
    count = Counter(compare(seed, of, symmetry=symmetry) for seed, of in found)
    assert count["violated"] + count["holds"] > 30, count


# --- programs -------------------------------------------------------------------------------------

CLAIMING = (ROOT / "benchmarks" / "programs" / "clear_tasks.krd").read_text("utf-8")

#: An answer that the summary does not allow would fault, or break the invariant.
LEGAL = """\
def fun next(int now) -> int: extern fresh
    ensures:
        0 <= result and result <= 4
        result != 2 and result != now

local:
    int at = 0

Move:
    pre: at < 4
    eff: at = next(at)

invariant Never: at != 2
"""

#: What a sensor reads depends on what it read before.
SENSED = """\
using Sense:
    sensors:
        int level
    contract Slow:
        ensures:
            0 <= level' and level' <= 3
            level' == level or level' == level + 1

local:
    int seen = 0

Look:
    pre: seen < Sense.level
    eff: seen = Sense.level

assume: Sense.level == 0

invariant Near: seen <= Sense.level
"""

STOPPED = """\
local:
    int done = 0

Work:
    pre: done < 3
    eff: done = done + 1

Leave:
    pre: done == 1
    eff: stop()

invariant StoppedEarly: stopped implies done == 1
"""

#: A robot that names another one, and itself after that.
NAMED = """\
local:
    int friend = -1
    bool said = false

Meet:
    pre: friend == -1
    eff:
        atomic:
            if last != -1 and last != pid:
                friend = last
            last = pid

Tell:
    pre: friend != -1 and not said
    eff: said = true

allwrite:
    int last = -1

invariant Others: friend != pid
invariant NotBoth: forall i, j: i != j and friend@i == j implies friend@j != i
"""

#: Numbers of either sign, divided by numbers of either sign.
DIVIDED = """\
local:
    int x = -7
    int y = 0
    int z = 0

Divide:
    pre: x < 8
    eff:
        y = x / 3 + x % 3 + x / -2
        z = x % -3
        x = x + 1

invariant Down: y * 2 < x + 6
invariant Negative: z <= 0
"""

LOST = """\
allwrite:
    int x = 0

Add:
    pre: x < 3
    eff: x = x + 1

invariant Small: x < 3
"""

#: A choice that only the store hears of.
PICKED = """\
def fun answer(int now) -> int: extern fresh
    ensures:
        0 <= result and result <= 3

local:
    bool said = false

allwrite:
    int x = 0

Say:
    pre: not said
    eff:
        said = true
        x = answer(0)

invariant Few: x < 3
"""

#: An update that nobody overwrites, beside a race for another variable.
UPDATED = """\
allwrite:
    int x = 0
    int y = 0

Add:
    pre: pid == 0 and x < 3
    eff: x = x + 1

Set:
    pre: pid > 0
    eff: y = pid

invariant Few: x < 3
"""

#: A model that follows an actuator: the claim is broken only before its turn.
FOLLOWED = """\
using Wheel:
    sensors:
        int speed = 0
    actuators:
        int wanted
    environment:
        speed = wanted

init:
    Wheel.wanted = 0

Faster:
    pre: Wheel.wanted < 3
    eff: Wheel.wanted = Wheel.wanted + 1

invariant Same: Wheel.speed == Wheel.wanted
"""

#: The same with a turn of the model that may fault.
FAULTING = FOLLOWED.replace("speed = wanted\n\n", "speed = 6 / (3 - wanted)\n\n")


def read(text: str, robots: int) -> System:
    program = load(Source("model.krd", text)).program
    assert program is not None
    return dealt(program, robots)


@pytest.mark.parametrize(
    ("text", "robots"),
    first(
        4,
        [
            (CLAIMING, 2),
            (LOST, 3),
            (LEGAL, 2),
            (SENSED, 2),
            (STOPPED, 3),
            (NAMED, 3),
            (DIVIDED, 1),
            (PICKED, 2),
            (UPDATED, 3),
            (FOLLOWED, 2),
            (FAULTING, 2),
            ((ROOT / "specs" / "examples" / "sum_of_ids.krd").read_text("utf-8"), 4),
            ((ROOT / "specs" / "examples" / "leader_elect.krd").read_text("utf-8"), 3),
        ],
    ),
    ids=[
        "claiming",
        "lost",
        "legal",
        "sensed",
        "stopped",
        "named",
        "divided",
        "picked",
        "updated",
        "followed",
        "faulting",
        "sum_of_ids",
        "leader_elect",
    ],
)
@pytest.mark.parametrize("symmetry", [False, True])
def test_programs_as_the_road_of_python(text: str, robots: int, symmetry: bool) -> None:
    of = read(text, robots)
    properties = properties_of(of)
    ends = []
    for compiled_from in (None, 0):
        search = begun(
            of,
            properties,
            subjects=EVERYTHING,
            symmetry=symmetry,
            compiled_from=compiled_from,
        )
        assert not isinstance(search, NotFinite)
        found = {(v.claim.subject, v.claim.name, v.rounds) for v in search.violations()}
        ends.append((found, search.end))
        assert search.is_compiled is (compiled_from == 0)
    assert ends[0] == ends[1]


# --- successors -----------------------------------------------------------------------------------


def successors_agree(of: System, most: int) -> int:
    """Compare the successors of every one of the first states; how many states there were."""
    search = begun(of, (), symmetry=False, compiled_from=None)
    assert not isinstance(search, NotFinite)
    assert not list(search.violations())
    vault, seen = search.vault, list(search.seen)
    starts = [vault.configuration(state) for state, before in search.seen.items() if before is None]
    layout = Layout(of, None, unset_somewhere(of, starts), tracks_ran=False)
    rounds = Rounds(layout, Goals(), 8)
    for state in seen[:most]:
        expected = {
            tuple(layout.numbers(vault.configuration(after))) for after in search.successors(state)
        }
        exploration = Exploration(rounds)
        start = tuple(layout.numbers(vault.configuration(state)))
        exploration.enter(start)
        exploration.expand(0, 1)
        found = {tuple(exploration.numbers(k)) for k in range(exploration.states)}
        assert found == expected | {start}
    return min(most, len(seen))


def test_every_set_of_successors() -> None:
    assert successors_agree(read(CLAIMING, 2), 60) == 60
    sums = (ROOT / "specs" / "examples" / "sum_of_ids.krd").read_text("utf-8")
    assert successors_agree(read(sums, 3), 60) > 5
