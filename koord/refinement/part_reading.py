"""Reading of parts: what robots tell of a run, checked line by line. [RECORDING]

Reading raises KoordError, with file and line, and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, assert_never

import msgspec
from msgspec import Struct, UnsetType, field

from koord.refinement import part_form, reports
from koord.refinement.part_form import ASKED_NAMES, FORMAT, VERSION
from koord.refinement.parts import Whose, nameless
from koord.refinement.reports import DIGEST_BYTES, Told
from koord.runtime.proposals import Admitted, Decision, EventFault, Faulted, StopRequests
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity, refusal
from koord.syntax.faults import FaultKind
from koord.syntax.source import Span, whole_file
from koord.traces.codec import Load, decode_subject
from koord.traces.form import Form
from koord.traces.json_reader import FormError, JsonNode, parse, shortened
from koord.traces.names import Names
from koord.traces.run_codec import Decoding, Known
from koord.traces.trace import Numbers


class Part(Struct, frozen=True):
    """A part as it was read."""

    name: str  #: the file's, for messages
    whose: Whose
    told: tuple[Told, ...]
    is_torn: bool  #: the file ends in the middle of a line


#: What is advised where a part is damaged.
_WITHOUT = "the file was changed or damaged: merge the other parts without it"

#: What is advised where a file is none.
_NO_PART = "name files that `koord deploy --pid I --trace FILE` or `--record FILE` wrote"


def read_part(raw: bytes, name: str, load: Load, known: Known | None = None) -> Part:
    """Read the part in a file. ``name`` is the file's, for messages. Raises KoordError.

    ``load`` makes the program of the texts in the head; ``known`` is what parts that are read
    together may share. A part may end in the middle of a line, where its robot was killed; what is
    damaged otherwise is refused.
    """
    whole, _, torn = raw.rpartition(b"\n")
    lines = whole.split(b"\n") if whole else []
    return read_lines(lines, name, load, known, is_torn=bool(torn))


def read_lines(
    lines: Iterable[bytes],
    name: str,
    load: Load,
    known: Known | None = None,
    *,
    is_torn: bool = False,
) -> Part:
    """As :func:`read_part`, of the whole lines of a part without their ends."""
    reading: _Reading | None = None
    for n, raw in enumerate(lines):
        place = Span(name, n + 1, 1, n + 1, 1)
        line: part_form.AnyLine | None = None
        try:
            line = _line(raw, place) if n else _head(raw, place)
            if line.n != n:
                reason = f"it is line {line.n} of the part, not line {n}: lines are missing"
                raise FormError(reason, ".n", part=line)
            if reading is None:
                assert isinstance(line, part_form.Head)
                reading = _Reading.of(name, line, load, Known() if known is None else known)
            else:
                reading.read(line)
        except FormError as error:
            raise error.refusal(place, "$", line, _WITHOUT) from None
    if reading is None:
        hint = "its robot was ended before it told anything: merge the other parts without it"
        raise refusal("K910", name, "there is no whole line in it", hint)
    return Part(name, reading.whose, tuple(reading.told), is_torn)


def _head(raw: bytes, place: Span) -> part_form.Head:
    """Decode the first line of a part. Raises KoordError and FormError."""
    document = _parsed(
        raw, place, "this is no part of a run, or its first line is damaged", _NO_PART
    )
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise refusal("K911", place.file, "this is no part of a run, though it is JSON", _NO_PART)
    version = document.get("version")
    if isinstance(version, int) and not isinstance(version, bool) and version > VERSION:
        reason = f"the part has version {version}; this koord reads version {VERSION}"
        raise refusal("K912", place.file, reason, "use the koord that wrote it, or a newer one")
    return JsonNode(document).form(part_form.Head)


def _line(raw: bytes, place: Span) -> part_form.AnyLine:
    """Decode a line. Raises KoordError and FormError."""
    try:
        found: part_form.AnyLine = _DECODER.decode(raw)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        any_line: Any = part_form.AnyLine
        found = JsonNode(_parsed(raw, place, "the line is damaged", _WITHOUT)).form(any_line)
    return found


_DECODER = msgspec.json.Decoder(part_form.AnyLine)


def _parsed(raw: bytes, place: Span, story: str, hint: str) -> object:
    try:
        document: object = parse(raw, place.file)
    except KoordError as error:
        message = error.diagnostics[0].message
        raise refusal("K910", place, f"{story}: {message}", hint) from None
    return document


class _Reading(Struct):
    """A part that is being read, behind its head."""

    name: str
    head: part_form.Head
    whose: Whose
    decoding: Decoding
    told: list[Told] = field(default_factory=list)

    @staticmethod
    def of(name: str, head: part_form.Head, load: Load, known: Known) -> _Reading:
        """Begin with the head. Raises FormError and KoordError."""
        subject = decode_subject(head, load)
        decoding = Decoding(Names(subject.system), Numbers.DOUBLE, known)
        decoding.robot(head.pid, head, ".pid")
        return _Reading(name, head, Whose(head.run, head.pid, subject), decoding)

    def read(self, line: part_form.AnyLine) -> None:
        """Read another line. Raises FormError."""
        if not isinstance(line, part_form.Head):
            self.told.append(self._told(line))
        elif nameless(line) != nameless(self.head):
            raise FormError("from here on it is the part of another run or robot", "", "K918", line)

    def _told(self, line: part_form.AnyLine) -> Told:
        of, pid = self.decoding, self.whose.pid
        match line:
            case part_form.Began(start=start):
                return reports.Began(of.start(start))
            case part_form.Undeclared():
                return reports.Undeclared()
            case part_form.TurnAnswers(round=round_, answer=answer):
                self._own(answer.robot, ".answer.robot", line)
                return reports.TurnAnswers(round_, of.answer(answer))
            case part_form.Sensed(round=round_, reading=reading):
                self._own(reading.robot, ".reading.robot", line)
                return reports.Sensed(round_, of.reading(reading))
            case part_form.Stood(round=round_, robot=robot):
                if isinstance(robot.copy, UnsetType):
                    raise FormError("the field 'copy' is missing", ".robot", part=line)
                return reports.Stood(round_, of.of_robot(pid, robot, of.store(robot.copy)))
            case part_form.Stumbled(round=round_, fault=fault):
                return reports.Stumbled(round_, self._fault(fault))
            case part_form.Acted():
                # All robots tell of the same decisions.
                said = (line.round, line.ran, line.skipped, line.fault or 0, line.digest)
                made = of.known_or(lambda: self._decision(line), (Decision, None), said)
                return reports.Acted(made)
            case part_form.Kept(round=round_, output=output):
                for one in output:
                    self._own(one.robot, ".robot", one)
                written = tuple(of.output(one, round_).written for one in output)
                return reports.Kept(round_, written)
            case part_form.Coordinated(round=round_, at_s=at_s):
                return reports.Coordinated(round_, at_s)
            case part_form.GaveUp(why=why):
                place = whole_file(self.name)
                return reports.GaveUp(
                    tuple(Diagnostic(o.code, Severity.ERROR, place, o.message) for o in why)
                )
            case part_form.Left(round=round_):
                return reports.Left(round_)
            case part_form.Missed(reports=missed):
                return reports.Missed(missed)
            case part_form.Head():
                raise AssertionError("heads tell nothing")
        assert_never(line)

    def _own(self, robot: int | None, path: str, part: Form) -> None:
        if robot != self.whose.pid:
            reason = f"it is told by robot {self.whose.pid}, of robot {robot}"
            raise FormError(reason, path, part=part)

    def _decision(self, line: part_form.Acted) -> Decision:
        try:
            digest = bytes.fromhex(line.digest)
        except ValueError:
            digest = b""
        if len(digest) != DIGEST_BYTES:
            reason = f"there should be {2 * DIGEST_BYTES} hexadecimal digits here"
            raise FormError(reason, ".digest", part=line)
        ran = tuple(map(self._admitted, line.ran))
        fault = None if line.fault is None else self._faulted(line.fault)
        of, told = self.decoding, [*line.skipped, *(one.robot for one in ran)]
        told += [] if fault is None else [fault.robot]
        for robot in told:
            of.robot(robot, line, "")
        if len(set(told)) != len(told):
            raise FormError("a robot is named twice", "", part=line)
        return Decision(line.round, ran, tuple(line.skipped), (), digest, fault)

    def _admitted(self, part: part_form.Admitted) -> Admitted:
        if part.asked not in ASKED_NAMES:
            reason = f"{shortened(part.asked)!r} is none of {', '.join(ASKED_NAMES)}"
            raise FormError(reason, ".asked", part=part)
        asked = StopRequests(ASKED_NAMES.index(part.asked))
        return Admitted(part.robot, self._event(part), asked)

    def _faulted(self, part: part_form.Faulted) -> Faulted:
        return Faulted(part.robot, self._event(part), self._fault(part.fault))

    def _event(self, part: part_form.Admitted | part_form.Faulted) -> int | None:
        of = self.decoding
        robot = of.robot(part.robot, part)
        return of.event(part.event, of.names.of(robot), ".event", part)

    def _fault(self, part: part_form.Fault) -> EventFault:
        if part.kind not in FaultKind.__members__:
            reason = f"there is no fault of the kind {shortened(part.kind)!r}"
            raise FormError(reason, ".kind", part=part)
        return EventFault(FaultKind[part.kind], part.place, part.detail)
