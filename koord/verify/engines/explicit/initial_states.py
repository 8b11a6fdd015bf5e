"""Enumeration of all initial configurations. [INIT] [PROP-ASSUME]"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

from msgspec import Struct

from koord.semantics.configurations import Fault, Store
from koord.semantics.domain import EXACT, Constant
from koord.semantics.recordings import Opening
from koord.semantics.turns import declared, initial_turn
from koord.syntax.system import System
from koord.traces.enumeration import ExploringInputs, Given, explored
from koord.verify.engines.explicit.commits import NOTHING, Commits
from koord.verify.engines.explicit.finiteness import known_starts
from koord.verify.engines.explicit.recipes import parts_written
from koord.verify.engines.explicit.states import State, StateStore


class _Beginning(Struct, frozen=True):
    """A possible INIT turn of one robot."""

    robot: int  #: the robot's number after it
    write: int
    fault: Fault | None
    given: Given


class InitialState(Struct, frozen=True):
    """A possible INIT of the system, whether or not the assumptions hold after it."""

    state: State
    is_faulted: bool
    _order: tuple[int, ...]
    _given: tuple[Given, ...]

    def opening(self) -> Opening:
        """The recording of this INIT."""
        robots = tuple(range(len(self._given) - 1))
        order = (*self._order, *(i for i in robots if i not in self._order))
        return Opening(
            order,
            tuple(start for given in self._given for start in given.starts),
            tuple(answer for given in self._given for answer in given.answers),
        )


def openings(system: System, vault: StateStore, commits: Commits) -> Iterator[InitialState]:
    """Yield every possible INIT."""
    starting = known_starts(system)
    stores = explored(
        lambda chooser: ExploringInputs(system, chooser, starting),
        lambda inputs: declared(EXACT, system, inputs),
    )
    for found in stores:
        store, faults = found.outcome
        is_faulted = any(condition is True for condition, _ in faults)
        beginnings = [
            list(_beginnings(system, vault, commits, robot, store))
            for robot in range(system.robots)
        ]
        for chosen in product(*beginnings):
            yield from _opened(vault, commits, store, found.given, chosen, is_faulted=is_faulted)


def _opened(
    vault: StateStore,
    commits: Commits,
    store: Store[Constant],
    given: Given,
    chosen: tuple[_Beginning, ...],
    *,
    is_faulted: bool,
) -> Iterator[InitialState]:
    writers = tuple(i for i, each in enumerate(chosen) if each.write != NOTHING)
    robots = tuple(each.robot for each in chosen)
    is_faulted = is_faulted or any(each.fault is not None for each in chosen)
    all_given = (given, *(each.given for each in chosen))
    writes = tuple(chosen[i].write for i in writers)
    for end in commits.ends(vault.shared(store), writes):
        order = tuple(writers[position] for position in end.order)
        yield InitialState((*robots, *end.shared), is_faulted, order, all_given)


def _beginnings(
    system: System, vault: StateStore, commits: Commits, robot: int, store: Store[Constant]
) -> Iterator[_Beginning]:
    starting = known_starts(system)
    turns = explored(
        lambda chooser: ExploringInputs(system, chooser, starting),
        lambda inputs: initial_turn(EXACT, system, robot, store, inputs),
    )
    for turn in turns:
        turned = turn.outcome
        if all(x.condition is True for x in turned.legality):
            fault = next((fault for condition, fault in turned.faults if condition is True), None)
            number = vault.robot(robot, turned.robot)
            write = commits.number(parts_written(vault, store, turned))
            yield _Beginning(number, write, fault, turn.given)
