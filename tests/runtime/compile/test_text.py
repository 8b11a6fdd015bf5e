"""What `koord compile` writes: readable, typed, laid out, and of the runtime alone."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from koord.refinement.cases import generated
from koord.runtime.compile import compiled
from koord.runtime.compile.formatting import WIDTH
from koord.runtime.compile.loading import loaded
from koord.syntax import core
from koord.syntax.load import load
from koord.syntax.source import Source
from tests.loading import example_files

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = example_files()
GOLDEN = sorted((Path(__file__).parent / "golden").glob("*.txt"))

#: So many generated programs are looked at.
GENERATED = 20


def program(path: Path) -> core.Program:
    found = load(Source(path.name, path.read_text("utf-8"))).program
    assert found is not None
    return found


def example(stem: str) -> core.Program:
    return program(ROOT / "specs/examples" / f"{stem}.krd")


def of_text(text: str) -> core.Program:
    elaborated = load(Source("app.krd", text))
    assert elaborated.program is not None, elaborated.diagnostics
    return elaborated.program


@pytest.fixture(scope="module")
def texts() -> dict[str, str]:
    """The compiled text of every example, and of some generated programs."""
    made = {f"{path.parent.name}_{path.stem}": compiled(program(path)) for path in EXAMPLES}
    for seed in range(GENERATED):
        made[f"generated_{seed}"] = compiled(generated(seed, 1).system.program)
    return made


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda path: path.stem)
def test_the_text_is_the_one_that_was_read_last(golden: Path) -> None:
    """`koord compile NAME.krd > NAME.txt` in specs/examples makes it anew, for a person to read."""
    assert compiled(example(golden.stem)) == golden.read_text("utf-8")


def test_there_is_a_golden_text_of_each_kind_of_program() -> None:
    assert [path.stem for path in GOLDEN] == ["cars_and_drones", "hvac", "sum_of_ids", "task"]


def test_a_formatter_finds_nothing_to_change(texts: dict[str, str], tmp_path: Path) -> None:
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text, "utf-8")
    command = [sys.executable, "-m", "ruff", "format", "--isolated", "--diff"]
    done = subprocess.run(
        [*command, "--line-length", str(WIDTH), str(tmp_path)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[:3000]


def test_only_the_runtime_is_imported(texts: dict[str, str]) -> None:
    allowed = {"__future__", "typing", "koord.runtime.robot"}
    for name, text in texts.items():
        found = {n.module for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom)}
        assert found <= allowed, name
        assert not [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Import)]


def test_the_same_program_gives_the_same_text() -> None:
    assert compiled(example("task")) == compiled(example("task"))


@pytest.mark.slow
def test_the_text_is_typed(texts: dict[str, str], tmp_path: Path) -> None:
    for name, text in texts.items():
        if not name.startswith("generated"):
            (tmp_path / f"{name}.py").write_text(text, "utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", str(tmp_path)],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stdout[:3000]


# --- names ----------------------------------------------------------------------------------------


def test_names_that_mean_something_in_python_are_given_another() -> None:
    program_ = of_text(
        "def len:\n  int index\n  int count\n\n"
        "enum None_: class, mro\n\n"
        "local:\n  int host = 1\n  int status = 2\n  int lambda = 3\n  int len_ = 4\n"
        "  len print\n  None_ m = mro\n\n"
        "allwrite:\n  int set = 0\n\n"
        "def fun max(int range) -> int:\n  int self = range\n  return self + 1\n\n"
        "set:\n  eff:\n    set = max(host) + status + lambda + len_\n"
        "    print.index = set\n    print.count = 2\n    m = class\n"
    )
    (robot,) = loaded(compiled(program_))
    assert [event.name for event in robot.EVENTS] == ["set"]
    assert set(robot.LOCALS) == {"host_", "status_", "lambda_", "len_", "print", "m"}
    assert [v.name for v in robot.SHARED.variables] == ["set_"]


def test_a_program_without_anything_compiles() -> None:
    (robot,) = loaded(compiled(of_text("local:\n  int x\n")))
    assert robot.EVENTS == ()


def test_strings_come_through() -> None:
    text = 'local:\n  string s = "it\'s \\"quoted\\" \\\\ and é"\n'
    elaborated = load(Source("app.krd", text)).program
    assert elaborated is not None
    initial = elaborated.agents[0].locals[0].initial
    assert isinstance(initial, core.Const)
    assert f"self.s = {initial.value!r}" in compiled(elaborated)


def test_functions_of_properties_alone_are_left_out() -> None:
    text = compiled(example("sum_of_ids"))
    assert "def sumOf" not in text
    assert "def Add(self)" in text
