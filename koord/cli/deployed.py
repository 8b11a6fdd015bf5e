"""The live table of a deployed run, and its summary."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.table import Table

from koord.api.deployed import Deployed, FleetHeard
from koord.cli.progress import LiveLine
from koord.cli.terminal import visible

if TYPE_CHECKING:
    from koord.api.breaches import BrokenStatement
    from koord.api.deployed import ProcessReport, RobotReport

#: More robots than this nobody reads; the rest is told in the last row.
MOST_ROWS = 40

#: Of a screen's lines, those that are no robot's.
_OTHER_LINES = 4


_HOLDS = "holds: "

#: Robots hold for a moment now and then: only what lasts longer is worth a line.
_LASTING_S = 1.0


class Board:
    """A table that is redrawn while robots run; without a terminal, lines of what is noticed."""

    def __init__(self, *, waits: bool = False) -> None:
        """Make a board; one that ``waits`` leaves the terminal to a question before the run."""
        self._waits = waits
        self._console = Console(stderr=True)
        self._live: Live | None = None
        self._line: LiveLine | None = None
        self._lines = Lines(self._print)
        self._shown_at = 0.0
        self.is_stopping = False

    def __enter__(self) -> Board:
        if not self._waits:
            self._begin()
        return self

    def _begin(self) -> None:
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False, transient=True)
            self._live.start()

    def __exit__(self, *_: object) -> None:
        self._close()
        if self._line is not None:
            self._line.__exit__()

    def announce(self, text: str) -> None:
        """Show a line for good, above the table."""
        if self._live is not None:
            with suppress(OSError):
                self._live.console.print(visible(text), highlight=False)
        else:
            self._print(text)

    def say(self, text: str) -> None:
        """Show what is done after the run, in place of the table."""
        if self._line is None:
            self._close()
            self._line = LiveLine(sys.stderr).__enter__()
        self._line.show(text)

    def show(self, heard: FleetHeard) -> None:
        """Show the present status of the robots."""
        now = time.monotonic()
        if self._waits:
            if not heard.statuses or any(status.checks for status in heard.statuses.values()):
                return  # people look at these, and are asked
            self._waits = False
            self._begin()
        if not self._console.is_terminal:
            self._lines.hear(heard, now)
        if self._live is None or now < self._shown_at + 0.2:
            return
        self._shown_at = now
        rows = max(1, min(MOST_ROWS, self._console.height - _OTHER_LINES))
        made = table(heard, rows)
        if self.is_stopping:
            made.title = f"{made.title}, stopping (Ctrl-C again: at once)"
        try:
            self._live.update(made, refresh=True)
        except OSError:
            self._close()  # the terminal went away; the robots go on, or come to a safe stop

    def _print(self, line: str) -> None:
        with suppress(OSError):  # nobody reads it any more; the robots go on
            print(visible(line), file=sys.stderr, flush=True)

    def _close(self) -> None:
        if self._live is not None:
            with suppress(OSError):
                self._live.stop()
            self._live = None


class Lines:
    """What is remarkable about robots, a line each time that it begins or ends."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._since: dict[tuple[int, str], float] = {}
        self._said: set[tuple[int, str]] = set()
        self._holding: set[int] = set()  #: the robots of which that was said
        #: the claims that did not hold, of which that was said
        self._broken: set[tuple[str, tuple[int, ...]]] = set()

    def hear(self, heard: FleetHeard, now: float) -> None:
        """Say what is new, and what is over."""
        for one in heard.broken:
            if one.key not in self._broken:
                self._broken.add(one.key)
                for line in breach_lines(one):
                    self._say(line)
        remarks = {
            (pid, remark)
            for pid, status in heard.statuses.items()
            if not status.is_over
            for remark in _remarks(status, heard.processes.get(pid))
        }
        self._since = {one: self._since.get(one, now) for one in remarks}
        self._said &= remarks
        new: dict[str, list[int]] = {}
        for pid, remark in sorted(remarks - self._said):
            holds = remark.startswith(_HOLDS)
            if not holds or now >= self._since[pid, remark] + _LASTING_S:
                self._said.add((pid, remark))
                self._holding |= {pid} if holds else set()
                new.setdefault(remark, []).append(pid)
        still = {pid for pid, remark in remarks if remark.startswith(_HOLDS)}
        for pid in sorted(self._holding - still):
            status = heard.statuses.get(pid)
            process = heard.processes.get(pid)
            is_lost = process is not None and process.is_lost
            if status is not None and not status.is_over and not is_lost:
                new.setdefault(f"goes on, in round {status.round}", []).append(pid)
        self._holding &= still
        for remark, pids in new.items():
            self._say(f"{_named(pids)}: {remark}")


def _named(pids: list[int]) -> str:
    """Robots by pid, in words: ``robots 0, 3–7``."""
    spans: list[list[int]] = []
    for pid in pids:
        if spans and spans[-1][-1] == pid - 1:
            spans[-1].append(pid)
        else:
            spans.append([pid])
    said = [f"{one[0]}–{one[-1]}" if len(one) > 2 else ", ".join(map(str, one)) for one in spans]
    return f"robot {said[0]}" if len(pids) == 1 else f"robots {', '.join(said)}"


def _remarks(status: RobotReport, process: ProcessReport | None) -> Iterator[str]:
    if status.checks:
        return  # people look at these
    if process is not None and process.story:
        yield process.story
    if process is None or not process.is_lost:
        yield from filter(None, (_doing(status), *status.notes))


def table(heard: FleetHeard, rows: int = MOST_ROWS) -> Table:
    """A row for each robot; if there are too many, first those with something to report."""
    statuses, lags, processes = heard.statuses, heard.lags(), heard.processes
    title = f"round {heard.round}" + ("" if heard.rounds is None else f" of {heard.rounds}")
    made = Table(title=title, title_justify="left", box=None, pad_edge=False)
    shown = sorted(statuses)
    if len(shown) > rows:
        shown = sorted(shown, key=lambda pid: (not story(statuses[pid], processes.get(pid)), pid))[
            :rows
        ]
    for name in ("robot", "round", "lag", "ran", "skipped", "late", "dropped", "coordinator"):
        made.add_column(name, justify="right")
    made.add_column("")
    for pid in sorted(shown):
        status = statuses[pid]
        made.add_row(
            str(pid),
            str(status.round),
            str(lags[pid]),
            str(status.ran),
            str(status.skipped),
            str(status.late),
            str(sum(n for _, n in status.drops)),
            "-" if status.coordinator is None else str(status.coordinator),
            story(status, processes.get(pid)),
        )
    if len(statuses) > len(shown):
        made.add_row("…", "", "", "", "", "", "", "", f"and {len(statuses) - len(shown)} more")
    if heard.broken:
        said = (line for one in heard.broken for line in breach_lines(one))
        made.caption, made.caption_justify = "\n".join(said), "left"
    return made


def story(status: RobotReport, process: ProcessReport | None = None) -> str:
    """The remark on a robot in the table: how it is doing, and what it has noticed."""
    return "; ".join(filter(None, (_standing(status, process), *status.notes)))


def _standing(status: RobotReport, process: ProcessReport | None) -> str:
    """How a robot is doing; of its process, if that was lost."""
    if process is None:
        return _doing(status)
    if process.is_lost:
        return process.story
    return "; ".join(filter(None, (_doing(status), process.restarted)))


def _doing(status: RobotReport) -> str:
    if status.trouble is not None:
        return f"stopped: {status.trouble}"
    if status.fault is not None:
        return f"fault: {status.fault}"
    if status.is_over:
        return "done"
    if status.all_stopped:
        return "all have stopped"
    if status.is_mute:
        return "came back without its journal: runs no events"
    if status.holding is None:
        return ""
    whom = ", ".join(map(str, status.waiting_for))
    return f"{_HOLDS}{status.holding.value}" + (f": {whom}" if whom else "")


def _division(deployed: Deployed) -> str:
    """The numbers of robots by kind, if there are several kinds: `` (2 Car, 1 Drone)``."""
    if len(deployed.agents) == 1:
        return ""
    each = (f"{deployed.kinds.count(k)} {name}" for k, name in enumerate(deployed.agents))
    return f" ({', '.join(each)})"


def summary(deployed: Deployed) -> str:
    """A deployed run in some lines."""
    statuses = deployed.statuses
    if not statuses:
        return "no robot has said anything"
    everyone = list(statuses.values())
    last = max(status.round for status in everyone)
    done = max(0, last)
    behind = [str(status.pid) for status in everyone if status.round < last]
    sent = sum(status.sent for status in everyone)
    ran = sum(status.ran for status in everyone)
    skipped = sum(status.skipped for status in everyone)
    whose = f"{len(deployed.kinds)} robots{_division(deployed)}"
    if len(everyone) == 1:
        whose = f"robot {everyone[0].pid}"
    lines = [
        f"{done} rounds of {whose}: "
        f"{ran} events, {skipped} skips, {sum(s.late for s in everyone)} of them late",
        f"{sent} datagrams sent, {sent / max(1, done + 1):.1f} a round; "
        f"longest round {max(s.longest_s for s in everyone):.3f} s; "
        f"{max(s.overdue for s in everyone)} rounds overdue",
        f"epoch {max(s.epoch for s in everyone)}; dropped: "
        + (", ".join(f"{n} {reason}" for reason, n in sorted(deployed.drops.items())) or "nothing"),
    ]
    written = max(status.written for status in everyone)
    if written:
        lines.append(f"journals: at most {written / max(1, done + 1):,.0f} bytes a round and robot")
    if all(status.all_stopped for status in everyone):
        lines.append("all robots have stopped")
    elif behind:
        lines.append(f"not at the last round: {', '.join(behind)}")
    ends = {pid: one.story for pid, one in deployed.processes.items() if one.story}
    untold = [status for status in everyone if status.pid not in ends]
    lines += sorted({_doing(status) for status in untold if status.fault or status.trouble})
    lines += [f"robot {pid}: {ends[pid]}" for pid in sorted(ends)]
    if deployed.stuck is not None:
        lines.append(deployed.stuck)
    for one in deployed.broken:
        lines += breach_lines(one)
    if deployed.unwatched:
        lines.append(f"not watched: {', '.join(deployed.unwatched)} (`koord merge` judges them)")
    return "\n".join(lines)


def breach_lines(one: BrokenStatement) -> Iterator[str]:
    """What is told of a claim that did not hold."""
    detail = f" {one.detail}" if one.detail else ""
    yield f"{one}{detail}"
    yield f"  {one.place}"
    yield from (f"    {line}" for line in one.text.splitlines())
    if one.rested:
        yield f"  what was proved of {', '.join(one.rested)} rests on it"
