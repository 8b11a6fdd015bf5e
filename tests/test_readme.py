"""What README.md promises is what the project has, and what it shows is what the tool prints.

So it is of the pages that its long sections became, which are read with it as one text.
"""

from __future__ import annotations

import doctest
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import koord
from koord.cli.exits import Exit
from koord.cli.main import COMMANDS, EPILOG
from koord.recheck import certificate
from koord.traces import form
from koord.verify import certificate_form
from tests import environments
from tests.loading import example_files
from tests.sampling import first
from tests.test_examples import EXPECTED

ROOT = Path(__file__).resolve().parent.parent

#: The pages that are read with README.md, in the order of what they show.
MOVED = (
    "docs/tutorial/tour.md",
    "docs/reference/one_page.md",
    "docs/reference/examples.md",
    "docs/explanation/benchmarks.md",
    "docs/how_to/commands.md",
    "docs/how_to/begin.md",
    "docs/how_to/tests.md",
    "docs/how_to/python.md",
)


def _read(name: str) -> str:
    """A page, with its links as they would be in the folder of the project."""
    text = (ROOT / name).read_text(encoding="utf-8")
    return text.replace("](../../", "](").replace("](../", "](docs/")


README = "\n".join(map(_read, ("README.md", *MOVED)))
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


#: The blocks of commands that people say to robots that run: nobody takes part in the tour.
SAID = re.findall(r"^```sh\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def test_every_command_is_listed_and_shown() -> None:
    commands = [*(command for command, _ in TOUR), *"".join(SAID).splitlines()]
    for entry in COMMANDS:
        assert f"| `koord {entry.name} " in README
        assert any(f"koord {entry.name} " in f"{command} " for command in commands)


def test_every_exit_code_is_listed_where_users_look() -> None:
    for code in set(Exit) - {Exit.PIPE_CLOSED}:
        assert f"\n| {code.value} | " in README
        assert re.search(rf"^  {code.value} ", EPILOG, re.MULTILINE)


#: What the tour says to install, before the first command that needs it.
INSTALLING = re.compile(r"\.venv/bin/pip install -q '\.\[(\w+)\]'")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the tour is taken: it has the project's programs, and what it writes stays there.

    What is installed there is what the first command of the README installs, and nothing else.
    """
    found = tmp_path_factory.mktemp("tour")
    for name in ("specs", "tests"):
        (found / name).symlink_to(ROOT / name)
    koord = found / "koord"
    koord.write_text(f'#!/bin/sh\nexec "{sys.executable}" -S -m koord "$@"\n', encoding="utf-8")
    koord.chmod(0o755)
    environments.made(found / "installed")
    return found


def told(folder: Path, command: str) -> subprocess.CompletedProcess[str]:
    """What a command prints there."""
    installed = os.pathsep.join((str(folder / "installed"), str(ROOT)))
    paths = {"PATH": f"{folder}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": installed}
    return subprocess.run(
        ["bash", "-c", command],
        cwd=folder,
        # What the system has of ROS 1 is none of what is shown.
        env={**os.environ, **paths, "PYTHONUTF8": "1", "KOORD_ROS1": str(folder)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize(
    ("command", "extra"),
    first(
        1,
        [
            ("koord sim specs/examples/task.krd --rounds 1", "sim"),
            ("koord check-refinement specs/examples/task.krd --target simulator --runs 1", "sim"),
            (
                "koord verify specs/examples/leader_elect.krd --certificate c.json >/dev/null"
                " && koord recheck c.json",
                "recheck",
            ),
            ("koord verify specs/examples/task.krd --robots 2..3 --plot t.svg", "plot"),
        ],
    ),
)
def test_what_is_not_installed_is_told_with_its_cure(
    tmp_path: Path, command: str, extra: str
) -> None:
    """In an environment with koord alone."""
    (tmp_path / "specs").symlink_to(ROOT / "specs")
    koord = tmp_path / "koord"
    koord.write_text(f'#!/bin/sh\nexec "{sys.executable}" -S -m koord "$@"\n', encoding="utf-8")
    koord.chmod(0o755)
    environments.made(tmp_path / "installed")
    done = told(tmp_path, command)
    assert done.returncode == Exit.BAD_INPUT, done.stdout
    assert f"pip install 'koord[{extra}]'" in done.stdout
    assert "Traceback" not in done.stdout


def test_the_tour_prints_what_is_shown(folder: Path) -> None:
    for command, expected in TOUR:
        if extra := INSTALLING.fullmatch(command):
            environments.made(folder / "installed", [extra[1]])
            continue
        done = told(folder, command)
        assert agrees(masked(command, expected), masked(command, done.stdout)), done.stdout


@pytest.mark.slow
def test_the_tour_can_be_taken_in_an_environment_that_pip_made(tmp_path: Path) -> None:
    """The commands of the tour, as a newcomer types them; what they print is looked at above."""
    pip = [str(tmp_path / ".venv" / "bin" / "pip"), "install", "-q"]
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path / ".venv")], check=True, timeout=300)
    subprocess.run([*pip, str(ROOT)], check=True, timeout=1200)
    for name in ("specs", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    paths = {"PATH": f"{tmp_path}/.venv/bin{os.pathsep}{os.environ['PATH']}"}
    for command, _ in TOUR:
        if extra := INSTALLING.fullmatch(command):
            subprocess.run([*pip, f"{ROOT}[{extra[1]}]"], check=True, timeout=1200)
            continue
        done = subprocess.run(
            ["bash", "-c", command],
            cwd=tmp_path,
            env={k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | paths,
            capture_output=True,
            encoding="utf-8",
            timeout=300,
            check=False,
        )
        assert "Traceback" not in done.stderr, done.stderr
        assert done.returncode in (Exit.OK, Exit.VIOLATED, Exit.BAD_INPUT), done.stderr
        assert "pip install" not in done.stderr


def masked(command: str, text: str) -> str:
    """The text without times, and without the run that a solver picked to break a claim."""
    text = re.sub(r" +\d+\.\d\d s\b", " - s", text)
    if "koord verify" in command:
        text = re.sub(r"^start\n.*?\n\n", "start …\n\n", text, flags=re.MULTILINE | re.DOTALL)
        text = re.sub(r" is false for .* \[", " is false for … [", text)
    if "koord deploy" in command:
        text = re.sub(r"\d+(\.\d+)?", "-", text)
        # Where others are at work, some robots are there long before others.
        early = r"^(epoch -; dropped:) - before this robot was in a run$"
        text = re.sub(early, r"\1 nothing", text, flags=re.MULTILINE)
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
    early, late = "epoch 0; dropped: 2 before this robot was in a run\n", "dropped: 2 forged\n"
    assert masked("koord deploy f", early) == "epoch -; dropped: nothing\n"
    assert masked("koord deploy f", late) == "dropped: - forged\n"
    assert masked("koord run f", "round 1, to t = 0.1 s\n") == "round 1, to t = 0.1 s\n"


# --- what is promised -----------------------------------------------------------------------------


def test_what_stays_as_it_is_is_said_of_this_version() -> None:
    """Of the language, traces, certificates and the public API, as their versions are now."""
    (promise,) = re.findall(r"^## What stays as it is\n(.*?)^## ", README, re.MULTILINE | re.DOTALL)
    assert f"Version {koord.__version__} " in promise
    assert re.findall(r"^- \*\*(.*?)\*\*", promise, re.MULTILINE) == [
        "the language",
        "traces",
        "certificates",
        "the public API",
    ]
    assert f"`--trace` writes (version {form.VERSION}," in promise
    assert f"`--certificate` writes (version {certificate_form.VERSION}," in promise
    assert certificate.VERSIONS[-1] == certificate_form.VERSION
    assert f"\n## {koord.__version__} " in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    contributing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert "README.md#what-stays-as-it-is" in contributing


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
    files = {path.relative_to(EXAMPLES).as_posix() for path in example_files()}
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
        *sorted(str(guide.relative_to(ROOT)) for guide in (ROOT / "koord").rglob("README.md")),
        "CHANGELOG.md",
        "CONTRIBUTING.md",
        "SECURITY.md",
        "tests/README.md",
        "specs/semantics/README.md",
        "specs/decisions/README.md",
        "docs/systems.md",
    ],
)
def test_the_files_that_are_linked_exist(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    local = [target for target in re.findall(r"\]\(([^)#]+)\)", text) if "://" not in target]
    missing = [target for target in local if not ((ROOT / name).parent / target).exists()]
    assert missing == []


@pytest.mark.parametrize("name", ["CONTRIBUTING.md", "tests/README.md"])
def test_the_files_that_are_named_exist(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:\w+/)*\w+\.(?:py|krd|lark|md|yaml))`", text))
    assert len(named) >= 3
    folders = [path for top in ("koord", "tests", "specs") for path in (ROOT / top).rglob("*")]
    known = {path.relative_to(ROOT).as_posix() for path in folders}
    assert [path for path in named if not any(f"/{k}".endswith(f"/{path}") for k in known)] == []


def test_what_is_shown_of_python_is_so(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    blocks = re.findall(r"^```python\n(.+?)^```", README, re.DOTALL | re.MULTILINE)
    examples = [doctest.DocTestParser().get_doctest(b, {}, "README.md", None, 0) for b in blocks]
    assert examples
    for example in examples:
        heard: list[str] = []
        doctest.DocTestRunner().run(example, out=heard.append)
        assert heard == []


def test_what_is_promised_is_shown_by_tests_that_exist() -> None:
    text = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    files = set(re.findall(r"`((?:runtime|deployed)/\w+\.py)`", text))
    assert len(files) >= 7
    tests = "".join((ROOT / "tests" / file).read_text(encoding="utf-8") for file in files)
    names = {word for word in re.findall(r"`(\w+)`", text) if word.count("_") >= 2}
    assert len(names) >= 10
    assert [name for name in sorted(names) if f"def test_{name}" not in tests] == []
