"""The documentation site: its pages are all there, and its links and anchors lead somewhere."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

import koord
from docs.generator import commands, configuration, diagnostics, formats, library, python_api
from docs.generator.markdown import anchors, fence, links, plain, slug
from docs.generator.site import ROOT, Site, dead_links, filled, generated, in_navigation, in_project
from koord.api.documents import DOCUMENTS
from koord.api.drivers import OWN, OWN_LOCALISERS
from koord.cli.main import COMMANDS
from koord.runtime.configuration import forms
from koord.syntax.catalogue import entries
from koord.syntax.elaboration.library import library_text


class _Loader(yaml.SafeLoader):
    """mkdocs.yml names functions of Python, which say nothing here."""


_LOADED = "tag:yaml.org,2002:python/object/apply:"
_Loader.add_multi_constructor(_LOADED, lambda loader, suffix, node: suffix)


def _navigation() -> list[str]:
    told = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"), _Loader)
    return in_navigation(filled(told["nav"]))


@pytest.fixture(scope="module")
def site() -> Site:
    return Site(in_project(_navigation()))


# --- links and navigation -------------------------------------------------------------------------


def test_links_and_anchors_lead_somewhere(site: Site) -> None:
    known = {place: anchors(text) for place, text in site.pages.items()}
    drawn = [path.relative_to(ROOT / "docs").as_posix() for path in ROOT.glob("docs/**/*.svg")]
    known |= {place: set[str]() for place in (*site.pictures, *drawn)}
    assert dead_links(site.pages, known) == []


def test_every_page_of_the_navigation_is_there_once(site: Site) -> None:
    listed = _navigation()
    assert len(listed) == len(set(listed))
    assert [place for place in listed if place not in site.pages] == []


def test_every_page_that_is_written_or_generated_is_in_the_navigation() -> None:
    """Name a new page in mkdocs.yml, where readers should come upon it."""
    written = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    assert sorted({*written, *generated()} - set(_navigation())) == []


def test_a_link_that_leads_nowhere_is_seen(tmp_path: Path) -> None:
    (tmp_path / "a.md").write_text("# A\n\n[b](b.md#there) [c](c.md) [d](b.md#here) [a](#a)\n")
    (tmp_path / "b.md").write_text("# B\n\n## There\n\n```sh\n## Here\n```\n")
    pages = {path.name: path.read_text() for path in tmp_path.glob("*.md")}
    known = {place: anchors(text) for place, text in pages.items()}
    assert dead_links(pages, known) == ["a.md: c.md", "a.md: b.md#here"]


def test_links_of_the_project_become_links_of_the_site(site: Site) -> None:
    text = (
        "[a](../specs/semantics/04-rounds.md#x), [b](../specs/examples/task.krd), "
        "[c](../koord/cli/main.py), `[d](../README.md)`, [e](https://example.org)\n"
    )
    assert site.linked("docs/a.md", text) == (
        "[a](specs/semantics/04-rounds.md#x), [b](specs/examples/task.krd.md), "
        "c, `[d](../README.md)`, [e](https://example.org)\n"
    )


def test_anchors_are_those_of_mkdocs_and_github() -> None:
    assert (
        slug("What a *verdict* means: `unknown`, vacuous") == "what-a-verdict-means-unknown-vacuous"
    )
    assert slug("How to add …") == "how-to-add-"
    assert anchors("# A b\n## A b\n### C {#own}\n") == {"a-b", "a-b_1", "own"}
    assert links("[`a](x)` b](y.md#z) ![p](q.png)\n```\n[no](no.md)\n```\n")[-1] == ("q.png", "")


# --- what is generated ----------------------------------------------------------------------------


def test_every_command_and_each_of_its_flags_has_its_place() -> None:
    made = commands.pages()
    for entry in COMMANDS:
        page = made[f"{commands.FOLDER}/{entry.name}.md"]
        assert f"[`koord {entry.name}`]({entry.name}.md)" in made[f"{commands.FOLDER}/index.md"]
        for action in commands.parser(entry)._actions:
            for name in action.option_strings:
                assert re.search(rf"^\|.*`{name}[` ]", page, re.MULTILINE), (entry.name, name)
    for code in ("| 0 |", "| 5 |", "| 143 |"):
        assert code in made[f"{commands.FOLDER}/index.md"]


def test_every_code_of_a_diagnostic_is_told_once() -> None:
    made = diagnostics.pages()
    index = made[f"{diagnostics.FOLDER}/index.md"]
    for story in entries().values():
        place = diagnostics.place(story)
        name, _, anchor = place.partition("#")
        page = made[f"{diagnostics.FOLDER}/{name}"]
        assert f"[{story.code}]({place})" in index
        assert anchor in anchors(page)
        assert story.story in page
        assert not story.bad or story.bad in page
    told = re.findall(r"^## (K\d{3}): ", "".join(made.values()), re.MULTILINE)
    assert sorted(told) == sorted(entries())


def test_everything_that_the_prelude_declares_is_in_the_library() -> None:
    prelude = library_text()
    page = library.pages()[library.PAGE]
    names = library.names(prelude)
    assert {"Task", "findPath", "Motion", "textOf"} <= set(names)
    assert [name for name in names if f"\n### {name}\n" not in page] == []
    shown = "".join(re.findall(r"^```koord\n(.*?)^```", page, re.MULTILINE | re.DOTALL))
    missing = [
        line for line in prelude.split("\n") if line[:1] not in ("", "#") and line not in shown
    ]
    assert missing == []


def _forms(form: Any, seen: dict[str, type[msgspec.Struct]]) -> None:
    """All structs that a form is made of."""
    for name in re.findall(r"forms\.(\w+)", str(form)):
        found = getattr(forms, name, None)
        if name not in seen and inspect.isclass(found) and issubclass(found, msgspec.Struct):
            seen[name] = found
            for field in msgspec.structs.fields(found):
                _forms(field.type, seen)


def test_every_field_of_a_configuration_is_told() -> None:
    page = configuration.pages()[configuration.PAGE]
    seen: dict[str, type[msgspec.Struct]] = {}
    _forms(forms.Form, seen)
    assert len(seen) >= 20
    for name, form in seen.items():
        (section,) = re.findall(rf"^## {name}\n(.*?)(?=^## |\Z)", page, re.M | re.S)
        for field in msgspec.structs.fields(form):
            assert f"| `{field.encode_name}` |" in section
    assert "rad, counter-clockwise from the x axis" in page


def test_every_option_of_a_driver_is_told() -> None:
    page = configuration.pages()[configuration.DRIVERS]
    for noun, targets in (
        ("Driver", OWN),
        ("Localiser", OWN_LOCALISERS),
    ):
        for name, target in targets.items():
            (section,) = re.findall(rf"^## {noun} {name}\n(.*?)(?=^## |\Z)", page, re.M | re.S)
            for field in msgspec.structs.fields(configuration.options(target)):
                assert f"| `{field.encode_name}` |" in section


def test_every_public_name_is_told_with_what_its_docstring_says() -> None:
    page = python_api.pages()[python_api.PAGE]
    for name in koord.__all__:
        if name != "__version__":
            assert page.count(f"\n### {name}\n") == 1
            assert inspect.getdoc(getattr(koord, name))
    assert "koord.verify(program: Loadable, *, robots: Robots = None, rounds: int = 20" in page
    assert "| `counterexample` | A run that breaks the claim" in page
    assert ":class:" not in page
    assert "``" not in page.replace("```", "")


def test_every_document_with_a_schema_is_told() -> None:
    made = formats.pages()
    assert set(DOCUMENTS) == {*formats.documents(), "configuration"}
    trace = made[f"{formats.FOLDER}/trace.md"]
    assert (
        "| `delta` | [Rational](#rational) | required | The length of a round, in seconds. |"
        in trace
    )


# --- pieces ---------------------------------------------------------------------------------------


def test_texts_are_shown_as_they_are() -> None:
    assert plain("a|b <c> `d|e` [f] g_h") == r"a\|b \<c\> `d|e` \[f\] g\_h"
    assert fence("koord", "x\n\n") == "```koord\nx\n```\n"


@pytest.mark.slow
def test_mkdocs_builds_the_site_strictly(tmp_path: Path) -> None:
    """Links, anchors and navigation, as mkdocs sees them; and nothing is loaded from elsewhere."""
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(tmp_path / "site"), strict=True)
    config.plugins.on_startup(command="build", dirty=False)
    build(config)
    built = {path.relative_to(tmp_path / "site").as_posix() for path in tmp_path.rglob("*.html")}
    assert {
        place.replace("README.md", "index.md")[:-3] + ".html" for place in Site().pages
    } <= built
    start = (tmp_path / "site" / "index.html").read_text(encoding="utf-8")
    assert re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=\"?https?:", start) == []
