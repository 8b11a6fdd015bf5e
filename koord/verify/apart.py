"""A time limit for each claim: who takes long is given up, and keeps nobody else waiting.

Engines work best on all claims together: a round is encoded once, and one claim helps to prove
another. So all are asked together first, for as long as one may take. What is open then is asked
claim by claim, each with its own time and with what is proved as lemmas; claims that know nothing
of each other can be asked in several processes, and the answers are those of one.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from koord.semantics.configurations import System
from koord.semantics.patience import ENDLESS
from koord.syntax.diagnostics import Diagnostic, KoordError
from koord.verify.portfolio import Choice, verify
from koord.verify.solving import Deadline
from koord.verify.verdicts import Bounds, Outcome, Report, Verdict

#: How long answers of other processes are waited for at a time.
_WAIT_S = 0.05


@dataclass(frozen=True, slots=True)
class _Question:
    """One claim by itself. ``before`` are the verdicts on all claims so far."""

    system: System
    bounds: Bounds
    choice: Choice
    name: str
    before: tuple[Verdict, ...]
    seed: int


def verify_apart(
    system: System,
    bounds: Bounds,
    choice: Choice = Choice.AUTO,
    *,
    names: Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[str], None] = lambda text: None,
    interrupted: Callable[[], bool] = lambda: False,
) -> Report:
    """As :func:`koord.verify.portfolio.verify`, with ``bounds.claim_s`` seconds for each claim.

    Up to ``jobs`` processes are used.
    """
    assert bounds.claim_s is not None
    started = time.monotonic()
    deadline = Deadline.after(bounds.timeout_s)
    together = replace(bounds, timeout_s=_least(bounds.claim_s, bounds.timeout_s))
    report = verify(system, together, choice, seed=seed, progress=progress, interrupted=interrupted)
    found = {verdict.claim.name: verdict for verdict in report.verdicts}
    asked = [name for name in found if not names or name in names]
    left = [name for name in asked if found[name].outcome is Outcome.UNKNOWN]
    cut = report.interrupted
    if left and len(found) > 1 and not cut:
        plain = replace(system, patience=ENDLESS)
        questions = [_Question(plain, bounds, choice, name, report.verdicts, seed) for name in left]
        ask = _in_turn if jobs == 1 or len(left) == 1 else _in_processes
        answers, cut = ask(questions, jobs, deadline, progress, interrupted)
        for answer in answers:
            if _is_better(answer, found[answer.claim.name]):
                found[answer.claim.name] = answer
    verdicts = tuple(found[name] for name in asked)
    return replace(report, verdicts=verdicts, interrupted=cut, seconds=time.monotonic() - started)


def _least(first: float, second: float | None) -> float:
    return first if second is None else min(first, second)


def _is_better(new: Verdict, old: Verdict) -> bool:
    """Whether an answer to a claim that is open says more than what was known."""
    if new.outcome is not Outcome.UNKNOWN:
        return True
    return (-1 if new.rounds is None else new.rounds) > (-1 if old.rounds is None else old.rounds)


def _answer(
    question: _Question,
    left_s: float | None,
    progress: Callable[[str], None] = lambda text: None,
    interrupted: Callable[[], bool] = lambda: False,
) -> Report:
    assert question.bounds.claim_s is not None
    seconds = _least(question.bounds.claim_s, left_s)
    return verify(
        question.system,
        replace(question.bounds, timeout_s=seconds),
        question.choice,
        names=[question.name],
        known=question.before,
        seed=question.seed,
        progress=progress,
        interrupted=interrupted,
    )


_Answers = tuple[list[Verdict], bool]


def _in_turn(
    questions: Sequence[_Question],
    jobs: int,
    deadline: Deadline,
    progress: Callable[[str], None],
    interrupted: Callable[[], bool],
) -> _Answers:
    """The verdicts, and whether Ctrl-C ended it."""
    answers: list[Verdict] = []
    for question in questions:
        if deadline.passed():
            break

        def told(text: str, name: str = question.name) -> None:
            progress(f"{name} by itself: {text}")

        report = _answer(question, deadline.left_s(), told, interrupted)
        answers += report.verdicts
        if report.interrupted:
            return answers, True
    return answers, False


def _in_processes(
    questions: Sequence[_Question],
    jobs: int,
    deadline: Deadline,
    progress: Callable[[str], None],
    interrupted: Callable[[], bool],
) -> _Answers:
    """The same in several processes, which end at once when time is up and on Ctrl-C.

    They are started anew, not forked: a solver and the thread of a live line do not survive that.
    Each has one claim, so that none keeps the memory of those before.
    """
    waiting = list(enumerate(questions))
    running: dict[Connection, tuple[int, BaseProcess]] = {}
    answers: dict[int, Verdict] = {}
    cut = False
    try:
        while (waiting or running) and not deadline.passed() and not cut:
            while waiting and len(running) < jobs:
                number, question = waiting.pop(0)
                running.update([_started(number, question, deadline)])
            done = len(questions) - len(waiting) - len(running)
            progress(f"claims by themselves, {jobs} at a time: {done} of {len(questions)} done")
            for told in connection.wait(list(running), _WAIT_S):
                assert isinstance(told, Connection)
                number, process = running.pop(told)
                # Of a process that died nothing comes: what was known of its claim stands.
                with suppress(EOFError):
                    answers[number] = _received(told.recv())
                process.join()
            cut = interrupted()
    except KeyboardInterrupt:
        cut = True
    finally:
        for _, process in running.values():
            process.terminate()
            process.join()
    return [answers[number] for number in sorted(answers)], cut


def _started(
    number: int, question: _Question, deadline: Deadline
) -> tuple[Connection, tuple[int, BaseProcess]]:
    context = multiprocessing.get_context("spawn")
    receives, sends = context.Pipe(duplex=False)
    process = context.Process(target=_answer_to, args=(sends, question, deadline.left_s()))
    process.daemon = True
    process.start()
    sends.close()
    return receives, (number, process)


def _received(answer: Verdict | tuple[Diagnostic, ...]) -> Verdict:
    """Raises KoordError if the program itself is to blame."""
    if isinstance(answer, Verdict):
        return answer
    raise KoordError(answer)


def _answer_to(sends: Connection, question: _Question, left_s: float | None) -> None:
    # Ctrl-C on a terminal reaches all processes; the first one ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        (verdict,) = _answer(question, left_s).verdicts
        sends.send(verdict)
    except KoordError as error:
        sends.send(error.diagnostics)
