"""Runs the tests that should catch a mutant, in a process of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass

from msgspec.structs import replace

from tests.mutants.caught import caught
from tests.mutants.mutant import ROOT, VARIABLE, Mutant

#: Which tests are run, one after the other until one fails, and for how long: a mutant may send
#: them round in circles, which is noticed too, but not where the tests themselves are long.
RUNS = (("not slow", 300), ("slow or generated", 3600))

#: pytest's exit codes: all passed, some failed, none is so marked. Others are mistakes of ours.
PASSED, FAILED, INTERRUPTED, UNKNOWN_TEST, NONE = 0, 1, 2, 4, 5

_FAILURE = re.compile(r"^(?:FAILED|ERROR) (\S+)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Which test caught a mutant; empty if none did."""

    mutant: Mutant
    caught_by: str
    seconds: float


def tried(mutant: Mutant) -> Outcome:
    """Run a mutant's tests with the mistake in place: the one that noticed it last, then all.

    The slow ones are run if no other notices it.
    """
    started = time.monotonic()
    known = caught().get(mutant.name)
    if known is not None and (again := known_to(replace(mutant, tests=(known,)))):
        return Outcome(mutant, again, time.monotonic() - started)
    found = next(filter(None, (_caught_by(mutant, *run) for run in RUNS)), "")
    return Outcome(mutant, found, time.monotonic() - started)


def known_to(mutant: Mutant) -> str:
    """The test of a mutant that notices it, be it slow; empty if none does."""
    return _caught_by(mutant, "slow or not slow", RUNS[0][1])


def _caught_by(mutant: Mutant, marks: str, timeout_s: int) -> str:
    try:
        done = _pytest(mutant.tests, mutant.name, marks, timeout_s)
    except subprocess.TimeoutExpired:
        return "no end" if "not slow" in marks else ""
    if done.returncode == UNKNOWN_TEST and "not found" in done.stderr:
        return ""
    if done.returncode == INTERRUPTED and "KeyboardInterrupt" in done.stdout:
        return "KeyboardInterrupt"  # nobody pressed Ctrl-C
    if done.returncode not in (PASSED, FAILED, NONE):
        raise RuntimeError(f"{mutant.name}: {done.stdout}{done.stderr}")
    found = _FAILURE.search(done.stdout)
    return found[1] if found is not None else ""


def passes(test: str) -> bool:
    """Whether a test passes where there is no mistake: only then it says something of a mutant."""
    return _pytest((test,), "", "slow or generated or not slow", RUNS[1][1]).returncode == PASSED


def untouched(mutants: Iterable[Mutant]) -> str:
    """What the mutants' tests say of the program as it is: nothing if all pass."""
    tests = dict.fromkeys(test for mutant in mutants for test in mutant.tests)
    done = _pytest(tuple(tests), "", *RUNS[0])
    return "" if done.returncode == PASSED else done.stdout


def _pytest(
    tests: tuple[str, ...], mutant: str, marks: str, timeout_s: int
) -> subprocess.CompletedProcess[str]:
    options = ["-x", "-q", "--tb=no", "-rfE", "-p", "no:cacheprovider", "-p", "no:xdist"]
    options += ["-m", marks, "-p", "tests.mutants.plugin"]
    command = [sys.executable, "-m", "pytest", *options, *tests]
    environment = {**os.environ, VARIABLE: mutant}
    # A mutant of a mutant's test, if this is run under a plugin already, would be odd.
    environment.pop("PYTEST_ADDOPTS", None)
    return subprocess.run(
        command,
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )
