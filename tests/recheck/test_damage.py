"""Whatever bytes a certificate consists of, it is rechecked or refused, never anything else."""

from __future__ import annotations

import json
from random import Random
from typing import Any

import pytest

from koord.recheck.certificate import read
from koord.recheck.checking import recheck
from koord.recheck.commands import NotACommandError, harmless
from koord.syntax.diagnostics import KoordError
from tests.recheck.certificates import Document, document_of

pytest.importorskip("cvc5")

VALUES: list[Any] = [
    None, True, -1, 0, 10**30, 1.5, "", "1/0", "é|\\", "x" * 500, [], [[]], {}, {"fraction": "1"},
    "koord certificate", "1e999", "\ud800", ["(assert"], "(check-sat)", "invariant X: true",
]  # fmt: skip


def _places(value: object, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """The way to every part of a document."""
    found = [path]
    if isinstance(value, dict):
        for name, part in value.items():
            found += _places(part, (*path, name))
    elif isinstance(value, list):
        for k, part in enumerate(value):
            found += _places(part, (*path, k))
    return found


def _damaged(document: Document, random: Random) -> object:
    """The document with one part gone, or something else in its place."""
    path = random.choice([p for p in _places(document) if p])
    parent: Any = document
    for step in path[:-1]:
        parent = parent[step]
    if random.random() < 0.3:
        del parent[path[-1]]
    else:
        parent[path[-1]] = random.choice(VALUES)
    return document


def _tried(raw: bytes) -> str:
    try:
        return recheck(read(raw, "damaged.json"), timeout_s=20).outcome.value
    except KoordError as error:
        codes = {d.code for d in error.diagnostics}
        return "refused" if codes <= {"K940", "K941"} else str(codes)


def test_damaged_parts_are_refused_or_rechecked() -> None:
    random = Random(1)
    said = [
        _tried(json.dumps(_damaged(document_of("hvac.krd", 1), random)).encode())
        for _ in range(150)
    ]
    assert said.count("refused") >= 75
    assert set(said) <= {"refused", "confirmed", "refuted", "unknown"}


def test_damaged_bytes_are_refused_or_rechecked() -> None:
    random = Random(2)
    raw = json.dumps(document_of("hvac.krd", 1)).encode()
    for _ in range(120):
        cut = bytearray(raw)
        for _ in range(random.randint(1, 4)):
            cut[random.randrange(len(cut))] = random.randrange(256)
        _tried(bytes(cut[: random.randint(1, len(cut))] if random.random() < 0.3 else cut))


@pytest.mark.parametrize(
    "raw", [b"", b"[]", b"\xff\xfe", b"[" * 100_000, b"null", b'{"format": "koord certificate"}']
)
def test_what_is_no_certificate_is_refused(raw: bytes) -> None:
    assert _tried(raw) == "refused"


@pytest.mark.parametrize(
    "script",
    [
        '(set-option :regular-output-channel "stolen")',
        '(set-option :diagnostic-output-channel "stolen")(check-sat)',
        "(get-model)",
        "(assert true) (reset)",
        "(",
        "))",
        '(assert (= "',
        "assert",
        "(include |x|)",
        "()",
    ],
)
def test_scripts_can_only_declare_and_assert(script: str) -> None:
    with pytest.raises(NotACommandError):
        harmless(script)


def test_a_script_is_passed_on_without_its_options() -> None:
    script = (
        "; a remark )\n(set-logic ALL)(set-info :status |un)sat|)\n(assert (not |)|))\n(check-sat)"
    )
    assert harmless(script) == "(assert (not |)|))\n(check-sat)"
