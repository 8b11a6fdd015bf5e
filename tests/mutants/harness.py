"""Runs the tests that should catch a mutant, in a process of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass

from tests.mutants.mutant import ROOT, VARIABLE, Mutant

#: A mutant may send the tests round in circles. That is noticed too.
TIMEOUT_S = 300

#: pytest's exit codes: all passed, some failed. Any other is a mistake of ours.
PASSED, FAILED = 0, 1

_FAILURE = re.compile(r"^(?:FAILED|ERROR) (\S+)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Which test caught a mutant; empty if none did."""

    mutant: Mutant
    caught_by: str
    seconds: float


def tried(mutant: Mutant) -> Outcome:
    """Run a mutant's tests with the mistake in place."""
    started = time.monotonic()
    try:
        done = _pytest(mutant.tests, mutant.name)
    except subprocess.TimeoutExpired:
        return Outcome(mutant, "no end", time.monotonic() - started)
    if done.returncode not in (PASSED, FAILED):
        raise RuntimeError(f"{mutant.name}: {done.stdout}{done.stderr}")
    found = _FAILURE.search(done.stdout)
    caught = found[1] if found is not None else ""
    return Outcome(mutant, caught, time.monotonic() - started)


def untouched(mutants: Iterable[Mutant]) -> str:
    """What the mutants' tests say of the program as it is: nothing if all pass."""
    tests = dict.fromkeys(test for mutant in mutants for test in mutant.tests)
    done = _pytest(tuple(tests), "")
    return "" if done.returncode == PASSED else done.stdout


def _pytest(tests: tuple[str, ...], mutant: str) -> subprocess.CompletedProcess[str]:
    options = ["-x", "-q", "--tb=no", "-rfE", "-p", "no:cacheprovider", "-p", "no:xdist"]
    command = [sys.executable, "-m", "pytest", *options, "-p", "tests.mutants.plugin", *tests]
    environment = {**os.environ, VARIABLE: mutant}
    # A mutant of a mutant's test, if this is run under a plugin already, would be odd.
    environment.pop("PYTEST_ADDOPTS", None)
    return subprocess.run(
        command,
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
