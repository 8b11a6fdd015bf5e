"""JSON of many objects that differ in a few values only: written as rows of one table of bytes.

A message about thousands of robots is one text thousands of times. It is encoded once, with holes
where values differ; then all holes are filled at once. Texts in a hole are padded to one length by
spaces, which JSON allows between its tokens.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from koord.sim.files.schemas import Message

#: Texts of one length, shape ``(n,)``: of any type whose items are bytes of text.
Texts: TypeAlias = NDArray[Any]

#: The texts of whole numbers that are written by looking them up: 0 to 9,999, then -0 to -999.
_WHOLE, _NEGATIVE = 10_000, 1_000
#: So many parts has a unit: millimetres.
_PARTS = 1_000


def hole(name: str) -> str:
    """What stands in an example for a value that differs."""
    return f"@{name}"


class Rows(Struct, frozen=True):
    """JSON objects of one length, a comma behind each."""

    raw: bytes
    width: int

    def between(self, first: int, last: int) -> bytes:
        """Some of the objects, with commas between them."""
        return self.raw[first * self.width : max(last * self.width - 1, 0)]


class Pattern:
    """The text of a JSON object, with holes."""

    def __init__(self, example: Message) -> None:
        parts = re.split(rb'"@(\w+)"', msgspec.json.encode(example) + b",")
        self._texts, self._holes = parts[::2], [name.decode() for name in parts[1::2]]

    def filled(self, **columns: Texts) -> Rows:
        """An object for each row of the columns: what each hole holds there."""
        types, blanks = [], []
        for text, name in zip(self._texts, [*self._holes, None], strict=True):
            types.append(("", f"S{len(text)}"))
            blanks.append(text)
            if name is not None:
                types.append((name, columns[name].dtype.str))
                blanks.append(bytes(columns[name].itemsize))
        row = np.frombuffer(b"".join(blanks), np.uint8)
        count = len(next(iter(columns.values())))
        table = np.broadcast_to(row, (count, len(row))).copy()
        fields = table.reshape(-1).view(np.dtype(types))
        for name in self._holes:
            fields[name] = columns[name]
        return Rows(table.tobytes(), len(row))


def texts(found: Iterable[bytes]) -> Texts:
    """Texts, padded to the length of the longest."""
    listed = list(found)
    width = max(map(len, listed), default=0)
    return np.array([one.ljust(width) for one in listed], f"S{max(width, 1)}")


def to_parts(values: NDArray[np.float32]) -> Texts:
    """Numbers, rounded to three digits as ``round`` does; what is no number is null.

    In single precision, so that their thousandths are exact in double precision.
    """
    with np.errstate(invalid="ignore"):
        parts = np.rint(values.astype(np.float64) * _PARTS)
        fit = (parts < _WHOLE * _PARTS) & (parts > -_NEGATIVE * _PARTS)
    if not fit.all():
        return texts(msgspec.json.encode(round(one, 3)) for one in values.tolist())
    whole, rest = np.divmod(np.abs(parts).astype(np.int32), _PARTS)
    whole[parts < 0] += _WHOLE
    found = np.empty((len(values), 2), np.uint32)
    found[:, 0], found[:, 1] = _WHOLES.take(whole), _RESTS.take(rest)
    joined: Texts = found.reshape(-1).view(np.uint64)
    return joined


def _looked_up(found: Sequence[str]) -> NDArray[np.uint32]:
    """Texts of four letters as numbers, which are copied more quickly."""
    return np.array(found, "S4").view(np.uint32)


_WHOLES = _looked_up(
    [f"{k:4}" for k in range(_WHOLE)] + [f"{f'-{k}':>4}" for k in range(_NEGATIVE)]
)
_RESTS = _looked_up([f".{k:03}" for k in range(_PARTS)])
