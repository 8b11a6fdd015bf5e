"""Recordings of deployed runs as MCAP. Needs ``koord[record]``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import IO, Any

from msgspec import to_builtins

from koord.runtime.deploy.news import RoundReport
from koord.runtime.deploy.status import RobotReport
from koord.runtime.deploy.supervision import ProcessReport
from koord.runtime.records import RecordFile
from koord.syntax.problem import Problem

_ROBOTS: tuple[str, dict[str, Any]] = (
    "koord.robots",
    {
        "type": "object",
        "properties": {
            "round": {"type": "integer"},
            "event": {"type": ["string", "null"]},
            "position": {"type": "array", "items": {"type": "number"}},
            "late": {"type": "boolean"},
            "took_s": {"type": "number"},
            "output": {"type": "array", "items": {"type": "object"}},
        },
    },
)
_PART: tuple[str, dict[str, Any]] = ("koord.part", {"type": "object"})

#: The topics of what robots tell of the run, a line of a part a message.
PARTS = "/parts/"

_STATUS: tuple[str, dict[str, Any]] = ("koord.status", {"type": "object"})


class DeploymentRecord:
    """An MCAP recording: JSON channels of robots (``/robots/0``, ``/parts/0``) and of statuses.

    Writing raises OSError.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = RecordFile(file)

    def describe(self, problem: Problem) -> None:
        """Write metadata: the program, robots and settings of the run."""
        facts = {"program": problem.name, "robots": problem.fleet}
        facts |= {"delta_s": str(problem.delta_s), "differing": ", ".join(problem.differing)}
        self._file.describe("koord", facts)

    def rounds(self, rounds: tuple[RoundReport, ...], now_ns: int) -> None:
        """Write the rounds of a robot."""
        for one in rounds:
            said = [{"stream": w.stream, "values": repr(w.values)} for w in one.output]
            message = {
                "round": one.round,
                "event": one.event,
                "position": list(one.position),
                "late": one.late,
                "took_s": one.took_s,
                "output": said,
            }
            self._file.add(f"/robots/{one.pid}", _ROBOTS, message, now_ns, one.round)

    def status(
        self, status: RobotReport, now_ns: int, process: ProcessReport | None = None
    ) -> None:
        """Write the status of a robot, and what became of its ``process``, if it has its own."""
        message = to_builtins(status)
        message["holding"] = None if status.holding is None else status.holding.value
        if process is not None:
            message["process"] = process.to_dict()
        self._file.add("/status", _STATUS, message, now_ns, status.round)

    def told(self, pid: int, lines: Iterable[bytes], now_ns: int) -> None:
        """Write lines of a robot's part."""
        for line in lines:
            self._file.add(f"{PARTS}{pid}", _PART, line, now_ns)

    def flush(self) -> None:
        """Flush all messages; the file is readable from then on, even if this process is killed."""
        self._file.flush()

    def close(self) -> None:
        """Finish the file."""
        self._file.close()

    def restore(self) -> None:
        """End with the last flush: there was no room for more. Raises OSError."""
        self._file.restore()
