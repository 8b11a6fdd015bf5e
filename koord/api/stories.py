"""Stories of results: what a page, a notebook or an editor shows of a run, as data.

A story is made of the trace that a result has; what the result knows besides stands in its ending:
the words of the verdict, what the compiled program does, why a loop is fair.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from msgspec import to_builtins
from msgspec.structs import replace

from koord.api.results import Result
from koord.api.story_page import framed, page_of
from koord.semantics.recordings import Reached, execute
from koord.syntax.source import counted
from koord.traces import story_form as forms
from koord.traces.story import story_of
from koord.traces.trace import BEFORE_ROUNDS, Violation
from koord.traces.trace import Trace as Recorded

if TYPE_CHECKING:
    from koord.api.fairness import Fair
    from koord.api.replay import ReplayReport
    from koord.api.run import RunReport
    from koord.api.traces import Trace
    from koord.api.verdicts import Verdict
    from koord.refinement.compiled_replay import Rerun
    from koord.traces.changes import Change
    from koord.traces.replay import Refused
    from koord.verify.verdicts import Counterexample


class Story(Result, frozen=True):
    """A run as people look at it: turns in words, and why the end breaks what is claimed."""

    told: forms.Story

    @property
    def headline(self) -> str:
        """How the run ends, in a line."""
        return self.told.ending.headline

    def to_dict(self) -> dict[str, object]:
        """The story as plain data; its schema is ``story``."""
        plain: dict[str, object] = to_builtins(self.told)
        return plain

    def to_html(self) -> str:
        """A page that shows it and loads nothing."""
        return page_of(self.told.title, [self.told])

    def __repr__(self) -> str:
        return f"<Story of {self.told.about}: {self.headline}>"

    def _repr_html_(self) -> str:
        return framed(self.to_html(), f"{self.told.title}: {self.headline}")


def story(found: Trace | RunReport | ReplayReport | Verdict) -> Story:
    """Tell a run as people look at it, for pages and other pictures.

    ``found`` is a trace, a run, a replay (told up to the first step that is wrong), or a verdict
    that has a counterexample. Raises :class:`koord.ArgumentError` for a verdict without one.

    >>> koord.story(koord.run("task.krd", rounds=5)).headline
    """
    from koord.api.replay import ReplayReport
    from koord.api.results import ArgumentError
    from koord.api.run import RunReport
    from koord.api.traces import Trace, recorded_once

    if isinstance(found, Trace | RunReport | ReplayReport):
        trace = found if isinstance(found, Trace) else found.trace
        recorded_once(trace.recorded, "pictures of steps have")
    match found:
        case Trace():
            return Story(story_of(found.recorded, title=_title(found.recorded)))
        case RunReport():
            recorded = found.trace.recorded
            return Story(story_of(recorded, title=_title(recorded)))
        case ReplayReport():
            return of_replay(found)
        case _:
            told = next(of_verdict(found), None)
            if told is None:
                raise ArgumentError("found", f"{found.name} has no counterexample to tell of")
            return told


def _title(trace: Recorded) -> str:
    return "" if trace.violation is not None else f"a run of {trace.sources.program.name}"


# --- verdicts -------------------------------------------------------------------------------------


def of_verdict(verdict: Verdict) -> Iterator[Story]:
    """Tell a verdict's counterexamples, one for each way to break the claim, as they are wanted."""
    first = verdict.found.counterexample
    runs = () if first is None else (first, *verdict.found.others)
    return (_counterexample(verdict, run, k, len(runs)) for k, run in enumerate(runs, start=1))


def _counterexample(verdict: Verdict, run: Counterexample, number: int, of: int) -> Story:
    recorded = verdict.recorded(run)
    title = verdict.name if of == 1 else f"{verdict.name}, {number} of {of} ways"
    told = story_of(recorded, title=title)
    fair = verdict.fairness(run)
    if told.loop is not None and fair is not None:
        told.loop = _loop(told.loop, fair, verdict, recorded)
    notes = compiled_lines(verdict.rerun(run))
    instant = verdict.instant(run)
    if instant is not None:
        notes.insert(0, f"it breaks {float(instant):.6g} s into the environment's turn")
    told.ending = replace(
        told.ending,
        detail=run.detail or told.ending.detail,
        rule=verdict.rule,
        robot=told.ending.robot if run.robot is None else run.robot,
        notes=notes,
    )
    return Story(told)


def of_step(verdict: Verdict) -> Story | None:
    """The story of the step that no proof of a claim gets over; None if none was found."""
    from koord.api.traces import sources_of
    from koord.traces.story import OpenStep, story_of_step

    step, stated = verdict.found.step, verdict.found.claim.stated
    if step is None or stated is None or verdict.found.counterexample is not None:
        return None
    about = str(verdict.program.problem(verdict.system.kinds, verdict.system.delta_s))
    shown = OpenStep(step.configurations, step.events, step.phase.value)
    sources = sources_of(verdict.program)
    return Story(story_of_step(sources, verdict.system, shown, stated, about))


def _loop(
    loop: forms.StoryLoop, fair: Fair, verdict: Verdict, recorded: Recorded
) -> forms.StoryLoop:
    from koord.traces.fairness import told

    first, last = recorded.configurations[loop.first - 1], recorded.configurations[-1]
    left_behind = list(verdict.left_behind(first, last))
    return forms.StoryLoop(
        loop.first, loop.last, list(told(fair.why)), list(fair.excluding), left_behind
    )


def compiled_lines(departure: Rerun) -> list[str]:
    """What the compiled program does in a run of the rules, in lines."""
    from koord.refinement.rounding import Unjudged
    from koord.syntax.source import visible

    if departure is None:
        return ["the compiled program does the same, state for state"]
    if isinstance(departure, Unjudged):
        return [
            "the compiled program comes to the same states, up to rounding; whether it breaks",
            f"the claim there is not known: {visible(departure.reason)}",
        ]
    where = f"round {departure.round + 1}" if departure.round != BEFORE_ROUNDS else "the start"
    return [f"the compiled program departs at {where}: {visible(departure.reason)}"]


def compiled_changes(departure: Rerun) -> tuple[Change, ...]:
    """The locations in which the compiled program's state differs from the recorded one."""
    from koord.refinement.compiled_replay import Departure

    return departure.changes if isinstance(departure, Departure) else ()


# --- replays and refinement -----------------------------------------------------------------------


def of_programs(trace: Recorded, broken: Violation | None = None) -> list[Story]:
    """Tell a run whose program was changed: a story for each program, in order. [RELOAD]

    ``broken`` is the claim that the run breaks, which its trace does not say.
    """
    told: list[Story] = []
    before, behind = None, 0
    for number, part in enumerate(trace.parts, 1):
        rounds = len(part.recording.rounds)
        steps = list(execute(part.numbers.domain, part.system, part.recording, before=before))
        title = f"program {number} of {len(trace.parts)}"
        one = story_of(part, title=title, steps=steps, behind=behind)
        behind += rounds
        if number < len(trace.parts):
            headline = f"another program goes on behind round {behind}"
            one.ending = replace(one.ending, headline=headline)
        elif broken is not None and one.ending.kind == "done":
            one.ending = _broken(one.ending, broken)
        told.append(Story(one))
        before = Reached(part.system, part.configurations[-1])
    return told


def _broken(ending: forms.StoryEnding, broken: Violation) -> forms.StoryEnding:
    where = f"in round {broken.round + 1}" if broken.round != BEFORE_ROUNDS else "at the start"
    return replace(ending, kind="violated", headline=f"{broken.name} does not hold, {where}")


def of_replay(report: ReplayReport) -> Story:
    """The story of a replay: of all steps, or of those before the first one that is wrong."""
    recorded = report.trace.recorded
    if report.refused is not None:
        return of_refused(recorded, report.refused)
    told = story_of(recorded, title=_title(recorded))
    ending = told.ending
    if report.compared:
        ending = _compared(ending, report.departure)
    if report.broken is not None and ending.kind == "done":
        ending = _broken(ending, report.broken)
    told.ending = ending
    return Story(told)


def _compared(ending: forms.StoryEnding, departure: Rerun) -> forms.StoryEnding:
    notes = [*ending.notes, *compiled_lines(departure)]
    changes = _differing(compiled_changes(departure))
    if not changes:
        return replace(ending, notes=notes)
    return replace(
        ending, notes=notes, expected_as="recorded", found_as="compiled", differences=changes
    )


def of_refused(trace: Recorded, refused: Refused) -> Story:
    """The story of a trace up to the first step that the rules do not allow."""
    from koord.traces.replay import replay

    steps: list[Any] = []
    replay(trace, steps.append)
    step = refused.step
    told = story_of(
        trace, title=f"a run of {trace.sources.program.name}", steps=steps, tracked=False
    )
    where = "the start" if step.round == BEFORE_ROUNDS else f"round {step.round + 1}"
    who = "" if step.robot is None else f", robot {step.robot}"
    what = ""
    if step.robot is not None:
        what = ", a skip" if step.event is None else f", event {step.event}"
    legal = counted(len(steps), "step")
    told.ending = replace(
        told.ending,
        kind="refused",
        headline=f"{where}{who}{what}: not legal",  # the rule is told beside it
        moment=len(told.moments) - 1,
        detail=refused.reason,
        rule=refused.rule,
        robot=step.robot,
        place=None,
        expected_as="by the rules",
        found_as="recorded",
        differences=_differing(refused.differences),
        notes=[f"{legal} before it are legal, and told here"],
    )
    return Story(told)


def _differing(changes: Iterable[Change]) -> list[forms.DifferingValue]:
    return [
        forms.DifferingValue(change.robot, change.name, change.old, change.new)
        for change in changes
    ]
