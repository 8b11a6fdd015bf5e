"""What ``koord deploy --pid I`` has printed on the computers of robots, as results. (P-SSH)"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
from msgspec import Struct

from koord.api.breaches import BrokenStatement
from koord.api.preflight import Check
from koord.runtime.deploy.status import RobotReport, unheard
from koord.runtime.deploy.supervision import EndCause, ProcessEnd, ProcessReport, ProcessState
from koord.runtime.remote.logins import RemoteEnd

#: The exit code of a robot that could not take part.
REFUSED = 2


class Complaint(Struct, frozen=True):
    """Why a robot could not take part, as it has said itself."""

    message: str
    hint: str | None


def _read(end: RemoteEnd) -> Mapping[str, Any]:
    """What a command has printed, as JSON; empty if it has not."""
    try:
        found = json.loads(end.printed)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


class RobotAnswer(Struct, frozen=True):
    """What a robot's run came to, as its computer tells."""

    status: RobotReport | None = None
    broken: tuple[BrokenStatement, ...] = ()
    unwatched: tuple[str, ...] = ()

    @staticmethod
    def of(end: RemoteEnd) -> RobotAnswer:
        """Read what a robot has reported; it is empty if it has not come to that."""
        told = _read(end)
        try:
            [robot] = told.get("robots", [])
            drops = list(robot["drops"].items())
            status = msgspec.convert({**robot, "drops": drops}, RobotReport)
            broken = msgspec.convert(told["broken"], tuple[BrokenStatement, ...])
            unwatched = msgspec.convert(told["unwatched"], tuple[str, ...])
        except (msgspec.ValidationError, KeyError, TypeError, ValueError, AttributeError):
            return RobotAnswer()
        return RobotAnswer(status, broken, unwatched)


def has_reported(end: RemoteEnd) -> bool:
    """Return whether a robot has come to its report."""
    return end.code not in (None, REFUSED) and b'"koord-deployed"' in end.printed[:1000]


def checks_of(end: RemoteEnd) -> tuple[Check, ...]:
    """What a robot has found before anything is armed; empty if it has not come to that."""
    try:
        [robot] = _read(end).get("robots", [])
        return msgspec.convert(robot["checks"], tuple[Check, ...])
    except (msgspec.ValidationError, KeyError, TypeError, ValueError):
        return ()


def complaints(end: RemoteEnd) -> Iterator[Complaint]:
    """Why a robot could not take part."""
    found = [one for one in _read(end).get("diagnostics", []) if one.get("severity") == "error"]
    for one in found:
        yield Complaint(f"{one.get('message')} [{one.get('code')}]", one.get("hint"))
    if not found:
        said = end.lost or f"koord ended with exit code {end.code}"
        yield Complaint(f"{said}: {end.last}" if end.last else said, None)


def process_of(pid: int, end: RemoteEnd) -> ProcessReport:
    """What became of a robot's process."""
    if has_reported(end):
        return ProcessReport(ProcessState.OVER)
    if end.lost:
        story = end.lost
    elif end.signal is not None:
        story = f"its process was killed (signal {end.signal})"
    else:
        story = f"its process ended with exit code {end.code}"
        story += f": {end.last}" if end.last else ""
    return ProcessReport(ProcessState.LOST, 0, ProcessEnd(pid, EndCause.AWAY, detail=story))


def status_of(pid: int, answer: RobotAnswer) -> RobotReport:
    """The last status of a robot; of who has told none, that nothing was heard."""
    return unheard(pid) if answer.status is None else answer.status


def joined(answers: Mapping[int, RobotAnswer]) -> RobotAnswer:
    """What all robots together have watched: which claims did not hold, which nobody saw."""
    broken = {one.key: one for answer in answers.values() for one in answer.broken}
    unwatched = {name for answer in answers.values() for name in answer.unwatched}
    return RobotAnswer(None, tuple(broken.values()), tuple(sorted(unwatched)))
