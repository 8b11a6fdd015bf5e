"""Atheris, if it is there: coverage leads it to inputs that nobody thought of."""

from __future__ import annotations

import importlib
import io
import shutil
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr
from pathlib import Path
from random import Random
from typing import Protocol

ROOT = Path(__file__).parents[2]

NO_ATHERIS = "atheris is not installed for this Python: fuzzing is left out"

#: libFuzzer's flags, unless others are given: the same inputs in every run, for a minute.
DEFAULTS = ("-seed=1", "-max_total_time=60", "-timeout=30", "-verbosity=0", "-print_final_stats=1")


class Subject(Protocol):
    """What is fuzzed: a module of this package."""

    def examine(self, data: bytes) -> None:
        """Raise if something is wrong with how these bytes are treated."""

    def varied(self, data: bytes, random: Random) -> bytes:
        """An input like this one."""

    def write_seeds(self, folder: Path) -> None:
        """Write the inputs that fuzzing begins with."""


def fuzz(module: str, flags: Sequence[str]) -> int:
    """Fuzz the subject of that name. What breaks it is left in ``build/fuzz``."""
    try:
        import atheris
    except ImportError:
        print(NO_ATHERIS, file=sys.stderr)
        return 0
    listed = io.StringIO()  # every module that is instrumented
    with redirect_stderr(listed), atheris.instrument_imports(include=["koord", "lark"]):
        subject: Subject = importlib.import_module(module)

    def mutated(data: bytes, most: int, seed: int) -> bytes:
        random = Random(seed)
        if random.randrange(4) == 0:
            return bytes(atheris.Mutate(data, most))
        return subject.varied(data, random)[:most]

    folder = ROOT / "build" / "fuzz" / module.rpartition(".")[2]
    shutil.rmtree(folder, ignore_errors=True)
    corpus = folder / "corpus"
    corpus.mkdir(parents=True)
    subject.write_seeds(corpus)
    command = [sys.argv[0], *DEFAULTS, f"-artifact_prefix={folder}/", *flags, str(corpus)]
    atheris.Setup(command, subject.examine, custom_mutator=mutated)
    atheris.Fuzz()  # ends the process
    return 0
