"""The environment's turn of one robot: its ports from one round to the next. [ENV-TRANS]"""

from __future__ import annotations

from typing import Generic, TypeVar

from msgspec import Struct

from koord.semantics.configurations import Fault, Robot
from koord.semantics.domain import Domain, conjunction
from koord.semantics.expressions import statement
from koord.semantics.machine import Legality, Machine
from koord.semantics.oracle import Inputs, Phase
from koord.semantics.statements import machine, run
from koord.semantics.storage import Storage, stored
from koord.syntax import core
from koord.syntax.core import BinaryOp, Direction
from koord.syntax.system import System

V = TypeVar("V")


class Evolved(Struct, Generic[V], frozen=True):
    """The result of the environment's turn: a robot's ports, with contracts to prove.

    ``promises`` are contracts of modules that have a model: they are to be proved, not assumed.
    """

    ports: tuple[Storage[V], ...]
    faults: tuple[tuple[V, Fault], ...]
    legality: tuple[Legality[V], ...]
    promises: tuple[tuple[V, core.Contract], ...]


def environment_turn(
    d: Domain[V], system: System, robot: int, state: Robot[V], inputs: Inputs[V]
) -> Evolved[V]:
    """Take the environment's turn of one robot. [ENV-TRANS]"""
    m = moved(d, system, robot, state, inputs)
    promises = []
    for module in system.agent(robot).modules:
        for contract in module.contracts:
            kept = _kept(m, contract)
            if module.environment is not None:
                promises.append((kept, contract))
            else:
                m.require("ENV-CONTRACT", kept, f"contract {contract.name}", contract.span)
    return Evolved(tuple(m.memory.after), tuple(m.faults), tuple(m.legality), tuple(promises))


def moved(
    d: Domain[V], system: System, robot: int, state: Robot[V], inputs: Inputs[V]
) -> Machine[V]:
    """A machine with a robot's ports before and after its turn; no contract was looked at yet."""
    agent = system.agent(robot)
    m = machine(
        d,
        system,
        inputs.oracle(Phase.ENV, robot),
        robot=robot,
        ports=state.ports,
        after=state.ports,
    )
    m.in_environment = True
    for module in agent.modules:
        if module.environment is not None:
            # [ENV-MODEL]: reads are of the ports before, writes are of those after.
            m.memory.bound = [None] * module.environment_bound
            run(m, module.environment)
        else:
            _sense(m, agent, module, inputs, robot)
    return m


class Ports(Struct, Generic[V], frozen=True):
    """A robot's ports before and after the environment's turn."""

    before: tuple[Storage[V], ...]
    after: tuple[Storage[V], ...]


def contract_holds(
    d: Domain[V],
    system: System,
    robot: int,
    ports: Ports[V],
    contract: core.Contract,
    inputs: Inputs[V],
) -> V:
    """Return the condition that a contract holds by legal answers. [ENV-CONTRACT]"""
    oracle = inputs.oracle(Phase.ENV, robot)
    m = machine(d, system, oracle, robot=robot, ports=ports.before, after=ports.after)
    m.in_environment = True
    kept = _kept(m, contract)
    return conjunction(d, [kept, *(needed.condition for needed in m.legality)])


def _sense(
    m: Machine[V], agent: core.Agent, module: core.Module, inputs: Inputs[V], robot: int
) -> None:
    """Let a sensor without a model read any value. [ENV-FREE]"""
    for position in module.ports:
        port = agent.ports[position]
        if port.direction is Direction.SENSOR:
            variable = port.declaration.variable
            value = inputs.sensor(robot, port)
            m.memory.after[variable.slot] = stored(m.d, variable.type, value, m.system.size)


def _kept(m: Machine[V], contract: core.Contract) -> V:
    """Return the condition that ``requires`` before implies ``ensures`` after it. [ENV-CONTRACT]

    A statement that faults counts as false (decision record 0006).
    """
    m.memory.bound = [None] * contract.bound
    required = conjunction(m.d, [statement(m, e) for e in contract.requires])
    ensured = conjunction(m.d, [statement(m, e) for e in contract.ensures])
    return m.d.binary(BinaryOp.IMPLIES, required, ensured)
