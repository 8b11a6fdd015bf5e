"""Forms of the JSON that commands print: structs from which ``koord schema`` is generated."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from msgspec import UNSET, Meta, UnsetType

from koord.syntax.forms import Digest, Exact, Form, FromOne, Natural, Tasks, Told, Value, words
from koord.syntax.forms import NotCovered as NotCovered

#: Rounds count from 0, as in traces; -1 is the start.
Round: TypeAlias = Annotated[int, Meta(ge=-1)]
Version: TypeAlias = Annotated[
    Literal[1], Meta(description="Changes when readers of this object have to change.")
]


# --- what something is said about -----------------------------------------------------------------


class InText(Form):
    """The settings that the text states; null where it states none."""

    robots: FromOne | None
    kinds: list[str] | None
    delta: Exact | None


class Parameter(Form):
    value: Value
    in_text: Annotated[Value | None, Meta(description="Null if the text gives none.")]


class Problem(Form):
    """The program with these robots and values, which the answer is about."""

    robots: Annotated[FromOne | None, Meta(description="How many; null for every number of them.")]
    kinds: Annotated[
        list[str] | None,
        Meta(
            description="Of which kind each robot is; null if there is one kind, or every number "
            "of robots."
        ),
    ]
    delta: Annotated[Exact, Meta(description="The length of a round in seconds, exactly.")]
    in_text: InText
    params: Annotated[
        dict[str, Parameter],
        Meta(description="All params by name: the value, and the one that the text gives."),
    ]
    tasks: Annotated[
        Tasks | None,
        Meta(description="Where the world's tasks are that a variable starts with; null: nowhere."),
    ]
    properties: Annotated[
        list[str], Meta(description="Files of properties that were read with the program.")
    ]


# --- koord replay ---------------------------------------------------------------------------------


class Difference(Form):
    robot: Natural | None
    location: str
    expected: str
    recorded: str


class Refusal(Form):
    """The first step that no rule allows."""

    rule: Annotated[str, Meta(description="As in specs/semantics.")]
    round: Round
    robot: Annotated[Natural | None, Meta(description="Null for the start and the environment.")]
    event: Annotated[str | None, Meta(description="Null for a skip.")]
    reason: Told
    differences: list[Difference]


class CompiledDifference(Form):
    robot: Natural | None
    location: str
    recorded: str
    compiled: str


class Departure(Form):
    """The first difference of the compiled program from the run."""

    round: Round
    reason: Told
    differences: list[CompiledDifference]


class Compiled(Form):
    """The run of the compiled program on the same schedule and inputs."""

    agrees: bool
    departs: Departure | None
    unjudged: Annotated[
        Told | None,
        Meta(description="Why nobody knows whether it breaks the claim on doubles, too."),
    ]


class Broken(Form):
    """The first claim that a run of robots breaks, on its way."""

    kind: Annotated[str, words("property", "contract")]
    name: str
    round: Round
    robot: Annotated[Natural | None, Meta(description="Whose turn broke it; null: no robot's.")]


class Replay(Form):
    """The answer of `koord replay --json`. Rounds count from 0, as in traces; -1 is the start."""

    version: Version
    program: Annotated[str, Meta(description="The name of the program's file.")]
    problem: Problem
    legal: bool
    steps: Annotated[Natural, Meta(description="How many were legal.")]
    rounds: Annotated[Natural, Meta(description="How many were legal as a whole.")]
    refused: Refusal | None
    slack: Annotated[
        float,
        Meta(ge=0, description="By how much floats could be off in assumptions and contracts."),
    ]
    trusted: Annotated[
        list[str],
        Meta(description="What speaks of all values of a type, and was not tried."),
    ]
    cut_off: Annotated[
        bool,
        Meta(
            description="Whether the file ends in the middle: nothing is known of the run after "
            "its rounds."
        ),
    ]
    compiled: Annotated[Compiled | None, Meta(description="With --compiled, of a legal trace.")]
    broken: Annotated[
        Broken | UnsetType | None,
        Meta(description="Only of a legal run of robots: on doubles, and without slack."),
    ] = UNSET
    unjudged: Annotated[
        list[str] | UnsetType,
        Meta(description="Properties of such a run that ask what nobody answered."),
    ] = UNSET
    reloads: Annotated[
        list[Natural] | UnsetType,
        Meta(description="The rounds before which the program of the run was changed."),
    ] = UNSET


# --- koord merge ----------------------------------------------------------------------------------


class MergedPart(Form):
    """The part of a robot."""

    pid: Natural
    name: Annotated[str, Meta(description="The file's; of a recording with the topic.")]
    rounds: Annotated[Natural, Meta(description="How many the robot acted on.")]
    end: Annotated[
        str,
        words("left", "silent", "torn"),
        Meta(description="The robot said that it stops, or did not, or in the middle of a line."),
    ]
    missed: Annotated[
        Natural, Meta(description="How many reports are missing, as they could not be written.")
    ]


class MergedRefusal(Form):
    """The first step that no rule allows."""

    rule: Annotated[str, Meta(description="As in specs/semantics.")]
    round: Round
    reason: Told


class Presumption(Form):
    """An assumption or a contract that is not judged by answers that nobody gave."""

    kind: Annotated[str, words("assumption", "contract")]
    name: Annotated[str, Meta(description="Of a contract with its module: `Motion.OnRoute`.")]


class Merged(Form):
    """The answer of `koord merge --json`. Rounds count from 0, as in traces; -1 is the start."""

    format: Literal["koord-merged"]
    version: Version
    program: Annotated[str, Meta(description="The name of the program's file.")]
    problem: Problem
    rounds: Annotated[Natural, Meta(description="How many are in the trace.")]
    rounds_told: Annotated[
        Natural,
        Meta(description="How many the run had at least; more, where no part tells of a round."),
    ]
    parts: Annotated[list[MergedPart], Meta(min_length=1, description="By pid.")]
    missing: Annotated[list[Natural], Meta(description="Robots of which there is no part.")]
    refused: MergedRefusal | None
    broken: Annotated[Broken | None, Meta(description="Only of a legal run.")]
    unjudged: Annotated[list[str], Meta(description="Properties that ask what nobody answered.")]
    presumed: Annotated[
        list[Presumption],
        Meta(description="Statements that ask what nobody answered: they may hold, or not."),
    ]


# --- koord recheck --------------------------------------------------------------------------------


class Place(Form):
    """The beginning of a place in a text; null for none."""

    file: str
    line: Natural
    column: Natural


Met: TypeAlias = Annotated[
    str, words("met", "not met", "unknown"), Meta(description="Whether the obligation is met.")
]


class RecheckedClaim(Form):
    kind: Annotated[str, words("property", "fault", "lost update", "contract", "liveness")]
    subject: Annotated[
        str, Meta(description="The variable of a lost update, or the contract; else empty.")
    ]
    name: Annotated[str, Meta(description="As in the text, or as follows from kind and subject.")]
    statement: Annotated[
        str, Meta(description="Koord, or what is asked of every program in words.")
    ]
    place: Place | None
    shown_for: Annotated[
        Literal["every number of robots", "these robots"] | None,
        Meta(description="Null if it was not shown."),
    ]


class Premise(Form):
    kind: Annotated[str, words("assumption", "contract", "summary", "fairness")]
    name: str
    statement: Annotated[
        str, Meta(description="Koord, or words of fairness; empty if it is the library's.")
    ]
    place: Place | None


class Obligation(Form):
    name: str
    every_number: Annotated[bool, Meta(description="Whether it is about every number of robots.")]
    answer: Met
    claim: Annotated[
        str,
        Meta(description="The claim that does not follow, or is not known to; empty if all do."),
    ]
    configuration: Annotated[
        list[str],
        Meta(
            description="Of an obligation that is not met: one in which the invariant holds, and "
            "from which it fails."
        ),
    ]


class Script(Form):
    name: str
    answer: Met
    reason: Annotated[str, Meta(description="Why the answer is unknown.")]


class Recheck(Form):
    """The answer of `koord recheck --json`. For the verdicts see specs/certificates/README.md."""

    version: Annotated[
        Literal[3], Meta(description="Changes when readers of this object have to change.")
    ]
    verdict: Annotated[str, words("confirmed", "refuted", "unknown")]
    reason: Annotated[str, Meta(description="Why it is not confirmed; empty if it is.")]
    place: Annotated[Place | None, Meta(description="The construct that is not rechecked.")]
    solver: Annotated[str, Meta(description="Which solver was asked, with its version.")]
    program: Annotated[str, Meta(description="The name of the program in the certificate.")]
    sha256: Digest
    problem: Problem
    vacuous: Annotated[
        list[str],
        Meta(description="Why less is shown than it seems; exit code 4 if it is confirmed."),
    ]
    claims: Annotated[
        list[RecheckedClaim],
        Meta(description="What is claimed, of every round or of whole runs, in full."),
    ]
    relies_on: Annotated[list[Premise], Meta(description="What is used and not shown.")]
    not_covered: Annotated[
        list[NotCovered],
        Meta(description="Claims that hold as the certificate says, and that it is no proof of."),
    ]
    obligations: Annotated[
        list[Obligation],
        Meta(description="Those that were made anew; up to the first that is not met."),
    ]
    scripts: Annotated[
        list[Script],
        Meta(description="What came with the certificate; met is one that is unsatisfiable."),
    ]
    seconds: Annotated[float, Meta(ge=0)]


# --- koord sim --splitting ------------------------------------------------------------------------


class SplittingRepetition(Form):
    """One repetition of splitting, which hangs on no other."""

    rate: Annotated[float, Meta(ge=0, le=1, description="The rate that it found, without bias.")]
    broken_at_first: Annotated[
        Natural, Meta(description="Of its particles, so many broke the claim before any branched.")
    ]
    runs: Annotated[Natural, Meta(description="How many it made, also in part.")]
    steps: Annotated[Natural, Meta(description="How often the lowest particles were replaced.")]


class Splitting(Form):
    """The answer of `koord sim --splitting CLAIM --json`."""

    version: Version
    program: Annotated[str, Meta(description="The name of the program's file.")]
    claim: str
    particles: FromOne
    seed: Natural
    interrupted: bool
    rate: Annotated[
        float | None,
        Meta(description="The share of runs that break the claim; null if it was interrupted."),
    ]
    low: Annotated[float | None, Meta(description="Where its interval of 95 % begins.")]
    high: Annotated[float | None, Meta(description="Where it ends.")]
    found: Annotated[Natural, Meta(description="So many repetitions found violations.")]
    runs: Annotated[Natural, Meta(description="So many runs were made, also in part.")]
    highest: Annotated[
        float | None,
        Meta(description="The highest level of the runs that broke nothing; null if none has one."),
    ]
    repetitions: list[SplittingRepetition]


# --- diagnostics ----------------------------------------------------------------------------------


class Span(Form):
    """A half-open range of characters, counted from 1; null means the file as a whole."""

    line: FromOne
    column: FromOne
    end_line: FromOne
    end_column: FromOne


class Note(Form):
    message: str
    file: str
    span: Span | None


class Edit(Form):
    """A replacement of the characters of a span by a text."""

    span: Span
    text: str


class Diagnostic(Form):
    code: Annotated[
        str,
        Meta(
            extra_json_schema={"pattern": "^K[0-9]{3}$"},
            description="Stable; `koord explain CODE` tells its story.",
        ),
    ]
    severity: Literal["error", "warning"]
    message: Told
    hint: Annotated[str | None, Meta(description="The cure, where one is known.")]
    file: Annotated[
        str, Meta(description="As named on the command line; <stdin> for standard input.")
    ]
    span: Span | None
    notes: list[Note]
    edits: Annotated[
        list[Edit],
        Meta(description="The cure as data, in `file`: made all together; none overlaps another."),
    ]


class Diagnostics(Form):
    """The answer of `koord check --json`, and of other commands with --json for wrong input."""

    version: Version
    errors: Annotated[Natural, Meta(description="How many diagnostics are errors.")]
    warnings: Annotated[Natural, Meta(description="How many are warnings.")]
    diagnostics: list[Diagnostic]


class MigratedFile(Form):
    """A program in today's forms."""

    file: Annotated[
        str, Meta(description="As named on the command line; <stdin> for standard input.")
    ]
    changed: Annotated[bool, Meta(description="Whether the text is another one than before.")]
    text: Annotated[str, Meta(description="The whole text in today's forms.")]
    steps: Annotated[
        list[Diagnostic],
        Meta(description="What was done, with places in the text as it was at that step."),
    ]
    left: Annotated[
        list[Diagnostic],
        Meta(description="What is told of `text`: errors are what only a person can mend."),
    ]


class Migrated(Form):
    """The answer of `koord migrate --json`."""

    version: Version
    files: list[MigratedFile]


# --- drivers --------------------------------------------------------------------------------------


class Measured(Form):
    """Something that a check saw."""

    seen: str
    limit: Annotated[str, Meta(description="What it had to be; empty if there is nothing to say.")]
    ok: bool


class Checked(Form):
    """What a check of a driver found."""

    check: Annotated[str, Meta(description="Its name, as for --only.")]
    verdict: Literal["passed", "failed", "skipped"]
    measures: list[Measured]
    why: Annotated[str, Meta(description="Why it was skipped; else empty.")]
    cure: Annotated[str, Meta(description="What would let it be made; else empty.")]
    took_s: Annotated[float, Meta(ge=0)]


class Conformed(Form):
    """The answer of `koord conform --json`."""

    format: Literal["koord-conformance"]
    version: Version
    driver: str
    vehicle: Annotated[str, Meta(description="Its type, as configurations name it.")]
    peer: Annotated[
        str | None,
        Meta(description="The other side of its wire, as --peer named it; null: none."),
    ]
    ok: Annotated[
        bool,
        Meta(description="Whether no check failed, some passed, and nobody cut them short."),
    ]
    interrupted: bool
    checks: Annotated[list[Checked], Meta(description="In the order of the suite.")]


# --- koord doctor ---------------------------------------------------------------------------------


class Package(Form):
    """A package of Python."""

    name: str
    installed: Annotated[str | None, Meta(description="Its version; null: it is not installed.")]
    trouble: Annotated[str | None, Meta(description="Why it cannot be loaded; null: it can.")]


class ExtraState(Form):
    """An extra of koord: `pip install 'koord[NAME]'` brings its packages."""

    name: str
    gives: str
    installed: Annotated[bool, Meta(description="Whether all of its packages are.")]
    packages: list[Package]


class ToolState(Form):
    """A program of others."""

    name: str
    path: Annotated[str | None, Meta(description="Null: it is not installed.")]
    gives: str
    package: Annotated[str, Meta(description="Debian's package that has it.")]


class PlugIn(Form):
    """A driver or localiser."""

    name: str
    package: Annotated[str, Meta(description="Which has it, with its version.")]
    missing: Annotated[str | None, Meta(description="Why it cannot be used; null: it can.")]


class CacheState(Form):
    """The folder of kept verdicts."""

    folder: str
    entries: Natural
    size_bytes: Natural
    is_writable: bool


class Doctor(Form):
    """The answer of `koord doctor --json`."""

    format: Literal["koord-doctor"]
    version: Version
    koord: Annotated[str, Meta(description="The version of koord.")]
    python: Annotated[str, Meta(description="The version of Python, and which Python it is.")]
    executable: str
    system: Annotated[str, Meta(description="The operating system and the processor.")]
    cores: Annotated[FromOne, Meta(description="How many this process may use.")]
    ok: Annotated[bool, Meta(description="Whether there are no problems.")]
    problems: Annotated[list[str], Meta(description="What has to be mended, each with its cure.")]
    needed: Annotated[list[Package], Meta(description="What koord cannot do without.")]
    extras: list[ExtraState]
    tools: list[ToolState]
    drivers: list[PlugIn]
    localisers: list[PlugIn]
    cache: CacheState
