"""The part of SARIF 2.1.0 that koord writes, as structs: all of it is of the standard's schema."""

from __future__ import annotations

from typing import Annotated, Final, Literal, TypeAlias

from msgspec import UNSET, Meta, UnsetType, field

from koord.syntax.forms import Form, FromOne, Natural, Told

#: Where the standard's schema is published, as readers of a log expect it to be named.
SCHEMA: Final = "https://json.schemastore.org/sarif-2.1.0.json"

Level: TypeAlias = Literal["none", "note", "warning", "error"]


class Sarif(Form, rename="camel"):
    """An object of the standard."""


class Message(Sarif):
    """A text; of help also as Markdown."""

    text: Told
    markdown: str | UnsetType = UNSET


class Configuration(Sarif):
    """How grave the results of a rule are."""

    level: Level


class Rule(Sarif):
    """A kind of results: a code of diagnostics, or a rule of the semantics."""

    id: Told
    short_description: Message
    full_description: Message
    default_configuration: Configuration
    help: Message


class Driver(Sarif):
    """The tool, with the rules of its results."""

    name: Literal["koord"]
    semantic_version: str
    rules: list[Rule]


class Tool(Sarif):
    """The tool."""

    driver: Driver


class Region(Sarif):
    """A half-open range of characters, counted from 1."""

    start_line: FromOne
    start_column: FromOne
    end_line: FromOne
    end_column: FromOne


class Artifact(Sarif):
    """The place of a file, as named on the command line."""

    uri: str


class PhysicalLocation(Sarif):
    """A place in a file; without a region the file as a whole."""

    artifact_location: Artifact
    region: Region | UnsetType = UNSET


class LogicalLocation(Sarif):
    """The name of a claim."""

    name: str
    kind: Literal["member"]


class Location(Sarif):
    """A place, and what is said there."""

    physical_location: PhysicalLocation | UnsetType = UNSET
    message: Message | UnsetType = UNSET
    logical_locations: list[LogicalLocation] | UnsetType = UNSET


class FlowLocation(Sarif):
    """A step of a run."""

    location: Location
    execution_order: Natural
    importance: Literal["important", "essential", "unimportant"]


class ThreadFlow(Sarif):
    """The steps of a run, in order."""

    locations: Annotated[list[FlowLocation], Meta(min_length=1)]


class CodeFlow(Sarif):
    """A run that breaks a claim."""

    message: Message
    thread_flows: Annotated[list[ThreadFlow], Meta(min_length=1)]


class Content(Sarif):
    """A text."""

    text: str


class Replacement(Sarif):
    """A replacement of the characters of a region."""

    deleted_region: Region
    inserted_content: Content


class ArtifactChange(Sarif):
    """The changes of a file, to be made all together."""

    artifact_location: Artifact
    replacements: Annotated[list[Replacement], Meta(min_length=1)]


class Fix(Sarif):
    """A cure as data."""

    description: Message
    artifact_changes: Annotated[list[ArtifactChange], Meta(min_length=1)]


class Result(Sarif):
    """A diagnostic, or a claim that does not hold or is unknown."""

    rule_id: Told
    rule_index: Natural
    kind: Literal["fail", "open"]
    level: Level
    message: Message
    locations: list[Location]
    related_locations: list[Location] | UnsetType = UNSET
    code_flows: list[CodeFlow] | UnsetType = UNSET
    fixes: list[Fix] | UnsetType = UNSET


class Invocation(Sarif):
    """Whether the command came to its end."""

    execution_successful: bool


class Run(Sarif):
    """What one command found."""

    tool: Tool
    invocations: list[Invocation]
    results: list[Result]
    column_kind: Literal["unicodeCodePoints"] = "unicodeCodePoints"


class Log(Form):
    """What `--sarif FILE` of `koord check` and `koord verify` writes."""

    schema: Literal["https://json.schemastore.org/sarif-2.1.0.json"] = field(name="$schema")
    version: Literal["2.1.0"]
    runs: Annotated[list[Run], Meta(min_length=1, max_length=1)]
