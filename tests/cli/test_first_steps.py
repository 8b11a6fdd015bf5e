"""`docs/`: from the box to the first drive and flight, as far as it goes without a vehicle."""

from __future__ import annotations

import argparse
import re
import shlex
from pathlib import Path

import pytest

import koord
from koord.cli.exits import Exit
from koord.cli.main import COMMANDS, main
from tests.sampling import first

ROOT = Path(__file__).parents[2]
FIRST = ROOT / "specs" / "examples" / "first"
FLEET = ROOT / "specs" / "examples" / "fleet"
GUIDES = sorted((ROOT / "docs").glob("*.md"))

_COMMAND = re.compile(r"^(koord (?!deploy .*\u2026).*?)(?: +#.*)?$", re.MULTILINE)
_LINK = re.compile(r"\]\(([^)#]+)")


def _commands() -> list[tuple[str, str]]:
    blocks = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
    return [
        (guide.name, command)
        for guide in GUIDES
        for block in blocks.findall(guide.read_text("utf-8"))
        for command in _COMMAND.findall(block)
    ]


@pytest.mark.parametrize(("guide", "command"), _commands())
def test_commands_have_the_arguments_that_are_there(guide: str, command: str) -> None:
    _, name, *words = shlex.split(command)
    (known,) = (one for one in COMMANDS if one.name == name)
    parser = argparse.ArgumentParser(exit_on_error=False)
    known.load().configure(parser)
    parser.parse_args(words)


def test_there_are_commands() -> None:
    assert len(_commands()) >= 16


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.name)
def test_links_lead_somewhere(guide: Path) -> None:
    links = _LINK.findall(guide.read_text("utf-8"))
    assert links
    assert [link for link in links if not (guide.parent / link).exists()] == []


@pytest.mark.parametrize(
    ("program", "config", "robots"),
    first(
        2,
        [
            (FIRST / "there_and_back.krd", FIRST / "car.yaml", "1"),
            (FIRST / "hover.krd", FIRST / "drone.yaml", "1"),
            (FLEET / "task_fleet.krd", FLEET / "task_fleet.yaml", "Car=2,Drone=1"),
        ],
    ),
    ids=lambda value: value.stem if isinstance(value, Path) else value,
)
def test_programs_are_proved_and_simulated(
    program: Path, config: Path, robots: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    there = tmp_path / config.name
    there.write_bytes(config.read_bytes())
    for name in ("robots.key", "fleet.key"):
        assert main(["config", "key", str(tmp_path / name)]) == Exit.OK
    assert main(["config", "check", str(there), "--program", str(program)]) == Exit.OK
    assert capsys.readouterr().err == ""
    assert main(["verify", str(program), "--robots", robots]) == Exit.OK
    assert "every number of rounds" in capsys.readouterr().out
    done = koord.simulate(str(program), str(there))
    assert done.ending.value == "all robots have stopped"
    assert done.broken == ()
