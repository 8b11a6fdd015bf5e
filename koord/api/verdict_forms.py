"""Forms of the JSON that `koord verify` prints, from which its schema is generated."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from msgspec import UNSET, Meta, UnsetType

from koord.api.forms import Compiled, Version
from koord.api.forms import Problem as Problem
from koord.syntax.analysis.premises import PremiseKind
from koord.syntax.forms import Form, FromOne, Natural, Told, words
from koord.traces.fairness import EventStatus
from koord.verify.claims import ClaimKind, ClaimPhase
from koord.verify.obstacles import Obstacle as _Obstacle
from koord.verify.verdicts import Emptiness, Outcome

Seconds: TypeAlias = Annotated[float, Meta(ge=0)]
Rounds: TypeAlias = Annotated[
    list[FromOne], Meta(description="Rounds that repeat; they count from 1.")
]
Place: TypeAlias = Annotated[str, Meta(description="FILE:LINE:COLUMN")]


class Failure(Form):
    who: Annotated[Told, Meta(description="The engine, or what else was done.")]
    what: Told
    place: Annotated[
        str | None,
        Meta(description="Where in koord, if that is to blame; null where memory or time is."),
    ]


def _kinds(of: type[_Obstacle]) -> list[str]:
    """The names of all kinds of obstacles, each before those that are kinds of it."""
    return [name for kind in of.__subclasses__() for name in (kind.__name__, *_kinds(kind))]


class Obstacle(Form):
    engine: str
    kind: Annotated[str, words(*_kinds(_Obstacle))]
    names: Annotated[
        list[str],
        Meta(description="Variables, sensors or functions that may have too many values."),
    ]
    what: Told
    cure: Told


class Ways(Form):
    found: Annotated[FromOne, Meta(description="How many, the first included.")]
    complete: Annotated[bool, Meta(description="Whether there is no other within the bound.")]
    reason: Annotated[
        str | None,
        Meta(description="Why there may be more; null if as many were found as were asked for."),
    ]


class FairEvent(Form):
    event: str
    standing: EventStatus
    enabled: Rounds
    ran: Rounds


class FairLock(Form):
    variables: list[str]
    asks: Rounds
    granted: Rounds


class FairRobot(Form):
    robot: Natural
    runs: Rounds
    not_ready: Rounds
    skips_though_ready: Rounds
    events: list[FairEvent]
    locks: Annotated[
        list[FairLock],
        Meta(
            description="Before which rounds the robot can do nothing without the lock of the "
            "variables, and in which it has it."
        ),
    ]


class Expectation(Form):
    name: str
    robot: Natural | None
    met: Rounds


class FairRun(Form):
    rounds: Rounds
    robots: list[FairRobot]
    expectations: list[Expectation]
    excluded_by: Annotated[
        list[str],
        Meta(description="Lines of Koord, each of which excludes the run and lets others be."),
    ]


class Fault(Form):
    kind: str
    place: str


class Violation(Form):
    round: Annotated[Natural, Meta(description="Counts from 1; 0 is the initial configuration.")]
    phase: ClaimPhase
    robot: Annotated[Natural | None, Meta(description="Whose turn broke it.")]
    detail: str
    place: Annotated[
        str | None, Meta(description="FILE:LINE:COLUMN of the statement that is broken.")
    ]
    fault: Annotated[
        Fault | None,
        Meta(
            description="Why a statement cannot be evaluated, as where it reads an unset value: "
            "it is false then."
        ),
    ]
    loop: Annotated[
        FromOne | None,
        Meta(
            description="Of a run without end: the first of the rounds that repeat for ever; the "
            "last one is round."
        ),
    ]
    fair: Annotated[
        FairRun | None,
        Meta(description="Of a run without end: why it is fair, and what would exclude it."),
    ]
    compiled: Annotated[
        Compiled,
        Meta(
            description="What the compiled program did when it was given the same run; rounds "
            "count from 1."
        ),
    ]
    robots: Annotated[
        FromOne | UnsetType,
        Meta(
            description="How many robots there are in the run, where the claim is about every "
            "number of them."
        ),
    ] = UNSET


class Claim(Form):
    name: Told
    kind: ClaimKind
    outcome: Outcome
    engine: Annotated[str, Meta(description="What gave the verdict; none if nothing did.")]
    every_number_of_robots: Annotated[
        bool,
        Meta(
            description="Whether it holds for every number of robots, not only the one asked about."
        ),
    ]
    all_rounds: Annotated[bool, Meta(description="Whether it holds for every number of rounds.")]
    through_round: Annotated[
        Natural | None, Meta(description="The last round through which it was seen to hold.")
    ]
    seconds: Seconds
    reason: Annotated[str | None, Meta(description="Why the outcome is unknown.")]
    obstacles: Annotated[
        list[Obstacle],
        Meta(
            description="If it is unknown: what stood in the way of each engine that was asked, "
            "and what would have to change. If it holds through some rounds: the same of the "
            "proofs for all rounds that were looked for and given up."
        ),
    ]
    fairness: Annotated[
        list[str],
        Meta(
            description="What a liveness proof needs: robots, locks, and names of expectations "
            "(assume P leadsto Q)."
        ),
    ]
    violated: Violation | None
    fewest_rounds: Annotated[
        bool,
        Meta(
            description="Whether it is known that no run with fewer rounds than the one in "
            "'violated' breaks the claim; false of runs without end."
        ),
    ]
    others: Annotated[
        list[Violation],
        Meta(description="Different ways, if --max-violations asked for them."),
    ]
    ways: Annotated[
        Ways | None,
        Meta(
            description="What became of the search for different ways; null if --max-violations "
            "asked for none."
        ),
    ]
    kept: Annotated[
        bool | UnsetType,
        Meta(description="True where a cache knew the answer, and `seconds` are those of then."),
    ] = UNSET


class Vacuity(Form):
    what: Emptiness
    subject: Annotated[str | None, Meta(description="The event or the invariant.")]
    detail: Told
    certain: Annotated[bool, Meta(description="False if only a longer run could tell.")]
    place: str | None


class NotLookedAt(Form):
    what: Emptiness
    subject: str


class Premise(Form):
    kind: PremiseKind
    name: str
    promise: Annotated[
        FromOne, Meta(description="Which of the things that a contract or summary ensures.")
    ]
    promises: Annotated[FromOne, Meta(description="How many it ensures.")]
    place: Place


class RestsOn(Form):
    claims: Annotated[
        list[str],
        Meta(description="Those that hold in every round, of all kinds but liveness."),
    ]
    needed: Annotated[
        list[Premise],
        Meta(description="Without any one of these some claim could not be proved."),
    ]
    spare: Annotated[list[Premise], Meta(description="Without all of these everything could.")]
    untried: Annotated[list[Premise], Meta(description="What there was no time to leave out.")]


class Branch(Form):
    place: Annotated[Place, Meta(description="That of the `if`.")]
    is_true: Annotated[bool, Meta(description="Whether its condition is, on the worst path.")]


class EventTimes(Form):
    event: str
    steps: Annotated[
        Natural, Meta(description="The most that guard and effect take, if `is_bound`.")
    ]
    is_bound: Annotated[
        bool,
        Meta(description="False if `endless` or `external` has something: counted with one trip."),
    ]
    branches: Annotated[list[Branch], Meta(description="Those of the worst path.")]
    endless: Annotated[
        list[Place], Meta(description="Loops over what may grow, whose trips nobody knows.")
    ]
    external: Annotated[
        list[str], Meta(description="External functions, whose steps nobody knows.")
    ]
    turns: Annotated[Natural, Meta(description="How many turns with this event were measured.")]
    median_us: Annotated[
        float | None, Meta(description="Of CPU on this machine, without external functions.")
    ]
    longest_us: float | None


class AgentTimes(Form):
    agent: Annotated[str, Meta(description="The kind of robot; empty if there is only one.")]
    turn_steps: Annotated[
        Natural,
        Meta(description="The most of a whole turn: all guards, urgent effects and the longest."),
    ]
    is_bound: bool
    events: list[EventTimes]


class Report(Form, kw_only=True):
    program: Annotated[
        str, Meta(description="As named on the command line; <stdin> for standard input.")
    ]
    robots: Annotated[FromOne | None, Meta(description="How many; null for every number of them.")]
    delta_s: Annotated[float, Meta(gt=0, description="The length of a round in seconds.")]
    problem: Problem
    rounds: Annotated[Natural, Meta(description="The bound that was asked for.")]
    outcome: Annotated[
        Outcome,
        Meta(description="The worst of all claims: violated before unknown before holds."),
    ]
    seconds: Seconds
    interrupted: Annotated[
        bool, Meta(description="Whether Ctrl-C ended it; what was known then is told.")
    ]
    claims: list[Claim]
    found_invariants: Annotated[
        list[str],
        Meta(
            description="Invariants that nobody gave and proofs rest on, as Koord; `at round: ` "
            "stands before those of the ends of rounds alone."
        ),
    ]
    vacuous: Annotated[
        bool,
        Meta(description="Whether some vacuity is certain; exit code 4 if all claims hold."),
    ]
    vacuities: list[Vacuity]
    not_looked_at: Annotated[
        list[NotLookedAt],
        Meta(
            description="Events and suppositions of which nobody knows whether they ever come "
            "true: looking for that was given up."
        ),
    ]
    failures: Annotated[
        list[Failure],
        Meta(
            description="Engines that gave no answer because they failed (the others were asked "
            "all the same), and parts of what is told beside the verdicts that could not be told."
        ),
    ]
    left_out: Annotated[
        dict[str, list[str]],
        Meta(description="By claim the variables, ports and events that it cannot depend on."),
    ]
    rests_on: Annotated[
        RestsOn | UnsetType, Meta(description="With --rests-on: what the proofs need.")
    ] = UNSET
    execution_times: Annotated[
        list[AgentTimes] | UnsetType,
        Meta(description="With --wcet: the worst paths of events, and times on this machine."),
    ] = UNSET


class Verdicts(Form):
    """What `koord verify --json` prints: a report for each program and number of robots."""

    version: Version
    reports: list[Report]
