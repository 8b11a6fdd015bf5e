"""Exact numbers that grow without end: a run stops before the machine does."""

from __future__ import annotations

from fractions import Fraction

from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.traces.codec_values import LONGEST_NUMBER_BITS
from koord.semantics.traces.json_reader import refusal
from koord.semantics.traces.recording import Concrete
from koord.semantics.values import Rec, Seq, Table


def check_lengths(before: Configuration[Constant], after: Configuration[Constant]) -> None:
    """Raise KoordError if a step made a number that is too long to go on with."""
    for old, new in zip(before.robots, after.robots, strict=True):
        if old is not new:
            _check_all(old.locals, new.locals)
            _check_all(old.ports, new.ports)
    _check_all(before.store.allread, after.store.allread)
    _check_all(before.store.allwrite, after.store.allwrite)


def _check_all(before: tuple[Storage[Constant], ...], after: tuple[Storage[Constant], ...]) -> None:
    for old, new in zip(before, after, strict=True):
        if old is not new and _bits(new) > LONGEST_NUMBER_BITS:
            raise refusal(
                "koord run",
                "K923",
                f"an exact number has grown to more than {LONGEST_NUMBER_BITS} bits",
                "run with --numbers double, or for fewer rounds",
            )


def _bits(part: Storage[Constant] | Concrete) -> int:
    """The length of the longest number in storage or a value."""
    match part:
        case int():
            return part.bit_length()
        case Fraction():
            return max(part.numerator.bit_length(), part.denominator.bit_length())
        case Cell(value=value):
            return _bits(value)
        case Tree(parts=parts):
            return max(map(_bits, parts), default=0)
        case Rec(fields=parts):
            return max(map(_bits, parts), default=0)
        case Seq(items=items):
            return max(map(_bits, items), default=0)
        case Table(entries=entries):
            return max((max(_bits(k), _bits(v)) for k, v in entries), default=0)
        case _:
            return 0
