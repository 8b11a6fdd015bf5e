"""The LALR table of the line grammar, and the machine that runs on it.

The table is prepared from ``grammar.lark`` by ``table_maker.py``: making it takes longer than
reading most programs.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from msgspec import Struct
from msgspec.json import decode

#: The terminal for the end of a line.
END = "$END"

#: Where the table is kept.
FILE = os.path.join(os.path.dirname(__file__), "table.json")


class Form(Struct, frozen=True):
    """A start symbol of the grammar: the states in which its lines begin and end."""

    begin: int
    end: int


class Rule(Struct, frozen=True):
    """A rule: the symbol that it makes of ``size`` symbols, and who makes its node."""

    symbol: str
    size: int
    method: str


class Table(Struct, frozen=True):
    """An LALR table.

    ``states`` give for each symbol the next state, or ``-1 - n`` where rule n ends before it.
    Terminals are in capitals, all others are symbols of rules.
    """

    forms: Mapping[str, Form]
    rules: tuple[Rule, ...]
    states: tuple[Mapping[str, int], ...]


@cache
def table() -> Table:
    """The table of the line grammar."""
    with open(FILE, "rb") as file:
        return decode(file.read(), type=Table)


class RefusedError(Exception):
    """Raised for a terminal that may not come next."""


class Machine:
    """The machine at some position of a line, which makes nodes by the methods of a builder."""

    __slots__ = ("_end", "_makers", "_nodes", "_rules", "_stack", "_states")

    def __init__(self, form: str, makers: tuple[Callable[[list[Any]], Any], ...]) -> None:
        found = table()
        self._rules, self._states, self._makers = found.rules, found.states, makers
        self._stack = [found.forms[form].begin]
        self._end = found.forms[form].end
        self._nodes: list[Any] = []

    def feed(self, terminal: str, token: Any) -> None:
        """Take the next token. Raises RefusedError where no form of line allows it."""
        while not self._advance(terminal):
            pass
        self._nodes.append(token)

    def finish(self) -> Any:
        """The node of the line that is at its end. Raises RefusedError if it is too short."""
        while self._stack[-1] != self._end:
            self._advance(END)
        return self._nodes[-1]

    def _advance(self, terminal: str) -> bool:
        """Go on to the next state, or end a rule before it; return whether it was the former."""
        stack, nodes = self._stack, self._nodes
        try:
            action = self._states[stack[-1]][terminal]
        except KeyError:
            raise RefusedError from None
        if action >= 0:
            stack.append(action)
            return True
        rule = self._rules[-1 - action]
        made = self._makers[-1 - action](nodes[-rule.size :])
        del nodes[-rule.size :], stack[-rule.size :]
        nodes.append(made)
        stack.append(self._states[stack[-1]][rule.symbol])
        return False

    def possible(self) -> set[str]:
        """The terminals that may come next."""
        return {name for name in self._states[self._stack[-1]] if self._accepts(name)}

    def _accepts(self, terminal: str) -> bool:
        """Return whether a terminal may come next: LALR tables end rules before they find out."""
        if not terminal.isupper():
            return False
        stack = list(self._stack)
        while terminal in self._states[stack[-1]]:
            action = self._states[stack[-1]][terminal]
            if action >= 0:
                return True
            rule = self._rules[-1 - action]
            del stack[-rule.size :]
            stack.append(self._states[stack[-1]][rule.symbol])
            if terminal == END and stack[-1] == self._end:
                return True
        return False
