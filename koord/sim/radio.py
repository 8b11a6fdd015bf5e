"""Ranges of communication: who hears whom, and who agrees on rounds. [ENV-RANGE]

Two robots hear each other if they are no further apart than the range. If rounds are agreed on by
radio, messages go from robot to robot, and those take part whom more than half of all robots can
reach: the others skip, as who is late does in a deployed run. [SKIP] [T-SKIP]
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from msgspec import Struct

from koord.runtime.engine import Schedule
from koord.runtime.motion.arrays import Bools, Floats
from koord.runtime.proposals import Proposal
from koord.runtime.robot import Robot


class Radio(Struct, frozen=True):
    """The radios of a fleet: their range in metres, and whether rounds are agreed on by them."""

    range_m: float = math.inf
    carries_rounds: bool = False


class Reception:
    """Who hears whom in a fleet, where its robots were measured last."""

    def __init__(self, radio: Radio, positions: Floats) -> None:
        """Measure a fleet; ``positions`` are in metres, shape ``(n, 3)``."""
        self.radio = radio
        self._rows: dict[int, tuple[Bools, tuple[bool, ...]]] = {}
        self._members: Bools | None = None
        self.measure(positions)

    def measure(self, positions: Floats) -> None:
        """Take note of where robots are now."""
        self._positions = positions.copy()
        self._members = None

    def heard(self, robot: int) -> tuple[bool, ...]:
        """For each robot, whether this one hears it; the same object as long as nothing changes."""
        row = self._row(robot)
        known = self._rows.get(robot)
        if known is None or not np.array_equal(known[0], row):
            known = self._rows[robot] = row, tuple(row.tolist())
        return known[1]

    @property
    def members(self) -> Bools:
        """A mask of the robots that can agree: those of a part with more than half of them all."""
        if self._members is None:
            self._members = self._majority()
        return self._members

    def _row(self, robot: int) -> Bools:
        gaps = self._positions - self._positions[robot]
        row: Bools = np.einsum("ij,ij->i", gaps, gaps) <= self.radio.range_m**2
        row[robot] = False
        return row

    def _majority(self) -> Bools:
        count = len(self._positions)
        unseen = np.ones(count, np.bool_)
        nobody = np.zeros(count, np.bool_)
        while unseen.sum() > count // 2:
            part = self._part(int(np.argmax(unseen)))
            if part.sum() > count // 2:
                return part
            unseen &= ~part
        return nobody

    def _part(self, first: int) -> Bools:
        """A mask of all robots that one can reach, itself included."""
        part = np.zeros(len(self._positions), np.bool_)
        part[first] = True
        open_ = [first]
        while open_:
            new = self._row(open_.pop()) & ~part
            part |= new
            open_ += np.flatnonzero(new).tolist()
        return part


class OverRadio(Struct):
    """A schedule under which proposals of robots that are out of reach arrive too late. [SKIP]"""

    inner: Schedule
    reception: Reception

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        return self.inner.order(round_, robots)

    def events(self, robot: Robot) -> Iterable[int] | None:
        return self.inner.events(robot)

    def willing(self, robot: Robot) -> bool:
        return self.inner.willing(robot)

    def hears(self, proposal: Proposal) -> bool:
        return bool(self.reception.members[proposal.robot]) and self.inner.hears(proposal)
