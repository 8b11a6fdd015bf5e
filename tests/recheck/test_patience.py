"""How long a second solver is waited for: its own work counts, and not that of others."""

from __future__ import annotations

import sys
import time

import pytest

from koord.recheck.solving import SolverAnswer, SolverSession


@pytest.mark.parametrize(
    ("waited_s", "worked_s", "is_late"),
    [
        (19.0, 19.0, False),
        (21.0, 21.0, True),
        (21.0, 6.0, False),
        (99.0, 6.0, False),
        (101.0, 6.0, True),  # it may be that it never works again
        (19.0, None, False),
        (21.0, None, True),
    ],
)
def test_who_has_not_worked_for_its_time_is_waited_for(
    waited_s: float, worked_s: float | None, is_late: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    with SolverSession.start() as session:
        with monkeypatch.context() as patched:
            patched.setattr(time, "monotonic", lambda: 1_000.0 + waited_s)
            before = None if worked_s is None else 3.0
            now = None if worked_s is None else 3.0 + worked_s
            patched.setattr(SolverSession, "_cpu_s", lambda _: now)
            assert session._is_late(1_000.0, before, 20.0) is is_late
        assert session.check() is SolverAnswer.SAT


@pytest.mark.skipif(sys.platform != "linux", reason="nobody tells how long another one worked")
def test_work_of_a_solver_is_told() -> None:
    with SolverSession.start() as session:
        assert session.check() is SolverAnswer.SAT
        first = session._cpu_s()
        assert first is not None
        own = time.process_time()
        assert 0.0 < first < own + 60.0
    assert session._cpu_s() is None  # it is gone
