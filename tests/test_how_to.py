"""How many files something new takes: what ARCHITECTURE.md says of it, counted in this tree.

Each was added by the how-to and stays as its proof. A change that makes the next one dearer (one
more place that has to know every type, say) shows here when it names one of these.
"""

from __future__ import annotations

import re

import pytest

from tests.test_floors import ROOT


def naming(pattern: str) -> list[str]:
    """The files of ``koord/`` in which something is named."""
    found = re.compile(pattern)
    return sorted(
        str(path.relative_to(ROOT))
        for path in (ROOT / "koord").rglob("*")
        if path.suffix in (".py", ".lark", ".krd") and found.search(path.read_text("utf-8"))
    )


@pytest.mark.parametrize(
    ("what", "pattern", "most"),
    [
        ("an operator that others define", r"\bclamp\b", 4),
        ("a primitive operator", r"ListOp\.KEYS|KEYS = ", 9),
        ("a statement", r"\bRepeat\b|\bREPEAT\b|loops\.repeat\b|def repeat\b", 12),
        (
            "a built-in type",
            r"SetType|SetLit|PRESENT|\bset_of\b|set_literal|\"Set\"|s\.add\(x\)",
            15,
        ),
    ],
)
def test_something_new_takes_few_files(what: str, pattern: str, most: int) -> None:
    files = naming(pattern)
    assert 0 < len(files) <= most, (what, files)
