"""Modules are found and read as Python does it: what was compiled counts if it is of the file."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.machinery import PathFinder, SourceFileLoader
from importlib.util import cache_from_source, module_from_spec
from pathlib import Path
from types import CodeType, ModuleType

import pytest

from koord.cli.module_files import Finder, look_here_first

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere Python looks for all")


def loaded(folder: Path, name: str) -> ModuleType:
    spec = Finder.find_spec(f"koord.{name}", [str(folder)])
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def compiled_by_python(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The modules that are left to Python, from now on."""
    names: list[str] = []
    by_python = SourceFileLoader.get_code

    def get_code(loader: SourceFileLoader, name: str) -> CodeType | None:
        names.append(name)
        return by_python(loader, name)

    monkeypatch.setattr(SourceFileLoader, "get_code", get_code)
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    return names


def test_what_was_compiled_is_read(tmp_path: Path, compiled_by_python: list[str]) -> None:
    file = tmp_path / "one.py"
    file.write_text("WHAT = 1\n")
    assert loaded(tmp_path, "one").WHAT == 1
    assert compiled_by_python == ["koord.one"]
    again = loaded(tmp_path, "one")
    assert again.WHAT == 1
    assert compiled_by_python == ["koord.one"]
    assert again.__file__ == str(file)
    assert again.__cached__ == cache_from_source(str(file))


@pytest.mark.parametrize("later_s", [0, 5])
def test_what_was_compiled_from_another_text_is_not(
    tmp_path: Path, compiled_by_python: list[str], later_s: int
) -> None:
    file = tmp_path / "one.py"
    file.write_text("WHAT = 1\n")
    loaded(tmp_path, "one")
    time = os.stat(file).st_mtime_ns + later_s * 10**9
    file.write_text("WHAT = 2\n" if later_s else "WHAT = 12\n")  # later, or longer
    os.utime(file, ns=(time, time))
    found = loaded(tmp_path, "one").WHAT
    assert found == (2 if later_s else 12)
    assert compiled_by_python == ["koord.one"] * 2


@pytest.mark.parametrize("length", [0, 7, 16, 30])
def test_what_is_cut_off_is_compiled_again(
    tmp_path: Path, compiled_by_python: list[str], length: int
) -> None:
    file = tmp_path / "one.py"
    file.write_text("WHAT = 1\n")
    loaded(tmp_path, "one")
    compiled = Path(cache_from_source(str(file)))
    compiled.write_bytes(compiled.read_bytes()[:length])
    if length < 16:
        assert loaded(tmp_path, "one").WHAT == 1
    else:  # Python compiles nothing again of which it knows the file
        with pytest.raises(EOFError):
            loaded(tmp_path, "one")
    assert compiled_by_python == ["koord.one"] * 2


def test_what_another_python_compiled_is_not_read(
    tmp_path: Path, compiled_by_python: list[str]
) -> None:
    file = tmp_path / "one.py"
    file.write_text("WHAT = 1\n")
    loaded(tmp_path, "one")
    compiled = Path(cache_from_source(str(file)))
    compiled.write_bytes(b"\0\0\r\n" + compiled.read_bytes()[4:])
    assert loaded(tmp_path, "one").WHAT == 1
    assert compiled_by_python == ["koord.one"] * 2


def test_what_was_compiled_elsewhere_has_the_name_of_its_file(
    tmp_path: Path, compiled_by_python: list[str]
) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "here/one.py").write_text("def one() -> int:\n    return 1\n")
    loaded(tmp_path / "here", "one")
    (tmp_path / "here").rename(tmp_path / "there")
    moved = loaded(tmp_path / "there", "one")
    assert moved.one.__code__.co_filename == str(tmp_path / "there/one.py")
    assert compiled_by_python == ["koord.one"] * 2


def test_packages_have_a_folder(tmp_path: Path) -> None:
    package = tmp_path / "pack"
    package.mkdir()
    assert Finder.find_spec("koord.pack", [str(tmp_path)]) is None  # there is nothing in it
    (package / "__init__.py").write_text("WHAT = 3\n")
    module = loaded(tmp_path, "pack")
    assert (module.WHAT, module.__path__) == (3, [str(package)])


@pytest.mark.parametrize(
    ("name", "folders"),
    [("koord.none", 1), ("other.one", 1), ("koord.one", 2), ("koord.one", None)],
)
def test_all_else_is_left_to_others(tmp_path: Path, name: str, folders: int | None) -> None:
    (tmp_path / "one.py").write_text("")
    path = None if folders is None else [str(tmp_path)] * folders
    assert Finder.find_spec(name, path) is None


def test_it_stands_before_python_and_behind_others(monkeypatch: pytest.MonkeyPatch) -> None:
    others = [one for one in sys.meta_path if one is not PathFinder]
    monkeypatch.setattr(sys, "meta_path", [*others, PathFinder])
    look_here_first()
    look_here_first()
    assert sys.meta_path == [*others, Finder, PathFinder]
    monkeypatch.setattr(sys, "meta_path", others)
    look_here_first()
    assert sys.meta_path == others


#: Tells at the end of a command which modules came so, of those that are named.
_TOLD = """
import atexit, sys
from koord.cli.start import entry

def tell():
    loaders = {name: type(module.__spec__.loader).__module__
        for name, module in list(sys.modules.items()) if getattr(module, "__spec__", None)}
    for name in ("koord.cli.main", "koord.syntax", "msgspec._utils", "argparse"):
        print(name, loaders[name] == "koord.cli.module_files")

atexit.register(tell)
entry()
"""


def test_commands_are_loaded_so() -> None:
    words = [sys.executable, "-c", _TOLD, "explain", "K204"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-4:] == [
        "koord.cli.main True",
        "koord.syntax True",
        "msgspec._utils True",
        "argparse False",
    ]
