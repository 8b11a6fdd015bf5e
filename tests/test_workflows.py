"""The GitHub Action and the hooks of pre-commit run what koord has, and say what comes of it."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

import koord
from koord.cli.exits import Exit
from koord.cli.main import main

ROOT = Path(__file__).resolve().parent.parent
ACTION = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
HOOKS = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text(encoding="utf-8"))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with a program."""
    koord.new(tmp_path / "posts")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def step(name: str, folder: Path, **inputs: str) -> tuple[int, str, dict[str, str]]:
    """Run a step of the action as its host does; its code, what it prints, and its outputs."""
    given = {key: str(one["default"]) for key, one in ACTION["inputs"].items()}
    given |= {key.replace("_", "-"): value for key, value in inputs.items()}
    (found,) = (one for one in ACTION["runs"]["steps"] if one.get("id") == name)
    environment = {
        key: re.sub(r"\$\{\{ inputs\.([\w-]+) \}\}", lambda named: given[named[1]], value)
        for key, value in found["env"].items()
    }
    assert "${{" not in found["run"], "what is typed into a workflow is no text of a script"
    outputs, summary = folder / "outputs", folder / "summary"
    outputs.write_text("")
    script = folder / "step.sh"
    script.write_text(found["run"], encoding="utf-8")
    command = folder / "bin" / "koord"  # this one, and not what stands elsewhere
    command.parent.mkdir(exist_ok=True)
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m koord "$@"\n')
    command.chmod(0o755)
    ran = subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", str(script)],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=folder,
        env={
            **os.environ,
            **environment,
            "PATH": f"{command.parent}:{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT),
            "GITHUB_OUTPUT": str(outputs),
            "GITHUB_STEP_SUMMARY": str(summary),
        },
    )
    told = dict(line.split("=", 1) for line in outputs.read_text().splitlines())
    return ran.returncode, ran.stdout + ran.stderr, told


def log(folder: Path, name: str) -> Any:
    return json.loads((folder / "koord-sarif" / name).read_text(encoding="utf-8"))


def test_the_action_checks_all_programs_and_verifies_what_it_is_told(folder: Path) -> None:
    code, _, told = step("prepare", folder)
    assert (code, told) == (0, {"sarif": "koord-sarif"})
    code, said, _ = step("check", folder)
    assert (code, said) == (0, "2 files checked: no errors\n")
    assert log(folder, "check.sarif")["runs"][0]["results"] == []
    arguments = "--with posts/properties.krd --robots 2"
    code, said, told = step("verify", folder, verify="posts/posts.krd", verify_arguments=arguments)
    assert (code, told) == (0, {"outcome": "holds"}), said
    assert "holds: 6 claims, 2 robots" in (folder / "summary").read_text()
    assert not (folder / "koord-verify.txt").exists()


def test_the_action_fails_where_a_property_does(folder: Path) -> None:
    program = folder / "posts" / "posts.krd"
    text = program.read_text(encoding="utf-8").replace("post = taken\n", "post = 0\n")
    program.write_text(text, encoding="utf-8")
    step("prepare", folder)
    code, said, told = step("verify", folder, verify="posts/po*.krd", allow="unknown vacuous")
    assert (code, told) == (Exit.VIOLATED, {"outcome": "violated"})
    assert "::error title=koord::violated" in said
    (result,) = log(folder, "verify.sarif")["runs"][0]["results"]
    assert result["codeFlows"]


@pytest.mark.parametrize(("allow", "code"), [("", Exit.UNKNOWN), ("vacuous unknown", 0)])
def test_the_action_allows_the_outcomes_that_it_is_told(
    folder: Path, allow: str, code: int
) -> None:
    program = "local:\n  int x = 0\nStep:\n  eff: x = x + 2\ninvariant Odd: forall i: x@i != 91\n"
    (folder / "odd.krd").write_text(program, encoding="utf-8")
    step("prepare", folder)
    bounds = "--engine induction --rounds 4 --robots 2"
    got, _, told = step("verify", folder, verify="odd.krd", verify_arguments=bounds, allow=allow)
    assert (got, told) == (code, {"outcome": "unknown"})


@pytest.mark.parametrize("name", ["check", "verify"])
def test_the_action_says_where_there_is_no_such_file(folder: Path, name: str) -> None:
    code, said, told = step(name, folder, check="src/*.krd", verify="src/*.krd")
    assert (code, told) == (Exit.BAD_INPUT, {})
    assert said == "::error title=koord::no file is like src/*.krd\n"


def test_the_action_installs_itself_unless_told_otherwise() -> None:
    (found,) = (one for one in ACTION["runs"]["steps"] if one.get("id") == "install")
    assert '"${PACKAGE:-$GITHUB_ACTION_PATH}"' in found["run"]


@pytest.mark.parametrize("hook", HOOKS, ids=lambda hook: hook["id"])
def test_hooks_pass_what_is_right_and_refuse_what_is_not(
    hook: dict[str, Any], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, *words = shlex.split(hook["entry"])
    assert program == "koord"
    assert hook["language"] == "python"
    assert re.search(hook["files"], "posts/posts.krd")
    assert not re.search(hook["files"], "posts/posts.yaml")
    path = folder / "posts" / "posts.krd"
    before = path.read_text(encoding="utf-8")
    assert main([*words, str(path)]) == Exit.OK
    assert path.read_text(encoding="utf-8") == before
    wrong = {
        "koord-check": before.replace("taken = taken + 1", "taken = token + 1"),
        "koord-format": before.replace("post = taken\n", "post  =  taken\n"),
        "koord-verify": before.replace("post = taken\n", "post = 0\n"),
    }[hook["id"]]
    path.write_text(wrong, encoding="utf-8")
    code = main([*words, str(path)])
    # pre-commit itself counts a file that a hook has changed as a failure.
    assert code != Exit.OK or path.read_text(encoding="utf-8") == before != wrong
