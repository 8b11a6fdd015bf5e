"""The solver cvc5, in a process of its own: the only file that uses it.

It runs in a process of its own: whatever it does, be it to crash, the one that asks goes on.
"""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from types import ModuleType
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from koord.recheck.script import SanitisedScript
from koord.syntax.forking import FORKING

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess


class SolverAnswer(Enum):
    """The answer of a solver to a query."""

    SAT = "sat"
    UNSAT = "unsat"
    UNKNOWN = "unknown"


class MissingSolverError(Exception):
    """Raised where cvc5 is not installed."""


class TextError(Exception):
    """Raised for a text that cvc5 cannot read."""


class SolverEndedError(Exception):
    """Raised where cvc5 ended during a query, as by a crash; its state is lost."""


def _cvc5() -> ModuleType:
    try:
        import cvc5
    except ImportError as error:
        raise MissingSolverError from error
    return cvc5  # type: ignore[no-any-return]


def version() -> str:
    """The version of cvc5. Raises MissingSolverError."""
    found = getattr(_cvc5(), "__version__", "")
    return f"cvc5 {found}".strip()


_OPTIONS = {
    "incremental": "true",
    "produce-models": "true",
    "global-declarations": "true",
    "strings-exp": "true",
    "arrays-exp": "true",
}

#: All theories, with quantifiers.
_ALL = "(set-logic ALL)"

#: How long an answer is waited for at a time, in seconds.
_WAIT_S = 0.1

#: How much longer than it may a solver can take to say so, and to read a script, in seconds.
_GRACE_S = 20.0

#: For how many times as long it is waited for where others have the cores.
_PATIENCE = 5


class SolverSession(Struct):
    """A session with cvc5, fed with commands. It is closed at the end of a ``with``."""

    _process: BaseProcess
    _line: Connection
    _untold: list[str]  #: commands that print nothing: they go with the next that does
    _waiting: Callable[[], None]  #: asked while it is waited for; what it raises ends the session
    _is_over: bool = False
    _question_s: float | None = None

    @staticmethod
    def start(
        seed: int = 0, logic: str = _ALL, waiting: Callable[[], None] = lambda: None
    ) -> SolverSession:
        """Start a session. Raises MissingSolverError."""
        _cvc5()  # whoever is forked from this process has it then
        can_fork = "fork" in multiprocessing.get_all_start_methods()
        context = multiprocessing.get_context("fork" if can_fork else "spawn")
        with FORKING:
            ours, theirs = context.Pipe()
            process = context.Process(  # type: ignore[attr-defined]
                target=_serve, args=(theirs, ours if can_fork else None, seed), daemon=True
            )
            process.start()
            theirs.close()
        return SolverSession(process, ours, [logic], waiting)

    def __enter__(self) -> SolverSession:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process, whatever it is doing."""
        if not self._is_over:
            self._is_over = True
            with FORKING:
                self._process.kill()
                self._process.join()
            self._line.close()

    def tell(self, commands: Iterable[str]) -> None:
        """Queue commands without output, to run before the next query."""
        self._untold += commands

    def ask(self, commands: Iterable[str], within_s: float | None = None) -> str:
        """Run commands and return their output.

        Raises TextError, SolverEndedError, and what is raised by who is asked while it waits.
        """
        if self._is_over:
            raise SolverEndedError("cvc5 has ended")
        self.tell(commands)
        script, self._untold = "\n".join(self._untold), []
        try:
            self._line.send(script)
            begun, worked = time.monotonic(), self._cpu_s()
            while not self._line.poll(_WAIT_S):
                self._waiting()
                if within_s is not None and self._is_late(begun, worked, within_s):
                    self.close()
                    raise SolverEndedError("cvc5 did not end in time")
            said, problem = self._line.recv()
        except (EOFError, OSError) as error:
            with FORKING:
                self._process.join()
                code = self._process.exitcode or 0
            self.close()
            raise SolverEndedError(f"cvc5 {_end(code)}") from error
        if problem:
            raise TextError(problem)
        return str(said)

    def _is_late(self, begun: float, worked: float | None, within_s: float) -> bool:
        """Return whether a solver has worked for longer than it may; where nobody knows, waited."""
        took_s, cpu_s = time.monotonic() - begun, self._cpu_s()
        if took_s < within_s:
            return False
        if worked is None or cpu_s is None:
            return True
        return cpu_s - worked >= within_s or took_s >= _PATIENCE * within_s

    def _cpu_s(self) -> float | None:
        """The time for which the solver has worked, if that can be told."""
        if sys.platform != "linux" or self._process.pid is None:
            return None
        try:
            # What clock_getcpuclockid(3) makes of a process.
            return time.clock_gettime((~self._process.pid << 3) | 2)
        except OSError:
            return None

    def allow(self, seconds: float) -> None:
        """Set the time limit of later queries, in seconds."""
        self.tell([f"(set-option :tlimit-per {max(1, int(seconds * 1000))})"])
        self._question_s = seconds + _GRACE_S

    def check(self) -> SolverAnswer:
        """Check whether the assertions are satisfiable."""
        said = self.ask(["(check-sat)"], self._question_s).split()
        return (
            SolverAnswer(said[-1])
            if said and said[-1] in ("sat", "unsat")
            else SolverAnswer.UNKNOWN
        )

    def values(self, terms: Sequence[str]) -> list[str]:
        """The values of terms in the model, after ``sat``."""
        found = []
        for term in terms:
            said = self.ask([f"(get-value ({term}))"], _GRACE_S).strip()
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
    """Rewrite ``(- 5)`` as -5, ``(/ 1 2)`` as 1/2, ``1.0`` as 1; leave anything else."""
    value = re.sub(r"\(/ (\(- )?(\d+)(?:\.0)?\)? (\d+)(?:\.0)?\)", _fraction, value)
    value = re.sub(r"\(- (\d+(?:/\d+)?)(?:\.0)?\)", r"-\1", value)
    return re.sub(r"\b(\d+)\.0\b", r"\1", value)


def _fraction(match: re.Match[str]) -> str:
    sign = "-" if match.group(1) else ""
    return f"{sign}{match.group(2)}/{match.group(3)}"


def read(script: SanitisedScript, waiting: Callable[[], None]) -> None:
    """Check that cvc5 can read a foreign script. Raises what a session's ``ask`` raises."""
    with SolverSession.start(0, script.logic or _ALL, waiting) as session:
        session.ask(script.commands, _GRACE_S)


def answer_of(script: SanitisedScript, seconds: float, waiting: Callable[[], None]) -> SolverAnswer:
    """The answer of cvc5 to a foreign script. Raises what a session's ``ask`` raises."""
    with SolverSession.start(0, script.logic or _ALL, waiting) as session:
        session.ask(script.commands, _GRACE_S)
        session.allow(seconds)
        return session.check()


# --- inside the process ---------------------------------------------------------------------------


def _serve(line: Connection, others: Connection | None, seed: int) -> None:
    """Run commands and send their output, until the session ends."""
    if others is not None:
        others.close()  # or the end of the one that asks would not be noticed
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the one that asks
    faulthandler.disable()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # last words of a solver that crashes
    solver = _Solver.start(seed)
    while True:
        try:
            text = line.recv()
        except (EOFError, OSError):
            return
        line.send(solver.told(text))


class _Solver(Struct):
    """cvc5, with a parser for its commands."""

    _solver: Any
    _parser: Any
    _symbols: Any
    _language: Any

    @staticmethod
    def start(seed: int) -> _Solver:
        cvc5 = _cvc5()
        manager = cvc5.TermManager()
        solver = cvc5.Solver(manager)
        options = {**_OPTIONS, "seed": str(seed)}
        for name, value in options.items():
            solver.setOption(name, value)
        symbols = cvc5.SymbolManager(manager)
        parser = cvc5.InputParser(solver, symbols)
        return _Solver(solver, parser, symbols, cvc5.InputLanguage.SMT_LIB_2_6)

    def told(self, text: str) -> tuple[str, str]:
        """The output of commands, and the error message if there is one."""
        said = []
        try:
            self._parser.setStringInput(self._language, text, "obligations")
            while not (command := self._parser.nextCommand()).isNull():
                said.append(str(command.invoke(self._solver, self._symbols)))
        except RuntimeError as error:  # of the parser
            return "", _brief(str(error)) or "cvc5 cannot read it"
        answer = "".join(said)
        return answer, _brief(answer) if "(error" in answer else ""


def _brief(text: str) -> str:
    return " ".join(text.split())[:300]


def _end(code: int) -> str:
    """Describe the end of a process."""
    if code < 0:
        name = signal.Signals(-code).name if -code in set(signal.Signals) else str(-code)
        return f"crashed ({name})"
    return f"ended by itself (exit code {code})"
