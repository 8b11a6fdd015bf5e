"""Inquiries: what the contracts of a robot ask, asked of its own host as it happens. [RECORDING]

A robot's program asks its host nothing of what only contracts mention. Asked in the moment in
which the sensors were read, the host of a vehicle knows the answers, and the judge needs not
presume any.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from koord.refinement.completion import asking_contracts
from koord.refinement.open_answers import PARTIALS, CannotTellError, OpenInputs
from koord.refinement.translation import Translation, to_plain, to_value
from koord.runtime.robot import Host, Robot, Turn
from koord.semantics.domain import Constant
from koord.semantics.environment import Ports, contract_holds
from koord.semantics.every_number import NotFiniteError
from koord.semantics.oracle import Key, Phase
from koord.semantics.recordings import Answer, Concrete, RecordedInputs
from koord.semantics.storage import Storage
from koord.syntax import core
from koord.syntax.diagnostics import KoordError


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

    def make(
        self,
        before: tuple[Storage[Constant], ...],
        robot: Robot,
        tell: Callable[[Answer], None],
    ) -> None:
        """Ask the host what the contracts of a round ask, after the environment's turn."""

        def ask(
            phase: Phase,
            pid: int,
            key: Key,
            function: core.External,
            arguments: tuple[Concrete, ...],
        ) -> Concrete | None:
            value = self._answer(function, arguments)
            if value is not None:
                tell(Answer(phase, pid, key, function.name, arguments, value))
            return value

        system = self._translation.system
        ports: Ports[Any] = Ports(before, self._translation.held_ports(robot))
        inputs = OpenInputs(RecordedInputs(), system.robots, ask)
        for _, contract in self._contracts:
            try:
                contract_holds(PARTIALS, system, self._pid, ports, contract, inputs)
            except (CannotTellError, NotFiniteError):
                continue  # what hangs on an answer that the host does not have

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
