"""The log of a fleet that moves elsewhere, made of what its robots tell: for the page of a run.

Robots tell where they are a few times a second, and once a round their state when it began. Time is
that of the machine's monotonic clock, from when the first robot told anything.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from msgspec import Struct

from koord.runtime.deploy.news import News, PoseReport, RoundReport
from koord.runtime.engine import Shown
from koord.runtime.motion.arrays import Floats, Ints
from koord.runtime.motion.geometry import as_path, headings_of
from koord.runtime.robot import Robot
from koord.runtime.store import AgreedStore
from koord.sim.measuring import TaskGauge
from koord.sim.observing import Observer
from koord.sim.run_log import Deeds, Header, Idle, RunLog, RunLogger, tilts_of
from koord.sim.separation import Nearby

#: A robot that has told nothing for so long is shown where it was.
_SILENT_S = 1.0


class _Poses:
    """Where robots were at the time that is logged; unknown ones are where they begin."""

    def __init__(self, starts: Sequence[tuple[float, float, float]]) -> None:
        count = len(starts)
        self.now_s = 0.0
        self._positions = np.array(starts, np.float64).reshape(count, 3)
        self._attitudes = np.zeros((count, 4))
        self._attitudes[:, 0] = 1.0
        self._paths: list[Floats] = [np.zeros((0, 3))] * count
        self._given = np.zeros(count, np.int64)

    def take(self, report: PoseReport) -> None:
        """Put a robot where it says that it was."""
        pid = report.pid
        self._positions[pid], self._attitudes[pid] = report.position, report.attitude
        if report.path is not None:
            self._paths[pid] = as_path(report.path)
            self._given[pid] += 1

    def positions(self) -> Floats:
        return self._positions

    def headings(self) -> Floats:
        return headings_of(self._attitudes)

    def tilts(self, robots: Ints) -> Floats:
        return tilts_of(self._attitudes[robots])

    def paths_given(self) -> Ints:
        return self._given.copy()

    def paths(self, robots: Ints) -> list[Floats]:
        return [self._paths[robot] for robot in robots.tolist()]


class _Rounds(Struct):
    """What robots and their store are after the round that is logged."""

    robots: Sequence[Robot]
    store: AgreedStore
    shown: list[Shown]
    round: int = -1
    ended: None = None


class FleetMirror:
    """The log of a fleet, which grows with what its robots tell."""

    def __init__(
        self,
        header: Header,
        starts: Sequence[tuple[float, float, float]],
        robots: Sequence[Robot],
        store: AgreedStore,
    ) -> None:
        """Make a log; ``robots`` and ``store`` are in the state of the rounds that are shown."""
        self._logger = RunLogger(header)
        self._poses = _Poses(starts)
        self._rounds = _Rounds(robots, store, [])
        self._observer = Observer(self._logger, self._rounds, self._poses)
        visit_m = [header.visit_m] * len(robots)
        self._tasks = TaskGauge(type(robots[0]), self._logger, visit_m)
        self._nearby = Nearby()
        self._untaken: list[PoseReport] = []
        self._told: dict[int, dict[int, RoundReport]] = {}
        self._last_s = [-math.inf] * len(robots)
        self._begun_s: float | None = None
        self._said: set[tuple[int, str]] = set()

    @property
    def log(self) -> RunLog:
        """The log so far."""
        return self._logger.recording

    def hear(self, news: Iterable[News]) -> None:
        """Take what robots tell, and log the poses that are complete by now."""
        for one in news:
            self._untaken += one.poses
            for told in one.rounds:
                self._told.setdefault(told.round, {})[told.pid] = told
            for pose in one.poses:
                self._last_s[pose.pid] = max(self._last_s[pose.pid], pose.at_s)
        if self._untaken:
            self._log_poses()

    def _log_poses(self) -> None:
        self._untaken.sort(key=lambda one: one.at_s)
        newest_s = self._untaken[-1].at_s
        if self._begun_s is None:
            self._begun_s = self._untaken[0].at_s
            self._last_s = [max(self._begun_s, last_s) for last_s in self._last_s]
        heard = [last_s for last_s in self._last_s if last_s > newest_s - _SILENT_S]
        complete_s = min(heard)
        taken = 0
        for one in self._untaken:
            if one.at_s > complete_s:
                break
            taken += 1
            self._poses.take(one)
            now_s = one.at_s - self._begun_s
            if now_s >= self._poses.now_s:
                self._poses.now_s = now_s
                positions = self._poses.positions()
                self._tasks.note_visits(positions, now_s)
                near = self._nearby.nearest(positions)
                apart_m = math.nan if near is None else near.distance_m
                self._observer.tick(self._poses, apart_m)
        del self._untaken[:taken]

    def begun(self, round_: int) -> None:
        """Log the round before one of which all states are known: robots have them now."""
        for number in sorted(one for one in self._told if one < round_):
            self._log_round(number, self._told.pop(number))

    def violated(self, claim: str, words: str, robots: Sequence[int]) -> None:
        """Log that a claim did not hold."""
        place = None
        if robots:
            x, y, z = self._poses.positions()[robots[0]].tolist()
            place = x, y, z
        self._logger.violation(self._poses.now_s, claim, words, robots, place)

    def remark(self, robot: int, words: str) -> None:
        """Log why a robot does not move, once."""
        if (robot, words) not in self._said:
            self._said.add((robot, words))
            self._logger.standing(self._poses.now_s, robot, self._poses.now_s, words)

    def end(self, words: str) -> None:
        """Log the end, with all that was told and is not logged yet."""
        for number in sorted(self._told):
            self._log_round(number, self._told.pop(number))
        self._logger.end(words)

    def _log_round(self, number: int, told: dict[int, RoundReport]) -> None:
        of, header = self._rounds, self._logger.recording.header
        deeds: Deeds = np.full(len(header.robots), int(Idle.SKIPPED), np.int16)
        for pid, report in sorted(told.items()):
            if report.event is not None:
                deeds[pid] = header.agents[header.robots[pid].agent].events.index(report.event)
            if report.output:
                of.shown.append(Shown(number, pid, report.output))
        of.round = number
        at_s = max(one.at_s for one in told.values()) - (self._begun_s or 0.0)
        last = self._logger.recording.rounds
        time_s = max(at_s, last[-1].time_s if last else 0.0)
        self._observer.round(number, deeds, time_s)
        self._tasks.note_assigned(of.store.values, time_s)
