"""Merging: what the robots of a deployed run have told, as one trace that can be judged."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from typing import Final

from msgspec import Struct, field, to_builtins

from koord.api.files import read_written
from koord.api.progress import Cancellation, Listener, Progress, ended, heard_by
from koord.api.replay import broken_form
from koord.api.results import ArgumentError, Result, html_table
from koord.api.traces import Trace
from koord.refinement.hearing import DisagreementError, Heard
from koord.refinement.judging import judge
from koord.refinement.part_reading import Part, read_lines, read_part
from koord.refinement.parts import difference
from koord.refinement.presuming import Presumption, UndecidedError
from koord.refinement.reports import Acted, Left, Missed
from koord.refinement.trace_merge import gathered
from koord.runtime.deploy.recording import PARTS
from koord.runtime.motion.libraries import require
from koord.runtime.proposals import INIT_ROUND
from koord.runtime.records import DamagedRecordError, is_record, read_messages
from koord.sampling.monitors import Watch
from koord.semantics.recordings import Step
from koord.syntax import core
from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.source import counted, visible
from koord.traces.codec import load_embedded
from koord.traces.replay import Refused
from koord.traces.run_codec import Known
from koord.traces.trace import Sources, Violation

#: Raised when the JSON changes in a way that its readers must know of.
MERGED_VERSION: Final = 1


class PartEnd(Enum):
    """How a part ends."""

    LEFT = "left"  #: the robot stopped in good order, and said so
    SILENT = "silent"  #: it was ended, or its part could not be written any more
    TORN = "torn"  #: the same, in the middle of a line


class PartRead(Struct, frozen=True):
    """A part that was merged: the robot's, its file, the rounds that it acted on, its end.

    ``missed`` is how many reports are missing, as they could not be written.
    """

    pid: int
    name: str
    rounds: int
    end: PartEnd
    missed: int = 0


class Merged(Result, frozen=True, kw_only=True):
    """The trace of a deployed run, with what it was merged of and how it is judged.

    ``missing`` are robots of which there is no part. ``rounds_told`` is how many rounds the run had
    at least; the trace has fewer where no part tells of one.
    """

    trace: Trace
    parts: tuple[PartRead, ...]
    missing: tuple[int, ...]
    rounds_told: int
    refused: Refused | None  #: the first step that no rule allows
    broken: Violation | None  #: the first property or contract that the run breaks, if it is legal
    unjudged: tuple[str, ...]  #: properties that ask what nobody answered
    presumed: tuple[Presumption, ...]  #: assumptions and contracts that do

    @property
    def is_whole(self) -> bool:
        """True if there is a whole part of each robot, and the trace goes to the run's end."""
        if self.missing or any(part.missed for part in self.parts):
            return False
        return self.has_all_told

    @property
    def has_all_told(self) -> bool:
        """True if all rounds that a part tells of are in the trace."""
        return self.trace.rounds == self.rounds_told

    @property
    def ok(self) -> bool:
        """True if the run is whole and legal, and breaks nothing."""
        return self.is_whole and not self.is_wrong

    @property
    def is_wrong(self) -> bool:
        """True if a step of the run is not legal, or breaks a property or a contract."""
        return self.refused is not None or self.broken is not None

    def to_dict(self) -> dict[str, object]:
        """The result as plain data, as ``koord merge --json`` prints it."""
        problem, refused = self.trace.recorded.problem, self.refused
        return {
            "format": "koord-merged",
            "version": MERGED_VERSION,
            "program": problem.texts[0],
            "problem": problem.document(),
            "rounds": self.trace.rounds,
            "rounds_told": self.rounds_told,
            "parts": [to_builtins(part) for part in self.parts],
            "missing": list(self.missing),
            "refused": None
            if refused is None
            else {"rule": refused.rule, "round": refused.step.round, "reason": refused.reason},
            "broken": None if self.broken is None else to_builtins(broken_form(self.broken)),
            "unjudged": list(self.unjudged),
            "presumed": [to_builtins(one) for one in self.presumed],
        }

    def __repr__(self) -> str:
        how = "legal" if self.refused is None else f"not legal by {self.refused.rule}"
        how += "" if self.broken is None else f", breaks {self.broken.name}"
        rounds = counted(self.trace.rounds, "round")
        return f"<Merged {self.trace.recorded.problem}: {rounds}, {how}>"

    def _repr_html_(self) -> str:
        rows = [(part.pid, part.name, part.rounds, part.end.value) for part in self.parts]
        return html_table(repr(self), ("robot", "part", "rounds", "end"), rows)


def merge(
    parts: Iterable[str | os.PathLike[str]],
    *,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Merged:
    """Merge what robots of a deployed run have told to one trace, and judge it by the rules.

    ``parts`` are files that ``koord deploy --pid I --trace FILE`` wrote, or recordings
    (``--record``). Of robots that were ended, or of which there is no part, what nobody saw is
    filled in as the program allows: sensors by their contracts, states by the rules.

    Raises :class:`koord.CancelledError` on ``cancellation``; and
    :class:`koord.KoordError` for files that are damaged, or of different runs (K918); where
    what is missing cannot be filled in (K918); and where two robots tell that they acted on
    different decisions (K919).

    >>> koord.merge(["part0.jsonl", "part1.jsonl"]).trace.save("run.json")
    """
    loading, tell = _Loading(), _Telling(heard_by(progress), cancellation)
    read: list[Part] = []
    for path in parts:
        tell.step(f"reading {visible(os.fspath(path))}")
        read += _read(os.fspath(path), loading)
    if not read:
        raise ArgumentError("parts", "there is no part to merge")
    return _merged(_one_of_each(read), tell)


class _Telling(Struct, frozen=True):
    """What is told of the progress of a merge, and whether to go on."""

    listener: Listener
    cancellation: Cancellation | None

    def step(self, message: str, round_: int | None = None) -> None:
        """Tell of a step. Raises CancelledError."""
        if self.cancellation is not None and self.cancellation.requested:
            raise ended(self.cancellation, "merging")
        self.listener(Progress(message, round_))


def _merged(parts: Mapping[int, Part], tell: _Telling) -> Merged:
    """As :func:`merge`, of the parts of one run by pid."""
    first = next(iter(parts.values()))
    subject = first.whose.subject
    system = subject.system
    missing = tuple(pid for pid in range(system.robots) if pid not in parts)
    try:
        heard = Heard.of((pid, part.told) for pid, part in parts.items())
    except DisagreementError as error:
        files = " and ".join(dict.fromkeys(parts[pid].name for pid in error.robots))
        raise refusal("K919", files, str(error)) from None
    coverage = heard.coverage(system.robots)
    if INIT_ROUND not in heard.decisions:
        raise refusal("K918", first.name, "no part tells how the run began", _cure(missing))
    of = f"of {coverage.rounds}"

    def filled(number: int) -> None:
        tell.step(f"filling in what nobody saw, round {number + 1} {of}", number + 1)

    gathering = gathered(subject.sources, system, heard, passed=filled)
    ran = gathering.run
    lasting = (one for one in gathering.choices if one.asked is None)
    watch = Watch.of(ran.trace, {(one.function, one.arguments) for one in lasting})

    def seen(step: Step) -> None:
        tell.step(f"judging, round {step.round + 1} {of}", max(0, step.round))
        watch.see(step)

    judged = judge(ran, seen)
    refused = judged.refused
    unseen = {pid: r for pid, r in coverage.unseen.items() if refused and r <= refused.step.round}
    if ran.gave_up is not None or unseen:
        why = ran.gave_up.diagnostics[0].message if ran.gave_up is not None else ""
        if refused is not None:
            why = f"in round {refused.step.round + 1}, {refused.reason} [{refused.rule}]"
        whose = ", ".join(map(str, unseen or missing)) or "that were ended"
        story = f"what robots {whose} did cannot be filled in: {why}"
        if isinstance(ran.gave_up, UndecidedError):
            story = why
        raise refusal("K918", first.name, story, _cure(missing))
    return Merged(
        trace=Trace(judged.trace),
        parts=tuple(_described(parts[pid]) for pid in sorted(parts)),
        missing=missing,
        rounds_told=coverage.rounds,
        refused=refused,
        broken=watch.violation if refused is None else None,
        unjudged=watch.unjudged,
        presumed=gathering.presumptions,
    )


def _cure(missing: tuple[int, ...]) -> str | None:
    if not missing:
        return None
    return f"name the parts of the robots {', '.join(map(str, missing))} as well"


def _described(part: Part) -> PartRead:
    acted = [one.decision.round for one in part.told if isinstance(one, Acted)]
    end = PartEnd.SILENT
    if part.is_torn:
        end = PartEnd.TORN
    elif part.told and isinstance(part.told[-1], Left):
        end = PartEnd.LEFT
    missed = sum(one.reports for one in part.told if isinstance(one, Missed))
    return PartRead(part.whose.pid, part.name, max(acted, default=-1) + 1, end, missed)


def _one_of_each(parts: Iterable[Part]) -> dict[int, Part]:
    """The part of each robot. Raises KoordError where they are not of one run."""
    found: dict[int, Part] = {}
    first: Part | None = None
    for part in parts:
        first = part if first is None else first
        differs = difference(first.whose, part.whose)
        if differs is not None:
            raise _apart(first, part, differs)
        pid = part.whose.pid
        before = found.setdefault(pid, part)
        if before is part:
            continue
        longer, shorter = sorted((before, part), key=lambda one: -len(one.told))
        if repr(longer.told[: len(shorter.told)]) != repr(shorter.told):
            raise _apart(before, part, f"these are two parts of robot {pid}, which differ")
        found[pid] = longer
    return found


def _apart(one: Part, other: Part, story: str) -> KoordError:
    hint = f"leave out {other.name}, or {one.name}"
    return refusal("K918", other.name, f"it does not belong to {one.name}: {story}", hint)


class _Loading(Struct):
    """What was read already: all parts of a run hold the same program, and many the same values."""

    programs: dict[str, core.Program] = {}
    known: Known = field(default_factory=Known)

    def load(self, sources: Sources) -> core.Program:
        texts = [text.text for text in sources.texts]
        key = repr((texts, sources.params, sources.tasks))
        if key not in self.programs:
            self.programs[key] = load_embedded(sources)
        return self.programs[key]


def _read(path: str, loading: _Loading) -> Iterator[Part]:
    """The parts in a file. Raises KoordError."""
    name, raw = visible(path), read_written(path)
    if not is_record(raw):
        yield read_part(raw, name, loading.load, loading.known)
        return
    require(("mcap",), "record")
    lines: dict[str, list[bytes]] = {}
    try:
        for topic, line in read_messages(raw, PARTS):
            lines.setdefault(topic, []).append(line)
    except DamagedRecordError as error:
        raise refusal("K910", name, f"the recording is damaged: {error}") from None
    if not lines:
        hint = "recordings of deployed robots have them (`record=`)"
        raise refusal("K911", name, "the recording has no parts of a run", hint)
    for topic in sorted(lines):
        yield read_lines(lines[topic], f"{name}{topic}", loading.load, loading.known)
