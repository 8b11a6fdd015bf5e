"""A pool of processes for independent work.

A process is forked from the one that asks: it starts in milliseconds with all that is known so far
(programs, circuits, what a solver was told), and nothing need be sent to it. What it finds out is
sent back. So the answer depends on what was known when the work was handed in, and not on how many
processes there are, nor on which of them is done first. Z3 stops its timers before a fork.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Generic, TypeVar

from msgspec import Struct, field

from koord.syntax.forking import FORKING
from koord.verify.forked import ForkedProcess, Receiver, fork, ready
from koord.verify.helpers import Helpers, PortableWork, lost
from koord.verify.job_process import (
    Begun,
    Found,
    JobChannel,
    Lasting,
    Noted,
    PartedError,
    PartingChannel,
    Progress,
    Unanswered,
    depth,
    do_work,
    end_of,
)

T = TypeVar("T")
K = TypeVar("K")


class _Here(Struct, frozen=True):
    """The channel of work that runs in this process."""

    progress: Progress
    note: Callable[[object], None]

    def __call__(self, text: str) -> None:
        self.progress(text)

    def lasting(self, until: float | None) -> None:
        """Ignore the moment: there is nobody to end this work."""


#: How long answers are waited for at a time.
_WAIT_S = 0.05

#: So many messages of each process are heard before it is looked at what there is to do: some say
#: more all the time.
_MOST_AT_ONCE = 100

#: After Ctrl-C: when processes that did not hear it are told, and when they are ended: those that
#: a process has forked sooner than itself, so that it can still say what it heard of them.
_TOLD_S, _ENDED_S, _SOONER_S = 0.2, 1.0, 0.2


def can_fork() -> bool:
    """Return whether processes can be forked: not in browsers, where there are none."""
    return hasattr(os, "fork") and sys.platform != "emscripten"


class Job(Struct, Generic[T], eq=False):
    """A submitted job. ``name`` is shown in progress reports.

    ``portable`` is work with the same answer that can be done elsewhere, if there is some.

    ``lasts_s`` is for how long its process may go on, and ``until`` when it is ended if it is not
    done (as :func:`time.monotonic` counts): then it ``is_late``. ``noted`` is what it told of
    before it was done, which stays known however it ends, and which is ``heard`` as it comes;
    ``told`` is what it was at last.
    ``share_until`` is when it is ended if it says nothing else by then: then it ``is_overdue``.
    ``lasted_s`` is for how long its process went on. Where it does not ``count``, progress reports
    say nothing of how many jobs there are. ``why`` it has no answer is known of what was asked
    elsewhere. It is to ``load`` what other work needs, too, before it has a process.
    """

    name: str
    work: Callable[[JobChannel], T]
    portable: PortableWork | None = None
    lasts_s: float | None = None
    until: float | None = None
    process: ForkedProcess | None = None
    line: Receiver | None = None
    is_done: bool = False
    is_late: bool = False
    share_until: float | None = None
    is_overdue: bool = False
    found: T | None = None
    failure: Exception | None = None
    noted: list[object] = field(default_factory=list)
    heard: Callable[[object], None] = lambda value: None
    told: str = ""
    started: float | None = None
    ends_at: float | None = None
    lasted_s: float = 0.0
    exit_code: int | None = None
    counts: bool = True
    why: str = ""
    load: Callable[[], object] = lambda: None

    def note(self, value: object) -> None:
        """Note what it told of."""
        self.noted.append(value)
        self.heard(value)

    @property
    def end(self) -> str:
        """The reason why the job's process ended without doing its work, in words."""
        if self.is_late or self.is_overdue:
            return "it did not end when its share of the time was over"
        return self.why or end_of(self.exit_code)


class Pool(Struct):
    """A pool of up to ``jobs`` processes; the caller counts as one unless it waits.

    Inside a ``with``, at whose end no process is left. ``interrupted`` is asked while it waits.
    With ``helpers`` they do what is portable, all at a time, and other work is done here.
    """

    jobs: int = 1
    progress: Progress = lambda text: None
    interrupted: Callable[[], bool] = lambda: False
    helpers: Helpers | None = None
    _waiting: list[Job[object]] = field(default_factory=list)
    _running: list[Job[object]] = field(default_factory=list)
    _leaving: list[Job[object]] = field(default_factory=list)  #: which end by themselves
    _is_entered: bool = False
    _done: int = 0
    _stopped_at: float | None = None
    _told: bool = False

    def __enter__(self) -> Pool:
        self._is_entered = True
        return self

    def __exit__(self, *_: object) -> None:
        self._waiting.clear()
        for job in list(self._running):
            self.drop(job)
        self._is_entered = False
        self.reap()

    def submit(
        self,
        name: str,
        work: Callable[[JobChannel], T],
        *,
        portable: PortableWork | None = None,
        lasts_s: float | None = None,
        until: float | None = None,
        counts: bool = True,
        first: bool = False,
        heard: Callable[[object], None] = lambda value: None,
        load: Callable[[], object] = lambda: None,
    ) -> Job[T]:
        """Submit work. The caller must not change what the work reads before it is done.

        Before a process is forked for it this one is to ``load`` what other work needs, too.

        With ``portable`` helpers, if there are any, do that instead. The answer must be the same.
        What is to be done ``first`` goes before all that waits.
        """
        if not self._running and not self._waiting:
            self._done = 0
        job: Job[T] = Job(
            name, work, portable, lasts_s, until, counts=counts, heard=heard, load=load
        )
        self._waiting.insert(0 if first else len(self._waiting), job)  # type: ignore[arg-type]
        if can_fork():
            self._listen(0)
            self._fill(self.jobs - 1)
        return job

    def begin_here(
        self,
        name: str,
        work: Callable[[JobChannel], T],
        *,
        is_long: Callable[[object], bool],
        until: float | None = None,
    ) -> Job[T]:
        """Do work in this process, until it tells of something by which it ``is_long``.

        Then it goes on in another one, and is a job like others, of which all that it told of is
        known; otherwise the job is done. It does not count in progress reports.
        """
        job: Job[T] = Job(name, work, until=until, counts=False)
        some: Job[object] = job  # type: ignore[assignment]
        _begin(some)
        channel = PartingChannel(partial(self._tell, some), job.note, is_long)
        try:
            job.found = channel.run(work)
            job.is_done = True
        except PartedError as parted:
            job.process, job.line = parted.process, parted.hears
            self._running.append(some)
        except Exception as error:
            job.failure, job.is_done = error, True
        return job

    def drop(self, job: Job[T]) -> None:
        """Drop a job whose result is no longer needed."""
        self._waiting = [other for other in self._waiting if other is not job]
        if any(other is job for other in self._running):
            self._running = [other for other in self._running if other is not job]
            if job.process is not None:
                job.process.send_signal(signal.SIGKILL)
            self._leave(job)
        job.is_done = True

    def reap(self) -> None:
        """Wait for the ends of all processes that have answered or were ended."""
        for job in self._leaving:
            _join(job)
        self._leaving.clear()

    def answer(self, job: Job[T]) -> T | None:
        """Wait for a job's result; None if its process died, as for want of memory, or was ended.

        Raises what the work raised, and KeyboardInterrupt if it could not end in good order.
        """
        if not can_fork():
            self._waiting = [other for other in self._waiting if other is not job]
            return job.work(_Here(self.progress, job.note))
        self.wait(job, lambda: job.is_done)
        if job.failure is not None:
            raise job.failure
        if job.found is None and self.interrupted():
            raise KeyboardInterrupt
        return job.found

    def wait(self, job: Job[T], enough: Callable[[], bool]) -> None:
        """Wait until it is ``enough``, which hangs on what was heard of jobs, of this one at last.

        Raises KeyboardInterrupt if this job could not end in good order.
        """
        while not enough():
            if self._stopped_at is not None or self.interrupted():
                self._stop(job)
            try:
                self._fill(self.jobs)
                self._listen(_WAIT_S)
                self._end_late()
            except KeyboardInterrupt:
                if self._stopped_at is not None:
                    raise
                self._stop_all()

    @property
    def is_stopped(self) -> bool:
        """Whether Ctrl-C came while somebody waited for a job: nothing more is begun."""
        return self._stopped_at is not None

    def answers(self, jobs: Mapping[K, Job[T]]) -> Iterator[tuple[K, T | None]]:
        """Yield the results of jobs, in order.

        After Ctrl-C those that could still say something are heard; then it raises
        KeyboardInterrupt.
        """
        cut = False
        for key, job in jobs.items():
            try:
                found = self.answer(job)
            except KeyboardInterrupt:
                cut = True
                continue
            yield key, found
        if cut or self.interrupted():
            raise KeyboardInterrupt

    # --- processes ------------------------------------------------------------------------------

    def _fill(self, most: int) -> None:
        if self._stopped_at is not None:
            return
        here = list(self._waiting)
        if self.helpers is not None:
            for job in [job for job in here if job.portable is not None]:
                assert job.portable is not None
                here.remove(job)
                self._waiting.remove(job)
                job.line = self.helpers.ask(job.portable)
                self._running.append(job)
        working = sum(job.process is not None for job in self._running)
        for job in here[: max(0, most - working)]:
            job.load()
            self._waiting.remove(job)
            with FORKING:
                process, receives = fork(partial(do_work, job.work, os.getpid()))
            _begin(job)
            job.process, job.line = process, receives
            self._running.append(job)

    def _listen(self, wait_s: float) -> None:
        """Hear all that was said by now; if it is nothing, wait for something for so long.

        Where this process was late, one that has all answers may have ended another one, which
        says so in fewer words: nobody is begun in its place before both are heard.
        """
        lines = {job.line: job for job in self._running if job.line is not None}
        for _ in range(_MOST_AT_ONCE):
            heard = ready(list(lines), wait_s)
            for line in heard:
                self._hear(lines[line], line)
                if lines[line].is_done:
                    del lines[line]
            if not (heard and lines):
                return
            wait_s = 0.0

    def _hear(self, job: Job[object], line: Receiver) -> None:
        try:
            said = line.receive()
        except (EOFError, OSError):
            # It died: nothing comes.
            said = Found(None, lost() if job.process is None else None)
        match said:
            case str():
                self._tell(job, said)
            case Noted(value=value):
                job.note(value)
            case Lasting(until=until):
                job.share_until = until
            case Begun(where=where):
                job.noted.clear()  # whoever was at it before has died
                _begin(job)
                self._tell(job, f"on {where}")
            case Unanswered():
                job.why, job.is_overdue = said.why, said.is_overdue
                self._put_away(job)
            case Found():
                job.found, job.failure = said.answer, said.failure
                self._put_away(job)

    def _put_away(self, job: Job[object]) -> None:
        job.is_done = True
        if job.started is not None:
            job.lasted_s = time.monotonic() - job.started
        self._running.remove(job)
        self._done += job.counts
        if job.found is None:
            _join(job)  # how it ended may be asked
        else:
            self._leave(job)

    def _leave(self, job: Job[T]) -> None:
        """Let a process end, which takes some milliseconds: nobody waits for it now.

        Outside a ``with`` nobody would do so later.
        """
        if job.process is None or not self._is_entered:
            _join(job)
            return
        _hang_up(job)
        with FORKING:
            self._leaving = [other for other in self._leaving if _is_alive(other)]
        self._leaving.append(job)  # type: ignore[arg-type]

    def _end_late(self) -> None:
        """End the processes whose time is over; what they reported counts."""
        for job in [job for job in self._running if _is_over(job)]:
            self._listen(0)  # it may have been done just now, or be at something else
            if not job.is_done and _is_over(job):
                if job.process is not None:
                    job.process.send_signal(signal.SIGKILL)
                job.is_late = _is_past(job.ends_at) or _is_past(job.until)
                job.is_overdue = not job.is_late
                self._put_away(job)

    def _tell(self, job: Job[object], text: str) -> None:
        job.told = text
        told = text if job.name in text else f"{job.name}: {text}"
        of = sum(other.counts for other in (*self._running, *self._waiting)) + self._done
        if job.counts and of > 1:
            told = f"{self._done} of {of} done; {told}"
        self.progress(told)

    def _stop(self, job: Job[T]) -> None:
        """Stop after Ctrl-C: let processes report what they know by now, then end them.

        On a terminal it reached them as well. Raises KeyboardInterrupt if this job has no answer.
        """
        self._stop_all()
        assert self._stopped_at is not None
        since = time.monotonic() - self._stopped_at
        is_running = any(other is job for other in self._running)
        if not is_running or since > _ENDED_S - depth() * _SOONER_S:
            raise KeyboardInterrupt
        if since > _TOLD_S and not self._told:
            self._told = True
            for other in self._running:
                _interrupt(other)

    def _stop_all(self) -> None:
        if self._stopped_at is None:
            self._stopped_at = time.monotonic()
            self._waiting.clear()


def _begin(job: Job[object]) -> None:
    """Note that a job is being done from now on."""
    job.started = time.monotonic()
    if job.lasts_s is not None:
        job.ends_at = job.started + job.lasts_s


def _is_over(job: Job[object]) -> bool:
    return _is_past(job.ends_at) or _is_past(job.until) or _is_past(job.share_until)


def _is_past(moment: float | None) -> bool:
    return moment is not None and moment <= time.monotonic()


def _interrupt(job: Job[object]) -> None:
    if job.process is not None:
        job.process.send_signal(signal.SIGINT)


def _is_alive(job: Job[object]) -> bool:
    return job.process is not None and job.process.is_alive()


def _join(job: Job[T]) -> None:
    if job.process is not None:
        with FORKING:
            job.process.join()
            job.exit_code = job.process.exit_code
        job.process = None
    _hang_up(job)


def _hang_up(job: Job[T]) -> None:
    if job.line is not None:
        job.line.close()
        job.line = None
