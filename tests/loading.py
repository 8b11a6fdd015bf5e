"""Texts of programs, and examples, as core programs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import dedent

from koord.syntax import core
from koord.syntax.elaboration.settings import ParamValue, Settings
from koord.syntax.load import load
from koord.syntax.source import Source

EXAMPLES = Path(__file__).parents[1] / "specs" / "examples"

#: Many small programs of one kind, which have tests of their own (tests/verify/test_protocols.py).
PROTOCOLS = EXAMPLES / "protocols"


def example_files() -> list[Path]:
    """The programs below ``specs/examples``, in order, without the protocols."""
    return sorted(path for path in EXAMPLES.rglob("*.krd") if PROTOCOLS not in path.parents)


def protocol_text(name: str) -> str:
    """The text of a protocol, by its name without its ending."""
    return (PROTOCOLS / f"{name}.krd").read_text("utf-8")


def program_of(text: str, **params: ParamValue) -> core.Program:
    """The core program of a text without mistakes, which may stand farther to the right."""
    return _loaded(Source("test.krd", dedent(text)), params)


def example_program(name: str) -> core.Program:
    """The core program of an example, by its path below ``specs/examples`` without its ending."""
    path = EXAMPLES / f"{name}.krd"
    return _loaded(Source(path.name, path.read_text("utf-8")), {})


def _loaded(source: Source, params: Mapping[str, ParamValue]) -> core.Program:
    loaded = load(source, Settings(params))
    assert loaded.program is not None, [str(d.message) for d in loaded.diagnostics]
    return loaded.program
