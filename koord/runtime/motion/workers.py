"""Processes that make plans meanwhile.

A plan is made of pose, goal and seed, so who makes it is no matter of what it is. Processes are
forked from this one, with the planners that it has by then, when the first plan is asked for. They
end with it, and Ctrl-C is for this process alone. A plan that nobody has begun when it is due is
made here, and so is what a process was at that has died.
"""

from __future__ import annotations

import os
import signal
import threading
import warnings
import weakref
from collections import deque
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess, current_process
from operator import index
from typing import Any, SupportsIndex

from msgspec import Struct, field

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.planning import Planner, Pose
from koord.runtime.motion.world import Point

#: So many plans are given to a process at a time, so that it never waits for more.
_AHEAD = 2

#: A process that does not end by itself within this time is killed.
_PATIENCE_S = 1.0


class Job(Struct, eq=False):
    """A plan that was asked for."""

    planner: int
    start: Pose
    goal: Point
    seed: SupportsIndex
    is_done: bool = False
    path: Floats | None = None
    error: Exception | None = None


def _seed(planner: Planner, job: Job) -> Any:
    """The seed of a plan: a number, unless the planner makes one of it where it needs one."""
    return job.seed if getattr(planner, "takes_late_seeds", False) else index(job.seed)


class _Worker(Struct, eq=False):
    process: BaseProcess
    wire: Connection
    jobs: deque[Job] = field(default_factory=deque)  #: in the order in which they were given


class Workers:
    """So many processes that plan, or none: then each plan is made when it is due.

    ``count`` may be set until the first plan is asked for.
    """

    def __init__(self, count: int = 0) -> None:
        self.count = count
        self._planners: list[Planner] = []
        self._workers: list[_Worker] = []
        self._begun: list[tuple[BaseProcess, Connection]] = []
        self._waiting: deque[Job] = deque()
        self._is_begun = False
        self._ends = weakref.finalize(self, _end, self._begun)

    @property
    def processes(self) -> tuple[BaseProcess, ...]:
        """The processes that are there."""
        return tuple(worker.process for worker in self._workers)

    def know(self, planner: Planner) -> int:
        """Tell of a planner, before the first plan is asked for; returns its number."""
        self._planners.append(planner)
        return len(self._planners) - 1

    def ask(self, planner: int, start: Pose, goal: Point, seed: SupportsIndex) -> Job:
        """Ask for a plan by the planner of a number."""
        if not self._is_begun:
            self._is_begun = True
            self._begin()
        job = Job(planner, start, goal, seed)
        if self._workers:
            self._waiting.append(job)
            self._hand_out()
        return job

    def forget(self, job: Job) -> None:
        """Give a plan up, if nobody has begun it."""
        if job in self._waiting:
            self._waiting.remove(job)

    def answer(self, job: Job) -> Floats | None:
        """The plan that was asked for, made now if nobody has. Raises what the planner raises."""
        while not job.is_done:
            if not any(job in worker.jobs for worker in self._workers):
                self.forget(job)
                self._make(job)
            elif self._waiting:  # rather than wait
                self._make(self._waiting.popleft())
            else:
                self._collect(None)
            self._collect(0.0)
        if job.error is not None:
            raise job.error
        return job.path

    def close(self) -> None:
        """End the processes. Plans that are still due are made here."""
        self._ends()
        self._workers.clear()

    # --- inside ---------------------------------------------------------------------------------

    def _begin(self) -> None:
        """Fork the processes, if that can be done without harm."""
        if self.count == 0 or "fork" not in get_all_start_methods():
            return
        # A fork has none of the other threads, and what they hold for ever.
        if threading.active_count() > 1 or current_process().daemon:
            return
        context = get_context("fork")
        for _ in range(self.count):
            ours, theirs = context.Pipe()
            others = [*(wire for _, wire in self._begun), ours]
            process = context.Process(
                target=_work, args=(self._planners, theirs, others), name="planner", daemon=True
            )
            # Ctrl-C must not reach it before it is deaf to it.
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", DeprecationWarning)  # of threads of libraries
                    process.start()
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, before)
            theirs.close()
            self._begun.append((process, ours))
            self._workers.append(_Worker(process, ours))

    def _make(self, job: Job) -> None:
        try:
            planner = self._planners[job.planner]
            job.path = planner.plan(job.start, job.goal, _seed(planner, job))
        except Exception as error:  # of a plan that may not be due yet
            job.error = error
        job.is_done = True

    def _hand_out(self) -> None:
        for worker in tuple(self._workers):
            while self._waiting and len(worker.jobs) < _AHEAD:
                job = self._waiting[0]
                try:
                    worker.wire.send((job.planner, job.start, job.goal, index(job.seed)))
                except OSError:
                    self._lose(worker)
                    break
                worker.jobs.append(self._waiting.popleft())

    def _collect(self, timeout_s: float | None) -> None:
        """Take what processes have made, and give them more."""
        if not self._workers:
            return
        ready = wait([worker.wire for worker in self._workers], timeout_s)
        for worker in tuple(self._workers):
            if worker.wire not in ready:
                continue
            try:
                is_made, path = worker.wire.recv()
            except (EOFError, OSError):
                self._lose(worker)
                continue
            job = worker.jobs.popleft()
            if is_made:
                job.path, job.is_done = path, True
            else:  # it fails here as well, where it is told
                self._make(job)
        self._hand_out()

    def _lose(self, worker: _Worker) -> None:
        """Go on without a process that has died; what it was at is to be made by others."""
        self._workers.remove(worker)
        self._waiting.extendleft(reversed(worker.jobs))
        worker.jobs.clear()


def _work(planners: list[Planner], wire: Connection, others: list[Connection]) -> None:
    """Make plans until the process that asks for them is gone."""
    for other in others:
        other.close()  # else nobody would see that it is gone
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    while True:
        try:
            planner, start, goal, seed = wire.recv()
            try:
                told = True, planners[planner].plan(start, goal, seed)
            except Exception:  # it is told where the plan is due
                told = False, None
            wire.send(told)
        except (EOFError, OSError):
            os._exit(0)


def _end(begun: list[tuple[BaseProcess, Connection]]) -> None:
    for _, wire in begun:
        wire.close()
    for process, _ in begun:
        process.join(_PATIENCE_S)
        if process.is_alive():
            process.kill()
            process.join()
