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

#: Of so many robots it is looked at once who hears whom; of more, robot by robot.
_MANY = 200


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
        self._whole: Bools | None = None  #: who hears whom, a row for each robot
        self._is_looked_at = False
        self.measure(positions)

    def measure(self, positions: Floats) -> None:
        """Take note of where robots are now."""
        self._positions = positions.copy()
        self._members, self._is_looked_at = None, False

    def heard(self, robot: int) -> tuple[bool, ...]:
        """For each robot, whether this one hears it; the same object as long as nothing changes."""
        if len(self._positions) <= _MANY:
            self._look()
        else:
            self._know(robot, self._row(robot))
        return self._rows[robot][1]

    @property
    def members(self) -> Bools:
        """A mask of the robots that can agree: those of a part with more than half of them all."""
        if self._members is None:
            self._members = self._majority()
        return self._members

    def _look(self) -> None:
        """Look at who hears whom, if nobody has since robots were measured."""
        if self._is_looked_at:
            return
        self._is_looked_at, count = True, len(self._positions)
        gaps = (self._positions[None] - self._positions[:, None]).reshape(-1, 3)
        whole = self._near(gaps).reshape(count, count)
        whole[np.diag_indices(count)] = False
        if self._whole is None or not np.array_equal(whole, self._whole):
            self._whole = whole
            for robot in range(count):
                self._know(robot, whole[robot])

    def _know(self, robot: int, row: Bools) -> None:
        """Note whom a robot hears; as long as nothing changes it is the same object."""
        known = self._rows.get(robot)
        if known is None or not np.array_equal(known[0], row):
            self._rows[robot] = row, tuple(row.tolist())

    def _row(self, robot: int) -> Bools:
        row = self._near(self._positions - self._positions[robot])
        row[robot] = False
        return row

    def _near(self, gaps: Floats) -> Bools:
        found: Bools = np.einsum("ij,ij->i", gaps, gaps) <= self.radio.range_m**2
        return found

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
