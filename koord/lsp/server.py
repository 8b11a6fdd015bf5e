"""The server: documents, what is asked about them, and verdicts as they come.

Analysis and verification run in threads, so that the loop of the protocol goes on. A text is
analysed once a version; what is asked waits for the newest. Nothing that a client sends ends the
server: what a handler raises is answered as an error.
"""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import re
import tempfile
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from cattrs import ClassValidationError, transform_error
from lsprotocol import types
from msgspec import Struct, to_builtins
from pygls.exceptions import FeatureRequestError, JsonRpcException, JsonRpcInvalidParams
from pygls.lsp.server import LanguageServer
from pygls.protocol import LanguageServerProtocol, lsp_method
from pygls.protocol.json_rpc import MsgId
from pygls.uris import to_fs_path

from koord.api.configuration_texts import (
    CheckedText,
    checked_text,
    configuration_text,
    load_libraries,
)
from koord.api.editing import Document, Source, Span, SymbolKind, document, normalise
from koord.api.html import html
from koord.api.program_files import beside, program_files
from koord.api.run_texts import run_text
from koord.api.verdict_marks import MarkKind, VerdictMark
from koord.lsp import features
from koord.lsp.configuration_features import field_completions, field_hover
from koord.lsp.features import file_name
from koord.lsp.places import Places
from koord.lsp.settings import LspSettings, read_settings
from koord.lsp.texts import changed
from koord.lsp.verifying import Verified, Verifier, warm_up
from koord.version import __version__

T = TypeVar("T")

#: The notification of verdicts, and the commands, which clients know by these names.
VERDICTS = "koord/verdicts"
COUNTEREXAMPLE = "koord.counterexample"
SHOW_TRACE = "koord/showTrace"
VERIFY = "koord.verify"
CANCEL = "koord.cancelVerification"

#: What clients call the language of configurations, and how their files end.
YAML = "yaml"
_YAML_SUFFIXES = (".yaml", ".yml")

_MARKS = {
    MarkKind.HOLDS: "✓",
    MarkKind.BOUNDED: "✓",
    MarkKind.VACUOUS: "∅",
    MarkKind.VIOLATED: "✗",
    MarkKind.UNKNOWN: "?",
}


class RefusedError(JsonRpcException):
    """A request that is understood and cannot be met; the message says why."""

    CODE = -32803  # RequestFailed in the protocol


class OpenText:
    """An open document: its newest text, its analysis, and the verdicts that are known.

    A configuration (``is_yaml``) has no analysis, and no verdicts.
    """

    def __init__(self, uri: str, text: str, version: int, language: str = "") -> None:
        self.uri = uri
        self.text = text
        self.version = version
        self.analysis: asyncio.Task[Document | None] | None = None
        self.known: Document | None = None  #: the newest analysis that has ended
        self.waiting: asyncio.Task[None] | None = None  #: for the delay before a verification
        self.verified: Verified | None = None
        self.verified_version = -1
        self.path = path_of(uri)
        self.is_yaml = language == YAML or file_name(uri).endswith(_YAML_SUFFIXES)
        self.files: frozenset[Path] = frozenset()  #: of its program, as of the last analysis
        self.main: Path | None = self.path
        self.settled = Verified()  #: what is known of a verification that goes on
        self.is_verifying = False
        self.diagnostics: list[types.Diagnostic] = []


class Shown(Struct, frozen=True, rename="camel"):
    """A verdict as the client is told of it; ``line`` counts from 0."""

    name: str
    kind: str
    line: int
    title: str
    story: str
    engine: str
    seconds: float
    kept: bool
    has_trace: bool
    stale: bool


class Misread(Struct, frozen=True):
    """A request that has not the form of its method, and why."""

    id: MsgId
    reason: str


class KoordProtocol(LanguageServerProtocol):
    """The protocol, with texts kept by the server alone, and with an answer to every request.

    pygls keeps texts, too, whose lines end where Python's do: changes then are in other places. It
    answers nothing to requests that it cannot read, for which a client then waits for ever.
    """

    _server: KoordServer

    def structure_message(self, data: dict[str, Any]) -> Any:
        """A message in its form; a request that cannot be read is :class:`Misread`."""
        try:
            return super().structure_message(data)
        except JsonRpcException as error:
            if "id" not in data or "method" not in data:
                raise
            cause = error.__cause__
            reasons = transform_error(cause) if isinstance(cause, ClassValidationError) else [cause]
            reason = "; ".join(map(str, reasons))
            # names as the protocol has them
            return Misread(data["id"], re.sub(r"_([a-z])", lambda at: at[1].upper(), reason))

    def handle_message(self, message: Any) -> None:
        """Take a message up; one that cannot be read is answered by why."""
        if isinstance(message, Misread):
            error = JsonRpcInvalidParams(message.reason).to_response_error()
            self._send_response(message.id, error=error)
        else:
            super().handle_message(message)

    @lsp_method(types.TEXT_DOCUMENT_DID_OPEN)
    def lsp_text_document__did_open(self, params: types.DidOpenTextDocumentParams) -> None:
        given = params.text_document
        self._server.open(given.uri, given.text, given.version, given.language_id)

    @lsp_method(types.TEXT_DOCUMENT_DID_CHANGE)
    def lsp_text_document__did_change(self, params: types.DidChangeTextDocumentParams) -> None:
        self._server.change(params)

    @lsp_method(types.TEXT_DOCUMENT_DID_CLOSE)
    def lsp_text_document__did_close(self, params: types.DidCloseTextDocumentParams) -> None:
        self._server.close(params.text_document.uri)


class KoordServer(LanguageServer):
    """The language server of Koord."""

    def __init__(self, warm: Callable[[], None] = warm_up) -> None:
        super().__init__("koord", __version__, protocol_cls=KoordProtocol)
        self.warm = warm  #: called beside the loop, once a client is there
        self.settings = LspSettings()
        self.texts: dict[str, OpenText] = {}
        self.verifiers: dict[Path | str, Verifier] = {}  #: by the program's own file
        self.analysts = ThreadPoolExecutor(1, "analysis")
        self.checkers = ThreadPoolExecutor(1, "configurations")  #: which wait for no program
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        _register(self)

    def report_server_error(self, error: Exception, source: Any) -> None:
        """Log what went wrong outside of requests, which are answered with their errors."""
        if source is not FeatureRequestError:
            message = f"koord: {error}"
            self.window_log_message(types.LogMessageParams(types.MessageType.Error, message))

    # --- documents --------------------------------------------------------------------------------

    def open(self, uri: str, text: str, version: int, language: str = "") -> None:
        """Take a document up."""
        self.close(uri)  # a client that opens it again has another text
        self.texts[uri] = OpenText(uri, text, version, language)
        self._analyse(self.texts[uri])

    def change(self, params: types.DidChangeTextDocumentParams) -> None:
        """Make changes of a document."""
        text = self.texts.get(params.text_document.uri)
        if text is None:
            return
        for change in params.content_changes:
            text.text = changed(text.text, change, self.encoding)
        text.version = params.text_document.version
        self._analyse(text)

    def close(self, uri: str) -> None:
        """Put a document away."""
        text = self.texts.pop(uri, None)
        if text is None:
            return
        self._end_verification(text)
        if not any(other.main == text.main for other in self.texts.values()):
            self.verifiers.pop(_key(text), None)
        self.text_document_publish_diagnostics(types.PublishDiagnosticsParams(uri, []))

    def close_all(self) -> None:
        """Put everything away, before the server ends."""
        for text in self.texts.values():
            self._end_verification(text)
        for verifier in self.verifiers.values():
            verifier.close(2.0)
        self.texts.clear()
        self.verifiers.clear()
        for threads in (self.analysts, self.checkers):
            threads.shutdown(wait=False, cancel_futures=True)
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    @property
    def encoding(self) -> types.PositionEncodingKind | str:
        """The units in which the client counts characters."""
        return self.server_capabilities.position_encoding or types.PositionEncodingKind.Utf16

    def places(self, of: Document, text: OpenText) -> Places:
        """The places of a document, and of the other files of its program, for the client."""
        others: list[tuple[Source, str]] = []
        if text.path is not None:
            known = {other.path: other.uri for other in self.texts.values()}
            for source in of.files:
                path = beside(text.path, source.name)
                others.append((source, known.get(path) or path.as_uri()))
        return Places(of.source, self.encoding, text.uri, others)

    async def document(self, uri: str) -> tuple[Document, Places] | None:
        """The newest analysis of a document; None: it is a configuration.

        Raises JsonRpcInvalidParams if it is not open.
        """
        while True:
            text = self.texts.get(uri)
            if text is None or text.analysis is None:
                raise JsonRpcInvalidParams(f"{uri} is not open")
            analysis = text.analysis
            # one that is superseded is cancelled, and the newer one asked
            await asyncio.wait([analysis])
            if not analysis.cancelled() and text.analysis is analysis:
                found = analysis.result()
                return None if found is None else (found, self.places(found, text))

    async def ask(self, uri: str, question: Callable[[Document, Places], T]) -> T | None:
        """Ask about the newest analysis, beside the loop; None, if it is a configuration."""
        known = await self.document(uri)
        if known is None:
            return None
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self.analysts, question, *known)

    async def ask_configuration(
        self, uri: str, question: Callable[[Places, Source | None], T | None]
    ) -> T | None:
        """Ask about an open text of YAML and its program, beside the loop.

        None, if it is neither a configuration nor the site of one.
        """
        text, opened = self.texts[uri], self._opened()
        name, path, now = file_name(uri), text.path, text.text

        def asked() -> T | None:
            found = configuration_text(name, path, now, opened.get)
            if found is None:
                return None
            return question(Places(found.source, self.encoding), found.program)

        return await asyncio.get_running_loop().run_in_executor(self.checkers, asked)

    def _opened(self) -> dict[Path | None, str]:
        """The texts of open documents by their files."""
        return {other.path: other.text for other in self.texts.values()}

    def is_yaml(self, uri: str) -> bool:
        """Whether a document is open that is YAML."""
        text = self.texts.get(uri)
        return text is not None and text.is_yaml

    def _analyse(self, text: OpenText, *, is_changed: bool = True) -> None:
        """Analyse a text that has changed, or one whose program has changed in another file."""
        if text.analysis is not None:
            text.analysis.cancel()
        self._end_verification(text)
        work = self._checked if text.is_yaml else self._analysed
        text.analysis = asyncio.get_running_loop().create_task(work(text, is_changed))
        text.analysis.add_done_callback(self._report)

    async def _checked(self, text: OpenText, is_changed: bool) -> None:
        """Check a configuration; a while later, where it is the program that has changed."""
        loop = asyncio.get_running_loop()
        version = text.version
        if not is_changed:
            await asyncio.sleep(self.settings.verify.delay_s)
        await asyncio.to_thread(load_libraries)
        read = partial(_check, text.uri, text.path, text.text, self._opened())
        found = await loop.run_in_executor(self.checkers, read)
        others: list[tuple[Source, str]] = []
        if text.path is not None:
            others = [(one, beside(text.path, one.name).as_uri()) for one in found.others]
            text.files = frozenset(beside(text.path, one.name) for one in found.others)
        places = Places(found.source, self.encoding, text.uri, others)
        text.diagnostics = features.diagnostics(found, places, text.uri)
        self._publish(text, version)
        for other in self._others(text):
            if other.is_yaml and is_changed:  # the configuration of a site, or the site of one
                self._analyse(other, is_changed=False)
            if other.known is not None and text.path is not None and other.path is not None:
                name = os.path.relpath(text.path, other.path.parent)
                other.known.take_configuration(Source(name, found.source.text))

    async def _analysed(self, text: OpenText, is_changed: bool) -> Document:
        loop = asyncio.get_running_loop()
        version = text.version
        read = partial(_read, text.uri, text.path, text.text, self._opened())
        found, text.main = await loop.run_in_executor(self.analysts, read)
        text.known = found
        places = self.places(found, text)
        text.files = frozenset() if text.path is None else _paths(found, text.path)
        text.diagnostics = features.diagnostics(found, places, text.uri)
        self._publish(text, version)
        if is_changed:
            for other in self._others(text):
                self._analyse(other, is_changed=False)
            if self.settings.verify.on == "change":
                self.verify(text)
                return found
        else:
            text.verified_version = -1
        if text.verified is not None:
            self._tell(text, "stale")
        return found

    def _others(self, text: OpenText) -> list[OpenText]:
        """The other open files of a program, those that were of it included."""
        return [
            other
            for other in self.texts.values()
            if other is not text and (other.path in text.files or text.path in other.files)
        ]

    def _report(self, task: asyncio.Task[Any]) -> None:
        """Tell of what failed in a task that nobody waits for."""
        if not task.cancelled() and (error := task.exception()) is not None:
            message = f"koord could not read the text: {error!r}"
            self.window_log_message(types.LogMessageParams(types.MessageType.Error, message))

    def _publish(self, text: OpenText, version: int) -> None:
        """Tell what is wrong: with the text, and by the verdicts on just this text."""
        found = list(text.diagnostics)
        verified = text.verified if text.verified_version == version else None
        if text.is_verifying:
            verified = text.settled
        if verified is not None and text.known is not None:
            found += _verdict_diagnostics(verified, self.places(text.known, text))
        self.text_document_publish_diagnostics(
            types.PublishDiagnosticsParams(text.uri, found, version)
        )

    # --- verdicts ---------------------------------------------------------------------------------

    def verify(self, text: OpenText, *, at_once: bool = False) -> None:
        """Verify a document as it is now; what is going on about older texts is ended."""
        if text.is_yaml:
            return
        found = text.known
        self._end_verification(text)
        if found is None or found.program is None:
            self._tell(text, "errors")
            return
        delay_s = 0.0 if at_once else self.settings.verify.delay_s
        version = text.version
        text.is_verifying, text.settled = True, Verified()
        self._tell(text, "verifying")
        loop = asyncio.get_running_loop()
        text.waiting = loop.create_task(self._verify_later(text, found, version, delay_s))

    async def _verify_later(
        self, text: OpenText, found: Document, version: int, delay_s: float
    ) -> None:
        await asyncio.sleep(delay_s)
        loop = asyncio.get_running_loop()

        def hear(version: int, verified: Verified) -> None:
            if found is text.known:  # and no other file of the program has changed
                self._verified(text, version, verified)

        def tell(version: int, verified: Verified) -> None:
            loop.call_soon_threadsafe(hear, version, verified)

        verifier = self.verifiers.get(_key(text))
        if verifier is None:
            verifier = self.verifiers[_key(text)] = Verifier(self.settings.verify)
        verifier.start(found, version, tell)

    def _verified(self, text: OpenText, version: int, verified: Verified) -> None:
        """Show the verdicts on a text, if it is still the newest.

        The other open files of the program are verified then: what is known is not asked again.
        """
        if version != text.version or self.texts.get(text.uri) is not text or verified.interrupted:
            return
        if not verified.done:
            if text.is_verifying:
                text.settled = verified
                self._publish(text, version)
                self._tell(text, "verifying")
            return
        text.is_verifying = False
        text.verified, text.verified_version = verified, version
        self._publish(text, version)
        self._tell(text, "refused" if verified.refused else "done")
        if self.settings.verify.on == "change":
            for other in self._others(text):
                if other.verified_version == -1 and not other.is_verifying and other.known:
                    self.verify(other, at_once=True)

    def _end_verification(self, text: OpenText) -> None:
        verifier = self.verifiers.get(_key(text))
        if text.waiting is not None:
            text.waiting.cancel()
            text.waiting = None
        if verifier is not None and text.is_verifying:
            verifier.cancel()
        text.is_verifying = False

    def stop_verification(self, uri: str) -> None:
        """End the verification of a document, as the user asks."""
        text = self.texts.get(uri)
        if text is not None and not text.is_yaml:
            self._end_verification(text)
            self._tell(text, "cancelled")

    def _tell(self, text: OpenText, state: str) -> None:
        """Tell the client how verification is going, for its lenses and gutter."""
        verified = text.verified
        self.protocol.notify(
            VERDICTS,
            {
                "uri": text.uri,
                "version": text.version,
                "state": state,
                "reason": "" if verified is None else verified.refused,
                "marks": [to_builtins(mark) for mark in self.shown(text)],
            },
        )
        workspace = self.client_capabilities.workspace
        lens = None if workspace is None else workspace.code_lens
        if lens is not None and lens.refresh_support:
            self.workspace_code_lens_refresh(None)

    def shown(self, text: OpenText) -> list[Shown]:
        """The verdicts that are known, at the places of their claims in the newest text.

        While a verification goes on those that it has settled, and older ones of other claims.
        """
        if text.known is None:
            return []
        new = text.settled.marks if text.is_verifying else ()
        shown = [_shown(mark, mark.span.line - 1, stale=False) for mark in new]
        stale = text.verified_version != text.version or text.is_verifying
        lines = _lines(text.known)
        told = {mark.name for mark in new}
        before = () if text.verified is None else text.verified.marks
        for mark in (mark for mark in before if mark.name not in told):
            line = lines.get(mark.name) if stale else mark.span.line - 1
            if line is None and mark.span.line == 1:
                line = 0
            if line is not None:
                shown.append(_shown(mark, line, stale))
        return shown

    def lenses(self, uri: str) -> list[types.CodeLens]:
        """The verdicts above their claims; those of an older text are said to be."""
        text = self.texts.get(uri)
        if text is None or text.known is None:
            return []
        shown = self.shown(text)
        lenses = [_lens(mark, uri) for mark in shown]
        told = {mark.name for mark in shown}
        if text.is_verifying:
            for name, line in _lines(text.known).items():
                if name not in told:
                    at = types.Range(types.Position(line, 0), types.Position(line, 0))
                    lenses.append(types.CodeLens(at, types.Command("… verifying", "")))
        return lenses

    def counterexample(self, uri: str, claim: str) -> dict[str, str]:
        """The run that breaks a claim: its title, as text and as a trace in JSON.

        Raises JsonRpcInvalidParams if there is none.
        """
        text = self.texts.get(uri)
        known = [] if text is None else [text.settled if text.is_verifying else None, text.verified]
        reports = [one.report for one in known if one is not None and one.report is not None]
        found = (v for report in reports for v in report.verdicts if v.name == claim)
        verdict = next(found, None)
        trace = None if verdict is None else verdict.counterexample
        if verdict is None or trace is None:
            raise JsonRpcInvalidParams(f"there is no counterexample of {claim}")
        return {
            "claim": claim,
            "title": f"{claim}: counterexample",
            "text": run_text(verdict),
            "trace": trace.to_json(),
            "html": html(verdict),
        }

    async def show_counterexample(self, uri: str, claim: str) -> dict[str, str]:
        """Show a counterexample: by the client if it can, else as a file that it opens."""
        loop = asyncio.get_running_loop()
        found = await loop.run_in_executor(self.analysts, self.counterexample, uri, claim)
        if self.settings.trace_view:
            self.protocol.notify(SHOW_TRACE, {"uri": uri, **found})
            return found
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="koord-lsp-")
        safe = "".join(c if c.isalnum() else "_" for c in claim)
        path = Path(self._folder.name) / f"{safe}.md"
        path.write_text(found["text"], encoding="utf-8")
        path.with_suffix(".json").write_text(found["trace"], encoding="utf-8")
        window = self.client_capabilities.window
        if window is not None and window.show_document is not None and window.show_document.support:
            self.window_show_document(
                types.ShowDocumentParams(path.as_uri(), take_focus=True), lambda _: None
            )
        else:
            message = f"the counterexample of {claim} is in {path}"
            self.window_show_message(types.ShowMessageParams(types.MessageType.Info, message))
        return found

    def configure(self, given: Any) -> None:
        """Take settings; wrong ones are told, and the old ones stay."""
        try:
            self.settings = read_settings(given)
        except ValueError as error:
            self.window_show_message(types.ShowMessageParams(types.MessageType.Warning, str(error)))
            return
        for text in self.texts.values():
            self._end_verification(text)
        self.verifiers.clear()


def path_of(uri: str) -> Path | None:
    """The file of an address; None if it is none of a file."""
    path = to_fs_path(uri) if uri.startswith("file:") else None
    return None if not path else Path(path)


def _read(
    uri: str, path: Path | None, text: str, opened: Mapping[Path | None, str]
) -> tuple[Document, Path | None]:
    """A text as a part of its program, and the program's own file."""
    if path is None:
        return document(Source(file_name(uri), normalise(text))), None
    files = program_files(path, text, opened.get)
    found = document(
        files.main,
        params=files.params,
        properties=files.properties,
        configurations=files.configurations,
        shown=path.name,
    )
    return found, path.parent / files.main.name


def _check(
    uri: str, path: Path | None, text: str, opened: Mapping[Path | None, str]
) -> CheckedText:
    """A configuration, checked with its program as it is open."""
    return checked_text(file_name(uri) if path is None else path.name, path, text, opened.get)


def _paths(found: Document, path: Path) -> frozenset[Path]:
    """The files of a document's program."""
    return frozenset(beside(path, file.name) for file in found.files)


def _key(text: OpenText) -> Path | str:
    """What the files of a program have in common."""
    return text.main or text.uri


def _lines(document: Document) -> dict[str, int]:
    """The lines of claims by name, from 0."""
    kinds = (SymbolKind.INVARIANT, SymbolKind.EVENTUALLY)
    return {
        symbol.name: symbol.name_span.line - 1
        for symbol in document.symbols
        if symbol.kind in kinds and symbol.name_span is not None
    }


def _shown(mark: VerdictMark, line: int, stale: bool) -> Shown:
    return Shown(
        mark.name,
        mark.kind.value,
        line,
        f"{_MARKS[mark.kind]} {mark.title}",
        mark.story,
        mark.engine,
        mark.seconds,
        mark.kept,
        mark.has_trace,
        stale,
    )


def _lens(mark: Shown, uri: str) -> types.CodeLens:
    at = types.Range(types.Position(mark.line, 0), types.Position(mark.line, 0))
    title = f"… {mark.title} (before the last change)" if mark.stale else mark.title
    command = types.Command(title, "")
    if mark.has_trace and not mark.stale:
        command = types.Command(
            f"{title} · show the run", COUNTEREXAMPLE, arguments=[uri, mark.name]
        )
    return types.CodeLens(at, command)


def _verdict_diagnostics(verified: Verified, places: Places) -> list[types.Diagnostic]:
    """What verdicts tell that people have to do something about."""
    found: list[types.Diagnostic] = []

    def add(span: Span, severity: types.DiagnosticSeverity, message: str, code: str) -> None:
        range_ = places.range(span)
        line = places.source.line_text(span.line)
        if span.end_line > span.line:  # of a section its first line
            end = places.position(span.line, len(line) + 1)
            range_ = types.Range(range_.start, end)
        found.append(types.Diagnostic(range_, message, severity, code, None, "koord verify"))

    for mark in verified.marks:
        match mark.kind:
            case MarkKind.VIOLATED:
                add(mark.span, types.DiagnosticSeverity.Error, mark.story, "violated")
                if mark.broken_at is not None and mark.broken_at != mark.span:
                    add(
                        mark.broken_at,
                        types.DiagnosticSeverity.Information,
                        f"{mark.name} breaks here",
                        "violated",
                    )
            case MarkKind.UNKNOWN:
                add(mark.span, types.DiagnosticSeverity.Information, mark.story, "unknown")
            case MarkKind.HOLDS | MarkKind.BOUNDED | MarkKind.VACUOUS:
                pass
    for span, told in verified.vacuities:
        add(span, types.DiagnosticSeverity.Warning, f"vacuous: {told}", "vacuous")
    if verified.refused:
        first = Span(places.source.name, 1, 1, 1, 1)
        add(first, types.DiagnosticSeverity.Information, verified.refused, "not verified")
    return found


# --- what clients ask -----------------------------------------------------------------------------


def _register(server: KoordServer) -> None:
    """Register what the server answers."""
    feature = server.feature

    @feature(types.INITIALIZE)
    def initialize(params: types.InitializeParams) -> None:
        server.configure(params.initialization_options)

    @feature(types.INITIALIZED)
    def initialized(params: types.InitializedParams) -> None:
        threading.Thread(target=server.warm, name="warming up", daemon=True).start()
        if _registers_texts(server):
            server.client_register_capability(_configurations_too())

    @feature(types.SHUTDOWN)
    def shutdown(params: None) -> None:
        server.close_all()

    @feature(types.WORKSPACE_DID_CHANGE_CONFIGURATION)
    def configured(params: types.DidChangeConfigurationParams) -> None:
        server.configure(params.settings)
        for text in server.texts.values():
            if server.settings.verify.on == "change" and text.known is not None:
                server.verify(text)

    @feature(types.TEXT_DOCUMENT_DID_SAVE)
    def saved(params: types.DidSaveTextDocumentParams) -> None:
        text = server.texts.get(params.text_document.uri)
        if text is not None and server.settings.verify.on == "save":
            server.verify(text, at_once=True)

    @feature(types.TEXT_DOCUMENT_HOVER)
    async def hover(params: types.HoverParams) -> types.Hover | None:
        uri, at = params.text_document.uri, params.position
        if server.is_yaml(uri):
            return await server.ask_configuration(uri, lambda places, _: field_hover(places, at))
        return await server.ask(uri, lambda d, places: features.hover(d, places, at))

    @feature(types.TEXT_DOCUMENT_DEFINITION)
    async def definition(params: types.DefinitionParams) -> types.Location | None:
        uri = params.text_document.uri
        return await server.ask(uri, lambda d, at: features.definition(d, at, params.position))

    @feature(types.TEXT_DOCUMENT_REFERENCES)
    async def references(params: types.ReferenceParams) -> list[types.Location] | None:
        return await server.ask(
            params.text_document.uri, lambda d, at: features.references(d, at, params)
        )

    @feature(types.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)
    async def highlights(
        params: types.DocumentHighlightParams,
    ) -> list[types.DocumentHighlight] | None:
        return await server.ask(
            params.text_document.uri, lambda d, at: features.highlights(d, at, params.position)
        )

    @feature(
        types.TEXT_DOCUMENT_COMPLETION, types.CompletionOptions(trigger_characters=[".", "@", "<"])
    )
    async def completion(params: types.CompletionParams) -> types.CompletionList | None:
        uri, at = params.text_document.uri, params.position
        if server.is_yaml(uri):
            return await server.ask_configuration(
                uri, lambda places, program: field_completions(places, program, at)
            )
        snippets = _takes_snippets(server)
        return await server.ask(
            params.text_document.uri,
            lambda d, at: features.completions(d, at, params.position, snippets=snippets),
        )

    @feature(
        types.TEXT_DOCUMENT_SIGNATURE_HELP,
        types.SignatureHelpOptions(trigger_characters=["(", ","]),
    )
    async def signature(params: types.SignatureHelpParams) -> types.SignatureHelp | None:
        return await server.ask(
            params.text_document.uri, lambda d, at: features.signature_help(d, at, params.position)
        )

    @feature(types.TEXT_DOCUMENT_FORMATTING)
    async def formatting(params: types.DocumentFormattingParams) -> list[types.TextEdit] | None:
        return await server.ask(params.text_document.uri, features.formatting)

    @feature(types.TEXT_DOCUMENT_PREPARE_RENAME)
    async def prepare(params: types.PrepareRenameParams) -> types.Range | None:
        found = await server.ask(
            params.text_document.uri, lambda d, at: features.prepare_rename(d, at, params.position)
        )
        if isinstance(found, str):
            raise RefusedError(found)
        return found

    @feature(types.TEXT_DOCUMENT_RENAME, types.RenameOptions(prepare_provider=True))
    async def rename(params: types.RenameParams) -> types.WorkspaceEdit | None:
        found = await server.ask(
            params.text_document.uri, lambda d, at: features.rename(d, at, params)
        )
        if isinstance(found, str):
            raise RefusedError(found)
        return found

    @feature(types.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    async def symbols(params: types.DocumentSymbolParams) -> list[types.DocumentSymbol] | None:
        return await server.ask(params.text_document.uri, features.symbols)

    @feature(
        types.TEXT_DOCUMENT_SEMANTIC_TOKENS_FULL,
        types.SemanticTokensLegend(features.TOKEN_KINDS, features.TOKEN_MODIFIERS),
    )
    async def tokens(params: types.SemanticTokensParams) -> types.SemanticTokens | None:
        return await server.ask(params.text_document.uri, features.semantic_tokens)

    @feature(types.TEXT_DOCUMENT_FOLDING_RANGE)
    async def folding(params: types.FoldingRangeParams) -> list[types.FoldingRange] | None:
        return await server.ask(params.text_document.uri, lambda d, at: features.folding(d))

    @feature(types.TEXT_DOCUMENT_INLAY_HINT)
    async def inlays(params: types.InlayHintParams) -> list[types.InlayHint] | None:
        if not server.settings.inlay_hints:
            return []
        return await server.ask(
            params.text_document.uri, lambda d, at: features.inlays(d, at, params.range)
        )

    @feature(
        types.TEXT_DOCUMENT_CODE_ACTION,
        types.CodeActionOptions(
            code_action_kinds=[types.CodeActionKind.QuickFix, types.CodeActionKind.SourceFixAll]
        ),
    )
    async def actions(params: types.CodeActionParams) -> list[types.CodeAction] | None:
        uri = params.text_document.uri
        return await server.ask(uri, lambda d, at: features.code_actions(d, at, uri, params.range))

    @feature(types.TEXT_DOCUMENT_CODE_LENS)
    async def lenses(params: types.CodeLensParams) -> list[types.CodeLens]:
        await server.document(params.text_document.uri)
        return server.lenses(params.text_document.uri)

    @server.command(COUNTEREXAMPLE)
    async def counterexample(uri: str, claim: str) -> dict[str, str]:
        return await server.show_counterexample(uri, claim)

    @server.command(VERIFY)
    async def verify(uri: str) -> None:
        await server.document(uri)
        server.verify(server.texts[uri], at_once=True)

    @server.command(CANCEL)
    def cancel(uri: str) -> None:
        server.stop_verification(uri)


def _takes_snippets(server: KoordServer) -> bool:
    text = server.client_capabilities.text_document
    completion = None if text is None else text.completion
    item = None if completion is None else completion.completion_item
    return item is not None and bool(item.snippet_support)


def _registers_texts(server: KoordServer) -> bool:
    """Whether the client may be asked later for the texts of more than programs."""
    text = server.client_capabilities.text_document
    sync = None if text is None else text.synchronization
    return sync is not None and bool(sync.dynamic_registration)


def _configurations_too() -> types.RegistrationParams:
    """The request for the texts of YAML files, to be asked what fields mean, and for nothing else.

    A client that counts YAML among the server's languages would ask the server for the layout of
    such files, too, and the user which of their formatters to take.
    """
    selector = [types.TextDocumentFilterLanguage(language=YAML)]
    options = {
        types.TEXT_DOCUMENT_DID_OPEN: types.TextDocumentRegistrationOptions(selector),
        types.TEXT_DOCUMENT_DID_CHANGE: types.TextDocumentChangeRegistrationOptions(
            types.TextDocumentSyncKind.Incremental, selector
        ),
        types.TEXT_DOCUMENT_DID_CLOSE: types.TextDocumentRegistrationOptions(selector),
        types.TEXT_DOCUMENT_HOVER: types.TextDocumentRegistrationOptions(selector),
        types.TEXT_DOCUMENT_COMPLETION: types.TextDocumentRegistrationOptions(selector),
    }
    return types.RegistrationParams(
        [types.Registration(f"yaml {method}", method, given) for method, given in options.items()]
    )


#: Collect garbage so seldom: what an analysis makes has few cycles, and what is loaded is much.
_COLLECTED_EACH = 50_000


def _warm_for_good() -> None:
    """Load what verifies, and leave it to no collector: this process does nothing else."""
    warm_up()
    gc.freeze()
    gc.set_threshold(_COLLECTED_EACH, *gc.get_threshold()[1:])


def serve(stdin: BinaryIO, stdout: BinaryIO) -> None:
    """Serve a client over two streams until it says so, or is gone."""
    logging.getLogger("pygls").setLevel(logging.CRITICAL)  # errors are answered, and told once
    server = KoordServer(_warm_for_good)
    try:
        server.start_io(stdin, stdout)
    finally:
        server.close_all()
