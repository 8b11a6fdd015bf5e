"""Machine code of whole rounds: all successors of states, put into a table. [T-ONE-WINNER]
[T-COMMIT]

What each robot can do is worked out on the snapshot, moves that come to the same are kept once, and
moves of all robots are combined with no lock class entered twice. Writers that meet are tried in
every order that makes a difference. The environment's turns are taken of each middle of a round
once. States stand in the order in which they were found, so that the table is the queue.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from msgspec import Struct

from koord.kernels.assembling import BYTES, I1, I32, I64, Cells, Code, Ir, Loaded, word
from koord.kernels.canonical import canonical_code
from koord.kernels.layout import Layout
from koord.kernels.terms import NoKernelError
from koord.kernels.turn_code import (
    FAULTS,
    POSSIBLE,
    TOO_LARGE,
    Course,
    course,
    environment_code,
    event_code,
    statement_code,
)
from koord.kernels.turns import TurnMaker, TurnTerms
from koord.semantics.configurations import NO_EVENT
from koord.syntax import core
from koord.syntax.analysis.footprint import rewritten
from koord.syntax.system import Status

#: The words of a context, by position.
(
    STATES,
    STATE_COUNT,
    STATE_MOST,
    TABLE,
    TABLE_MASK,
    BEFORE,
    MIDDLES,
    MIDDLE_COUNT,
    MIDDLE_MOST,
    MIDDLE_TABLE,
    MIDDLE_MASK,
    FOUND,
    CURRENT,
    LEFT,
    STATE_ROOM,
    MIDDLE_ROOM,
    ROUNDS,
) = range(17)
CONTEXT_WORDS = 17

#: Why a search leaves machine code before its end (``LEFT``).
LEFT_TOO_LARGE, LEFT_FULL = 1, 2

#: Robots have so many different moves in one state at most.
_MOST_MOVES = 20_000


class Goals(Struct, frozen=True):
    """What is looked for: statements, of which those ``inside`` also between turns, in this order;
    then faults; then lost updates of ``allwrite`` variables, by slot.
    """

    statements: tuple[tuple[core.Expr, int], ...] = ()
    inside: frozenset[int] = frozenset()
    on_ports: frozenset[int] = frozenset()  #: of those inside, that read what models change
    faults: bool = False
    lost: tuple[int, ...] = ()

    @property
    def count(self) -> int:
        """The number of goals."""
        return len(self.statements) + 1 + len(self.lost)


class Rounds:
    """The machine code of a system's rounds. Raises NoKernelError where there is none."""

    def __init__(self, layout: Layout, goals: Goals, bits: int) -> None:
        self.layout, self.goals = layout, goals
        self.cells = Cells(layout, bits)
        system = layout.system
        maker = TurnMaker(layout, bits)
        updates = rewritten(system.program)
        self.events = [
            [
                maker.event(i, e, updates.get((kind, e), frozenset()))
                for e in range(len(system.program.agents[kind].events))
            ]
            for i, kind in enumerate(system.kinds)
        ]
        self.environments = [
            maker.environment(i) if system.agent(i).modules else None for i in range(system.robots)
        ]
        self.statements = [maker.statement(e, bound) for e, bound in goals.statements]
        self._write(ir.Module("kernels"))

    def _write(self, module: Any) -> None:
        _Writer(self, module).write()
        self._loaded = Loaded(module)
        self.expand = self._loaded.function("expand", 3)
        self.enter = self._loaded.function("enter", 2)
        self.canonical = self._loaded.function("canonical", 3)
        self.rehash = self._loaded.function("rehash", 4)


class _Writer:
    def __init__(self, of: Rounds, module: Any) -> None:
        self.of, self.module = of, module
        self.layout, self.cells, self.goals = of.layout, of.cells, of.goals
        self.robots = range(len(self.layout.robots))
        widest = max(r.end - r.first for r in self.layout.robots)
        self.course: Course = course(self.cells, widest)
        self.shared_words = self.cells.shared_bytes // 8
        self.state_words = self.cells.state_bytes // 8
        self.has_environment = any(e is not None for e in of.environments)
        may_be_last = any(
            e is not None and (e.possible is not True or e.faults is not False)
            for e in of.environments
        )
        inside = self.goals.inside
        self.in_middles = sorted(inside if may_be_last else inside & self.goals.on_ports)

    def write(self) -> None:
        module, cells = self.module, self.cells
        self.canonical = canonical_code(module, cells)
        self.events = [
            [
                event_code(module, f"event_{i}_{e}", turn, i, cells, self.course)
                for e, turn in enumerate(turns)
            ]
            for i, turns in enumerate(self.of.events)
        ]
        self.environments = [
            environment_code(module, f"environment_{i}", turn, cells) if turn is not None else None
            for i, turn in enumerate(self.of.environments)
        ]
        self.statements = [
            statement_code(module, f"statement_{k}", holds, cells)
            for k, holds in enumerate(self.of.statements)
        ]
        self._hash()
        self.insert_state = self._insert("states", STATES, STATE_ROOM)
        self.insert_middle = self._insert("middles", MIDDLES, MIDDLE_ROOM)
        self._rehash()
        self._enter()
        self._environment()
        self._middle()
        self._races()
        self._expand()

    # --- the context ----------------------------------------------------------------------------

    def _get(self, code: Code, context: Ir, field: int) -> Ir:
        return code.get(context, 8 * field, I64)

    def _put(self, code: Code, context: Ir, field: int, value: Ir) -> None:
        code.put(context, 8 * field, value)

    def _block(self, code: Code, context: Ir, field: int) -> Ir:
        return code.b.inttoptr(self._get(code, context, field), BYTES)

    def _leave(self, code: Code, context: Ir, reason: int) -> None:
        self._put(code, context, LEFT, word(reason))

    def _find(self, code: Code, context: Ir, goal: int, where: Ir) -> None:
        """Note where a goal was met, the first time."""
        found = self._block(code, context, FOUND)
        with code.b.if_then(code.b.icmp_signed("<", code.get(found, 8 * goal, I64), word(0))):
            code.put(found, 8 * goal, where)

    def _behind(self, code: Code, context: Ir) -> Ir:
        """What is noted of a goal that is met in the round behind the current state."""
        current = self._get(code, context, CURRENT)
        return code.b.or_(code.b.shl(current, word(1)), word(1))

    # --- tables ---------------------------------------------------------------------------------

    def _hash(self) -> None:
        code = Code(self.module, "hash", (BYTES,), I64)
        code.inlined()
        b, value = code.b, word(-7046029254386353131)
        for part in code.words(code.arguments[0], self.state_words):
            value = b.mul(b.xor(value, part), word(-4417276706812531889))
            value = b.xor(value, b.lshr(value, word(32)))
        value = b.mul(value, word(-7046029254386353131))
        b.ret(b.xor(value, b.lshr(value, word(29))))
        self.hash = code.function

    def _insert(self, name: str, first: int, room: int) -> Ir:
        """Put a canonical state into a table of numbers: its number if it is new, else -1."""
        code = Code(self.module, f"insert_{name}", (BYTES, BYTES), I64)
        context, state = code.arguments
        b = code.b
        table = self._block(code, context, TABLE if first == STATES else MIDDLE_TABLE)
        mask = self._get(code, context, TABLE_MASK if first == STATES else MIDDLE_MASK)
        states = self._block(code, context, first)
        size = word(self.cells.state_bytes)
        place = code.slot(I64)
        b.store(b.and_(b.call(self.hash, [state]), mask), place)
        mine = code.words(state, self.state_words)

        def entry() -> Ir:
            return code.get(table, b.shl(b.load(place), word(2)), I32)

        with code.while_(lambda: b.icmp_signed("!=", entry(), ir.Constant(I32, 0))):
            number = b.sub(b.zext(entry(), I64), word(1))
            theirs = code.words(code.at(states, b.mul(number, size)), self.state_words)
            differs = word(0)
            for one, other in zip(mine, theirs, strict=True):
                differs = b.or_(differs, b.xor(one, other))
            with b.if_then(b.icmp_signed("==", differs, word(0))):
                b.ret(word(-1))
            b.store(b.and_(b.add(b.load(place), word(1)), mask), place)
        count = self._get(code, context, first + 1)
        with b.if_then(b.icmp_signed(">=", count, self._get(code, context, room))):
            self._leave(code, context, LEFT_FULL)
            b.ret(word(-1))
        code.copy(code.at(states, b.mul(count, size)), state, self.cells.state_bytes)
        after = b.add(count, word(1))
        code.put(table, b.shl(b.load(place), word(2)), b.trunc(after, I32))
        self._put(code, context, first + 1, after)
        b.ret(count)
        return code.function

    def _rehash(self) -> None:
        """``rehash(states, count, table, mask)``: fill an empty table with states."""
        code = Code(self.module, "rehash", (BYTES, I64, BYTES, I64), I64)
        states, count, table, mask = code.arguments
        b, place = code.b, code.slot(I64)
        with code.loop(word(0), count) as number:
            state = code.at(states, b.mul(number, word(self.cells.state_bytes)))
            b.store(b.and_(b.call(self.hash, [state]), mask), place)

            def taken() -> Ir:
                entry = code.get(table, b.shl(b.load(place), word(2)), I32)
                return b.icmp_signed("!=", entry, ir.Constant(I32, 0))

            with code.while_(taken):
                b.store(b.and_(b.add(b.load(place), word(1)), mask), place)
            entry = b.trunc(b.add(number, word(1)), I32)
            code.put(table, b.shl(b.load(place), word(2)), entry)
        b.ret(word(0))

    def _renamed(self, code: Code, state: Ir) -> Ir:
        if self.layout.symmetry is None:
            return state
        out, names = code.block(self.cells.state_bytes), code.block(8 * len(self.robots))
        code.b.call(self.canonical, [state, out, names])
        return out

    def _enter(self) -> None:
        """``enter(context, state)``: put a state into the table, and look at it if it is new."""
        code = Code(self.module, "enter", (BYTES, BYTES), I64)
        context, state = code.arguments
        b = code.b
        kept = self._renamed(code, state)
        number = b.call(self.insert_state, [context, kept])
        with b.if_then(b.icmp_signed(">=", number, word(0))):
            before = self._block(code, context, BEFORE)
            current = b.trunc(self._get(code, context, CURRENT), I32)
            code.put(before, b.shl(number, word(2)), current)
            for goal, holds in enumerate(self.statements):
                with b.if_then(b.not_(b.call(holds, [kept]))):
                    self._find(code, context, goal, b.shl(number, word(1)))
        b.ret(number)
        self.enter = code.function

    # --- the environment ------------------------------------------------------------------------

    def _environment(self) -> None:
        """All that the environment makes of a middle. [ENV-TRANS]"""
        code = Code(self.module, "environment", (BYTES, BYTES), I64)
        context, state = code.arguments
        after = code.block(self.cells.state_bytes)
        code.copy(after, state, self.cells.state_bytes)
        if any(e is not None and e.faults is not False for e in self.of.environments):
            self._environment_faults(code, context, state, after)
            code.copy(after, state, self.cells.state_bytes)
        self._environment_of(code, context, state, after, 0)
        code.b.ret(word(0))
        self.environment = code.function

    def _outcome(self, code: Code, flags: Ir, wanted: int) -> Ir:
        """Whether a turn is possible, and ``wanted`` is what becomes of it."""
        both = code.b.and_(flags, word(POSSIBLE | FAULTS))
        return code.b.icmp_signed("==", both, word(POSSIBLE | wanted))

    def _environment_faults(self, code: Code, context: Ir, state: Ir, after: Ir) -> None:
        """Note a fault of a model, if every robot's environment has a turn."""
        if not self.goals.faults:
            return
        b = code.b
        all_have: Ir = ir.Constant(I1, 1)
        any_faults: Ir = ir.Constant(I1, 0)
        for robot, turn in enumerate(self.of.environments):
            if turn is None:
                continue
            seen = code.slot(I64)
            b.store(word(0), seen)
            with code.loop(word(0), word(turn.combinations)) as chosen:
                flags = b.call(self.environments[robot], [state, chosen, after])
                possible = b.icmp_signed("!=", b.and_(flags, word(POSSIBLE)), word(0))
                b.store(b.or_(b.load(seen), b.select(possible, flags, word(0))), seen)
            has = b.icmp_signed("!=", b.load(seen), word(0))
            faults = b.icmp_signed("!=", b.and_(b.load(seen), word(FAULTS)), word(0))
            all_have, any_faults = b.and_(all_have, has), b.or_(any_faults, faults)
        with b.if_then(b.and_(all_have, any_faults)):
            self._find(code, context, len(self.statements), self._behind(code, context))

    def _environment_of(self, code: Code, context: Ir, state: Ir, after: Ir, robot: int) -> None:
        if robot == len(self.robots):
            code.b.call(self.enter, [context, after])
            return
        turn = self.of.environments[robot]
        if turn is None:
            self._environment_of(code, context, state, after, robot + 1)
            return
        with code.loop(word(0), word(turn.combinations)) as chosen:
            flags = code.b.call(self.environments[robot], [state, chosen, after])
            with code.b.if_then(self._outcome(code, flags, 0)):
                self._stop_if_too_large(code, context, flags)
                self._environment_of(code, context, state, after, robot + 1)

    def _stop_if_too_large(self, code: Code, context: Ir, flags: Ir) -> None:
        large = code.b.icmp_signed("!=", code.b.and_(flags, word(TOO_LARGE)), word(0))
        with code.b.if_then(large):
            self._leave(code, context, LEFT_TOO_LARGE)

    # --- middles --------------------------------------------------------------------------------

    def _middle(self) -> None:
        """What becomes of the end of the program turns. [END-PROG] [T-PREFIX]"""
        code = Code(self.module, "middle", (BYTES, BYTES), I64)
        context, state = code.arguments
        b = code.b
        rounds = self._get(code, context, ROUNDS)
        self._put(code, context, ROUNDS, b.add(rounds, word(1)))
        statuses = [robot.status for robot in self.layout.robots]
        if all(status is not None for status in statuses):
            stop: Ir = ir.Constant(I1, 1)
            for status in statuses:
                assert status is not None
                runs = b.icmp_signed("==", self.cells.read(code, state, status), word(0))
                stop = b.and_(stop, b.not_(runs))
            with b.if_then(stop):
                stopped = self.cells.narrow(code, word(int(Status.STOPPED)))
                for status in statuses:
                    assert status is not None
                    code.put(state, status * self.cells.size, stopped)
        for goal in self.in_middles:
            with b.if_then(b.not_(b.call(self.statements[goal], [state]))):
                self._find(code, context, goal, self._behind(code, context))
        if not self.has_environment:
            b.call(self.enter, [context, state])
        else:
            kept = self._renamed(code, state)
            number = b.call(self.insert_middle, [context, kept])
            with b.if_then(b.icmp_signed(">=", number, word(0))):
                b.call(self.environment, [context, kept])
        b.ret(word(0))
        self.middle = code.function

    # --- writers that meet ----------------------------------------------------------------------

    def _races(self) -> None:
        """``races(context, state, moves, waiting, covered, values)``: every end of a race.

        ``moves`` are the addresses of the robots' courses. Writers are tried from the last to the
        first: of the last one all is seen, of one before what the later ones leave open. A writer
        that is hidden by later ones is left out, and one that meets no other needs no order.
        """
        code = Code(self.module, "races", (BYTES, BYTES, BYTES, I64, BYTES, BYTES), I64)
        context, state, moves, waiting, covered, values = code.arguments
        b, size = code.b, self.cells.shared_bytes
        mine, written = code.block(size), code.block(size)
        code.copy(mine, covered, size)
        code.copy(written, values, size)
        seen = [
            [
                b.and_(m, b.not_(c))
                for m, c in zip(
                    self._masks(code, moves, i), code.words(covered, self.shared_words), strict=True
                )
            ]
            for i in self.robots
        ]
        open_ = [
            b.and_(
                b.trunc(b.lshr(waiting, word(i)), I1),
                b.icmp_signed("!=", self._either(code, seen[i]), word(0)),
            )
            for i in self.robots
        ]
        left = code.slot(I64)
        b.store(word(0), left)
        for i in self.robots:
            met = word(0)
            for j in self.robots:
                if j != i:
                    both = [b.and_(x, y) for x, y in zip(seen[i], seen[j], strict=True)]
                    either = self._either(code, both)
                    met = b.or_(met, b.select(open_[j], either, word(0)))
            meets = b.icmp_signed("!=", met, word(0))
            with b.if_then(b.and_(open_[i], b.not_(meets))):
                self._apply(code, moves, i, mine, written)
            bit = b.select(b.and_(open_[i], meets), word(1 << i), word(0))
            b.store(b.or_(b.load(left), bit), left)
        rest = b.load(left)
        with b.if_else(b.icmp_signed("==", rest, word(0))) as (done, more):
            with done:
                self._commit(code, context, state, mine, written)
            with more:
                next_mask, next_values = code.block(size), code.block(size)
                for i in self.robots:
                    with b.if_then(b.trunc(b.lshr(rest, word(i)), I1)):
                        code.copy(next_mask, mine, size)
                        code.copy(next_values, written, size)
                        self._apply(code, moves, i, next_mask, next_values)
                        others = b.and_(rest, word(~(1 << i)))
                        arguments = [context, state, moves, others, next_mask, next_values]
                        b.call(code.function, arguments)
        b.ret(word(0))
        self.races = code.function

    def _move(self, code: Code, moves: Ir, robot: int) -> Ir:
        return code.b.inttoptr(code.get(moves, 8 * robot, I64), BYTES)

    def _masks(self, code: Code, moves: Ir, robot: int) -> list[Ir]:
        move = code.at(self._move(code, moves, robot), self.course.mask)
        return code.words(move, self.shared_words)

    def _either(self, code: Code, words: Sequence[Ir]) -> Ir:
        result = word(0)
        for part in words:
            result = code.b.or_(result, part)
        return result

    def _apply(self, code: Code, moves: Ir, robot: int, covered: Ir, values: Ir) -> None:
        """Let a writer write what nobody behind it has written."""
        b, move = code.b, self._move(code, moves, robot)
        for k in range(self.shared_words):
            before = code.get(covered, 8 * k, I64)
            mask = code.get(move, self.course.mask + 8 * k, I64)
            its = b.and_(code.get(move, self.course.values + 8 * k, I64), b.not_(before))
            code.put(values, 8 * k, b.or_(code.get(values, 8 * k, I64), its))
            code.put(covered, 8 * k, b.or_(before, mask))

    def _commit(self, code: Code, context: Ir, state: Ir, covered: Ir, values: Ir) -> None:
        """The store after all writes; the state has the robots already."""
        b, after = code.b, code.block(self.cells.state_bytes)
        shared, size = self._shared(), self.layout.shared_first * self.cells.size
        code.copy(after, state, self.cells.state_bytes)
        merged = code.block(self.cells.shared_bytes)
        for k in range(self.shared_words):
            code.put(merged, 8 * k, word(0))
        code.copy(merged, code.at(state, size), shared)
        for k in range(self.shared_words):
            old = b.and_(code.get(merged, 8 * k, I64), b.not_(code.get(covered, 8 * k, I64)))
            code.put(merged, 8 * k, b.or_(old, code.get(values, 8 * k, I64)))
        code.copy(code.at(after, size), merged, shared)
        b.call(self.middle, [context, after])

    def _shared(self) -> int:
        return self.cells.shared_cells * self.cells.size

    # --- rounds ---------------------------------------------------------------------------------

    def _moves_of(self, robot: int) -> int:
        return 1 + sum(turn.combinations for turn in self.of.events[robot])

    def _expand(self) -> None:
        """``expand(context, first, end)``: all rounds from some states; which comes next."""
        code = Code(self.module, "expand_one", (BYTES, BYTES), I64)
        context, state = code.arguments
        if sum(map(self._moves_of, self.robots)) > _MOST_MOVES:
            raise NoKernelError("robots have too many moves in one state")
        blocks = [code.block(self._moves_of(i) * self.course.size) for i in self.robots]
        counts = [self._courses(code, context, state, i, blocks[i]) for i in self.robots]
        after, moves = code.block(self.cells.state_bytes), code.block(8 * len(self.robots))
        code.copy(after, state, self.cells.state_bytes)
        self._combine(code, (context, after, moves), blocks, counts, 0, _Partial(self.shared_words))
        code.b.ret(word(0))
        self._loop(code.function)

    def _loop(self, expand_one: Ir) -> None:
        code = Code(self.module, "expand", (BYTES, I64, I64), I64)
        context, first, end = code.arguments
        b, number = code.b, code.slot(I64)
        b.store(first, number)

        def goes_on() -> Ir:
            more = b.icmp_signed("<", b.load(number), end)
            for count, most in ((STATE_COUNT, STATE_MOST), (MIDDLE_COUNT, MIDDLE_MOST)):
                held, room = self._get(code, context, count), self._get(code, context, most)
                more = b.and_(more, b.icmp_signed("<", held, room))
            is_left = b.icmp_signed("!=", self._get(code, context, LEFT), word(0))
            return b.and_(more, b.not_(is_left))

        with code.while_(goes_on):
            states = self._block(code, context, STATES)
            self._put(code, context, CURRENT, b.load(number))
            state = code.at(states, b.mul(b.load(number), word(self.cells.state_bytes)))
            b.call(expand_one, [context, state])
            b.store(b.add(b.load(number), word(1)), number)
        b.ret(b.load(number))

    def _courses(self, code: Code, context: Ir, state: Ir, robot: int, block: Ir) -> Ir:
        """Put a robot's different moves into a block; how many there are. [SKIP] [SELECT]"""
        b, of, layout = code.b, self.course, self.layout
        count, own = code.slot(I64), layout.robots[robot]
        for offset in range(0, of.size, 8):
            code.put(block, offset, word(0))
        size = (own.end - own.first) * self.cells.size
        code.copy(code.at(block, of.own), code.at(state, own.first * self.cells.size), size)
        if own.ran is not None:
            nothing = self.cells.narrow(code, word(NO_EVENT))
            code.put(block, of.own + (own.ran - own.first) * self.cells.size, nothing)
        b.store(word(1), count)
        if own.status is None:
            for position, turn in enumerate(self.of.events[robot]):
                self._event(code, context, state, (robot, position), turn, block, count)
            return b.load(count)
        status = self.cells.read(code, state, own.status)
        with b.if_then(b.icmp_signed("!=", status, word(int(Status.STOPPED)))):
            for position, turn in enumerate(self.of.events[robot]):
                self._event(code, context, state, (robot, position), turn, block, count)
        return b.load(count)

    def _event(
        self,
        code: Code,
        context: Ir,
        state: Ir,
        event: tuple[int, int],
        turn: TurnTerms,
        block: Ir,
        count: Ir,
    ) -> None:
        robot, position = event
        b, of, size = code.b, self.course, self.course.size
        if turn.possible is False:
            return
        with code.loop(word(0), word(turn.combinations)) as chosen:
            place = code.at(block, b.mul(b.load(count), word(size)))
            for offset in range(of.own, of.values, 8):
                # What is left over behind a robot's cells would tell equal moves apart.
                code.put(place, offset, word(0))
            flags = b.call(self.events[robot][position], [state, chosen, place])
            if self.goals.faults and turn.faults is not False:
                with b.if_then(self._outcome(code, flags, FAULTS)):
                    self._find(code, context, len(self.statements), self._behind(code, context))
            with b.if_then(self._outcome(code, flags, 0)):
                self._stop_if_too_large(code, context, flags)
                is_new = code.slot(I64)
                b.store(word(1), is_new)
                mine = code.words(place, size // 8)
                with code.loop(word(0), b.load(count)) as other:
                    theirs = code.words(code.at(block, b.mul(other, word(size))), size // 8)
                    differs = self._either(
                        code, [b.xor(x, y) for x, y in zip(mine, theirs, strict=True)]
                    )
                    with b.if_then(b.icmp_signed("==", differs, word(0))):
                        b.store(word(0), is_new)
                b.store(b.add(b.load(count), b.load(is_new)), count)

    def _combine(
        self,
        code: Code,
        held: tuple[Ir, Ir, Ir],
        blocks: list[Ir],
        counts: list[Ir],
        robot: int,
        before: _Partial,
    ) -> None:
        """Combine moves of the robots from one on with those before. [ATOMIC]"""
        b, of = code.b, self.course
        _, after, moves = held
        if robot == len(self.robots):
            self._combined(code, held, before)
            return
        own = self.layout.robots[robot]
        with code.loop(word(0), counts[robot]) as chosen:
            move = code.at(blocks[robot], b.mul(chosen, word(of.size)))
            entered = code.get(move, of.entered, I64)
            free = b.icmp_signed("==", b.and_(entered, before.taken), word(0))
            with b.if_then(free):
                code.put(moves, 8 * robot, b.ptrtoint(move, I64))
                size = (own.end - own.first) * self.cells.size
                to = code.at(after, own.first * self.cells.size)
                code.copy(to, code.at(move, of.own), size)
                masks = code.words(code.at(move, of.mask), self.shared_words)
                values = code.words(code.at(move, of.values), self.shared_words)
                met = [b.and_(m, c) for m, c in zip(masks, before.covered, strict=True)]
                now = _Partial(self.shared_words)
                now.taken = b.or_(before.taken, entered)
                now.met = b.or_(before.met, self._either(code, met))
                now.covered = [b.or_(c, m) for c, m in zip(before.covered, masks, strict=True)]
                now.values = [b.or_(w, v) for w, v in zip(before.values, values, strict=True)]
                self._combine(code, held, blocks, counts, robot + 1, now)

    def _combined(self, code: Code, held: tuple[Ir, Ir, Ir], of: _Partial) -> None:
        b = code.b
        context, after, moves = held
        covered, values = (code.block(self.cells.shared_bytes) for _ in range(2))
        with b.if_else(b.icmp_signed("==", of.met, word(0))) as (apart, race):
            with apart:
                for k in range(self.shared_words):
                    code.put(covered, 8 * k, of.covered[k])
                    code.put(values, 8 * k, of.values[k])
                self._commit(code, context, after, covered, values)
            with race:
                self._lost(code, context, moves)
                for k in range(self.shared_words):
                    code.put(covered, 8 * k, word(0))
                    code.put(values, 8 * k, word(0))
                everybody = word((1 << len(self.robots)) - 1)
                b.call(self.races, [context, after, moves, everybody, covered, values])

    def _lost(self, code: Code, context: Ir, moves: Ir) -> None:
        """Note lost updates: one's update meets another's write. [LOST-UPDATE]"""
        b = code.b
        if not self.goals.lost:
            return
        lost: list[Ir] = [word(0)] * self.shared_words
        for i in self.robots:
            move = code.at(self._move(code, moves, i), self.course.updates)
            mine = code.words(move, self.shared_words)
            for j in self.robots:
                if i != j:
                    masks = self._masks(code, moves, j)
                    lost = [
                        b.or_(x, b.and_(m, o)) for x, m, o in zip(lost, mine, masks, strict=True)
                    ]
        block = code.block(self.cells.shared_bytes)
        for k, part in enumerate(lost):
            code.put(block, 8 * k, part)
        size, first = self.cells.size, self.layout.shared_first
        for position, slot in enumerate(self.goals.lost):
            for cell in _cells_of(self.layout.allwrite[slot]):
                held = code.get(block, (cell - first) * size, self.cells.type)
                with b.if_then(b.icmp_signed("!=", held, ir.Constant(self.cells.type, 0))):
                    goal = len(self.statements) + 1 + position
                    self._find(code, context, goal, self._behind(code, context))


class _Partial:
    """What the moves of some robots come to: lock classes taken, and the store's cells written."""

    def __init__(self, words: int) -> None:
        self.taken: Ir = word(0)
        self.met: Ir = word(0)
        self.covered: list[Ir] = [word(0)] * words
        self.values: list[Ir] = [word(0)] * words


def _cells_of(atoms: Any) -> list[int]:
    if isinstance(atoms, tuple):
        return [cell for part in atoms for cell in _cells_of(part)]
    return [atoms.value]
