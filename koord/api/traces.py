"""Traces in the public API, and their files."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from koord.api.files import write_atomically
from koord.api.programs import Program, no_program
from koord.api.results import Result, html_table
from koord.syntax import core
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity, refusal
from koord.syntax.elaboration.settings import Settings
from koord.syntax.load import load as elaborate
from koord.syntax.source import Source, counted
from koord.traces.codec import decode_document, encode, load_embedded
from koord.traces.itf import embedded_trace, encode_itf, is_itf
from koord.traces.json_reader import parse
from koord.traces.replay import replay
from koord.traces.trace import Sources
from koord.traces.trace import Trace as Recorded
from koord.traces.unfinished import completed, mended

if TYPE_CHECKING:
    from koord.traces.trace import Trace as Recorded
    from koord.traces.trace import Violation


class Trace(Result, frozen=True):
    """A run of a program, complete in itself: texts, robots, every choice, every configuration."""

    recorded: Recorded

    @property
    def rounds(self) -> int:
        """The number of rounds; the last one may be cut."""
        return sum(len(part.recording.rounds) for part in self.recorded.parts)

    @property
    def robots(self) -> int:
        """The number of robots."""
        return self.recorded.system.robots

    @property
    def violation(self) -> Violation | None:
        """The violation in which the run ends, or None."""
        return self.recorded.violation

    def to_dict(self) -> dict[str, object]:
        """The trace as plain data, as ``koord run --json`` prints it."""
        found: dict[str, object] = json.loads(self.encoded())
        return found

    def encoded(self) -> bytes:
        """Encode as the bytes of a file."""
        from koord.traces.codec import encode

        return encode(self.recorded)

    def to_itf(self) -> dict[str, Any]:
        """The trace in ITF, which tools for TLA+ read."""
        from koord.traces.itf import encode_itf

        recorded_once(self.recorded, "ITF has")
        found: dict[str, Any] = json.loads(encode_itf(self.recorded))
        return found

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a file, whole or not at all; to ``….itf.json`` in the form of TLA+ tools.

        Raises :class:`koord.KoordError` where that cannot be written.
        """
        write_trace(os.fspath(path), self.recorded)

    def __repr__(self) -> str:
        broken = self.recorded.violation
        ending = "" if broken is None else f", which breaks {broken.name}"
        fault = self.recorded.parts[-1].configurations[-1].fault
        ending += "" if fault is None else f", which ends in a fault: {fault.kind.value}"
        return f"<Trace of {self.recorded.problem}: {counted(self.rounds, 'round')}{ending}>"

    def _repr_html_(self) -> str:
        from koord.traces.changes import changes
        from koord.traces.names import Names

        rows: list[tuple[object, ...]] = []
        for part in self.recorded.parts:
            system, names = part.system, Names(part.system)
            for number, round_ in enumerate(part.recording.rounds):
                ran = [
                    "" if event is None else system.agent(robot).events[event].name
                    for robot, event in enumerate(round_.events)
                ]
                before, after = part.configurations[number : number + 2]
                changed = [change.told() for change in changes(names, before, after)]
                rows.append((len(rows) + 1, *ran, ", ".join(changed)))
        columns = ("round", *(f"robot {robot}" for robot in range(self.robots)), "changes")
        return html_table(repr(self), columns, rows)


def reloads_of(trace: Recorded) -> Iterator[int]:
    """The rounds before which the program of a run was changed, counted from 0. [RELOAD]"""
    first = 0
    for part in trace.parts[:-1]:
        first += len(part.recording.rounds)
        yield first


def recorded_once(trace: Recorded, who: str) -> None:
    """Check that the program of a run was not changed. Raises KoordError, which says ``who``."""
    for number in reloads_of(trace):
        story = f"the program was changed before round {number + 1}, and {who} one program"
        hint = "the page of a replay shows it, and so does that of a simulation"
        raise refusal("K958", trace.sources.program.name, story, hint)


#: By convention, and by what other tools look for.
ITF_SUFFIX = ".itf.json"


def sources_of(loaded: Program) -> Sources:
    """The texts and settings of a program, in the form of traces."""
    chosen = loaded.settings
    return Sources(loaded.source, loaded.properties, tuple(chosen.params.items()), chosen.tasks)


def write_trace(path: str, trace: Recorded) -> None:
    """Write a trace, in the format of the file's suffix. Raises KoordError."""
    write_atomically(path, _encoded(path, trace))


def complete_trace(path: str, trace: Recorded) -> None:
    """As :func:`write_trace`, for a run whose trace has grown beside it. Raises KoordError."""
    from pathlib import Path

    from koord.api.growing import part_of

    part = Path(part_of(path))
    if path.endswith(ITF_SUFFIX) or not part.is_file():
        write_trace(path, trace)
    else:
        write_atomically(path, completed(part.read_bytes(), trace))


class UnreadableTraceError(Exception):
    """Raised where a trace would not be legal when read again: an error in koord itself."""


def write_counterexample(path: str, trace: Recorded) -> None:
    """Write a trace as ``write_trace`` does, after it was read back and replayed.

    Raises KoordError; and UnreadableTraceError, without a file, where a replay would refuse it.
    """
    data = _encoded(path, trace)
    try:
        refused = replay(read_trace(data, path, None)).refused
    except KoordError as error:
        raise UnreadableTraceError(error.diagnostics[0].message) from error
    if refused is not None:
        step = refused.step
        where = f"round {step.round + 1}, {step.rule}" if step.round >= 0 else step.rule
        story = f"[{refused.rule}] {refused.reason} ({where})"
        raise UnreadableTraceError(
            f"the counterexample is not legal when it is read again: {story}"
        )
    write_atomically(path, data)


def _encoded(path: str, trace: Recorded) -> bytes:
    if path.endswith(ITF_SUFFIX):
        recorded_once(trace, "ITF has")
    return encode_itf(trace) if path.endswith(ITF_SUFFIX) else encode(trace)


def read_trace(raw: bytes, name: str, program: Source | None) -> Recorded:
    """Read the trace in a file of either format. Raises KoordError.

    ``program``, if given, replaces the text that the trace holds. Of a file that ends in the
    middle the rounds that are whole are read, and the trace is ``cut_off``.
    """
    whole = mended(raw)
    if whole is not None:
        return replace(read_trace(whole, name, program), cut_off=True)

    def load(sources: Sources) -> core.Program:
        if program is None:
            return load_embedded(sources)
        return _elaborated(replace(sources, program=program))

    document = parse(raw, name)
    if program is not None and isinstance(document, dict) and document.get("later"):
        story = "the trace has several programs, as the first one was changed"
        raise refusal("K914", name, story, "leave out `program=`")
    try:
        trace = (
            embedded_trace(document, name, load)
            if is_itf(document)
            else decode_document(document, name, load)
        )
    except KoordError as error:
        if program is None:
            raise
        raise KoordError(tuple(_of_another(d, program) for d in error.diagnostics)) from None
    if program is None:
        return trace
    return replace(trace, sources=replace(trace.sources, program=program))


def _of_another(diagnostic: Diagnostic, program: Source) -> Diagnostic:
    """A diagnostic that suggests that the trace belongs to another program."""
    if diagnostic.code != "K913":
        return diagnostic
    hint = f"the trace may be of another program than {program.name}: leave out `program=`"
    return replace(diagnostic, code="K914", hint=hint)


def _elaborated(sources: Sources) -> core.Program:
    """Elaborate the program that the user named. Raises KoordError with its errors."""
    settings = Settings(dict(sources.params), sources.tasks)
    elaborated = elaborate(sources.program, settings, sources.properties)
    if elaborated.program is not None:
        return elaborated.program
    errors = tuple(d for d in elaborated.diagnostics if d.severity is Severity.ERROR)
    raise KoordError(errors or (no_program(sources.program.name),))
