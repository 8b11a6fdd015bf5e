"""The plugin of pytest: programs are collected, and each of their claims is a test.

This file is loaded in each run of pytest where koord is installed, also of projects that do not
use it: it imports nothing of koord before a program is collected.
"""

from __future__ import annotations

from collections.abc import Callable
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from koord.plugins.choices import CHOICES

if TYPE_CHECKING:
    from koord.api.verify_report import VerifyReport


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("koord", "programs for teams of robots (koord)")
    group.addoption(
        "--koord", action="store_true", help="collect every program (*.krd), a test for each claim"
    )
    group.addoption(
        "--koord-verify",
        metavar="FLAGS",
        default="",
        help="flags of `koord verify` for all programs, as '--robots 2..4 --rounds 10'",
    )
    for what, of in (("unknown", "a claim is unknown"), ("vacuous", "verdicts are vacuous")):
        group.addoption(
            f"--koord-{what}", choices=CHOICES, help=f"what becomes of a test where {of} (fail)"
        )
        parser.addini(f"koord_{what}", f"as --koord-{what}", default="fail")
    parser.addini(
        "koord_files", "patterns of programs to collect, as *.krd (none)", type="args", default=[]
    )
    parser.addini("koord_verify", "as --koord-verify", default="")


def pytest_configure(config: pytest.Config) -> None:
    for name in ("koord_unknown", "koord_vacuous"):
        choice = config.getini(name)
        if choice not in CHOICES:
            known = ", ".join(CHOICES)
            raise pytest.UsageError(f"{name} is {choice!r}, and has to be one of {known}")


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect a program that is named, or like a pattern, or any with ``--koord``."""
    if file_path.suffix != ".krd":
        return None
    is_named = parent.session.isinitpath(file_path)
    patterns = parent.config.getini("koord_files")
    relative = _relative(file_path, parent.config.rootpath)
    is_like = any(fnmatch(file_path.name, one) or fnmatch(relative, one) for one in patterns)
    if not (is_named or is_like or parent.config.getoption("koord")):
        return None
    from koord.plugins.program_items import ProgramFile

    return ProgramFile.made(parent, file_path, is_named=is_named)


def _relative(path: Path, root: Path) -> str:
    return path.relative_to(root).as_posix() if path.is_relative_to(root) else path.as_posix()


@pytest.fixture
def koord_verify(request: pytest.FixtureRequest) -> Callable[..., VerifyReport]:
    """Verify a program, and fail with the runs that break its claims: ``koord_verify("a.krd")``.

    The program is a file, from the folder of the test, or one that is loaded. Arguments by name
    are those of ``koord.verify``; ``unknown`` and ``vacuous`` say what becomes of such verdicts
    instead of the options of that name: ``"fail"``, ``"xfail"``, ``"warn"``. Returns the report.
    """
    from koord.plugins.program_items import verifier

    return verifier(request)
