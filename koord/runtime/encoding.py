"""Canonical encoding of plain data: equal data give equal bytes, for digests and datagrams.

MessagePack, written and read by msgspec, which checks types, lengths and nesting while it reads.
Whole numbers of more than 64 bits, which MessagePack lacks, are an extension of it.
"""

from __future__ import annotations

from hashlib import blake2b
from typing import Any

import msgspec

from koord.runtime.proposals import Plain

#: The code of the extension: a whole number in two's complement, the greatest byte first.
BIG_INT = 1

#: Numbers longer than this are not read: adding two of them would take the time of a round.
MOST_BIG_INT_BYTES = 1 << 16

_SCALARS = (bool, int, float, str, type(None))

_ENCODER = msgspec.msgpack.Encoder()


class NotPlainError(ValueError):
    """Raised for MessagePack data of the right type that no robot can have sent."""


def encode(value: Any) -> bytes:
    """Encode structs, tuples, scalars and bytes as MessagePack."""
    try:
        return _ENCODER.encode(value)
    except OverflowError:
        return _ENCODER.encode(_with_big_ints(msgspec.to_builtins(value, builtin_types=(bytes,))))


def _with_big_ints(flat: Any) -> Any:
    if isinstance(flat, list | tuple):
        return [_with_big_ints(item) for item in flat]
    if isinstance(flat, int) and not -(2**63) <= flat < 2**64:
        size = flat.bit_length() // 8 + 1
        return msgspec.msgpack.Ext(BIG_INT, flat.to_bytes(size, "big", signed=True))
    return flat


def decoder(type_: Any) -> msgspec.msgpack.Decoder[Any]:
    """A decoder of what :func:`encode` wrote. It raises MsgspecError and NotPlainError."""
    return msgspec.msgpack.Decoder(
        type_, ext_hook=big_int, dec_hook=lambda _type, value: plain(value)
    )


def big_int(code: int, data: memoryview) -> int:
    """Decode a big integer: the ``ext_hook`` of a decoder. Raises NotPlainError."""
    if code != BIG_INT or not 0 < len(data) <= MOST_BIG_INT_BYTES:
        raise NotPlainError(f"extension {code} of {len(data)} bytes")
    return int.from_bytes(data, "big", signed=True)


def plain(value: Any) -> Plain:
    """Convert decoded lists to tuples. Raises NotPlainError for types that Koord lacks."""
    if isinstance(value, list | tuple):
        return tuple(plain(item) for item in value)
    if isinstance(value, _SCALARS):
        return value
    raise NotPlainError(f"a {type(value).__name__}")


def text_digest(text: str, size: int) -> str:
    """A digest of a text with so many bytes, in hexadecimal digits."""
    return blake2b(text.encode(), digest_size=size).hexdigest()
