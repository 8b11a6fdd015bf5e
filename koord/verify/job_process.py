"""Inside a process that does work for another one: a channel back, Ctrl-C, and the end.

Whoever does work says on a line what it is at, what it found out by then, and at last the result.
A pool listens to processes that it forked, and to others that answer questions elsewhere, in the
same way.
"""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from select import select
from types import FrameType
from typing import TYPE_CHECKING, NoReturn, Protocol, TypeAlias, TypeVar

from msgspec import Struct

from koord.syntax.diagnostics import KoordError
from koord.syntax.forking import FORKING
from koord.verify.forked import ForkedProcess, Receiver, Sender, part

if TYPE_CHECKING:
    from ctypes import CDLL

T = TypeVar("T")

#: Says what is being done.
Progress: TypeAlias = Callable[[str], None]


class JobChannel(Protocol):
    """The channel by which work reports progress and results before it is done."""

    def __call__(self, text: str) -> None: ...

    def note(self, value: object) -> None: ...

    def lasting(self, until: float | None) -> None:
        """Set the moment at which the work is ended, unless it sets another one by then."""


#: How often a process says what it is doing.
_TELL_S = 0.2

#: How many processes stand between this one and the one that was started first.
_depth = 0

#: Whether Ctrl-C was heard by this process, which does work for another one.
_was_interrupted = False

#: `prctl` of Linux: which signal comes when the process that forked this one is gone.
_PR_SET_PDEATHSIG = 1

#: When the garbage collector looks for what nobody needs. A proof makes ten thousands of objects in
#: some tenths of a second, of which it finds next to nothing; before contexts are made it is asked.
_COLLECTED = (50_000, 20, 20)

#: From this size on memory is asked for by itself, in bytes.
_LARGEST = 32 * 2**20

#: `mallopt` of glibc: how much freed memory stays with a process, in bytes, and ``_LARGEST``.
_KEPT = {-1: 256 * 2**20, -3: _LARGEST}

#: How much memory is to come in huge pages, in bytes: that of as many contexts as there are at once
#: in most questions. What is not used of it takes no memory.
_IN_HUGE_PAGES = 4 * _LARGEST

#: `madvise` of Linux, and the size of a huge page there, in bytes.
_MADV_HUGEPAGE, _HUGE_PAGE = 14, 2 * 2**20

#: `mallopt` of glibc: how much more memory is asked for at a time, and what is usual, in bytes.
_M_TOP_PAD, _USUAL_TOP_PAD = -2, 128 * 2**10


def was_interrupted() -> bool:
    """Return whether Ctrl-C reached this process: any later exception may be due to it.

    Inside a call of Z3 the KeyboardInterrupt becomes an ArgumentError of ctypes, for one.
    """
    return _was_interrupted


def depth() -> int:
    """Return how many processes stand between this one and the one that was started first."""
    return _depth


class Found(Struct, frozen=True):
    """The result of a process, or its exception."""

    answer: object
    failure: Exception | None = None


class Noted(Struct, frozen=True):
    """A result that a process sends before it is done."""

    value: object


class Lasting(Struct, frozen=True):
    """The moment at which a process is to be ended, unless it sends another."""

    until: float | None


class Begun(Struct, frozen=True):
    """The news that work was begun elsewhere, perhaps not for the first time."""

    where: str


class Unanswered(Struct, frozen=True):
    """The news that work elsewhere has ended without a result, and why."""

    why: str
    is_overdue: bool = False


#: What ends processes that ask for more memory than there is.
_FOR_WANT = frozenset({"SIGKILL", "SIGSEGV", "SIGABRT", "SIGBUS"})


def end_of(exit_code: int | None) -> str:
    """The reason why a process ended without doing its work, in words."""
    if exit_code is None or exit_code >= 0:
        return "its process ended before it was done"
    ended_by = signal.Signals(-exit_code).name
    wanting = ", as for want of memory" if ended_by in _FOR_WANT else ""
    return f"its process was ended by {ended_by}{wanting}"


def do_work(work: Callable[[JobChannel], T], parent: int, sends: Sender) -> None:
    """Do the work, send the result, and exit without flushing."""
    try:
        _begin(parent)
        signal.signal(signal.SIGINT, _heard)
        _conclude(lambda: work(_Line(sends)), sends)
    finally:
        _leave()


def _begin(parent: int) -> None:
    """Begin to be a process that does work for the one that forked it."""
    global _depth
    _depth += 1
    die_with(parent)
    gc.freeze()  # what was made before lasts as long as this process
    gc.set_threshold(*_COLLECTED)
    keep_freed_memory()


def _conclude(answer: Callable[[], object], sends: Sender) -> None:
    """Send an answer, or what it raises."""
    try:
        found = pickle.dumps(Found(answer()))
    except KoordError as error:
        found = pickle.dumps(Found(None, error))
    except KeyboardInterrupt:
        return
    except Exception as error:
        if _was_interrupted:
            return
        found = _raised(error)
    sends.send_pickled(found)
    sends.close()


class PartedError(BaseException):
    """Raised in a process whose work goes on in another one, ``process``, which it ``hears``."""

    def __init__(self, process: ForkedProcess, hears: Receiver) -> None:
        self.process, self.hears = process, hears


class PartingChannel(Struct):
    """The channel of work that begins in this process, and goes on in another if it takes long.

    That is as soon as it tells of something by which it ``is_long``. By then what it tells of is
    ``heard`` here, and from then on in this process, which listens to the other one.
    """

    tell: Progress
    heard: Callable[[object], None]
    is_long: Callable[[object], bool]
    _here: bool = True
    _sends: Sender | None = None

    def __call__(self, text: str) -> None:
        self.tell(text)

    def note(self, value: object) -> None:
        if self._here:
            self.heard(value)
            if self._sends is None and self.is_long(value):
                self._part()

    def lasting(self, until: float | None) -> None:
        """Ignore the moment: whoever waits for this process ends it."""

    def run(self, work: Callable[[JobChannel], T]) -> T:
        """Do the work. Raises PartedError once it goes on in another process, which sends it."""
        try:
            found = work(self)
            if self._sends is not None:
                _conclude(lambda: found, self._sends)
        except BaseException as error:
            if self._sends is None:
                raise
            _conclude(partial(_raise, error), self._sends)
        finally:
            if self._sends is not None:
                _leave()
        return found

    def _part(self) -> None:
        """Go on in another process; this one leaves its work where it is."""
        parent = os.getpid()
        try:
            with FORKING:
                parted = part()
        except OSError:
            return  # there can be no more processes: this one goes on
        if isinstance(parted, tuple):
            self._here = False
            raise PartedError(*parted)
        self._sends, line = parted, _Line(parted)
        self.tell, self.heard = line, line.note
        _begin(parent)
        signal.signal(signal.SIGINT, _heard)


def _raise(error: BaseException) -> NoReturn:
    raise error


def _heard(number: int, frame: FrameType | None) -> None:
    """Handle Ctrl-C, which may come twice (from the terminal): end the work, not the sending."""
    global _was_interrupted
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _was_interrupted = True
    raise KeyboardInterrupt


def _raised(error: Exception) -> bytes:
    """Serialise an exception with its traceback."""
    import traceback  # which reads Python itself, and is seldom needed

    where = traceback.format_exc()
    error.add_note(where)
    try:
        found = pickle.dumps(Found(None, error))
        pickle.loads(found)
    except Exception:
        found = pickle.dumps(Found(None, RuntimeError(where)))
    return found


class _Line(Struct):
    """The channel of a forked process, which limits the rate of progress reports."""

    sends: Sender
    last: float = 0.0

    def note(self, value: object) -> None:
        self._send(Noted(value))

    def lasting(self, until: float | None) -> None:
        self._send(Lasting(until))

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
    c_library.sbrk.restype, c_library.sbrk.argtypes = ctypes.c_void_p, [ctypes.c_ssize_t]
    # Asked for at once: where a page has been written to there is no huge one any more.
    c_library.mallopt(_M_TOP_PAD, _IN_HUGE_PAGES)
    block = c_library.malloc(_HUGE_PAGE)
    end = c_library.sbrk(0)
    c_library.mallopt(_M_TOP_PAD, _USUAL_TOP_PAD)
    if block is not None and block < end < block + 2 * _IN_HUGE_PAGES:
        first = -(-block // _HUGE_PAGE) * _HUGE_PAGE
        c_library.madvise(first, end // _HUGE_PAGE * _HUGE_PAGE - first, _MADV_HUGEPAGE)
    c_library.free(block)


def _leave() -> None:
    """Exit at once: unflushed data belong to the process that forked this one."""
    os.kill(os.getpid(), signal.SIGKILL)
