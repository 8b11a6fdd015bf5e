"""The form of trace files: structs from which ``koord schema trace`` is generated. [TRACE]

Values of the program are JSON by their types, see :mod:`koord.traces.value_codec`.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, TypeAlias

from msgspec import UNSET, Meta, Struct, UnsetType

from koord.semantics.configurations import Turn
from koord.semantics.oracle import Phase
from koord.syntax.faults import FaultKind
from koord.syntax.forms import Natural, defined, words
from koord.syntax.system import Status
from koord.traces.trace import Numbers, ViolationKind

FORMAT: Final = "koord trace"

#: Raised with every change that an older reader would misunderstand.
VERSION: Final = 4

#: What has nothing new in it is written as older readers know it: 2 is a run that repeats itself,
#: 3 one with slack, 4 one whose program was changed.
PLAIN: Final = 1
LOOP: Final = 2
SLACK: Final = 3

#: How the status of a robot is written.
STATUS_NAMES = tuple(status.name.lower() for status in sorted(Status))


# What hangs on types of the program, or on how long a number is, is read by the codec of values.
Rational: TypeAlias = Annotated[Any, defined("Rational")]
Param: TypeAlias = Annotated[Any, defined("Param")]
Value: TypeAlias = Annotated[Any, defined("Value")]
Storage: TypeAlias = Annotated[Any, defined("Storage")]
Variables: TypeAlias = Annotated[
    dict[str, Storage],
    Meta(description="By name; ports as Module.port."),
]
Event: TypeAlias = Annotated[
    str | None, Meta(description="The name of an event of the robot's agent; null for a skip.")
]
Version: TypeAlias = Literal[1, 2, 3, 4]
Home: TypeAlias = Literal["local", "port", "allread", "allwrite"]

_ANY = ["boolean", "number", "string", "array", "object"]

#: The schemas of what is read by the codec of values, by the names that forms refer to.
VALUES: dict[str, Any] = {
    "Rational": {
        "type": "string",
        "pattern": "^-?(0x[0-9a-f]+|[0-9]+)(/(0x[0-9a-f]+|[0-9]+))?$",
        "description": "An exact number: 3/4, -2; in hexadecimal from 2^53 on.",
    },
    "Param": {
        "anyOf": [
            {"type": ["boolean", "string"]},
            {"type": "array", "items": {"$ref": "#/$defs/Param"}},
            *(
                {
                    "type": "object",
                    "properties": {kind: {"$ref": "#/$defs/Rational"}},
                    "required": [kind],
                    "additionalProperties": False,
                }
                for kind in ("int", "float")
            ),
        ]
    },
    "Value": {
        "description": "int: an integer, or a hexadecimal string from 2^53 on. float: a rational "
        "string (exact), a number or inf, -inf, nan (double). bool: true, false. string: a string. "
        "Enumeration: the member's name. Record: an object of its fields. Array, list, queue: an "
        "array. Map: an array of [key, value], in order of insertion.",
        "type": _ANY,
    },
    "Storage": {
        "description": "What a variable holds: a value, in which an atom without one is "
        '{"#unset": null}.',
        "type": _ANY,
    },
}


class Form(Struct, forbid_unknown_fields=True, omit_defaults=True):
    """A part of a trace file: a JSON object that allows no further fields."""


class Text(Form):
    name: str
    sha256: Annotated[
        str,
        Meta(description="Of the text in UTF-8.", extra_json_schema={"pattern": "^[0-9a-f]{64}$"}),
    ]
    text: str


class Store(Form):
    allread: Variables
    allwrite: Variables


class Robot(Form):
    status: Annotated[str, words(*STATUS_NAMES)]
    ran: Event
    turn: Turn
    locals: Variables
    ports: Variables
    copy: Annotated[
        Store | UnsetType, Meta(description="The robot's copy of the store, where it is another.")
    ] = UNSET


class Fault(Form):
    kind: Annotated[str, words(*FaultKind.__members__)]
    robot: Natural | None
    place: Annotated[
        tuple[str, Natural, Natural, Natural, Natural],
        Meta(description="File, line, column, end line, end column."),
    ]
    detail: str


class Configuration(Form, kw_only=True):
    round: Annotated[Natural, Meta(description="Rounds completed.")]
    turn: Turn = Turn.PROG
    taken: Annotated[list[Natural], Meta(description="Lock classes taken in this round.")] = []
    fault: Fault | UnsetType = UNSET
    store: Store
    robots: list[Robot]


class Start(Form):
    """The start of an arbitrary variable; of an allread variable, the robot's own entry."""

    home: Home
    variable: str
    robot: Natural | None
    value: Value


class Reading(Form):
    robot: Natural
    port: str
    value: Value


class Answer(Form):
    phase: Phase
    robot: Natural
    key: Annotated[
        list[int],
        Meta(min_length=1, description="The number of the site, then the trail (RECORDING)."),
    ]
    function: Annotated[str | None, Meta(description="null for choose.")]
    arguments: list[Value]
    value: Value


class Output(Form):
    robot: Annotated[Natural | None, Meta(description="null in INIT.")]
    stream: str
    types: list[str]
    values: list[Value]


class Violation(Form):
    kind: ViolationKind
    name: str
    round: Annotated[int, Meta(ge=-1, description="-1 for INIT.")]
    robot: Natural | None


class Opening(Form):
    order: list[Natural]
    starts: list[Start]
    answers: list[Answer]
    output: list[Output]


class Round(Form):
    order: Annotated[list[Natural], Meta(description="The order of the program turns.")]
    events: Annotated[list[Event], Meta(description="What each robot ran, by robot.")]
    readings: Annotated[
        list[Reading],
        Meta(description="Sensors without a model, after the environment's turn."),
    ]
    answers: list[Answer]
    cut: Annotated[
        bool, Meta(description="The run ends in this round, before the environment's turn.")
    ]
    output: list[Output]
    after: Annotated[Configuration, Meta(description="Where the round ended.")]


class Run(Form, kw_only=True):
    opening: Opening
    initial: Configuration
    rounds: list[Round]
    loop: Annotated[
        Natural | UnsetType,
        Meta(
            description="Rounds from this one on, counted from 0, repeat for ever (rule LASSO). "
            "Not there: the run ends."
        ),
    ] = UNSET
    violation: Violation | None


class Later(Form, kw_only=True):
    """A part of a run with another program, which goes on from where the one before ended (rule
    RELOAD). Its opening has no order, its initial configuration is the one in which the program
    goes on, and its rounds count from there.
    """

    program: Text
    properties: list[Text]
    params: dict[str, Param]
    tasks: list[tuple[Rational, Rational, Rational]] | None
    run: Run


class File(Form, kw_only=True):
    """A run of a Koord program: texts, settings, schedule, answers, configurations, output (rules
    TRACE, RECORDING, REPLAY). Values are encoded by their types in the program: see $defs/Value.
    """

    format: Literal["koord trace"]
    version: Annotated[
        Version,
        Meta(
            description="4 if the program was changed, else 3 if claims have slack, else 2 if the "
            "run repeats itself, else 1."
        ),
    ]
    program: Text
    properties: Annotated[list[Text], Meta(description="Files of further properties (--with).")]
    params: Annotated[dict[str, Param], Meta(description="Values given with --set.")]
    tasks: Annotated[
        list[tuple[Rational, Rational, Rational]] | None,
        Meta(description="Places of the world's tasks, in metres, if the settings list them."),
    ]
    robots: Annotated[
        list[Natural],
        Meta(
            min_length=1,
            description="For each robot the position of its agent in the program.",
        ),
    ]
    delta: Annotated[Rational, Meta(description="The length of a round, in seconds.")]
    numbers: Annotated[
        Numbers,
        Meta(description="What a float is in this trace: a rational, or an IEEE double."),
    ]
    slack: Annotated[
        Rational,
        Meta(
            description="By how much floats may be off in assumptions and contracts: vehicles made "
            "the run. None if it is missing."
        ),
    ] = UNSET
    run: Run
    later: Annotated[
        list[Later] | UnsetType,
        Meta(description="The parts of the run after each change of its program."),
    ] = UNSET
