"""The form of certificates: structs from which ``koord schema certificate`` is generated."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from msgspec import Meta

from koord.syntax.forms import Digest, Exact, Form, Natural, NotCovered, Tasks, Text, Value, words

FORMAT: Final = "koord certificate"
VERSION: Final = 5


class Claim(Form):
    name: str
    kind: Annotated[str, words("property", "fault", "lost update", "contract", "liveness")]
    subject: Annotated[
        str, Meta(description="The variable of a lost update, or the contract; else empty.")
    ]
    every_number: Annotated[
        bool,
        Meta(description="Whether it holds for every number of robots, not for those here alone."),
    ]


class Conjunct(Form):
    name: str
    depth: Annotated[int, Meta(ge=1, le=10, description="Over how many rounds it is inductive.")]
    every_number: Annotated[
        bool,
        Meta(
            description="Whether it is one of those that are inductive for every number of robots."
        ),
    ]
    text: Annotated[str, Meta(description="One invariant, in Koord.")]


class RestsOn(Form):
    assumptions: list[str]
    contracts: list[str]
    summaries: list[str]


class Obligation(Form):
    name: str
    smt2: Annotated[
        str,
        Meta(description="SMT-LIB 2: declarations and assertions, with one check-sat at the end."),
    ]
    sha256: Digest


class Settling(Form):
    text: Annotated[
        str,
        Meta(
            description="A measure as an invariant of Koord: of every robot where it is of each,"
            " then of the one that is meant; a number stands behind `0 <=`. Empty for a lock class."
        ),
    ]
    every_robot: Annotated[bool, Meta(description="Whether it is of each robot by itself.")]
    number: Annotated[bool, Meta(description="Whether it is a number, and not a statement.")]
    lock_class: Annotated[
        Natural | None, Meta(description="The position of a lock class, if it is one.")
    ]


class Help(Form):
    kind: Annotated[str, words("robot", "expected", "after a run", "time")]
    state: Annotated[str, Meta(description="An invariant: the robots of which it holds help.")]
    assumption: Annotated[str, Meta(description="What it rests on; empty if nothing is expected.")]
    falls: Annotated[str, Meta(description="The number that time lowers, behind `0 <=`; or empty.")]
    unmoved: Annotated[
        bool,
        Meta(description="Whether it lasts as nothing that it reads changes, of any robot."),
    ]


class First(Form):
    state: Annotated[
        str, Meta(description="An invariant: of the robots of which it holds one is the first.")
    ]
    number: Annotated[str, Meta(description="The number by which it is, behind `0 <=`.")]


class Progress(Form):
    """A proof of a claim about whole runs: T-PROGRESS of specs/semantics/10-liveness.md."""

    claim: str
    lasting: Annotated[
        list[str], Meta(description="Invariants: what holds from the trigger until the goal does.")
    ]
    order: Annotated[
        list[Settling], Meta(description="What settles, one after the other: measures and locks.")
    ]
    help: Annotated[list[Help], Meta(description="The ways in which somebody helps.")]
    first: Annotated[
        list[First],
        Meta(description="Those of whom one is the first, by a number and then by its own."),
    ]


class CertificateForm(Form):
    """What a proof for all rounds consists of, version 5. What it says:
    specs/certificates/README.md.
    """

    format: Literal["koord certificate"]
    version: Literal[5]
    made_by: Annotated[str, Meta(description="The tool and its version.")]
    program: Text
    properties: Annotated[
        list[Text], Meta(description="Files of properties, read with the program.")
    ]
    parameters: Annotated[
        dict[str, Value], Meta(description="Values of params that were set, by name.")
    ]
    tasks: Annotated[
        Tasks | None,
        Meta(description="Where the world's tasks are, if a configuration said so."),
    ]
    kinds: Annotated[
        list[Natural],
        Meta(
            min_length=1,
            description="Robot by robot, the position of its kind in the program.",
        ),
    ]
    delta: Annotated[Exact, Meta(description="The length of a round in seconds.")]
    claims: Annotated[
        list[Claim],
        Meta(min_length=1, description="What is said to hold in every round, or of whole runs."),
    ]
    invariant: Annotated[
        list[Conjunct], Meta(description="Statements whose conjunction is inductive.")
    ]
    progress: Annotated[
        list[Progress], Meta(description="Proofs of the claims about whole runs, one of each.")
    ]
    rests_on: Annotated[
        RestsOn, Meta(description="Names of what the proof may use and does not show.")
    ]
    not_covered: Annotated[
        list[NotCovered],
        Meta(description="Claims that were found to hold and that this is no proof of."),
    ]
    obligations: Annotated[
        list[Obligation], Meta(description="Scripts, each of which is to be unsatisfiable.")
    ]
