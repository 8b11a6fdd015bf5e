"""Search for starts that meet assumptions and readings that meet contracts, by bounded trial."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable

from msgspec import Struct

from koord.sampling.compiled.turns import Turns
from koord.sampling.conjuncts import false_beforehand
from koord.sampling.sampled_inputs import SampledInputs
from koord.semantics.configurations import Configuration, Robot
from koord.semantics.domain import Constant, Domain
from koord.semantics.environment import environment_turn
from koord.semantics.expressions import statement
from koord.semantics.machine import Legality, Machine
from koord.semantics.oracle import Phase
from koord.semantics.quantifiers import instances
from koord.semantics.rounds import Stepped, initialised
from koord.semantics.statements import machine
from koord.semantics.storage import contents, held, stored
from koord.syntax import core
from koord.syntax.core import BinaryOp, Direction, Home, QuantifierKind
from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.system import System

#: So many initial configurations are tried before the assumptions count as not to be met.
START_TRIES = 3000

#: So many readings of one robot's sensors are tried in one round.
READING_TRIES = 500

#: After so many tries without progress the search begins anew somewhere else.
_PATIENCE = 150


# --- INIT ---------------------------------------------------------------------------------------


def settled_start(
    d: Domain[Constant],
    system: System,
    inputs: SampledInputs,
    order: tuple[int, ...],
    turns: Turns | None = None,
) -> Stepped[Constant]:
    """INIT with starts that meet the assumptions. Raises KoordError if none are found. [INIT]

    One start at a time is mended or drawn anew, and kept if no more parts of the assumptions break.
    Of all but the first it is asked by the code of ``turns``, where it is certain.
    """
    stepped = initialised(d, system, inputs, order)
    best, waiting = _broken(d, system, stepped.configuration, inputs), 0
    false = false_beforehand(d, system, stepped.configuration) if best else None
    if false is not None:
        raise refusal(
            "K920",
            false.span,
            f"this assumption is false of {system.fleet}, whatever the variables start with",
            "choose other `robots=` or `params=`, or mend the assumption",
        )
    most = inputs.sampler.start_tries
    for _ in range(START_TRIES if most is None else most):
        if not best:
            return stepped
        if all(map(inputs.is_given, inputs.starts)) and not inputs.answers:
            break
        before, kept = (dict(inputs.starts), dict(inputs.answers)), stepped
        restart = waiting == _PATIENCE
        _vary(d, system, stepped.configuration, inputs, turns, everything=restart)
        stepped = initialised(d, system, inputs, order)
        broken = _broken(d, system, stepped.configuration, inputs, turns)
        if restart or broken <= best:
            waiting = 0 if restart or broken < best else waiting + 1
            best = broken
        else:
            inputs.starts, inputs.answers = before
            stepped = kept
            waiting += 1
    if best:
        raise _no_start(d, system, stepped.configuration, inputs)
    return stepped


def _vary(
    d: Domain[Constant],
    system: System,
    configuration: Configuration[Constant],
    inputs: SampledInputs,
    turns: Turns | None,
    *,
    everything: bool,
) -> None:
    """Change some variables' starts: as an assumption suggests, or at random."""
    from koord.sampling.constraint_guesses import placed, repairs

    keys = [key for key in inputs.starts if not inputs.is_given(key)]
    rng = inputs.sampler.rng
    if not everything and inputs.sampler.chance(70):
        found = [
            repair
            for position, assumption in enumerate(system.program.assumptions)
            # What holds needs no repair.
            if turns is None or turns.missed(configuration, position) != 0
            for repair in repairs(
                _looking(d, system, configuration, assumption.bound, inputs), assumption.condition
            )
            if (repair.home, repair.slot, repair.robot) in keys
        ]
        if found:
            repair = rng.choice(found)
            key = repair.home, repair.slot, repair.robot
            inputs.starts[key] = placed(inputs.starts[key], repair.path, repair.value)
            return
    inputs.forget_answers()
    for key in keys if everything else keys and [rng.choice(keys)]:
        inputs.redraw(key)


def unmet(
    d: Domain[Constant],
    system: System,
    configuration: Configuration[Constant],
    inputs: SampledInputs,
) -> core.Assumption | None:
    """The first assumption that does not hold, or None."""
    for assumption in system.program.assumptions:
        m = _looking(d, system, configuration, assumption.bound, inputs)
        if not statement(m, assumption.condition):
            return assumption
    return None


def _broken(
    d: Domain[Constant],
    system: System,
    configuration: Configuration[Constant],
    inputs: SampledInputs,
    turns: Turns | None = None,
) -> int:
    """Count the conjuncts of the assumptions that do not hold, by code where there is some."""
    total = 0
    for position, assumption in enumerate(system.program.assumptions):
        missed = None if turns is None else turns.missed(configuration, position)
        if missed is None:
            m = _looking(d, system, configuration, assumption.bound, inputs)
            missed = misses(m, assumption.condition)
        total += missed
    return total


def _looking(
    d: Domain[Constant],
    system: System,
    configuration: Configuration[Constant],
    bound: int,
    inputs: SampledInputs,
) -> Machine[Constant]:
    return machine(d, system, inputs.oracle(Phase.CHECK, 0), bound=bound, view=configuration)


def misses(m: Machine[Constant], e: core.Expr) -> int:
    """Count the conjuncts and instances of a statement that fail: 0 if and only if it holds."""
    match e:
        case core.Binary(op=BinaryOp.AND, left=left, right=right):
            return misses(m, left) + misses(m, right)
        case core.Binary(op=BinaryOp.IMPLIES, left=left, right=right):
            # A condition that faults makes the whole false, and an inner one too.
            return misses(m, right) if statement(m, left) else int(not statement(m, e))
        case core.Quantified(
            quantifier=QuantifierKind.FORALL,
            domain=core.RobotRange() | core.IntRange() | core.Elements(),
        ):
            total = 0
            for label, here, value in list(instances(m, e)):
                if here:
                    m.memory.bound[e.variable.slot] = held(m.d, value)
                    m.trail.append(label)
                    total += misses(m, e.body)
                    m.trail.pop()
            # What it ranges over may fault; then it does not hold either.
            return total or int(not statement(m, e))
        case _:
            return int(not statement(m, e))


def _no_start(
    d: Domain[Constant],
    system: System,
    configuration: Configuration[Constant],
    inputs: SampledInputs,
) -> KoordError:
    assumption = unmet(d, system, configuration, inputs)
    assert assumption is not None
    # Those without a name were given one that no reader of the program knows.
    named = not re.fullmatch(r"assume_\d+", assumption.name)
    name = f"the assumption {assumption.name}" if named else "this assumption"
    tries = f"in {START_TRIES} tries " if inputs.starts or inputs.answers else ""
    return refusal(
        "K920",
        assumption.span,
        f"no initial configuration was found {tries}that meets {name}",
        "give the variables initial values that meet it, or see with `koord verify` whether the "
        "assumptions are contradictory",
    )


# --- sensors ------------------------------------------------------------------------------------


def settle_readings(
    d: Domain[Constant],
    system: System,
    configuration: Configuration[Constant],
    inputs: SampledInputs,
    keeps: Callable[[int], bool] | None = None,
) -> None:
    """Find readings that every contract allows. Raises KoordError if none are found. [ENV-FREE]

    First what a vehicle would read, then the readings before the turn, then others, one by one.
    ``keeps`` says of a robot's readings that contracts allow them, or nothing.
    """
    inputs.look_at(configuration)
    for robot in range(len(configuration.robots)):
        settle_robot(d, system, configuration, robot, inputs, keeps)


def settle_robot(
    d: Domain[Constant],
    system: System,
    configuration: Configuration[Constant],
    robot: int,
    inputs: SampledInputs,
    keeps: Callable[[int], bool] | None = None,
) -> None:
    """Find the readings of one robot. Raises KoordError if none are found."""
    state, agent = configuration.robots[robot], system.agent(robot)
    free = [module for module in agent.modules if module.environment is None]
    for module in free:
        from koord.sampling.library import driven

        for port, value in driven(inputs.sampler, agent, module, state).items():
            if not inputs.is_given((robot, port)):
                inputs.readings[robot, port] = value
    if any(module.contracts for module in free) and (keeps is None or not keeps(robot)):
        _Search(d, system, inputs, configuration.round, robot, state).run(free)


class _Search(Struct):
    """The search for one robot's readings in one round."""

    d: Domain[Constant]
    system: System
    inputs: SampledInputs
    round: int
    robot: int
    state: Robot[Constant]

    def run(self, modules: list[core.Module]) -> None:
        ports = self.system.agent(self.robot).ports
        sensors = [
            ports[position]
            for module in modules
            for position in module.ports
            if ports[position].direction is Direction.SENSOR
            and not self.inputs.is_given((self.robot, ports[position].declaration.variable.slot))
        ]
        broken = best = self.unkept()
        often = Counter(needed.what for needed in broken)
        for attempt in range(READING_TRIES):
            if not broken:
                return
            if not sensors:
                break
            before = dict(self.inputs.readings)
            anew = attempt % _PATIENCE == 0
            if anew or not self.mend():
                for port in sensors if anew else [self.inputs.sampler.rng.choice(sensors)]:
                    self.redraw(port, keep=attempt == 0)
            broken = self.unkept()
            often.update(needed.what for needed in broken)
            if anew or len(broken) <= len(best):
                best = broken
            else:
                self.inputs.readings = before
        if broken:
            raise self.no_reading(max(broken, key=lambda needed: often[needed.what]))

    def redraw(self, port: core.Port, *, keep: bool) -> None:
        """Draw a new reading of a sensor, or keep its last one."""
        variable, sampler = port.declaration.variable, self.inputs.sampler
        last, is_set = contents(self.d, self.state.ports[variable.slot], variable.type)
        key = self.robot, variable.slot
        if is_set and (keep or sampler.chance(25)):
            self.inputs.readings[key] = last
            return
        known = self.inputs.around(self.robot, variable.type)
        self.inputs.readings[key] = sampler.value(
            variable.type, [last, last, *known] if is_set else known
        )

    def mend(self) -> bool:
        """Now and then change a sensor's reading to a value that a contract suggests."""
        from koord.sampling.constraint_guesses import placed, repairs

        if not self.inputs.sampler.chance(60):
            return False
        agent = self.system.agent(self.robot)
        after = list(self.state.ports)
        for (robot, slot), value in self.inputs.readings.items():
            if robot == self.robot:
                type_ = agent.ports[slot].declaration.variable.type
                after[slot] = stored(self.d, type_, value, self.system.robots)
        oracle = self.inputs.oracle(Phase.ENV, self.robot)
        ports = self.state.ports
        found = []
        for module in agent.modules:
            for contract in module.contracts if module.environment is None else ():
                m = machine(
                    self.d,
                    self.system,
                    oracle,
                    robot=self.robot,
                    ports=ports,
                    after=tuple(after),
                    bound=contract.bound,
                )
                if all(statement(m, e) for e in contract.requires):
                    found += [r for e in contract.ensures for r in repairs(m, e)]
        found = [
            repair
            for repair in found
            if repair.home is Home.PORT
            and (self.robot, repair.slot) in self.inputs.readings
            and not self.inputs.is_given((self.robot, repair.slot))
        ]
        if not found:
            return False
        repair = self.inputs.sampler.rng.choice(found)
        key = self.robot, repair.slot
        old = self.inputs.readings[key]
        self.inputs.readings[key] = placed(old, repair.path, repair.value)
        return True

    def unkept(self) -> list[Legality[Constant]]:
        """The contracts that the readings do not satisfy."""
        turned = environment_turn(self.d, self.system, self.robot, self.state, self.inputs)
        return [needed for needed in turned.legality if self.d.known(needed.condition) is not True]

    def no_reading(self, broken: Legality[Constant]) -> KoordError:
        return refusal(
            "K922",
            broken.span,
            f"no reading of robot {self.robot} in round {self.round + 1} was found in "
            f"{READING_TRIES} tries that keeps {broken.what}",
            "give the module an `environment:` block, or see with `koord verify` whether its "
            "contracts are contradictory",
        )
