"""Explanations of a fair lasso: per robot, event, lock and expectation, why it is fair. [LASSO]

Said of its loop, by the same judgements that :mod:`koord.traces.lassos` makes: who runs what and
when, what is enabled now and then only, who may be passed over, and who asks for which lock. Rounds
count from 1, as people are shown them; what is so *before* a round is so of the configuration that
it starts from.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

from msgspec import Struct

from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.liveness import expected, locks_of
from koord.semantics.recordings import Recording
from koord.syntax.system import System
from koord.traces.lassos import Lasso, able_in, holds_at, ran


class EventStatus(Enum):
    """The status of an event in the loop of a lasso: whether it runs and when it is enabled."""

    RUNS = "runs"  #: in one of them at least
    NEVER = "never enabled"
    AT_TIMES = "enabled now and then"
    ALWAYS = "always enabled"


class OfEvent(Struct, frozen=True):
    """An event of a robot: the rounds before which it may be enabled, and those that run it."""

    event: str
    enabled: tuple[int, ...]
    ran: tuple[int, ...]
    standing: EventStatus


class OfLock(Struct, frozen=True):
    """A lock that a robot needs: the rounds before which it waits, and those that grant it."""

    variables: tuple[str, ...]
    asks: tuple[int, ...]
    granted: tuple[int, ...]


class OfRobot(Struct, frozen=True):
    """The reason that the loop is fair to a robot: rounds in which it runs, or is not ready before.

    ``skips`` are the rounds in which it skips though it is ready. [FAIR-ROBOT] [FAIR-LOCK]
    """

    robot: int
    runs: tuple[int, ...]
    idle: tuple[int, ...]
    skips: tuple[int, ...]
    events: tuple[OfEvent, ...]
    locks: tuple[OfLock, ...]


class OfExpectation(Struct, frozen=True):
    """The reason that an expectation is met: rounds that meet it, or none that raises it.

    ``robot`` is whose it is, if it is about each by itself. [FAIR-ASSUME]
    """

    name: str
    robot: int | None
    met: tuple[int, ...]


class Excuses(Struct, frozen=True):
    """The reasons that a lasso is fair. ``rounds`` are those of its loop."""

    rounds: tuple[int, ...]
    robots: tuple[OfRobot, ...]
    expectations: tuple[OfExpectation, ...]


def excuses(
    system: System, recording: Recording, configurations: Sequence[Configuration[Constant]]
) -> Excuses:
    """Explain why a lasso is fair. The lasso has to be fair."""
    lasso = Lasso(system, recording, tuple(configurations))
    rounds = tuple(range(lasso.begins + 1, len(recording.rounds) + 1))
    robots = tuple(_of_robot(lasso, rounds, robot) for robot in range(system.robots))
    expectations = tuple(
        OfExpectation(
            response.name,
            response.robot,
            tuple(n for n in lasso.repeated if holds_at(lasso, response.goal, n)),
        )
        for response in expected(system)
    )
    return Excuses(rounds, robots, expectations)


def _of_robot(lasso: Lasso, rounds: tuple[int, ...], robot: int) -> OfRobot:
    system = lasso.system
    pairs = dict(zip(rounds, lasso.rounds, strict=True))
    able = {n: able_in(system, start, robot) for n, (start, _) in pairs.items()}
    runs = tuple(n for n, (_, round_) in pairs.items() if ran(round_, robot))
    events = []
    for position, event in enumerate(system.agent(robot).events):
        enabled = tuple(n for n in rounds if able[n].events[position])
        here = tuple(n for n in rounds if pairs[n][1].events[robot] == position)
        events.append(OfEvent(event.name, enabled, here, _standing(rounds, enabled, here)))
    locks = []
    for k in (k for whose, k in locks_of(system) if whose == robot):
        of = {p for p, event in enumerate(system.agent(robot).events) if k in event.lock_classes}
        locks.append(
            OfLock(
                tuple(system.program.lock_classes[k].variables),
                tuple(n for n in rounds if able[n].asks_for(k)),
                tuple(n for n in runs if pairs[n][1].events[robot] in of),
            )
        )
    return OfRobot(
        robot,
        runs,
        tuple(n for n in rounds if not able[n].ready),
        tuple(n for n in rounds if able[n].ready and n not in runs),
        tuple(events),
        tuple(locks),
    )


def _standing(
    rounds: tuple[int, ...], enabled: tuple[int, ...], here: tuple[int, ...]
) -> EventStatus:
    if here:
        return EventStatus.RUNS
    if not enabled:
        return EventStatus.NEVER
    return EventStatus.ALWAYS if enabled == rounds else EventStatus.AT_TIMES


def told(found: Excuses) -> list[str]:
    """Describe why the loop is fair, a line per reason; robots with equal reasons share one."""
    lines: dict[str, list[int]] = {}
    for of in found.robots:
        for line in _told(found.rounds, of):
            lines.setdefault(line, []).append(of.robot)
    said = [f"{_robots(who)} {line}" for line, who in lines.items()]
    for expectation in found.expectations:
        whose = "" if expectation.robot is None else f" of robot {expectation.robot}"
        how = "what it speaks of is never owed in the loop"
        if expectation.met:
            how = f"what it expects is so after {_rounds(expectation.met)}"
        said.append(f"{expectation.name}{whose} is met: {how}")
    return said


def _told(rounds: tuple[int, ...], of: OfRobot) -> list[str]:
    said = []
    if of.runs:
        names = list(dict.fromkeys(e.event for e in of.events if e.ran))
        line = f"runs {' and '.join(names)} in {_rounds(of.runs)}"
        if of.skips:
            line += f", so that it may skip in {_rounds(of.skips)}, where it could run"
        said.append(line)
    else:
        line = f"never runs: it can run nothing in {_rounds(of.idle)}"
        if of.skips:
            line += f", so that it may skip for ever, also in {_rounds(of.skips)}"
        said.append(line)
    for event in of.events:
        if event.standing is EventStatus.AT_TIMES:
            without = tuple(n for n in rounds if n not in event.enabled)
            how = f"is enabled in {_rounds(event.enabled)} only, not in {_rounds(without)}"
            said.append(f"never runs {event.event}, which {how}")
        elif event.standing is EventStatus.ALWAYS:
            how = "fairness is to robots, and which event one runs is its own affair"
            said.append(f"never runs {event.event}, which is always enabled: {how}")
    for lock in of.locks:
        variables = ", ".join(lock.variables)
        if lock.asks:
            said.append(
                f"asks for the lock of {variables} in {_rounds(lock.asks)}, and has it in "
                f"{_rounds(lock.granted)}"
            )
        elif not lock.granted and any(_waits(event, of) for event in of.events):
            said.append(f"never has the lock of {variables}: it can always do without, or nothing")
    return said


def _waits(event: OfEvent, of: OfRobot) -> bool:
    return event.standing in (EventStatus.AT_TIMES, EventStatus.ALWAYS) and bool(of.locks)


def _robots(who: Sequence[int]) -> str:
    if len(who) == 1:
        return f"robot {who[0]}"
    if len(who) > 2 and list(who) == list(range(who[0], who[-1] + 1)):
        return f"each of robots {who[0]} to {who[-1]}"
    return f"each of robots {', '.join(map(str, who[:-1]))} and {who[-1]}"


def _rounds(rounds: Sequence[int]) -> str:
    """Name rounds in words; some of them if they are many."""
    if len(rounds) == 1:
        return f"round {rounds[0]}"
    if list(rounds) == list(range(rounds[0], rounds[-1] + 1)):
        return f"rounds {rounds[0]} to {rounds[-1]}"
    if len(rounds) > 6:
        return f"rounds {', '.join(map(str, rounds[:5]))}, … {rounds[-1]}"
    return f"rounds {', '.join(map(str, rounds[:-1]))} and {rounds[-1]}"
