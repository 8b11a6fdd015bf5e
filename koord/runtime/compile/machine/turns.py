"""The machine code of a program's turns: guards of all robots by one call, and effects of events.

Of each kind there is a function that looks at the guards of its robots, and of each event one that
runs it for robots that have chosen it. What has no code is left to compiled robots, as is a robot
where code is in doubt.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import msgspec
from msgspec import Struct

from koord.machine.code import (
    BYTES,
    I8,
    I64,
    WORD_BYTES,
    Code,
    Ir,
    TooMuchCodeError,
    new_module,
    word,
)
from koord.machine.kept import keep
from koord.runtime.compile.machine.body import STATE, Body, Budget
from koord.runtime.compile.machine.claims import ClaimsCode
from koord.runtime.compile.machine.expressions import truth
from koord.runtime.compile.machine.kept_turns import (
    ToldColumn,
    ToldKind,
    ToldTurns,
    assembled,
)
from koord.runtime.compile.machine.layout import Column, Layout, NoCodeError
from koord.runtime.compile.machine.made import (
    HEAD_WORDS,
    IN_DOUBT,
    NO,
    YES,
    Turns,
)
from koord.runtime.compile.machine.statements import block
from koord.runtime.compile.naming import PythonNames
from koord.runtime.compile.watching import Watched
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.walk import reached, written

#: Events are bits of a word, and so are classes of locks.
_MOST_BITS = 63


def turns_of(program: core.Program, watched: Watched | None, key: str | None) -> Turns | None:
    """Compile the turns of a program, and its claims; None where there is no use of it.

    They are kept, under a key if there is one.
    """
    return _Making(program, watched, key).turns()


class _Written(Struct):
    """The columns that events of a kind write, None without code; bits of guards without any."""

    columns: list[tuple[Column, ...] | None]
    without: int


class _Making:
    def __init__(self, program: core.Program, watched: Watched | None, key: str | None) -> None:
        self.program, self.watched, self.key = program, watched, key
        self.module = new_module("turns")
        self.layout = Layout(PythonNames(program))
        self.budget = Budget()

    def turns(self) -> Turns | None:
        if len(self.program.lock_classes) > _MOST_BITS:
            return None
        made = [self._kind(kind, agent) for kind, agent in enumerate(self.program.agents)]
        if not any(one is not None for one in made):
            return None
        claims: ClaimsCode | None = None
        if self.watched is not None:
            claims = ClaimsCode(self.module, self.watched, self.layout, self.budget)
        known = {id(column): k for k, column in enumerate(self.layout.columns.values())}
        kinds = tuple(
            None
            if one is None
            else ToldKind(tuple(_told(known, columns) for columns in one.columns), one.without)
            for one in made
        )
        columns = tuple(ToldColumn(w, home.value, slot) for w, home, slot in self.layout.columns)
        told = ToldTurns(columns, kinds, {} if claims is None else claims.told())
        about = msgspec.json.encode(told)
        try:
            code = keep(self.key, self.module, about, hasty=True)
        except TooMuchCodeError:
            return None
        return assembled(self.program, self.watched, told, code)

    def _kind(self, kind: int, agent: core.Agent) -> _Written | None:
        """What the events of a kind write, of those that have code; None if no guard has."""
        if len(agent.events) > _MOST_BITS:
            return None
        guards = [self._guard(kind, k, event) for k, event in enumerate(agent.events)]
        if not any(guards):
            return None
        without = sum(1 << k for k, has_code in enumerate(guards) if not has_code)
        self._all_guards(kind, guards, without)
        effects = [
            self._effect(kind, k, event) if guards[k] else None
            for k, event in enumerate(agent.events)
        ]
        return _Written(effects, without)

    # --- one robot --------------------------------------------------------------------------------

    def _guard(self, kind: int, number: int, event: core.Event) -> bool:
        """Compile a guard as a function of a robot; False if it has no code."""
        name = f"guard_{kind}_{number}"
        code = Code(self.module, name, [*STATE, I64], I64)
        code.function.linkage = "internal"
        *state, robot = code.arguments
        doubtful = _ending(code, IN_DOUBT)
        body = Body(
            code, self.program, self.layout, kind, state, robot, doubtful, block, self.budget
        )
        with suppress(NoCodeError):
            holds = truth(body, event.guard)
            code.b.ret(code.b.zext(holds, I64))
            return True
        del self.module.globals[name]
        return False

    def _effect(self, kind: int, number: int, event: core.Event) -> tuple[Column, ...] | None:
        """Compile an event as a function of a robot and the address of what it writes."""
        name = f"effect_{kind}_{number}"
        code = Code(self.module, name, [*STATE, I64, BYTES, BYTES], I64)
        code.function.linkage = "internal"
        *state, robot, words, flags = code.arguments
        doubtful = _ending(code, IN_DOUBT)
        body = Body(
            code, self.program, self.layout, kind, state, robot, doubtful, block, self.budget
        )
        with suppress(NoCodeError):
            columns = self._banked(body, event, words, flags)
            block(body, event.effect)
            code.put(words, 0, code.b.load(body.locks))
            code.put(words, WORD_BYTES, code.b.load(body.asked))
            code.b.ret(word(NO))
            self._all_effects(kind, number, columns)
            return columns
        del self.module.globals[name]
        return None

    def _banked(self, body: Body, event: core.Event, words: Ir, flags: Ir) -> tuple[Column, ...]:
        """Copy what an event may write into cells of its own."""
        places = [p for node in reached(self.program, event.effect) for p in written(node)]
        variables = {
            (p.variable.home, p.variable.slot): p.variable
            for p in places
            if p.variable.home is not Home.BOUND
        }
        code, b, columns, first = body.code, body.b, [], HEAD_WORDS
        body.locks, body.asked = code.slot(I64), code.slot(I64)
        b.store(word(0), body.locks)
        b.store(word(0), body.asked)
        for variable in variables.values():
            column = self.layout.column(body.kind, variable)
            if variable.home is Home.ALLWRITE:
                source = body.cells_at(body.shared, body.shared_flags, column.first)
            else:
                source = body.cells_of(column, body.robot)
            own = body.cells_at(body.as_words(words), flags, first)
            own.is_banked = True
            for leaf in range(len(column.leaves)):
                there, here = source.index(leaf), own.index(leaf)
                for block_, own_block in ((source.words, own.words), (source.flags, own.flags)):
                    b.store(b.load(b.gep(block_, [there])), b.gep(own_block, [here]))
            body.banked[id(column)] = own
            columns.append(column)
            first += len(column.leaves)
        return tuple(columns)

    # --- all robots -------------------------------------------------------------------------------

    def _all_guards(self, kind: int, guards: Sequence[bool], without: int) -> None:
        """Compile the look at all guards, of so many robots."""
        arguments = [*STATE, BYTES, I64, BYTES, BYTES, BYTES]
        code = Code(self.module, f"guards_{kind}", arguments, I64)
        *state, robots, count, enabled, doubtful, some = code.arguments
        b = code.b
        found = code.slot(I64)
        b.store(word(0), found)
        with code.loop(word(0), count) as index:
            robot = code.get(robots, b.mul(index, word(WORD_BYTES)), I64)
            yes, unsure = word(0), word(without)
            for number, has_code in enumerate(guards):
                if has_code:
                    said = self._ask(code, f"guard_{kind}_{number}", [*state, robot])
                    bit = word(1 << number)
                    yes = b.or_(yes, b.select(_is(b, said, YES), bit, word(0)))
                    unsure = b.or_(unsure, b.select(_is(b, said, IN_DOUBT), bit, word(0)))
            at = b.mul(robot, word(WORD_BYTES))
            code.put(enabled, at, yes)
            code.put(doubtful, at, unsure)
            with code.only_if(b.icmp_unsigned("!=", b.or_(yes, unsure), word(0))):
                now = b.load(found)
                code.put(some, b.mul(now, word(WORD_BYTES)), robot)
                b.store(b.add(now, word(1)), found)
        b.ret(b.load(found))

    def _all_effects(self, kind: int, number: int, columns: Sequence[Column]) -> None:
        """Compile the run of an event, for so many robots."""
        arguments = [*STATE, BYTES, I64, BYTES, BYTES, BYTES]
        code = Code(self.module, f"run_{kind}_{number}", arguments, I64)
        *state, robots, count, words, flags, verdicts = code.arguments
        b = code.b
        each = HEAD_WORDS + sum(len(column.leaves) for column in columns)
        with code.loop(word(0), count) as index:
            robot = code.get(robots, b.mul(index, word(WORD_BYTES)), I64)
            first = b.mul(index, word(each))
            own = code.at(words, b.mul(first, word(WORD_BYTES)))
            given = [*state, robot, own, code.at(flags, first)]
            said = self._ask(code, f"effect_{kind}_{number}", given)
            code.put(verdicts, index, b.trunc(said, I8))
        b.ret(word(0))

    def _ask(self, code: Code, name: str, arguments: Sequence[Ir]) -> Ir:
        return code.b.call(self.module.globals[name], list(arguments))


def _told(known: dict[int, int], columns: Sequence[Column] | None) -> tuple[int, ...] | None:
    return None if columns is None else tuple(known[id(column)] for column in columns)


def _is(b: Ir, said: Ir, what: int) -> Ir:
    return b.icmp_unsigned("==", said, word(what))


def _ending(code: Code, verdict: int) -> Ir:
    """A block that ends the function with a verdict."""
    ending = code.b.append_basic_block("doubtful")
    with code.b.goto_block(ending):
        code.b.ret(word(verdict))
    return ending
