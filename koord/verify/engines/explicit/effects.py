"""Effects of events, each computed once for all values that it reads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Fault, Robot
from koord.semantics.domain import EXACT, Constant
from koord.semantics.locations import Mask
from koord.semantics.oracle import Inputs, NoInputs
from koord.semantics.recordings import Answer
from koord.semantics.storage import Storage, Tree
from koord.semantics.turns import Turned, guard_of, program_turn
from koord.syntax import core
from koord.syntax.analysis.footprint import Reads, reads_of, rewritten, together
from koord.syntax.system import Status, System
from koord.syntax.walk import asks
from koord.traces.enumeration import ExploringInputs, explored
from koord.verify.engines.explicit.cells import Cells, Codes
from koord.verify.engines.explicit.lazy import Decisions, LazyDomain, PlaceOf
from koord.verify.engines.explicit.recipes import (
    PartRecipe,
    Recipe,
    VariableEffect,
    part_recipe,
    recipe,
)
from koord.verify.engines.explicit.states import ReadWindow, RobotState, Snapshot, State, StateStore


class Guard(Struct, frozen=True):
    """The result of a guard: whether the event may be selected, and must be if it is urgent.

    ``is_off`` holds if the guard is false, and does not fault, with all answers; ``is_on`` if it is
    true with all answers.
    """

    is_off: bool
    is_on: bool


class Effect(Struct, frozen=True):
    """The effect of an event on a robot and the store, as a function of the values read.

    ``status`` is the least that the robot's status is afterwards; ``entered`` has a bit for each
    lock class.
    """

    fault: Fault | None
    locals: tuple[tuple[int, Recipe], ...]  #: by slot
    ports: tuple[tuple[int, Recipe], ...]
    entries: tuple[tuple[int, Recipe], ...]
    status: int
    writes: tuple[PartRecipe, ...]
    updates: frozenset[int]
    entered: int
    answers: tuple[Answer, ...] = ()


class EventOf(Struct):
    """An event of one kind of robot, with the variables that it reads.

    ``asks`` and ``guard_asks`` say whether the event, or its guard alone, leaves something open.
    """

    event: core.Event
    kind: int
    position: int
    asks: bool
    guard_asks: bool
    reads: Reads
    guard_window: ReadWindow
    window: ReadWindow
    guards: Decisions[Guard] = field(default_factory=Decisions)
    effects: Decisions[Effect] = field(default_factory=Decisions)


class Effects:
    """The effects of a system's events."""

    def __init__(self, system: System, vault: StateStore) -> None:
        self._system = system
        self._vault = vault
        self._updates = rewritten(system.program)

    def event(self, kind: int, position: int) -> EventOf:
        """The record of an event of one kind of robot."""
        program = self._system.program
        event = program.agents[kind].events[position]
        guard = reads_of(program, event.guard)
        reads = together([guard, reads_of(program, event.effect)])
        return EventOf(
            event,
            kind,
            position,
            asks(program, event.guard) or asks(program, event.effect),
            asks(program, event.guard),
            reads,
            ReadWindow(self._vault, kind, guard),
            ReadWindow(self._vault, kind, reads),
        )

    # --- guards ---------------------------------------------------------------------------------

    def guard(self, of: EventOf, robot: int, state: State) -> Guard:
        """Evaluate an event's guard in a state."""
        if of.guard_asks:
            return self._asked_guard(of, robot, state)
        seen = of.guard_window.snapshot(robot, state)
        known = of.guards.find(seen.root, seen.codes)
        if known is None:
            d = self._looking(seen)
            before = of.guard_window.robot(robot, seen.root)
            inputs: Inputs[Any] = NoInputs()
            holds, sound = guard_of(d, self._system, robot, before, of.event, inputs)
            is_on = d.known(holds) is True
            known = Guard(not is_on and d.known(sound) is True, is_on)
            of.guards.keep(seen.root, seen.codes, d.seen, known)
        return known

    def _asked_guard(self, of: EventOf, robot: int, state: State) -> Guard:
        before = self._known(robot, state)
        results = [
            turn.outcome
            for turn in explored(
                lambda chooser: ExploringInputs(self._system, chooser),
                lambda inputs: guard_of(EXACT, self._system, robot, before, of.event, inputs),
            )
        ]
        return Guard(
            all(holds is not True and sound is True for holds, sound in results),
            all(holds is True for holds, _ in results),
        )

    def excuse(self, of: EventOf, robot: int, state: State) -> tuple[Answer, ...]:
        """Answers under which a guard does not hold, or None."""
        before = self._known(robot, state)
        turns = explored(
            lambda chooser: ExploringInputs(self._system, chooser),
            lambda inputs: guard_of(EXACT, self._system, robot, before, of.event, inputs),
        )
        return next(turn.given.answers for turn in turns if turn.outcome[0] is not True)

    # --- effects --------------------------------------------------------------------------------

    def effects(
        self, of: EventOf, robot: int, state: State
    ) -> Iterator[tuple[Effect, list[Codes]]]:
        """The possible effects of an event that may be selected, with the values read."""
        seen = of.window.snapshot(robot, state)
        if of.asks:
            for effect in self._asked(of, robot, state):
                yield effect, seen.codes
            return
        known = of.effects.find(seen.root, seen.codes)
        if known is None:
            d = self._looking(seen)
            before = of.window.robot(robot, seen.root)
            inputs: Inputs[Any] = NoInputs()
            selectable, turned = program_turn(d, self._system, robot, before, of.position, inputs)
            assert d.known(selectable) is True
            known = self._effect(d.known, of, robot, before, turned, ())
            of.effects.keep(seen.root, seen.codes, d.seen, known)
        yield known, seen.codes

    def _asked(self, of: EventOf, robot: int, state: State) -> Iterator[Effect]:
        before = self._known(robot, state)
        turns = explored(
            lambda chooser: ExploringInputs(self._system, chooser),
            lambda inputs: program_turn(EXACT, self._system, robot, before, of.position, inputs),
        )
        for turn in turns:
            selectable, turned = turn.outcome
            if selectable is True and all(x.condition is True for x in turned.legality):
                answers = turn.given.answers
                yield self._effect(EXACT.known, of, robot, before, turned, answers)

    def _effect(
        self,
        known: Any,
        of: EventOf,
        robot: int,
        before: Robot[Any],
        turned: Turned[Any],
        answers: tuple[Answer, ...],
    ) -> Effect:
        vault, after, kind = self._vault, turned.robot, of.kind
        fault = next(
            (fault for condition, fault in turned.faults if known(condition) is True), None
        )
        if fault is not None:
            return Effect(fault, (), (), (), 0, (), frozenset(), 0, answers)
        return Effect(
            None,
            self._changed(vault.locals[kind], before.locals, after.locals),
            self._changed(vault.ports[kind], before.ports, after.ports),
            tuple(self._entry(slot, after.copy.allread[slot], robot) for slot in turned.allread),
            int(known(after.status)),
            tuple(
                self._write(slot, before, after, mask)
                for slot, mask in sorted(turned.allwrite.items())
            ),
            self._updates.get((kind, of.position), frozenset()),
            sum(1 << k for k, condition in turned.entered.items() if known(condition) is True),
            answers,
        )

    def _changed(
        self,
        cells: Sequence[Cells],
        before: tuple[Storage[Any], ...],
        after: tuple[Storage[Any], ...],
    ) -> tuple[tuple[int, Recipe], ...]:
        """Recipes of the slots that were written: a write makes a new object."""
        return tuple(
            (slot, recipe(cells[slot], self._vault.scalars, new))
            for slot, (old, new) in enumerate(zip(before, after, strict=True))
            if old is not new
        )

    def _entry(self, slot: int, whole: Storage[Any], robot: int) -> tuple[int, Recipe]:
        assert isinstance(whole, Tree)
        cells = self._vault.entries[slot]
        return slot, recipe(cells, self._vault.scalars, whole.parts[robot])

    def _write(
        self, slot: int, before: Robot[Any], after: Robot[Any], mask: Mask[Any]
    ) -> PartRecipe:
        cells = self._vault.allwrite[slot]
        form, _ = cells.taken_apart(before.copy.allwrite[slot])
        view = after.copy.allwrite[slot]
        return part_recipe(slot, cells, self._vault.scalars, form, view, mask)

    # --- robots ---------------------------------------------------------------------------------

    def _looking(self, seen: Snapshot) -> LazyDomain:
        scalars = self._vault.scalars

        def look(place: PlaceOf) -> Constant:
            return scalars.value(seen.codes[place.variable][place.position], place.type)

        return LazyDomain(look)

    def _known(self, robot: int, state: State) -> Robot[Constant]:
        """The robot as it is, but running: an event's effect does not depend on the status."""
        vault = self._vault
        made = vault.state_of(state[robot], vault.store(state))
        return replace(made, status=int(Status.RUNNING))

    # --- what becomes of things -----------------------------------------------------------------

    def followed(self, own: RobotState, event: int, effect: Effect, codes: list[Codes]) -> int:
        """The number of the robot after an event."""
        vault, kind = self._vault, own.kind
        return vault.robots.number(
            RobotState(
                kind,
                _put(vault.locals[kind], own.locals, effect.locals, codes),
                _put(vault.ports[kind], own.ports, effect.ports, codes),
                _put(vault.entries, own.entries, effect.entries, codes),
                max(own.status, effect.status),
                event if vault.tracks_ran else NO_EVENT,
            )
        )

    def parts(self, effect: Effect, codes: list[Codes]) -> tuple[VariableEffect, ...]:
        """The writes of an event to allwrite variables."""
        return tuple([write.part(self._vault.scalars, codes) for write in effect.writes])


def _put(
    cells: Sequence[Cells],
    numbers: tuple[int, ...],
    changed: tuple[tuple[int, Recipe], ...],
    codes: list[Codes],
) -> tuple[int, ...]:
    if not changed:
        return numbers
    listed = list(numbers)
    for slot, made in changed:
        listed[slot] = cells[slot].numbered(made.form, made.codes(codes))
    return tuple(listed)
