"""Symbols in: what the domain of terms computes simplifies to what the exact domain computes.

Every scalar of a configuration and of the inputs becomes a symbol; one turn is evaluated on them;
then the symbols are replaced by what they stand for.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from random import Random

import pytest

from koord.semantics.domain import EXACT
from koord.semantics.environment import environment_turn
from koord.semantics.every_number import NotFiniteError
from koord.semantics.oracle import Inputs
from koord.semantics.properties import holds_in
from koord.semantics.recordings import RecordedInputs
from koord.semantics.turns import committed, declared, initial_turn, program_turn
from koord.syntax import core
from koord.syntax.types import BOOL
from koord.verify.encoding.terms import Term, Terms
from tests.agreement.flattening import (
    first_fault,
    flat_evolved,
    flat_store,
    flat_turned,
    itself,
    meaning_of,
)
from tests.agreement.symbols import Asked, Symbols
from tests.agreement.triples import Triple, exact_steps, triple
from tests.generators.configurations import configuration
from tests.generators.runs import Player, RandomInputs
from tests.sampling import blocks

#: So many triples of a block are compared whole: of a few a loop has no bound that symbols know.
WHOLE = 250 / 255


class Comparison:
    """One triple on both domains."""

    def __init__(self, t: Triple) -> None:
        self.t = t
        self.random = Random(t.seed)
        # Mostly symbols all over; sometimes constants among them, which take other paths.
        share = self.random.choice((1.0, 1.0, 0.6))
        self.symbols = Symbols(Terms(), self.random, t.system.robots, share)
        self.start = self.symbols.configuration(t.system, t.start)
        # What the schedule answers, and by chance what else the exact domain asks for.
        self.recorded = RandomInputs(self.random, t.system.robots, {})
        self.recorded.answers.update(((a.phase, a.robot, a.key), a) for a in t.round.answers)
        self.recorded.readings.update(((r.robot, r.slot), r) for r in t.round.readings)
        answers, readings = self.recorded.answers, self.recorded.readings
        self.asked = Asked(self.symbols, {}, readings, answers)

    def program_turn(self, robot: int, position: int) -> None:
        """The turn on a snapshot, and its writes put into some other store."""
        t, d = self.t, self.symbols.d
        other = configuration(self.random, t.system).store
        state = t.start.robots[robot]
        selectable, exact = program_turn(EXACT, t.system, robot, state, position, self.recorded)
        after = committed(EXACT, other, exact)
        symbolic = program_turn(d, t.system, robot, self.start.robots[robot], position, self.asked)
        symbolic_after = committed(d, self.symbols.store(t.system, other), symbolic[1])
        meaning = meaning_of(self.symbols, (symbolic, symbolic_after))
        assert meaning(symbolic[0], BOOL) == selectable
        assert flat_turned(meaning, t.system, robot, symbolic[1], symbolic_after) == flat_turned(
            itself, t.system, robot, exact, after
        )

    def environment_turn(self, robot: int) -> None:
        t, d = self.t, self.symbols.d
        exact = environment_turn(EXACT, t.system, robot, t.start.robots[robot], self.recorded)
        symbolic = environment_turn(d, t.system, robot, self.start.robots[robot], self.asked)
        meaning = meaning_of(self.symbols, symbolic)
        assert flat_evolved(meaning, t.system, robot, symbolic) == flat_evolved(
            itself, t.system, robot, exact
        )

    def properties(self) -> None:
        t, d = self.t, self.symbols.d
        program = t.system.program
        closed: list[core.Property | core.Assumption] = [*program.properties, *program.assumptions]
        for p in closed:
            exact, _ = holds_in(EXACT, t.system, t.start, p.condition, p.bound, self.recorded)
            symbolic, _ = holds_in(d, t.system, self.start, p.condition, p.bound, self.asked)
            meaning = meaning_of(self.symbols, symbolic)
            assert meaning(symbolic, BOOL) == exact, p.name


@dataclass(slots=True)
class Compared:
    """What was compared: triples, all of each, that are different; and how many of them fault."""

    triples: set[str] = field(default_factory=set)
    faults: int = 0

    def add(self, seed: int) -> None:
        t = triple(seed)
        if compare(t) == 0:
            self.triples.add(repr((t.system.program, t.start, t.round)))
            self.faults += any(s.configuration.fault is not None for s in exact_steps(t))


def compare(t: Triple) -> int:
    """Compare one triple; the number of things that could not be compared."""
    comparison = Comparison(t)
    skipped = 0
    for robot in range(t.system.robots):
        # Whatever the schedule has it do: an event whose guard does not hold is compared as well.
        for position in range(len(t.system.agent(robot).events)):
            try:
                comparison.program_turn(robot, position)
            except NotFiniteError:
                skipped += 1
        comparison.environment_turn(robot)
    comparison.properties()
    return skipped


@pytest.mark.parametrize("seeds", blocks(25, of=255, count=8))
def test_turns_and_properties_agree(seeds: range) -> None:
    """In all blocks together at least 2,000 triples, faults included; 25 by default."""
    compared = Compared()
    for seed in seeds:
        compared.add(seed)
    assert len(compared.triples) >= WHOLE * len(seeds)
    assert len(seeds) // 20 < compared.faults < len(seeds) * 3 // 4


@pytest.mark.slow
@pytest.mark.parametrize("block", range(20))
def test_turns_and_properties_agree_on_many(block: int) -> None:
    for seed in range(200_000 + block * 1_000, 201_000 + block * 1_000):
        compare(triple(seed))


# --- INIT -----------------------------------------------------------------------------------------


def compare_init(seed: int) -> None:
    t = triple(seed)
    opened = Player(Random(seed), t.system).opening()
    if opened is None:
        return
    opening, _ = opened
    recorded = RecordedInputs(starts=opening.starts, answers=opening.answers)
    symbols = Symbols(Terms(), Random(seed), t.system.robots, 1.0)
    asked = Asked(
        symbols,
        {(s.home, s.slot, s.robot): s for s in opening.starts},
        {},
        {(a.phase, a.robot, a.key): a for a in opening.answers},
    )
    store, faults = declared(EXACT, t.system, recorded)
    symbolic: Inputs[Term] = asked
    symbolic_store, symbolic_faults = declared(symbols.d, t.system, symbolic)
    meaning = meaning_of(symbols, (symbolic_store, symbolic_faults))
    fault = first_fault(itself, faults)
    assert first_fault(meaning, symbolic_faults) == fault
    if fault is not None:
        return
    assert flat_store(meaning, t.system, symbolic_store) == flat_store(itself, t.system, store)
    for robot in range(t.system.robots):
        exact = initial_turn(EXACT, t.system, robot, store, recorded)
        turned = initial_turn(symbols.d, t.system, robot, symbolic_store, symbolic)
        after = committed(EXACT, store, exact)
        symbolic_after = committed(symbols.d, symbolic_store, turned)
        meaning = meaning_of(symbols, (turned, symbolic_after))
        assert flat_turned(meaning, t.system, robot, turned, symbolic_after) == flat_turned(
            itself, t.system, robot, exact, after
        )


@pytest.mark.parametrize("seeds", blocks(30, of=250, count=4))
def test_init_agrees(seeds: range) -> None:
    for seed in seeds:
        compare_init(seed)
