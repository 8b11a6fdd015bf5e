"""Replay of traces by the rules, and by compiled programs."""

from __future__ import annotations

import os
from collections.abc import Callable
from fractions import Fraction
from itertools import islice
from typing import TYPE_CHECKING, Final

from msgspec import UNSET, convert, to_builtins
from msgspec.structs import replace

from koord.api import forms
from koord.api.files import read_written
from koord.api.programs import Text, source_of
from koord.api.progress import Cancellation, Listener, Progress, asker, ended
from koord.api.results import Result, html_table
from koord.api.robots import exact_number
from koord.api.traces import Trace, read_trace, recorded_once, reloads_of
from koord.sampling.monitors import Watch
from koord.syntax.budget import ENDLESS, Budget, OutOfBudgetError
from koord.syntax.source import counted, visible
from koord.traces.replay import Refused, Replayed
from koord.traces.replay import replay as judge
from koord.traces.trace import Numbers, Violation
from koord.traces.trace import Trace as Recorded

if TYPE_CHECKING:
    from koord.refinement.compiled_replay import Rerun
    from koord.semantics.recordings import Step


def compiled_form(departure: Rerun, first: int) -> forms.Compiled:
    """The result of the compiled program as JSON; rounds count from ``first``, after the start."""
    from koord.refinement.rounding import Unjudged

    if departure is None:
        return forms.Compiled(True, None, None)
    if isinstance(departure, Unjudged):
        return forms.Compiled(True, None, departure.reason)
    differences = [
        forms.CompiledDifference(change.robot, change.name, change.old, change.new)
        for change in departure.changes
    ]
    departs = forms.Departure(departure.round + first, departure.reason, differences)
    return forms.Compiled(False, departs, None)


#: Raised when the JSON changes in a way that its readers must know of.
REPLAY_VERSION: Final = 1


class ReplayReport(Result, frozen=True):
    """The result of a replay: the numbers of legal steps and rounds, and the first illegal step.

    If ``compared``, the compiled program ran it as well, and ``departure`` is where it did
    something else; None: it did the same. Of a run of robots (on doubles, without slack and without
    a violation at its end) ``broken`` is the first property or contract that it breaks, and
    ``unjudged`` are properties that ask what nobody answered.
    """

    trace: Trace
    found: Replayed
    compared: bool = False
    departure: Rerun = None
    broken: Violation | None = None
    unjudged: tuple[str, ...] = ()

    @property
    def legal(self) -> bool:
        """True if every step is legal."""
        return self.found.refused is None

    @property
    def refused(self) -> Refused | None:
        """The first step that is wrong, with the rule that it breaks, or None."""
        return self.found.refused

    @property
    def agrees(self) -> bool:
        """True if the compiled program, if compared, came to the same states."""
        if self.departure is None:
            return True
        from koord.refinement.compiled_replay import Departure

        return not isinstance(self.departure, Departure)

    @property
    def rounds(self) -> int:
        """The number of legal rounds."""
        return self.found.rounds

    def to_dict(self) -> dict[str, object]:
        """The result as plain data, as ``koord replay --json`` prints it; rounds count from 0."""
        recorded, found, refused = self.trace.recorded, self.found, self.found.refused
        made = forms.Replay(
            version=REPLAY_VERSION,
            program=recorded.problem.texts[0],
            problem=convert(recorded.problem.document(), forms.Problem),
            legal=refused is None,
            steps=found.steps,
            rounds=found.rounds,
            refused=None if refused is None else _refusal(refused),
            slack=float(recorded.slack),
            trusted=list(found.trusted),
            reloads=list(reloads_of(recorded)) or UNSET,
            cut_off=recorded.cut_off,
            compiled=compiled_form(self.departure, first=0) if self.compared else None,
        )
        if self.legal and is_of_robots(recorded):
            made.broken = None if self.broken is None else broken_form(self.broken)
            made.unjudged = list(self.unjudged)
        plain: dict[str, object] = to_builtins(made)
        return plain

    def __repr__(self) -> str:
        refused = self.found.refused
        if refused is None:
            said = f"legal, {counted(self.rounds, 'round')}"
            said += "" if self.broken is None else f", breaks {self.broken.name}"
            return f"<ReplayReport {self.trace.recorded.problem}: {said}>"
        where = f"round {refused.step.round + 1}"
        said = f"not legal by {refused.rule} in {where}: {refused.reason}"
        return f"<ReplayReport {self.trace.recorded.problem}: {said}>"

    def _repr_html_(self) -> str:
        refused = self.found.refused
        if refused is None:
            return html_table(repr(self), (), ())
        columns = ("robot", "location", "by the rules", "recorded")
        rows = [(c.robot, c.name, c.old, c.new) for c in refused.differences]
        return html_table(repr(self), columns, rows)


def broken_form(broken: Violation) -> forms.Broken:
    """The violation of a claim as JSON."""
    return forms.Broken(broken.kind.value, broken.name, broken.round, broken.robot)


def _refusal(refused: Refused) -> forms.Refusal:
    step = refused.step
    differences = [
        forms.Difference(change.robot, change.name, change.old, change.new)
        for change in refused.differences
    ]
    return forms.Refusal(
        refused.rule, step.round, step.robot, step.event, refused.reason, differences
    )


def load_trace(path: str | os.PathLike[str], *, program: Text | None = None) -> Trace:
    """Load the trace in a file, in koord's form or in ITF.

    ``program`` is a text to read it with, instead of the one that it holds. Of a file that ends in
    the middle the rounds that are whole are read. Raises :class:`koord.KoordError` for what is no
    trace, or does not fit the program.

    >>> koord.load_trace("trace.json")
    """
    name = os.fspath(path)
    given = None if program is None else source_of(program)
    return Trace(read_trace(read_written(name), visible(name), given))


def replay(
    trace: Trace | str | os.PathLike[str],
    *,
    program: Text | None = None,
    slack: float | Fraction | None = None,
    compiled: bool = False,
    timeout_s: float | None = None,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> ReplayReport:
    """Replay a trace rule by rule; it may be the name of a file.

    ``program`` is a text to replay it with, instead of the one that it holds. ``slack`` is by how
    much floats may be off in assumptions and contracts (as the trace says: traces of vehicles say
    how far these may be off). With ``compiled`` the compiled program runs it, too.

    Raises :class:`koord.KoordError` for what is no trace, or does not fit the program; and
    :class:`koord.CancelledError` or TimeoutError after ``cancellation``, or ``timeout_s`` seconds.

    >>> koord.replay(report.counterexample).legal
    True
    """
    if not isinstance(trace, Trace):
        trace = load_trace(trace, program=program)
    elif program is not None:
        trace = Trace(read_trace(trace.to_json().encode(), "trace", source_of(program)))

    def told(step: Step) -> None:
        if progress is not None and step.robot is None:
            progress(Progress("replaying", round=step.round + 1))

    amount = None if slack is None else exact_number("slack", slack)
    budget = Budget(asker(cancellation, timeout_s))
    try:
        return replayed(trace.recorded, told, slack=amount, compiled=compiled, budget=budget)
    except OutOfBudgetError:
        raise ended(cancellation, "while a trace was replayed") from None


def replayed(
    recorded: Recorded,
    shown: Callable[[Step], None],
    *,
    slack: Fraction | None = None,
    compiled: bool = False,
    budget: Budget = ENDLESS,
) -> ReplayReport:
    """As :func:`replay`; ``shown`` is called with each legal step. Raises OutOfBudgetError."""
    if slack is not None:
        first, *later = [replace(part, slack=slack) for part in recorded.parts]
        recorded = replace(first, later=tuple(later))
    judged = _loosened(recorded, budget)
    if compiled:
        recorded_once(recorded, "compiled programs run")
    watches = list(map(_watch_of, judged.parts)) if is_of_robots(recorded) else []
    left = iter(watches)
    now: list[Watch] = []

    def seen(step: Step) -> None:
        shown(step)
        if step.rule in ("INIT", "RELOAD"):
            now[:] = [*islice(left, 1)]
        for watch in now:
            watch.see(step)

    report = ReplayReport(Trace(recorded), judge(judged, seen))
    if watches and report.legal:
        broken = next((one.violation for one in watches if one.violation is not None), None)
        unjudged = dict.fromkeys(name for one in watches for name in one.unjudged)
        report = replace(report, broken=broken, unjudged=tuple(unjudged))
    if not compiled or not report.legal:
        return report
    from koord.refinement.compiled_replay import rerun

    return replace(report, compared=True, departure=rerun(recorded, budget=budget))


def _watch_of(recorded: Recorded) -> Watch:
    """A watch that accuses nobody by answers that perhaps nobody gave."""
    from koord.refinement.completion import asked_by_rules

    return Watch.of(recorded, asked_by_rules(recorded))


def is_of_robots(recorded: Recorded) -> bool:
    """Return whether a trace is a run of robots that is to be judged on its way.

    Vehicles keep claims with slack, and are judged where they are simulated; what claims a
    violation shows it at its end.
    """
    is_open = recorded.violation is None and recorded.recording.loop is None
    return is_open and recorded.numbers is Numbers.DOUBLE and not recorded.slack


def _loosened(recorded: Recorded, budget: Budget) -> Recorded:
    """The trace with the trace's slack in the program's assumptions and contracts."""
    first, *later = [_loosened_part(part, budget) for part in recorded.parts]
    return replace(first, later=tuple(later))


def _loosened_part(part: Recorded, budget: Budget) -> Recorded:
    program = part.system.program
    if part.slack:
        from koord.runtime.compile.slack import loosened

        program = loosened(program, part.slack)
    return replace(part, system=replace(part.system, program=program, budget=budget))
