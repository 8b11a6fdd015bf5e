"""Place-holders of peers and options, and what they stand for: ports and domains that are free.

``{free}`` is a port, ``{domain}`` a domain of DDS, ``{job}`` a number that counts from 0. Peers
that run at the same time differ by them. (P-KIT-JOBS)
"""

from __future__ import annotations

import re
import secrets
import socket
from collections.abc import Callable
from typing import Any

from msgspec import Struct

#: Ports below those that systems give to clients, so that nobody else is given one meanwhile.
_PORTS = range(20000, 26000)

#: Domains of DDS whose ports are in none of these ranges.
_DOMAINS = range(76, 100)

_HOLDER = re.compile(r"\{(free|domain|job)\}")

#: What this process has given away: to ask whether a port is free says nothing of the next second.
_given: set[tuple[range, int]] = set()


class Holders(Struct, frozen=True):
    """What place-holders stand for."""

    free: int
    domain: int
    job: int

    def text(self, text: str) -> str:
        """A text, filled."""
        return _HOLDER.sub(lambda match: str(getattr(self, match[1])), text)

    def value(self, value: Any) -> Any:
        """A value of options, filled; what is a place-holder and nothing else becomes a number."""
        match value:
            case str():
                whole = _HOLDER.fullmatch(value)
                return getattr(self, whole[1]) if whole else self.text(value)
            case dict():
                return {name: self.value(one) for name, one in value.items()}
            case list() | tuple():
                return [self.value(one) for one in value]
            case _:
                return value


def fresh(job: int = 0) -> Holders:
    """Place-holders of a job that nobody else has."""
    return Holders(free_port(), free_domain(), job)


def has_holder(value: Any) -> bool:
    """Return whether there is a place-holder in a text, or anywhere in options."""
    match value:
        case str():
            return _HOLDER.search(value) is not None
        case dict():
            return any(map(has_holder, value.values()))
        case list() | tuple():
            return any(map(has_holder, value))
        case _:
            return False


def free_port() -> int:
    """A port of UDP and TCP that nobody uses now, and that was not given to anybody else here."""
    return _first(_PORTS, lambda port: port)


def free_domain() -> int:
    """A domain of DDS of which nobody on this machine is a part."""
    return _first(_DOMAINS, lambda domain: 7410 + 250 * domain)


def _first(numbers: range, port: Callable[[int], int]) -> int:
    """A number that is free, from a place by chance; else one that others may have, too."""
    begin = secrets.randbelow(len(numbers))
    for k in range(len(numbers)):
        number = numbers[(begin + k) % len(numbers)]
        if (numbers, number) not in _given and _is_free(port(number)):
            _given.add((numbers, number))
            return number
    return numbers[begin]


def _is_free(port: int) -> bool:
    for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM):
        with socket.socket(socket.AF_INET, kind) as asked:
            try:
                asked.bind(("", port))
            except OSError:
                return False
    return True
