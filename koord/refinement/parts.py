"""Parts: what one robot tells of a run, as a file of JSON lines. [RECORDING]

:mod:`koord.refinement.part_form` has the form. A robot writes each line at once, so that of one
that is killed nothing is missing but perhaps the end of its last line; when it is started again it
goes on in the same file. :mod:`koord.refinement.part_reading` is the way back.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import assert_never

import msgspec
from msgspec import UNSET, Struct
from msgspec.structs import replace

from koord.refinement import part_form, reports
from koord.refinement.part_form import FORMAT, VERSION
from koord.refinement.reports import Missed, Told
from koord.runtime.proposals import Decision, EventFault
from koord.syntax.source import visible
from koord.traces.codec import Subject, encode_subject
from koord.traces.names import Names
from koord.traces.run_codec import (
    encode_answer,
    encode_output,
    encode_reading,
    encode_robot,
    encode_start,
)
from koord.traces.value_codec import encode_fraction


class Whose(Struct, frozen=True):
    """What a part is of: a robot of a run, and what was run."""

    run: str
    pid: int
    subject: Subject


def difference(one: Whose, other: Whose) -> str | None:
    """What makes two parts those of different runs, or None.

    Where the files of a program lay does not matter, nor how they were laid out.
    """
    ours, theirs = one.subject, other.subject
    system, their_system = ours.system, theirs.system
    if one.run != other.run:
        return f"the run {visible(one.run)!r} is not {visible(other.run)!r}"
    given, theirs_given = dict(ours.sources.params), dict(theirs.sources.params)
    for name in sorted(given.keys() | theirs_given.keys()):
        if given.get(name) != theirs_given.get(name):
            return f"the param {name} differs"
    if ours.sources.tasks != theirs.sources.tasks:
        return "the tasks differ"
    if system.program != their_system.program:
        return "the program differs"
    if system.kinds != their_system.kinds:
        return "the robots differ, or their kinds"
    if system.delta_s != their_system.delta_s:
        return f"δ = {float(system.delta_s):g} s is not {float(their_system.delta_s):g} s"
    return None if ours.slack == theirs.slack else "the slack differs"


class PartWriter:
    """The part of a robot, which grows while the robot runs.

    The file is opened with the first report: what a run is called may not be known before. One of
    the same robot in the same run is continued, behind its last whole line; another one is
    replaced. Where the file cannot be written, the robot goes on, and reports are missing: their
    number is told as soon as there is room again. ``trouble`` is the last reason.
    """

    def __init__(self, path: Path, whose: Callable[[], Whose]) -> None:
        self.path = path
        self.trouble: OSError | None = None
        self.missed = 0  #: reports, all in all
        self._whose = whose
        self._file: int | None = None
        self._lines = 0
        self._size = 0  #: of the whole lines, in bytes
        self._untold = 0  #: reports that were missed since the last that was written
        self._encoding: Encoding | None = None

    def tell(self, told: Told) -> None:
        """Write a report, and before it how many were missed, if any were."""
        try:
            if self._encoding is None:
                self._encoding = self._open()
            if self._untold:
                self._write(self._encoding.line(Missed(self._untold), self._lines))
                self._untold = 0
            self._write(self._encoding.line(told, self._lines))
        except OSError as error:
            self.trouble = error
            self.missed += 1
            self._untold += 1

    def _open(self) -> Encoding:
        whose = self._whose()
        begun = _begun(self.path, whose)
        self._lines = begun.count(b"\n")
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_CLOEXEC", 0)
        self._file = os.open(self.path, flags, 0o666)
        self._size = len(begun)
        try:
            self._write(encode_head(whose, self._lines))
        except OSError:
            os.close(self._file)
            raise
        return Encoding(Names(whose.subject.system), whose.pid)

    def _write(self, line: part_form.Line) -> None:
        """Write a line behind the last whole one, as a whole. Raises OSError."""
        assert self._file is not None
        data = _encoded(line)
        if os.fstat(self._file).st_size != self._size:
            os.ftruncate(self._file, self._size)
        if os.write(self._file, data) != len(data):
            with suppress(OSError):  # else with the next line
                os.ftruncate(self._file, self._size)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))
        self._size += len(data)
        self._lines += 1


def _begun(path: Path, whose: Whose) -> bytes:
    """The whole lines of a part that the same robot began in the same run, or nothing."""
    try:
        found = path.read_bytes()
        head = msgspec.json.decode(found.partition(b"\n")[0], type=part_form.Head)
    except (FileNotFoundError, msgspec.MsgspecError):
        return b""
    is_ours = nameless(head) == nameless(encode_head(whose, 0))
    return found[: found.rindex(b"\n") + 1] if is_ours else b""


def nameless(head: part_form.Head) -> part_form.Head:
    """A head without what may change between two starts of one robot: where its files lie."""
    program, properties = replace(head.program, name=""), head.properties
    texts = [replace(text, name="") for text in properties]
    return replace(head, n=0, program=program, properties=texts)


def encode_head(whose: Whose, n: int) -> part_form.Head:
    """Encode the line that says whose a part is."""
    subject = whose.subject
    return part_form.Head(
        n=n,
        format=FORMAT,
        version=VERSION,
        run=whose.run,
        pid=whose.pid,
        **encode_subject(subject.sources, subject.system),
        slack=encode_fraction(subject.slack) if subject.slack else UNSET,
    )


def _encoded(line: part_form.Line) -> bytes:
    try:
        return msgspec.json.encode(line) + b"\n"
    except UnicodeEncodeError:  # half a character, in a string of the program
        return json.dumps(msgspec.to_builtins(line)).encode() + b"\n"


class Encoding(Struct, frozen=True):
    """The encoding of the reports of a robot."""

    names: Names
    pid: int

    def line(self, told: Told, n: int) -> part_form.AnyLine:
        """The line of a report, with its number."""
        names = self.names
        match told:
            case reports.Began(start=start):
                return part_form.Began(n=n, start=encode_start(names, start))
            case reports.Undeclared():
                return part_form.Undeclared(n=n)
            case reports.TurnAnswers(round=round_, answer=answer):
                return part_form.TurnAnswers(n=n, round=round_, answer=encode_answer(names, answer))
            case reports.Sensed(round=round_, reading=reading):
                return part_form.Sensed(n=n, round=round_, reading=encode_reading(names, reading))
            case reports.Stood(round=round_, robot=robot):
                stood = encode_robot(names, self.pid, robot)
                return part_form.Stood(n=n, round=round_, robot=stood)
            case reports.Stumbled(round=round_, fault=fault):
                return part_form.Stumbled(n=n, round=round_, fault=_fault(fault))
            case reports.Acted(decision=decision):
                return self._acted(decision, n)
            case reports.Kept(round=round_, written=written):
                output = [encode_output(self.pid, one) for one in written]
                return part_form.Kept(n=n, round=round_, output=output)
            case reports.Coordinated(round=round_, at_s=at_s):
                return part_form.Coordinated(n=n, round=round_, at_s=at_s)
            case reports.GaveUp(why=why):
                reasons = [part_form.Reason(one.code, one.message) for one in why]
                return part_form.GaveUp(n=n, why=reasons)
            case reports.Left(round=round_):
                return part_form.Left(n=n, round=round_)
            case Missed(reports=missed):
                return part_form.Missed(n=n, reports=missed)
        assert_never(told)

    def _acted(self, decision: Decision, n: int) -> part_form.Acted:
        faulted = decision.fault
        return part_form.Acted(
            n=n,
            round=decision.round,
            ran=[
                part_form.Admitted(
                    one.robot, self._event(one.robot, one.event), one.asked.name.lower()
                )
                for one in decision.ran
            ],
            skipped=list(decision.skipped),
            fault=None
            if faulted is None
            else part_form.Faulted(
                faulted.robot, self._event(faulted.robot, faulted.event), _fault(faulted.fault)
            ),
            digest=decision.digest.hex(),
        )

    def _event(self, robot: int, position: int | None) -> str | None:
        return None if position is None else self.names.of(robot).events[position]


def _fault(fault: EventFault) -> part_form.Fault:
    return part_form.Fault(fault.kind.name, fault.place, fault.detail)
