"""What README.md promises is what the project has."""

from __future__ import annotations

import re
from pathlib import Path

from koord.cli.exits import Exit
from koord.cli.main import COMMANDS, EPILOG

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def commands() -> list[str]:
    """The lines behind ``$`` in the blocks marked ``console``: those that .ci/run executes."""
    blocks = re.findall(r"^```console\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
    return [line[2:] for block in blocks for line in block.splitlines() if line.startswith("$ ")]


def test_the_first_two_commands_are_the_verdict_and_the_tests() -> None:
    verdict, tests = commands()[:2]
    assert "pip install" in verdict
    assert verdict.endswith("koord verify specs/examples/task.krd --rounds 20")
    assert tests == "make check"


def test_every_command_is_listed() -> None:
    for entry in COMMANDS:
        assert f"| `koord {entry.name} " in README


def test_every_exit_code_is_listed_where_users_look() -> None:
    for code in set(Exit) - {Exit.PIPE_CLOSED}:
        assert f"\n| {code.value} | " in README
        assert re.search(rf"^  {code.value} ", EPILOG, re.MULTILINE)


def test_the_files_it_points_to_exist() -> None:
    targets = re.findall(r"\]\(([^)]+)\)", README)
    local = [target for target in targets if "://" not in target]
    assert local
    assert [target for target in local if not (ROOT / target).exists()] == []
