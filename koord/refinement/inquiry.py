"""Inquiries: what contracts and assumptions ask of a robot, asked of its own host. [RECORDING]

A robot's program asks its host nothing of what only these mention. Asked in the moment in
which the sensors were read, the host of a vehicle knows the answers, and the judge needs not
presume any.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeAlias

from msgspec.structs import replace

from koord.refinement.claims import AssumedPart, Claim, Kept
from koord.refinement.completion import asked_in, asking_contracts
from koord.refinement.open_answers import PARTIALS, CannotTellError, OpenInputs
from koord.refinement.translation import Translation, to_plain, to_value
from koord.runtime.robot import Host, Robot, Turn
from koord.sampling.conjuncts import Conjunct, conjuncts_of
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.environment import Ports
from koord.semantics.every_number import NotFiniteError
from koord.semantics.oracle import Key, Phase
from koord.semantics.recordings import Answer, Concrete, RecordedInputs
from koord.semantics.rounds import unset_start
from koord.semantics.storage import Storage
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.diagnostics import KoordError

#: Is told of an answer.
Tell: TypeAlias = Callable[[Answer], None]


class Inquiry:
    """What the contracts of one robot ask in each round, at most once each.

    What its host cannot answer it is asked but once in the whole run.
    """

    def __init__(self, host: Host, translation: Translation, pid: int) -> None:
        self._host = host
        self._translation = translation
        self._pid = pid
        system = translation.system
        self._contracts = asking_contracts(system.program, system.agent(pid))
        self._unanswered: set[str] = set()

    def before(self, robot: Robot) -> tuple[Storage[Constant], ...] | None:
        """What the ports hold before the environment's turn; None if no contract asks anything."""
        return self._translation.held_ports(robot) if self._contracts else None

    def make(self, before: tuple[Storage[Constant], ...], robot: Robot, tell: Tell) -> None:
        """Ask the host what the contracts of a round ask, after the environment's turn."""
        ports: Ports[Any] = Ports(before, self._translation.held_ports(robot))
        for module, contract in self._contracts:
            self._ask(Kept(self._pid, module, contract, ports), tell)

    def of_start(self, robot: Robot, tell: Tell) -> None:
        """Ask it what assumptions ask after INIT: of this robot, and of what all share.

        Of what several share the first of those that it is about asks.
        """
        system = self._translation.system
        state = self._translation.robot(robot)
        blank = unset_start(DOUBLES, system)
        robots = (*blank.robots[: self._pid], state, *blank.robots[self._pid + 1 :])
        at = replace(blank, robots=robots, store=state.copy)
        for assumption in system.program.assumptions:
            if not asked_in(system.program, assumption.condition):
                continue
            for part in conjuncts_of(system, assumption.condition):
                if self._is_own(part):
                    self._ask(AssumedPart(part, assumption.bound, at), tell)

    def _is_own(self, part: Conjunct) -> bool:
        """Return whether it is this robot that asks what a conjunct asks."""
        own = {robot for home, _, robot in part.places if home in (None, Home.LOCAL, Home.PORT)}
        return (own or {min(part.robots.values(), default=0)}) == {self._pid}

    def _ask(self, claim: Claim, tell: Tell) -> None:
        """Ask the host what a claim asks, whatever it cannot answer, and tell the answers."""

        def ask(
            phase: Phase,
            asking: int,
            key: Key,
            function: core.External,
            arguments: tuple[Concrete, ...],
        ) -> Concrete | None:
            value = self._answer(function, arguments)
            if value is not None:
                tell(Answer(phase, self._pid, key, function.name, arguments, value))
            return value

        system = self._translation.system
        inputs = OpenInputs(RecordedInputs(), system.robots, ask)
        with suppress(CannotTellError, NotFiniteError):  # it hangs on what the host does not know
            claim.holds(PARTIALS, system, inputs)

    def _answer(self, function: core.External, arguments: tuple[Concrete, ...]) -> Concrete | None:
        if function.name in self._unanswered:
            return None
        given = tuple(map(to_plain, arguments))
        try:
            answer = self._host.ask(Turn.ENV, self._pid, (), function.name, given)
            return to_value(answer, function.result.type)
        except (LookupError, KoordError):
            self._unanswered.add(function.name)
            return None
