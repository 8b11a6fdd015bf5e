"""The engines by name."""

from __future__ import annotations

from enum import Enum


class Engine(Enum):
    """What gave a verdict."""

    EVERY_N = "every N"  #: for every number of robots at once
    INDUCTION = "induction"
    SEARCH = "search"
    SPACER = "spacer"  #: constrained Horn clauses
    BITS = "bits"  #: and-inverter graphs, SAT and IC3
    ABC = "abc"  #: the same, with PDR by abc
    BMC = "bmc"
    NONE = "none"


def engine_named(name: str) -> Engine:
    """The engine of that name; NONE for what is none."""
    return next((engine for engine in Engine if engine.value == name), Engine.NONE)
