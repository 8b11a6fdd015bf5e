"""The paper's Task listing: its mistakes, and nothing else."""

from __future__ import annotations

from pathlib import Path

from koord.syntax.diagnostics import Severity
from koord.syntax.load import load
from koord.syntax.source import Source

LISTING = Path(__file__).parent / "golden" / "task_as_printed.krd"


def test_the_listing_yields_its_real_mistakes() -> None:
    found = load(Source("task.krd", LISTING.read_text(encoding="utf-8")))
    told = [(d.code, d.severity, d.span.line, d.span.column) for d in found.diagnostics]
    assert found.program is None
    assert told == [
        ("K403", Severity.WARNING, 11, 7),
        ("K244", Severity.ERROR, 14, 3),
        ("K201", Severity.ERROR, 23, 12),
        ("K110", Severity.ERROR, 25, 13),
    ]


def test_each_is_told_with_its_cure() -> None:
    found = load(Source("task.krd", LISTING.read_text(encoding="utf-8")))
    unused, route, task, layout = found.diagnostics
    assert "`i` is never used" in unused.message
    assert route.message == (
        "`route` holds one `pos` for each robot, but a `pos[]` is stored in `route[pid]`"
    )
    assert route.hint == "declare it as `pos[][] route`: one `pos[]` for each robot"
    assert [note.span.line for note in route.notes] == [27, 31, 35, 40]
    assert task.message == "`task` is not declared"
    assert task.hint == "the element that the loop is at is `list[i].assigned`"
    assert layout.hint is not None
    assert "10" in layout.hint


def test_with_the_cures_taken_nothing_is_left() -> None:
    text = LISTING.read_text(encoding="utf-8")
    lines = text.splitlines()
    lines[10] = ""
    lines[13] = "  pos[][] route"
    lines[22] = lines[22].replace("task.", "list[i].")
    lines[24:36] = [line.removeprefix("  ") for line in lines[24:36]]
    found = load(Source("task.krd", "\n".join(lines)))
    # Its tasks come from a configuration, which a warning names.
    assert [d.code for d in found.diagnostics] == ["K406"]
    assert found.program is not None
    assert [function.name for function in found.program.functions] == [
        "allAssigned",
        "pathIsClear",
    ]
    assert [external.name for external in found.program.externals] == ["findPath", "pathsClear"]
    assert [lock.variables for lock in found.program.lock_classes] == [("list",)]
