"""A round of a crowd, from the perspective of named robots. [T-EVERY-N]"""

from __future__ import annotations

from typing import Protocol

from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store, Turn
from koord.semantics.domain import conjunction, disjunction
from koord.semantics.environment import Evolved, environment_turn
from koord.semantics.properties import overlap
from koord.semantics.turns import guard_of, program_turn
from koord.syntax import core
from koord.syntax.analysis.footprint import rewritten
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.system import Status
from koord.syntax.types import BOOL, INT
from koord.syntax.walk import nodes
from koord.verify.encoding.moments import turn_taken
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.all_robots import ParameterisedSystem
from koord.verify.engines.every_n.commits import Commits, Guards, PossibleTurn
from koord.verify.engines.every_n.functions import RobotInputs
from koord.verify.engines.every_n.initial_states import faults_of


class RoundStart(Protocol):
    """Where a round starts: after INIT, anywhere, or where another one ends."""

    @property
    def configuration(self) -> Configuration[Term]:
        """The configuration."""
        ...

    def robot(self, kind: int, robot: Term) -> Robot[Term]:
        """The robot of a kind with a number."""
        ...


class ParameterisedRound:
    """A round of a crowd from some configuration.

    ``inside`` is any configuration in which some robots have run an event and the others have not
    yet, ``middle`` one at the end of the program turns, ``end`` one after the environment's turn.
    ``calm``: no program turn faulted; ``legal``: who skipped was allowed to (inside a round, who
    has not run may still have to); ``gentle``: the environment's turn did not fault. Rounds that
    follow each other have labels, by which what is unknown in them is told apart.
    """

    def __init__(self, world: ParameterisedSystem, start: RoundStart, label: str = "") -> None:
        self.world = world
        self.start = start
        self._label = label
        self._moved: dict[object, tuple[Term, list[PossibleTurn]]] = {}
        self._states: dict[object, tuple[Term, list[tuple[Term, Robot[Term]]]]] = {}
        self._evolved: dict[object, tuple[Term, list[tuple[Term, Robot[Term], Evolved[Term]]]]] = {}
        self._asked: Term = False
        world, d = self.world, self.world.d
        self.calm: Term = d.fresh("calm", BOOL)
        self.legal: Term = d.fresh("legal", BOOL)
        self.gentle: Term = d.fresh("gentle", BOOL)
        before = self.start.configuration.store
        guards = Guards.of(world.program)
        self.commits = Commits(world, before, self.moves, guards, f"{label}round")
        store = Store(
            tuple(self.commits.entries(slot) for slot in range(len(before.allread))),
            tuple(self.commits.everything(slot) for slot in range(len(before.allwrite))),
        )
        for lock_class in world.program.lock_classes:
            # Also where a block writes nothing that all may write: one robot enters it at most.
            self.commits.winner(lock_class.index)
        self.inside: Configuration[Term] = Configuration((), store, 0, Turn.ENV, at=self.after_turn)
        self._asked = self._everyone_asked()
        self.middle: Configuration[Term] = Configuration(
            (), store, 0, Turn.ENV, at=self.after_turns
        )
        self.end: Configuration[Term] = Configuration((), store, 1, at=self._at_end)

    @property
    def configuration(self) -> Configuration[Term]:
        """The configuration at its end, where the next round starts."""
        return self.end

    # --- program turns --------------------------------------------------------------------------

    def moves(self, robot: Term) -> list[PossibleTurn]:
        """The turns that a robot may take in this round. [SELECT] [T-SNAPSHOT]"""
        d, book = self.world.d, self.world.book
        key = d.key(robot)
        if key not in self._moved:
            with book.about(robot):
                self._moved[key] = robot, self._any_move(robot)
                self.commits.know(robot)
                for kind, here in self.world.cases(robot):
                    self._urge(kind, robot, here)
        return self._moved[key][1]

    def _any_move(self, robot: Term) -> list[PossibleTurn]:
        cases = self.world.cases(robot)
        moves = [move for kind, here in cases for move in self._moves(kind, robot, here)]
        sound = self.world.d.unary(UnaryOp.NOT, faults_of(self.world, moves))
        self.world.book.note(self.world.book.implied(self.calm, sound))
        return moves

    def event(self, robot: Term) -> Term:
        """The position of the event that a robot runs in this round, or ``NO_EVENT``."""
        with self.world.d.depending_on((robot,)):
            return self.world.d.fresh(f"{self._label}event", INT)

    def _moves(self, kind: int, robot: Term, here: Term) -> list[PossibleTurn]:
        world, d, book = self.world, self.world.d, self.world.book
        event = self.event(robot)
        state, seat = self.start.robot(kind, robot), world.seat(kind, robot)
        inputs = RobotInputs(world.unknowns, f"{self._label}round", robot)
        count = len(world.program.agents[kind].events)
        book.note(book.implied(here, book.between(NO_EVENT, event, count)))
        running = d.binary(BinaryOp.NE, state.status, d.const(int(Status.STOPPED), INT))
        moves = []
        for position in range(count):
            selectable, turned = program_turn(d, seat, 0, state, position, inputs)
            chosen = conjunction(d, [here, d.binary(BinaryOp.EQ, event, position)])
            legal = [x.condition for x in turned.legality]
            book.note(book.implied(chosen, conjunction(d, [selectable, running, *legal])))
            moves.append(PossibleTurn(kind, position, chosen, turned))
        return moves

    def _urge(self, kind: int, robot: Term, here: Term) -> None:
        """Assert that a robot that skips has no urgent event that obliges it to run. [SKIP]"""
        world, d, book = self.world, self.world.d, self.world.book
        state, seat = self.start.robot(kind, robot), world.seat(kind, robot)
        inputs = RobotInputs(world.unknowns, f"{self._label}round", robot)
        running = d.binary(BinaryOp.NE, state.status, d.const(int(Status.STOPPED), INT))
        acts = d.binary(BinaryOp.NE, self.event(robot), NO_EVENT)
        for urgent in world.program.agents[kind].events:
            if urgent.urgent:
                holds, _ = guard_of(d, seat, 0, state, urgent, inputs)
                taken = d.unary(UnaryOp.NOT, self._taken(robot, urgent))
                waits = conjunction(d, [self.legal, here, running, holds, taken])
                book.note(book.implied(waits, acts))

    def _taken(self, robot: Term, event: core.Event) -> Term:
        """The condition that another robot enters a lock class that an event needs."""
        d = self.world.d
        taken = []
        for lock_class in sorted(event.lock_classes):
            winner = self.commits.winner(lock_class)
            other = d.binary(BinaryOp.NE, winner, robot)
            taken.append(d.binary(BinaryOp.AND, other, self.commits.enters(lock_class, winner)))
        return disjunction(d, taken)

    def after_turn(self, robot: Term) -> list[tuple[Term, Robot[Term]]]:
        """A robot after its event, or before it. [T-SNAPSHOT] [T-PREFIX]"""
        world, d = self.world, self.world.d
        world.book.name(robot)
        key = d.key(robot)
        if key not in self._states:
            moves = self.moves(robot)
            found = []
            for kind, here in world.cases(robot):
                mine = [(m.chosen, m.turned) for m in moves if m.kind == kind]
                found.append((here, turn_taken(d, self.start.robot(kind, robot), mine)))
            self._states[key] = robot, found
        return self._states[key][1]

    # --- the end of the program turns -----------------------------------------------------------

    def _everyone_asked(self) -> Term:
        """The condition that all robots have asked to stop, or stopped. [END-PROG] [STOP]"""
        if not any(isinstance(node, core.TryStop) for node in nodes(self.world.program.agents)):
            return False
        d, running = self.world.d, int(Status.RUNNING)

        def asked(robot: Term) -> Term:
            return conjunction(
                d,
                [
                    d.binary(BinaryOp.IMPLIES, here, d.binary(BinaryOp.NE, state.status, running))
                    for here, state in self.after_turn(robot)
                ],
            )

        return self.world.book.every(0, self.world.crowd.count, asked)

    def after_turns(self, robot: Term) -> list[tuple[Term, Robot[Term]]]:
        """A robot at the end of the program turns: it stops if all have asked. [STOP]"""
        d, stopped = self.world.d, int(Status.STOPPED)
        return [
            (here, replace(state, status=d.ite(self._asked, stopped, state.status)))
            for here, state in self.after_turn(robot)
        ]

    # --- the environment's turn -----------------------------------------------------------------

    def evolved(self, robot: Term) -> list[tuple[Term, Robot[Term], Evolved[Term]]]:
        """A robot after the environment's turn, per kind, with the findings. [ENV-TRANS]"""
        key = self.world.d.key(robot)
        if key not in self._evolved:
            with self.world.book.about(robot):
                self._evolved[key] = robot, self._after_environment(robot)
        return self._evolved[key][1]

    def _after_environment(self, robot: Term) -> list[tuple[Term, Robot[Term], Evolved[Term]]]:
        world, d, book = self.world, self.world.d, self.world.book
        found = []
        for here, state in self.after_turns(robot):
            inputs = RobotInputs(world.unknowns, f"{self._label}environment", robot)
            seat = world.seat(state.kind, robot)
            turned = environment_turn(d, seat, 0, state, inputs)
            legal = conjunction(d, [x.condition for x in turned.legality])
            calm = [d.unary(UnaryOp.NOT, fault) for fault, _ in turned.faults]
            book.note(book.implied(here, legal))
            book.note(book.implied(self.gentle, book.implied(here, conjunction(d, calm))))
            state = replace(state, ports=turned.ports, copy=self.middle.store, turn=Turn.PROG)
            found.append((here, state, turned))
        return found

    def _at_end(self, robot: Term) -> list[tuple[Term, Robot[Term]]]:
        self.world.book.name(robot)
        return [(here, state) for here, state, _ in self.evolved(robot)]

    def robot(self, kind: int, robot: Term) -> Robot[Term]:
        """The robot of a kind with a number, at the end of the round."""
        return next(state for _, state in self._at_end(robot) if state.kind == kind)

    # --- what a round finds out -----------------------------------------------------------------

    def faults(self, robot: Term) -> Term:
        """The condition that a robot's program turn faults. [T-FAULT]"""
        return faults_of(self.world, self.moves(robot))

    def breaks(self, robot: Term) -> Term:
        """The condition that the environment's turn of a robot faults."""
        d = self.world.d
        return disjunction(
            d,
            [
                d.binary(BinaryOp.AND, here, fault)
                for here, _, turned in self.evolved(robot)
                for fault, _ in turned.faults
            ],
        )

    def fails(self, robot: Term, contract: str) -> Term:
        """The condition that a model does not keep a contract of its module."""
        d = self.world.d
        return disjunction(
            d,
            [
                d.binary(BinaryOp.AND, here, d.unary(UnaryOp.NOT, kept))
                for here, _, turned in self.evolved(robot)
                for kept, promise in turned.promises
                if promise.name == contract
            ],
        )

    def loses(self, robot: Term, other: Term, name: str) -> Term:
        """The condition that a robot's update of a variable meets another's write. [LOST-UPDATE]"""
        d, program = self.world.d, self.world.program
        updates = rewritten(program)
        slots = [e.variable.slot for e in program.allwrite if e.variable.name == name]
        met = [
            conjunction(
                d,
                [
                    mine.chosen,
                    theirs.chosen,
                    overlap(d, mine.turned.allwrite.get(slot), theirs.turned.allwrite.get(slot)),
                ],
            )
            for slot in slots
            for mine in self.moves(robot)
            if slot in updates.get((mine.kind, mine.position), ())
            for theirs in self.moves(other)
        ]
        return conjunction(d, [d.binary(BinaryOp.NE, robot, other), disjunction(d, met)])
