"""INIT of a crowd, and arbitrary configurations at the end of a round. [INIT] [T-EVERY-N]"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store, Turn
from koord.semantics.domain import conjunction, disjunction
from koord.semantics.storage import Many, Storage, many_of
from koord.semantics.turns import declared, initial_turn
from koord.syntax import core
from koord.syntax.analysis.footprint import Footprint, WriteExtent, footprint, statuses
from koord.syntax.core import BinaryOp, Home, UnaryOp
from koord.syntax.types import BOOL, INT, ArrayType, Type
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.all_robots import ParameterisedSystem
from koord.verify.engines.every_n.commits import NO_GUARDS, Commits, PossibleTurn
from koord.verify.engines.every_n.functions import RobotInputs


class ParameterisedInit:
    """The configuration after INIT of a crowd. Where ``calm`` holds, nothing faulted."""

    def __init__(self, world: ParameterisedSystem) -> None:
        self.world = world
        self._turns: dict[object, tuple[Term, list[PossibleTurn]]] = {}
        world, d = self.world, self.world.d
        self.calm: Term = d.fresh("calm init", BOOL)
        inputs = RobotInputs(world.unknowns, "init", None)
        self._store, faults = declared(d, world.system, inputs)
        self.fault: Term = disjunction(d, [fault for fault, _ in faults])
        world.book.note(world.book.implied(self.calm, d.unary(UnaryOp.NOT, self.fault)))
        self._commits = Commits(world, self._store, self.moves, NO_GUARDS, "init", everybody=True)
        store = Store(
            tuple(self._commits.entries(slot) for slot in range(len(self._store.allread))),
            tuple(self._commits.everything(slot) for slot in range(len(self._store.allwrite))),
        )
        self.configuration: Configuration[Term] = Configuration((), store, 0, at=self._at)

    def moves(self, robot: Term) -> list[PossibleTurn]:
        """The initial turns of a robot, one per kind. [T-SNAPSHOT]"""
        key = self.world.d.key(robot)
        if key not in self._turns:
            with self.world.book.about(robot):
                self._turns[key] = robot, self._moves(robot)
                self._commits.know(robot)
        return self._turns[key][1]

    def _moves(self, robot: Term) -> list[PossibleTurn]:
        d, book, moves = self.world.d, self.world.book, []
        for kind, here in self.world.cases(robot):
            seat = self.world.seat(kind, robot)
            inputs = RobotInputs(self.world.unknowns, "init", robot)
            turned = initial_turn(d, seat, 0, self._store, inputs)
            legal = conjunction(d, [x.condition for x in turned.legality])
            book.note(book.implied(here, legal))
            moves.append(PossibleTurn(kind, NO_EVENT, here, turned))
        calm = d.unary(UnaryOp.NOT, faults_of(self.world, moves))
        book.note(book.implied(self.calm, calm))
        return moves

    def robot(self, kind: int, robot: Term) -> Robot[Term]:
        """The robot of a kind with a number."""
        return next(state for _, state in self._at(robot) if state.kind == kind)

    def _at(self, robot: Term) -> list[tuple[Term, Robot[Term]]]:
        self.world.book.name(robot)
        return [
            (move.chosen, replace(move.turned.robot, turn=Turn.PROG)) for move in self.moves(robot)
        ]


def faults_of(world: ParameterisedSystem, moves: Sequence[PossibleTurn]) -> Term:
    """The condition that one of some turns is taken and faults. [T-FAULT]"""
    d = world.d
    return disjunction(
        d, [d.binary(BinaryOp.AND, x.chosen, f) for x in moves for f, _ in x.turned.faults]
    )


class ArbitraryState:
    """An arbitrary configuration at the end of a round, reachable or not.

    It has in common with the one after INIT what no event ever changes.
    """

    def __init__(self, world: ParameterisedSystem, opening: ParameterisedInit) -> None:
        self.world = world
        self.opening = opening
        self._robots: dict[object, tuple[Term, list[tuple[Term, Robot[Term]]]]] = {}
        self._shapes: dict[tuple[Home, int, int], Storage[Term]] = {}
        program = self.world.program
        self._footprint: Footprint = footprint(program)
        before = self.opening.configuration.store
        store = Store(
            tuple(self._entries(entry, before) for entry in program.allread),
            tuple(self._shared(entry, before) for entry in program.allwrite),
        )
        self.configuration: Configuration[Term] = Configuration((), store, 0, at=self._at)

    def robot(self, kind: int, robot: Term) -> Robot[Term]:
        """The robot of a kind with a number."""
        return next(state for _, state in self._at(robot) if state.kind == kind)

    def _at(self, robot: Term) -> list[tuple[Term, Robot[Term]]]:
        self.world.book.name(robot)
        key = self.world.d.key(robot)
        if key not in self._robots:
            with self.world.book.about(robot):
                cases = self.world.cases(robot)
                found = [(here, self._any(kind, robot, here)) for kind, here in cases]
            self._robots[key] = robot, found
        return self._robots[key][1]

    def _any(self, kind: int, robot: Term, here: Term) -> Robot[Term]:
        d, agent = self.world.d, self.world.program.agents[kind]
        with d.depending_on((robot,)):
            status, ran = d.fresh("status", INT), d.fresh("ran", INT)
        possible = [
            d.binary(BinaryOp.EQ, status, d.const(int(s), INT))
            for s in sorted(statuses(self.world.program)[kind])
        ]
        inside = self.world.book.between(NO_EVENT, ran, len(agent.events))
        fact = d.binary(BinaryOp.AND, disjunction(d, possible), inside)
        self.world.book.note(self.world.book.implied(here, fact))
        return Robot(
            kind,
            tuple(self._own(kind, x, x.variable.name, robot) for x in agent.locals),
            tuple(self._own(kind, p.declaration, p.label, robot) for p in agent.ports),
            self.configuration.store,
            status,
            ran,
        )

    # --- variables ------------------------------------------------------------------------------

    def _own(self, kind: int, entry: core.Declaration, name: str, robot: Term) -> Storage[Term]:
        """Storage of a local or port of one robot, by a name that its kind has once."""
        home, slot = entry.variable.home, entry.variable.slot
        written = self._footprint.get((home, kind, slot), WriteExtent.NEVER)
        if written is WriteExtent.NEVER:
            return self._initial(home, kind, slot, robot)
        shape = self._shape((home, kind, slot), lambda any_: self._initial(home, kind, slot, any_))
        name = f"{home.value} {kind} {name}"
        return self._some(name, entry.variable.type, shape, written, (robot,))

    def _initial(self, home: Home, kind: int, slot: int, robot: Term) -> Storage[Term]:
        move = next(move for move in self.opening.moves(robot) if move.kind == kind)
        state = move.turned.robot
        return (state.locals if home is Home.LOCAL else state.ports)[slot]

    def _shared(self, entry: core.Declaration, before: Store[Term]) -> Storage[Term]:
        """Storage of an allwrite variable."""
        variable = entry.variable
        written = self._footprint.get((Home.ALLWRITE, 0, variable.slot), WriteExtent.NEVER)
        like = before.allwrite[variable.slot]
        some = self._some(f"allwrite  {variable.name}", variable.type, like, written, ())
        return self.world.naming(some)

    def _entries(self, entry: core.Declaration, before: Store[Term]) -> Storage[Term]:
        """Storage of an allread variable."""
        variable = entry.variable
        assert isinstance(variable.type, ArrayType)
        element, slot = variable.type.element, variable.slot
        initial = before.allread[slot]
        assert isinstance(initial, Many)
        written = self._footprint.get((Home.ALLREAD, 0, slot), WriteExtent.NEVER)

        def at(robot: Term) -> Storage[Term]:
            self.world.book.name(robot)
            if written is WriteExtent.NEVER:
                return initial.at(robot)
            shape = self._shape((Home.ALLREAD, 0, slot), initial.at)
            return self._some(f"allread  {variable.name}", element, shape, written, (robot,))

        return many_of(initial.crowd, at)

    def _shape(
        self, key: tuple[Home, int, int], of: Callable[[Term], Storage[Term]]
    ) -> Storage[Term]:
        """The shape of a variable after INIT, for a robot of which nothing is known."""
        if key not in self._shapes:
            with self.world.book.about(0):
                self.world.book.glimpse(partial(self._look, key, of))
        return self._shapes[key]

    def _look(
        self, key: tuple[Home, int, int], of: Callable[[Term], Storage[Term]], robot: Term
    ) -> Term:
        self._shapes[key] = of(robot)
        return True

    def _some(
        self,
        name: str,
        type_: Type,
        like: Storage[Term],
        written: WriteExtent,
        arguments: tuple[Term, ...],
    ) -> Storage[Term]:
        """Any storage of a variable. Where only elements of a list change, its length stays."""
        return self.world.unknowns.storage_of(name, type_, like, written, arguments)
