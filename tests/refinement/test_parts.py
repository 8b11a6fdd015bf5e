"""Parts: what robots tell comes back as it was told, and damage is named by file and line."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Sequence
from contextlib import suppress
from fractions import Fraction
from functools import partial
from itertools import count
from pathlib import Path
from random import Random
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from koord.refinement import reports
from koord.refinement.cases import Target, generated, tried
from koord.refinement.deployed import Expedition
from koord.refinement.part_reading import read_part
from koord.refinement.parts import PartWriter, Whose
from koord.refinement.reports import Told
from koord.runtime.chaos.network import CHAOS
from koord.runtime.proposals import Decision, Write
from koord.syntax import core
from koord.syntax.diagnostics import Diagnostic, KoordError
from koord.syntax.system import System, dealt
from koord.traces.codec import Subject, load_embedded
from koord.traces.trace import Sources
from tests.refinement.running import program, seeds, sources
from tests.sampling import first

TEXT = (
    'allwrite:\n  int sum = 0\nlocal:\n  int mine = 0\n  string word = "x"\n'
    "Add:\n  eff:\n    atomic:\n      sum = sum + 1\n    mine = sum\n    stdout << mine\n"
)


def whose(text: str = TEXT, *, run: str = "a run", pid: int = 0, name: str = "app.krd") -> Whose:
    system = dealt(program(text), 2)
    of = sources(text)
    return Whose(run, pid, Subject(Sources(type(of.program)(name, text)), system, Fraction(0)))


def written(path: Path, told: Sequence[Told], of: Whose) -> bytes:
    writer = PartWriter(path, lambda: of)
    for one in told:
        writer.tell(one)
    assert writer.trouble is None
    return path.read_bytes()


def error(raw: bytes, name: str = "0.jsonl") -> Diagnostic:
    with pytest.raises(KoordError) as caught:
        read_part(raw, name, load_embedded)
    (found,) = caught.value.diagnostics
    return found


def _already(program: core.Program, _: Sources) -> core.Program:
    """The program, which nobody has to load: generated ones have no text."""
    return program


SOME = (reports.Undeclared(), reports.Coordinated(3, 1.5), reports.Left(4))


# --- there and back -------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", first(6, seeds(60)))
def test_what_is_told_comes_back(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of every type of value: robots of generated programs, in chaos."""
    stories: list[tuple[System, Sources, Sequence[Sequence[Told]]]] = []
    honest = Expedition.ran

    def ran(self: Expedition, told: Sequence[Sequence[Told]]) -> Any:
        stories.append((self.system, self.sources, told))
        return honest(self, told)

    monkeypatch.setattr(Expedition, "ran", ran)
    tried(generated(seed, 8, Target.NETWORK, CHAOS))
    for system, of, told in stories:
        for pid, story in enumerate(told):
            here = Whose("a run", pid, Subject(of, system, Fraction(0)))
            raw = written(tmp_path / f"{pid}.jsonl", story, here)
            if not story:
                continue
            part = read_part(raw, "part", partial(_already, system.program))
            # As texts, because what is no number does not equal itself.
            assert repr(part.told) == repr(tuple(story))
            assert (part.whose.run, part.whose.pid, part.is_torn) == ("a run", pid, False)


def test_a_robot_that_was_started_again_goes_on_in_its_part(tmp_path: Path) -> None:
    path = tmp_path / "0.jsonl"
    written(path, SOME, whose())
    path.write_bytes(path.read_bytes() + b'{"told":"sto')
    raw = written(path, SOME, whose(name="elsewhere/app.krd"))
    part = read_part(raw, "0.jsonl", load_embedded)
    assert part.told == (*SOME, *SOME)
    assert [json.loads(line)["n"] for line in raw.splitlines()] == list(range(8))


@pytest.mark.parametrize(
    "other", [whose(run="another"), whose(pid=1), whose(TEXT.replace("+ 1", "+ 2"))]
)
def test_the_part_of_another_run_is_replaced(tmp_path: Path, other: Whose) -> None:
    path = tmp_path / "0.jsonl"
    written(path, SOME, whose())
    part = read_part(written(path, SOME[:1], other), "0.jsonl", load_embedded)
    assert part.told == SOME[:1]


def test_of_a_robot_that_was_killed_half_a_line_is_missing(tmp_path: Path) -> None:
    raw = written(tmp_path / "0.jsonl", SOME, whose())
    part = read_part(raw[:-5], "0.jsonl", load_embedded)
    assert part.is_torn
    assert part.told == SOME[:-1]


def test_a_part_that_cannot_be_written_does_not_stop_the_robot(tmp_path: Path) -> None:
    folder = tmp_path / "nowhere"
    writer = PartWriter(folder / "0.jsonl", whose)
    for one in SOME:
        writer.tell(one)
    assert isinstance(writer.trouble, FileNotFoundError)
    assert writer.missed == 3
    folder.mkdir()
    writer.tell(SOME[0])
    part = read_part((folder / "0.jsonl").read_bytes(), "0.jsonl", load_embedded)
    assert part.told == (reports.Missed(3), SOME[0])


@pytest.mark.parametrize("full_at", range(8))
def test_a_part_goes_on_when_there_is_room_again(
    full_at: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever line the disk is full at, and at the next: no half a line is left."""
    honest, path, writes = os.write, tmp_path / "0.jsonl", count()

    def write(file: int, data: bytes) -> int:
        match next(writes) - full_at:
            case 0:
                return honest(file, data[: len(data) // 2])
            case 1:
                raise OSError(errno.ENOSPC, "No space left on device")
        return honest(file, data)

    writer, told = PartWriter(path, whose), SOME * 2
    monkeypatch.setattr(os, "write", write)
    for one in told:
        writer.tell(one)
        if path.exists():
            assert path.read_bytes()[-1:] in (b"", b"\n")
    part = read_part(path.read_bytes(), "0.jsonl", load_embedded)
    missed = sum(one.reports for one in part.told if isinstance(one, reports.Missed))
    kept = [one for one in part.told if not isinstance(one, reports.Missed)]
    at = max(0, full_at - 1)  # the first line is the head
    late = at + 2 >= len(told)  # nothing is told after it
    assert kept == [*told[:at], *told[at + 2 :]]
    assert writer.missed == min(2, len(told) - at)
    assert missed == (0 if late else 2)


def test_decisions_that_write_otherwise_are_told_apart() -> None:
    one, other = (Decision(3, (), (0, 1), (Write(0, (), value),)) for value in (1, 2))
    assert reports.shortened(one) != reports.shortened(other)
    assert reports.shortened(one).writes == ()
    assert len(reports.shortened(one).digest) == reports.DIGEST_BYTES


# --- damage ---------------------------------------------------------------------------------------


def lines(tmp_path: Path) -> list[bytes]:
    return written(tmp_path / "0.jsonl", SOME, whose()).splitlines(keepends=True)


def test_a_line_that_is_missing_is_told(tmp_path: Path) -> None:
    whole = lines(tmp_path)
    found = error(b"".join(whole[:1] + whole[2:]))
    assert (found.code, str(found.span)) == ("K913", "0.jsonl:2:1")
    assert found.message == "$.n: it is line 2 of the part, not line 1: lines are missing"


def test_what_is_no_part_at_all_is_told() -> None:
    found = error(b"local:\n  int x = 0\n")
    assert found.message.startswith(
        "this is no part of a run, or its first line is damaged: it is no"
    )


def test_a_damaged_line_is_told(tmp_path: Path) -> None:
    whole = lines(tmp_path)
    found = error(b"".join([*whole[:2], whole[2][:9] + b"\n", whole[3]]))
    assert (found.code, str(found.span)) == ("K910", "0.jsonl:3:1")
    assert found.message.startswith("the line is damaged: ")
    found = error(b"".join([*whole[:2], whole[2].replace(b"round", b"rounds"), whole[3]]))
    assert (found.code, found.message) == ("K913", "$.rounds: there should be no such field")


def test_other_files_are_no_parts(tmp_path: Path) -> None:
    whole = lines(tmp_path)
    assert error(b"").message == "there is no whole line in it"
    assert error(b"{}\n").code == "K911"
    assert error(b"".join(whole[1:])).code == "K911"
    assert error(whole[0].replace(b'"version":1', b'"version":2')).code == "K912"
    assert error(whole[0].replace(b"sum + 1", b"sum + 2")).code == "K915"
    assert error(whole[0].replace(b'"pid":0', b'"pid":2')).message == "$.pid: 2 is out of range"


def test_a_part_that_goes_on_as_another_s_is_refused(tmp_path: Path) -> None:
    whole = lines(tmp_path)
    head = json.loads(whole[0]) | {"n": 4, "run": "another"}
    found = error(b"".join(whole) + json.dumps(head).encode() + b"\n")
    assert (found.code, str(found.span)) == ("K918", "0.jsonl:5:1")


@pytest.mark.parametrize("seed", range(4))
def test_whatever_bytes_come_in_a_diagnostic_or_a_part_comes_out(seed: int, tmp_path: Path) -> None:
    rng, raw = Random(seed), b"".join(lines(tmp_path))
    for _ in range(150):
        damaged = bytearray(raw)
        for _ in range(rng.randint(1, 3)):
            at = rng.randrange(len(damaged))
            damaged[at : at + rng.choice((0, 1, 1, 4))] = rng.randbytes(rng.choice((0, 1, 2)))
        with suppress(KoordError):
            read_part(bytes(damaged), "0.jsonl", load_embedded)


def test_lines_are_as_the_schema_says(tmp_path: Path) -> None:
    from koord.api.documents import schema

    check = Draft202012Validator(schema("part"))
    for line in lines(tmp_path):
        check.validate(json.loads(line))
