"""The parts of a symbolic round: optional events, and the configurations to check."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Turn
from koord.semantics.storage import Storage, merge_storage_known
from koord.semantics.turns import Turned
from koord.syntax.core import UnaryOp
from koord.syntax.types import INT
from koord.verify.claims import ClaimPhase, StepFindings
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.encoding.terms import Term, Terms

Before: TypeAlias = "dict[tuple[int, int], Term]"


class EventOption(Struct, frozen=True):
    """An event of a robot in a round: the Boolean that says it runs, and its turn."""

    robot: int
    position: int
    chosen: Term
    turned: Turned[Term]


class SymbolicConfiguration(Struct):
    """A configuration at which properties are checked, with the constraints that make it reachable.

    ``constraints`` of all moments up to here hold together in every run that reaches it. ``fault``
    says that the step to here faulted: then the configuration is not looked at.
    ``real`` says when the configuration is one at all. ``checks`` answers what properties of it
    leave open.
    """

    phase: ClaimPhase
    configuration: Configuration[Term]
    constraints: list[Term]
    findings: StepFindings[Term]
    checks: SymbolicInputs
    real: Term = True


class SymbolicInit(Struct):
    """INIT as a symbolic step, with its unknowns."""

    inputs: SymbolicInputs
    before: Before
    moment: SymbolicConfiguration


class SymbolicRound(Struct):
    """A symbolic round: the program turns, then the environment's, with the unknowns of both.

    ``urgency`` holds of whole rounds only: inside a round, robots that did not move yet may still
    have to. ``before[i, j]`` (i < j) says that i's turn came before j's; empty where no order is
    needed. ``inside`` is looked at where the end of the program turns is not enough: the
    configuration in which the robots that run no event have not moved yet. Where nobody runs, one
    of them has skipped: ``free[i]`` says that i may do so before anyone else has moved. [T-PREFIX]
    """

    options: list[EventOption]
    before: Before
    inputs: SymbolicInputs
    inside: SymbolicConfiguration | None
    middle: SymbolicConfiguration
    end: SymbolicConfiguration
    urgency: list[Term]
    free: list[Term]

    @property
    def moments(self) -> list[SymbolicConfiguration]:
        """The configurations to check, in order."""
        inside = [self.inside] if self.inside is not None else []
        return [*inside, self.middle, self.end]

    def until(self, d: Terms, moment: SymbolicConfiguration) -> list[Term]:
        """The constraints, besides those of the program turns, under which a moment is reached."""
        if moment is self.inside:
            return []
        if moment is self.middle:
            return self.urgency
        sound = d.unary(UnaryOp.NOT, self.middle.findings.fault)
        return [sound, *self.urgency, *self.end.constraints]


def turn_taken(
    d: Terms, state: Robot[Term], options: Iterable[tuple[Term, Turned[Term]]]
) -> Robot[Term]:
    """The state of a robot after the event it chose of ``options``, or after none.
    [END-EVENT] [SKIP]
    """
    locals_, ports, status = state.locals, state.ports, state.status
    ran = d.const(NO_EVENT, INT)
    for chosen, turned in options:
        after = turned.robot
        locals_ = _merged(d, chosen, after.locals, locals_)
        ports = _merged(d, chosen, after.ports, ports)
        status = d.ite(chosen, after.status, status)
        ran = d.ite(chosen, after.ran, ran)
    return replace(state, locals=locals_, ports=ports, status=status, ran=ran, turn=Turn.ENV)


def _merged(
    d: Terms, condition: Term, then: tuple[Storage[Term], ...], other: tuple[Storage[Term], ...]
) -> tuple[Storage[Term], ...]:
    pairs = zip(then, other, strict=True)
    return tuple(merge_storage_known(d, condition, a, b) for a, b in pairs)
