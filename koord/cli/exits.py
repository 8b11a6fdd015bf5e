"""Exit codes of ``koord``; the same for every command."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum


class Exit(IntEnum):
    """The exit codes, as ``koord --help`` and README.md list them."""

    OK = 0  #: done; every property holds
    VIOLATED = 1  #: a property does not hold, a trace is illegal, a layout differs
    BAD_INPUT = 2  #: a mistake in a program, a file or a flag
    UNKNOWN = 3  #: no verdict within the limits
    VACUOUS = 4  #: every property holds, but says less than it seems to
    STUCK = 5  #: a robot of a simulated run stands still that is to go somewhere
    INTERNAL = 70  #: a mistake in koord itself (EX_SOFTWARE of sysexits.h)
    NO_MEMORY = 71  #: too little memory to do anything (EX_OSERR of sysexits.h)
    HUNG_UP = 129  #: stopped by SIGHUP: the terminal went away
    INTERRUPTED = 130  #: stopped with Ctrl-C
    PIPE_CLOSED = 141  #: the reader of the output went away
    TERMINATED = 143  #: stopped by SIGTERM


_GRAVITY = (
    Exit.INTERRUPTED,
    Exit.BAD_INPUT,
    Exit.VIOLATED,
    Exit.STUCK,
    Exit.UNKNOWN,
    Exit.VACUOUS,
    Exit.OK,
)


def gravest(codes: Iterable[Exit]) -> Exit:
    """The code of a run over several files: bad input before violated before unknown."""
    return min(codes, key=_GRAVITY.index, default=Exit.OK)
