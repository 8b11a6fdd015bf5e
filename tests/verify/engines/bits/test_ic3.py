"""IC3, unrolling and clauses on small random circuits, of which every state can be listed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise, product
from random import Random

import pysolvers
import pytest
from msgspec import field
from msgspec.structs import replace

from koord.verify.effort import Deadline
from koord.verify.engines.bits.circuit import Latch
from koord.verify.engines.bits.clauses import FALSE_SIDE, OTHER, QUICK, TRUE_SIDE, Clauses
from koord.verify.engines.bits.graph import Graph
from koord.verify.engines.bits.ic3 import ClauseInvariant, Ic3Run, Reached, SafetyQuery, Unfinished
from koord.verify.engines.bits.unrolling import holds_always

State = tuple[bool, ...]


@dataclass(frozen=True)
class Small:
    """A circuit of few latches and inputs."""

    graph: Graph
    inputs: list[int]
    question: SafetyQuery

    def moves(self, state: State) -> Iterator[tuple[State, bool, bool]]:
        """For all inputs: the next state, whether that is a step, and whether this is bad."""
        q = self.question
        wanted = [*(latch.next for latch in q.latches), q.steps, q.bad]
        for bits in product((False, True), repeat=len(self.inputs)):
            given = {x >> 1: b for x, b in zip(self.inputs, bits, strict=True)}
            given |= {x.literal >> 1: b for x, b in zip(q.latches, state, strict=True)}
            *then, steps, bad = self.graph.values(wanted, given)
            yield tuple(then), steps, bad

    def starts(self) -> set[State]:
        q = self.question
        found = set()
        for bits in product((False, True), repeat=len(self.inputs)):
            given = {x >> 1: b for x, b in zip(self.inputs, bits, strict=True)}
            opens, *first = self.graph.values([q.opens, *(x.init for x in q.latches)], given)
            if opens:
                found.add(tuple(first))
        return found

    def bad_after(self) -> int | None:
        """The number of the first round that can be bad, from 1; None if none ever is."""
        seen: set[State] = set()
        now, number = self.starts(), 0
        while now:
            number += 1
            if any(bad for state in now for _, _, bad in self.moves(state)):
                return number
            seen |= now
            now = {then for s in now for then, steps, _ in self.moves(s) if steps} - seen
        return None


def small(seed: int) -> Small:
    random = Random(seed)
    g = Graph()
    latches = [g.input(f"l{k}") for k in range(random.choice((3, 4, 5)))]
    inputs = [g.input(f"i{k}") for k in range(random.choice((1, 2, 3)))]

    def made(leaves: list[int], depth: int) -> int:
        if depth == 0 or random.random() < 0.15:
            return random.choice(leaves) ^ random.choice((0, 1))
        a, b, c = (made(leaves, depth - 1) for _ in range(3))
        how = random.choice((g.both, g.both, g.either, g.differ))
        return how(a, b) if random.random() < 0.7 else g.choose(a, b, c)

    every = latches + inputs
    rare = g.all_of(x ^ random.choice((0, 1)) for x in random.sample(latches, len(latches) - 1))
    question = SafetyQuery(
        tuple(
            Latch(f"l{k}", x, random.choice((0, 1, made(inputs, 1))), made(every, 3))
            for k, x in enumerate(latches)
        ),
        g.either(made(inputs, 1), made(inputs, 1)),
        g.either(made(every, 2), made(every, 2)),
        g.both(rare, random.choice((1, made(inputs, 1)))),
    )
    return Small(g, inputs, question)


def searched(of: Small) -> ClauseInvariant | Reached:
    found = Ic3Run(Clauses(of.graph, QUICK), of.question, Deadline()).run()
    assert isinstance(found, ClauseInvariant | Reached)
    return found


def in_cube(state: State, cube: tuple[int, ...]) -> bool:
    return all(state[abs(x) - 1] == (x > 0) for x in cube)


def keeping(seed: int) -> Small:
    """A circuit of which something is kept until it is bad."""
    of, random = small(seed), Random(-seed)
    g, q = of.graph, of.question
    one, other = (x.literal ^ random.choice((0, 1)) for x in random.sample(q.latches, 2))
    kept = g.either(one, other)
    first, then = (
        g.substituted(kept, {x.literal >> 1: to for x, to in zip(q.latches, values, strict=True)})
        for values in ([x.init for x in q.latches], [x.next for x in q.latches])
    )
    bad = g.either(q.bad, g.both(q.steps, then ^ 1))
    return Small(g, of.inputs, replace(q, opens=g.both(q.opens, first), bad=bad, kept=(kept,)))


def compare(seed: int, made: Callable[[int], Small] = small) -> str:
    of = made(seed)
    first = of.bad_after()
    found = searched(of)
    if isinstance(found, Reached):
        assert first is not None, seed
        # The run that was found need not be the shortest, but it is no shorter.
        assert found.rounds >= first, seed
        return f"bad after {min(first, 3)}"
    assert first is None, seed
    assert holds_always(of.graph, of.question, found.cubes), seed
    states, pending = set(of.starts()), list(of.starts())
    while pending:
        for then, steps, _ in of.moves(pending.pop()):
            if steps and then not in states:
                states.add(then)
                pending.append(then)
    assert not any(in_cube(s, cube) for s in states for cube in found.cubes), seed
    return "empty" if not states else "proved with clauses" if found.cubes else "proved"


def test_it_says_what_listing_all_states_says() -> None:
    count = Counter(compare(seed) for seed in range(225))
    assert count["proved with clauses"] >= 20, count
    assert count["bad after 1"] >= 20, count
    assert count["bad after 2"] >= 5, count
    assert count["bad after 3"] >= 1, count


def test_it_says_that_of_what_is_kept_until_something_is_bad() -> None:
    count = Counter(compare(seed, keeping) for seed in range(225))
    assert count["proved with clauses"] >= 5, count
    assert count["bad after 2"] >= 3, count


@pytest.mark.slow
def test_it_says_what_listing_all_states_says_of_many() -> None:
    for seed in range(10_000, 30_000):
        compare(seed)
        compare(seed, keeping)


def test_an_invariant_that_is_none_is_told() -> None:
    told = 0
    for seed in range(120):
        of = small(seed)
        if of.bad_after() is not None:
            continue
        found = searched(of)
        assert isinstance(found, ClauseInvariant)
        if not found.cubes:
            continue
        states = set(of.starts())
        for cube in found.cubes:
            # Without a clause it may still be one; with one that a run breaks it never is.
            wrong = [x for x in states if not in_cube(x, cube)]
            if wrong:
                full = tuple(k + 1 if b else -(k + 1) for k, b in enumerate(wrong[0]))
                assert not holds_always(of.graph, of.question, [*found.cubes, full])
                told += 1
        if of.question.bad and any(bad for s in _all(of) for _, _, bad in of.moves(s)):
            assert not holds_always(of.graph, of.question, [])
            told += 1
    assert told >= 15


def _all(of: Small) -> Iterator[State]:
    return product((False, True), repeat=len(of.question.latches))


def test_what_cannot_be_kept_is_no_invariant() -> None:
    """A clause that INIT and safety bear, but some round breaks."""
    g = Graph()
    a, b = g.input("a"), g.input("b")
    latches = (Latch("a", a, 0, 1), Latch("b", b, 0, a))
    question = SafetyQuery(latches, 1, 1, g.both(a ^ 1, b))
    assert not holds_always(g, question, [(2,)])
    assert holds_always(g, question, [(-1, 2)])


def test_what_is_said_to_be_kept_is_shown() -> None:
    g = Graph()
    a, b = g.input("a"), g.input("b")
    for then, is_kept in ((b, False), (g.either(a, b), True)):
        question = SafetyQuery((Latch("a", a, 1, then),), 1, 1, 0, kept=(a,))
        assert holds_always(g, question, []) is is_kept


def test_few_questions_are_not_enough() -> None:
    of = next(s for s in map(small, range(400)) if s.bad_after() is None and _hard(s))
    search = Ic3Run(Clauses(of.graph, QUICK), of.question, Deadline(), limit=1)
    assert not isinstance(search.run(), ClauseInvariant | Reached)


def test_questions_of_one_frame_are_limited_by_themselves() -> None:
    """The limit is of each frame: as many as the widest one needs are enough for all."""
    more = fewer = 0
    for of in map(small, range(150)):
        free = _Counted(Clauses(of.graph, QUICK), of.question, Deadline())
        found = free.run()
        if not isinstance(found, ClauseInvariant):
            continue
        marks = [0, *free.opened, free.queries]
        most = max(after - before for before, after in pairwise(marks))
        assert _limited(of, most) == found
        more += most < free.queries
        fewer += isinstance(_limited(of, 1), Unfinished)
    assert more >= 10
    assert fewer >= 10


class _Counted(Ic3Run):
    """A run that remembers how many questions were asked when it opened each frame."""

    opened: list[int] = field(default_factory=list)

    def _open_frame(self) -> None:
        super()._open_frame()
        self.opened.append(self.queries)


def _limited(of: Small, most: int) -> object:
    return Ic3Run(Clauses(of.graph, QUICK), of.question, Deadline(), frame_limit=most).run()


def _hard(of: Small) -> bool:
    found = searched(of)
    return isinstance(found, ClauseInvariant) and found.rounds > 1


@pytest.mark.parametrize("engine", [QUICK, OTHER])
def test_clauses_say_what_the_graph_says(engine: str) -> None:
    for seed in range(50):
        of = small(seed)
        g, q = of.graph, of.question
        leaves = [*of.inputs, *(x.literal for x in q.latches)]
        wanted = [q.bad, q.steps, *(x.next for x in q.latches)]
        clauses = Clauses(g, engine)
        signed = [clauses.of(x) for x in leaves]
        one_sided = Clauses(g, engine)
        sides = [(one_sided.of(x, TRUE_SIDE), one_sided.of(x, FALSE_SIDE)) for x in wanted]
        # A literal that is written down in one direction only cannot be had where it is false.
        again = [one_sided.of(x, TRUE_SIDE) for x in leaves]
        for bits in product((False, True), repeat=len(leaves)):
            given = {x >> 1: b for x, b in zip(leaves, bits, strict=True)}
            expected = g.values(wanted, given)
            assumed = [n if b else -n for n, b in zip(signed, bits, strict=True)]
            for x, value in zip(wanted, expected, strict=True):
                number = clauses.of(x)
                assert clauses.solve([*assumed, number]) == value
                assert clauses.solve([*assumed, -number]) != value
            there = [n if b else -n for n, b in zip(again, bits, strict=True)]
            for (yes, _), value in zip(sides, expected, strict=True):
                assert one_sided.solve([*there, yes]) == value
        if seed > 25 and engine == OTHER:
            break


def test_ctrl_c_that_the_solver_hears_is_ctrl_c() -> None:
    """It has an error of its own for that."""

    class Interrupted:
        def conf_budget(self, conflicts: int) -> None:
            pass

        def solve_limited(self, assumptions: list[int]) -> bool:
            raise pysolvers.error("Caught keyboard interrupt")

    clauses = Clauses(Graph())
    clauses._solver = Interrupted()
    with pytest.raises(KeyboardInterrupt):
        clauses.solve([])
