"""A notebook in a real kernel: cells are run, and what they show is HTML."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.plugins.test_notebook import BROKEN, COUNTER, words

pytestmark = [pytest.mark.slow, pytest.mark.waits]

#: So long may a kernel take on a machine that does other things as well.
PATIENCE_S = 120


def test_a_notebook_shows_verdicts_runs_and_counterexamples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nbclient = pytest.importorskip("nbclient", reason="pip install nbclient ipykernel")
    pytest.importorskip("ipykernel", reason="pip install nbclient ipykernel")
    nbformat = pytest.importorskip("nbformat")
    # A kernel of this Python, whatever others are installed.
    spec = tmp_path / "kernels" / "koord"
    spec.mkdir(parents=True)
    argv = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    described = {"argv": argv, "display_name": "koord", "language": "python"}
    (spec / "kernel.json").write_text(json.dumps(described), "utf-8")
    monkeypatch.setenv("JUPYTER_PATH", str(tmp_path))
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))
    cells = [
        "%load_ext koord",
        f"%%koord verify --robots 2 --rounds 4\n{COUNTER}",
        f"%%koord verify --robots 2 --rounds 4 --as broken\n{BROKEN}",
        "[verdict for verdict in broken.verdicts if verdict.name == 'Small'][0]",
        f"%%koord run --robots 2 --rounds 3\n{COUNTER}",
        f"%%koord check\n{COUNTER}oops",
    ]
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in cells])
    client = nbclient.NotebookClient(book, timeout=PATIENCE_S, kernel_name="koord")
    client.execute(cwd=str(tmp_path))

    def html(number: int) -> str:
        outputs: list[Any] = book.cells[number].outputs
        shown = [one.data["text/html"] for one in outputs if "text/html" in one.get("data", {})]
        assert len(shown) == 1, outputs
        return str(shown[0])

    assert book.cells[0].outputs == []
    assert "Low holds in every round" in words(html(1))
    assert "a run that breaks Small" in words(html(2))
    assert "Small is false for i = " in words(html(2))
    assert html(3).lstrip().startswith("<iframe")
    assert "srcdoc" in html(3)
    assert "Step" in html(4)
    assert "K1" in html(5)
