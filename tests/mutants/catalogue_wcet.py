"""Seeded mistakes in worst-case execution times."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

_PATHS, _TIMES = ("tests/syntax/test_worst_paths.py",), ("tests/api/test_verify.py",)

WCET = (
    Mutant(
        "the worst path takes the shorter branch",
        "syntax.analysis.worst_paths._Longest.of",
        "then.steps >= otherwise.steps",
        "then.steps < otherwise.steps",
        _PATHS,
    ),
    Mutant(
        "a list is as long as it was declared, for ever",
        "syntax.analysis.worst_paths._may_grow",
        "not isinstance(sequence.type, ArrayType) and not isinstance(sequence, fixed)",
        "False",
        _PATHS,
    ),
    Mutant(
        "what may grow is looked for on the worst path alone",
        "syntax.analysis.worst_paths._Longest.path",
        "self._reached((*parts, *block), everything=True)",
        "self._reached((*parts, *block), everything=False)",
        _PATHS,
    ),
    Mutant(
        "a turn has no guards",
        "syntax.analysis.worst_paths.AgentPaths.turn_steps",
        "sum(one.guard.steps for one in self.events)",
        "0",
        _PATHS,
    ),
    Mutant(
        "what a host thinks counts as a program's time",
        "api.wcet._timed",
        "time.thread_time_ns() - self.host.asked_ns - began",
        "time.thread_time_ns() - began",
        _TIMES,
    ),
)
