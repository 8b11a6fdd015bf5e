"""Stories of traces: what every turn did, in words, and why the end breaks what is claimed. [TRACE]

The reference semantics runs the recording again; nothing is told but what it gives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import assert_never

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Configuration, Fault
from koord.semantics.domain import Constant
from koord.semantics.recordings import Step, execute
from koord.syntax import core
from koord.syntax.source import NOWHERE, Span, is_whole_file
from koord.syntax.system import System
from koord.syntax.types import POS
from koord.traces.lassos import able_in, rule_of
from koord.traces.names import Names, variables
from koord.traces.rendering import repeats, show_output
from koord.traces.story_form import (
    FORMAT,
    VERSION,
    Moment,
    Story,
    StoryEnding,
    StoryEvent,
    StoryFault,
    StoryKind,
    StoryLoop,
    StoryPlace,
    StoryText,
    StoryWorld,
    Track,
)
from koord.traces.story_rows import RowTable
from koord.traces.story_tracks import stated_in, track_of_states, tracks_of
from koord.traces.trace import BEFORE_ROUNDS, Sources, Trace, Violation, ViolationKind

#: Of longer runs the last turns are told.
MOST_MOMENTS = 20_000

#: The names of sensors that tell where a robot is.
_PLACES = ("position", "psn")


def story_of(
    trace: Trace,
    *,
    title: str = "",
    steps: Sequence[Step] | None = None,
    tracked: bool = True,
    behind: int = 0,
) -> Story:
    """Tell a trace, whose steps are legal; ``steps`` are those to tell, where it is known.

    ``tracked``: the statement that the trace breaks is evaluated after every turn. So many rounds
    of the run, of other programs, lie ``behind``: those of the trace are counted from there.
    """
    d, system = trace.numbers.domain, trace.system
    if steps is None:
        steps = list(execute(d, system, trace.recording))
    names = Names(system)
    violation = trace.violation
    stated = stated_in(trace)
    read = frozenset() if stated is None else variables((stated.condition, stated.trigger))
    subject = violation.name if violation and violation.kind is ViolationKind.LOST_UPDATE else ""
    begun = steps[0].configuration if steps else trace.configurations[0]
    table = RowTable.of(names, begun, read, subject)
    first = _first_told(steps)
    told = steps[first:]
    before = steps[first - 1].configuration if first else None
    places = partial(_place, frozenset(source.name for source in trace.sources.texts))
    moments = list(_moments(trace, table, told, before, places, behind))
    world = _world(system, table)
    tracks = tracks_of(trace, told, steps) if tracked and told else []
    return Story(
        format=FORMAT,
        version=VERSION,
        title=title or (violation.name if violation is not None else "a run"),
        program=trace.sources.program.name,
        about=str(trace.problem),
        numbers=trace.numbers.value,
        delta_s=float(system.delta_s),
        texts=[StoryText(source.name, source.text) for source in trace.sources.texts],
        kinds=_kinds(system, places),
        robots=list(system.kinds),
        rows=[replace(row, start=text) for row, text in zip(table.rows, table.texts, strict=True)],
        moments=moments or [_nothing()],
        left_out=max(told[0].round, 0) if first else 0,
        tracks=tracks,
        loop=_loop(trace),
        world=world,
        ending=_ending(trace, told, _breaking(trace, tracks, told), places, behind),
    )


class OpenStep(Struct, frozen=True):
    """A step from a configuration that may not be reachable: rounds, and who runs what in them.

    ``events[k][i]`` is the position of the event that robot i runs in round k, or ``NO_EVENT``.
    """

    configurations: tuple[Configuration[Constant], ...]
    events: tuple[tuple[int, ...], ...]
    phase: str  #: up to where the last round goes, in words


def story_of_step(
    sources: Sources, system: System, step: OpenStep, stated: core.Property, about: str
) -> Story:
    """Tell a step that breaks a statement, though nobody knows whether a run comes to it.

    The order of turns is not told, so that all changes of a round are those of its last moment.
    """
    table = RowTable.of(Names(system), step.configurations[0], variables(stated.condition), "")
    start, before = list(table.texts), step.configurations[0]
    states: list[Configuration[Constant] | None] = [before]
    first = list(table.positions(None, before))
    moments = [Moment(0, "INIT", None, None, None, [], first, [], [], None)]
    for number, (events, after) in enumerate(
        zip(step.events, step.configurations[1:], strict=True), start=1
    ):
        for robot, event in enumerate(events):
            ran = None if event == NO_EVENT else event
            rule = "SKIP" if ran is None else "EVENT-TRANS"
            moments.append(Moment(number, rule, robot, ran, None, [], [], [], [], None))
            states.append(None)
        changes, moved = list(table.changes(before, after)), list(table.positions(before, after))
        moments.append(Moment(number, "ENV-TRANS", None, None, None, changes, moved, [], [], None))
        states.append(after)
        before = after
    places = partial(_place, frozenset(source.name for source in sources.texts))
    ending = StoryEnding(
        "step",
        f"{stated.name} is not inductive: a step breaks it, {step.phase}",
        len(moments) - 1,
        "before it all claims hold, and nobody knows whether a run comes there; an invariant that "
        "rules it out would prove the claim",
        "",
        places(stated.span),
        None,
        "",
        "",
        [],
        [],
    )
    return Story(
        format=FORMAT,
        version=VERSION,
        title=f"{stated.name}: a step that breaks it",
        program=sources.program.name,
        about=about,
        numbers="exact",
        delta_s=float(system.delta_s),
        texts=[StoryText(source.name, source.text) for source in sources.texts],
        kinds=_kinds(system, places),
        robots=list(system.kinds),
        rows=[replace(row, start=text) for row, text in zip(table.rows, start, strict=True)],
        moments=moments,
        left_out=0,
        tracks=track_of_states(system, stated, states),
        loop=None,
        world=_world(system, table),
        ending=ending,
    )


def _kinds(system: System, places: Callable[[Span], StoryPlace | None]) -> list[StoryKind]:
    return [
        StoryKind(agent.name, [StoryEvent(e.name, places(e.span)) for e in agent.events])
        for agent in system.program.agents
    ]


# --- turns ----------------------------------------------------------------------------------------


def _first_told(steps: Sequence[Step]) -> int:
    """The first step that is told: the start, or the beginning of a late round."""
    first = max(0, len(steps) - MOST_MOMENTS)
    while 0 < first < len(steps) and steps[first].round == steps[first - 1].round:
        first += 1
    return first if first < len(steps) else 0


def _nothing() -> Moment:
    """The start of a run of which no step is legal."""
    return Moment(0, "INIT", None, None, None, [], [], [], [], None)


def _moments(
    trace: Trace,
    table: RowTable,
    steps: Iterable[Step],
    before: Configuration[Constant] | None,
    places: Callable[[Span], StoryPlace | None],
    behind: int,
) -> Iterator[Moment]:
    """The steps as moments; the table's texts are those before the first one, at the end."""
    system, d = trace.system, trace.numbers.domain
    if before is not None:
        table.texts[:] = table.texts_of(before)
    start = list(table.texts)
    for step in steps:
        after = step.configuration
        changes = list(table.changes(before, after))
        if before is None and step.rule in ("INIT", "RELOAD"):
            start = list(table.texts)
            changes = []
        event = None
        if step.event is not None and step.robot is not None:
            events_of = system.agent(step.robot).events
            event = next(k for k, e in enumerate(events_of) if e.name == step.event)
        blocked = None
        if step.rule == "SKIP" and before is not None and before.taken:
            assert step.robot is not None
            open_ = able_in(system, before, step.robot, d).events
            events = zip(system.agent(step.robot).events, open_, strict=False)
            blocked = next(
                (e.name for e, is_open in events if is_open and e.lock_classes & before.taken), None
            )
        yield Moment(
            round=0 if step.round == BEFORE_ROUNDS else step.round + 1 + behind,
            rule=step.rule,
            robot=step.robot,
            event=event,
            blocked=blocked,
            changes=changes,
            positions=list(table.positions(before, after)),
            output=[f"{w.stream} << {show_output(w.values, w.types)}" for w in step.stepped.output],
            broken=[
                f"contract {contract.name} of robot {robot}"
                for robot, contract in step.stepped.promises
            ],
            fault=_fault(after.fault, places),
        )
        before = after
    table.texts[:] = start


def _fault(fault: Fault | None, places: Callable[[Span], StoryPlace | None]) -> StoryFault | None:
    if fault is None:
        return None
    return StoryFault(fault.kind.value, fault.robot, places(fault.span), fault.detail)


def _place(files: frozenset[str], span: Span) -> StoryPlace | None:
    """A place in one of the texts; None for what stands in no text."""
    if span == NOWHERE or is_whole_file(span) or span.file not in files:
        return None
    return StoryPlace(span.file, span.line, span.column, span.end_line, span.end_column)


# --- the world ------------------------------------------------------------------------------------


def _world(system: System, table: RowTable) -> StoryWorld | None:
    """Where robots are and want to be; None if no robot has a sensor that tells it."""
    robots: list[int | None] = []
    targets: list[int | None] = []
    for robot in range(system.robots):
        places = {"sensor": list[int](), "actuator": list[int]()}
        for row, (one, type_) in enumerate(zip(table.rows, table.types, strict=True)):
            if one.robot == robot and type_ == POS and one.home in places:
                places[one.home].append(row)
        named = [
            row
            for row in places["sensor"]
            if table.rows[row].name.rpartition(".")[2].lower() in _PLACES
        ]
        robots.append(next(iter(named or places["sensor"]), None))
        targets.append(next(iter(places["actuator"]), None))
    if all(row is None for row in robots):
        return None
    return StoryWorld(robots, targets)


# --- the end --------------------------------------------------------------------------------------


def _loop(trace: Trace) -> StoryLoop | None:
    first = trace.recording.loop
    if first is None:
        return None
    return StoryLoop(first + 1, len(trace.recording.rounds), [], [], [])


def _breaking(trace: Trace, tracks: Sequence[Track], told: Sequence[Step]) -> int:
    """The turn that breaks what is claimed: the first after which it does not hold, or the last."""
    if trace.recording.loop is None and tracks and False in tracks[0].truth:
        return tracks[0].truth.index(False)
    return max(0, len(told) - 1)


def _ending(
    trace: Trace,
    told: Sequence[Step],
    moment: int,
    places: Callable[[Span], StoryPlace | None],
    behind: int,
) -> StoryEnding:
    """The end of a legal trace: a fault, a violation, a loop, or just its last round."""
    done = StoryEnding("done", "the run ends here", moment, "", "", None, None, "", "", [], [])
    if not told:
        return done
    last, violation, fault = told[moment], trace.violation, told[-1].configuration.fault
    if fault is not None:
        whose = "" if fault.robot is None else f" of robot {fault.robot}"
        return replace(
            done,
            kind="fault",
            headline=f"fault{whose}: {fault.kind.value}, {when(told[-1], behind)}",
            moment=len(told) - 1,
            detail=fault.detail,
            rule="FAULT",
            place=places(fault.span),
            robot=fault.robot,
        )
    if trace.recording.loop is not None:
        stated = stated_in(trace)
        named = "" if stated is None else f"{stated.name} is broken: "
        return replace(
            done,
            kind="loop",
            headline=f"{named}{repeats(trace.recording)}",
            rule="" if stated is None else rule_of(stated),
            place=None if stated is None else places(stated.span),
        )
    if violation is not None:
        return replace(
            done,
            kind="violated",
            headline=f"{_broken(violation)}, {when(last, behind)}",
            rule=_RULES[violation.kind],
            place=_place_of(trace, violation, places),
            robot=violation.robot,
        )
    if last.round != BEFORE_ROUNDS:
        return replace(done, headline=f"the run ends {when(last, behind)}")
    return done


def _broken(violation: Violation) -> str:
    match violation.kind:
        case ViolationKind.PROPERTY:
            return f"{violation.name} does not hold"
        case ViolationKind.CONTRACT:
            return f"contract {violation.name} of robot {violation.robot} is broken"
        case ViolationKind.LOST_UPDATE:
            return f"an update of {violation.name} is lost"
    assert_never(violation.kind)


_RULES = {
    ViolationKind.PROPERTY: "PROP-INVARIANT",
    ViolationKind.CONTRACT: "PROP-CONTRACT",
    ViolationKind.LOST_UPDATE: "LOST-UPDATE",
}


def when(step: Step, behind: int = 0) -> str:
    """The end of a step in words; so many rounds of other programs lie behind it."""
    if step.round == BEFORE_ROUNDS:
        return "at the start"
    number = step.round + 1 + behind
    if step.robot is None:
        return f"at the end of round {number}"
    did = "skips" if step.event is None else f"runs {step.event}"
    return f"in round {number}, as robot {step.robot} {did}"


def _place_of(
    trace: Trace, violation: Violation, places: Callable[[Span], StoryPlace | None]
) -> StoryPlace | None:
    program = trace.system.program
    if violation.kind is ViolationKind.LOST_UPDATE:
        spans = [d.span for d in program.allwrite if d.variable.name == violation.name]
    elif violation.kind is ViolationKind.PROPERTY:
        spans = [p.span for p in program.properties if p.name == violation.name]
    else:
        contracts = (c for a in program.agents for m in a.modules for c in m.contracts)
        spans = [c.span for c in contracts if c.name == violation.name]
    return next(iter(map(places, spans)), None)
