"""Liveness to safety: fairness is met fewer than k times while a response is pending.

All of it are literals of one round, over the state at its start and its inputs. Where a guard asks
an external function, nothing is known of all of its answers: then its robot is not ready on the
strength of it, and asks for nothing. That makes more runs fair, never fewer.

[T-COUNT] See Claessen and Sörensson, *A liveness checking algorithm that counts* (2012).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.liveness import Response, expected, locks_of, responses
from koord.semantics.turns import guard_of
from koord.syntax import core
from koord.syntax.core import PropertyKind
from koord.syntax.system import Status, System
from koord.syntax.types import BOOL
from koord.syntax.walk import asks as leaves_open
from koord.verify.claims import Claim, ClaimKind
from koord.verify.effort import Deadline
from koord.verify.encoding.choices import differs
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.engines.bits.circuit import Circuit, Latch, circuit_of
from koord.verify.engines.bits.clauses import OTHER, QUICK, Clauses
from koord.verify.engines.bits.constraint_selection import related
from koord.verify.engines.bits.domain import BitDomain, Bits, literal
from koord.verify.engines.bits.graph import FALSE, TRUE, Graph
from koord.verify.engines.bits.ic3 import SafetyQuery, reduced


class Condition(Struct, frozen=True):
    """A fairness condition that a fair run meets infinitely often: ``met`` in a round.

    ``kind`` is the fairness that it belongs to: robots, or the name of an expectation.
    """

    kind: str
    name: str
    met: int


class Grant(Struct, frozen=True):
    """A strong fairness condition: granted infinitely often if it is asked for infinitely often."""

    name: str
    asked: int
    granted: int


class MonitoredCircuit(Struct, frozen=True):
    """A circuit with monitors of one response.

    The latches of ``circuit`` include those of the monitors. ``pending`` holds of a round if the
    trigger came and the goal did not, up to its start. ``waiting`` knows that of the rounds
    before, and ``owed`` the same of what is expected.
    """

    circuit: Circuit
    pending: int
    waiting: Latch
    owed: tuple[Latch, ...]
    conditions: tuple[Condition, ...]
    grants: tuple[Grant, ...]

    def resting_on(self, kinds: Sequence[str]) -> MonitoredCircuit:
        """The same circuit with conditions of some kinds only, which makes more runs fair."""
        return replace(self, conditions=tuple(c for c in self.conditions if c.kind in kinds))


#: What no run does.
NOTHING = Response(
    "nothing",
    None,
    None,
    core.Property("nothing", PropertyKind.AT_ROUND, core.Const(False, BOOL), 0),
)


def statements_of(system: System, stated: Sequence[core.Property]) -> tuple[Claim, ...]:
    """All statements that are evaluated on the states of a circuit."""
    asked = [r for p in stated for r in responses(system, p)] + list(expected(system))
    return tuple(dict.fromkeys(_claim(s) for r in asked for s in r.statements))


def _claim(statement: core.Property) -> Claim:
    return Claim(statement.name, ClaimKind.PROPERTY, statement)


class Watching(Struct):
    """A system's circuit, to which monitors of responses are added one after the other."""

    system: System
    circuit: Circuit
    asked: frozenset[Claim]

    @staticmethod
    def of(
        system: System, stated: Sequence[core.Property], lemmas: Sequence[Claim], level: int
    ) -> Watching:
        """Build the circuit. Raises NotFiniteError where a loop has no known bound."""
        claims = dict.fromkeys((*statements_of(system, stated), _claim(NOTHING.goal), *lemmas))
        return Watching(system, circuit_of(system, tuple(claims), level), frozenset(claims))

    @property
    def d(self) -> BitDomain:
        return self.circuit.d

    def watched(self, response: Response) -> MonitoredCircuit:
        """Add the monitors of one response to the circuit, and return it."""
        g = self.d.graph
        name = f"{response.name} pending"
        begun, latch = g.input(name), FALSE
        here = begun
        if response.trigger is None:
            latch = TRUE
        else:
            here = g.either(begun, self._held(response.trigger))
        pending = g.both(here, self._held(response.goal) ^ 1)
        waiting = Latch(name, begun, latch, pending)
        expecting: list[Latch] = []
        conditions = self._robots()
        for k, other in enumerate(expected(self.system)):
            whose = "" if other.robot is None else f"@{other.robot}"
            name = f"{other.name} owed {k if not whose else ''}{whose}"
            before = g.input(name)
            assert other.trigger is not None
            asked = g.either(before, self._held(other.trigger))
            owed = g.both(asked, self._held(other.goal) ^ 1)
            expecting.append(Latch(name, before, FALSE, owed))
            conditions.append(Condition(other.name, name, owed ^ 1))
        latches = (*self.circuit.latches, waiting, *expecting)
        watching = replace(self.circuit, latches=latches)
        return MonitoredCircuit(
            watching, pending, waiting, tuple(expecting), tuple(conditions), tuple(self._grants())
        )

    def _held(self, statement: core.Property) -> int:
        claim = _claim(statement)
        assert claim in self.asked
        # What cannot fail is not noted.
        return self.circuit.held.get(claim, TRUE)

    # --- robots and locks -----------------------------------------------------------------------

    def _robots(self) -> list[Condition]:
        g, found = self.d.graph, []
        for robot in range(self.system.robots):
            ready = g.any_of(on for on, _ in self._guards(robot))
            met = g.either(self._ran(robot, None), g.both(ready, self._running(robot)) ^ 1)
            found.append(Condition("robots", f"runs@{robot}", met))
        return found

    def _grants(self) -> list[Grant]:
        g, found = self.d.graph, []
        for robot, k in locks_of(self.system):
            events = self.system.agent(robot).events
            guards = self._guards(robot)
            pairs = list(zip(events, guards, strict=True))
            ready = g.any_of(on for on, _ in guards)
            others = g.any_of(may for e, (_, may) in pairs if k not in e.lock_classes)
            asked = g.all_of([ready, self._running(robot), others ^ 1])
            found.append(Grant(f"lock {k}@{robot}", asked, self._ran(robot, k)))
        return found

    def _guards(self, robot: int) -> list[tuple[int, int]]:
        """For each event, the literals that its guard surely holds, and that it may hold."""
        d, circuit, found = self.d, self.circuit, []
        d.opaques.part = 1
        for event in self.system.agent(robot).events:
            if leaves_open(self.system.program, event.guard):
                found.append((FALSE, TRUE))
                continue
            state = cast(Any, circuit.start.robots[robot])
            inputs = SymbolicInputs(cast(Any, circuit.unknowns[1]), "guards")
            holds, sound = guard_of(cast(Any, d), self.system, robot, state, event, inputs)
            on, whole = literal(cast(Bits, holds)), literal(cast(Bits, sound))
            found.append((on, d.graph.either(on, whole ^ 1)))
        return found

    def _running(self, robot: int) -> int:
        status = cast(Any, self.circuit.start.robots[robot].status)
        return literal(cast(Bits, differs(cast(Any, self.d), status, Status.STOPPED)))

    def _ran(self, robot: int, k: int | None) -> int:
        """The literal that a robot runs an event, or one of a lock class."""
        events = self.system.agent(robot).events
        return self.d.graph.any_of(
            literal(cast(Bits, o.chosen))
            for o in self.circuit.round.options
            if o.robot == robot and (k is None or k in events[o.position].lock_classes)
        )


class Counting(Struct, frozen=True):
    """The counting problem: a part of a circuit, fairness conditions, and the rounds that count.

    ``met`` are the conditions of fairness by name; ``on`` holds of rounds that count.
    """

    graph: Graph
    latches: tuple[Latch, ...]
    opens: int
    steps: int
    whole: int  #: the same with all constraints, and what is lost then
    lost: int
    given: tuple[int, ...]
    met: tuple[tuple[str, int], ...]
    pending: int
    settled: tuple[Latch, ...]  #: in the order in which they settle
    on: int  #: pending, and nothing that settles changes


def counting(
    watched: MonitoredCircuit, given: Sequence[int], *, locks: bool, narrow: bool
) -> Counting:
    """Make the counting problem of a response.

    Without ``locks`` that of locks is left out, and with ``narrow`` constraints that hardly matter:
    both allow more runs.
    """
    circuit = watched.circuit
    g, pending = circuit.d.graph, watched.pending
    latches = list(circuit.latches)
    met = [(condition.name, condition.met) for condition in watched.conditions]
    required: list[int] = []
    for grant in watched.grants if locks else ():
        name = f"{grant.name} is asked for no more"
        before = g.input(name)
        over = g.either(before, g.input(f"{name}, from now on"))
        latches.append(Latch(name, before, FALSE, g.both(over, pending)))
        required.append(g.both(over, grant.asked) ^ 1)
        met.append((grant.name, g.either(over, grant.granted)))
    roots = [pending, *(now for _, now in met), *required, *given]
    steps = whole = g.all_of([circuit.steps, *required])
    if narrow:
        kept, inputs = related(circuit, latches, [*roots, circuit.lost])
        steps = g.all_of([*kept, *required])
        mine = tuple(latch for latch in latches if latch.literal >> 1 in inputs)
    else:
        mine = reduced(latches, g.cone, [*roots, steps])
    settled = tuple(settling(g, mine, [steps, pending, *given]))
    changed = g.any_of(g.differ(x.literal, x.next) for x in settled)
    on = g.both(pending, changed ^ 1)
    lost = g.both(circuit.lost, steps)
    known = tuple(given)
    return Counting(
        g, mine, circuit.opens, steps, whole, lost, known, tuple(met), pending, settled, on
    )


def settling(g: Graph, latches: Sequence[Latch], required: Sequence[int]) -> list[Latch]:
    """Find bits that change finitely often in each run, once those before them have settled.

    Each of them never rises, or never falls, in a round in which the ones before do not change.
    """
    clauses = Clauses(g, QUICK)
    for must in required:
        clauses.require(must)
    pending = {latch: (clauses.of(latch.literal), clauses.of(latch.next)) for latch in latches}
    found: list[Latch] = []
    while True:
        before = len(found)
        for latch, (now, then) in list(pending.items()):
            if clauses.solve([now, -then]) and clauses.solve([-now, then]):
                continue
            found.append(latch)
            del pending[latch]
            clauses.add([-now, then])
            clauses.add([now, -then])
        if len(found) == before:
            clauses.close()
            return found


def settles(of: Counting, deadline: Deadline) -> bool:
    """Return whether the settling bits do settle, by another solver with all constraints."""
    clauses = Clauses(of.graph, OTHER, deadline)
    for must in (of.whole, of.pending, *of.given):
        clauses.require(must)
    for latch in of.settled:
        now, then = clauses.of(latch.literal), clauses.of(latch.next)
        if clauses.solve([now, -then]) and clauses.solve([-now, then]):
            return False
        clauses.add([-now, then])
        clauses.add([now, -then])
    clauses.close()
    return True


def counted(of: Counting, times: int) -> SafetyQuery:
    """The query whether fairness can be met so many times while the count goes on."""
    g, on = of.graph, of.on
    latches = list(of.latches)
    # One after the other, one in each round: what is known of the first may rule out the next.
    seen, behind = [], TRUE
    for name, now in of.met:
        before = g.input(f"{name} met")
        seen.append((f"{name} met", before, g.either(before, g.both(behind, now))))
        behind = before
    all_seen = seen[-1][2] if seen else TRUE
    for name, before, now in seen:
        latches.append(Latch(name, before, FALSE, g.all_of([on, all_seen ^ 1, now])))
    reached = TRUE
    for number in range(1, times + 1):
        before = g.input(f"met {number} times")
        after = g.either(before, g.both(all_seen, reached))
        latches.append(Latch(f"met {number} times", before, FALSE, g.both(on, after)))
        reached = before
    bad = g.either(reached, of.lost)
    return SafetyQuery(tuple(latches), of.opens, of.steps, bad, of.given)
