"""Logs of rounds that code made, and the steps that they stand for. [EVENT-TRANS] [SKIP]"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, TypeAlias

from msgspec import Struct

from koord.sampling.compiled.round_ends import ended, opened
from koord.sampling.compiled.round_turns import UNWRITTEN
from koord.sampling.compiled.state import State, StateColumn
from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store, Turn, Written
from koord.semantics.domain import Constant
from koord.semantics.storage import Storage, Tree
from koord.syntax.core import Home


class TurnEntry(NamedTuple):
    """A program turn in a log, which has plain tuples of these parts.

    ``event`` is None for a skip, and ``lost`` the event that lost its lock. ``data`` has what
    columns held before and after, one after the other; ``copies`` what the robot now has as its
    copies of the variables that any robot writes, of those that the event may write.
    """

    robot: int
    event: int | None
    lost: int | None
    data: tuple[Any, ...]
    copies: tuple[Any, ...]
    written: tuple[Written[Constant], ...]
    taken: frozenset[int]


#: A column, an index, and what it held there before and after.
ColumnChange: TypeAlias = tuple[StateColumn, int, Any, Any]


class Columns(Struct, frozen=True):
    """The columns that turns write, in the order of their data: by kind and event, and by kind."""

    of_events: Mapping[tuple[int, int], tuple[StateColumn, ...]]
    of_environments: Mapping[int, tuple[StateColumn, ...]]


class RoundLog(Struct, frozen=True):
    """What a round did: its program turns, and what models did at each robot after them."""

    turns: tuple[Any, ...] = ()
    environment: tuple[tuple[int, tuple[Any, ...]], ...] = ()


class LoggedState(Struct, frozen=True):
    """A state with the columns that logs are about."""

    state: State
    columns: Columns

    def _changes(self, log: RoundLog) -> Iterator[ColumnChange]:
        """What was changed, one after the other."""
        for turn in log.turns:
            yield from self.of_turn(turn)
        yield from self.of_environment(log)

    def of_turn(self, turn: Any) -> list[ColumnChange]:
        """What a program turn changed."""
        robot, event, _, data, *_ = turn
        if event is None:
            return []
        kind = self.state.system.kinds[robot]
        return _paired(self.columns.of_events[kind, event], robot, data)

    def of_environment(self, log: RoundLog) -> list[ColumnChange]:
        """What models changed."""
        kinds, columns = self.state.system.kinds, self.columns.of_environments
        found = []
        for robot, data in log.environment:
            found += _paired(columns[kinds[robot]], robot, data)
        return found

    def undo(self, log: RoundLog) -> None:
        """Let the columns hold what they did before."""
        for column, index, old, _ in reversed(list(self._changes(log))):
            column.values[index] = old

    def redo(self, log: RoundLog) -> None:
        """Let the columns hold again what was undone."""
        for column, index, _, new in self._changes(log):
            column.values[index] = new

    def turns(
        self, before: Configuration[Constant], log: RoundLog
    ) -> Iterator[tuple[TurnEntry, Configuration[Constant]]]:
        """The program turns of a round, with the configurations after them."""
        for made in log.turns:
            turn = TurnEntry(*made)
            before = self._after(before, turn)
            yield turn, before

    def _after(self, before: Configuration[Constant], turn: TurnEntry) -> Configuration[Constant]:
        state = before.robots[turn.robot]
        robots, store = opened(before.robots), before.store
        if turn.event is None:
            after = Robot(
                state.kind, state.locals, state.ports, state.copy, state.status, NO_EVENT, Turn.ENV
            )
        else:
            after, store = self._ran(state, store, turn)
        robots = (*robots[: turn.robot], after, *robots[turn.robot + 1 :])
        return ended(before, robots, store, turn.taken)

    def _ran(
        self, state: Robot[Constant], store: Store[Constant], turn: TurnEntry
    ) -> tuple[Robot[Constant], Store[Constant]]:
        assert turn.event is not None
        own = {Home.LOCAL: list(state.locals), Home.PORT: list(state.ports)}
        shared = {Home.ALLREAD: list(store.allread), Home.ALLWRITE: list(store.allwrite)}
        copy = {Home.ALLREAD: list(state.copy.allread), Home.ALLWRITE: list(state.copy.allwrite)}
        status, copies = state.status, iter(turn.copies)
        columns = self.columns.of_events[state.kind, turn.event]
        for column, _, old, new in _paired(columns, turn.robot, turn.data):
            slot = column.slots[0 if column.home is Home.ALLWRITE else turn.robot]
            assert slot is not None
            match column.home:
                case None:
                    status = new
                case Home.ALLREAD:
                    if new is not old:
                        for one in (shared, copy):
                            one[Home.ALLREAD][slot] = self._entry(
                                one[Home.ALLREAD][slot], turn.robot, self._storage(column, new)
                            )
                case Home.ALLWRITE:
                    mine = next(copies)
                    if mine is not UNWRITTEN:
                        copy[Home.ALLWRITE][slot] = self._storage(column, mine)
                        shared[Home.ALLWRITE][slot] = self._storage(column, new)
                case home:
                    if new is not old:
                        own[home][slot] = self._storage(column, new)
        return Robot(
            state.kind,
            tuple(own[Home.LOCAL]),
            tuple(own[Home.PORT]),
            Store(*map(tuple, copy.values())),
            status,
            turn.event,
            Turn.ENV,
        ), Store(*map(tuple, shared.values()))

    def _storage(self, column: StateColumn, value: Any) -> Storage[Constant]:
        return column.storage(self.state.d, value, self.state.system.robots)

    @staticmethod
    def _entry(
        entries: Storage[Constant], robot: int, storage: Storage[Constant]
    ) -> Tree[Constant]:
        assert isinstance(entries, Tree)
        parts = entries.parts
        return Tree((*parts[:robot], storage, *parts[robot + 1 :]))


def _paired(
    columns: tuple[StateColumn, ...], robot: int, data: tuple[Any, ...]
) -> list[ColumnChange]:
    values = iter(data)
    return [
        (column, 0 if column.home is Home.ALLWRITE else robot, old, new)
        for column, old, new in zip(columns, values, values, strict=True)
    ]
