"""A run as it was recorded: what can be replayed, shown, and written for other tools."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

from koord.api.results import Result, html_table

if TYPE_CHECKING:
    from koord.traces.trace import Trace as Recorded
    from koord.traces.trace import Violation


class Trace(Result, frozen=True):
    """A run of a program, complete in itself: texts, robots, every choice, every configuration."""

    recorded: Recorded

    @property
    def rounds(self) -> int:
        """How many rounds there are; the last one may be broken off."""
        return len(self.recorded.recording.rounds)

    @property
    def robots(self) -> int:
        """How many robots there are."""
        return self.recorded.system.robots

    @property
    def violation(self) -> Violation | None:
        """What the run breaks, if it ends for that."""
        return self.recorded.violation

    def to_dict(self) -> dict[str, object]:
        """As ``koord run --json`` prints it; the schema is ``trace``."""
        found: dict[str, object] = json.loads(self.encoded())
        return found

    def encoded(self) -> bytes:
        """The bytes of a file."""
        from koord.traces.codec import encode

        return encode(self.recorded)

    def to_itf(self) -> dict[str, Any]:
        """In the form that tools for TLA+ read (ITF)."""
        from koord.traces.itf import encode_itf

        found: dict[str, Any] = json.loads(encode_itf(self.recorded))
        return found

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a file, whole or not at all; to ``….itf.json`` in the form of TLA+ tools.

        Raises :class:`koord.KoordError` where that cannot be written.
        """
        from koord.api.traces import write_trace

        write_trace(os.fspath(path), self.recorded)

    def __repr__(self) -> str:
        broken = self.recorded.violation
        ending = "" if broken is None else f", which breaks {broken.name}"
        fault = self.recorded.configurations[-1].fault
        ending += "" if fault is None else f", which ends in a fault: {fault.kind.value}"
        rounds = f"{self.rounds} round{'' if self.rounds == 1 else 's'}"
        return f"<Trace of {self.recorded.problem}: {rounds}{ending}>"

    def _repr_html_(self) -> str:
        from koord.traces.changes import changes
        from koord.traces.names import Names

        system, configurations = self.recorded.system, self.recorded.configurations
        names = Names(system)
        rows = []
        for number, round_ in enumerate(self.recorded.recording.rounds):
            ran = [
                "" if event is None else system.agent(robot).events[event].name
                for robot, event in enumerate(round_.events)
            ]
            before, after = configurations[number : number + 2]
            changed = [
                f"{change.name}{'' if change.robot is None else f'@{change.robot}'}: "
                f"{change.old} → {change.new}"
                for change in changes(names, before, after)
            ]
            rows.append((number + 1, *ran, ", ".join(changed)))
        columns = ("round", *(f"robot {robot}" for robot in range(system.robots)), "changes")
        return html_table(repr(self), columns, rows)
