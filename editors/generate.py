"""Make the grammars of editors from the one list of words: ``python -m editors.generate``.

With ``--check`` nothing is written, and the exit code is 1 if something is not up to date.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable
from pathlib import Path

from koord.syntax import vocabulary
from koord.syntax.editing.completion import SECTION_FORMS, STATEMENT_FORMS
from koord.syntax.editing.words import WORDS
from koord.syntax.elaboration.library import library, library_names

FOLDER = Path(__file__).resolve().parent


def _any(words: Iterable[str]) -> str:
    """A group of words for a regular expression."""
    return "|".join(sorted(words))


def _ports() -> list[str]:
    names = {
        decl.name.name
        for module in library().modules.values()
        for decl in (*module.sensors, *module.actuators)
    }
    return sorted(names)


def textmate() -> dict[str, object]:
    """The grammar for TextMate, of which VS Code and many others make use."""
    name = r"[A-Za-z_]\w*"

    def match(pattern: str, scope: str, **groups: str) -> dict[str, object]:
        made: dict[str, object] = {"match": pattern}
        if scope:
            made["name"] = f"{scope}.koord"
        if groups:
            made["captures"] = {
                number.removeprefix("g"): {"name": f"{of}.koord"} for number, of in groups.items()
            }
        return made

    patterns = [
        match(r"(#|//).*$", "comment.line"),
        {
            "name": "string.quoted.double.koord",
            "begin": '"',
            "end": r'"|$',
            "patterns": [match(r"\\.", "constant.character.escape")],
        },
        match(r"\b\d+(\.\d+)?([eE][+-]?\d+)?\b", "constant.numeric"),
        match(
            rf"\b(def)\s+(fun)\s+({name})",
            "",
            g1="storage.type",
            g2="storage.type",
            g3="entity.name.function",
        ),
        match(
            rf"\b(def|enum|agent|using|contract)\s+(module\s+|adt\s+)?({name})",
            "",
            g1="storage.type",
            g2="storage.modifier",
            g3="entity.name.type",
        ),
        match(
            rf"\b(invariant|eventually|assume)\s+({name})(?=\s*(at\s+round\s*)?:)",
            "",
            g1="keyword.other.property",
            g2="entity.name.section",
        ),
        match(rf"\b(urgent)\s+({name})(?=\s*:)", "", g1="storage.modifier", g2="entity.name.event"),
        match(rf"^(?!(?:{_any(vocabulary.KEYWORDS)})\b){name}(?=\s*:)", "entity.name.event"),
        match(rf"\b({_any(vocabulary.HEADS)})\b(?=\s*:)", "storage.type"),
        match(r"\bextern(\s+fresh)?\b|\bat\s+round\b", "storage.modifier"),
        match(rf"\b({_any(vocabulary.OPERATORS)})\b", "keyword.operator.word"),
        match(rf"\b({_any(vocabulary.CONSTANTS)})\b", "constant.language"),
        match(rf"\b({_any(vocabulary.STATEMENTS)})\b", "keyword.control"),
        match(rf"\b({_any(vocabulary.SECTIONS)})\b", "storage.type"),
        match(rf"\b({_any(vocabulary.OWN_NAMES)})\b", "variable.language"),
        match(rf"\b({_any(vocabulary.FUNCTIONS)})\b(?=\s*\()", "support.function.builtin"),
        match(rf"\b({_any(library_names())})\b(?=\s*\()", "support.function"),
        match(
            rf"\b({_any(vocabulary.TYPES | vocabulary.GENERIC_TYPES)})\b", "support.type.primitive"
        ),
        match(rf"\b({_any(library().modules)})\b", "support.class"),
        match(rf"(?<=\.)({_any(_ports())})\b", "support.variable.property"),
        match(rf"\b{name}(?=\s*\()", "entity.name.function.call"),
        match("|".join(re.escape(sign) for sign in vocabulary.SIGNS), "keyword.operator"),
    ]
    return {
        "$schema": "https://raw.githubusercontent.com/martinring/tmlanguage/master/tmlanguage.json",
        "comment": "made by editors/generate.py: change that",
        "name": "Koord",
        "scopeName": "source.koord",
        "fileTypes": ["krd"],
        "patterns": patterns,
    }


def vim() -> str:
    """The syntax for Vim and Neovim."""

    def keywords(group: str, words: Iterable[str]) -> str:
        return f"syn keyword {group} {' '.join(sorted(words))}"

    # very nomagic: all but `\\` stands for itself, so that `|`, `+`, `&`, `=` need no care
    signs = "\\|".join(s.replace("/", "\\/") for s in vocabulary.SIGNS if s.isascii())
    lines = [
        '" Vim syntax of Koord, made by editors/generate.py: change that',
        "if exists('b:current_syntax')",
        "  finish",
        "endif",
        "",
        keywords("koordSection", vocabulary.SECTIONS),
        keywords("koordStatement", vocabulary.STATEMENTS),
        keywords("koordOperator", vocabulary.OPERATORS),
        keywords("koordBoolean", vocabulary.CONSTANTS),
        keywords("koordName", vocabulary.OWN_NAMES),
        keywords("koordType", vocabulary.TYPES | vocabulary.GENERIC_TYPES),
        keywords("koordModule", library().modules),
        f"syn match koordSection /\\v<({_any(vocabulary.HEADS)})>\\ze\\s*:/",
        "syn match koordSection /\\v<(fun|adt|contract)>\\ze\\s+\\w/",
        "syn match koordModifier /\\v<extern(\\s+fresh)?>|<at\\s+round>/",
        f"syn match koordBuiltin /\\v<({_any(vocabulary.FUNCTIONS)})>\\ze\\s*\\(/",
        f"syn match koordLibrary /\\v<({_any(library_names())})>\\ze\\s*\\(/",
        f"syn match koordSign /\\V{signs}/",
        "syn match koordNumber /\\v<\\d+(\\.\\d+)?([eE][+-]?\\d+)?>/",
        "syn match koordEvent /^\\h\\w*\\ze\\s*:/",
        'syn region koordString start=/"/ skip=/\\\\./ end=/"\\|$/',
        "syn match koordComment /\\(#\\|\\/\\/\\).*$/ contains=@Spell",
        "",
        *(
            f"hi def link {group} {to}"
            for group, to in (
                ("koordSection", "Structure"),
                ("koordStatement", "Statement"),
                ("koordOperator", "Operator"),
                ("koordBoolean", "Boolean"),
                ("koordName", "Identifier"),
                ("koordType", "Type"),
                ("koordModule", "Include"),
                ("koordModifier", "StorageClass"),
                ("koordBuiltin", "Function"),
                ("koordLibrary", "Function"),
                ("koordSign", "Operator"),
                ("koordNumber", "Number"),
                ("koordEvent", "Label"),
                ("koordString", "String"),
                ("koordComment", "Comment"),
            )
        ),
        "",
        "let b:current_syntax = 'koord'",
    ]
    return "\n".join(lines) + "\n"


def snippets() -> dict[str, object]:
    """The snippets for VS Code: the forms that the server offers as well."""
    made: dict[str, object] = {}
    for name, form in (*SECTION_FORMS.items(), *STATEMENT_FORMS.items()):
        known = WORDS.get(name.partition(" ")[0])
        made[name] = {
            "prefix": name.replace(" ", ""),
            "body": form.replace("    ", "\t").split("\n"),
            "description": known.meaning if known is not None else "an event",
        }
    return made


def files() -> dict[Path, str]:
    """What is generated, by the files that it is in."""

    def text(data: object) -> str:
        return json.dumps(data, indent=2, ensure_ascii=False) + "\n"

    return {
        FOLDER / "vscode/syntaxes/koord.tmLanguage.json": text(textmate()),
        FOLDER / "vscode/snippets/koord.json": text(snippets()),
        FOLDER / "vim/syntax/koord.vim": vim(),
    }


def outdated() -> list[Path]:
    """The files that are not as they would be made now."""
    return [
        path
        for path, text in files().items()
        if not path.is_file() or path.read_text(encoding="utf-8") != text
    ]


def main(arguments: list[str]) -> int:
    """Write what is not up to date, or tell it."""
    found = outdated()
    if "--check" in arguments:
        return 1 if found else 0
    made = files() if found else {}
    for path in found:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(made[path], encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
