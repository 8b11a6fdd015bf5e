from __future__ import annotations

import io
import os
import stat
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from koord.api import files
from koord.api.files import write_atomically
from koord.cli.files import check_writable, read_program
from koord.syntax.diagnostics import Diagnostic, KoordError
from koord.syntax.source import is_whole_file

IS_ROOT = hasattr(os, "geteuid") and os.geteuid() == 0


def refusal(error: pytest.ExceptionInfo[KoordError]) -> Diagnostic:
    (diagnostic,) = error.value.diagnostics
    return diagnostic


def test_a_program_is_read_with_its_bytes(tmp_path: Path) -> None:
    path = tmp_path / "a.krd"
    path.write_bytes(b"\xef\xbb\xbflocal:\r\n  int x\r\n")
    read = read_program(str(path))
    assert read.source.text == "local:\n  int x\n"
    assert read.raw.startswith(b"\xef\xbb\xbf")


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("none.krd", "there is no such file"),
        ("folder", "it is a folder; name the files in it"),
        ("a.krd/b.krd", "not a directory"),
        ("nul\0.krd", "embedded null"),
    ],
)
def test_a_file_that_cannot_be_read(tmp_path: Path, name: str, reason: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.krd").touch()
    with pytest.raises(KoordError) as error:
        read_program(f"{tmp_path}/{name}")
    assert refusal(error).code == "K901"
    assert reason in refusal(error).message
    assert is_whole_file(refusal(error).span)


@pytest.mark.skipif(IS_ROOT, reason="root may read everything")
def test_a_file_that_may_not_be_read(tmp_path: Path) -> None:
    path = tmp_path / "a.krd"
    path.touch(0o200)
    with pytest.raises(KoordError) as error:
        read_program(str(path))
    assert refusal(error).message == "cannot be read: permission denied"


def test_the_first_byte_that_is_not_utf8_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.krd"
    path.write_bytes("local:\r\n  ≤ ".encode() + b"\xe4 int\n")
    with pytest.raises(KoordError) as error:
        read_program(str(path))
    found = refusal(error)
    assert found.code == "K902"
    assert "0xe4" in found.message
    assert (found.span.line, found.span.column) == (2, 5)


def test_a_file_without_an_end_is_not_read_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "LARGEST_FILE", 1000)
    path = tmp_path / "a.krd"
    path.write_bytes(b"x" * 1000)
    assert len(read_program(str(path)).raw) == 1000
    path.write_bytes(b"x" * 1001)
    with pytest.raises(KoordError) as error:
        read_program(str(path))
    assert "larger than" in refusal(error).message


def test_standard_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(b"x\r\n")))
    read = read_program("-")
    assert (read.source.name, read.source.text) == ("<stdin>", "x\n")
    monkeypatch.setattr(sys, "stdin", None)
    with pytest.raises(KoordError) as error:
        read_program("-")
    assert "closed" in refusal(error).message


def test_writing_keeps_the_mode_and_leaves_nothing_behind(tmp_path: Path) -> None:
    path = tmp_path / "a.krd"
    path.write_bytes(b"old")
    path.chmod(0o640)
    write_atomically(str(path), b"new")
    assert path.read_bytes() == b"new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert [p.name for p in tmp_path.iterdir()] == ["a.krd"]


def test_a_new_file_has_the_usual_mode(tmp_path: Path) -> None:
    previous = os.umask(0o027)
    try:
        write_atomically(str(tmp_path / "a"), b"new")
    finally:
        os.umask(previous)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o640


def test_a_link_goes_on_pointing_to_its_file(tmp_path: Path) -> None:
    target = tmp_path / "real.krd"
    target.write_bytes(b"old")
    link = tmp_path / "link.krd"
    link.symlink_to("real.krd")
    write_atomically(str(link), b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"


def test_a_crash_while_writing_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.krd"
    path.write_bytes(b"old")

    def interrupted(descriptor: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(str(path), b"new")
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.krd"]


@pytest.mark.parametrize(
    ("name", "reason"), [("folder", "it is a folder"), ("none/a.json", "there is no folder")]
)
def test_an_output_is_tried_before_the_work(tmp_path: Path, name: str, reason: str) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(KoordError) as error:
        check_writable(str(tmp_path / name))
    assert refusal(error).code == "K903"
    assert reason in refusal(error).message
    with pytest.raises(KoordError):
        write_atomically(str(tmp_path / name), b"x")


def test_what_is_read_is_not_written_over(tmp_path: Path) -> None:
    path, link = tmp_path / "a.krd", tmp_path / "b.krd"
    path.write_text("")
    link.symlink_to(path)
    for name in (path, link):
        with pytest.raises(KoordError) as error:
            check_writable(str(name), ("-", str(path)))
        assert refusal(error).message == "cannot be written: it is read by the same command"
    check_writable(str(path), ("-", str(tmp_path / "c.krd")))


def test_an_output_that_can_be_written(tmp_path: Path) -> None:
    check_writable(str(tmp_path / "new.json"))
    check_writable(os.devnull)
    write_atomically(os.devnull, b"x")
    assert not os.path.isfile(os.devnull)


@pytest.mark.skipif(IS_ROOT, reason="root may write everything")
def test_a_file_that_may_not_be_written_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.krd"
    path.write_bytes(b"old")
    path.chmod(0o440)
    with pytest.raises(KoordError) as error:
        write_atomically(str(path), b"new")
    assert refusal(error).message == "cannot be written: permission denied"
    with pytest.raises(KoordError):
        check_writable(str(path))
    assert path.read_bytes() == b"old"
