"""The form of certificates: structs from which ``koord schema certificate`` is generated."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from msgspec import Meta

from koord.syntax.forms import Digest, Exact, Form, Natural, NotCovered, Tasks, Text, Value, words

FORMAT: Final = "koord certificate"
VERSION: Final = 3


class Claim(Form):
    name: str
    kind: Annotated[str, words("property", "fault", "lost update", "contract")]
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


class CertificateForm(Form):
    """What a proof for all rounds consists of, version 3. What it says:
    specs/certificates/README.md.
    """

    format: Literal["koord certificate"]
    version: Literal[3]
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
        list[Claim], Meta(min_length=1, description="What is said to hold in every round.")
    ]
    invariant: Annotated[
        list[Conjunct], Meta(description="Statements whose conjunction is inductive.")
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
