"""Dead ends: runs that cannot go on, as no readings meet all contracts. [ENV-CONTRACT]

What would come after is not looked at by anybody. First it is asked whether there are any ports at
all that leave a robot's environment no turn, which most often there are not; if so, a few runs show
whether robots get there. That no reading will do is then for a solver to say.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import field

from koord.semantics.configurations import NO_EVENT, Robot, Store
from koord.semantics.domain import conjunction
from koord.semantics.environment import environment_turn
from koord.semantics.storage import stored
from koord.syntax import core
from koord.syntax.core import Direction, UnaryOp
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import Status, System
from koord.syntax.types import is_flat
from koord.syntax.walk import reached
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.solver import Solver, SolverAnswer
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.encoding.terms import Term, Terms
from koord.verify.encoding.unknowns import Symbolic, Unknowns
from koord.verify.vacuity.reachability import runs_of
from koord.verify.verdicts import Emptiness, Vacuity

#: What it may cost to see whether ports can be such, for each robot that is asked about; what the
#: answer for certain ports may cost; how long runs are, in turns of robots, and what they may cost.
_PORTS_S = 0.005
_READINGS_S = 0.5
_TURNS = 600
_RUNS_S = 1.0


def dead_end(system: System, deadline: Deadline, seed: int) -> Vacuity | None:
    """A run that ends because no readings meet the contracts, if one is found."""
    if not any(_may_end(system, robot, deadline, seed) for robot in _asked(system)):
        return None
    soon = deadline.sooner(_RUNS_S)
    for run, play in runs_of(system, _TURNS // system.robots, seed):
        try:
            for _ in play.steps():
                if soon.passed():
                    return None
        except KoordError:
            for robot, state in enumerate(run.configuration.robots):
                if not _has_readings(system, robot, state, deadline, seed):
                    where = f"robot {robot} in round {run.round + 1} of some run"
                    detail = f"no turn of the environment meets those of {where}, which ends there"
                    return Vacuity(Emptiness.CONTRACTS, "", detail, certain=False)
    return None


def _asked(system: System) -> Iterator[int]:
    """The first robot of each kind, and the last: contracts may mention their numbers."""
    for kind in sorted(set(system.kinds)):
        robots = [robot for robot, other in enumerate(system.kinds) if other == kind]
        yield from sorted({robots[0], robots[-1]})


class _Readings(SymbolicInputs):
    """Symbolic inputs with fixed readings."""

    given: dict[int, Symbolic] = field(default_factory=dict)

    def sensor(self, robot: int, port: core.Port) -> Symbolic:
        return self.given[port.declaration.variable.slot]


def _may_end(system: System, robot: int, deadline: Deadline, seed: int) -> bool:
    """Return whether some ports of a robot, reachable or not, admit no readings."""
    agent = system.agent(robot)
    contracts = [contract for module in agent.modules for contract in module.contracts]
    models = any(module.environment is not None for module in agent.modules)
    types = [port.declaration.variable.type for port in agent.ports]
    below = reached(system.program, tuple(contracts))
    open_ = any(isinstance(node, core.ExternalCall | core.Choose) for node in below)
    if not contracts or models or open_ or not all(map(is_flat, types)):
        return False
    d = Terms(system.budget)
    unknowns = Unknowns(d, system.program, system.robots)
    values = [(x.declaration.variable, x.declaration.length) for x in agent.ports]
    ports = tuple(
        stored(d, v.type, unknowns.value(v.name, v.type, length), system.robots)
        for v, length in values
    )
    store: Store[Term] = Store((), ())
    state = Robot(system.kinds[robot], (), ports, store, int(Status.RUNNING), NO_EVENT)
    sensors = [port for port in agent.ports if port.direction is Direction.SENSOR]
    slots = [port.declaration.variable.slot for port in sensors]

    def unmet(values: Sequence[Symbolic]) -> Term:
        inputs = _Readings(unknowns, "readings", given=dict(zip(slots, values, strict=True)))
        turned = environment_turn(d, system, robot, state, inputs)
        return d.unary(UnaryOp.NOT, conjunction(d, [x.condition for x in turned.legality]))

    ended = unknowns.every([port.declaration.variable.type for port in sensors], unmet)
    effort = Effort.of_seconds(_PORTS_S)
    return Solver(d, unknowns, seed).check([ended], deadline, effort) is SolverAnswer.SAT


def _has_readings(
    system: System, robot: int, state: Robot[Term], deadline: Deadline, seed: int
) -> bool:
    """Return whether some readings meet a robot's contracts, as far as is known."""
    d = Terms(system.budget)
    unknowns = Unknowns(d, system.program, system.robots)
    turned = environment_turn(d, system, robot, state, SymbolicInputs(unknowns, "readings"))
    solver = Solver(d, unknowns, seed)
    question = [needed.condition for needed in turned.legality]
    answer = solver.check(question, deadline, Effort.of_seconds(_READINGS_S))
    return answer is not SolverAnswer.UNSAT or bool(unknowns.limits)
