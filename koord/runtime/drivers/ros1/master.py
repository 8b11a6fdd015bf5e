"""The master of a graph of ROS 1, and its nodes, asked with little patience."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from http.client import HTTPConnection, HTTPException
from typing import Any
from xml.parsers.expat import ExpatError
from xmlrpc.client import Error, ServerProxy, Transport

from msgspec import Struct

#: Who does not answer within this counts as absent, in s.
PATIENCE_S = 1.0

#: What is raised where somebody does not answer, or not as he should.
UNREACHABLE = (OSError, HTTPException, Error, ExpatError, ValueError, TypeError, LookupError)

#: The type of those who take whatever comes, such as recorders.
_ANY = "*"


class Role(Enum):
    """What a node does on a topic; the value is what its own interface calls that."""

    PUBLISH = "Publications"
    LISTEN = "Subscriptions"

    @property
    def other(self) -> Role:
        return Role.LISTEN if self is Role.PUBLISH else Role.PUBLISH


class Seen(Struct, frozen=True):
    """Which nodes are on which topics, by what the master tells."""

    nodes: Mapping[Role, Mapping[str, tuple[str, ...]]] = {}

    def on(self, topic: str, role: Role) -> tuple[str, ...]:
        return self.nodes.get(role, {}).get(topic, ())


class _Impatient(Transport):
    """Carries calls that do not wait forever."""

    def make_connection(self, host: Any) -> HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = PATIENCE_S
        return connection


def _proxy(uri: str) -> ServerProxy:
    return ServerProxy(uri, transport=_Impatient())


class Master:
    """What is asked of a master. All of it raises one of UNREACHABLE if that does not answer."""

    def __init__(self, uri: str) -> None:
        self.uri, self.caller = uri, "/koord"

    def look(self) -> Seen:
        """Who publishes and who listens."""
        with _proxy(self.uri) as proxy:
            publishers, subscribers, _ = _told(proxy.getSystemState(self.caller))
        told = {Role.PUBLISH: publishers, Role.LISTEN: subscribers}
        return Seen({role: {t: tuple(nodes) for t, nodes in lot} for role, lot in told.items()})

    def register(self, topic: str, type_name: str, role: Role, own_uri: str) -> None:
        """Say again that this process publishes or hears a topic, as to a master that was lost."""
        with _proxy(self.uri) as proxy, _proxy(own_uri) as own:
            if role is Role.PUBLISH:
                proxy.registerPublisher(self.caller, topic, type_name, own_uri)
            else:
                told = proxy.registerSubscriber(self.caller, topic, type_name, own_uri)
                # As a master says it to those who listen.
                own.publisherUpdate("/master", topic, _told(told))

    def types(self, topic: str, role: Role, nodes: tuple[str, ...]) -> dict[str, str | None]:
        """The type that each node has for a topic; None: it does not answer."""
        found: dict[str, str | None] = {}
        for node in nodes:
            try:
                with _proxy(self.uri) as proxy:
                    uri = _told(proxy.lookupNode(self.caller, node))
                with _proxy(uri) as other:
                    told = _told(getattr(other, f"get{role.value}")(self.caller))
                for name, kind in told:
                    if name == topic and kind != _ANY:
                        found[node] = kind
            except UNREACHABLE:
                found[node] = None
        return found


def _told(answer: Any) -> Any:
    """What an answer says, which is a code, a comment and that. Raises ValueError if it refuses."""
    code, comment, told = answer
    if code != 1:
        raise ValueError(comment)
    return told
