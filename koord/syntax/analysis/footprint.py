"""Which variables a program may still change after INIT, and how. Read off the text.

Where induction starts from *any* configuration, this says what the configuration cannot have
forgotten: variables that no event writes keep the value they had after INIT; lists that are only
written element by element keep their length; an atom that is set is never unset.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum

from koord.syntax import core
from koord.syntax.core import Direction, Home
from koord.syntax.system import Status
from koord.syntax.types import GrowingType
from koord.syntax.walk import nodes, statements, written

_RESIZING = core.Append | core.Remove | core.Pop


class WriteExtent(IntEnum):
    """How much of a variable may change."""

    NEVER = 0
    PARTS = 1  #: elements or fields below an atom, never the atom as such
    WHOLE = 2


Footprint = dict[tuple[Home, int, int], WriteExtent]
"""(home, agent kind or 0 for shared variables, slot) → how it is written; NEVER is left out."""


def footprint(program: core.Program) -> Footprint:
    """The footprint of all events and environments of a program."""
    found: Footprint = {}
    for kind, agent in enumerate(program.agents):
        for event in agent.events:
            for place in _changed(event.effect):
                _note(found, kind, place)
        for module in agent.modules:
            for place in _changed(module.environment or ()):
                _note(found, kind, place)
            if module.environment is None:
                for position in module.ports:
                    port = agent.ports[position]
                    if port.direction is Direction.SENSOR:
                        slot = port.declaration.variable.slot
                        found[Home.PORT, kind, slot] = WriteExtent.WHOLE
    return found


def statuses(program: core.Program) -> tuple[frozenset[Status], ...]:
    """The statuses that robots of each kind may have between rounds. [STOP]"""
    asking = any(_has(agent, core.TryStop) for agent in program.agents)
    found = []
    for agent in program.agents:
        possible = {Status.RUNNING}
        if asking or _has(agent, core.Stop):
            possible.add(Status.STOPPED)
        if _has(agent, core.TryStop):
            possible.add(Status.ASKED)
        found.append(frozenset(possible))
    return tuple(found)


def _has(agent: core.Agent, kind: type[core.Stop] | type[core.TryStop]) -> bool:
    return any(
        isinstance(statement, kind)
        for block in (agent.init, *(event.effect for event in agent.events))
        for statement in statements(block)
    )


def stops_show(program: core.Program) -> bool:
    """Whether a property can tell robots that stop together from robots that asked to. [STOP]"""
    asks = any(
        isinstance(node, core.TryStop)
        for agent in program.agents
        for node in nodes((agent.init, agent.events))
    )
    looks = any(isinstance(node, core.Stopped) for node in nodes(program.properties))
    return asks and looks


def _note(found: Footprint, kind: int, place: core.Place) -> None:
    variable = place.variable
    own = variable.home in (Home.LOCAL, Home.PORT)
    key = (variable.home, kind if own else 0, variable.slot)
    how = WriteExtent.PARTS if _inside_list(place) else WriteExtent.WHOLE
    found[key] = max(found.get(key, WriteExtent.NEVER), how)


def _inside_list(place: core.Place) -> bool:
    """Whether a place is an element of a list, or lies in one: the list keeps its length.

    Writing at a map's key may add the key, so that changes the map as a whole.
    """
    inside = False
    type_ = place.variable.type
    for step in place.steps:
        if isinstance(step, core.KeyStep):
            return False
        inside = inside or isinstance(type_, GrowingType)
        type_ = step.type
    return inside


def _changed(block: core.Block) -> Iterator[core.Place]:
    """What a block writes; a variable as a whole where a list in it gets another length."""
    for statement in statements(block):
        resized = statement.place if isinstance(statement, _RESIZING) else None
        for place in written(statement):
            yield core.Place(place.variable) if place is resized else place
