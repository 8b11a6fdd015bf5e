"""Machine code of whole rounds: all successors of states, put into a table. [T-SNAPSHOT]

What each robot can do is worked out on the snapshot (:mod:`moves`), moves that come to the same are
kept once, and moves of all robots are combined with no lock class entered twice
(:mod:`combinations`). Writers that meet are tried in every order that makes a difference
(:mod:`races`). The environment's turns (:mod:`environment_turns`) are taken of each middle of a
round once. States stand in the order in which they were found, so that the table is the queue.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from koord.kernels.assembling import Cells
from koord.kernels.canonical import canonical_code
from koord.kernels.combinations import expand_one_code
from koord.kernels.context import (
    CURRENT,
    LEFT,
    MIDDLE_COUNT,
    MIDDLE_MOST,
    STATE_COUNT,
    STATE_MOST,
    STATES,
    WORK,
    WORK_MOST,
    Context,
    Goals,
)
from koord.kernels.entering import await_code, enter_code, renamed, settle_code
from koord.kernels.environment_turns import environment_turns_code, idle_cells, ways_of
from koord.kernels.layout import Layout
from koord.kernels.module import RoundModule
from koord.kernels.races import races_code
from koord.kernels.tables import (
    MIDDLE_TABLE,
    STATE_TABLE,
    hash_code,
    insert_code,
    lookup_code,
    rehash_code,
)
from koord.kernels.terms import NoKernelError
from koord.kernels.turn_code import course, environment_code, event_code, statement_code
from koord.kernels.turns import TurnMaker
from koord.machine.code import (
    BYTES,
    I1,
    I64,
    Code,
    Ir,
    Loaded,
    TooMuchCodeError,
    constant,
    new_module,
    word,
)
from koord.syntax.analysis.footprint import rewritten
from koord.syntax.system import Status

#: More robots have no machine code: what writers that meet come to is written out for each two.
_MOST_ROBOTS = 16


class Rounds:
    """The machine code of a system's rounds. Raises NoKernelError where there is none."""

    def __init__(self, layout: Layout, goals: Goals, bits: int) -> None:
        self.layout, self.goals = layout, goals
        self.cells = Cells(layout, bits)
        maker = TurnMaker(layout, bits)
        self.of = round_module(self.cells, goals, maker)
        self._write(maker)
        try:
            self._loaded = Loaded(self.of.module)
        except TooMuchCodeError as error:
            raise NoKernelError(str(error)) from None
        self.expand = self._loaded.function("expand", 3)
        self.enter = self._loaded.function("enter", 2)
        self.lookup = self._loaded.function("lookup", 2)
        self.canonical = self._loaded.function("canonical", 3)
        self.rehash = self._loaded.function("rehash", 4)

    def _write(self, maker: TurnMaker) -> None:
        """Write the functions into the module."""
        _Writer(self.of).write()


def round_module(cells: Cells, goals: Goals, maker: TurnMaker) -> RoundModule:
    """The module of a system with its turns and statements as terms. Raises NoKernelError."""
    layout, system = cells.layout, cells.layout.system
    if system.robots > _MOST_ROBOTS:
        raise NoKernelError(f"there are more than {_MOST_ROBOTS} robots")
    updates = rewritten(system.program)
    environments = tuple(
        maker.environment(i) if system.agent(i).modules else None for i in range(system.robots)
    )
    return RoundModule(
        new_module("kernels"),
        cells,
        goals,
        tuple(
            tuple(
                maker.event(i, e, updates.get((kind, e), frozenset()))
                for e in range(len(system.program.agents[kind].events))
            )
            for i, kind in enumerate(system.kinds)
        ),
        environments,
        tuple(maker.statement(e, bound) for e, bound in goals.statements),
        course(cells, max(r.end - r.first for r in layout.robots)),
        idle_cells(environments),
    )


def turns_code(of: RoundModule) -> tuple[list[list[Ir]], list[Ir | None]]:
    """The functions of all events by robot, and of the environments' turns."""
    module, cells = of.module, of.cells
    events = [
        [
            event_code(module, f"event_{i}_{e}", turn, i, cells, of.course)
            for e, turn in enumerate(turns)
        ]
        for i, turns in enumerate(of.events)
    ]
    environments = [
        environment_code(module, f"environment_{i}", turn, cells) if turn is not None else None
        for i, turn in enumerate(of.environments)
    ]
    return events, environments


def stop_all(code: Code, of: RoundModule, state: Ir) -> None:
    """Stop all robots if all have asked for it or stopped. [STOP]"""
    b, cells = code.b, of.cells
    statuses = [robot.status for robot in of.layout.robots]
    stop: Ir = constant(I1, 1)
    for status in statuses:
        if status is None:
            return
        runs = b.icmp_signed("==", cells.read(code, state, status), word(int(Status.RUNNING)))
        stop = b.and_(stop, b.not_(runs))
    with b.if_then(stop):
        for status in statuses:
            assert status is not None
            stopped = cells.narrow(code, word(int(Status.STOPPED)))
            code.put(state, status * cells.size, stopped)


def expand_code(
    of: RoundModule,
    expand_one: Ir,
    tables: Sequence[tuple[int, int]],
    *,
    begun: Callable[[Context], None] = lambda context: None,
    ended: Callable[[Context, Ir], None],
) -> None:
    """``expand(context, first, end)``: all rounds from some states; which state is next.

    It comes back early where one of the ``tables`` (a count, and its most) is to grow, where so
    much work is done, and where machine code cannot go on. ``begun`` and ``ended`` write what is
    done before and behind each state; ``ended`` is given the number of the next one.
    """
    code = Code(of.module, "expand", (BYTES, I64, I64), I64)
    address, first, end = code.arguments
    context = Context(code, address)
    b, number = code.b, code.slot(I64)
    b.store(first, number)

    def goes_on() -> Ir:
        more = b.icmp_signed("<", b.load(number), end)
        for count, most in (*tables, (WORK, WORK_MOST)):
            more = b.and_(more, b.icmp_signed("<", context.get(count), context.get(most)))
        is_left = b.icmp_signed("!=", context.get(LEFT), word(0))
        return b.and_(more, b.not_(is_left))

    with code.while_(goes_on):
        here = b.load(number)
        context.put(CURRENT, here)
        begun(context)
        state = code.at(context.block(STATES), b.mul(here, word(of.cells.state_bytes)))
        b.call(expand_one, [address, state])
        after = b.add(here, word(1))
        ended(context, after)
        b.store(after, number)
    b.ret(b.load(number))


class _Writer:
    """A writer of the functions that the others are called from, in the order of their calls."""

    def __init__(self, of: RoundModule) -> None:
        self.of = of

    def write(self) -> None:
        of = self.of
        module, cells = of.module, of.cells
        self.canonical = canonical_code(module, cells)
        events, turns = turns_code(of)
        self.statements = [
            statement_code(module, f"statement_{k}", holds, cells)
            for k, holds in enumerate(of.statements)
        ]
        hashed = hash_code(module, cells)
        self.insert_state = insert_code(module, cells, STATE_TABLE, "insert_state", hashed)
        self.insert_middle = insert_code(module, cells, MIDDLE_TABLE, "insert_middle", hashed)
        lookup_code(module, cells, STATE_TABLE, hashed)
        rehash_code(module, cells, hashed)
        enter_code(of, self.canonical, self.insert_state, self.statements)
        self.settle = settle_code(of, hashed, self.insert_state, self.statements)
        self.enter = await_code(of, self.canonical, self.settle)
        environment = environment_turns_code(of, turns, self.enter)
        middle = self._middle(environment)
        races = races_code(of, middle)
        expand_one = expand_one_code(of, events, middle, races, ways_of(of.environments))
        tables = ((STATE_COUNT, STATE_MOST), (MIDDLE_COUNT, MIDDLE_MOST))
        expand_code(of, expand_one, tables, ended=self._settle)

    def _middle(self, environment: Ir) -> Ir:
        """``middle(context, state)``: what becomes of the end of the program turns. [END-PROG]
        [T-PREFIX]
        """
        of = self.of
        code = Code(of.module, "middle", (BYTES, BYTES), I64)
        context, state = Context(code, code.arguments[0]), code.arguments[1]
        b, cells = code.b, of.cells
        context.add(WORK, word(1))
        stop_all(code, of, state)
        for goal in self._in_middles():
            with b.if_then(b.not_(b.call(self.statements[goal], [state]))):
                context.find(goal, context.behind())
        if not of.has_environment:
            b.call(self.enter, [context.address, state])
        else:
            for cell in sorted(of.idle):
                code.put(state, cell * cells.size, constant(cells.type, 0))
            kept = renamed(code, of, self.canonical, state)
            number = b.call(self.insert_middle, [context.address, kept])
            with b.if_then(b.icmp_signed(">=", number, word(0))):
                b.call(environment, [context.address, kept])
        b.ret(word(0))
        return code.function

    def _in_middles(self) -> list[int]:
        """The statements that are looked at between the program turns and the environment's."""
        of = self.of
        may_be_last = any(
            e is not None and (e.possible is not True or e.faults is not False)
            for e in of.environments
        )
        inside = of.goals.inside
        return sorted(inside if may_be_last else inside & of.goals.on_ports)

    def _settle(self, context: Context, _after: Ir) -> None:
        """Enter the states behind the one that was expanded."""
        context.code.b.call(self.settle, [context.address])
