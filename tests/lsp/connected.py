"""A client and the server in one loop, connected by streams as by pipes."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Coroutine
from concurrent.futures import Future
from contextlib import asynccontextmanager
from threading import Event
from typing import Any, TypeVar

from lsprotocol import types
from pygls.io_ import run_async
from pygls.lsp.client import LanguageClient

from koord.lsp.server import SHOW_TRACE, VERDICTS, KoordServer

T = TypeVar("T")
URI = "file:///work/app.krd"

CAPABILITIES = types.ClientCapabilities(
    text_document=types.TextDocumentClientCapabilities(
        completion=types.CompletionClientCapabilities(
            completion_item=types.ClientCompletionItemOptions(snippet_support=True)
        )
    )
)


class _Writer:
    """What one side writes, the other reads."""

    def __init__(self, reader: asyncio.StreamReader) -> None:
        self.reader = reader

    def write(self, data: bytes) -> None:
        self.reader.feed_data(data)

    def close(self) -> None:
        self.reader.feed_eof()


class Editor:
    """A client, and what it was told."""

    def __init__(self, server: KoordServer) -> None:
        self.server = server
        self.client = LanguageClient("tests", "1")
        self.version = 0
        self.diagnostics: list[types.PublishDiagnosticsParams] = []
        self.verdicts: list[Any] = []
        self.traces: list[Any] = []
        self.messages: list[str] = []
        self.told = asyncio.Condition()

        @self.client.feature(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        async def published(params: types.PublishDiagnosticsParams) -> None:
            await self._note(self.diagnostics, params)

        @self.client.feature(VERDICTS)
        async def verdicts(params: Any) -> None:
            await self._note(self.verdicts, params)

        @self.client.feature(SHOW_TRACE)
        async def trace(params: Any) -> None:
            await self._note(self.traces, params)

        @self.client.feature(types.WINDOW_SHOW_MESSAGE)
        async def shown(params: types.ShowMessageParams) -> None:
            await self._note(self.messages, params.message)

        @self.client.feature(types.WINDOW_LOG_MESSAGE)
        async def logged(params: types.LogMessageParams) -> None:
            await self._note(self.messages, params.message)

    async def _note(self, into: list[Any], what: Any) -> None:
        async with self.told:
            into.append(what)
            self.told.notify_all()

    async def until(self, wanted: Any) -> None:
        """Wait until something was told."""
        async with self.told:
            await asyncio.wait_for(self.told.wait_for(wanted), 120)

    @property
    def document(self) -> types.TextDocumentIdentifier:
        return types.TextDocumentIdentifier(URI)

    def open(self, text: str) -> None:
        item = types.TextDocumentItem(URI, "koord", self.version, text)
        self.client.text_document_did_open(types.DidOpenTextDocumentParams(item))

    def replace(self, text: str) -> None:
        """Send a whole new text."""
        self.change(types.TextDocumentContentChangeWholeDocument(text))

    def change(self, *changes: types.TextDocumentContentChangeEvent) -> None:
        self.version += 1
        here = types.VersionedTextDocumentIdentifier(self.version, URI)
        self.client.text_document_did_change(types.DidChangeTextDocumentParams(here, list(changes)))

    async def raw(self, method: str, params: Any) -> Any:
        """Send a request as it is given, whether or not it has the form of its method."""
        protocol, answer = self.client.protocol, Future[Any]()
        protocol._request_futures["raw"] = answer
        body = json.dumps({"jsonrpc": "2.0", "id": "raw", "method": method, "params": params})
        assert protocol.writer is not None
        protocol.writer.write(f"Content-Length: {len(body)}\r\n\r\n{body}".encode())
        return await asyncio.wrap_future(answer)

    async def checked(self) -> list[types.Diagnostic]:
        """What is wrong with the newest text."""
        await self.until(lambda: any(d.version == self.version for d in self.diagnostics))
        return list(next(d for d in self.diagnostics if d.version == self.version).diagnostics)

    async def verified(self, state: str = "done") -> Any:
        """The verdicts on the newest text."""
        await self.until(
            lambda: any(v.version == self.version and v.state == state for v in self.verdicts)
        )
        return next(
            v for v in reversed(self.verdicts) if v.version == self.version and v.state == state
        )


@asynccontextmanager
async def connected(
    settings: Any = None, capabilities: types.ClientCapabilities = CAPABILITIES
) -> AsyncIterator[Editor]:
    """Within the context, a client of a server that was initialised."""
    server = KoordServer(lambda: None)
    editor = Editor(server)
    to_server, to_client = asyncio.StreamReader(), asyncio.StreamReader()
    server.protocol.set_writer(_Writer(to_client))
    editor.client.protocol.set_writer(_Writer(to_server))
    stop = Event()
    sides = [
        asyncio.create_task(run_async(stop, to_server, server.protocol)),
        asyncio.create_task(run_async(stop, to_client, editor.client.protocol)),
    ]
    try:
        await editor.client.initialize_async(
            types.InitializeParams(capabilities=capabilities, initialization_options=settings)
        )
        editor.client.initialized(types.InitializedParams())
        yield editor
        await editor.client.shutdown_async(None)
    finally:
        stop.set()
        to_server.feed_eof()
        to_client.feed_eof()
        await asyncio.gather(*sides)
        server.close_all()
        server.shutdown()


def run(work: Coroutine[Any, Any, T]) -> T:
    """Run a test's coroutine, in at most two minutes."""
    return asyncio.run(asyncio.wait_for(work, 120))
