"""Forms of the JSON about runs in worlds and on robots, and about compiled programs."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from msgspec import UNSET, Meta, UnsetType

from koord.api.forms import Merged, Problem, Round, Version
from koord.syntax.forms import Form, FromOne, Natural, Told, words

Point: TypeAlias = Annotated[
    tuple[float, float, float], Meta(description="x, y and z in metres, in the world's frame.")
]
Metres: TypeAlias = Annotated[float, Meta(ge=0)]
Seconds: TypeAlias = Annotated[float, Meta(ge=0)]

#: Why a run ended; `limit`: the time was up.
Ending: TypeAlias = Annotated[
    str,
    words("stopped", "still", "limit", "violated", "fault", "interrupted", "silent", "played"),
]


# --- koord sim ------------------------------------------------------------------------------------


class SimulatedRobot(Form):
    """The figures of a robot."""

    distance_m: Annotated[float, Meta(ge=0, description="How far it went.")]
    waited_s: Annotated[
        float, Meta(ge=0, description="How long it had no goal, and had not stopped.")
    ]
    events: Natural
    skips: Natural
    blocked: Annotated[
        Natural, Meta(description="Rounds in which another robot was in its lock class.")
    ]
    tasks: Annotated[Natural, Meta(description="How many it visited.")]


class SimulatedTask(Form):
    """A task of the program's shared list."""

    robot: Annotated[Natural | None, Meta(description="Its owner; null: nobody yet.")]
    visited_s: Annotated[float | None, Meta(description="When the owner was there; null: not yet.")]


class Nearest(Form):
    """The least separation of the run."""

    distance_m: Metres
    robots: tuple[Natural, Natural]
    time_s: Seconds


class WorldBounds(Form):
    """From where to where the world reaches."""

    low: Point
    high: Point
    given: Annotated[bool, Meta(description="Whether the configuration says so.")]


class BrokenInWorld(Form):
    """A claim that does not hold."""

    claim: Annotated[str, Meta(description="Its kind and its name, or `separation`.")]
    time_s: Seconds
    robots: list[Natural]
    place: Point | None
    words: str
    sort: Annotated[str, Meta(description="Which kind of claim it is; empty for a separation.")]


class Standing(Form):
    """A robot that stands still at the end, and is to go somewhere."""

    robot: Natural
    since_s: Seconds
    why: Annotated[str, Meta(description="A word for the reason: `no_way`.")]
    words: Told


class SimulatedFault(Form):
    """The fault that ended the run."""

    kind: str
    place: Annotated[str, Meta(description="`file:line:column`.")]
    detail: str
    robot: Annotated[Natural | None, Meta(description="Null: of a shared variable's start.")]


class SimulatedRun(Form):
    """The answer of `koord sim --json`. Times are simulated, but for `wall_s`."""

    format: Literal["koord-simulated"]
    version: Version
    program: Annotated[str, Meta(description="The name of the program's file.")]
    problem: Problem
    seed: Natural
    ending: Ending
    rounds: Natural
    time_s: Seconds
    robots: list[SimulatedRobot]
    tasks: list[SimulatedTask]
    nearest: Nearest | None
    messages: Annotated[
        Natural, Meta(description="How many messages the protocol would have sent.")
    ]
    digest: Annotated[str, Meta(description="Of the whole run: equal runs have equal ones.")]
    devices: Annotated[list[str], Meta(description="What each robot is on.")]
    safety_m: Annotated[float, Meta(ge=0, description="Nearer robots are too near; 0: none are.")]
    bounds: WorldBounds
    wall_s: Seconds
    claims: Annotated[dict[str, Natural], Meta(description="How often each claim was looked at.")]
    by_chance: Annotated[
        list[str], Meta(description="Functions and sensors that no world answers: chance does.")
    ]
    broken: list[BrokenInWorld]
    standing: list[Standing]
    fault: SimulatedFault | None
    late: Annotated[
        Natural | UnsetType,
        Meta(description="With several processes: proposals that came too late."),
    ] = UNSET


# --- koord deploy ---------------------------------------------------------------------------------


class TextPlace(Form):
    """A half-open range of characters in a file, counted from 1."""

    file: str
    line: Natural
    column: Natural
    end_line: Natural
    end_column: Natural


class RobotBreach(Form):
    """A claim that did not hold, as a robot saw it."""

    claim: Annotated[str, Meta(description="Its kind and its name.")]
    span: TextPlace
    robots: list[Natural]
    round: Round
    times: FromOne
    detail: str


class RobotCheck(Form):
    """Something that a robot looked at before it was armed."""

    name: str
    finding: Annotated[str, words("good", "doubtful", "bad", "pending")]
    text: str
    cure: str


class RobotProcessEnd(Form):
    """How a process last ended before its time."""

    pid: Natural
    cause: Annotated[str, words("done", "stopped", "killed", "crashed", "deaf", "away")]
    round: Annotated[Round | None, Meta(description="In which it was last heard; null: never.")]
    signal: int | None
    detail: str | None


class RobotProcess(Form):
    """What became of a robot's process."""

    state: Annotated[str, words("running", "over", "lost", "given up")]
    restarts: Natural
    end: RobotProcessEnd | None
    story: Annotated[str, Meta(description="In words; empty if it did not end before its time.")]


class DeployedRobot(Form):
    """The last status of a robot. Rounds count from 0; -1 is the start."""

    pid: Natural
    round: Round
    behind: Annotated[
        Natural, Meta(description="Rounds that it knows to be decided and has not acted on.")
    ]
    coordinator: Natural | None
    epoch: Natural
    holding: Annotated[
        str | None, Meta(description="Why it holds its position; null: it does not.")
    ]
    waiting_for: list[Natural]
    ran: Annotated[Natural, Meta(description="Rounds in which it was let through.")]
    skipped: Natural
    late: Annotated[Natural, Meta(description="Rounds that its proposal came too late for.")]
    overdue: Annotated[Natural, Meta(description="Rounds that began more than half a δ late.")]
    longest_s: Seconds
    took_s: Annotated[float, Meta(ge=0, description="From the first commit to the last.")]
    sent: Annotated[Natural, Meta(description="Datagrams.")]
    received: Natural
    drops: Annotated[
        dict[str, Natural], Meta(description="Datagrams that it dropped, by the reason.")
    ]
    is_over: bool
    all_stopped: bool
    is_mute: bool
    is_voter: bool
    fault: str | None
    trouble: str | None
    notes: list[str]
    breaches: list[RobotBreach]
    unwatched: list[str]
    run: str
    checks: list[RobotCheck]
    start: Natural
    written: Annotated[Natural, Meta(description="Bytes of its journal.")]
    sent_bytes: Natural
    arrived: Natural
    arrived_bytes: Natural
    process: RobotProcess | UnsetType = UNSET


class DeployedBreach(Form):
    """A claim that did not hold while the robots ran."""

    claim: str
    place: Annotated[str, Meta(description="`file:line:column`.")]
    text: str
    robots: list[Natural]
    round: Round
    times: FromOne
    detail: str
    rested: Annotated[list[str], Meta(description="Claims whose proofs need it, as was said.")]


class DeployedRun(Form):
    """The answer of `koord deploy --json`."""

    format: Literal["koord-deployed"]
    version: Version
    program: Annotated[str, Meta(description="The name of the program's file.")]
    problem: Problem
    robots: Annotated[list[DeployedRobot], Meta(description="By pid; those that were heard.")]
    stuck: Annotated[str | None, Meta(description="Why no round could be decided any more.")]
    broken: list[DeployedBreach]
    unwatched: Annotated[
        list[str], Meta(description="Claims of which nobody knew enough to look at them.")
    ]
    trace: Annotated[Merged | None, Meta(description="What `koord merge --json` says of it.")]


# --- koord check-refinement -----------------------------------------------------------------------


class TargetTotals(Form, rename="camel"):
    """The totals of runs on a target."""

    target: Annotated[str, words("engine", "kernels", "network", "udp")]
    runs: Natural
    rounds: Natural
    steps: Natural
    skips: Natural
    faults: Natural
    gave_up: Annotated[
        Natural, Meta(description="Runs for which no values were found that the program allows.")
    ]
    turns_by_code: Annotated[Natural, Meta(description="Turns that machine code made.")]
    turns_by_robots: Natural


class RefusedCase(Form):
    """The first run that the rules refuse, made as small as could be found."""

    program: str
    target: Annotated[str, words("engine", "kernels", "network", "udp")]
    seed: Natural
    robots: FromOne
    problem: Problem
    rounds: Natural
    policy: str
    rule: Annotated[str | None, Meta(description="Null: the compiled program fell over.")]
    reason: Told
    saved: Annotated[str | None, Meta(description="The file that it is kept in.")]
    again: Annotated[str, Meta(description="The command that runs it again.")]


class RefinementRuns(Form, tag_field="format", tag="koord-refinement"):
    """Runs of compiled programs, judged by the rules."""

    version: Version
    targets: list[TargetTotals]
    failure: RefusedCase | None
    programs: list[str]


class Explored(Form):
    """A state space that was explored."""

    what: str
    states: Natural
    transitions: Natural
    depth: Natural | UnsetType = UNSET
    complete: bool | UnsetType = UNSET


class ProtocolRuns(Form, tag_field="format", tag="koord-protocol-check"):
    """The answer with `--target protocol`: exploration, and runs on bad networks."""

    version: Version
    explored: list[Explored]
    runs: Natural
    rounds: Natural
    crashes: Natural
    broken: Annotated[
        list[str], Meta(description="Invariants of specs/protocol that did not hold.")
    ]


class ProofStep(Form):
    """A step of the proof of the protocol."""

    action: str
    rule: str
    statement: str
    answer: str
    seconds: Seconds
    counterexample: list[str]


class ProtocolProved(Form, tag_field="format", tag="koord-protocol-proof"):
    """The answer with `--target protocol --prove`, for every number of robots."""

    version: Version
    proved: bool
    invariants: list[str]
    explored: list[Explored]
    strays: Annotated[list[str], Meta(description="Where the machine leaves the model.")]
    steps: list[ProofStep]


class GuardianStep(Form):
    """A step of the proof of the guardian."""

    event: str
    rule: str
    invariant: str
    answer: str
    counterexample: list[str]


class GuardianProved(Form, tag_field="format", tag="koord-guardian-check"):
    """The answer with `--target guardian`."""

    version: Version
    proved: bool
    invariants: list[str]
    explored: list[Explored]
    broken: list[str]
    steps: list[GuardianStep]


class JudgedSimulations(Form):
    """The answer with `--target simulator`, for one program."""

    program: str
    values: Annotated[str, Meta(description="δ, and each value that is not the text's.")]
    runs: Natural
    rounds: Natural
    steps: Natural
    refused: Annotated[str | None, Meta(description="The first step that no rule allows.")]
    saved: str | None


#: The answers of `koord check-refinement --json`, by what was checked.
RefinementAnswer: TypeAlias = (
    RefinementRuns | ProtocolRuns | ProtocolProved | GuardianProved | list[JudgedSimulations]
)


# --- several runs ---------------------------------------------------------------------------------


class CampaignRun(Form):
    """A run of a campaign, as a line of its CSV file."""

    swept: Annotated[str, Meta(description="The value that was swept; empty if none was.")]
    robots: FromOne
    values: Annotated[str, Meta(description="δ, and each value that is not the text's.")]
    seed: Natural
    ending: Ending
    time_s: Seconds
    tasks: Natural
    tasks_done: Natural
    tasks_s: Annotated[
        float | None, Meta(description="When the last task was visited; null: not all were.")
    ]
    distance_m: Annotated[float, Meta(ge=0, description="How far all robots went together.")]
    separation_m: Annotated[
        float | None, Meta(description="The least between two robots; null if there is one robot.")
    ]
    safety_m: Annotated[float, Meta(ge=0, description="Nearer than this is not safe; 0: not said.")]
    waited_s: Annotated[
        float, Meta(ge=0, description="How long robots had no goal, and had not stopped.")
    ]
    events: Natural
    skips: Natural
    blocked: Annotated[
        Natural, Meta(description="Turns in which another robot was in the lock class.")
    ]
    messages: Natural
    packets_sent: Annotated[
        Natural, Meta(description="Datagrams of all robots, one to all counted once.")
    ]
    packets_received: Natural
    bytes_sent: Annotated[Natural, Meta(description="Without the headers of the network.")]
    bytes_received: Natural
    broken: Annotated[Natural, Meta(description="So many claims were broken.")]
    stuck: Annotated[
        Natural, Meta(description="So many robots stand still at the end and should go.")
    ]
    digest: Annotated[str, Meta(description="Of its trace; runs with one digest are alike.")]
    wall_s: Seconds
    cpu_s: Annotated[float, Meta(ge=0, description="Of the thread that made it.")]
    memory_mib: Annotated[
        float, Meta(ge=0, description="The most that its process has had until then.")
    ]
    threads: Annotated[Natural, Meta(description="Of its process at the end.")]


class CampaignUntil(Form):
    """The wish for an interval that reaches no further than so much to each side."""

    metric: Literal["time", "distance", "waited", "broken"]
    reach: float


class CampaignInterval(Form):
    """A mean, or a rate, and its interval of 95 % at least."""

    mean: float
    low: float | None
    high: float | None


class CampaignRuns(Form):
    """The answer of `koord sim --runs K --json`, and of `--sweep` and `--until`."""

    format: Literal["koord-campaign"]
    version: Version
    runs: list[CampaignRun]
    until: CampaignUntil | UnsetType = UNSET
    intervals: Annotated[
        dict[str, CampaignInterval] | UnsetType,
        Meta(description="Of what `until` names, by the value that was swept, or robots."),
    ] = UNSET
