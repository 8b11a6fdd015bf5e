"""`koord lsp` as a process: over its pipes, and where pygls is not there."""

from __future__ import annotations

import asyncio
import sys

import pytest
from lsprotocol import types
from pygls.lsp.client import LanguageClient

from koord.cli.exits import Exit
from koord.cli.main import main
from tests.lsp.connected import URI, run


def test_the_command_serves_an_editor_over_its_pipes() -> None:
    async def work() -> int | None:
        client = LanguageClient("tests", "1")
        told: asyncio.Queue[types.PublishDiagnosticsParams] = asyncio.Queue()

        @client.feature(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def published(params: types.PublishDiagnosticsParams) -> None:
            told.put_nowait(params)

        await client.start_io(sys.executable, "-m", "koord", "lsp")
        settings = {"verify": {"on": "never"}}
        params = types.InitializeParams(
            capabilities=types.ClientCapabilities(), initialization_options=settings
        )
        answer = await client.initialize_async(params)
        assert answer.server_info is not None
        assert answer.server_info.name == "koord"
        item = types.TextDocumentItem(URI, "koord", 1, "Go:\n  eff: x = 1\n")
        client.text_document_did_open(types.DidOpenTextDocumentParams(item))
        found = await told.get()
        assert [d.code for d in found.diagnostics] == ["K201"]
        await client.shutdown_async(None)
        client.exit(None)
        process = client._server
        assert process is not None
        code = await process.wait()
        await client.stop()
        return code

    assert run(work()) == Exit.OK


def test_without_pygls_the_command_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.startswith(("koord.lsp", "pygls"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pygls", None)
    assert main(["lsp"]) == Exit.BAD_INPUT
    told = capsys.readouterr().err
    assert "K950" in told
    assert "pip install 'koord[lsp]'" in told
