"""Whatever bytes a certificate consists of, it is rechecked or refused, never anything else."""

from __future__ import annotations

import json
from collections.abc import Callable
from random import Random
from typing import Any

import pytest

from koord.recheck import checking
from koord.recheck.certificate import read
from koord.recheck.checking import RecheckOutcome, recheck
from koord.recheck.script import NotACommandError, SanitisedScript, harmless
from koord.recheck.solving import SolverAnswer
from koord.syntax.diagnostics import KoordError
from koord.verify.certificates import digest
from tests.recheck.certificates import Document, document_of, rechecked
from tests.sampling import first, sampled

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


@pytest.mark.parametrize("count", sampled(15, [150]))
def test_damaged_parts_are_refused_or_rechecked(count: int) -> None:
    random = Random(1)
    said = [
        _tried(json.dumps(_damaged(document_of("hvac.krd", 1), random)).encode())
        for _ in range(count)
    ]
    assert said.count("refused") >= count // 2
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


#: What a forger may put in place of a script or around it, and what is said of it.
TAMPERED: dict[str, tuple[Callable[[str], str], str]] = {
    "empty": (lambda script: "", "it asserts nothing"),
    "blank": (lambda script: " \n; nothing\n", "it asserts nothing"),
    "only a question": (lambda script: "(check-sat)", "it asserts nothing"),
    "no question": (lambda script: script.replace("(check-sat)", ""), "it asks nothing"),
    "two questions": (lambda script: script + "(check-sat)", "comes after its question"),
    "asked too early": (lambda script: "(check-sat)" + script, "comes after its question"),
    "truncated": (lambda script: script[: len(script) // 2], "is not closed"),
    "cut in a name": (lambda script: script + "(assert |x", "a quotation in it does not end"),
    "closed too often": (lambda script: script + ")", "closes nothing"),
    "prose": (lambda script: f"proved, trust me {script}", "in no command"),
    "no such logic": (lambda script: f"(set-logic NONSENSE)\n{script}", "cannot parse logic"),
    "a poorer logic": (lambda script: f"(set-logic QF_LIA)\n{script}", "not declared as a type"),
    "logic in the middle": (lambda script: "(assert true)(set-logic ALL)", "not to be run"),
    "exit first": (lambda script: f"(exit)\n{script}", "something comes after its exit"),
    "says sat": (lambda script: f"(set-info :status sat)\n{script}", "says of itself"),
    "declared twice": (lambda script: _TWICE + script, "it declares twice twice"),
    "twice as written": (lambda script: _QUOTED + script, "it declares twice twice"),
    "undeclared": (lambda script: f"(assert (less 1 2))\n{script}", "'less' not declared"),
    "wrong type": (lambda script: f"(assert (+ 1 true))\n{script}", "arithmetic"),
    "options": (lambda script: f"(set-option :produce-models true){script}", "not to be run"),
    "taken back": (lambda script: script.replace("(check", "(reset)(check"), "not to be run"),
    "binary": (lambda script: f"\x00\x7f{script}", "it is not text"),
    "half a character": (lambda script: f"; \ud800\n{script}", "it is not text"),
}  # fmt: skip

_TWICE = "(declare-const twice Int)(declare-const twice Real)"
_QUOTED = "(declare-const twice Int)(declare-const |twice| Real)"


def tampered(change: Callable[[str], str], which: int = 2) -> Document:
    """A certificate with a script that was changed, by somebody who knows of its digest."""
    document = document_of("hvac.krd", 1)
    script = document["obligations"][which]
    script["smt2"] = change(script["smt2"])
    script["sha256"] = digest(script["smt2"])
    return document


@pytest.mark.parametrize("kind", first(8, TAMPERED))
def test_scripts_that_are_none_are_named(kind: str) -> None:
    change, story = TAMPERED[kind]
    with pytest.raises(KoordError) as found:
        rechecked(tampered(change))
    (problem,) = found.value.diagnostics
    assert problem.code == "K941"
    named = "the script 'consecution of the program turns' cannot be read: "
    assert problem.message.startswith(named)
    assert story in problem.message


def test_each_script_that_is_none_is_named() -> None:
    document = tampered(lambda script: "", 1)
    document["obligations"][3] |= {"smt2": "(", "sha256": digest("(")}
    with pytest.raises(KoordError) as found:
        rechecked(document)
    first, second = found.value.diagnostics
    assert "'consecution inside a round' cannot be read" in first.message
    assert "consecution of the environment's turn" in second.message


def test_a_script_that_was_changed_is_refused_by_its_digest() -> None:
    document = document_of("hvac.krd", 1)
    document["obligations"][0]["smt2"] += "(assert false)"
    with pytest.raises(
        KoordError, match=r"obligations\[0\]\.smt2 is not the text that was certified"
    ):
        rechecked(document)


def test_two_scripts_of_one_name_are_refused() -> None:
    document = document_of("hvac.krd", 1)
    document["obligations"].append(document["obligations"][0])
    with pytest.raises(KoordError, match="two obligations 'initiation'"):
        rechecked(document)


def test_a_script_that_can_be_satisfied_refutes() -> None:
    found = rechecked(tampered(lambda script: "(declare-const x Int)(assert (< 0 x))(check-sat)"))
    assert found.outcome is RecheckOutcome.REFUTED
    assert "can be satisfied" in found.reason


def test_a_script_that_is_too_deep_for_the_solver_is_not_agreed_with() -> None:
    """It makes cvc5 crash where its stack is not endless."""
    deep = 100_000
    nested = f"(assert {'(not ' * deep}true{')' * deep})(check-sat)"
    found = rechecked(tampered(lambda script: nested))
    assert found.outcome is not RecheckOutcome.CONFIRMED
    assert "consecution of the program turns" in found.reason


def test_scripts_that_are_too_hard_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checking, "SECOND_OPINION_S", 0.0)
    found = rechecked(document_of("hvac.krd", 1))
    assert found.outcome is RecheckOutcome.UNKNOWN
    assert (
        found.reason == "the script 'initiation' in the certificate: there was no time left to ask"
    )
    assert [opinion.answer for opinion in found.opinions] == [SolverAnswer.UNKNOWN] * 4


def test_a_script_is_passed_on_without_its_options() -> None:
    script = "; a remark )\n(set-logic ALL)(set-info :status |un)sat|)\n(assert (not |)|))\n"
    script += "(check-sat)\n(exit)"
    assert harmless(script) == SanitisedScript("(set-logic ALL)", ("(assert (not |)|))",))


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
