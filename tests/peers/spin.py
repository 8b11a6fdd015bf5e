"""Asking SPIN, where it is installed together with a C compiler."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from tests.peers.model import Model

#: What a translated program is compiled with: all states in full, no reduction of any kind.
_FLAGS = ("-w", "-DNOREDUCE", "-DSAFETY", "-DNOFAIR", "-DVECTORSZ=32768")


class UnsureError(Exception):
    """SPIN did not look at everything; the message says why."""


@dataclass(frozen=True)
class Answer:
    """For each broken claim the first round in which it is (0: after INIT)."""

    first: dict[str, int]
    states: int


def missing() -> str:
    """What would have to be installed; empty if nothing."""
    compilers = [name for name in ("gcc", "cc") if shutil.which(name)]
    lacking = [] if shutil.which("spin") else ["spin"]
    return " and ".join(lacking + ([] if compilers else ["a C compiler"]))


def ask(model: Model, folder: Path, *, seconds: float = 30.0, large: bool = False) -> Answer:
    """Every run of a model. Raises UnsureError; RuntimeError if SPIN refuses the model.

    ``large`` models are compiled for speed and may use gigabytes; small ones are compiled quickly.
    """
    build = ("-O2", "-DMEMLIM=8000") if large else ("-O0", "-DMEMLIM=60")
    (folder / "model.pml").write_text(model.promela, "utf-8")
    (folder / "rules.h").write_text(model.rules, "utf-8")
    compiler = shutil.which("gcc") or "cc"
    _run(folder, seconds, "spin", "-a", "model.pml")
    _run(folder, seconds, compiler, *_FLAGS, *build, "-o", "pan", "pan.c")
    told = _run(folder, seconds, "./pan", "-E", "-m100000", "-w24" if large else "-w20")
    if "max search depth too small" in told or "Search not completed" in told:
        raise UnsureError("the search was not completed")
    if "unsure 0" not in told:
        raise UnsureError("a value or a list beyond the sizes of the translation")
    rounds = {
        int(claim): int(first) for claim, first in re.findall(r"^claim (\d+) (-?\d+)$", told, re.M)
    }
    assert len(rounds) == len(model.claims), told
    states = re.search(r"(\d+) states, stored", told)
    assert states is not None, told
    first = {name: rounds[n] for n, name in enumerate(model.claims) if rounds[n] >= 0}
    return Answer(first, int(states[1]))


def _run(folder: Path, seconds: float, *command: str) -> str:
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=seconds, check=False
        )
    except subprocess.TimeoutExpired:
        raise UnsureError(f"{command[0]} took longer than {seconds:g} s") from None
    if "reached -DMEMLIM bound" in done.stdout:
        raise UnsureError("too many states")
    if done.returncode != 0:
        raise RuntimeError(f"{command[0]}: {(done.stdout + done.stderr)[-3000:]}")
    return done.stdout
