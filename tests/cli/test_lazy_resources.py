"""What Z3 asks of ``importlib.resources`` loads nothing; whoever asks for more has all of it."""

from __future__ import annotations

import subprocess
import sys


def said(program: str) -> list[str]:
    """What a fresh interpreter prints that has put the module off."""
    start = "import sys; from koord.cli.lazy_resources import put_off; put_off()\n"
    done = subprocess.run(
        [sys.executable, "-c", start + program],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert done.stderr == ""
    return done.stdout.split()


def test_z3_finds_its_library_without_it() -> None:
    found = said(
        "import z3\n"
        "print(z3.simplify(z3.IntVal(2) + 3), 'importlib.resources._common' in sys.modules)"
    )
    assert found == ["5", "False"]


def test_others_have_all_of_it() -> None:
    found = said(
        "import importlib.resources as whole\n"
        "from importlib.resources import as_file, files\n"
        "from importlib.resources.abc import Traversable\n"
        "import z3\n"
        "prelude = files('koord.syntax').joinpath('prelude.krd')\n"
        "with as_file(prelude) as path: print(path.is_file())\n"
        "print(isinstance(prelude, Traversable), whole.files is files)\n"
        "print(whole.Package is sys.modules['importlib.resources'].Package)\n"
    )
    assert found == ["True", "True", "True", "True"]


def test_a_second_time_changes_nothing() -> None:
    found = said(
        "from importlib.resources import Package\n"
        "put_off()\n"
        "import importlib.resources\n"
        "print(importlib.resources.Package is Package, hasattr(importlib.resources, 'none'))\n"
    )
    assert found == ["True", "False"]


def test_msgspec_is_loaded_without_what_is_for_files() -> None:
    found = said(
        "from koord.cli.lazy_resources import load_msgspec\n"
        "load_msgspec()\n"
        "import msgspec\n"
        "from msgspec.json import decode\n"
        "print(*(name in sys.modules for name in ('textwrap', 'platform', 'typing_extensions')))\n"
        "print(msgspec.json.decode(msgspec.json.encode({'a': 1}))['a'])\n"
        "import msgspec.inspect\n"
        "print(msgspec.inspect.type_info(int).__class__.__name__)\n"
        "print(msgspec.json.schema(int)['type'], msgspec.json.schema(str)['type'])\n"
        "print(len(msgspec.json.schema_components([int, str])))\n"
        "import platform\n"
        "print(platform.python_version() == '.'.join(map(str, sys.version_info[:3])))"
    )
    assert found == ["False", "False", "False", "1", "IntType", "integer", "string", "2", "True"]


def test_argparse_is_loaded_without_translations() -> None:
    found = said(
        "print('gettext' in sys.modules)\n"
        "import argparse, gettext\n"
        "print(gettext.__spec__.name, argparse._('usage: '), argparse.ngettext('a', 'b', 2))\n"
    )
    assert found == ["False", "gettext", "usage:", "b"]


def test_what_is_written_in_c_is_the_same_afterwards() -> None:
    found = said(
        "from koord.cli.lazy_resources import load_msgspec\n"
        "load_msgspec()\n"
        "import msgspec\n"
        "print('datetime' in sys.modules, type(sys.modules['pickle']).__name__)\n"
        "from datetime import date\n"
        "print(msgspec.json.decode(b'\"2026-11-29\"', type=date) == date(2026, 11, 29))\n"
        "import pickle\n"
        "quick, text = pickle.Pickler, pickle.dumps([1])\n"
        "print(pickle.HIGHEST_PROTOCOL > 4, type(sys.modules['pickle']).__name__)\n"
        "import pickle\n"
        "print(pickle.Pickler is quick, pickle.loads(text) == [1], pickle._dumps([1]) == text)\n"
    )
    assert found == ["False", "LazyModule", "True", "True", "module", "True", "True", "True"]
