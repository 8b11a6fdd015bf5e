"""While somebody types in an editor: the language server over its pipes, in a warm process.

An invariant of Task is changed again and again, each time to a text that nobody has seen. What is
told are milliseconds of the wall, from the change to the diagnostics, to the verdicts, and to what
else editors ask after each key, and the CPU of the server and its processes. The program is
opened, and one change made, before anything is measured. Diagnostics are measured without
verification, too: they are told before it begins.
"""

from __future__ import annotations

import asyncio
import os
import statistics
import sys
import time
from pathlib import Path
from typing import Any

from lsprotocol import types
from pygls.lsp.client import LanguageClient

from harness import EXAMPLES, Column, Report, main

URI = "file:///task.krd"
OLD = "invariant Route: forall i: route[i] == Motion.path@i"


class Client:
    """An editor: it changes one line, and hears what comes of it."""

    def __init__(self) -> None:
        self.client = LanguageClient("benchmark", "1")
        self.version = 0
        self.heard: dict[tuple[str, int], asyncio.Event] = {}
        self.verdicts: dict[int, Any] = {}

        @self.client.feature(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def published(params: types.PublishDiagnosticsParams) -> None:
            self.event("diagnostics", params.version or 0).set()

        @self.client.feature("koord/verdicts")
        def verdicts(params: Any) -> None:
            if params.state == "done":
                self.verdicts[params.version] = params.marks
                self.event("verdicts", params.version).set()

    def event(self, what: str, version: int) -> asyncio.Event:
        return self.heard.setdefault((what, version), asyncio.Event())

    async def start(self, text: str, on: str) -> None:
        await self.client.start_io(sys.executable, "-m", "koord", "lsp")
        settings = {"verify": {"on": on}}
        params = types.InitializeParams(
            capabilities=types.ClientCapabilities(), initialization_options=settings
        )
        await self.client.initialize_async(params)
        self.client.initialized(types.InitializedParams())
        item = types.TextDocumentItem(URI, "koord", self.version, text)
        self.client.text_document_did_open(types.DidOpenTextDocumentParams(item))
        await self.event("verdicts" if on == "change" else "diagnostics", self.version).wait()

    def cpu_ms(self) -> float:
        """The CPU of the server, and of its processes that have ended, in milliseconds."""
        assert self.client._server is not None
        stat = Path(f"/proc/{self.client._server.pid}/stat")
        if not stat.is_file():
            return 0.0
        ticks = stat.read_text().rpartition(")")[2].split()[11:15]
        return sum(map(int, ticks)) * 1e3 / os.sysconf("SC_CLK_TCK")

    async def change(self, line: int, text: str, until: str) -> float:
        """Change a line: the milliseconds to its diagnostics, or to its verdicts."""
        self.version += 1
        document = types.VersionedTextDocumentIdentifier(self.version, URI)
        range_ = types.Range(types.Position(line, 0), types.Position(line, 1000))
        change = types.TextDocumentContentChangePartial(range_, text)
        begun = time.perf_counter()
        self.client.text_document_did_change(types.DidChangeTextDocumentParams(document, [change]))
        await self.event(until, self.version).wait()
        return (time.perf_counter() - begun) * 1e3

    async def stop(self) -> None:
        await self.client.shutdown_async(None)
        self.client.exit(None)
        await self.client.stop()


async def _asked(client: Client, line: int) -> dict[str, float]:
    """The milliseconds of what editors ask after a key."""
    here, at = types.TextDocumentIdentifier(URI), types.Position(line, 30)
    asked = {
        "hover": lambda: client.client.text_document_hover_async(types.HoverParams(here, at)),
        "completion": lambda: client.client.text_document_completion_async(
            types.CompletionParams(here, at)
        ),
        "semantic tokens": lambda: client.client.text_document_semantic_tokens_full_async(
            types.SemanticTokensParams(here)
        ),
        "references": lambda: client.client.text_document_references_async(
            types.ReferenceParams(types.ReferenceContext(True), here, at)
        ),
    }
    found: dict[str, float] = {}
    for what, question in asked.items():
        times = []
        for _ in range(5):
            begun = time.perf_counter()
            await question()
            times.append((time.perf_counter() - begun) * 1e3)
        found[what] = statistics.median(times)
    return found


async def _measured(report: Report) -> None:
    text = (EXAMPLES / "task.krd").read_text("utf-8")
    line = text[: text.index(OLD)].count("\n")
    table = report.table(
        "Task: an invariant is changed",
        Column("what", "what"),
        Column("changes", "changes", 0),
        Column("median_ms", "median, ms"),
        Column("worst_ms", "worst, ms"),
        Column("cpu_ms", "CPU, ms"),
    )
    others: dict[str, float] = {}
    for what, on, changes in (
        ("diagnostics", "never", 6 if report.quick else 40),
        ("verdicts", "change", 6 if report.quick else 25),
    ):
        client = Client()
        await client.start(text, on)
        times: list[float] = []
        begun_ms = 0.0
        for number in range(changes + 1):
            if number == 1:
                begun_ms = client.cpu_ms()
            new = f"{OLD} and {number} <= numAgents + {number}"
            times.append(await client.change(line, new, what))
            if on == "change":
                marks = {mark.name: mark.kind for mark in client.verdicts[client.version]}
                report.expect(marks["Route"] == "holds", f"change {number}: {marks}")
        row: dict[str, str | float] = {
            "what": what,
            "changes": changes,
            "median_ms": statistics.median(times[1:]),
            "worst_ms": max(times[1:]),
            "cpu_ms": (client.cpu_ms() - begun_ms) / changes,
        }
        table.rows.append(row)
        if on == "never":
            others = await _asked(client, line)
        await client.stop()
    for what, median in others.items():
        table.rows.append({"what": what, "changes": 5, "median_ms": median})


def editor(report: Report) -> None:
    """Measure the server."""
    asyncio.run(_measured(report))


if __name__ == "__main__":
    sys.exit(main("editor", __doc__ or "", editor))
