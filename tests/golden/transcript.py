"""Play a scenario: give its commands, and note what they print and write."""

from __future__ import annotations

import contextlib
import gc
import io
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

from koord.cli.main import main
from tests.golden.described import described, mistakes
from tests.golden.plain import plain_file, plain_output
from tests.golden.scenarios import EXAMPLES, ROOT, Command, Scenario

#: The width that helps and tables are laid out for, no colours, and where verdicts are kept.
SURROUNDINGS = {"COLUMNS": "100", "NO_COLOR": "1", "KOORD_CACHE": "kept-verdicts"}


def plain_surroundings() -> None:
    """Make this process print alike, wherever it runs."""
    os.environ.update(SURROUNDINGS)


def transcript(scenario: Scenario) -> str:
    """What came of it, as lines. Documents that their schemas do not describe are refused."""
    documents: list[tuple[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), _uncollected():
        shutil.copytree(ROOT / EXAMPLES, EXAMPLES)
        lines = [line for command in scenario.commands for line in _played(command, documents)]
    found = [mistake for document in documents for mistake in mistakes(*document)]
    assert not found, found
    return "\n".join(lines) + "\n"


@contextlib.contextmanager
def _uncollected() -> Iterator[None]:
    """No garbage is collected meanwhile: when it is, Z3 numbers terms anew, and orders them so."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.collect()


def _played(command: Command, documents: list[tuple[str, Any]]) -> Iterator[str]:
    for file in command.writes:
        Path(file).unlink(missing_ok=True)
    out, err = io.StringIO(), io.StringIO()
    stdin = io.TextIOWrapper(io.BytesIO(command.stdin.encode()), encoding="utf-8")
    with (
        patch.object(sys, "stdin", stdin),
        # What is said of machine code depends on what was made in this process before.
        patch("koord.machine.kept.machine_store", return_value=None),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            code = main(list(command.words))
        except SystemExit as end:  # as argparse ends what asks for help
            code = int(end.code or 0)
    documents += described(command, out.getvalue(), code)
    yield f"$ koord {' '.join(command.words)}"
    yield from plain_output(out.getvalue(), is_verbatim=command.is_verbatim)
    yield from (f"! {line}" for line in plain_output(err.getvalue()))
    yield f"exit {code}"
    for file in command.writes:
        if Path(file).exists():
            yield f"# {file}"
            yield from plain_file(Path(file), is_verbatim=command.is_verbatim)
