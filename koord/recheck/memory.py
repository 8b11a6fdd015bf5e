"""What a body reads and writes, and what it leaves behind."""

from __future__ import annotations

from msgspec import Struct, field

from koord.recheck.storage import Crowd, Location, State, Storage
from koord.recheck.terms import Term
from koord.recheck.values import Value
from koord.syntax import core
from koord.syntax.source import Span
from koord.syntax.types import Type


class Write(Struct, frozen=True):
    """A write to a shared variable, where ``when`` holds."""

    when: Term
    variable: core.Variable
    locations: tuple[Location, ...]
    value: Value


class Fault(Struct, frozen=True):
    """Something that goes wrong where ``when`` holds."""

    when: Term
    what: str
    span: Span

    def of(self, when: Term) -> Fault:
        """The same under another condition."""
        return Fault(when, self.what, self.span)


class Memory(Struct):
    """What a body reads and writes: M and cp of a robot, or in a property a configuration."""

    locals: list[Storage] = field(default_factory=list)
    ports: list[Storage] = field(default_factory=list)
    allread: list[Storage] = field(default_factory=list)
    allwrite: list[Storage] = field(default_factory=list)
    after: list[Storage] | None = None  #: ports after the environment's turn, while it runs
    #: In a property: the configuration that it is about.
    state: State | Crowd | None = None


class Frame(Struct):
    """A running function: where it has returned, and what."""

    result: Storage
    type: Type | None
    returned: Term
