"""What a round is made of, with its unknowns: events that may run, moments to look at."""

from __future__ import annotations

from dataclasses import dataclass

from koord.semantics.configurations import Configuration
from koord.semantics.turns import Turned
from koord.verify.claims import Findings, Phase
from koord.verify.races import Before
from koord.verify.symbols import SymbolicInputs
from koord.verify.terms import Term


@dataclass(frozen=True, slots=True)
class Option:
    """One event of one robot in a round: the Boolean that says it runs, and its turn."""

    robot: int
    position: int
    chosen: Term
    turned: Turned[Term]


@dataclass(slots=True)
class Moment:
    """A configuration at which properties are looked at, with what makes it one.

    ``constraints`` of all moments up to here hold together in every run that reaches it. ``fault``
    says that the step to here faulted: then the configuration is not looked at.
    ``real`` says when the configuration is one at all. ``checks`` answers what properties of it
    leave open.
    """

    phase: Phase
    configuration: Configuration[Term]
    constraints: list[Term]
    findings: Findings[Term]
    checks: SymbolicInputs
    real: Term = True


@dataclass(slots=True)
class Opening:
    """INIT with its unknowns."""

    inputs: SymbolicInputs
    before: Before
    moment: Moment


@dataclass(slots=True)
class SymbolicRound:
    """A round: the program turns, then the environment's, with the unknowns of both.

    ``urgency`` holds of whole rounds only: inside a round, robots that did not move yet may still
    have to. ``before[i, j]`` (i < j) says that i's turn came before j's; empty where no order is
    needed. ``inside`` is looked at where the end of the program turns is not enough: the
    configuration in which the robots that run no event have not moved yet. Where nobody runs, one
    of them has skipped: ``free[i]`` says that i may do so before anyone else has moved. [T-PREFIX]
    """

    options: list[Option]
    before: Before
    inputs: SymbolicInputs
    inside: Moment | None
    middle: Moment
    end: Moment
    urgency: list[Term]
    free: list[Term]
