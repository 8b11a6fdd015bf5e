"""What drivers need of a graph of topics, whatever carries them."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any, Protocol

from koord.runtime.drivers.ros.options import Wire

#: A message that is to be sent: values by fields, those of parts by theirs. What is left out is 0.
#: Stamps are `sec` and `nanosec`.
Fields = Mapping[str, Any]


class Latest(Protocol):
    """What is heard on a topic."""

    @property
    def wire(self) -> Wire: ...

    def take(self) -> Any | None:
        """The latest message that was not taken yet, without waiting.

        Its fields are those of the published type; stamps may have other names
        (:func:`koord.runtime.drivers.ros.poses.seconds`).
        """


class Sender(Protocol):
    """A topic that is published."""

    @property
    def wire(self) -> Wire: ...

    @property
    def is_heard(self) -> bool:
        """True if somebody subscribes to it."""

    def send(self, message: Fields) -> None:
        """Publish, without waiting: who reads too slowly hears the next one. Raises DriverError."""


class Graph(Protocol):
    """A robot's part in a graph of topics."""

    #: What to look at where nothing is heard.
    @property
    def hint(self) -> str: ...

    def listen(self, wire: Wire) -> Latest:
        """Subscribe to a topic. Raises DriverError."""

    def publish(self, wire: Wire) -> Sender:
        """Advertise a topic. Raises DriverError."""

    def why_silent(self, wire: Wire) -> str:
        """Why nothing is heard on a topic, as far as is known."""

    def why_unheard(self, wire: Wire) -> str:
        """Why nobody hears a topic, as far as is known."""

    def mistyped(self, wire: Wire) -> str | None:
        """What is wrong if a topic is published, but not with its type."""

    @property
    def trouble(self) -> str | None:
        """What is wrong with the graph itself by now."""

    def close(self) -> None:
        """Leave it."""


def differs(wire: Wire, types: Set[str], wanted: str) -> str | None:
    """What is wrong if a topic has ends, none of which has the type that is wanted."""
    if not types or wanted in types:
        return None
    return f"`{wire.told}` has the type {', '.join(sorted(types))}, not {wanted}"


def filled(message: Any, fields: Fields) -> Any:
    """A message of a library with its fields set."""
    for name, value in fields.items():
        if isinstance(value, Mapping):
            filled(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message
