"""The suite with checks side by side, each group of them against a peer of its own. (P-KIT-JOBS)

What a driver is tested for is mostly seen by waiting for its vehicle. Checks that do not rest on
each other's findings so take place at the same time, in processes of their own: a driver is one
client of its libraries in each, as on a robot.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Collection, Iterator, Sequence
from queue import Empty, Queue

import msgspec

from koord.testing.conformance.bench import Call, Check
from koord.testing.conformance.failing import judge_calls
from koord.testing.conformance.findings import Failed, Finding, Measure, Measures, Verdict
from koord.testing.conformance.lane import Lane, Said
from koord.testing.conformance.running import CHECKS, NAMES

#: Checks in the groups that stay together, those that take longest first. What the first of a group
#: has led a vehicle along, deployed or frozen, the others look at as well.
GROUPS = (
    ("program", "twin"),
    ("frames", "attitude", "velocity", "units", "speed"),
    ("dead-man",),
    ("fence",),
    ("holds",),
    ("lands",),
    ("link",),
    (
        *("nobody-there", "opens", "options", "capabilities", "pose", "stays", "stamps", "ports"),
        "battery",
    ),
    ("stale", "remarks", "second", "restarts"),
    ("e-stop",),
)

#: It judges the calls of all others, and is made at the end.
LAST = "blocks"

#: So often it is asked whether somebody wants the end.
_LOOK_S = 0.1

_BY_NAME = {check.name: check for check in CHECKS}

#: What comes of a process: its lane, and what it says; None: it has ended.
_News = tuple[int, Said | None]


def beside(
    lane: Callable[[int, tuple[str, ...]], Lane],
    jobs: int,
    only: Collection[str] = NAMES,
    begins: Callable[[Check], None] = lambda check: None,
    is_cancelled: Callable[[], bool] = lambda: False,
) -> Iterator[Finding]:
    """Make the checks of these names, so many groups of them at once; yield what each finds.

    ``lane`` makes of a number and of checks what a process is to do: each has a peer of its own.
    Findings come as they are made. All vehicles are at rest at the end, which comes early where
    somebody asks for it.
    """
    groups = [chosen for one in GROUPS if (chosen := tuple(c for c in one if c in only))]
    if LAST in only and not groups:
        groups = [(LAST,)]
    waiting = [lane(number, checks) for number, checks in enumerate(groups)]
    running: dict[int, Running] = {}
    news: Queue[_News] = Queue()
    calls: list[Call] = []
    begun, is_ending = 0, False
    starting: int | None = None  #: to start is what costs most, and goes one after the other
    try:
        while running or (begun < len(waiting) and not is_ending):
            may_begin = begun < len(waiting) and len(running) < jobs and not is_ending
            if may_begin and starting is None:
                starting, running[begun] = begun, Running(begun, waiting[begun], news)
                begun += 1
            if is_cancelled() and not is_ending:
                is_ending = True
                for one in running.values():
                    one.end()
            try:
                number, said = news.get(timeout=_LOOK_S)
            except Empty:
                continue
            starting = None if number == starting else starting
            if said is None:
                yield from running.pop(number).missing(is_ending)
            elif said.begins is not None:
                begins(_BY_NAME[said.begins])
            elif said.finding is not None:
                running[number].found.add(said.finding.check)
                yield said.finding
            else:
                calls += said.calls or ()
        if LAST in only and (LAST,) not in groups and not is_ending:
            begins(_BY_NAME[LAST])
            yield judged(calls)
    finally:
        for one in running.values():
            one.end()
        for one in running.values():
            one.wait()


def judged(calls: Sequence[Call]) -> Finding:
    """What all calls say of whether the driver blocks."""
    measures, verdict = Measures(), Verdict.PASSED
    try:
        judge_calls(calls, measures)
    except Failed as failed:
        verdict = Verdict.FAILED
        measures.taken.append(failed.measure)
    return Finding(LAST, verdict, tuple(measures.taken))


class Running:
    """The process of a lane."""

    def __init__(self, number: int, lane: Lane, news: Queue[_News]) -> None:
        self.found: set[str] = set()
        self._number, self._lane, self._news = number, lane, news
        self._error = b""
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-m", "koord.testing.conformance.lane"),
                msgspec.json.encode(lane).decode(),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={
                **os.environ,
                **lane.environment,
                "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
            },
            start_new_session=True,  # Ctrl-C is heard here, and told by the end of its input
        )
        self._listening = [
            threading.Thread(target=listen, daemon=True) for listen in (self._errors, self._listen)
        ]
        for one in self._listening:
            one.start()

    def end(self) -> None:
        """Ask it to bring its vehicle to rest, and to end."""
        assert self._process.stdin is not None
        self._process.stdin.close()

    def wait(self) -> None:
        """Wait until it has ended."""
        for one in self._listening:
            one.join()
        self._process.wait()

    def missing(self, is_ending: bool) -> Iterator[Finding]:
        """What it owes, if it has ended before its time: checks that failed with it."""
        self.end()
        self.wait()
        if is_ending:
            return
        said = self._error.decode(errors="replace").strip()[-400:]
        seen = f"the process of the check ended with {self._process.returncode}: {said}"
        for check in self._lane.checks:
            if check not in self.found:
                yield Finding(check, Verdict.FAILED, (Measure(seen, ok=False),))

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._news.put((self._number, msgspec.json.decode(line, type=Said)))
        self._process.stdout.close()
        self._news.put((self._number, None))

    def _errors(self) -> None:
        assert self._process.stderr is not None
        with self._process.stderr as stream:
            for line in stream:
                self._error = (self._error + line)[-4000:]
