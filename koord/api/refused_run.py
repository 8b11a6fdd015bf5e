"""Refused runs: how they are kept, described and repeated."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from msgspec import Struct

from koord.api.files import write_atomically
from koord.refinement.cases import Case, Tried
from koord.runtime.compile import compiled
from koord.syntax.problem import Problem
from koord.traces.codec import encode

#: Of a run that is refused, so many of the locations that differ are shown.
_SHOWN = 8


class RefusedRun(Struct, frozen=True):
    """A run that the rules refuse; ``path`` is the file that it is kept in, if it is."""

    outcome: Tried
    again: str  #: the command that runs it again, as it was found
    path: str | None = None

    @property
    def case(self) -> Case:
        """The case of the run."""
        return self.outcome.case

    @property
    def problem(self) -> Problem:
        """The program with its robots and settings: the subject of the run."""
        case = self.case
        texts = tuple(source.name for source in case.sources.texts)
        return Problem(texts, case.system.program, case.system.kinds, case.system.delta_s)

    def kept(self, folder: str | None) -> RefusedRun:
        """The run kept in a file of another folder.

        Kept is a trace, or, of a generated program, what was made of it. Raises KoordError.
        """
        if folder is None:
            return self
        stem = Path(folder) / f"refinement-{self.case.seed}"
        judged = self.outcome.judged
        if judged is not None and self.case.sources.program.text:
            path, data = f"{stem}.json", encode(judged.trace)
        else:
            path, data = f"{stem}.txt", self._story().encode("utf-8")
        write_atomically(path, data)
        if self.path is not None and self.path != path:
            with suppress(OSError):
                os.unlink(self.path)
        return RefusedRun(self.outcome, self.again, path)

    def smaller(self, outcome: Tried) -> RefusedRun:
        """A smaller refused run, with the facts of the first one."""
        return RefusedRun(outcome, self.again, self.path)

    def to_dict(self) -> dict[str, object]:
        """The run as plain data, as ``--json`` prints it."""
        case, refused = self.case, self.outcome.refused
        return {
            "program": case.sources.program.name,
            "target": case.target.value,
            "seed": case.seed,
            "robots": case.system.robots,
            "problem": self.problem.document(),
            "rounds": case.rounds,
            "policy": case.policy.value,
            "rule": None if refused is None else refused.rule,
            "reason": self.outcome.crash if refused is None else refused.reason,
            "saved": self.path,
            "again": self.again,
        }

    def lines(self) -> Iterator[str]:
        """Describe the first step that the rules do not allow."""
        refused = self.outcome.refused
        if refused is None:
            yield "the compiled program fell over:"
            yield from self.outcome.crash.splitlines()
            return
        step = refused.step
        who = "" if step.robot is None else f", robot {step.robot}"
        what = "" if step.event is None else f", {step.event}"
        when = "INIT" if step.round < 0 else f"round {step.round + 1}"
        yield f"[{refused.rule}] {when}{who}{what}: {refused.reason}"
        for change in refused.differences[:_SHOWN]:
            whose = "" if change.robot is None else f" of robot {change.robot}"
            yield f"  {change.name}{whose}: by the rules {change.old}, recorded {change.new}"
        if self.outcome.judged is not None:
            rounds = self.outcome.judged.trace.recording.rounds
            for count, round_ in enumerate(rounds, start=1):
                events = ", ".join("skip" if e is None else str(e) for e in round_.events)
                yield f"  round {count}: order {list(round_.order)}, events [{events}]"

    def _story(self) -> str:
        """Describe the run in full: program, compiled program, schedule, first wrong step."""
        case = self.case
        parts = [
            f"{self.again}  # as it was found; what follows may be made smaller",
            f"seed {case.seed}, {case.system.fleet}, {case.rounds} rounds, {case.policy.value}",
            *self.lines(),
            "",
            "# compiled",
            _text(case),
            "# the core program",
            repr(case.system.program),
        ]
        if self.outcome.judged is not None:
            parts += ["", "# the recording", repr(self.outcome.judged.trace.recording)]
        return "\n".join(parts) + "\n"


def _text(case: Case) -> str:
    try:
        return compiled(case.system.program)
    except Exception as error:
        return f"it cannot be compiled: {error!r}"
