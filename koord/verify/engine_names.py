"""Names of the engines, for requests and verdicts."""

from __future__ import annotations

from enum import Enum


class Engine(Enum):
    """An engine, by its name."""

    EVERY_N = "every N"  #: for every number of robots at once
    INDUCTION = "induction"
    SEARCH = "search"  #: all configurations one by one
    SPACER = "spacer"  #: constrained Horn clauses
    BITS = "bits"  #: and-inverter graphs, SAT and IC3
    ABC = "abc"  #: the same, with PDR by abc
    BMC = "bmc"
    NONE = "none"  #: no engine gave it

    @property
    def folder(self) -> str:
        """The engine's folder in ``koord/verify/engines``."""
        return _FOLDERS.get(self.value, self.value)


#: The folders that have other names than their engines.
_FOLDERS = {"every N": "every_n", "search": "explicit", "spacer": "horn", "abc": "bits"}


def engine_named(name: str) -> Engine:
    """The engine of a name; NONE for an unknown name."""
    return next((engine for engine in Engine if engine.value == name), Engine.NONE)
