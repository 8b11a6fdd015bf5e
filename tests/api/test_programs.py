from __future__ import annotations

import ast
import json
import re
from fractions import Fraction
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

import koord
from koord.cli.diagnostics import in_flags
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.syntax.literals import ParamValue

SMALL = """\
param int most = 4
param float step = 0.5
local:
  int x = 0
Up:
  pre: x < most and step > 0
  eff: x = x + 1
invariant Small: x <= most
"""


def test_a_program_is_loaded_from_a_file_and_from_a_text(tmp_path: Path) -> None:
    path = tmp_path / "counter.krd"
    path.write_text(SMALL)
    program = koord.load(path)
    assert program.name == str(path)
    assert koord.load(str(path)) == program
    assert koord.load(koord.Source("counter.krd", SMALL)).core.properties[0].name == "Small"
    assert "1 events, properties: Small, most = 4" in repr(program)


def test_the_values_of_params_are_exact() -> None:
    text = koord.Source("counter.krd", SMALL)
    program = koord.load(text, params={"most": 7, "step": 0.1})
    values: dict[str, ParamValue] = {each.name: each.value for each in program.core.parameters}
    assert values == {"most": 7, "step": Fraction(1, 10)}
    with pytest.raises(koord.ArgumentError, match="nan is not a number"):
        koord.load(text, params={"step": float("nan")})


def test_properties_come_from_files_of_their_own() -> None:
    more = koord.Source("more.krd", "invariant More: x >= 0\n")
    program = koord.load(koord.Source("counter.krd", SMALL), properties=[more])
    assert [stated.name for stated in program.core.properties] == ["Small", "More"]
    assert [source.name for source in program.sources] == ["counter.krd", "more.krd"]


def test_all_mistakes_are_told_at_once() -> None:
    text = koord.Source("wrong.krd", SMALL.replace("x + 1", "y + z"))
    with pytest.raises(koord.KoordError) as raised:
        koord.load(text)
    assert [d.code for d in raised.value.diagnostics] == ["K201", "K201"]
    report = koord.check(text)
    assert report.program is None
    assert report.errors == raised.value.diagnostics
    assert "<CheckReport wrong.krd: 2 errors, 0 warnings>" in repr(report)
    assert "K201" in report._repr_html_()
    schema = koord.schema("diagnostics")
    Draft202012Validator(schema).validate(json.loads(report.to_json()))


def test_warnings_can_be_errors() -> None:
    text = koord.Source("warned.krd", SMALL.replace("int x = 0", "int x = 0\n  int unused = 0"))
    report = koord.check(text)
    assert report.program is not None
    assert report.program.warnings == report.warnings != ()
    strict = koord.check(text, strict=True)
    assert strict.program is None
    assert len(strict.errors) == len(report.warnings)


def test_a_file_that_is_not_there_and_one_without_a_program() -> None:
    with pytest.raises(koord.KoordError, match="K901"):
        koord.load("nowhere.krd")
    with pytest.raises(koord.KoordError, match="K904"):
        koord.load(koord.Source("more.krd", "invariant More: true\n"))


def test_there_is_no_schema_of_anything_else() -> None:
    with pytest.raises(koord.ArgumentError, match="there is no schema of 'verdict'") as raised:
        koord.schema("verdict")
    assert raised.value.argument == "document"


def test_every_public_name_can_be_had_and_is_known_to_type_checkers() -> None:
    for name in koord.__all__:
        assert getattr(koord, name) is not None
    assert set(koord.__all__) <= set(dir(koord))
    tree = ast.parse(Path(koord.__file__).read_text(encoding="utf-8"))
    (typed,) = (node for node in tree.body if isinstance(node, ast.If))
    shown = {
        (found.module, alias.asname)
        for found in ast.walk(typed)
        if isinstance(found, ast.ImportFrom)
        for alias in found.names
    }
    assert shown == {(module, name) for module, names in koord._HOMES.items() for name in names}
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        koord.nothing  # noqa: B018


def test_messages_name_arguments_and_on_a_terminal_flags(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    only = tmp_path / "more.krd"
    only.write_text("invariant More: true\n")
    with pytest.raises(koord.KoordError, match="K904") as raised:
        koord.load(only)
    assert "this file behind `properties=`" in str(raised.value.diagnostics[0].hint)
    assert main(["verify", str(only)]) == Exit.BAD_INPUT
    assert "this file behind `--with`" in capsys.readouterr().err
    with pytest.raises(koord.KoordError, match=r"<params>:.*K236"):
        koord.load(koord.Source("counter.krd", SMALL), params={"mots": 3})
    with pytest.raises(koord.ArgumentError, match="leave out `engine=`"):
        koord.verify(koord.Source("counter.krd", SMALL), robots="any", engine="bits")


def test_nothing_that_is_raised_speaks_of_flags() -> None:
    """But for documents, comments that are read, and a command that makes a run again."""
    assert in_flags("`form='smt2'` or `engine=`, not `x='y'`") == (
        "`--export smt2` or `--engine`, not `x='y'`"
    )
    for path in sorted(Path(koord.__path__[0], "api").glob("*.py")):
        if path.stem in (
            "forms",
            "run_forms",
            "verdict_forms",
            "documents",
            "program_files",
            "configuration_texts",
            "refinement",
            "command_lines",
            "remote",
        ):
            continue
        if path.stem.startswith("remote"):  # the command there is given flags
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        statements = [node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)]
        constants = [node for node in ast.walk(tree) if isinstance(node, ast.Constant)]
        said = [str(node.value) for node in constants if node not in statements]
        assert [text for text in said if re.search(r"--[a-z]", text)] == [], path
