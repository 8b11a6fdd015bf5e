"""The machine code of claims about states: of whom it is not sure that they hold.

Code is *sure* that a claim holds, or it names the robots; whether it holds for these, and what of
it faults, is decided by the compiled claim. So a claim that code has looked at is broken exactly
where the compiled one is.
"""

from __future__ import annotations

from contextlib import suppress
from itertools import product

from koord.machine.code import BYTES, I64, WORD_BYTES, Code, Ir, word
from koord.runtime.compile.machine.body import STATE, Body, Budget
from koord.runtime.compile.machine.expressions import truth
from koord.runtime.compile.machine.kept_turns import ToldClaim
from koord.runtime.compile.machine.layout import Layout, NoCodeError
from koord.runtime.compile.machine.made import IN_DOUBT, YES
from koord.runtime.compile.machine.statements import block
from koord.runtime.compile.watching import Watched, WatchedClaim, WatchedKind
from koord.syntax import core

#: Claims about more robots are left to Python, as are those about so many pairs of kinds.
_MOST_ROBOTS, _MOST_PAIRS = 2, 4

#: What a look at a claim is given behind the state.
_LISTS = [BYTES, I64, BYTES, I64, BYTES, I64]


class ClaimsCode:
    """Claims, which are compiled into a module."""

    def __init__(self, module: Ir, watched: Watched, layout: Layout, budget: Budget) -> None:
        self._module, self._program = module, watched.program
        self._layout, self._budget = layout, budget
        self._names: dict[str, list[ToldClaim]] = {}
        for claim in watched.claims:
            if claim.sort not in (WatchedKind.CONTRACT, WatchedKind.SUMMARY):
                self._claim(claim)

    def told(self) -> dict[str, tuple[ToldClaim, ...]]:
        """The functions of claims by method."""
        return {method: tuple(names) for method, names in self._names.items()}

    def _claim(self, claim: WatchedClaim) -> None:
        """Compile a claim for all kinds of robots that it is about, or for none."""
        agents = range(len(self._program.agents))
        whose = [agents if agent is None else (agent,) for agent in claim.agents]
        pairs = list(product(*whose))
        if len(claim.agents) > _MOST_ROBOTS or len(pairs) > _MOST_PAIRS:
            return
        names: list[ToldClaim] = []
        made: list[str] = []
        with suppress(NoCodeError):
            for kinds in pairs:
                self._holds(f"holds_{claim.method}_{len(names)}", claim, kinds, made)
                self._look(f"look_{claim.method}_{len(names)}", made)
                names.append(ToldClaim(made[-1], kinds))
            self._names[claim.method] = names
            return
        for name in made:
            del self._module.globals[name]

    def _holds(
        self, name: str, claim: WatchedClaim, kinds: tuple[int, ...], made: list[str]
    ) -> None:
        """Compile a claim as a function of two robots: whether it is sure to hold."""
        code = Code(self._module, name, [*STATE, I64, I64], I64)
        made.append(name)
        code.function.linkage = "internal"
        *state, one, other = code.arguments
        doubtful = code.b.append_basic_block("doubtful")
        with code.b.goto_block(doubtful):
            code.b.ret(word(IN_DOUBT))
        body = Body(code, self._program, self._layout, 0, state, one, doubtful, block, self._budget)
        function = self._program.function(claim.stated)
        (returned,) = function.body
        assert isinstance(returned, core.Return)
        assert returned.value is not None
        body.watched = {}
        for variable, robot, kind in zip(function.parameters, (one, other), kinds, strict=False):
            body.store(body.bound(variable), 0, variable.type, [robot])
            body.watched[variable.slot] = robot, kind
        code.b.ret(code.b.zext(truth(body, returned.value), I64))

    def _look(self, name: str, made: list[str]) -> None:
        """Compile the look at all robots, or pairs of them."""
        code = Code(self._module, name, [*STATE, *_LISTS], I64)
        made.append(name)
        holds = self._module.globals[made[-2]]
        *state, ones, count, others, other_count, found, room = code.arguments
        b, number = code.b, code.slot(I64)
        b.store(word(0), number)
        full = b.append_basic_block("full")
        with code.loop(word(0), count) as first, code.loop(word(0), other_count) as second:
            pair = [
                code.get(robots, b.mul(at, word(WORD_BYTES)), I64)
                for robots, at in ((ones, first), (others, second))
            ]
            said = b.call(holds, [*state, *pair])
            with code.only_if(b.icmp_unsigned("!=", said, word(YES))):
                known = b.load(number)
                b.store(b.add(known, word(1)), number)
                there = b.append_basic_block("there")
                b.cbranch(b.icmp_signed("<", known, room), there, full)
                b.position_at_end(there)
                for k, robot in enumerate(pair):
                    at = b.add(b.mul(known, word(2)), word(k))
                    code.put(found, b.mul(at, word(WORD_BYTES)), robot)
        b.ret(b.load(number))
        b.position_at_end(full)
        b.ret(b.load(number))
