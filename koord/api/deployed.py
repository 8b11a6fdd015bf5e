"""The status of robots in a deployed run, and its result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from msgspec import field, to_builtins

from koord.api.progress import Progress
from koord.api.results import Result, html_table
from koord.syntax.diagnostics import Diagnostic
from koord.syntax.problem import Problem

if TYPE_CHECKING:
    from koord.api.breaches import BrokenStatement as BrokenStatement
    from koord.api.merge import Merged
    from koord.api.preflight import Preflight
    from koord.runtime.deploy.job import Job
    from koord.runtime.deploy.status import RobotReport as RobotReport
    from koord.runtime.deploy.supervision import ProcessReport as ProcessReport


class Deployed(Result, frozen=True, kw_only=True):
    """The result of a deployed run: the last status of each robot, by pid."""

    problem: Problem
    statuses: Mapping[int, RobotReport]
    agents: tuple[str, ...]  #: the kinds of robots by name; ``kinds`` says which robot is of which
    kinds: tuple[int, ...]
    rounds: int | None  #: that were to be done; None: until somebody ends it
    interrupted: bool
    #: What became of the robots' processes, by pid, if each robot was one on this machine.
    processes: Mapping[int, ProcessReport] = field(default_factory=dict)
    broken: tuple[BrokenStatement, ...] = ()  #: claims that did not hold while it ran
    unwatched: tuple[str, ...] = ()  #: claims of which nobody knew enough to look at them
    stuck: str | None = None  #: why no round could be decided any more, if that ended the run
    warnings: tuple[Diagnostic, ...] = ()
    preflight: Preflight | None = None  #: what was found, if nothing else was to be done
    merged: Merged | None = None  #: what all robots have told, if there is to be a trace
    unmerged: tuple[Diagnostic, ...] = ()  #: why there is no trace, or no whole part of one
    left: str | None = None  #: the folder of parts that tell more than the trace has
    aside: str | None = None  #: where the parts of an earlier run are now, that was killed

    @classmethod
    def of(
        cls, job: Job, problem: Problem, statuses: Mapping[int, RobotReport], *, interrupted: bool
    ) -> Deployed:
        """Make the result from the robots' last reports."""
        return cls(
            problem=problem,
            statuses=dict(statuses),
            agents=tuple(one.__name__ for one in job.classes),
            kinds=job.kinds,
            rounds=job.rounds,
            interrupted=interrupted,
        )

    @property
    def in_trouble(self) -> bool:
        """True if a fault ended the run, or a robot could not go on."""
        return any(one.fault or one.trouble for one in self.statuses.values())

    @property
    def drops(self) -> Mapping[str, int]:
        """The numbers of datagrams that all robots have dropped, by reason."""
        from koord.runtime.deploy.status import added

        return added(*(one.drops for one in self.statuses.values()))

    @property
    def is_complete(self) -> bool:
        """True if the rounds were done, or all robots have stopped, and no process was lost."""
        if self.stuck is not None or any(one.is_lost for one in self.processes.values()):
            return False
        states = self.statuses.values()
        done = [one.is_over or one.all_stopped or self.rounds is None for one in states]
        return bool(done) and all(done)

    @property
    def ok(self) -> bool:
        """True if the run was completed without trouble or interruption, and its trace is legal."""
        is_told = not self.unmerged and (self.merged is None or self.merged.ok)
        is_well = self.is_complete and not self.in_trouble and not self.broken
        return is_well and not self.interrupted and is_told

    def to_dict(self) -> dict[str, object]:
        """The result as plain data, as ``koord deploy --json`` prints it."""
        robots = []
        for pid in sorted(self.statuses):
            status = self.statuses[pid]
            holding = None if status.holding is None else status.holding.value
            told = {**to_builtins(status), "holding": holding, "drops": dict(status.drops)}
            if pid in self.processes:
                told["process"] = self.processes[pid].to_dict()
            robots.append(told)
        return {
            "format": "koord-deployed",
            "version": 1,
            "program": self.problem.texts[0],
            "problem": self.problem.document(),
            "robots": robots,
            "stuck": self.stuck,
            "broken": [one.to_dict() for one in self.broken],
            "unwatched": list(self.unwatched),
            "trace": None if self.merged is None else self.merged.to_dict(),
        }

    def __repr__(self) -> str:
        states = self.statuses.values()
        done = max((0, *(one.round for one in states)))
        ran, skipped = sum(one.ran for one in states), sum(one.skipped for one in states)
        how = "a robot is in trouble" if self.in_trouble else "interrupted"
        if not self.in_trouble and not self.interrupted:
            how = "done" if self.is_complete else "not all robots came to the end"
        whose = f"{len(states)} of {len(self.kinds)} robots"
        return (
            f"<Deployed {self.problem.name}, {whose}: {done} rounds, {ran} events, "
            f"{skipped} skips, {how}>"
        )

    def _repr_html_(self) -> str:
        columns = ("robot", "round", "ran", "skipped", "late", "")
        states = (self.statuses[pid] for pid in sorted(self.statuses))
        rows = [
            (one.pid, one.round, one.ran, one.skipped, one.late, self._remark(one))
            for one in states
        ]
        return html_table(str(self.problem), columns, rows)

    def _remark(self, status: RobotReport) -> str:
        process = self.processes.get(status.pid)
        return status.fault or status.trouble or (process.story if process is not None else "")


class FleetHeard(Progress, frozen=True, kw_only=True):
    """Progress: the status of the robots of a run, by pid."""

    statuses: Mapping[int, RobotReport]
    rounds: int | None  #: that are to be done; None: until somebody ends it
    #: What became of the robots' processes, by pid, if each robot is one on this machine.
    processes: Mapping[int, ProcessReport] = field(default_factory=dict)
    broken: tuple[BrokenStatement, ...] = ()  #: claims that did not hold so far

    @classmethod
    def of(
        cls,
        statuses: Mapping[int, RobotReport],
        rounds: int | None,
        processes: Mapping[int, ProcessReport] | None = None,
        broken: tuple[BrokenStatement, ...] = (),
    ) -> FleetHeard:
        """Make the progress from the robots' reports so far."""
        first = max((0, *(status.round for status in statuses.values())))
        said = f"round {first}, {len(statuses)} robots heard"
        return cls(
            said,
            round=first,
            statuses=dict(statuses),
            rounds=rounds,
            processes=dict(processes or {}),
            broken=broken,
        )

    def lags(self) -> dict[int, int]:
        """The number of rounds by which each robot is behind, as far as old reports can tell."""
        statuses = self.statuses.values()
        from koord.runtime.deploy.news import REPORT_S

        first = max((status.round for status in statuses), default=0)
        took_s = max((status.took_s for status in statuses), default=0.0)
        # So many rounds pass between two reports: so old may be what a robot has said last.
        slack = 1 + 2 * REPORT_S * (first / took_s if took_s > 0 else 0.0)
        return {
            status.pid: status.behind if first - status.round <= slack else first - status.round
            for status in statuses
        }
