"""Which files belong to a program: by its comment, or as the only one of its folder."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import pytest

from koord.api.program_files import ProgramFiles, is_of_properties, program_beside, program_files

PROGRAM = "local:\n  int x = 0\nStep:\n  eff: x = 1\n"
PROPERTIES = "# more\nparam int most = 3\ninvariant Few:\n  forall i: x@i <= most\n"


def files(path: Path, text: str | None = None, **opened: str) -> ProgramFiles:
    return program_files(
        path,
        path.read_text("utf-8") if text is None else text,
        lambda other: opened.get(other.stem),
    )


def names(found: ProgramFiles) -> tuple[str, ...]:
    return found.main.name, *(one.name for one in found.properties)


@pytest.mark.parametrize(
    ("text", "is_one"),
    [
        (PROPERTIES, True),
        (PROGRAM, False),
        (PROPERTIES + PROGRAM, False),
        ("def fun f(int a) -> int: a\nassume: x > 0\n", True),
        ("def fun f(int a) -> int: a\n", False),
        ("def adt Job:\n  int at\ninvariant A: true\n", False),
        ("invariant A: true\nnot yet wri", True),
        ("", False),
    ],
)
def test_texts_of_properties_are_told_from_programs(text: str, is_one: bool) -> None:
    assert is_of_properties(text) is is_one


def test_the_only_program_of_a_folder_has_its_properties(tmp_path: Path) -> None:
    for name, text in {"app.krd": PROGRAM, "b.krd": PROPERTIES, "a.krd": PROPERTIES}.items():
        (tmp_path / name).write_text(text, "utf-8")
    assert names(files(tmp_path / "app.krd")) == ("app.krd", "a.krd", "b.krd")
    assert names(files(tmp_path / "b.krd")) == ("app.krd", "a.krd", "b.krd")
    (tmp_path / "other.krd").write_text(PROGRAM, "utf-8")
    assert names(files(tmp_path / "app.krd")) == ("app.krd",)
    assert names(files(tmp_path / "b.krd")) == ("b.krd",)


def test_a_comment_says_which_files_and_params(tmp_path: Path) -> None:
    said = (
        "# koord verify: --robots 2 --with=more.krd --with gone.krd --set most=0.5 --set on=true\n"
    )
    (tmp_path / "app.krd").write_text(said + PROGRAM, "utf-8")
    (tmp_path / "other.krd").write_text(PROGRAM, "utf-8")
    (tmp_path / "more.krd").write_text(PROPERTIES, "utf-8")
    (tmp_path / "app_large.yaml").write_text("params: {most: 2}\n", "utf-8")
    for name in ("app.krd", "more.krd"):
        found = files(tmp_path / name)
        assert names(found) == ("app.krd", "more.krd")
        assert found.params == {"most": Fraction(1, 2), "on": True}
        assert [one.name for one in found.configurations] == ["app_large.yaml"]


def test_texts_that_are_open_count_and_not_what_is_saved(tmp_path: Path) -> None:
    (tmp_path / "app.krd").write_text(PROGRAM, "utf-8")
    (tmp_path / "more.krd").write_text(PROPERTIES, "utf-8")
    found = files(tmp_path / "app.krd", text=PROGRAM + "# new\n", more=PROPERTIES + "# newer\n")
    assert found.main.text.endswith("# new\n")
    assert found.properties[0].text.endswith("# newer\n")


def test_a_comment_that_is_half_written_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "app.krd"
    path.write_text(
        "# koord verify: --with 'more\n# koord verify: --set a=[1, --set c=1e999 --set b=[]\n",
        "utf-8",
    )
    found = files(path)
    assert (names(found), found.params) == (("app.krd",), {"b": ()})


def test_a_configuration_belongs_to_the_program_that_it_is_named_like(tmp_path: Path) -> None:
    """Of several to that with the longest name, and never to a file of properties."""
    for name, text in (("app", PROGRAM), ("app_two", PROGRAM), ("app_two_more", PROPERTIES)):
        (tmp_path / f"{name}.krd").write_text(text, "utf-8")

    def named(name: str) -> str | None:
        found = program_beside(tmp_path / name, lambda path: None)
        return None if found is None else found.name

    assert named("app.yaml") == named("app_large.yml") == "app.krd"
    assert named("app_two.yaml") == named("app_two_more.yaml") == "app_two.krd"
    assert named("other.yaml") is None
    opened = program_beside(tmp_path / "app.yaml", lambda path: PROGRAM + "# typed\n")
    assert opened is not None
    assert opened.text.endswith("# typed\n")
