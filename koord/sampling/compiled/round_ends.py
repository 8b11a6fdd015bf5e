"""How a round begins and ends for all robots, as the rules say. [EVENT-TRANS] [END-PROG] [STOP]"""

from __future__ import annotations

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store, Turn
from koord.semantics.domain import Constant
from koord.syntax.system import Status


def opened(robots: tuple[Robot[Constant], ...]) -> tuple[Robot[Constant], ...]:
    """The robots at the start of a turn: a round's first turn clears ``ran``. [EVENT-TRANS]"""
    for state in robots:
        if state.turn is Turn.ENV:
            return robots
    return tuple(
        state
        if state.ran == NO_EVENT
        else Robot(
            state.kind,
            state.locals,
            state.ports,
            state.copy,
            state.status,
            NO_EVENT,
            state.turn,
        )
        for state in robots
    )


def ended(
    before: Configuration[Constant],
    robots: tuple[Robot[Constant], ...],
    store: Store[Constant],
    taken: frozenset[int],
) -> Configuration[Constant]:
    """Begin the environment's turn once every robot has had its own. [END-PROG] [STOP]"""
    turn = Turn.ENV
    for state in robots:
        if state.turn is Turn.PROG:
            turn = before.turn
            break
    else:
        if all(state.status != Status.RUNNING for state in robots):
            stopped = int(Status.STOPPED)
            robots = tuple(
                Robot(s.kind, s.locals, s.ports, s.copy, stopped, s.ran, s.turn) for s in robots
            )
    return Configuration(robots, store, before.round, turn, taken, before.fault)
