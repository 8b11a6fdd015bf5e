"""Machine code that is kept from run to run: it is that of the same module, or none."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from hashlib import sha256
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
from msgspec import Struct

pytest.importorskip("llvmlite")

import koord
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.machine import kept as keeping
from koord.machine.code import I64, Code, Ir, Loaded, new_module, word
from koord.machine.kept import (
    Shared,
    find,
    is_kept,
    keep,
    kept,
    key_of,
    machine_store,
    newly_kept,
)
from koord.machine.processor import abilities
from koord.runtime.compile.machine.kept_turns import kept_turns, key_of_turns
from koord.runtime.compile.machine.lazy import LazyTurns
from koord.runtime.compile.watching import watched
from koord.runtime.motion.bodies import Car
from koord.stores.folder import FolderStore
from koord.syntax.core import Program
from tests.runtime.column_twins import program_of
from tests.runtime.test_claims_by_code import CLAIMS, HOLDING

pytestmark = pytest.mark.skipif(
    not abilities() or keeping._linker() is None, reason="code is kept on Linux, with a linker"
)

LINES = """\
using Motion:
    sensors:
        pos psn
        bool reached
    actuators:
        pos target

local:
    int visited = 0

init:
    Motion.target = Motion.psn

Next:
    pre: Motion.reached
    eff:
        visited = visited + 1
        Motion.target = pos(1.0 * visited, 0.0, 1.0)

invariant Few: visited <= 50
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FolderStore:
    monkeypatch.setenv("KOORD_CACHE", str(tmp_path / "kept"))
    newly_kept()
    found = machine_store()
    assert found is not None
    return found


def tripling(times: int = 3) -> Ir:
    """A module with a function that multiplies."""
    code = Code(new_module("tripling"), "times", [I64], I64)
    code.b.ret(code.b.mul(code.arguments[0], word(times)))
    return code.function.module


def refused() -> NoReturn:
    raise AssertionError("this is made anew")


def test_code_is_made_once(folder: FolderStore, monkeypatch: pytest.MonkeyPatch) -> None:
    assert kept("tripling", (3,), tripling).function("times", 1)(14) == 42
    assert newly_kept() == folder.path
    assert folder.use().entries == 1
    found = kept("tripling", (3,), refused)
    assert isinstance(found, Shared)
    assert found.function("times", 1)(-5) == -15
    assert newly_kept() == ""
    assert folder.clear().entries == 1
    assert not Path(folder.path).exists()


def test_code_of_other_values_is_other_code(folder: FolderStore) -> None:
    one = kept("tripling", (3,), lambda: tripling(3)).function("times", 1)
    other = kept("tripling", (4,), lambda: tripling(4)).function("times", 1)
    assert (one(10), other(10)) == (30, 40)


class _Foreign(Struct, frozen=True):
    number: int


def test_no_two_values_have_one_key(monkeypatch: pytest.MonkeyPatch) -> None:
    array = np.arange(6.0)
    values = [
        *((1,), (1.0,), (True,), ("1",), (b"1",), ((1,),), (1, 1), ("11",), ("1", "1"), (None,)),
        *((array,), (array.reshape(2, 3),), (array.astype(np.float32),), (array + 1e-15,), ()),
        *((Car(),), (Car(mass_kg=3.6),), (((),),), ((), ()), ("",), (-0.0,), (0.0,)),
    ]
    keys = [key_of(*value) for value in values]
    assert len({*keys}) == len(keys)
    assert None not in keys
    assert key_of(_Foreign(1)) is None  # whose methods are in no file of koord
    with pytest.raises(TypeError):
        key_of(object())
    key = key_of(1)
    monkeypatch.setattr(keeping, "_surroundings", lambda: sha256(b"another processor"))
    assert key_of(1) != key
    monkeypatch.setattr(keeping, "processor", dict)
    assert key_of(1) is None


def test_what_koord_is_made_of_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    keeping._surroundings.cache_clear()
    key = key_of(1)
    monkeypatch.setattr(keeping, "_files", lambda: [("machine/lanes.py", 1, 1)])
    keeping._surroundings.cache_clear()
    assert key_of(1) != key
    monkeypatch.undo()
    keeping._surroundings.cache_clear()
    assert key_of(1) == key


def test_files_are_told_apart_by_when_they_were_changed() -> None:
    files = {path: (size, changed) for path, size, changed in keeping._files()}
    place = Path(koord.__file__).parent
    for name in ("machine/lanes.py", "sim/squad_kernel.py", "runtime/compile/machine/body.py"):
        told = (place / name).stat()
        assert files[name] == (told.st_size, told.st_mtime_ns)


def _damaged(path: Path) -> None:
    raw = bytearray(path.read_bytes())
    raw[-100] ^= 1
    path.write_bytes(raw)


def _moved(path: Path) -> None:
    key = key_of("tripling", 4)
    assert key is not None
    place = path.parents[1] / key[:2] / f"{key[2:]}.code"
    place.parent.mkdir(mode=0o700)
    path.rename(place)


@pytest.mark.parametrize(
    "spoil",
    [
        _damaged,
        _moved,
        lambda path: path.chmod(0o622),
        lambda path: path.parent.chmod(0o777),
        lambda path: path.parents[1].chmod(0o777),
        lambda path: path.write_bytes(b""),
    ],
)
def test_what_may_be_somebody_elses_is_never_loaded(
    folder: FolderStore, spoil: Callable[[Path], None]
) -> None:
    keep(key := key_of("tripling", 3), tripling())
    (file,) = Path(folder.path).rglob("*.code")
    assert find(key) is not None
    spoil(file)
    assert find(key) is None
    assert find(key_of("tripling", 4)) is None
    Path(folder.path).chmod(0o700)


def test_links_are_not_followed(folder: FolderStore, tmp_path: Path) -> None:
    keep(key := key_of("tripling", 3), tripling())
    (file,) = Path(folder.path).rglob("*.code")
    elsewhere = file.rename(tmp_path / "elsewhere")
    file.symlink_to(elsewhere)
    assert find(key) is None


@pytest.mark.parametrize("why", ["off", "linker", "read-only"])
def test_what_cannot_be_kept_runs_all_the_same(
    folder: FolderStore, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    match why:
        case "off":
            monkeypatch.setenv("KOORD_CACHE", "off")
        case "linker":
            monkeypatch.setattr(keeping, "_linker", lambda: None)
        case _:
            monkeypatch.setattr(FolderStore, "put", lambda *_: False)
    code = keep(key_of("tripling", 3), tripling())
    assert code.function("times", 1)(14) == 42
    assert isinstance(code, Loaded) == (why != "read-only")
    assert not Path(folder.path).exists()
    assert newly_kept() == ""


# --- programs -------------------------------------------------------------------------------------


def made(text: str) -> tuple[Program, LazyTurns]:
    program = program_of(text)
    return program, LazyTurns(program, watched(program, Fraction(0)))


def test_turns_are_kept_with_what_is_to_be_known_of_them(
    folder: FolderStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, first = made(HOLDING + CLAIMS)
    assert first.worth_turns > 1_000
    fresh = first()
    assert fresh is not None
    monkeypatch.setattr("koord.runtime.compile.machine.turns.turns_of", refused)
    _, again = made("\n\n" + HOLDING + CLAIMS)  # places do not count
    assert again.worth_turns < 1_000
    found = again()
    assert found is not None
    assert found.layout.rows == fresh.layout.rows
    assert found.layout.cells == fresh.layout.cells
    assert [*found.layout.columns] == [*fresh.layout.columns]
    for one, other in zip(
        found.layout.columns.values(), fresh.layout.columns.values(), strict=True
    ):
        parts = ((c.name, c.home, c.kind, c.first, c.leaves, c.type) for c in (one, other))
        assert len({*parts}) == 1
    assert {*found.claims} == {*fresh.claims}
    assert found.claims
    for kind, other_kind in zip(found.kinds, fresh.kinds, strict=True):
        assert (kind is None) == (other_kind is None)
        if kind is not None and other_kind is not None:
            assert (kind.urgent, kind.without) == (other_kind.urgent, other_kind.without)
            assert [e and e.words for e in kind.effects] == [
                e and e.words for e in other_kind.effects
            ]


def test_turns_of_other_claims_are_made_anew(folder: FolderStore) -> None:
    program = program_of(HOLDING + CLAIMS)
    LazyTurns(program, watched(program, Fraction(0)))()
    assert is_kept(key_of_turns(program, watched(program, Fraction(0))))
    assert not is_kept(key_of_turns(program, watched(program, Fraction(1, 100))))
    assert not is_kept(key_of_turns(program, None))
    other = program_of((HOLDING + CLAIMS).replace("k@i > 2", "k@i > 3"))
    looked = watched(other, Fraction(0))
    assert kept_turns(other, looked, key_of_turns(other, looked)) is None


FLEET = """\
devices:
    drone: {bot_type: QUAD, planner: RRT_DRONE}
    car: {bot_type: CAR, planner: RRT_CAR}
agents:
""" + "".join(
    f"    - {{pid: {pid}, on_device: {kind}, position: [0, {6 * pid}, {height}]}}\n"
    for pid, (kind, height) in enumerate([("drone", 1), ("car", 0)] * 6)
)


def run() -> list[str]:
    """A run in a process of its own: its digest, its events, and whether LLVM was there.

    Who runs first makes code, and the others load it.
    """
    text = (
        "import sys, koord\n"
        f"source = koord.Source('line.krd', {LINES!r})\n"
        f"fleet = koord.Source('fleet.yaml', {FLEET!r})\n"
        "made = koord.simulate(source, fleet, rounds=60)\n"
        "print(made.figures.digest, len(made.broken), 'llvmlite.binding' in sys.modules,"
        " made.kept_code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, check=True, timeout=300
    )
    return done.stdout.split()


def test_runs_with_kept_code_are_those_without(
    folder: FolderStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Which is made with LLVM's passes, and else without."""
    first, again = run(), run()
    monkeypatch.setenv("KOORD_CACHE", "off")
    without = run()
    assert first[:2] == again[:2] == without[:2]
    assert first[2:] == ["True", folder.path]
    assert again[2:] == ["False"]
    assert without[2:] == ["True"]


def test_users_are_told_of_it_and_can_be_rid_of_it(
    folder: FolderStore, capsys: pytest.CaptureFixture[str]
) -> None:
    keep(key_of("tripling", 3), tripling())
    assert main(["cache"]) == Exit.OK
    assert "machine code: 1 file, 0.0 MiB" in capsys.readouterr().out
    assert main(["cache", "--clear"]) == Exit.OK
    assert "machine code: removed 1 file" in capsys.readouterr().out
    assert main(["cache"]) == Exit.OK
    assert "machine code" not in capsys.readouterr().out


def test_the_run_that_made_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "line.krd"
    program.write_text(LINES)
    asked = ["sim", str(program), "--robots", "2", "--rounds", "2", "--no-html"]
    news = ["/somewhere/machine", ""]
    monkeypatch.setattr("koord.api.sim_report.newly_kept", lambda: news.pop(0))
    main(asked)
    assert "is kept in /somewhere/machine: the next run starts sooner" in capsys.readouterr().err
    main(asked)
    assert "machine code" not in capsys.readouterr().err
