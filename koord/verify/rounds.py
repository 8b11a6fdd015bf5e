"""One round as one formula, of size O(robots · program). [T-COMMIT] [T-ONE-WINNER] [T-PREFIX]

Every robot's events run once on its snapshot, by the semantics' own turns on Z3 terms; Booleans say
which event each robot runs. Where the order of robots matters (writes to one location outside of
atomic blocks; urgent events that wait for a lock) Booleans say who comes before whom; elsewhere
there is no order at all. A robot that would lose a lock skips, so at most one robot enters a class.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from koord.semantics.configurations import (
    NO_EVENT,
    Configuration,
    Robot,
    Status,
    Store,
    System,
    Turn,
)
from koord.semantics.domain import conjunction, disjunction
from koord.semantics.masks import Mask, joined, restricted
from koord.semantics.races import overlap, rewritten
from koord.semantics.storage import Storage, merge_storage
from koord.semantics.turns import (
    Turned,
    declared,
    environment_turn,
    guard_of,
    initial_turn,
    program_turn,
)
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, UnaryOp
from koord.syntax.types import BOOL, INT
from koord.verify.claims import Findings, Phase
from koord.verify.footprint import Written, footprint, statuses, stops_show
from koord.verify.races import is_flat, precedes, racy_variables, winning
from koord.verify.symbols import SymbolicInputs, Unknowns
from koord.verify.terms import Term


@dataclass(frozen=True, slots=True)
class Option:
    """One event of one robot in a round: the Boolean that says it runs, and its turn."""

    robot: int
    position: int
    chosen: Term
    turned: Turned[Term]


@dataclass(slots=True)
class Moment:
    """A configuration at which properties are looked at, with what makes it one.

    ``constraints`` of all moments up to here hold together in every run that reaches it. ``fault``
    says that the step to here faulted: then the configuration is not looked at.
    ``real`` says when the configuration is one at all. ``checks`` answers what properties of it
    leave open.
    """

    phase: Phase
    configuration: Configuration[Term]
    constraints: list[Term]
    findings: Findings[Term]
    checks: SymbolicInputs
    real: Term = True


@dataclass(slots=True)
class Opening:
    """INIT with its unknowns."""

    inputs: SymbolicInputs
    before: dict[tuple[int, int], Term]
    moment: Moment


@dataclass(slots=True)
class SymbolicRound:
    """A round: the program turns, then the environment's, with the unknowns of both.

    ``urgency`` holds of whole rounds only: inside a round, robots that did not move yet may still
    have to. ``before[i, j]`` (i < j) says that i's turn came before j's; empty where no order is
    needed. ``inside`` is looked at where the end of the program turns is not enough: the
    configuration in which the robots that run no event have not moved yet. Where nobody runs, one
    of them has skipped: ``free[i]`` says that i may do so before anyone else has moved. [T-PREFIX]
    """

    options: list[Option]
    before: dict[tuple[int, int], Term]
    inputs: SymbolicInputs
    inside: Moment | None
    middle: Moment
    end: Moment
    urgency: list[Term]
    free: list[Term]


class Encoder:
    """Builds initial configurations and rounds of one system."""

    def __init__(self, system: System, unknowns: Unknowns) -> None:
        self.system = system
        self.unknowns = unknowns
        self.d = unknowns.d
        self._racy = racy_variables(system.program)
        self._urgent = any(e.urgent for a in system.program.agents for e in a.events)
        self._stops_show = stops_show(system.program)
        self._updates = rewritten(system.program)
        self._footprint = footprint(system.program)
        self._statuses = statuses(system.program)

    # --- configurations to start from -----------------------------------------------------------

    def initial(self) -> Opening:
        """The configuration after INIT. [INIT]"""
        d, robots = self.d, range(self.system.robots)
        inputs = SymbolicInputs(self.unknowns, "init")
        store, faults = declared(d, self.system, inputs)
        turns = [initial_turn(d, self.system, i, store, inputs) for i in robots]
        writers: dict[int, list[int]] = {}
        for i, turned in enumerate(turns):
            for slot in turned.allwrite:
                writers.setdefault(slot, []).append(i)
        racy = {slot for slot, who in writers.items() if len(who) > 1}
        before = self._order("init") if racy else {}
        always = d.const(True, BOOL)
        options = [Option(i, NO_EVENT, always, turned) for i, turned in enumerate(turns)]
        final = self._committed(store, options, before, racy)
        constraints = [*self._order_constraints(before)]
        constraints += [x.condition for turned in turns for x in turned.legality]
        found = [f for f, _ in faults] + [f for turned in turns for f, _ in turned.faults]
        states = tuple(replace(t.robot, copy=final, turn=Turn.PROG) for t in turns)
        configuration = Configuration(states, final, 0)
        return Opening(inputs, before, self._moment(Phase.INIT, configuration, constraints, found))

    def arbitrary(self, initial: Configuration[Term], label: str) -> Configuration[Term]:
        """Any configuration at the end of a round, reachable or not: where induction starts.

        It has in common with ``initial`` what no event ever changes.
        """
        program = self.system.program
        shared = {Home.ALLREAD: program.allread, Home.ALLWRITE: program.allwrite}
        stores = {Home.ALLREAD: initial.store.allread, Home.ALLWRITE: initial.store.allwrite}
        store = Store(
            *(
                tuple(
                    self._any(label, home, 0, declaration, before)
                    for declaration, before in zip(shared[home], stores[home], strict=True)
                )
                for home in (Home.ALLREAD, Home.ALLWRITE)
            )
        )
        robots = tuple(
            self._any_robot(i, state, store, label) for i, state in enumerate(initial.robots)
        )
        return Configuration(robots, store, 0)

    def _any(
        self,
        label: str,
        home: Home,
        kind: int,
        declaration: core.Declaration,
        before: Storage[Term],
    ) -> Storage[Term]:
        variable = declaration.variable
        written = self._footprint.get((home, kind, variable.slot), Written.NEVER)
        return self.unknowns.storage(f"{variable.name}{label}", variable.type, before, written)

    def _any_robot(
        self, robot: int, state: Robot[Term], store: Store[Term], label: str
    ) -> Robot[Term]:
        d, agent = self.d, self.system.agent(robot)
        status = d.fresh(f"status@{robot}", INT)
        ran = d.fresh(f"ran@{robot}", INT)
        possible = disjunction(
            d,
            [
                d.binary(BinaryOp.EQ, status, d.const(int(s), INT))
                for s in sorted(self._statuses[state.kind])
            ],
        )
        inside = [
            d.binary(BinaryOp.LE, d.const(NO_EVENT, INT), ran),
            d.binary(BinaryOp.LT, ran, d.const(len(agent.events), INT)),
        ]
        self.unknowns.constraints.append(conjunction(d, [possible, *inside]))
        where = f"@{robot}{label}"
        return replace(
            state,
            locals=tuple(
                self._any(where, Home.LOCAL, state.kind, declaration, before)
                for declaration, before in zip(agent.locals, state.locals, strict=True)
            ),
            ports=tuple(
                self._any(where, Home.PORT, state.kind, port.declaration, before)
                for port, before in zip(agent.ports, state.ports, strict=True)
            ),
            copy=store,
            status=status,
            ran=ran,
        )

    # --- rounds ---------------------------------------------------------------------------------

    def round(self, start: Configuration[Term], label: str) -> SymbolicRound:
        """One round from a configuration in which every robot is to move."""
        inputs = SymbolicInputs(self.unknowns, label)
        options = self._options(start, inputs, label)
        before = self._order(label) if self._racy else {}
        inside = self._program_turns(start, options, before)
        asked, middle = self._end_of_program_turns(inside)
        urgency = self._urgency(start, options, inputs) if self._urgent else []
        end = self._environment(middle.configuration, inputs)
        if not self._urgent and not self._stops_show:
            return SymbolicRound(options, before, inputs, None, middle, end, urgency, [])
        acting = self._acting(options)
        # A lone robot that skips has ended the program turns.
        free = self._free(start, inputs) if self.system.robots > 1 else []
        # Where everyone has moved and asked, nobody sees that they did not all stop yet; where
        # nobody has moved, the round before has not been left.
        ended = self.d.binary(BinaryOp.AND, conjunction(self.d, acting), asked)
        begun = disjunction(self.d, [*acting, *free])
        inside.real = self.d.binary(BinaryOp.AND, begun, self.d.unary(UnaryOp.NOT, ended))
        return SymbolicRound(options, before, inputs, inside, middle, end, urgency, free)

    def _free(self, start: Configuration[Term], inputs: SymbolicInputs) -> list[Term]:
        """Robot by robot, whether it may skip while no lock class is taken. [SKIP]"""
        d, free = self.d, []
        for i, state in enumerate(start.robots):
            urgent = [event for event in self.system.agent(i).events if event.urgent]
            obliged = [guard_of(d, self.system, i, state, e, inputs)[0] for e in urgent]
            running = self._differs(state.status, Status.STOPPED)
            waits = d.binary(BinaryOp.AND, running, disjunction(d, obliged))
            free.append(d.unary(UnaryOp.NOT, waits))
        return free

    def _acting(self, options: list[Option]) -> list[Term]:
        """Robot by robot, whether it runs an event."""
        return [
            disjunction(self.d, [o.chosen for o in options if o.robot == i])
            for i in range(self.system.robots)
        ]

    def _end_of_program_turns(self, inside: Moment) -> tuple[Term, Moment]:
        """Whether all robots stop now, and the configuration after that. [END-PROG] [STOP]"""
        d, robots = self.d, inside.configuration.robots
        asked = conjunction(d, [self._differs(r.status, Status.RUNNING) for r in robots])
        if d.known(asked) is not False:
            stopped = d.const(int(Status.STOPPED), INT)
            robots = tuple(replace(r, status=d.ite(asked, stopped, r.status)) for r in robots)
        configuration = replace(inside.configuration, robots=robots)
        checks = SymbolicInputs(self.unknowns, Phase.MIDDLE.value)
        return asked, Moment(
            Phase.MIDDLE, configuration, inside.constraints, inside.findings, checks
        )

    def _options(
        self, start: Configuration[Term], inputs: SymbolicInputs, label: str
    ) -> list[Option]:
        options = []
        for i, state in enumerate(start.robots):
            for position, event in enumerate(self.system.agent(i).events):
                chosen = self.d.fresh(f"{event.name}@{i}#{label}", BOOL)
                selectable, turned = program_turn(self.d, self.system, i, state, position, inputs)
                running = self._differs(state.status, Status.STOPPED)
                allowed = conjunction(
                    self.d, [selectable, running, *(x.condition for x in turned.legality)]
                )
                if self.d.known(allowed) is False:
                    continue
                self.unknowns.constraints.append(self.d.binary(BinaryOp.IMPLIES, chosen, allowed))
                options.append(Option(i, position, chosen, turned))
        return options

    def _program_turns(
        self,
        start: Configuration[Term],
        options: list[Option],
        before: dict[tuple[int, int], Term],
    ) -> Moment:
        """The configuration when robots have run the events they chose. [EVENT-TRANS]"""
        d = self.d
        constraints = self._one_event_each(options) + self._locks(options)
        constraints += self._order_constraints(before)
        store = self._committed(start.store, options, before, set(self._racy))
        robots = tuple(
            self._chosen_state(state, [o for o in options if o.robot == i])
            for i, state in enumerate(start.robots)
        )
        faults = [d.binary(BinaryOp.AND, o.chosen, f) for o in options for f, _ in o.turned.faults]
        configuration = Configuration(robots, store, start.round, Turn.ENV)
        lost = self._lost_updates(options)
        return self._moment(Phase.INSIDE, configuration, constraints, faults, lost=lost)

    def _moment(
        self,
        phase: Phase,
        configuration: Configuration[Term],
        constraints: list[Term],
        faults: list[Term],
        *,
        lost: Sequence[tuple[Term, str]] = (),
        promises: Sequence[tuple[Term, str]] = (),
    ) -> Moment:
        findings = Findings(disjunction(self.d, faults), tuple(lost), tuple(promises))
        checks = SymbolicInputs(self.unknowns, phase.value)
        return Moment(phase, configuration, constraints, findings, checks)

    def _one_event_each(self, options: list[Option]) -> list[Term]:
        """Each robot at most one event a round."""
        constraints: list[Term] = []
        for i in range(self.system.robots):
            mine = [o.chosen for o in options if o.robot == i]
            constraints += self._at_most_one(mine)
        return constraints

    def _locks(self, options: list[Option]) -> list[Term]:
        """At most one robot enters each lock class: who loses, skips. [ATOMIC] [T-ONE-WINNER]"""
        constraints: list[Term] = []
        for lock_class in self.system.program.lock_classes:
            entering: dict[int, list[Term]] = {}
            for o in options:
                entered = o.turned.entered.get(lock_class.index)
                if entered is not None:
                    both = self.d.binary(BinaryOp.AND, o.chosen, entered)
                    entering.setdefault(o.robot, []).append(both)
            constraints += self._at_most_one([disjunction(self.d, x) for x in entering.values()])
        return constraints

    def _at_most_one(self, conditions: Sequence[Term]) -> list[Term]:
        d = self.d
        return [
            d.unary(UnaryOp.NOT, d.binary(BinaryOp.AND, a, b))
            for a, b in combinations(conditions, 2)
        ]

    def _chosen_state(self, state: Robot[Term], options: list[Option]) -> Robot[Term]:
        """The robot after the event it chose, or after none. [END-EVENT] [SKIP]"""
        d = self.d
        locals_, ports = state.locals, state.ports
        status: Term = state.status
        ran: Term = d.const(NO_EVENT, INT)
        for o in options:
            after = o.turned.robot
            locals_ = self._merged(o.chosen, after.locals, locals_)
            ports = self._merged(o.chosen, after.ports, ports)
            status = d.ite(o.chosen, after.status, status)
            ran = d.ite(o.chosen, after.ran, ran)
        return replace(state, locals=locals_, ports=ports, status=status, ran=ran, turn=Turn.ENV)

    def _merged(
        self,
        condition: Term,
        then: tuple[Storage[Term], ...],
        other: tuple[Storage[Term], ...],
    ) -> tuple[Storage[Term], ...]:
        pairs = zip(then, other, strict=True)
        return tuple(merge_storage(self.d, condition, a, b) for a, b in pairs)

    def _differs(self, status: Term, other: Status) -> Term:
        return self.d.binary(BinaryOp.NE, status, self.d.const(int(other), INT))

    # --- writes ---------------------------------------------------------------------------------

    def _committed(
        self,
        store: Store[Term],
        options: list[Option],
        before: dict[tuple[int, int], Term],
        racy: set[int],
    ) -> Store[Term]:
        """The store after everybody's writes. [SHARED-ASSIGN] [T-COMMIT]"""
        allread = list(store.allread)
        for slot in range(len(allread)):
            for o in options:
                mask = restricted(self.d, o.turned.allread.get(slot), o.chosen)
                source = o.turned.robot.copy.allread[slot]
                allread[slot] = joined(self.d, allread[slot], source, mask)
        allwrite = list(store.allwrite)
        for slot, declaration in enumerate(self.system.program.allwrite):
            writes = [
                (o.robot, o.turned.robot.copy.allwrite[slot], mask)
                for o in options
                if (mask := restricted(self.d, o.turned.allwrite.get(slot), o.chosen)) is not None
            ]
            if slot not in racy:
                for _, source, mask in writes:
                    allwrite[slot] = joined(self.d, allwrite[slot], source, mask)
            elif is_flat(declaration.variable.type):
                allwrite[slot] = winning(self.d, allwrite[slot], writes, before)
            else:
                allwrite[slot] = self._in_order(allwrite[slot], writes, before)
        return Store(tuple(allread), tuple(allwrite))

    def _in_order(
        self,
        target: Storage[Term],
        writes: list[tuple[int, Storage[Term], Mask[Term]]],
        before: dict[tuple[int, int], Term],
    ) -> Storage[Term]:
        """Writes applied one place of the order after the other: for lists and maps that race."""
        d, robots = self.d, self.system.robots
        places = [self._place_of(i, before) for i in range(robots)]
        for place in range(robots):
            current = target
            for robot in sorted({robot for robot, _, _ in writes}):
                here = d.binary(BinaryOp.EQ, places[robot], d.const(place, INT))
                changed = current
                for writer, source, mask in writes:
                    if writer == robot:
                        changed = joined(d, changed, source, mask)
                target = (
                    merge_storage(d, here, changed, target)
                    if d.known(here) is None
                    else (changed if d.known(here) else target)
                )
        return target

    def _place_of(self, robot: int, before: dict[tuple[int, int], Term]) -> Term:
        """How many robots come before this one."""
        d = self.d
        count: Term = d.const(0, INT)
        for other in range(self.system.robots):
            if other != robot:
                earlier = precedes(d, other, robot, before)
                count = d.binary(
                    BinaryOp.ADD, count, d.ite(earlier, d.const(1, INT), d.const(0, INT))
                )
        return count

    def _lost_updates(self, options: list[Option]) -> list[tuple[Term, str]]:
        """Where one robot's update of an allwrite variable meets another's write. [LOST-UPDATE]"""
        found = []
        for slot, declaration in enumerate(self.system.program.allwrite):
            for mine in options:
                updates = self._updates.get((self.system.kinds[mine.robot], mine.position), ())
                if slot not in updates:
                    continue
                for other in options:
                    if other.robot == mine.robot:
                        continue
                    theirs, own = other.turned.allwrite.get(slot), mine.turned.allwrite.get(slot)
                    if theirs is not None and own is not None:
                        both = overlap(self.d, own, theirs)
                        met = conjunction(self.d, [mine.chosen, other.chosen, both])
                        if self.d.known(met) is not False:
                            found.append((met, declaration.variable.name))
        return found

    # --- order ----------------------------------------------------------------------------------

    def _order(self, label: str) -> dict[tuple[int, int], Term]:
        pairs = combinations(range(self.system.robots), 2)
        return {(i, j): self.d.fresh(f"{i}<{j}#{label}", BOOL) for i, j in pairs}

    def _order_constraints(self, before: dict[tuple[int, int], Term]) -> list[Term]:
        """``before`` is transitive. It is total and irreflexive by the way it is stored."""
        d = self.d
        if not before:
            return []
        constraints: list[Term] = []
        for i, j, k in combinations(range(self.system.robots), 3):
            ij, jk, ik = before[i, j], before[j, k], before[i, k]
            chain = d.binary(BinaryOp.AND, ij, jk)
            constraints.append(d.binary(BinaryOp.IMPLIES, chain, ik))
            constraints.append(d.binary(BinaryOp.IMPLIES, ik, d.binary(BinaryOp.OR, ij, jk)))
        return constraints

    def _urgency(
        self,
        start: Configuration[Term],
        options: list[Option],
        inputs: SymbolicInputs,
    ) -> list[Term]:
        """Who skips has no urgent event whose lock classes are free. [SKIP] [T-ONE-WINNER]

        Who skips writes nothing, so it may as well come last, when all classes are taken.
        """
        d = self.d
        constraints: list[Term] = []
        for i, state in enumerate(start.robots):
            acts = disjunction(d, [o.chosen for o in options if o.robot == i])
            running = self._differs(state.status, Status.STOPPED)
            for event in self.system.agent(i).events:
                if not event.urgent:
                    continue
                holds, _ = guard_of(d, self.system, i, state, event, inputs)
                taken = self._taken_by_others(i, event, options)
                waits = conjunction(d, [running, holds, d.unary(UnaryOp.NOT, taken)])
                constraints.append(d.binary(BinaryOp.IMPLIES, waits, acts))
        return constraints

    def _taken_by_others(self, robot: int, event: core.Event, options: list[Option]) -> Term:
        d = self.d
        taken = []
        for o in options:
            if o.robot != robot:
                for lock_class in event.lock_classes:
                    entered = o.turned.entered.get(lock_class)
                    if entered is not None:
                        taken.append(d.binary(BinaryOp.AND, o.chosen, entered))
        return disjunction(d, taken)

    # --- the environment ------------------------------------------------------------------------

    def _environment(self, middle: Configuration[Term], inputs: SymbolicInputs) -> Moment:
        """The configuration after the environment's turn. [ENV-TRANS] [REFRESH]"""
        d = self.d
        robots: list[Robot[Term]] = []
        constraints: list[Term] = []
        faults: list[Term] = []
        promises: list[tuple[Term, str]] = []
        for i, state in enumerate(middle.robots):
            turned = environment_turn(d, self.system, i, state, inputs)
            constraints += [x.condition for x in turned.legality]
            faults += [fault for fault, _ in turned.faults]
            promises += [(kept, contract.name) for kept, contract in turned.promises]
            robots.append(replace(state, ports=turned.ports, copy=middle.store, turn=Turn.PROG))
        configuration = Configuration(tuple(robots), middle.store, middle.round + 1)
        return self._moment(Phase.END, configuration, constraints, faults, promises=promises)
