"""Hearing: the reports of all robots of a run, by subject, and what they leave open. [RECORDING]"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from msgspec import Struct, field

from koord.refinement.reports import (
    Acted,
    Began,
    Coordinated,
    GaveUp,
    Kept,
    Left,
    Missed,
    Sensed,
    Stood,
    Stumbled,
    Told,
    TurnAnswers,
    Undeclared,
    round_of,
)
from koord.runtime.proposals import INIT_ROUND, Decision, EventFault
from koord.semantics.configurations import Robot, Written
from koord.semantics.domain import Constant
from koord.semantics.oracle import Key, Phase
from koord.semantics.recordings import Answer, Reading, Start
from koord.syntax.core import Home
from koord.syntax.diagnostics import KoordError


class DisagreementError(Exception):
    """Raised where two robots acted on different decisions of a round, or started differently."""

    def __init__(self, round_: int, robots: tuple[int, int], what: str) -> None:
        one, other = robots
        whose = f"robots {one} and {other}" if one != other else f"robot {one}, told twice,"
        where = "INIT" if round_ == INIT_ROUND else f"round {round_ + 1}"
        super().__init__(f"{whose} {what} in {where}")
        self.round, self.robots = round_, robots


class Coverage(Struct, frozen=True):
    """What robots have told of a run, all in all.

    The run had at least so many ``rounds``. ``unseen`` are robots that ran in a round of which they
    tell nothing, or whose reports of it may be missing, each with the first such round (-1: INIT).
    """

    rounds: int
    unseen: Mapping[int, int]


class Heard(Struct):
    """The reports of all robots, by subject. Of duplicates the last counts."""

    decisions: dict[int, Decision] = field(default_factory=dict)
    starts: dict[tuple[Home, int, int | None], Start] = field(default_factory=dict)
    answers: dict[int, dict[tuple[Phase, int, Key], Answer]] = field(default_factory=dict)
    readings: dict[int, dict[tuple[int, int], Reading]] = field(default_factory=dict)
    stood: dict[tuple[int, int], Robot[Constant]] = field(default_factory=dict)
    stumbled: dict[tuple[int, int], EventFault] = field(default_factory=dict)
    written: dict[tuple[int, int], tuple[Written[Constant], ...]] = field(default_factory=dict)
    undeclared: bool = False
    gave_up: KoordError | None = None
    #: Who was the first to tell of a decision, or of a start; and who told anything.
    first: dict[int | tuple[Home, int, int | None], int] = field(default_factory=dict)
    tellers: set[int] = field(default_factory=set)
    last: dict[int, int] = field(default_factory=dict)  #: the round that each told of last
    gaps: dict[int, int] = field(default_factory=dict)  #: the round of who missed reports first

    @staticmethod
    def of(told: Iterable[tuple[int, Sequence[Told]]]) -> Heard:
        """Hear what robots have told, each by its pid. Raises DisagreementError."""
        heard = Heard()
        for pid, story in told:
            for one in story:
                heard.hear(pid, one)
        return heard

    def hear(self, pid: int, told: Told) -> None:
        """Hear a report of a robot. Raises DisagreementError."""
        self.tellers.add(pid)
        about = round_of(told)
        if about is not None:
            self.last[pid] = about
        match told:
            case Began(start=start):
                key = (start.home, start.slot, start.robot)
                # As texts, because what is no number does not equal itself.
                if repr(self.starts.setdefault(key, start)) != repr(start):
                    robots = self.first[key], pid
                    raise DisagreementError(INIT_ROUND, robots, "began with different values")
                self.first.setdefault(key, pid)
            case Undeclared():
                self.undeclared = True
            case TurnAnswers(round=round_, answer=answer):
                of_round = self.answers.setdefault(round_, {})
                of_round[answer.phase, answer.robot, answer.key] = answer
            case Sensed(round=round_, reading=reading):
                self.readings.setdefault(round_, {})[pid, reading.slot] = reading
            case Stood(round=round_, robot=robot):
                self.stood[round_, pid] = robot
            case Stumbled(round=round_, fault=fault):
                self.stumbled[round_, pid] = fault
            case Kept(round=round_, written=written):
                self.written[round_, pid] = written
            case Coordinated() | Left():
                pass  # says who, and when; all that was decided is told by those who acted on it
            case Missed():
                self.gaps.setdefault(pid, self.last.get(pid, INIT_ROUND))
            case GaveUp(why=why):
                self.gave_up = KoordError(why) if why else self.gave_up
            case Acted(decision=decision):
                round_ = decision.round
                if self.decisions.setdefault(round_, decision) != decision:
                    robots = self.first[round_], pid
                    raise DisagreementError(round_, robots, "acted on different decisions")
                self.first.setdefault(round_, pid)

    def coverage(self, robots: int) -> Coverage:
        """What is known of a run of so many robots."""
        unseen = {pid: INIT_ROUND for pid in range(robots) if pid not in self.tellers}
        for round_ in sorted(self.decisions):
            for robot in ran_in(self.decisions[round_]):
                if round_ != INIT_ROUND and (round_, robot) not in self.stood:
                    unseen.setdefault(robot, round_)
        for robot, round_ in self.gaps.items():
            unseen[robot] = min(unseen.get(robot, round_), round_)
        told = max(self.decisions, default=INIT_ROUND) + 1
        last = self.decisions.get(told - 1)
        if last is not None and told > 0 and is_of_model(last):
            told -= 1
        return Coverage(told, unseen)


def is_of_model(decision: Decision) -> bool:
    """Return whether a model of the environment faulted before the round, which so has none."""
    return decision.fault is not None and decision.fault.event is None


def ran_in(decision: Decision) -> tuple[int, ...]:
    """The robots that were let through in a round, in order, and the one that faulted."""
    faulted = () if decision.fault is None else (decision.fault.robot,)
    return (*(taken.robot for taken in decision.ran), *faulted)
