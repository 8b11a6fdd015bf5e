"""Runs as tables, one round at a time: events, changes and output.

round 2, to t = 0.2 s
  0     Add   total: 0 → 0, done: false → true
              stdout: "total 0"
  1, 2  skip
  env         Heater.temp@1: 70 → 70.1
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from msgspec import Struct, field

from koord.api.column_texts import ColumnTexts, NotPlainError
from koord.cli.terminal import Paint, Style, visible
from koord.semantics.configurations import Configuration, Written
from koord.semantics.domain import Constant
from koord.semantics.recordings import Recording, Step
from koord.semantics.storage import Storage
from koord.syntax.system import System
from koord.traces.changes import Change, changes
from koord.traces.names import Named, Names
from koord.traces.rendering import UNSET, repeats, show_fraction, show_output, show_storage

if TYPE_CHECKING:
    from koord.api.run import MadeRound, TakenStep

#: Of what one step changed, so many lines are shown.
_MOST_LINES = 12

#: Longer lists of robots are told as their number.
_WIDEST_WHO = 24

ENVIRONMENT = "env"


class ShownStep(Struct, frozen=True):
    """A step of a round, prepared for display."""

    step: Step
    before: Configuration[Constant]
    lost: str | None = None  #: the event that the robot could not run: a lock was taken


class _Row(Struct, frozen=True):
    """A row of a table: the robots, the event, and its effects."""

    who: str
    ran: str
    pieces: tuple[str, ...]
    output: tuple[str, ...] = ()
    paint: Paint | None = None


class RunTable(Struct):
    """A layout of runs as tables. Idle rounds are counted and shown together."""

    names: Names
    style: Style
    _idle: list[int] = field(default_factory=list)
    _texts: ColumnTexts | None = None

    @property
    def system(self) -> System:
        return self.names.system

    # --- the start ------------------------------------------------------------------------------

    def start(self, step: Step) -> Iterator[str]:
        """The configuration after INIT."""
        yield self.style.paint("start", Paint.BOLD)
        rows = [] if step.configuration.fault is not None else self._whole(step.configuration)
        rows += [_Row("", "", (), (line,)) for line in _written(step.stepped.output)]
        if not rows and step.configuration.fault is None:
            rows = [_Row("all", "", ("there are no variables",))]
        yield from self._laid_out(rows)
        yield from self._fault(step)

    def configuration(self, configuration: Configuration[Constant]) -> Iterator[str]:
        """Lay out the values of all variables, without a heading."""
        yield from self._laid_out(self._whole(configuration))

    def _whole(self, configuration: Configuration[Constant]) -> list[_Row]:
        rows = [_Row("all", "", tuple(self._shared(configuration)))]
        for number, robot in enumerate(configuration.robots):
            own = self.names.of(number)
            pieces = _held((*own.locals, *own.ports), (*robot.locals, *robot.ports))
            rows.append(_Row(self._robot(number), "", tuple(pieces)))
        return [row for row in rows if row.pieces]

    def step(
        self,
        ran: Sequence[str],
        before: Configuration[Constant],
        after: Configuration[Constant],
    ) -> Iterator[str]:
        """Lay out a round as a whole: each robot's event ("" for a skip), and all changes."""
        found = list(changes(self.names, before, after))
        rows = []
        for number, event in enumerate(ran):
            own = [change for change in found if change.robot == number]
            pieces = tuple(change.told(number) for change in own)
            if event or pieces:
                rows.append(_Row(self._robot(number), event or "skip", pieces))
        shared = tuple(change.told() for change in found if change.robot is None)
        if shared:
            rows.append(_Row("all", "", shared))
        yield from self._laid_out(rows or [_Row("all", "", ("nothing changes",))])

    def _shared(self, configuration: Configuration[Constant]) -> Iterator[str]:
        store = configuration.store
        names = (*self.names.allread, *self.names.allwrite)
        yield from _held(names, (*store.allread, *store.allwrite))

    def _robot(self, number: int) -> str:
        kind = self.system.agent(number).name
        return f"{number} {kind}".rstrip()

    # --- rounds ---------------------------------------------------------------------------------

    def round(self, number: int, steps: list[ShownStep]) -> Iterator[str]:
        """The steps of a round, whole or broken off. Rounds count from 1 for those who read."""
        rows = list(self._rows(steps))
        if not rows and steps[-1].step.configuration.fault is None:
            self._idle.append(number + 1)
            return
        yield from self._round(number, rows)
        for shown in steps:
            yield from self._fault(shown.step)

    def _round(self, number: int, rows: list[_Row]) -> Iterator[str]:
        yield from self.idle()
        yield self.heading(number)
        yield from self._laid_out(rows)

    def made_round(self, made: MadeRound) -> Iterator[str]:
        """A round that code made, as :meth:`round` lays it out. Raises NotPlainError."""
        rows = self._rows_of(made)
        if rows:
            yield from self._round(made.number, rows)
        else:
            self._idle.append(made.number + 1)

    def _rows_of(self, made: MadeRound) -> list[_Row]:
        if self._texts is None:
            self._texts = ColumnTexts(self.names)
        if made.evolved is not None:
            raise NotPlainError
        texts, logged = self._texts, made.code.logged
        rows: list[_Row] = []
        skipped: list[str] = []
        for turn in made.log.turns:
            robot, event, lost, _, _, written, _ = turn
            if event is None:
                if lost is None:
                    skipped.append(str(robot))
                else:
                    name = self.system.agent(robot).events[lost].name
                    rows.append(_Row(self._robot(robot), "skip", (f"{name} lost its lock",)))
                continue
            pieces = texts.told(logged.of_turn(turn), robot)
            if not pieces and not written:
                pieces = ("nothing changes",)
            name = self.system.agent(robot).events[event].name
            output = tuple(_written(written)) if written else ()
            rows.append(_Row(self._robot(robot), name, pieces, output))
        pieces = texts.told(logged.of_environment(made.log), None)
        if pieces:
            rows.append(_Row(ENVIRONMENT, "", pieces))
        _insert_skips(rows, skipped)
        return rows

    def heading(self, number: int) -> str:
        """The line above a round."""
        time = show_fraction(self.system.delta_s * (number + 1))
        return self.style.paint(f"round {number + 1}, to t = {time} s", Paint.BOLD)

    def idle(self) -> Iterator[str]:
        """One line for the rounds before, if nothing happened in them."""
        if self._idle:
            first, last = self._idle[0], self._idle[-1]
            which = f"round {first}" if first == last else f"rounds {first} to {last}"
            yield self.style.paint(f"{which}: everyone skips, nothing changes", Paint.GUTTER)
            self._idle = []

    def looped(self, recording: Recording) -> Iterator[str]:
        """One line in front of the rounds that repeat, after what was before. [LASSO]"""
        yield from self.idle()
        yield self.style.paint(f"from here on {repeats(recording)}:", Paint.BOLD)

    def goes_on(self, recording: Recording, changed: Sequence[str]) -> str:
        """The line behind the rounds that repeat; ``changed`` is what they do not come back to."""
        assert recording.loop is not None
        line = f"... and again from round {recording.loop + 1} on"
        if changed:
            shown = ", ".join(changed[:3]) + (" and others" if len(changed) > 3 else "")
            line += f", with other values of {shown}, on which nothing depends"
        return self.style.paint(line, Paint.BOLD)

    def rows(self, steps: list[ShownStep]) -> Iterator[str]:
        """The lines of some steps, without a heading."""
        yield from self._laid_out(list(self._rows(steps)))
        for shown in steps:
            yield from self._fault(shown.step)

    def _rows(self, steps: list[ShownStep]) -> Iterator[_Row]:
        """The rows of steps; none if nobody did anything."""
        rows: list[_Row] = []
        skipped: list[str] = []
        for shown in steps:
            step = shown.step
            found = list(changes(self.names, shown.before, step.configuration))
            if step.rule == "SKIP" and shown.lost is None and not found:
                assert step.robot is not None
                skipped.append(str(step.robot))
            elif step.rule != "ENV-TRANS":
                rows.append(self._of_robot(shown, found))
            elif found or step.stepped.promises:
                rows.append(self._of_environment(step, found))
        _insert_skips(rows, skipped)
        yield from rows

    def _of_robot(self, shown: ShownStep, found: list[Change]) -> _Row:
        step = shown.step
        assert step.robot is not None
        who = self._robot(step.robot)
        pieces = [change.told(step.robot) for change in found]
        ran = step.event if step.event is not None else "skip"
        if shown.lost is not None:
            pieces.insert(0, f"{shown.lost} lost its lock")
        elif not pieces and not step.stepped.output and step.configuration.fault is None:
            pieces.append("nothing changes")
        return _Row(who, ran, tuple(pieces), tuple(_written(step.stepped.output)))

    def _of_environment(self, step: Step, found: list[Change]) -> _Row:
        pieces = [change.told() for change in found]
        broken = [
            f"contract {c.name} of robot {robot} is broken" for robot, c in step.stepped.promises
        ]
        return _Row(ENVIRONMENT, "", (*pieces, *broken))

    def _fault(self, step: Step) -> Iterator[str]:
        fault = step.configuration.fault
        if fault is not None:
            whose = "" if fault.robot is None else f"robot {fault.robot}: "
            detail = f" ({fault.detail})" if fault.detail else ""
            yield "  " + self.style.paint(f"fault: {whose}{fault.kind.value}{detail}", Paint.ERROR)

    # --- layout ---------------------------------------------------------------------------------

    def _laid_out(self, rows: list[_Row]) -> Iterator[str]:
        who = max((len(row.who) for row in rows), default=0)
        ran = max((len(visible(row.ran)) for row in rows), default=0)
        margin = 2 + who + 2 + (ran + 2 if ran else 0)
        width = max(self.style.width - margin, 30)
        for row in rows:
            ran_text = visible(row.ran).ljust(ran)
            if row.paint is not None or row.ran == "skip":
                ran_text = self.style.paint(ran_text, Paint.GUTTER)
            head = f"  {row.who.ljust(who)}  " + (f"{ran_text}  " if ran else "")
            lines = list(_filled(row.pieces, width))
            lines += [line for text in row.output for line in _filled((text,), width)]
            if len(lines) > _MOST_LINES:
                more = len(lines) - _MOST_LINES
                lines = [*lines[:_MOST_LINES], f"... and {more} more lines"]
            yield (head + (lines[0] if lines else "")).rstrip()
            for line in lines[1:]:
                yield " " * margin + line


class Rounds:
    """A printer of a run's steps, round by round, as each round ends."""

    def __init__(self, table: RunTable) -> None:
        self._table = table
        self._steps: list[ShownStep] = []
        self._last: Configuration[Constant] | None = None

    def show_round(self, made: MadeRound) -> None:
        """Show a whole round, which code made."""
        try:
            lines = list(self._table.made_round(made))
        except NotPlainError:
            for taken in made.steps():
                self.show(taken)
        else:
            self._print(lines)

    def show(self, taken: TakenStep) -> None:
        """Show the next step of the run."""
        step = taken.step
        before = taken.before if taken.before is not None else self._last
        if before is None:
            self._print(self._table.start(step))
        else:
            self._steps.append(ShownStep(step, before, taken.lost))
            if step.rule == "ENV-TRANS":
                self._end_round()
        self._last = step.configuration

    def close(self) -> None:
        """Show what is left: a round that was not finished, rounds in which nothing happened."""
        if self._steps:
            self._end_round()
        self._print(self._table.idle())

    def _end_round(self) -> None:
        self._print(self._table.round(self._steps[0].step.round, self._steps))
        self._steps = []

    @staticmethod
    def _print(lines: Iterable[str]) -> None:
        whole = list(lines)
        if whole:
            print("\n".join(whole))


def _insert_skips(rows: list[_Row], skipped: list[str]) -> None:
    """Add a row for those who skip, in front of the environment's, if anybody did anything."""
    if skipped and rows:
        at = len(rows) - (rows[-1].who == ENVIRONMENT)
        who = ", ".join(skipped)
        who = who if len(who) <= _WIDEST_WHO else f"{len(skipped)} robots"
        rows.insert(at, _Row(who, "skip", (), paint=Paint.GUTTER))


def _held(named: Iterable[Named], storages: Iterable[Storage[Constant]]) -> Iterator[str]:
    """The values of variables; after those that are set, the names of those that are not."""
    unset = []
    for one, storage in zip(named, storages, strict=True):
        shown = show_storage(storage, one.type)
        if shown == UNSET:
            unset.append(one.name)
        else:
            yield f"{one.name} = {shown}"
    if unset:
        *others, last = unset
        yield f"{', '.join(others)} and {last} are unset" if others else f"{last} is unset"


def _written(output: Iterable[Written[Constant]]) -> Iterator[str]:
    for written in output:
        yield f"{written.stream} << {show_output(written.values, written.types)}"


def _filled(pieces: Sequence[str], width: int) -> Iterator[str]:
    """Join pieces with commas, as many to a line as fit; long ones take several lines."""
    line = ", ".join(pieces)
    if len(line) <= width and line.isprintable():
        if line:
            yield line
        return
    line = ""
    shown = [visible(piece) for piece in pieces]
    for position, piece in enumerate(shown):
        if position + 1 < len(shown):
            piece += ","
        if line and len(line) + 1 + len(piece) > width:
            yield line
            line = ""
        line = f"{line} {piece}" if line else piece
        if len(line) > width:
            *whole, line = textwrap.wrap(line, width, subsequent_indent="  ") or [""]
            yield from whole
    if line:
        yield line
