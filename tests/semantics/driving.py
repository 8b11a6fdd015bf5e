"""Runs by hand, for tests: say who runs what, and look at what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

from koord.sampling.monitors import Monitor
from koord.sampling.policies import Play, Policy
from koord.sampling.running import ProgramTurn, Run, new_run
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.recordings import Step
from koord.syntax import core
from koord.syntax.source import Source
from koord.syntax.system import System, dealt
from koord.traces.names import Names
from koord.traces.rendering import show_output, show_storage
from koord.traces.trace import Numbers, Sources, Trace, traced
from tests.semantics.by_the_rules import ByTheRules

NO_TEXT = Sources(Source("built.krd", ""))


@dataclass
class Drive:
    """A run under the control of a test; values are asked for as a user would read them."""

    run: Run
    names: Names
    last: Step

    @property
    def configuration(self) -> Configuration[Constant]:
        return self.run.configuration

    # --- moving ---------------------------------------------------------------------------------

    def go(self, robot: int, event: str) -> Drive:
        """The robot runs the event. Raises IllegalStepError if it may not."""
        position = self.names.of(robot).events.index(event)
        self.last = self.run.make(ProgramTurn(robot, position))
        return self

    def skip(self, *robots: int) -> Drive:
        for robot in robots:
            self.last = self.run.make(ProgramTurn(robot, None))
        return self

    def env(self) -> Drive:
        self.last = self.run.evolve()
        return self

    def round(self, *events: str | None) -> Drive:
        """A whole round, robots in order."""
        for robot, event in enumerate(events):
            if event is None:
                self.skip(robot)
            else:
                self.go(robot, event)
        return self.env()

    def enabled(self, robot: int) -> list[str]:
        events = self.names.of(robot).events
        return [events[position] for position in self.run.enabled(robot)]

    # --- looking --------------------------------------------------------------------------------

    def shared(self, name: str) -> str:
        """A shared variable in the store."""
        store = self.configuration.store
        for named, storage in (
            *zip(self.names.allread, store.allread, strict=True),
            *zip(self.names.allwrite, store.allwrite, strict=True),
        ):
            if named.name == name:
                return show_storage(storage, named.type)
        raise AssertionError(name)

    def own(self, robot: int, name: str) -> str:
        """A local, a port (``Module.name``), or the robot's copy of a shared variable."""
        state, names = self.configuration.robots[robot], self.names.of(robot)
        for named, storage in (
            *zip(names.locals, state.locals, strict=True),
            *zip(names.ports, state.ports, strict=True),
            *zip(self.names.allread, state.copy.allread, strict=True),
            *zip(self.names.allwrite, state.copy.allwrite, strict=True),
        ):
            if named.name == name:
                return show_storage(storage, named.type)
        raise AssertionError(name)

    def each(self, name: str) -> list[str]:
        """A local or port of every robot."""
        return [self.own(robot, name) for robot in range(self.run.system.robots)]

    @property
    def output(self) -> list[str]:
        """What the last step wrote."""
        return [show_output(w.values, w.types) for w in self.last.stepped.output]

    def trace(self) -> Trace:
        return traced(NO_TEXT, self.run.system, self.run.numbers, self.run.recording())


def drive(
    program: core.Program,
    robots: int = 2,
    *,
    numbers: Numbers = Numbers.EXACT,
    seed: int = 0,
    order: tuple[int, ...] | None = None,
) -> Drive:
    """A run of a program, after INIT."""
    system = dealt(program, robots)
    run = new_run(system, numbers, Random(seed), ByTheRules(numbers.domain, system))
    return Drive(run, Names(system), run.begin(order))


def played(
    program: core.Program,
    policy: Policy,
    *,
    robots: int = 3,
    rounds: int = 5,
    numbers: Numbers = Numbers.EXACT,
    rng: Random | None = None,
    system: System | None = None,
) -> tuple[Play, Trace]:
    """A run by a policy, to its end, and its trace."""
    system = system if system is not None else dealt(program, robots)
    turns = ByTheRules(numbers.domain, system)
    run = new_run(system, numbers, rng if rng is not None else Random(0), turns)
    play = Play(run, policy, rounds, Monitor(run.d, system, run.inputs))
    for _ in play.steps():
        pass
    return play, traced(NO_TEXT, system, numbers, play.recording(), play.violation)
