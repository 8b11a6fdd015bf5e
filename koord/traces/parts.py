"""Traces that grow while their runs go on, and those that end in the middle. [TRACE]

What has grown is the text that :func:`koord.traces.codec.encode` gives of the whole run,
up to the end of a round: there is one form of traces, and a part of a trace is a piece of it.
"""

from __future__ import annotations

import json
from typing import BinaryIO

from koord.traces.codec import encode, head_of, render, rendered_round
from koord.traces.encode_runs import encode_rounds, encode_run, encode_start_of_run
from koord.traces.trace import Trace

#: Where rounds begin. Strings in JSON have no line breaks: this is nowhere else.
_ROUNDS = '\n "rounds": ['

#: What stands behind the rounds of a run of which nothing more is known.
_END = '\n ],\n "violation": null\n}\n}\n'


class PartTrace:
    """A file that a trace grows in."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._begun, self._rounds = file, False, 0

    def grow(self, trace: Trace) -> None:
        """Write what is new of a run, all of whose rounds are over."""
        new = list(map(rendered_round, encode_rounds(trace, self._rounds)))
        text = "".join(f"{',' * (self._rounds + k > 0)}\n{line}" for k, line in enumerate(new))
        if not self._begun:
            text = _begun(trace) + text
        self._begun, self._rounds = True, len(trace.recording.rounds)
        self._file.write(text.encode("utf-8"))
        self._file.flush()


def _begun(trace: Trace) -> str:
    """A trace up to its first round."""
    whole = render({**head_of(trace), "run": {**encode_start_of_run(trace), "rounds": []}})
    return whole.decode("utf-8").rpartition(_ROUNDS)[0] + _ROUNDS


def completed(part: bytes, trace: Trace) -> bytes:
    """The text of a trace of which a part has grown: its rounds are not encoded again. [TRACE]"""
    _, found, grown = part.partition(_ROUNDS.encode())
    lines = [line.rstrip(b",") for line in grown.split(b"\n")[1:]]
    if not found or len(lines) > len(trace.recording.rounds):
        return encode(trace)  # no round was over
    lines += [rendered_round(one).encode() for one in encode_rounds(trace, len(lines))]
    whole = render({**head_of(trace), "run": encode_run(trace, [])})
    head, empty, end = whole.rpartition(f"{_ROUNDS}]".encode())
    rounds = _ROUNDS.encode() + b"\n" + b",\n".join(lines) + b"\n ]" if lines else empty
    return head + rounds + end


def mended(raw: bytes) -> bytes | None:
    """A trace that ends in the middle as one that ends behind its last whole round.

    None if it does not end there: it is whole, it ends before its first round, or it is no trace.
    """
    head, rounds, rest = raw.partition(_ROUNDS.encode())
    if not rounds or raw.rstrip().endswith(b"}\n}"):
        return None
    lines = []
    for line in rest.split(b"\n")[1:]:
        if not line.startswith(b"  {"):
            break
        lines.append(line.rstrip(b",\r"))
    if lines and not _is_whole(lines[-1]):
        lines.pop()
    return head + rounds + b",".join(b"\n" + line for line in lines) + _END.encode()


def _is_whole(line: bytes) -> bool:
    """Whether a round was written to its end: a piece of an object is no JSON."""
    try:
        json.loads(line)
    except ValueError:
        return False
    return True
