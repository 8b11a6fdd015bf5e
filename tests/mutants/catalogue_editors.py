"""Seeded mistakes in what editors are told."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

_TESTS = ("tests/syntax/test_editing.py",)

EDITORS = (
    Mutant(
        "a name may be renamed to one that catches another",
        "syntax.editing.renaming.renamed",
        "_shape(after) != _shape(model)",
        "False",
        _TESTS,
    ),
    Mutant(
        "variables of two quantifiers are one symbol",
        "syntax.editing.model.identity",
        "(span.file, span.line, span.column)",
        "(span.file, symbol.kind, symbol.name)",
        _TESTS,
    ),
    Mutant(
        "a cure is offered that mends nothing",
        "syntax.editing.cures.cures",
        "len(after) < len(before) and not set(after) - set(before)",
        "True",
        _TESTS,
    ),
    Mutant(
        "verdicts on an older text are shown as those on the newest",
        "lsp.server.KoordServer._verified",
        "version != text.version or self.texts.get(text.uri) is not text or verified.interrupted",
        "verified.interrupted",
        ("tests/lsp/test_verdicts.py",),
    ),
    Mutant(
        "the end of a change is the end of its first line",
        "lsp.texts.changed",
        "offset(text, change.range.end, encoding)",
        "offset(text, change.range.start, encoding)",
        ("tests/lsp/test_texts.py",),
    ),
    Mutant(
        "characters of two units count as one",
        "lsp.places.width",
        "ord(character) > 0xFFFF",
        "ord(character) > 0x10FFFF",
        ("tests/lsp/test_texts.py",),
    ),
    Mutant(
        "a name is renamed in one file of a program alone",
        "syntax.editing.model.SemanticModel.occurrences_of",
        "self.all_occurrences",
        "self.occurrences",
        ("tests/lsp/test_program_files.py",),
    ),
    Mutant(
        "a file of properties belongs to every program beside it",
        "api.program_files._Folder.only_program",
        "len(found) == 1",
        "found",
        ("tests/api/test_program_files.py",),
    ),
    Mutant(
        "the other files of a program are not told of a change",
        "lsp.server.KoordServer._analysed",
        "self._others(text)",
        "()",
        ("tests/lsp/test_program_files.py",),
    ),
    Mutant(
        "claims of other files are marked on the first line",
        "api.verdict_marks._is_own",
        "stated.span.file not in others",
        "True",
        ("tests/lsp/test_program_files.py",),
    ),
    Mutant(
        "a string with a sign of comments is one",
        "syntax.editing.lines.ends_in_text",
        "not last[0].startswith('\"')",
        "last",
        _TESTS,
    ),
    Mutant(
        "an edit that was put back is agreed to when another one comes",
        "api.edits._PutBack.agreed",
        "edit.sources != sources",
        "False",
        ("tests/api/test_reloading.py",),
    ),
    Mutant(
        "a request that cannot be read is left without an answer",
        "lsp.server.KoordProtocol.handle_message",
        "self._send_response(message.id, error=error)",
        "pass",
        ("tests/lsp/test_server.py",),
    ),
    Mutant(
        "a configuration in an editor is checked without its program",
        "api.configuration_texts.checked_text",
        "program_beside(path, opened)",
        "None",
        ("tests/lsp/test_configurations.py",),
    ),
    Mutant(
        "any file of YAML that has agents is a configuration",
        "api.configuration_texts.is_configuration",
        "2 * len(names & _FIELDS) >= len(names)",
        "True",
        ("tests/lsp/test_configurations.py",),
    ),
    Mutant(
        "a configuration belongs to the program with the shortest name",
        "api.program_files.program_beside",
        "len(one.stem)",
        "-len(one.stem)",
        ("tests/api/test_program_files.py",),
    ),
    Mutant(
        "a name is renamed in a configuration as it was when the program was changed",
        "api.editing.Document.take_configuration",
        "one.name == source.name",
        "False",
        ("tests/lsp/test_configurations.py",),
    ),
    Mutant(
        "a field is completed by the one above it, in the same block or not",
        "api.configuration_fields._around",
        "len(found[1]) < indent",
        "len(found[1]) <= indent",
        ("tests/lsp/test_configurations.py",),
    ),
    Mutant(
        "browsers have processes",
        "verify.processes.can_fork",
        "sys.platform != 'emscripten'",
        "True",
        ("tests/playground/test_answering.py",),
    ),
)
