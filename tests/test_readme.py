"""What README.md promises is what the project has, and what it shows is what the tool prints."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from koord.cli.exits import Exit
from koord.cli.main import COMMANDS, EPILOG
from tests.test_examples import EXPECTED

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
EXAMPLES = ROOT / "specs" / "examples"

#: In what the README shows, a line of its own that stands for any number of lines left out.
LEFT_OUT = "…"


def shown() -> list[tuple[str, str]]:
    """The blocks marked ``console``: each a command behind ``$``, and what it prints."""
    blocks = re.findall(r"^```console\n\$ (.*)\n((?:.*\n)*?)```$", README, re.MULTILINE)
    assert len(blocks) == README.count("```console")
    return blocks


#: .ci/run executes the first two.
PROMISED, TOUR = shown()[:2], shown()[2:]


# --- commands -------------------------------------------------------------------------------------


def test_the_first_two_commands_are_the_verdict_and_the_tests() -> None:
    (verdict, _), (tests, _) = PROMISED
    assert "pip install" in verdict
    assert verdict.endswith("koord verify specs/examples/task.krd --rounds 20")
    assert tests == "make check"


def test_every_command_is_listed_and_shown() -> None:
    for entry in COMMANDS:
        assert f"| `koord {entry.name} " in README
        assert any(f"koord {entry.name} " in command for command, _ in TOUR)


def test_every_exit_code_is_listed_where_users_look() -> None:
    for code in set(Exit) - {Exit.PIPE_CLOSED}:
        assert f"\n| {code.value} | " in README
        assert re.search(rf"^  {code.value} ", EPILOG, re.MULTILINE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the tour is taken: it has the project's programs, and what it writes stays there."""
    made = tmp_path_factory.mktemp("tour")
    for name in ("specs", "tests"):
        (made / name).symlink_to(ROOT / name)
    koord = made / "koord"
    koord.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m koord "$@"\n', encoding="utf-8")
    koord.chmod(0o755)
    return made


def test_the_tour_prints_what_is_shown(folder: Path) -> None:
    paths = {"PATH": f"{folder}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    for command, expected in TOUR:
        done = subprocess.run(
            ["bash", "-c", command],
            cwd=folder,
            env={**os.environ, **paths, "PYTHONUTF8": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            timeout=120,
            check=False,
        )
        assert agrees(masked(command, expected), masked(command, done.stdout)), done.stdout


def masked(command: str, text: str) -> str:
    """The text without times, and without the run that a solver picked to break a claim."""
    text = re.sub(r" +\d+\.\d\d s\b", " - s", text)
    if "koord verify" in command:
        text = re.sub(r"^start\n.*?\n\n", "start …\n\n", text, flags=re.MULTILINE | re.DOTALL)
        text = re.sub(r" is false for .* \[", " is false for … [", text)
    if "koord deploy" in command:
        text = re.sub(r"\d+(\.\d+)?", "-", text)
    if "koord recheck" in command:
        text = re.sub(r"cvc5 \S+", "cvc5 -", re.sub(r"\[\d+\.\d s\]", "[- s]", text))
    return text


def agrees(expected: str, printed: str) -> bool:
    """Whether what was printed is what is shown, where lines may be left out."""
    parts = re.split(rf"^{LEFT_OUT}\n", expected, flags=re.MULTILINE)
    return re.fullmatch("(?:.*\n)*?".join(map(re.escape, parts)), printed) is not None


def test_the_comparison_sees_a_difference() -> None:
    assert agrees("a\n…\nb\n", "a\nx\ny\nb\n")
    assert agrees("a\nb\n", "a\nb\n")
    assert not agrees("a\nb\n", "a\nx\nb\n")
    assert not agrees("a\n…\nb\n", "a\nx\ny\nc\n")
    assert masked("koord verify f", "A  holds  bmc   0.18 s\n") == "A  holds  bmc - s\n"
    assert masked("koord run f", "round 1, to t = 0.1 s\n") == "round 1, to t = 0.1 s\n"


# --- programs -------------------------------------------------------------------------------------


def test_the_program_that_is_shown_is_the_example() -> None:
    (listing,) = re.findall(r"^```koord\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
    text = (EXAMPLES / "leader_elect.krd").read_text(encoding="utf-8")
    without_heading = re.sub(r"\A(#.*\n)*\n", "", text)
    assert listing == without_heading


def listed() -> dict[str, str]:
    """The verdict that the tables of examples give, by path below specs/examples."""
    rows = re.findall(
        r"^\| \[(\w+)\]\(specs/examples/(\S+)\) \|.*\| (.*) \|$", README, re.MULTILINE
    )
    assert all(path.endswith(f"{name}.krd") for name, path, _ in rows)
    return {path: verdict for _, path, verdict in rows}


def test_every_example_is_listed() -> None:
    files = {path.relative_to(EXAMPLES).as_posix() for path in EXAMPLES.rglob("*.krd")}
    assert set(listed()) == files


def rows() -> list[tuple[str, str, str]]:
    """Each verdict that the tables give: the file, the flags behind it, what is said."""
    found = []
    for path, verdicts in listed().items():
        for one in verdicts.split("; "):
            ((flags, said),) = re.findall(r"^(?:with `(--[^`]+)`: )?(.*)$", one)
            found.append((path, flags, said))
    return found


@pytest.mark.parametrize(("path", "flags", "said"), rows())
def test_the_command_of_each_row_shows_its_verdict(path: str, flags: str, said: str) -> None:
    """The command is one of those that tests/test_examples.py runs, with just these flags."""
    (run,) = (run for run in EXPECTED[path].runs if run.chosen() == flags.split())
    assert not run.slow
    if said == "holds in every round":
        assert (run.exit, run.says) == (Exit.OK, {})
    else:
        how = r"violated in round \d+|violated by a loop of rounds \d+ to \d+"
        ((claim, where),) = re.findall(rf"^`([^`]+)` ({how})$", said)
        assert run.says[claim] == where


# --- files ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [
        "README.md",
        "ARCHITECTURE.md",
        "CHANGELOG.md",
        "tests/README.md",
        "specs/semantics/README.md",
    ],
)
def test_the_files_that_are_linked_exist(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    local = [target for target in re.findall(r"\]\(([^)#]+)\)", text) if "://" not in target]
    missing = [target for target in local if not ((ROOT / name).parent / target).exists()]
    assert missing == []


@pytest.mark.parametrize("name", ["ARCHITECTURE.md", "tests/README.md"])
def test_the_files_that_are_named_exist(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:\w+/)*\w+\.(?:py|krd|lark|md|yaml))`", text))
    assert len(named) > 10
    folders = [path for top in ("koord", "tests", "specs") for path in (ROOT / top).rglob("*")]
    known = {path.relative_to(ROOT).as_posix() for path in folders}
    assert [path for path in named if not any(f"/{k}".endswith(f"/{path}") for k in known)] == []
