"""Recordings of runs whose program changes: numbers of variables and events go on. [RELOAD]

What is in a recording stays what it was: what a new program has besides gets the next numbers.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Hashable
from typing import TypeVar

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from koord.sim.packing import shape_of
from koord.sim.run_log import (
    SHARED,
    Declared,
    Deeds,
    Header,
    LoggedAgent,
    LoggedChange,
    LoggedVariable,
    RunLog,
)

T = TypeVar("T")


class Numbering(Struct, frozen=True):
    """The numbers in a recording of what a program counts by itself."""

    declared: Declared
    events: tuple[NDArray[np.int16], ...]  #: of each agent, by position
    agents: NDArray[np.int64]  #: of each robot

    def change(self, change: LoggedChange) -> LoggedChange:
        """A change of a variable that the program counts."""
        shared, agents = self.declared.shared, self.declared.agents
        of = shared if change.robot == SHARED else agents[self.agents[change.robot]]
        return change._replace(variable=of[change.variable])

    def deeds(self, deeds: Deeds) -> Deeds:
        """What robots did, by events that the program counts."""
        found = deeds.copy()
        for pid in np.flatnonzero(deeds >= 0).tolist():
            found[pid] = self.events[self.agents[pid]][deeds[pid]]
        return found


def declared_in(recording: RunLog) -> Declared:
    """The variables of the program that a recording is at."""
    if recording.reloads:
        return recording.reloads[-1].has
    header = recording.header
    agents = tuple(tuple(range(len(agent.variables))) for agent in header.agents)
    return Declared(tuple(range(len(header.shared))), agents)


def extended(header: Header, new: Header) -> tuple[Header, Numbering]:
    """The header with what another program has besides, and the numbers of all that it has.

    ``new`` is the header that a run of the other program would have.
    """
    shared, of_shared = _joined(header.shared, new.shared, _key)
    agents, of_agents, of_events = [], [], []
    for known, one in zip(header.agents, new.agents, strict=True):
        variables, numbers = _joined(known.variables, one.variables, _key)
        events, positions = _joined(known.events, one.events, _itself)
        agents.append(LoggedAgent(one.name, events, variables))
        of_agents.append(numbers)
        of_events.append(np.array(positions, np.int16))
    kinds = np.array([robot.agent for robot in header.robots], np.int64)
    numbering = Numbering(Declared(of_shared, tuple(of_agents)), tuple(of_events), kinds)
    return replace(header, agents=tuple(agents), shared=shared), numbering


def _joined(
    known: tuple[T, ...], more: tuple[T, ...], key: Callable[[T], Hashable]
) -> tuple[tuple[T, ...], tuple[int, ...]]:
    """What is known with what is new behind it, and the numbers of ``more`` in there."""
    numbers = {key(one): number for number, one in enumerate(known)}
    every = list(known)
    for one in more:
        if key(one) not in numbers:
            numbers[key(one)] = len(every)
            every.append(one)
    return tuple(every), tuple(numbers[key(one)] for one in more)


def _key(variable: LoggedVariable) -> Hashable:
    """The same for variables that are the same: each program has its own classes of records."""
    return variable.name, variable.home, json.dumps(shape_of(variable.shape))


def _itself(name: str) -> Hashable:
    return name
