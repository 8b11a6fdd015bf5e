"""The motion automaton: idle, planning, moving, holding or stopped. (paper, III-D)

One step is a pure function of arrays over robots; a deployed robot runs it with one robot, the
simulator with thousands. *Visited* is the paper's (II-A): a robot that has stayed within ε_v of the
end of its route for the time δ_v has ``reached`` it. A robot that was not told anything yet has
nothing left to reach, so it has reached as well.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Bools, Floats, Ints, lengths

#: Times are sums of steps; what is missing by rounding does not count.
ROUNDING_S = 1e-9


class MotionState(IntEnum):
    """The states of the motion automaton."""

    IDLE = 0  #: nothing to do; it stays where it is
    PLANNING = 1  #: it was given a target and has no path yet; it stays where it is
    MOVING = 2  #: it follows its route
    HOLDING = 3  #: it was told to hold; it remembers its route
    STOPPED = 4  #: for good


class Visit(Struct, frozen=True):
    """The visit criterion: within ``epsilon_m`` of a place for ``dwell_s`` seconds."""

    epsilon_m: float = 0.2  #: ε_v
    dwell_s: float = 0.5  #: δ_v

    @property
    def leave_m(self) -> float:
        """The distance in metres beyond which a pushed robot has left the place that it reached."""
        return 2 * self.epsilon_m


class Automata(Struct, frozen=True):
    """The states of robots' automata; every array has one entry per robot."""

    state: Ints
    since_s: Floats  #: since when it is within ε_v of the end without a break; NaN: it is not
    reached: Bools
    has_route: Bools
    resumes: Ints  #: what a robot that holds goes back to


class Orders(Struct, frozen=True):
    """Orders since the last step, as masks over robots. Later fields take precedence."""

    asked: Bools  #: a target was given, for which a path is to be planned
    routed: Bools  #: a route was given, or planned
    failed: Bools  #: no way to the target was found
    held: Bools  #: told to hold
    released: Bools  #: told to go on
    stopped: Bools  #: told to stop


def initial(count: int) -> Automata:
    """Automata of robots that have no orders yet."""
    idle = np.full(count, MotionState.IDLE, np.int64)
    no = np.zeros(count, np.bool_)
    return Automata(idle, np.full(count, np.nan), ~no, no, idle)


def no_orders(count: int) -> Orders:
    """Empty orders; the masks are the caller's to write to."""
    return Orders(*(np.zeros(count, np.bool_) for _ in range(6)))


def step(
    automata: Automata, orders: Orders, psn: Floats, end: Floats, now_s: float, visit: Visit
) -> Automata:
    """Step the automata on orders and a measurement at a time.

    ``psn`` are the measured positions and ``end`` the ends of the routes, shape ``(count, 3)``.
    """
    state, reached = automata.state.copy(), automata.reached.copy()
    since, has_route = automata.since_s.copy(), automata.has_route.copy()
    resumes = automata.resumes.copy()
    alive = state != MotionState.STOPPED
    holding = state == MotionState.HOLDING
    for mask, becomes in (
        (orders.asked, MotionState.PLANNING),
        (orders.routed, MotionState.MOVING),
        (orders.failed, MotionState.IDLE),
    ):
        if not mask.any():
            continue
        told = mask & alive
        state[told & ~holding] = becomes
        resumes[told & holding] = becomes
        reached[told], since[told] = False, np.nan
        has_route[told] = becomes is MotionState.MOVING
    if orders.held.any():
        begins = orders.held & alive & ~holding
        resumes[begins] = state[begins]
        state[begins] = MotionState.HOLDING
    if orders.released.any():
        goes_on = orders.released & (state == MotionState.HOLDING) & ~orders.held
        state[goes_on] = resumes[goes_on]
    if orders.stopped.any():
        state[orders.stopped] = MotionState.STOPPED

    distance, runs = lengths(psn - end), state != MotionState.STOPPED
    inside = has_route & (distance <= visit.epsilon_m) & runs
    since = np.where(inside, np.where(np.isnan(since), now_s, since), np.nan)
    dwelt = inside & (now_s - since >= visit.dwell_s - ROUNDING_S)
    here = ~has_route | (distance <= visit.leave_m)
    reached = (reached | dwelt) & here & runs
    state[(state == MotionState.MOVING) & reached] = MotionState.IDLE
    state[(state == MotionState.IDLE) & has_route & ~reached] = MotionState.MOVING
    return Automata(state, since, reached, has_route, resumes)


def moves(automata: Automata) -> Bools:
    """A mask of the robots that follow their routes now; the others stay where they are."""
    moving: Bools = (automata.state == MotionState.MOVING) | (
        (automata.state == MotionState.IDLE) & automata.has_route
    )
    return moving
