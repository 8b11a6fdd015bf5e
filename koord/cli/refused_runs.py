"""A run that the rules refuse: how it is kept, what is told of it, and how it is run again."""

from __future__ import annotations

import argparse
import os
import shlex
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from msgspec import Struct

from koord.api.files import write_atomically
from koord.cli.files import DASH
from koord.refinement.cases import Case, Tried
from koord.runtime.compile import compiled
from koord.syntax.literals import literal, number
from koord.syntax.problem import Problem
from koord.traces.codec import encode

#: Of a run that is refused, so many of the locations that differ are shown.
_SHOWN = 8


class RefusedRun(Struct):
    """A failing run and its file: kept at once as it was found, then each smaller one in its place.

    What is kept is a trace, or, of a generated program, what was made of it.
    """

    outcome: Tried
    again: str  #: the command that runs it again, as it was found
    folder: str
    path: str | None = None

    def keep(self) -> None:
        """Write the file. Raises KoordError."""
        case, judged = self.outcome.case, self.outcome.judged
        stem = Path(self.folder) / f"refinement-{case.seed}"
        if judged is not None and case.sources.program.text:
            path, data = f"{stem}.json", encode(judged.trace)
        else:
            path, data = f"{stem}.txt", _story(self.outcome, self.again).encode("utf-8")
        write_atomically(path, data)
        if self.path is not None and self.path != path:
            with suppress(OSError):
                os.unlink(self.path)
        self.path = path

    def replace(self, smaller: Tried) -> None:
        """Keep a smaller run instead. Raises KoordError."""
        self.outcome = smaller
        self.keep()

    def document(self) -> dict[str, object]:
        """What ``--json`` says of it."""
        case, refused = self.outcome.case, self.outcome.refused
        return {
            "program": case.sources.program.name,
            "target": case.target.value,
            "seed": case.seed,
            "robots": case.system.robots,
            "problem": problem_of(case).document(),
            "rounds": case.rounds,
            "policy": case.policy.value,
            "rule": None if refused is None else refused.rule,
            "reason": self.outcome.crash if refused is None else refused.reason,
            "saved": self.path,
            "again": self.again,
        }


def again(arguments: argparse.Namespace, case: Case, number_of_runs: int) -> str:
    """The command that makes a run again: the last of so many, on one target alone."""
    generated = not case.sources.program.text
    words = ["koord", "check-refinement"]
    if generated:
        words += ["--case", str(case.seed)]
    else:
        name = case.sources.program.name
        words += [name if name in arguments.files else DASH]
        words += ["--runs", str(number_of_runs), "--seed", str(arguments.seed)]
    words += ["--target", case.target.value, "--rounds", str(arguments.rounds)]
    if arguments.faults != "none":
        words += ["--faults", arguments.faults]
    if not generated:
        if arguments.delta is not None:
            words += ["--delta", number(arguments.delta)]
        for name, value in arguments.settings:
            words += ["--set", f"{name}={literal(value)}"]
        for path in arguments.properties:
            words += ["--with", path]
    return shlex.join(words)


def told(one: Tried) -> Iterator[str]:
    """The first step that the rules do not allow."""
    refused = one.refused
    if refused is None:
        yield "the compiled program fell over:"
        yield from one.crash.splitlines()
        return
    step = refused.step
    who = "" if step.robot is None else f", robot {step.robot}"
    what = "" if step.event is None else f", {step.event}"
    when = "INIT" if step.round < 0 else f"round {step.round + 1}"
    yield f"[{refused.rule}] {when}{who}{what}: {refused.reason}"
    for change in refused.differences[:_SHOWN]:
        whose = "" if change.robot is None else f" of robot {change.robot}"
        yield f"  {change.name}{whose}: by the rules {change.old}, recorded {change.new}"
    if one.judged is not None:
        for number, round_ in enumerate(one.judged.trace.recording.rounds, start=1):
            events = ", ".join("skip" if e is None else str(e) for e in round_.events)
            yield f"  round {number}: order {list(round_.order)}, events [{events}]"


def problem_of(case: Case) -> Problem:
    """What a case is a run of."""
    texts = tuple(source.name for source in case.sources.texts)
    return Problem(texts, case.system.program, case.system.kinds, case.system.delta_s)


def _story(one: Tried, command: str) -> str:
    """A failing case in full: program, what it was compiled to, schedule, first wrong step."""
    parts = [
        f"{command}  # as it was found; what follows may be made smaller",
        f"seed {one.case.seed}, {one.case.system.fleet}, {one.case.rounds} rounds, "
        f"{one.case.policy.value}",
        *told(one),
        "",
        "# compiled",
        _text(one.case),
        "# the core program",
        repr(one.case.system.program),
    ]
    if one.judged is not None:
        parts += ["", "# the recording", repr(one.judged.trace.recording)]
    return "\n".join(parts) + "\n"


def _text(case: Case) -> str:
    try:
        return compiled(case.system.program)
    except Exception as error:
        return f"it cannot be compiled: {error!r}"
