"""The other solver: the only file that knows cvc5. It is given text, as anyone could give it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from types import ModuleType
from typing import Any

#: About what cvc5 does in a second, in its own units: a limit in them is the same on any machine.
PER_SECOND = 100_000


class Answer(Enum):
    """What a solver says of a question."""

    SAT = "sat"
    UNSAT = "unsat"
    UNKNOWN = "unknown"


class MissingSolverError(Exception):
    """cvc5 is not installed."""


class TextError(Exception):
    """A text that cvc5 cannot read."""


def _cvc5() -> ModuleType:
    try:
        import cvc5
    except ImportError as error:
        raise MissingSolverError from error
    return cvc5  # type: ignore[no-any-return]


def version() -> str:
    """Which cvc5 it is. Raises MissingSolverError."""
    found = getattr(_cvc5(), "__version__", "")
    return f"cvc5 {found}".strip()


_OPTIONS = {
    "incremental": "true",
    "produce-models": "true",
    "global-declarations": "true",
    "strings-exp": "true",
    "arrays-exp": "true",
}


@dataclass(slots=True)
class Session:
    """One run of cvc5, fed with commands."""

    _solver: Any
    _parser: Any
    _symbols: Any
    _language: Any

    @staticmethod
    def start(seed: int = 0) -> Session:
        """Raises MissingSolverError."""
        cvc5 = _cvc5()
        manager = cvc5.TermManager()
        solver = cvc5.Solver(manager)
        options = {**_OPTIONS, "seed": str(seed)}
        for name, value in options.items():
            solver.setOption(name, value)
        symbols = cvc5.SymbolManager(manager)
        parser = cvc5.InputParser(solver, symbols)
        session = Session(solver, parser, symbols, cvc5.InputLanguage.SMT_LIB_2_6)
        session.tell(["(set-logic ALL)"])
        return session

    def tell(self, commands: Iterable[str]) -> str:
        """Run commands; what they print. Raises TextError."""
        said = []
        try:
            self._parser.setStringInput(self._language, "\n".join(commands), "obligations")
            while not (command := self._parser.nextCommand()).isNull():
                said.append(str(command.invoke(self._solver, self._symbols)))
        except RuntimeError as error:  # of the parser
            raise TextError(" ".join(str(error).split())[:300]) from error
        answer = "".join(said)
        if "(error" in answer:
            raise TextError(" ".join(answer.split())[:300])
        return answer

    def allow(self, seconds: float) -> None:
        """How long a question may take from here on."""
        self.tell([f"(set-option :tlimit-per {max(1, int(seconds * 1000))})"])

    def check(self) -> Answer:
        """Whether what is asserted can hold."""
        said = self.tell(["(check-sat)"]).split()
        return Answer(said[-1]) if said and said[-1] in ("sat", "unsat") else Answer.UNKNOWN

    def values(self, terms: Sequence[str]) -> list[str]:
        """What the model says of terms, after ``sat``."""
        found = []
        for term in terms:
            said = self.tell([f"(get-value ({term}))"]).strip()
            found.append(_value(said))
        return found


def _value(said: str) -> str:
    """The value in ``((term value))``, as a person writes it."""
    depth, start, quoted = 0, 0, False
    inner = said[2:-2]
    for k, letter in enumerate(inner):
        if letter == "|":
            quoted = not quoted
        if quoted:
            continue
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if depth == 0 and letter in " )" and k + 1 < len(inner):
            start = k + 1
            break
    return plain(inner[start:].strip())


def plain(value: str) -> str:
    """``(- 5)`` as -5, ``(/ 1 2)`` as 1/2, ``1.0`` as 1; anything else as it is."""
    value = re.sub(r"\(/ (\(- )?(\d+)(?:\.0)?\)? (\d+)(?:\.0)?\)", _fraction, value)
    value = re.sub(r"\(- (\d+(?:/\d+)?)(?:\.0)?\)", r"-\1", value)
    return re.sub(r"\b(\d+)\.0\b", r"\1", value)


def _fraction(match: re.Match[str]) -> str:
    sign = "-" if match.group(1) else ""
    return f"{sign}{match.group(2)}/{match.group(3)}"


def answer_of(text: str, seconds: float) -> Answer:
    """What cvc5 says of a whole script that someone else wrote. Raises TextError."""
    session = Session.start()
    session.allow(seconds)
    said = session.tell([line for line in text.splitlines() if "(set-logic" not in line]).split()
    return Answer(said[-1]) if said and said[-1] in ("sat", "unsat") else Answer.UNKNOWN
