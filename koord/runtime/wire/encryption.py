"""Encrypted frames: ChaCha20-Poly1305 (RFC 8439) around the body. Needs ``koord[encrypt]``.

    header (as in :mod:`koord.runtime.wire.frames`) | salt 16 | encrypted body | tag 16

The header can be read by everybody, and the tag covers it. A nonce must never be used twice under
one key. Datagram numbers are no such nonce by themselves: the fleet key lives for many runs, and a
start may be that of an old disk that was brought back, with numbers that were used before. So each
seal draws a salt of 128 random bits, and encrypts with a key of its own, made of its key and the
salt; under that key the nonce is the datagram's number, and a seal whose numbers do not rise draws
another salt. (This is how XChaCha20 extends nonces, with keyed BLAKE2b for HChaCha20.)
"""

from __future__ import annotations

import secrets
from hashlib import blake2b

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

from koord.runtime.wire.frames import HEADER_BYTES, SALT_BYTES, Seal, Version

_NONCE_BYTES = 12
_BODY_AT = HEADER_BYTES + SALT_BYTES


class Encrypting(Seal):
    """The seal that encrypts and authenticates."""

    __slots__ = ("_cipher", "_heard", "_key", "_newest", "_salt")

    VERSION = Version.ENCRYPTED

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._newest = -1  #: the highest number that was used with this salt
        self._heard: dict[int, tuple[bytes, ChaCha20Poly1305]] = {}  #: by sender: the last salt
        self._draw()

    def _draw(self) -> None:
        self._salt = secrets.token_bytes(SALT_BYTES)
        self._cipher = _cipher(self._key, self._salt)

    def _closed(self, header: bytes, number: int, body: bytes) -> bytes:
        if number <= self._newest:
            self._draw()
        self._newest = number
        return header + self._salt + self._cipher.encrypt(_nonce(number), body, header)

    def _opened(self, datagram: bytes, sender: int, number: int) -> bytes | None:
        salt = datagram[HEADER_BYTES:_BODY_AT]
        known = self._heard.get(sender)
        is_known = known is not None and known[0] == salt
        cipher = known[1] if known is not None and is_known else _cipher(self._key, salt)
        header = datagram[:HEADER_BYTES]
        try:
            body = cipher.decrypt(_nonce(number), datagram[_BODY_AT:], header)
        except InvalidTag:  # also of what is too short for a tag
            return None
        if not is_known:  # strangers cannot fill this
            self._heard[sender] = salt, cipher
        return body


def _cipher(key: bytes, salt: bytes) -> ChaCha20Poly1305:
    own = blake2b(salt, key=key, digest_size=32, person=b"koord encrypted").digest()
    return ChaCha20Poly1305(own)


def _nonce(number: int) -> bytes:
    return number.to_bytes(_NONCE_BYTES, "big")
