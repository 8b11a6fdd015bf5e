"""The form of stories: runs as people look at them, from which pages and other pictures are made.

A story holds what a trace says, turn by turn and in words: what each robot did, which values
changed, and why the last configuration breaks what is claimed. Values are texts. Rounds count from
1; round 0 is the start.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, TypeAlias

from msgspec import Meta

from koord.syntax.forms import Form, FromOne, Natural, Told

FORMAT: Final = "koord-story"

#: Raised when readers of the JSON have to change.
VERSION: Final = 1

Home: TypeAlias = Annotated[
    Literal["allwrite", "allread", "local", "sensor", "actuator", "status"],
    Meta(description="Allwrite and allread are shared; status is whether a robot has stopped."),
]
Row: TypeAlias = Annotated[int, Meta(ge=0, description="A position among the rows.")]
AtMoment: TypeAlias = Annotated[int, Meta(ge=0, description="A position among the moments.")]


class StoryText(Form):
    """A text that the program was read from."""

    name: str
    text: str


class StoryPlace(Form):
    """A place in one of the texts; lines and columns count from 1, the end is not included."""

    file: str
    line: FromOne
    column: FromOne
    end_line: FromOne
    end_column: FromOne


class StoryRow(Form):
    """A variable, or a part of one that has values of its own."""

    name: Told
    home: Home
    robot: Annotated[Natural | None, Meta(description="Whose it is; null of shared ones.")]
    start: Annotated[str, Meta(description="The value before the first moment's changes.")]
    is_read: Annotated[bool, Meta(description="Whether the claim reads the variable.")]


class StoryEvent(Form):
    """An event of a kind of robot, and where it stands."""

    name: Told
    place: StoryPlace | None


class StoryKind(Form):
    """A kind of robot."""

    name: Annotated[str, Meta(description="Empty where the program has one kind only.")]
    events: list[StoryEvent]


class StoryFault(Form):
    """A fault, whose it is and where."""

    kind: str
    robot: Natural | None
    place: StoryPlace | None
    detail: str


class Position(Form):
    """Where a row of type `pos` is, in metres."""

    row: Row
    x: float
    y: float
    z: float


class NewValue(Form):
    """A row with another value than before."""

    row: Row
    value: str


class Moment(Form):
    """What one turn did: the start, a robot's turn, or the environment's."""

    round: Natural
    rule: str
    robot: Annotated[Natural | None, Meta(description="Null of the start and the environment.")]
    event: Annotated[
        Natural | None, Meta(description="The position of the event in its kind; null of a skip.")
    ]
    blocked: Annotated[
        str | None,
        Meta(
            description="Of a robot that skips: an event that it could run, had no other robot "
            "the lock in this round."
        ),
    ]
    changes: list[NewValue]
    positions: list[Position]
    output: list[str]
    broken: Annotated[list[str], Meta(description="Contracts that the turn breaks.")]
    fault: StoryFault | None


class FormulaNode(Form):
    """A part of a formula with its value, by the reference semantics.

    ``parts`` are those that its value depends on: operands, or the instances of a quantifier.
    """

    text: Told
    value: Annotated[
        str | None, Meta(description="Null where the rules do not look at it, or cannot.")
    ]
    binding: Annotated[
        str, Meta(description="Of an instance of a quantifier: the values of its variables.")
    ]
    decides: Annotated[bool, Meta(description="Whether what it is a part of owes it its value.")]
    note: Annotated[str, Meta(description="Why there is no value: a fault, no answer, no need.")]
    parts: list[FormulaNode]
    left_out: Annotated[Natural, Meta(description="How many parts are not told.")]


class FormulaAt(Form):
    """A formula with its parts' values after a moment."""

    moment: AtMoment
    formula: FormulaNode


class Track(Form):
    """A statement, and whether it holds after each moment: null where nobody asks."""

    name: Told
    text: str
    truth: list[bool | None]
    formulas: Annotated[list[FormulaAt], Meta(description="After the moments that matter.")]


class DifferingValue(Form):
    """A location of which two records differ."""

    robot: Natural | None
    name: str
    expected: str
    found: str


class StoryEnding(Form):
    """How the run ends, and what is wrong there."""

    kind: Literal["done", "violated", "fault", "refused", "loop", "step"]
    headline: Told
    moment: Annotated[AtMoment, Meta(description="The turn that breaks it, or the last one.")]
    detail: str
    rule: Annotated[str, Meta(description="The rule that is broken; empty if none is.")]
    place: StoryPlace | None
    robot: Natural | None
    expected_as: Annotated[str, Meta(description="What `expected` is of differences, in words.")]
    found_as: str
    differences: list[DifferingValue]
    notes: Annotated[list[str], Meta(description="What else is known, as of the compiled program.")]


class StoryWorld(Form):
    """Where robots are and want to be: rows of type `pos`, one for each robot that has one."""

    robots: list[Row | None]
    targets: list[Row | None]


class StoryLoop(Form):
    """The rounds that repeat for ever, and why nothing forbids that they do."""

    first: FromOne
    last: FromOne
    fair: Annotated[list[str], Meta(description="Why the loop is fair.")]
    excluded_by: Annotated[
        list[str], Meta(description="Lines of Koord, each of which would exclude the run.")
    ]
    left_behind: Annotated[
        list[str],
        Meta(description="Places to whose values the loop does not return; nothing hangs on them."),
    ]


class Story(Form):
    """A run as people look at it."""

    format: Literal["koord-story"]
    version: Literal[1]
    title: Told
    program: str
    about: Annotated[str, Meta(description="The program with its robots and settings, in words.")]
    numbers: Literal["exact", "double"]
    delta_s: Annotated[float, Meta(gt=0)]
    texts: list[StoryText]
    kinds: list[StoryKind]
    robots: Annotated[list[Natural], Meta(description="The kind of each robot, by position.")]
    rows: list[StoryRow]
    moments: Annotated[list[Moment], Meta(min_length=1)]
    left_out: Annotated[Natural, Meta(description="How many rounds before these are not told.")]
    tracks: list[Track]
    loop: StoryLoop | None
    world: StoryWorld | None
    ending: StoryEnding
