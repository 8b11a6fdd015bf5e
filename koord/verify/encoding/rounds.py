"""One round as one formula, of size O(robots · program). [T-COMMIT] [T-ONE-WINNER] [T-PREFIX]

Every robot's events run once on its snapshot, by the semantics' own turns on Z3 terms; Booleans say
which event each robot runs. Where the order of robots matters (writes to one location outside of
atomic blocks; urgent events that wait for a lock) places say who comes before whom; elsewhere
there is no order at all. A robot that would lose a lock skips, so at most one robot enters a class.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store, Turn
from koord.semantics.domain import conjunction, disjunction
from koord.semantics.environment import environment_turn
from koord.semantics.storage import Storage
from koord.semantics.turns import declared, initial_turn, program_turn
from koord.syntax import core
from koord.syntax.analysis.footprint import (
    Footprint,
    WriteExtent,
    footprint,
    rewritten,
    statuses,
    stops_show,
)
from koord.syntax.core import BinaryOp, Home, UnaryOp
from koord.syntax.system import Status, System
from koord.syntax.types import BOOL, INT
from koord.verify.claims import ClaimPhase, StepFindings
from koord.verify.encoding.choices import (
    committed,
    differs,
    free_to_skip,
    lost_updates,
    obligations,
    one_event_each,
    one_winner_each,
    order_of,
    racy_variables,
    who_acts,
)
from koord.verify.encoding.moments import (
    Before,
    EventOption,
    SymbolicConfiguration,
    SymbolicInit,
    SymbolicRound,
    turn_taken,
)
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.encoding.terms import Term, Terms
from koord.verify.encoding.unknowns import Unknowns


class Arbitrary:
    """A builder of arbitrary configurations of one system."""

    def __init__(self, system: System, unknowns: Unknowns) -> None:
        self.system = system
        self.unknowns = unknowns
        self.footprint: Footprint = footprint(self.system.program)
        self.statuses: tuple[frozenset[Status], ...] = statuses(self.system.program)

    @property
    def d(self) -> Terms:
        return self.unknowns.d

    def configuration(self, initial: Configuration[Term], label: str) -> Configuration[Term]:
        """Any configuration at a round's end, reachable or not: the start of an inductive step.

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
        written = self.footprint.get((home, kind, variable.slot), WriteExtent.NEVER)
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
                for s in sorted(self.statuses[state.kind])
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


class Encoder:
    """A builder of symbolic initial configurations and rounds of one system.

    With ``movers`` all other robots only skip: these are some of the runs, with smaller formulas.
    """

    def __init__(
        self, system: System, unknowns: Unknowns, movers: frozenset[int] | None = None
    ) -> None:
        self.system = system
        self.movers = frozenset(range(system.robots)) if movers is None else movers
        self.unknowns = unknowns
        self.d = unknowns.d
        self._racy = racy_variables(system.program)
        self._urgent = any(e.urgent for a in system.program.agents for e in a.events)
        self._stops_show = stops_show(system.program)
        self._updates = rewritten(system.program)
        self._arbitrary = Arbitrary(system, unknowns)

    # --- configurations to start from -----------------------------------------------------------

    def initial(self) -> SymbolicInit:
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
        before = order_of(d, self.system.robots, "init") if racy else {}
        always = d.const(True, BOOL)
        options = [EventOption(i, NO_EVENT, always, turned) for i, turned in enumerate(turns)]
        final = committed(d, self.system, store, options, before, racy)
        constraints = [x.condition for turned in turns for x in turned.legality]
        found = [f for f, _ in faults] + [f for turned in turns for f, _ in turned.faults]
        states = tuple(replace(t.robot, copy=final, turn=Turn.PROG) for t in turns)
        configuration = Configuration(states, final, 0)
        return SymbolicInit(
            inputs, before, self._moment(ClaimPhase.INIT, configuration, constraints, found)
        )

    def arbitrary(self, initial: Configuration[Term], label: str) -> Configuration[Term]:
        """Any configuration at a round's end, reachable or not: the start of an inductive step.

        It has in common with ``initial`` what no event ever changes.
        """
        return self._arbitrary.configuration(initial, label)

    # --- rounds ---------------------------------------------------------------------------------

    def round(self, start: Configuration[Term], label: str) -> SymbolicRound:
        """One round from a configuration in which every robot is to move."""
        inputs = SymbolicInputs(self.unknowns, label)
        options = self._options(start, inputs, label)
        before = order_of(self.d, self.system.robots, label) if self._racy else {}
        inside = self._program_turns(start, options, before)
        asked, middle = self._end_of_program_turns(inside)
        urgency = obligations(self.d, self.system, start, options, inputs) if self._urgent else []
        end = self._environment(middle.configuration, inputs)
        if not self._urgent and not self._stops_show:
            return SymbolicRound(options, before, inputs, None, middle, end, urgency, [])
        acting = who_acts(self.d, self.system, options)
        # A lone robot that skips has ended the program turns.
        free = free_to_skip(self.d, self.system, start, inputs) if self.system.robots > 1 else []
        # Where everyone has moved and asked, nobody sees that they did not all stop yet; where
        # nobody has moved, the round before has not been left.
        ended = self.d.binary(BinaryOp.AND, conjunction(self.d, acting), asked)
        begun = disjunction(self.d, [*acting, *free])
        inside.real = self.d.binary(BinaryOp.AND, begun, self.d.unary(UnaryOp.NOT, ended))
        return SymbolicRound(options, before, inputs, inside, middle, end, urgency, free)

    def _end_of_program_turns(
        self, inside: SymbolicConfiguration
    ) -> tuple[Term, SymbolicConfiguration]:
        """The condition that all robots stop now, and the configuration after that.
        [END-PROG] [STOP]
        """
        d, robots = self.d, inside.configuration.robots
        asked = conjunction(d, [differs(self.d, r.status, Status.RUNNING) for r in robots])
        if d.known(asked) is not False:
            stopped = d.const(int(Status.STOPPED), INT)
            robots = tuple(replace(r, status=d.ite(asked, stopped, r.status)) for r in robots)
        configuration = replace(inside.configuration, robots=robots)
        checks = SymbolicInputs(self.unknowns, ClaimPhase.MIDDLE.value)
        return asked, SymbolicConfiguration(
            ClaimPhase.MIDDLE, configuration, inside.constraints, inside.findings, checks
        )

    def _options(
        self, start: Configuration[Term], inputs: SymbolicInputs, label: str
    ) -> list[EventOption]:
        options = []
        for i in sorted(self.movers):
            state = start.robots[i]
            for position, event in enumerate(self.system.agent(i).events):
                chosen = self.d.fresh(f"{event.name}@{i}#{label}", BOOL)
                selectable, turned = program_turn(self.d, self.system, i, state, position, inputs)
                running = differs(self.d, state.status, Status.STOPPED)
                allowed = conjunction(
                    self.d, [selectable, running, *(x.condition for x in turned.legality)]
                )
                if self.d.known(allowed) is False:
                    continue
                self.unknowns.constraints.append(self.d.binary(BinaryOp.IMPLIES, chosen, allowed))
                options.append(EventOption(i, position, chosen, turned))
        return options

    def _program_turns(
        self,
        start: Configuration[Term],
        options: list[EventOption],
        before: Before,
    ) -> SymbolicConfiguration:
        """The configuration after the robots' chosen events. [EVENT-TRANS]"""
        d = self.d
        constraints = one_event_each(d, self.system, options)
        constraints += one_winner_each(d, self.system, options)
        store = committed(d, self.system, start.store, options, before, set(self._racy))
        robots = tuple(
            turn_taken(d, state, [(o.chosen, o.turned) for o in options if o.robot == i])
            for i, state in enumerate(start.robots)
        )
        faults = [d.binary(BinaryOp.AND, o.chosen, f) for o in options for f, _ in o.turned.faults]
        configuration = Configuration(robots, store, start.round, Turn.ENV)
        lost = lost_updates(d, self.system, self._updates, options)
        return self._moment(ClaimPhase.INSIDE, configuration, constraints, faults, lost=lost)

    def _moment(
        self,
        phase: ClaimPhase,
        configuration: Configuration[Term],
        constraints: list[Term],
        faults: list[Term],
        *,
        lost: Sequence[tuple[Term, str]] = (),
        promises: Sequence[tuple[Term, str]] = (),
    ) -> SymbolicConfiguration:
        findings = StepFindings(disjunction(self.d, faults), tuple(lost), tuple(promises))
        checks = SymbolicInputs(self.unknowns, phase.value)
        return SymbolicConfiguration(phase, configuration, constraints, findings, checks)

    # --- the environment ------------------------------------------------------------------------

    def _environment(
        self, middle: Configuration[Term], inputs: SymbolicInputs
    ) -> SymbolicConfiguration:
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
        return self._moment(ClaimPhase.END, configuration, constraints, faults, promises=promises)
