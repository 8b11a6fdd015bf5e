"""The form of parts: structs from which ``koord schema part`` is generated. [RECORDING]

A part is what one robot tells of a run: JSON lines, of which each is one of these objects. Values
are encoded as in traces (:mod:`koord.traces.form`).
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, TypeAlias

from msgspec import UNSET, Meta

from koord.runtime.proposals import StopRequests
from koord.syntax.faults import FaultKind
from koord.syntax.forms import Natural, words
from koord.traces import form

FORMAT: Final = "koord part"

#: Raised with every change that an older reader would misunderstand.
VERSION: Final = 1

#: How what an event asks for is written.
ASKED_NAMES = tuple(asked.name.lower() for asked in StopRequests)

Round: TypeAlias = Annotated[int, Meta(ge=-1, description="-1 for INIT.")]


class Line(form.Form, kw_only=True, tag_field="told"):
    """What all lines have."""

    n: Annotated[Natural, Meta(description="Lines are numbered from 0: none is missing.")]


class Head(Line, kw_only=True, tag="head"):
    """What the part is of: its first line. A robot that was started again says it once more."""

    format: Literal["koord part"]
    version: Literal[1]
    run: Annotated[str, Meta(description="The identity of the run, the same in all parts.")]
    pid: Natural
    program: form.Text
    properties: Annotated[
        list[form.Text], Meta(description="Files of further properties (--with).")
    ]
    params: Annotated[dict[str, form.Param], Meta(description="Values given with --set.")]
    tasks: Annotated[
        list[tuple[form.Rational, form.Rational, form.Rational]] | None,
        Meta(description="Places of the world's tasks, in metres, if the settings list them."),
    ]
    robots: Annotated[
        list[Natural],
        Meta(min_length=1, description="For each robot the position of its agent in the program."),
    ]
    delta: Annotated[form.Rational, Meta(description="The length of a round, in seconds.")]
    slack: Annotated[
        form.Rational,
        Meta(description="By how much floats may be off in assumptions and contracts; 0 if not."),
    ] = UNSET


class Began(Line, kw_only=True, tag="began"):
    """The start of an arbitrary variable."""

    start: form.Start


class Undeclared(Line, kw_only=True, tag="undeclared"):
    """The start of a shared variable is a fault."""


class TurnAnswers(Line, kw_only=True, tag="answered"):
    """An answer of an external function or of `choose` in a round's turn."""

    round: Round
    answer: form.Answer


class Sensed(Line, kw_only=True, tag="sensed"):
    """A sensor's reading at the end of a round."""

    round: Round
    reading: form.Reading


class Stood(Line, kw_only=True, tag="stood"):
    """The state of the robot when a round began, with its copy of the store."""

    round: Natural
    robot: form.Robot


class Fault(form.Form):
    kind: Annotated[str, words(*FaultKind.__members__)]
    place: Annotated[str, Meta(description="File (if it is not the program's), line and column.")]
    detail: str


class Stumbled(Line, kw_only=True, tag="stumbled"):
    """The robot's model of the environment faulted at the end of a round."""

    round: Round
    fault: Fault


class Admitted(form.Form):
    robot: Natural
    event: Annotated[form.Event, Meta(description="null in INIT.")]
    asked: Annotated[str, words(*ASKED_NAMES), Meta(description="To stop, or nothing.")]


class Faulted(form.Form):
    robot: Natural
    event: Annotated[form.Event, Meta(description="null in INIT, or if its model faulted.")]
    fault: Fault


class Acted(Line, kw_only=True, tag="acted"):
    """A decision that the robot acted on."""

    round: Round
    ran: Annotated[list[Admitted], Meta(description="Robots that were let through, in order.")]
    skipped: Annotated[list[Natural], Meta(description="Those that were not, after them.")]
    fault: Annotated[Faulted | None, Meta(description="What ended the run.")]
    digest: Annotated[
        str,
        Meta(
            description="BLAKE2b of the whole decision, with its writes: 16 bytes.",
            extra_json_schema={"pattern": "^[0-9a-f]{32}$"},
        ),
    ]


class Kept(Line, kw_only=True, tag="kept"):
    """The robot was let through in a round: its output."""

    round: Round
    output: list[form.Output]


class Coordinated(Line, kw_only=True, tag="coordinated"):
    """The robot decided a round as coordinator."""

    round: Round
    at_s: Annotated[float, Meta(description="Seconds of its machine's monotonic clock.")]


class Reason(form.Form):
    code: str
    message: str


class GaveUp(Line, kw_only=True, tag="gave up"):
    """The robot's host found no values that the program allows, or (no reason) too large ones."""

    why: list[Reason]


class Left(Line, kw_only=True, tag="left"):
    """The robot stopped in good order before a round: what follows is that of another start."""

    round: Round


class Missed(Line, kw_only=True, tag="missed"):
    """What the robot told before this line could not be written: a disk was full, say."""

    reports: Annotated[int, Meta(ge=1, description="How many reports are missing here.")]


#: A line of a part.
AnyLine: TypeAlias = (
    Head
    | Began
    | Undeclared
    | TurnAnswers
    | Sensed
    | Stood
    | Stumbled
    | Acted
    | Kept
    | Coordinated
    | GaveUp
    | Left
    | Missed
)
