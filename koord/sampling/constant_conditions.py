"""Parts of assumptions that hang on nothing that a run could choose: true or false beforehand."""

from __future__ import annotations

from koord.sampling.property_parts import Part, called, parts_of
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant, Domain
from koord.semantics.expressions import statement
from koord.semantics.oracle import NoOracle, Oracle
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.syntax import core
from koord.syntax.system import System
from koord.syntax.walk import nodes


def false_beforehand(
    d: Domain[Constant], system: System, configuration: Configuration[Constant]
) -> core.Expr | None:
    """A part of an assumption that is false whatever starts: of ``numAgents``, say, or a param."""
    for assumption in system.program.assumptions:
        for part in parts_of(system, assumption.condition):
            if part.places or _asks(system, part):
                continue
            oracle: Oracle[Constant] = NoOracle()
            m = machine(d, system, oracle, bound=assumption.bound, view=configuration)
            for slot, robot in part.robots.items():
                m.memory.bound[slot] = held(d, robot)
            if statement(m, part.condition) is not True:
                return part.condition
    return None


def _asks(system: System, part: Part) -> bool:
    return any(
        isinstance(node, core.Choose | core.ExternalCall)
        for node in (*nodes(part.condition), *called(system, part.condition))
    )
