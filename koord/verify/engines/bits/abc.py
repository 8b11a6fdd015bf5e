"""PDR by the external tool abc, where it is installed, with its results checked again."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from functools import partial
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory

from koord.verify.effort import Deadline
from koord.verify.engines.bits.circuit import Latch
from koord.verify.engines.bits.circuit_files import aiger_of, machine_asking
from koord.verify.engines.bits.graph import TRUE, Graph
from koord.verify.engines.bits.ic3 import ClauseInvariant, Cube, Reached, SafetyQuery, Unfinished
from koord.verify.job_process import die_with

#: What Debian calls it, and what it calls itself.
NAMES = ("berkeley-abc", "abc")

_ASSERTED = re.compile(r"was asserted in frame (\d+)")


def installed() -> str | None:
    """The path of the program, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


def searched(
    g: Graph, question: SafetyQuery, deadline: Deadline, seconds: float | None = None
) -> ClauseInvariant | Reached | Unfinished:
    """Run abc on a safety query: an invariant, or the round that violates it.

    It may work for so many ``seconds`` of its own CPU time (None: unlimited), and ends with this
    process, however that ends.
    """
    program = installed()
    assert program is not None, "whoever asks has looked"
    if deadline.passed():
        return Unfinished(0)
    with TemporaryDirectory() as folder:
        problem, invariant = Path(folder) / "problem.aig", Path(folder) / "invariant.pla"
        machine = machine_asking(g, question)
        problem.write_bytes(aiger_of(machine))
        # Rewriting leaves the latches as they are, so the invariant is one of what was written.
        command = f"read {problem}; dc2; pdr -d -I {invariant}"
        try:
            done = subprocess.run(
                [program, "-q", command],
                capture_output=True,
                text=True,
                timeout=deadline.left_s(),
                check=False,
                cwd=folder,
                preexec_fn=partial(_begin, os.getpid(), seconds),
            )
        except subprocess.TimeoutExpired:
            return Unfinished(0)
        asserted = _ASSERTED.search(done.stdout)
        if asserted is not None:
            # Frame 0 is that of INIT, or of the first round: this is enough for both.
            return Reached(int(asserted[1]) + 1)
        if "Property proved" not in done.stdout:
            return Unfinished(0)
        text = invariant.read_text(encoding="utf-8") if invariant.exists() else ""
    return ClauseInvariant(tuple(sorted(_cubes(text, machine.latches))), 0)


def _begin(parent: int, seconds: float | None) -> None:
    """Limit this process, before it becomes abc."""
    die_with(parent)
    if seconds is not None:
        from resource import RLIMIT_CPU, getrlimit, setrlimit

        setrlimit(RLIMIT_CPU, (ceil(seconds), getrlimit(RLIMIT_CPU)[1]))


def _cubes(text: str, latches: Sequence[Latch]) -> Iterator[Cube]:
    """The cubes of states that an invariant excludes, among those reached by legal steps.

    abc has all latches start false: it negates those that do not.
    """
    names: list[str] = []
    negated = {latch.name: latch.init == TRUE for latch in latches}
    for line in text.splitlines():
        if line.startswith(".ilb"):
            names = line.split()[1:]
        row = line.split()
        if len(row) != 2 or row[1] != "1" or set(row[0]) - {"0", "1", "-"}:
            continue
        said = {
            name: (value == "1") ^ negated[name]
            for name, value in zip(names, row[0], strict=True)
            if value != "-"
        }
        if not said.pop("begun", True) or not said.pop("valid", True):
            continue
        literals = ((int(name[1:]) + 1) * (1 if value else -1) for name, value in said.items())
        yield tuple(sorted(literals))
