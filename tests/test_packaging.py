"""What is given away is whole: wheel, sdist, conda recipe, image and development container."""

from __future__ import annotations

import json
import re
import tarfile
import tomllib
import zipfile
from configparser import ConfigParser
from pathlib import Path
from typing import Any

import pytest
import yaml

import koord

builders = pytest.importorskip("hatchling.builders.wheel")

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
RECIPE = yaml.safe_load((ROOT / "packaging/conda/recipe.yaml").read_text(encoding="utf-8"))
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")

#: Files of this folder that nobody needs who has an sdist: they are of the repository.
OF_THE_REPOSITORY = {".gitignore", ".pre-commit-config.yaml"}


def of_the_package() -> set[str]:
    """All files of the package, from the root."""
    files = (path for path in (ROOT / "koord").rglob("*") if path.is_file())
    return {path.relative_to(ROOT).as_posix() for path in files if "__pycache__" not in path.parts}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """The wheel, as it is built of this tree."""
    folder = tmp_path_factory.mktemp("wheel")
    builder = builders.WheelBuilder(str(ROOT))
    (made,) = builder.build(directory=str(folder), versions=["standard"])
    return zipfile.ZipFile(made)


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """The files of the sdist, from its folder."""
    from hatchling.builders.sdist import SdistBuilder

    folder = tmp_path_factory.mktemp("sdist")
    (made,) = SdistBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"])
    with tarfile.open(made) as archive:
        return {name.partition("/")[2] for name in archive.getnames()}


def test_the_wheel_has_every_file_of_the_package(wheel: zipfile.ZipFile) -> None:
    """Grammar, prelude, stories, schemas, pages and templates are no Python."""
    names = {name for name in wheel.namelist() if not name.startswith("koord-")}
    assert names == of_the_package()
    endings = {Path(name).suffix for name in names}
    assert {".py", ".typed", ".lark", ".krd", ".md", ".json", ".js", ".txt"} <= endings


def test_the_wheel_says_what_it_has(wheel: zipfile.ZipFile) -> None:
    (name,) = (name for name in wheel.namelist() if name.endswith("/entry_points.txt"))
    found = ConfigParser()
    found.read_string(wheel.read(name).decode())
    assert dict(found["console_scripts"]) == {"koord": "koord.cli.start:entry"}
    assert dict(found["pytest11"]) == {"koord": "koord.plugins.pytest_plugin"}
    metadata = wheel.read(name.replace("entry_points.txt", "METADATA")).decode()
    assert f"\nVersion: {koord.__version__}\n" in metadata
    assert "\nLicense-File: LICENSE\n" in metadata


def test_the_sdist_is_enough_to_build_and_to_test(sdist: set[str]) -> None:
    assert of_the_package() <= sdist
    beside = {path.name for path in ROOT.iterdir() if path.is_file()} - OF_THE_REPOSITORY
    # What tools leave lying about here is not given away.
    assert {name for name in sdist if "/" not in name} - {"PKG-INFO", ".gitignore"} <= beside
    for name in ("action.yml", ".pre-commit-hooks.yaml", "Dockerfile", "Makefile", "uv.lock"):
        assert name in sdist
    for folder in ("tests", "specs", "benchmarks", "docs", "packaging", ".ci"):
        assert any(name.startswith(f"{folder}/") for name in sdist), folder


def test_twine_finds_nothing_wrong(
    tmp_path: Path, wheel: zipfile.ZipFile, capsys: pytest.CaptureFixture[str]
) -> None:
    check = pytest.importorskip("twine.commands.check").check
    assert wheel.filename is not None
    assert check([wheel.filename], strict=True) is False, capsys.readouterr().out


def test_classifiers_say_which_pythons_there_are() -> None:
    minor = [
        int(found[1])
        for one in PROJECT["classifiers"]
        if (found := re.fullmatch(r"Programming Language :: Python :: 3\.(\d+)", one))
    ]
    assert PROJECT["requires-python"] == f">=3.{min(minor)}"
    assert minor == list(range(min(minor), max(minor) + 1))


def test_the_recipe_of_conda_is_of_this_version() -> None:
    assert RECIPE["context"]["version"] == koord.__version__
    assert PROJECT["requires-python"] == f">={RECIPE['context']['python_min']}"
    needed = RECIPE["requirements"]["run"][1:]
    assert needed == [one.replace(">=", " >=") for one in PROJECT["dependencies"]]
    (script,) = RECIPE["build"]["python"]["entry_points"]
    assert script == f"koord = {PROJECT['scripts']['koord']}"
    assert RECIPE["about"]["summary"] == PROJECT["description"]
    assert RECIPE["about"]["license"] == PROJECT["license"]


def test_rattler_build_reads_the_recipe() -> None:
    rattler: Any = pytest.importorskip("rattler_build")
    (made,) = rattler.Stage0Recipe.from_file(str(ROOT / "packaging/conda/recipe.yaml")).render()
    assert made.recipe().package.name == "koord"


def test_the_image_copies_what_building_needs() -> None:
    """And the context lets it through."""
    copied = {
        word
        for line in re.findall(r"^COPY (?!--from)(.*) \S+$", DOCKERFILE, re.MULTILINE)
        for word in line.split()
    }
    needed = {"pyproject.toml", PROJECT["readme"], *PROJECT["license-files"], "koord"}
    assert copied == needed
    allowed = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert {line[1:] for line in allowed if line.startswith("!")} == needed


def test_the_image_has_extras_that_there_are() -> None:
    (extras,) = re.findall(r"^ARG EXTRAS=(.*)$", DOCKERFILE, re.MULTILINE)
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])


def test_the_development_container_installs_what_tests_need() -> None:
    path = ROOT / ".devcontainer" / "devcontainer.json"
    container = json.loads(path.read_text(encoding="utf-8"))
    assert container["postCreateCommand"].endswith("make .venv/.installed")
    assert "INSTALLED := $(VENV)/.installed" in (ROOT / "Makefile").read_text(encoding="utf-8")
