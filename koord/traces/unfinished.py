"""Partial traces: files that grow with their runs, and files that end in the middle. [TRACE]

What has grown is the text that :func:`koord.traces.codec.encode` gives of the whole run,
up to the end of a round: there is one form of traces, and a part of a trace is a piece of it.
"""

from __future__ import annotations

import json
from typing import BinaryIO

from koord.traces.codec import encode, rendered_part, rendered_rounds
from koord.traces.form import FORMAT, VERSION
from koord.traces.run_codec import encode_rounds
from koord.traces.trace import Trace

#: Where rounds begin. Strings in JSON have no line breaks: this is nowhere else.
_ROUNDS = '\n "rounds": ['

#: Where the parts of a run begin that have another program each.
_LATER = ',\n"later": [\n'

#: What stands behind the rounds of a run of which nothing more is known; and behind its last part,
#: if it has several.
_RUN_END = '\n ],\n "violation": null\n}'
_END, _LATER_END = f"{_RUN_END}\n}}\n", f"{_RUN_END}}}\n]\n}}\n"


#: Where the version stands in the text of a trace.
_VERSION_AT = len(f'{{\n"format": "{FORMAT}",\n"version": ')


class GrowingTrace:
    """A file to which a trace is written while its run goes on."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._begun, self._rounds = file, False, 0
        self._part = 0  #: of the run, which may have had several programs

    def grow(self, trace: Trace) -> None:
        """Append the new rounds of a run, all of which are over."""
        parts = trace.parts
        text = "" if self._begun else _begun(parts[0])
        text += self._grown(parts[self._part])
        self._begun = True
        for part in parts[self._part + 1 :]:
            text += _RUN_END + ("}," if self._part else _LATER[:-1]) + "\n"
            text += rendered_part(part, with_rounds=False).rpartition(_ROUNDS)[0] + _ROUNDS
            self._part, self._rounds = self._part + 1, 0
            text += self._grown(part)
        self._file.write(text.encode("utf-8"))
        if self._part:
            self._raise_version()
        self._file.flush()

    def _grown(self, part: Trace) -> str:
        new = encode_rounds(part, self._rounds)
        text = f"{',' * (self._rounds > 0)}\n{rendered_rounds(new)}" if new else ""
        self._rounds = len(part.recording.rounds)
        return text

    def _raise_version(self) -> None:
        """Say in the second line that the run has several programs: versions have one digit."""
        here = self._file.tell()
        self._file.seek(_VERSION_AT)
        self._file.write(str(VERSION).encode())
        self._file.seek(here)


def _begun(trace: Trace) -> str:
    """Encode a trace up to its first round."""
    return encode(trace, with_rounds=False).decode().rpartition(_ROUNDS)[0] + _ROUNDS


def completed(part: bytes, trace: Trace) -> bytes:
    """Complete a partly written trace, without encoding its rounds again. [TRACE]"""
    if trace.later:
        return encode(trace)
    _, found, grown = part.partition(_ROUNDS.encode())
    lines = [line.rstrip(b",") for line in grown.split(b"\n")[1:]]
    if not found or len(lines) > len(trace.recording.rounds):
        return encode(trace)  # no round was over
    new = encode_rounds(trace, len(lines))
    lines += [rendered_rounds(new).encode()] if new else []
    head, empty, end = encode(trace, with_rounds=False).rpartition(f"{_ROUNDS}]".encode())
    rounds = _ROUNDS.encode() + b"\n" + b",\n".join(lines) + b"\n ]" if lines else empty
    return head + rounds + end


def mended(raw: bytes) -> bytes | None:
    """Cut a trace that ends in the middle behind its last whole round.

    None if it does not end there: it is whole, it ends before its first round, or it is no trace.
    """
    head, rounds, rest = raw.rpartition(_ROUNDS.encode())
    if not rounds or raw.rstrip().endswith((b"}\n}", b"}}\n]\n}")):
        return None
    lines = []
    for line in rest.split(b"\n")[1:]:
        if not line.startswith(b"  {"):
            break
        lines.append(line.rstrip(b",\r"))
    if lines and not _is_whole(lines[-1]):
        lines.pop()
    end = _LATER_END if _LATER.encode() in head else _END
    return head + rounds + b",".join(b"\n" + line for line in lines) + end.encode()


def _is_whole(line: bytes) -> bool:
    """Return whether a round was written to its end: a part of an object is no JSON."""
    try:
        json.loads(line)
    except ValueError:
        return False
    return True
