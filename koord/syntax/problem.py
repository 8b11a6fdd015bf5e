"""Problems: the subject of a verdict, as texts with all settings that differ from them.

How many robots there are, of which kinds, how long a round takes, what params are, where tasks are:
wherever a verdict or a run is shown or kept, its ``Problem`` is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction

from msgspec import Struct

from koord.syntax import core
from koord.syntax.literals import encoded, literal, number
from koord.syntax.source import counted

#: More tasks than these are counted and not listed, in a line.
_FEW_TASKS = 3


class Problem(Struct, frozen=True):
    """A program with its settings: the subject of a verdict or a run.

    ``texts`` are the names of the files that it was read from, that of the program first.
    ``kinds[i]`` is the position of robot i's kind in the program; None: every number of robots.
    """

    texts: tuple[str, ...]
    program: core.Program
    kinds: tuple[int, ...] | None
    delta_s: Fraction

    @property
    def name(self) -> str:
        """The names of the files: ``task.krd with more.krd``."""
        program, *properties = self.texts
        return program + (f" with {', '.join(properties)}" if properties else "")

    @property
    def fleet(self) -> str:
        """The robots in words."""
        if self.kinds is None:
            return "every number of robots"
        robots, other = fleet(self.program, self.kinds), self.other_fleet
        return robots if other is None else f"{robots} ({other} in the text)"

    @property
    def other_fleet(self) -> str | None:
        """The robots that the text states, if it states others."""
        stated = self.program.instance.kinds
        if self.kinds is None or stated in ((), self.kinds):
            return None
        said = fleet(self.program, stated)
        return "in another order" if said == fleet(self.program, self.kinds) else said

    @property
    def round_(self) -> str:
        """The length of a round, in words."""
        said, stated = f"δ = {number(self.delta_s)} s", self.program.instance.delta_s
        if stated is None or stated == self.delta_s:
            return said
        return f"{said} ({number(stated)} s in the text)"

    @property
    def values(self) -> tuple[str, ...]:
        """δ, and each value that is not the text's: ``tasks = 10 (4 in the text)``."""
        return (self.round_, *self.settings)

    @property
    def differing(self) -> tuple[str, ...]:
        """Each value that is not the text's, robots and δ included."""
        robots = [] if self.other_fleet is None else [self.fleet]
        is_stated = self.program.instance.delta_s in (None, self.delta_s)
        return (*robots, *([] if is_stated else [self.round_]), *self.settings)

    @property
    def settings(self) -> tuple[str, ...]:
        """Each param that is not as in the text, and where tasks are."""
        return tuple(self._settings())

    def _settings(self) -> Iterator[str]:
        for given in self.program.parameters:
            if given.is_set:
                yield told(given)
        tasks = self.program.tasks
        if tasks is not None and len(tasks) > _FEW_TASKS:
            yield f"{len(tasks)} tasks of the world"
        elif tasks is not None:
            places = (f"({', '.join(map(number, place))})" for place in tasks)
            yield f"tasks of the world: {', '.join(places)}"

    def __str__(self) -> str:
        """Print the problem: ``task.krd: 3 robots, δ = 0.1 s, tasks = 10 (4 in the text)``."""
        return f"{self.name}: {', '.join((self.fleet, *self.values))}"

    def document(self) -> dict[str, object]:
        """The problem as JSON, with all params."""
        tasks = self.program.tasks
        several = self.kinds is not None and len(self.program.agents) > 1
        names = [agent.name for agent in self.program.agents]
        instance = self.program.instance
        return {
            "robots": None if self.kinds is None else len(self.kinds),
            "kinds": [names[kind] for kind in self.kinds or ()] if several else None,
            "delta": str(self.delta_s),
            "in_text": {
                "robots": len(instance.kinds) or None,
                "kinds": [names[kind] for kind in instance.kinds] if len(names) > 1 else None,
                "delta": None if instance.delta_s is None else str(instance.delta_s),
            },
            "params": {
                given.name: {
                    "value": encoded(given.value),
                    "in_text": None if given.written is None else encoded(given.written),
                }
                for given in self.program.parameters
            },
            "tasks": None if tasks is None else [[str(x) for x in place] for place in tasks],
            "properties": list(self.texts[1:]),
        }


def told(given: core.Parameter) -> str:
    """Print a param with its value, and with that of the text if it is another."""
    said = f"{given.name} = {literal(given.value)}"
    if not given.is_set:
        return said
    if given.written is None:
        return f"{said} (no value in the text)"
    return f"{said} ({literal(given.written)} in the text)"


def fleet(program: core.Program, kinds: Sequence[int]) -> str:
    """Print robots by kind: ``3 robots``, ``3 robots (2 Car, 1 Drone)``."""
    together = counted(len(kinds), "robot")
    if len(program.agents) == 1:
        return together
    each = ", ".join(f"{kinds.count(k)} {a.name}" for k, a in enumerate(program.agents))
    return f"{together} ({each})"
