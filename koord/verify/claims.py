"""Claims: the proof goals of a system, from its properties and from the rules for every program."""

from __future__ import annotations

from enum import Enum
from typing import Generic, TypeVar

from msgspec import Struct

from koord.semantics.configurations import Configuration
from koord.semantics.domain import Domain, conjunction, disjunction
from koord.semantics.liveness import LIVENESS
from koord.semantics.machine import Legality
from koord.semantics.oracle import Inputs
from koord.semantics.properties import holds_in
from koord.syntax import core
from koord.syntax.analysis.footprint import rewritten
from koord.syntax.core import Home, PropertyKind, UnaryOp
from koord.syntax.system import System
from koord.syntax.walk import nodes

V = TypeVar("V")


class ClaimKind(Enum):
    """The kinds of claims, by their origin."""

    PROPERTY = "property"  #: the program says so
    FAULT = "fault"  #: no program may fault
    LOST_UPDATE = "lost update"  #: no update of an allwrite variable may be lost
    CONTRACT = "contract"  #: a module with a model keeps its contracts
    LIVENESS = "liveness"  #: the program says so, of whole runs


#: The rule that a violation of a claim breaks.
RULES = {
    ClaimKind.PROPERTY: "PROP-INVARIANT",
    ClaimKind.FAULT: "FAULT",
    ClaimKind.LOST_UPDATE: "LOST-UPDATE",
    ClaimKind.CONTRACT: "PROP-CONTRACT",
    ClaimKind.LIVENESS: "PROP-EVENTUALLY",
}


def rule_of(claim: Claim) -> str:
    """The rule that a violation of the claim breaks."""
    if claim.stated is not None and claim.stated.trigger is not None:
        return "PROP-LEADS-TO"
    return RULES[claim.kind]


class ClaimPhase(Enum):
    """The points of a run at which configurations are checked. [T-PREFIX]"""

    INIT = "after INIT"
    INSIDE = "inside a round"  #: robots that run no event have not moved yet
    MIDDLE = "after program turns"
    END = "after the environment's turn"


class Claim(Struct, frozen=True):
    """A claim. ``subject`` names the variable of a lost update, or the contract.

    ``reads_ports`` says whether the environment's turn can change what is claimed.
    """

    name: str
    kind: ClaimKind
    stated: core.Property | None = None
    subject: str = ""
    reads_ports: bool = True

    def __hash__(self) -> int:
        # What is stated is large, and claims that differ in nothing else are few.
        return hash((self.name, self.kind, self.subject))

    @property
    def is_state_property(self) -> bool:
        """True if the claim is about single configurations, so that one may assume it."""
        return self.kind is ClaimKind.PROPERTY

    def looked_at(self, phase: ClaimPhase) -> bool:
        """Return whether the claim is about configurations of a phase.
        [PROP-INVARIANT] [PROP-ROUND]
        """
        match self.kind:
            case ClaimKind.PROPERTY:
                assert self.stated is not None
                every = self.stated.kind is PropertyKind.INVARIANT
                if every and phase is ClaimPhase.END and not self.reads_ports:
                    # The environment changes ports only: it was asked after the program turns.
                    return False
                return every or phase not in (ClaimPhase.INSIDE, ClaimPhase.MIDDLE)
            case ClaimKind.FAULT:
                return True
            case ClaimKind.LOST_UPDATE:
                return phase in (ClaimPhase.INSIDE, ClaimPhase.MIDDLE)
            case ClaimKind.CONTRACT:
                return phase is ClaimPhase.END
            case ClaimKind.LIVENESS:
                return False


NO_FAULT = Claim("no fault", ClaimKind.FAULT)


def claims_of(system: System) -> tuple[Claim, ...]:
    """Every safety claim of a system, in the order in which they are reported.

    What is claimed of whole runs is not among them: see ``liveness_of``.
    """
    program = system.program
    some_function = reads_ports(program, ())  # which is the same for all of them
    claims = [
        Claim(
            p.name,
            ClaimKind.PROPERTY,
            p,
            reads_ports=some_function or _reads_ports(program, p.condition),
        )
        for p in program.properties
        if p.kind in (PropertyKind.INVARIANT, PropertyKind.AT_ROUND)
    ]
    claims.append(NO_FAULT)
    updated = sorted({slot for slots in rewritten(program).values() for slot in slots})
    if system.robots > 1:
        for slot in updated:
            name = program.allwrite[slot].variable.name
            claims.append(Claim(f"no lost update of {name}", ClaimKind.LOST_UPDATE, None, name))
    for agent in program.agents:
        for module in agent.modules:
            if module.environment is not None:
                claims += [
                    Claim(f"contract {c.name}", ClaimKind.CONTRACT, None, c.name)
                    for c in module.contracts
                ]
    return tuple(dict.fromkeys(claims))


def reads_ports(program: core.Program, condition: core.Expr | tuple[()]) -> bool:
    """Return whether a statement may read a port, itself or in a function that it calls."""
    bodies = tuple(function.body for function in program.functions)
    return _reads_ports(program, (condition, bodies))


def _reads_ports(program: core.Program, part: object) -> bool:
    """Return whether a part of a program reads a port, but for the functions that it calls."""
    return any(agent.ports for agent in program.agents) and any(
        isinstance(node, core.Variable) and node.home is Home.PORT for node in nodes(part)
    )


def liveness_of(system: System) -> tuple[Claim, ...]:
    """The liveness claims of a system."""
    live = (p for p in system.program.properties if p.kind in LIVENESS)
    return tuple(Claim(p.name, ClaimKind.LIVENESS, p) for p in live)


class StepFindings(Struct, Generic[V], frozen=True):
    """The findings of a symbolic step: fault, lost updates, and contracts to be proved."""

    fault: V
    lost_updates: tuple[tuple[V, str], ...] = ()
    promises: tuple[tuple[V, str], ...] = ()


def broken(
    d: Domain[V],
    system: System,
    claim: Claim,
    configuration: Configuration[V],
    findings: StepFindings[V],
    inputs: Inputs[V],
) -> tuple[V, tuple[Legality[V], ...]]:
    """Return the condition that a configuration, or the step to it, breaks a claim."""
    match claim.kind:
        case ClaimKind.PROPERTY:
            assert claim.stated is not None
            p = claim.stated
            holds, legality = holds_in(d, system, configuration, p.condition, p.bound, inputs)
            return d.unary(UnaryOp.NOT, holds), legality
        case ClaimKind.FAULT:
            return findings.fault, ()
        case ClaimKind.LOST_UPDATE:
            met = [when for when, name in findings.lost_updates if name == claim.subject]
            return disjunction(d, met), ()
        case ClaimKind.CONTRACT:
            kept = [when for when, name in findings.promises if name == claim.subject]
            return d.unary(UnaryOp.NOT, conjunction(d, kept)), ()
        case ClaimKind.LIVENESS:
            raise AssertionError(f"{claim.name} is not about one configuration")
