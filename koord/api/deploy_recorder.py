"""The recording of a deployed run, which grows while robots tell what they do."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from koord.runtime.deploy.news import News
from koord.runtime.deploy.recording import DeploymentRecord
from koord.runtime.deploy.supervision import ProcessReport
from koord.syntax.problem import Problem

if TYPE_CHECKING:
    from koord.api.deployed_parts import Parts


class Recorder:
    """The record of a run, begun once the run is accepted, with all earlier reports."""

    def __init__(self, path: str, problem: Problem, parts: Parts | None, stack: ExitStack) -> None:
        self._path, self._problem, self._stack = path, problem, stack
        self._tails = {} if parts is None else parts.tails()
        self._record: DeploymentRecord | None = None
        self._trouble: OSError | None = None
        self._early: list[News] = []

    def hear(
        self,
        news: Iterable[News],
        processes: Mapping[int, ProcessReport] | None = None,
        *,
        is_sure: bool,
    ) -> None:
        """Record the reports of robots, and what became of their own ``processes``, if any."""
        if self._trouble is not None:
            return
        self._early += news
        if not is_sure:
            return
        with self._trying():
            self._write(processes or {})

    @contextmanager
    def _trying(self) -> Iterator[None]:
        """Robots go on where there is no room for more: the recording then ends before that."""
        try:
            yield
        except OSError as error:
            self._trouble = error
            if self._record is not None:
                with suppress(OSError):
                    self._record.restore()

    def close(self) -> OSError | None:
        """Finish the recording; return why it ends before the run, if it does."""
        if self._record is not None and self._trouble is None:
            with self._trying():
                self._record.close()
        self._record = None
        return self._trouble

    def _write(self, processes: Mapping[int, ProcessReport]) -> None:
        if self._record is None:
            # Without a buffer: what is not written can be taken back.
            file = self._stack.enter_context(Path(self._path).open("wb", buffering=0))  # noqa: SIM115
            self._record = DeploymentRecord(file)
            self._stack.callback(self.close)
            self._record.describe(self._problem)
        for one in self._early:
            now = time.time_ns()
            self._record.rounds(one.rounds, now)
            self._record.status(one.status, now, processes.get(one.status.pid))
        self._early.clear()
        for pid, tail in self._tails.items():
            self._record.told(pid, tail.lines(), time.time_ns())
        self._record.flush()
