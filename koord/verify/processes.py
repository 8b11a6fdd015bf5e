"""A pool of processes for independent work.

A process is forked from the one that asks: it starts in milliseconds with all that is known so far
(programs, circuits, what a solver was told), and nothing need be sent to it. What it finds out is
sent back. So the answer depends on what was known when the work was handed in, and not on how many
processes there are, nor on which of them is done first. Z3 stops its timers before a fork.
"""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from select import select
from types import FrameType
from typing import TYPE_CHECKING, Generic, Protocol, TypeAlias, TypeVar

from msgspec import Struct, field

from koord.syntax.diagnostics import KoordError
from koord.syntax.forking import FORKING
from koord.verify.forked import ForkedProcess, Receiver, Sender, fork, ready

if TYPE_CHECKING:
    from ctypes import CDLL

T = TypeVar("T")
K = TypeVar("K")

#: Says what is being done.
Progress: TypeAlias = Callable[[str], None]


class JobChannel(Protocol):
    """The channel by which work reports progress and results before it is done."""

    def __call__(self, text: str) -> None: ...

    def note(self, value: object) -> None: ...

    def lasting(self, until: float | None) -> None:
        """Set the moment at which the work is ended, unless it sets another one by then."""


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

#: How often a process says what it is doing.
_TELL_S = 0.2

#: After Ctrl-C: when processes that did not hear it are told, and when they are ended: those that
#: a process has forked sooner than itself, so that it can still say what it heard of them.
_TOLD_S, _ENDED_S, _SOONER_S = 0.2, 1.0, 0.2

#: How many processes stand between this one and the one that was started first.
_depth = 0

#: Whether Ctrl-C was heard by this process, which does a pool's work.
_was_interrupted = False

#: `prctl` of Linux: which signal comes when the process that forked this one is gone.
_PR_SET_PDEATHSIG = 1

#: From this size on memory is asked for by itself, in bytes.
_LARGEST = 32 * 2**20

#: `mallopt` of glibc: how much freed memory stays with a process, in bytes, and ``_LARGEST``.
_KEPT = {-1: 256 * 2**20, -3: _LARGEST}

#: How much memory is to come in huge pages, in bytes: that of as many contexts as there are at once
#: in most questions. What is not used of it takes no memory.
_IN_HUGE_PAGES = 4 * _LARGEST

#: `madvise` of Linux, and the size of a huge page there, in bytes.
_MADV_HUGEPAGE, _HUGE_PAGE = 14, 2 * 2**20


#: What ends processes that ask for more memory than there is.
_FOR_WANT = frozenset({"SIGKILL", "SIGSEGV", "SIGABRT", "SIGBUS"})


def was_interrupted() -> bool:
    """Return whether Ctrl-C reached this process: any later exception may be due to it.

    Inside a call of Z3 the KeyboardInterrupt becomes an ArgumentError of ctypes, for one.
    """
    return _was_interrupted


def can_fork() -> bool:
    """Return whether processes can be forked."""
    return hasattr(os, "fork")


class Job(Struct, Generic[T], eq=False):
    """A submitted job. ``name`` is shown in progress reports.

    ``lasts_s`` is for how long its process may go on, and ``until`` when it is ended if it is not
    done (as :func:`time.monotonic` counts): then it ``is_late``. ``noted`` is what it told of
    before it was done, which stays known however it ends; ``told`` is what it was at last.
    ``share_until`` is when it is ended if it says nothing else by then: then it ``is_overdue``.
    ``lasted_s`` is for how long its process went on. Where it does not ``count``, progress reports
    say nothing of how many jobs there are.
    """

    name: str
    work: Callable[[JobChannel], T]
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
    told: str = ""
    started: float | None = None
    lasted_s: float = 0.0
    exit_code: int | None = None
    counts: bool = True

    @property
    def end(self) -> str:
        """The reason why the job's process ended without doing its work, in words."""
        if self.is_late or self.is_overdue:
            return "it did not end when its share of the time was over"
        if self.exit_code is None or self.exit_code >= 0:
            return "its process ended before it was done"
        ended_by = signal.Signals(-self.exit_code).name
        wanting = ", as for want of memory" if ended_by in _FOR_WANT else ""
        return f"its process was ended by {ended_by}{wanting}"


class Pool(Struct):
    """A pool of up to ``jobs`` processes; the caller counts as one unless it waits.

    Inside a ``with``, at whose end no process is left. ``interrupted`` is asked while it waits.
    """

    jobs: int = 1
    progress: Progress = lambda text: None
    interrupted: Callable[[], bool] = lambda: False
    _waiting: list[Job[object]] = field(default_factory=list)
    _running: list[Job[object]] = field(default_factory=list)
    _done: int = 0
    _stopped_at: float | None = None
    _told: bool = False

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        self._waiting.clear()
        for job in self._running:
            _end(job)
        self._running.clear()

    def submit(
        self,
        name: str,
        work: Callable[[JobChannel], T],
        *,
        lasts_s: float | None = None,
        until: float | None = None,
        counts: bool = True,
        first: bool = False,
    ) -> Job[T]:
        """Submit work. The caller must not change what the work reads before it is done.

        What is to be done ``first`` goes before all that waits.
        """
        if not self._running and not self._waiting:
            self._done = 0
        job: Job[T] = Job(name, work, lasts_s, until, counts=counts)
        self._waiting.insert(0 if first else len(self._waiting), job)  # type: ignore[arg-type]
        if can_fork():
            self._listen(0)
            self._fill(self.jobs - 1)
        return job

    def drop(self, job: Job[T]) -> None:
        """Drop a job whose result is no longer needed."""
        self._waiting = [other for other in self._waiting if other is not job]
        if any(other is job for other in self._running):
            self._running = [other for other in self._running if other is not job]
            _end(job)

    def answer(self, job: Job[T]) -> T | None:
        """Wait for a job's result; None if its process died, as for want of memory, or was ended.

        Raises what the work raised, and KeyboardInterrupt if it could not end in good order.
        """
        if not can_fork():
            self._waiting = [other for other in self._waiting if other is not job]
            return job.work(_Here(self.progress, job.noted.append))
        while not job.is_done:
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
        if job.failure is not None:
            raise job.failure
        if job.found is None and self.interrupted():
            raise KeyboardInterrupt
        return job.found

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
        while self._waiting and len(self._running) < most and self._stopped_at is None:
            job = self._waiting.pop(0)
            with FORKING:
                process, receives = fork(partial(_worked, job.work, os.getpid()))
            job.started = time.monotonic()
            if job.lasts_s is not None:
                ends = time.monotonic() + job.lasts_s
                job.until = ends if job.until is None else min(ends, job.until)
            job.process, job.line = process, receives
            self._running.append(job)

    def _listen(self, wait_s: float) -> None:
        lines = {job.line: job for job in self._running if job.line is not None}
        for line in ready(list(lines), wait_s):
            job = lines[line]
            try:
                said = line.receive()
            except (EOFError, OSError):
                said = _Found(None)  # it died: nothing comes
            match said:
                case str():
                    self._tell(job, said)
                case _Noted(value=value):
                    job.noted.append(value)
                case _Lasting(until=until):
                    job.share_until = until
                case _Found():
                    job.found, job.failure = said.answer, said.failure
                    self._put_away(job)

    def _put_away(self, job: Job[object]) -> None:
        job.is_done = True
        if job.started is not None:
            job.lasted_s = time.monotonic() - job.started
        self._running.remove(job)
        self._done += job.counts
        _join(job)

    def _end_late(self) -> None:
        """End the processes whose time is over; what they reported counts."""
        for job in [job for job in self._running if _is_over(job)]:
            self._listen(0)  # it may have been done just now, or be at something else
            if not job.is_done and _is_over(job):
                assert job.process is not None
                job.process.send_signal(signal.SIGKILL)
                job.is_late = _is_past(job.until)
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
        if not is_running or since > _ENDED_S - _depth * _SOONER_S:
            raise KeyboardInterrupt
        if since > _TOLD_S and not self._told:
            self._told = True
            for other in self._running:
                _interrupt(other)

    def _stop_all(self) -> None:
        if self._stopped_at is None:
            self._stopped_at = time.monotonic()
            self._waiting.clear()


def _is_over(job: Job[object]) -> bool:
    return _is_past(job.until) or _is_past(job.share_until)


def _is_past(moment: float | None) -> bool:
    return moment is not None and moment <= time.monotonic()


def _interrupt(job: Job[object]) -> None:
    if job.process is not None:
        job.process.send_signal(signal.SIGINT)


def _end(job: Job[T]) -> None:
    if job.process is not None:
        job.process.send_signal(signal.SIGKILL)
    _join(job)


def _join(job: Job[T]) -> None:
    if job.process is not None:
        with FORKING:
            job.process.join()
            job.exit_code = job.process.exit_code
        job.process = None
    if job.line is not None:
        job.line.close()
        job.line = None


# --- inside a process -----------------------------------------------------------------------------


class _Found(Struct, frozen=True):
    """The result of a process, or its exception."""

    answer: object
    failure: Exception | None = None


def _worked(work: Callable[[JobChannel], T], parent: int, sends: Sender) -> None:
    """Do the work, send the result, and exit without flushing."""
    global _depth
    _depth += 1
    try:
        die_with(parent)
        gc.freeze()  # what was made before lasts as long as this process
        keep_freed_memory()
        signal.signal(signal.SIGINT, _heard)
        try:
            found = pickle.dumps(_Found(work(_Line(sends))))
        except KoordError as error:
            found = pickle.dumps(_Found(None, error))
        except KeyboardInterrupt:
            return
        except Exception as error:
            if _was_interrupted:
                return
            found = _raised(error)
        sends.send_pickled(found)
        sends.close()
    finally:
        _leave()


def _heard(number: int, frame: FrameType | None) -> None:
    """Handle Ctrl-C, which may come twice (from the terminal): end the work, not the sending."""
    global _was_interrupted
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _was_interrupted = True
    raise KeyboardInterrupt


def _raised(error: Exception) -> bytes:
    """Serialise an exception with its traceback."""
    where = traceback.format_exc()
    error.add_note(where)
    try:
        found = pickle.dumps(_Found(None, error))
        pickle.loads(found)
    except Exception:
        found = pickle.dumps(_Found(None, RuntimeError(where)))
    return found


class _Noted(Struct, frozen=True):
    """A result that a process sends before it is done."""

    value: object


class _Lasting(Struct, frozen=True):
    """The moment at which a process is to be ended, unless it sends another."""

    until: float | None


class _Line(Struct):
    """The channel of a forked process, which limits the rate of progress reports."""

    sends: Sender
    last: float = 0.0

    def note(self, value: object) -> None:
        self._send(_Noted(value))

    def lasting(self, until: float | None) -> None:
        self._send(_Lasting(until))

    def _send(self, message: object) -> None:
        """Send a message; Ctrl-C waits until all of it is sent."""
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self.sends.send(message)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def __call__(self, text: str) -> None:
        now = time.monotonic()
        if now - self.last < _TELL_S:
            return
        self.last = now
        _, there_is_room, _ = select([], [self.sends], [], 0)
        if there_is_room:
            self._send(text)


def die_with(parent: int) -> None:
    """Make this process end when the process that forked it ends."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            _leave()


def keep_freed_memory() -> None:
    """Let the next context of Z3 have the memory of the last one, in all of this process.

    A context takes 17 MB: to give them back and ask for them anew takes five times as long as
    all else that makes one.
    """
    if sys.platform == "linux":
        import ctypes

        c_library = ctypes.CDLL(None)
        if hasattr(c_library, "mallopt"):  # others than glibc may have none
            for parameter, value in _KEPT.items():
                c_library.mallopt(parameter, value)
            _take_huge_pages(c_library)


def _take_huge_pages(c_library: CDLL) -> None:
    """Let memory of this process come in huge pages: a context takes 4,000 of the small ones.

    To be given these one by one takes three times as long as all else that makes a context. The
    memory is not used here, only named: where there are no huge pages nothing changes.
    """
    import ctypes

    c_library.malloc.restype, c_library.malloc.argtypes = ctypes.c_void_p, [ctypes.c_size_t]
    c_library.free.restype, c_library.free.argtypes = None, [ctypes.c_void_p]
    c_library.madvise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    size = _LARGEST - 2**20  # below the size that would be memory by itself
    blocks = [c_library.malloc(size) for _ in range(_IN_HUGE_PAGES // _LARGEST)]
    for block in filter(None, blocks):
        first = -(-block // _HUGE_PAGE) * _HUGE_PAGE
        length = (block + size) // _HUGE_PAGE * _HUGE_PAGE - first
        c_library.madvise(first, length, _MADV_HUGEPAGE)
    for block in filter(None, blocks):
        c_library.free(block)


def _leave() -> None:
    """Exit at once: unflushed data belong to the process that forked this one."""
    os.kill(os.getpid(), signal.SIGKILL)
