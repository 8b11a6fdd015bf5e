"""Datagrams of strangers: of seven kinds, from a seed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import Enum
from random import Random

#: The longest datagram of koord's.
_LONGEST = 1400


class Kind(Enum):
    """The kinds of hostile datagrams. The last six are made of recorded ones."""

    RANDOM = "random bytes"
    FLIPPED = "one bit is another"
    REPLAYED = "as it was sent before"
    CUT_SHORT = "its end is missing"
    TOO_LONG = "something follows it"
    OF_ANOTHER_VERSION = "its version is another"
    SPLICED = "the head of one on the body of another"


KINDS = tuple(Kind)


class Flood:
    """Makes datagrams of one kind."""

    def __init__(self, kind: Kind, recorded: Sequence[bytes], seed: int) -> None:
        self._kind, self._recorded = kind, recorded
        self._random = Random(seed)

    def of(self, count: int) -> Iterator[bytes]:
        """So many datagrams."""
        return (self._one() for _ in range(count))

    def _one(self) -> bytes:
        draw, data = self._random, self._random.choice(self._recorded)
        match self._kind:
            case Kind.RANDOM:
                return draw.randbytes(draw.randrange(_LONGEST))
            case Kind.FLIPPED:
                at = draw.randrange(len(data))
                return data[:at] + bytes((data[at] ^ 1 << draw.randrange(8),)) + data[at + 1 :]
            case Kind.REPLAYED:
                return data
            case Kind.CUT_SHORT:
                return data[: draw.randrange(len(data))]
            case Kind.TOO_LONG:
                return data + draw.randbytes(draw.randrange(1, 2 * _LONGEST))
            case Kind.OF_ANOTHER_VERSION:
                return data[:1] + bytes((draw.randrange(2, 256),)) + data[2:]
            case Kind.SPLICED:
                at = draw.randrange(1, len(data))
                return data[:at] + draw.choice(self._recorded)[at:]
