"""All computers of a fleet at once: a thread with their connections. Needs ``koord[ssh]``."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine, Iterable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from pathlib import PurePosixPath
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, TypeVar

from koord.runtime.remote.computer import Computer
from koord.runtime.remote.logins import Login, LostError, RemoteEnd, RemoteError

T = TypeVar("T")

#: How long anything is waited for at a time.
_WAIT_S = 0.1

#: Robots that are told to stop have so long for it, those that are not reached then so long to be
#: reached, in seconds.
STOP_S, REACH_S = 40.0, 20.0

#: Who insists does not wait longer for those that are told.
_INSIST_S = 3.0


class Computers:
    """The computers of a fleet; within the context there are connections.

    ``tell`` hears lines of robots, in the thread that calls.
    """

    def __init__(
        self,
        hosts: Mapping[int, str],
        login: Login,
        folder: PurePosixPath,
        tell: Callable[[int, str], None],
    ) -> None:
        self._lines: SimpleQueue[tuple[int, str]] = SimpleQueue()
        self._tell = tell
        self.all = {
            pid: Computer(pid, host, login, folder / str(pid), self._teller(pid))
            for pid, host in hosts.items()
        }
        self._loop = asyncio.new_event_loop()
        # What the library's own tasks hear of a lost connection is told by ours.
        self._loop.set_exception_handler(lambda loop, context: None)
        self._futures: list[Future[Any]] = []
        self._thread = threading.Thread(target=self._loop.run_forever, name="ssh", daemon=True)

    def _teller(self, pid: int) -> Callable[[str], None]:
        return lambda line: self._lines.put((pid, line))

    def __enter__(self) -> Computers:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        with suppress(TimeoutError):
            asyncio.run_coroutine_threadsafe(self._closed(), self._loop).result(_INSIST_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _closed(self) -> None:
        for future in self._futures:
            future.cancel()
        for one in self.all.values():
            one.let_go()
        # What waits for an answer hears that there is none: by the library's own tasks.
        if others := asyncio.all_tasks() - {asyncio.current_task()}:
            await asyncio.wait(others)

    def _begun(self, coroutine: Coroutine[object, object, T]) -> Future[T]:
        future = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        self._futures.append(future)
        return future

    def each(
        self,
        action: Callable[[int, Computer], Coroutine[object, object, T]],
        is_cancelled: Callable[[], bool],
    ) -> tuple[dict[int, T], dict[int, RemoteError]]:
        """Do something with all at once; return what came of it, and what went wrong.

        Both are without those that were not done when it was cancelled.
        """

        async def tried(pid: int, computer: Computer) -> T | RemoteError:
            try:
                return await action(pid, computer)
            except RemoteError as error:
                return error
            except LostError as lost:
                return RemoteError(f"the connection was lost: {lost}")

        futures = {pid: self._begun(tried(pid, one)) for pid, one in self.all.items()}
        while not (all(one.done() for one in futures.values()) or is_cancelled()):
            self._hear()
        done: dict[int, T] = {}
        wrong: dict[int, RemoteError] = {}
        for pid, future in futures.items():
            if future.done():
                found = future.result()
                if isinstance(found, RemoteError):
                    wrong[pid] = found
                else:
                    done[pid] = found
            else:
                future.cancel()
        self._drain()
        return done, wrong

    def follow(
        self,
        name: str,
        is_cancelled: Callable[[], bool],
        is_hopeless: Callable[[Mapping[int, RemoteEnd]], bool],
    ) -> dict[int, RemoteEnd]:
        """Follow a command that runs on all, until all have ended or are given up.

        They are told to stop when that is cancelled, or hopeless by the ends that are known.
        (P-SSH-STOP)
        """
        futures = {pid: self._begun(one.follow(name)) for pid, one in self.all.items()}
        ended_at_s: dict[int, float] = {}
        stopped_at_s: float | None = None
        try:
            while not all(one.done() for one in futures.values()):
                self._hear()
                now = self._loop.time()
                ends = {pid: one.result() for pid, one in futures.items() if one.done()}
                ended_at_s = {pid: ended_at_s.get(pid, now) for pid in ends}
                if stopped_at_s is None and (is_cancelled() or is_hopeless(ends)):
                    stopped_at_s = now
                    for computer in self.all.values():
                        computer.stops = True
                since_s = stopped_at_s or self._only_lost_since(ended_at_s)
                if since_s is not None:
                    for pid in futures.keys() - ends.keys():
                        self._lose_patience(self.all[pid], now, since_s)
        except KeyboardInterrupt:  # people insist: a second SIGTERM ends them at once
            self.stop(name, [pid for pid, one in futures.items() if not one.done()])
            raise
        self._drain()
        return {pid: one.result() for pid, one in futures.items()}

    def _only_lost_since(self, ended_at_s: Mapping[int, float]) -> float | None:
        """Since when all have ended but those that are not reached; None: it is not so."""
        going_on = self.all.keys() - ended_at_s.keys()
        if not ended_at_s or any(self.all[pid].lost_at_s is None for pid in going_on):
            return None
        return max(ended_at_s.values())

    def _lose_patience(self, computer: Computer, now: float, since_s: float) -> None:
        """Give a computer up that had long enough, since there was a reason to wait for it."""
        lost_at_s = computer.lost_at_s
        if lost_at_s is not None and now - max(lost_at_s, since_s) > REACH_S:
            computer.given_up = "its computer is not reached any more"
        elif lost_at_s is None and now - since_s > STOP_S:
            computer.given_up = f"it did not end within {STOP_S:g} s"

    def stop(self, name: str, pids: Iterable[int] | None = None) -> None:
        """Tell commands to stop, and wait for no end; those that were told already stop at once."""
        told = self.all.keys() if pids is None else pids

        async def stopped() -> None:
            tried = (self.all[pid].stop(name) for pid in told)
            await asyncio.gather(*tried, return_exceptions=True)

        with suppress(TimeoutError):
            self._begun(stopped()).result(_INSIST_S)

    def _hear(self) -> None:
        """Wait a moment, and tell what was said meanwhile."""
        with suppress(Empty):
            self._tell(*self._lines.get(timeout=_WAIT_S))
        self._drain()

    def _drain(self) -> None:
        with suppress(Empty):
            while True:
                self._tell(*self._lines.get_nowait())
