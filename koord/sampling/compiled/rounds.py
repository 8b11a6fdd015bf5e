"""Whole rounds as code, which changes a state in place. [SELECT]

A round is made as far as nothing is in doubt. What was done by then stands, and the rules go on
from there: it is said at which stage the round halted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random
from typing import Any

from koord.sampling.compiled.asking import Asking
from koord.sampling.compiled.claims import unit_of
from koord.sampling.compiled.halts import Halt, Schedule, Stage
from koord.sampling.compiled.operations import InDoubt
from koord.sampling.compiled.round_claims import Claims
from koord.sampling.compiled.round_log import LoggedState, RoundLog
from koord.sampling.compiled.round_text import RoundText
from koord.sampling.compiled.state import State
from koord.semantics.configurations import NO_EVENT, Configuration
from koord.semantics.domain import Constant, Domain
from koord.semantics.oracle import Inputs, Phase
from koord.syntax import core
from koord.syntax.system import Status, System


class RoundCode:
    """The rounds of a system as code. Raises NoCodeError where there is none.

    ``state`` has to show a configuration between two rounds; :meth:`play` changes it.
    """

    def __init__(
        self,
        d: Domain[Constant],
        system: System,
        schedule: Schedule,
        claims: Claims,
        unit: int | None,
    ) -> None:
        self.system = system
        self.schedule = schedule
        self.claims = claims
        self.unit = unit
        self.state = State(d, system, unit)
        self._turns: list[Any] = []
        self._environment: list[Any] = []
        self.ran_before: list[int] = [NO_EVENT] * system.robots
        self._asking: dict[Phase, list[Any]] = {Phase.PROG: [], Phase.ENV: []}
        text = RoundText(self.state, schedule, claims)
        self.logged = LoggedState(self.state, text.columns)
        #: Whether the environment's turn is left to the rules.
        self.senses = text.senses
        self._values = text.names.values
        self._values |= {
            "log": self._turns,
            "env_log": self._environment,
            "ask_prog": self._asking[Phase.PROG],
            "ask_env": self._asking[Phase.ENV],
        }
        self._play: Callable[[], tuple[int, int, int | None]] = text.names.made("play")
        self._end: Callable[[], bool] = text.names.made("end")
        self._holds: Callable[[], bool] = text.names.made("holds")

    def serve(self, inputs: Inputs[Constant], rng: Random | None, skips_percent: int) -> None:
        """Ask these inputs from now on, draw by this generator, and skip so often at random."""
        for phase, asking in self._asking.items():
            asking[:] = [
                Asking(self.state.d, self.system, phase, robot, inputs)
                for robot in range(self.system.robots)
            ]
        if rng is not None:
            self._values["bits"] = rng.getrandbits
        self._values["percent"] = skips_percent

    def holds(self) -> bool:
        """Return whether code can tell that all claims hold in the state."""
        return _told(self._holds)

    def end(self) -> bool:
        """As :meth:`holds`, where only an environment's turn was taken since they did."""
        return _told(self._end)

    def seek(self, sought: Sequence[core.Expr]) -> None:
        """Look for these from now on, of all that were sought at first."""
        wanted = [f"sought_{self.claims.sought.index(one)}" for one in sought]
        self._values["sought"][:] = [self._values[name] for name in wanted]

    def play(self) -> Halt:
        """Make a round, as far as nothing is in doubt."""
        self.close()
        halt = Halt(*self._play())
        if halt.stage == Stage.WHOLE:
            self.state.round += 1
        return halt

    def close(self) -> None:
        """Forget what the last round did."""
        self._turns.clear()
        self._environment.clear()
        self.ran_before[:] = self.state.ran.values

    @property
    def log(self) -> RoundLog:
        """What the last round did, if it is not closed."""
        return RoundLog(tuple(self._turns), tuple(self._environment))

    @property
    def anyone_runs(self) -> bool:
        """Return whether a robot runs events."""
        return int(Status.RUNNING) in self.state.status.values

    def undo_environment(self) -> None:
        """Undo what models did in a round that halted among them, or at its end."""
        self.logged.undo(RoundLog((), tuple(self._environment)))
        self._environment.clear()

    def undo_turn(self) -> None:
        """Undo the last program turn of a round that halted after it."""
        self.logged.undo(RoundLog((self._turns.pop(),)))

    @property
    def round(self) -> int:
        """How many rounds are over."""
        return self.state.round

    def configuration(self) -> Configuration[Constant]:
        """The configuration before what the log has."""
        return self.before(self.log, self.ran_before)

    def before(self, log: RoundLog, ran: Sequence[int]) -> Configuration[Constant]:
        """The configuration before a log that led to the present state, with what robots ran."""
        kept, number = list(self.state.ran.values), self.state.round
        self.logged.undo(log)
        self.state.ran.values[:] = ran
        if log.environment:
            self.state.round -= 1
        configuration = self.state.configuration()
        self.logged.redo(log)
        self.state.ran.values[:] = kept
        self.state.round = number
        return configuration


def _told(says: Callable[[], bool]) -> bool:
    try:
        return says()
    except (InDoubt, ArithmeticError):
        return False


def usual_unit(d: Domain[Constant], system: System) -> int | None:
    """A unit of which all constant floats of a system are whole numbers."""
    return unit_of(d, system, system.program)
