"""Diagnostics and verdicts as SARIF 2.1.0, which code hosts and editors show beside the text."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING
from urllib.parse import quote

from msgspec import UNSET, UnsetType, to_builtins

from koord.api import sarif_forms as forms
from koord.api.programs import CheckReport
from koord.syntax.catalogue import entries
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.source import NOWHERE, Span, counted, is_whole_file, whole_file
from koord.version import __version__

if TYPE_CHECKING:
    from koord.api.verdicts import Parts, Verdict
    from koord.api.verify_report import VerifyReport
    from koord.semantics.configurations import Configuration
    from koord.semantics.domain import Constant
    from koord.semantics.recordings import Step
    from koord.traces.names import Names
    from koord.verify.verdicts import Counterexample, Vacuity

#: What rules about claims say of runs that break them: a title, and a story.
_CLAIMS = {
    "PROP-INVARIANT": (
        "an invariant does not hold",
        "Some run of the program reaches a configuration in which the invariant is false.",
    ),
    "FAULT": (
        "a robot can fault",
        "In some run of the program an evaluation has no value: an index that is out of range, a "
        "division by zero, a value that is not set.",
    ),
    "LOST-UPDATE": (
        "an update of a shared variable can be lost",
        "In some run two robots read a shared variable in one round and both write it, so that "
        "one of the updates is lost. `atomic:` lets one robot at a time do it.",
    ),
    "PROP-CONTRACT": (
        "a module does not keep its contract",
        "In some run the model of a module answers what its contract does not allow.",
    ),
    "PROP-EVENTUALLY": (
        "what is to happen in the end may never happen",
        "There is a fair run without end in which it never happens.",
    ),
    "PROP-LEADS-TO": (
        "what is to follow may never follow",
        "There is a fair run without end in which the first happens and the second never follows.",
    ),
}

_RUN = (
    "The code flow is such a run, which was replayed by the rules of the semantics; "
    "`koord verify` shows it with all values."
)

#: The same of vacuities: why verdicts say less than they seem to.
_VACUOUS = (
    "a verdict says less than it seems to",
    "What was verified holds, but partly because what it is about cannot happen.",
)
_VACUITY = "VACUOUS"


def sarif(*found: CheckReport | VerifyReport) -> dict[str, object]:
    """Reports of :func:`koord.check` and :func:`koord.verify` as one SARIF log, as plain data.

    Results are diagnostics, claims that are violated (with runs as code flows) or unknown (of kind
    ``open``), and vacuities that are certain. Claims that hold are left out.

    >>> koord.sarif(koord.check("task.krd"))["version"]
    '2.1.0'
    """
    from koord.api.verdicts import Parts

    checked = [one for one in found if isinstance(one, CheckReport)]
    verified = [one for one in found if not isinstance(one, CheckReport)]
    diagnostics = [diagnostic for one in checked for diagnostic in one.diagnostics]
    return sarif_log(diagnostics, verified, Parts())


def sarif_text(
    diagnostics: Iterable[Diagnostic], reports: Sequence[VerifyReport] = (), *, parts: Parts
) -> bytes:
    """A SARIF log as the bytes of a file."""
    log = sarif_log(diagnostics, reports, parts)
    return (json.dumps(log, indent=2, ensure_ascii=False) + "\n").encode("utf-8")


def sarif_log(
    diagnostics: Iterable[Diagnostic], reports: Sequence[VerifyReport], parts: Parts
) -> dict[str, object]:
    """A SARIF log as plain data; ``parts`` records details that fail."""
    rules = _Rules()
    results = [_of_diagnostic(one, rules) for one in dict.fromkeys(diagnostics)]
    for report in reports:
        for verdict in report.verdicts:
            if not verdict.holds:
                results.append(_of_verdict(report, verdict, rules, parts))
        results += [_of_vacuity(report, one, rules) for one in report.vacuities if one.certain]
    ended = not any(report.interrupted for report in reports)
    run = forms.Run(
        forms.Tool(forms.Driver("koord", __version__, rules.made)),
        [forms.Invocation(ended)],
        results,
    )
    log: dict[str, object] = to_builtins(forms.Log(forms.SCHEMA, "2.1.0", [run]))
    return log


class _Rules:
    """The rules of a log, in the order in which results need them."""

    def __init__(self) -> None:
        self.made: list[forms.Rule] = []
        self._places: dict[str, int] = {}

    def of_code(self, code: str) -> int:
        """The place of a diagnostic's code."""
        if code in self._places:
            return self._places[code]
        story = entries()[code]
        paragraphs = [" ".join(each.split()) for each in story.story.strip().split("\n\n")]
        text, markdown = "\n\n".join(paragraphs), story.story.strip()
        if story.bad:
            text += f"\n\nFor example:\n\n{story.bad}\nThis is right:\n\n{story.good}"
            markdown += _example("For example", story.bad) + _example("This is right", story.good)
        level: forms.Level = "error" if story.severity is Severity.ERROR else "warning"
        return self._add(code, story.title, paragraphs[0], level, (text, markdown))

    def of_claim(self, rule: str) -> int:
        """The place of a rule of the semantics that a claim is about."""
        title, story = _CLAIMS[rule]
        help_ = f"{story} {_RUN}"
        return self._add(rule, title, story, "error", (help_, help_))

    def of_vacuity(self) -> int:
        """The place of the rule that verdicts are not vacuous."""
        title, story = _VACUOUS
        return self._add(_VACUITY, title, story, "warning", (story, story))

    def _add(
        self, rule: str, title: str, story: str, level: forms.Level, help_: tuple[str, str]
    ) -> int:
        if rule not in self._places:
            self._places[rule] = len(self.made)
            self.made.append(
                forms.Rule(
                    id=rule,
                    short_description=forms.Message(title),
                    full_description=forms.Message(story),
                    default_configuration=forms.Configuration(level),
                    help=forms.Message(*help_),
                )
            )
        return self._places[rule]


def _example(heading: str, program: str) -> str:
    return f"\n\n{heading}:\n\n```koord\n{program}```"


# --- places ---------------------------------------------------------------------------------------


def uri_of(file: str) -> str:
    """The URI of a file: relative, as it is named, or absolute."""
    path = PurePath(file)
    if path.is_absolute():
        return path.as_uri()
    return quote(file.replace(os.sep, "/"))


def _region(span: Span) -> forms.Region:
    # A region that ends where it begins is an insertion, and one must not end before that.
    end_column = span.end_column
    if span.end_line == span.line:
        end_column = max(span.column, end_column)
    return forms.Region(span.line, span.column, span.end_line, end_column)


def _place(span: Span | None) -> forms.PhysicalLocation | UnsetType:
    if span is None or span.file == NOWHERE.file:
        return UNSET
    artifact = forms.Artifact(uri_of(span.file))
    if is_whole_file(span):
        return forms.PhysicalLocation(artifact)
    return forms.PhysicalLocation(artifact, _region(span))


def _location(
    span: Span | None, message: str | None = None, name: str | None = None
) -> forms.Location:
    return forms.Location(
        _place(span),
        UNSET if message is None else forms.Message(message),
        UNSET if name is None else [forms.LogicalLocation(name, "member")],
    )


# --- diagnostics ----------------------------------------------------------------------------------


def _of_diagnostic(one: Diagnostic, rules: _Rules) -> forms.Result:
    said = one.message if one.hint is None else f"{one.message}\nhelp: {one.hint}"
    fixes: list[forms.Fix] | UnsetType = UNSET
    if one.edits:
        replacements = [
            forms.Replacement(_region(edit.span), forms.Content(edit.text)) for edit in one.edits
        ]
        change = forms.ArtifactChange(forms.Artifact(uri_of(one.span.file)), replacements)
        fixes = [forms.Fix(forms.Message(one.hint or one.message), [change])]
    related = [_location(note.span, note.message) for note in one.notes]
    return forms.Result(
        rule_id=one.code,
        rule_index=rules.of_code(one.code),
        kind="fail",
        level="error" if one.severity is Severity.ERROR else "warning",
        message=forms.Message(said),
        locations=[_location(one.span)] if _place(one.span) is not UNSET else [],
        related_locations=related or UNSET,
        fixes=fixes,
    )


# --- verdicts -------------------------------------------------------------------------------------


def _of_verdict(
    report: VerifyReport, verdict: Verdict, rules: _Rules, parts: Parts
) -> forms.Result:
    run, stated = verdict.found.counterexample, verdict.found.claim.stated
    file = whole_file(report.program.source.name)
    place = file if stated is None else stated.span
    made = forms.Result(
        rule_id=verdict.rule,
        rule_index=rules.of_claim(verdict.rule),
        kind="fail",
        level="error",
        message=forms.Message(f"{verdict.name} is unknown for {report.problem}: {verdict.reason}"),
        locations=[_location(place, name=verdict.name)],
    )
    if run is None:
        made.kind, made.level = "open", "none"
        return made
    broken = place if run.span is None or run.span.file == NOWHERE.file else run.span
    made.locations = [_location(broken, name=verdict.name)]
    detail = run.detail
    if not detail.startswith(verdict.name):
        detail = f"{verdict.name}: {detail}"
    made.message = forms.Message(f"{detail}, {_when(run)}; {report.problem}")
    flows = []
    for each in (run, *verdict.found.others):
        with parts.enduring(f"the code flow of {verdict.name}"):
            flows.append(_flow(verdict, each, broken))
    made.code_flows = flows or UNSET
    return made


def _when(run: Counterexample) -> str:
    if run.recording.loop is not None:
        return "in a run without end"
    if run.round == 0:
        return "at the start"
    return f"in round {run.round}, {run.phase.value}"


def _flow(verdict: Verdict, run: Counterexample, broken: Span) -> forms.CodeFlow:
    """A counterexample, step by step; robots that skip and change nothing are left out."""
    steps = list(_steps(verdict, run))
    end = _location(broken, f"{run.detail} [{verdict.rule}]")
    locations = [forms.FlowLocation(each, order, "important") for order, each in enumerate(steps)]
    locations.append(forms.FlowLocation(end, len(steps), "essential"))
    rounds = counted(len(run.recording.rounds), "round")
    said = f"a run of {rounds} that breaks {verdict.name}"
    if run.recording.loop is not None:
        said += f"; from round {run.recording.loop + 1} on its rounds repeat for ever"
    return forms.CodeFlow(forms.Message(said), [forms.ThreadFlow(locations)])


def _steps(verdict: Verdict, run: Counterexample) -> Iterator[forms.Location]:
    """The steps, each where its event stands; those without one where the program does.

    Code hosts show no step that has no place.
    """
    from koord.traces.changes import changes
    from koord.traces.names import Names

    names, file = Names(verdict.system), whole_file(verdict.program.source.name)
    before = None
    for step in verdict.steps(run):
        after = step.configuration
        if before is None:
            before = after
            yield _location(file, f"the start: {', '.join(_values(names, after))}")
            continue
        found = [one.told(step.robot) for one in changes(names, before, after)]
        before = after
        if found or step.event is not None:
            what = ", ".join(found) or "nothing changes"
            yield _location(_event_span(verdict, step) or file, f"{_who(step)}: {what}")


def _values(names: Names, configuration: Configuration[Constant]) -> Iterator[str]:
    """All variables with their values; those of robots with the robot behind ``@``."""
    from koord.traces.rendering import show_storage

    store = configuration.store
    shared = (*names.allread, *names.allwrite)
    for one, storage in zip(shared, (*store.allread, *store.allwrite), strict=True):
        yield f"{one.name} = {show_storage(storage, one.type)}"
    for number, robot in enumerate(configuration.robots):
        own = names.of(number)
        held = zip((*own.locals, *own.ports), (*robot.locals, *robot.ports), strict=True)
        for one, storage in held:
            yield f"{one.name}@{number} = {show_storage(storage, one.type)}"


def _who(step: Step) -> str:
    who = "the environment" if step.robot is None else f"robot {step.robot}"
    event = "" if step.event is None else f" runs {step.event}"
    return f"round {step.round + 1}: {who}{event}"


def _event_span(verdict: Verdict, step: Step) -> Span | None:
    """The place of the event that a robot runs; None for skips and for the environment."""
    if step.robot is None or step.event is None:
        return None
    events = verdict.system.agent(step.robot).events
    return next(event.span for event in events if event.name == step.event)


def _of_vacuity(report: VerifyReport, one: Vacuity, rules: _Rules) -> forms.Result:
    about = re.sub(r"\s+", " ", one.told)
    file = whole_file(report.program.source.name)
    return forms.Result(
        rule_id=_VACUITY,
        rule_index=rules.of_vacuity(),
        kind="fail",
        level="warning",
        message=forms.Message(f"{about}; {report.problem}"),
        locations=[_location(file if one.span is None else one.span)],
    )
