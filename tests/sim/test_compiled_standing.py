"""Machine code of the watchman: it notes and tells what NumPy does."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from koord.runtime.motion.automaton import MotionState
from koord.runtime.motion.bodies import Car, PlannerName
from koord.runtime.motion.planning import Hindrance, Plight
from koord.runtime.motion.world import World
from koord.sim.sensing import FleetSensors
from koord.sim.standing import StandingRobot, Watchman
from koord.sim.standing_kernel import CompiledWatchman

#: How far robots go in a round: among others just as far as counts, and a little more or less.
STEPS = (0.0, 0.01, 0.0125, 0.05, float(np.nextafter(0.05, 1)), float(np.nextafter(0.05, 0)), 0.3)

#: Of robots in some rounds: states, who has stopped, how far each is from its goal, and its steps.
ROBOT = st.tuples(
    st.sampled_from(list(MotionState)),
    st.sampled_from([False, False, False, True]),
    st.sampled_from([1.0, 0.04, 0.05, 0.0]),
    st.sampled_from(STEPS),
    st.sampled_from([None, None, None, None, Hindrance.NO_WAY]),
)
SPELLS = st.lists(
    st.tuples(st.lists(ROBOT, min_size=3, max_size=3), st.integers(1, 70)), min_size=1, max_size=4
)

GOING = (MotionState.MOVING, False, 1.0)


class Watched:
    """What a watchman tells of rounds, and what it has noted then."""

    def __init__(self, kind: type[Watchman]) -> None:
        self.watchman = kind(World(), [Car()] * 3)
        self.told: list[StandingRobot] = []
        self.noted: list[Any] = []

    def round(self, number: int, sensed: FleetSensors, stopped: Any, places: Any) -> None:
        one = self.watchman
        times = number / 10, (number + 1) / 10
        self.told += one.round(*times, sensed, stopped, places, lambda robot: ())
        lingering = one._lingering.since_s.tobytes(), one._lingering.at.tobytes()
        self.noted.append((one.still_s, one.sees_some_go, *lingering))


@given(SPELLS)
@example([([(*GOING, step, None) for step in STEPS[:3]], 70)])
@example([([(*GOING, step, None) for step in STEPS[3:6]], 70)])
def test_both_tell_and_note_the_same(spells: list[tuple[list[tuple[Any, ...]], int]]) -> None:
    one, other = Watched(Watchman), Watched(CompiledWatchman)
    number, along = 0, np.zeros(3)
    for robots, rounds in spells:
        states, stopped, short_m, steps, hindrances = map(list, zip(*robots, strict=True))
        plights = {k: Plight(why) for k, why in enumerate(hindrances) if why is not None}
        for k in range(rounds):
            along = along + np.array(steps) * (1 if k % 2 else -1)
            places = np.array([(x, 5.0 * row, 0.0) for row, x in enumerate(along)])
            sensed = FleetSensors(
                places,
                np.zeros(3),
                np.zeros(3, np.bool_),
                np.array(states, np.int64),
                np.array(short_m),
                (PlannerName.STRAIGHT,) * 3,
                plights,
            )
            for each in (one, other):
                each.round(number, sensed, np.array(stopped, np.bool_), places)
            number += 1
    assert one.told == other.told
    assert one.noted == other.noted


@pytest.mark.parametrize("kind", [Watchman, CompiledWatchman])
def test_who_makes_no_headway_is_told(kind: type[Watchman]) -> None:
    watched = Watched(kind)
    states = np.full(3, MotionState.MOVING, np.int64)
    for k in range(60):
        places = np.array([(0.01 * k, 0.0, 0.0), (0.0, 5.0, 0.0), (0.0001 * k, 9.0, 0.0)])
        sensed = FleetSensors(
            places, np.zeros(3), np.zeros(3, np.bool_), states, np.ones(3), (), {}
        )
        watched.round(k, sensed, np.zeros(3, np.bool_), places)
    assert [(one.robot, one.since_s) for one in watched.told] == [(1, 0.0), (2, 0.0)]
