"""The kernel: its guide names what is there, and its rules never look into a scalar."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any, TypeVar

import pytest
from msgspec import Struct
from msgspec.structs import astuple

from koord.semantics.configurations import Configuration
from koord.semantics.domain import EXACT, Constant, Domain
from koord.semantics.oracle import NoInputs
from koord.semantics.properties import holds_in
from koord.semantics.rounds import enabled, evolved, initialised, run_event, run_skip
from koord.semantics.values import default
from koord.syntax import core
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System, dealt
from koord.syntax.types import INT, Type

V = TypeVar("V")

ROOT = Path(__file__).parents[2]
KERNEL = ROOT / "koord" / "semantics"
SPEC = ROOT / "specs" / "semantics"
GUIDE = (KERNEL / "README.md").read_text(encoding="utf-8")

#: Programs that leave nothing open but starts.
EXAMPLES = ("allstop", "leader_elect", "lineform", "shortest_path", "sum_of_ids")

DEFINITION = re.compile(r"\[`(\w+)\.(\w+)`\]\((\w+\.py)\)")
RULE = re.compile(r"\[([A-Z][A-Z0-9-]+)\]\(\.\./\.\./specs/semantics/([\w-]+\.md)\) \|$", re.M)
CHAPTER = re.compile(r"^\| \[(\d\d-[\w-]+)\]\(\S+\) \| (.*) \|$", re.M)


# --- the guide ------------------------------------------------------------------------------------


def test_every_key_definition_is_where_the_guide_says() -> None:
    found = DEFINITION.findall(GUIDE)
    assert len(found) > 15
    for module, name, file in found:
        assert file == f"{module}.py"
        tree = ast.parse((KERNEL / file).read_text(encoding="utf-8"))
        names = {getattr(node, "name", None) for node in tree.body}
        names |= {getattr(getattr(node, "target", None), "id", None) for node in tree.body}
        assert name in names, f"{file} has no {name}"


def test_every_key_definition_names_its_rule() -> None:
    rows = [line for line in GUIDE.splitlines() if DEFINITION.search(line)]
    for row in rows:
        (rule, chapter), *others = RULE.findall(row)
        assert not others
        assert f"### [{rule}] " in (SPEC / chapter).read_text(encoding="utf-8"), row


def test_every_chapter_has_its_files_and_every_file_its_chapter() -> None:
    rows = dict(CHAPTER.findall(GUIDE))
    assert sorted(rows) == sorted(path.stem for path in SPEC.glob("[0-9][0-9]-*.md"))
    named = [file for row in rows.values() for file in re.findall(r"`(\w+\.py)`", row)]
    assert {*named} == {path.name for path in KERNEL.glob("*.py")} - {"__init__.py"}
    for chapter, row in rows.items():
        first = chapter.partition("-")[2].replace("-", "_")
        # What is proved, and what is about texts, is not evaluated.
        assert row.startswith(f"`{first}.py`") or chapter in ("08-theorems", "11-old-forms")


# --- scalars that nobody may look into ------------------------------------------------------------


class Sealed:
    """A scalar that refuses every question that Python may ask of it."""

    def __init__(self, constant: Constant) -> None:
        self.sealed = constant

    def _refused(self, *_: object) -> bool:
        raise AssertionError("a rule looked into a scalar")

    __bool__ = __eq__ = __lt__ = __le__ = __gt__ = __ge__ = __hash__ = _refused


class Sealing:
    """The exact domain on sealed scalars."""

    def const(self, value: Constant, type_: Type) -> Sealed:
        return Sealed(EXACT.const(value, type_))

    def known(self, value: Sealed) -> Constant | None:
        return value.sealed

    def unary(self, op: UnaryOp, operand: Sealed) -> Sealed:
        return Sealed(EXACT.unary(op, operand.sealed))

    def binary(self, op: BinaryOp, left: Sealed, right: Sealed) -> Sealed:
        return Sealed(EXACT.binary(op, left.sealed, right.sealed))

    def ite(self, condition: Sealed, then: Sealed, other: Sealed) -> Sealed:
        return then if condition.sealed else other


class Defaults(NoInputs):
    """Every variable that starts anyhow starts with the default of its type."""

    def __init__(self, d: Domain[Any]) -> None:
        self.d = d

    def start(self, declaration: core.Declaration, robot: int | None) -> Any:
        return default(self.d, declaration.variable.type, 0)

    def sensor(self, robot: int, port: core.Port) -> Any:
        return default(self.d, port.declaration.variable.type, 0)


def opened(part: object) -> object:
    """The same with constants for sealed scalars, as plain tuples."""
    if isinstance(part, Sealed):
        return part.sealed
    if isinstance(part, tuple):
        return tuple(map(opened, part))
    return opened(astuple(part)) if isinstance(part, Struct) else part


def after_rounds(d: Domain[V], system: System, rounds: int) -> Configuration[V]:
    """The configuration after rounds in which every robot runs its first event that may run."""
    inputs = Defaults(d)
    at = initialised(d, system, inputs).configuration
    for _ in range(rounds):
        for robot in range(system.robots):
            able = enabled(d, system, at, robot, inputs)
            free = [p for p in able if not system.agent(robot).events[p].lock_classes & at.taken]
            if free:
                at = run_event(d, system, at, robot, free[0], inputs).configuration
            else:
                at = run_skip(d, system, at, robot, inputs).configuration
        at = evolved(d, system, at, inputs).configuration
        for stated in system.program.properties:
            holds_in(d, system, at, stated.condition, stated.bound, inputs)
    return at


@pytest.mark.parametrize(
    "name", ["allstop", "leader_elect", "lineform", "shortest_path", "sum_of_ids"]
)
def test_no_rule_looks_into_a_scalar(name: str) -> None:
    path = ROOT / "specs" / "examples" / f"{name}.krd"
    program = load(Source(path.name, path.read_text(encoding="utf-8"))).program
    assert program is not None
    system = dealt(program, 3)
    sealed: Configuration[Sealed] = after_rounds(Sealing(), system, 4)
    assert sealed.fault is None
    assert opened(sealed) == opened(after_rounds(EXACT, system, 4))


def test_a_sealed_scalar_refuses() -> None:
    one = Sealing().const(1, INT)
    for look in (bool, hash, lambda scalar: scalar == 1, lambda scalar: scalar < 1):
        with pytest.raises(AssertionError):
            look(one)
