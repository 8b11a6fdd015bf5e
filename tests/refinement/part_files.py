"""Parts of deployed runs in virtual time, as files, for tests that merge them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

from koord.refinement.deployed import Expedition, told_over_network
from koord.refinement.parts import PartWriter, Whose
from koord.refinement.reports import Told
from koord.refinement.running import ready
from koord.runtime.chaos.network import CALM, Faults
from koord.syntax.system import System, dealt
from koord.traces.codec import Subject
from koord.traces.trace import Sources
from tests.refinement.running import program, sources

#: A line of a part, as JSON.
Line = dict[str, Any]


def part_files(
    folder: Path,
    text: str,
    *,
    robots: int = 3,
    rounds: int = 12,
    seed: int = 1,
    faults: Faults = CALM,
    run: str = "a run",
) -> list[Path]:
    """The parts of a run of a program."""
    system = dealt(program(text), robots)
    expedition = Expedition(
        ready(system.program), system, sources(text), rounds, seed, faults=faults
    )
    return written(folder, system, sources(text), told_over_network(expedition), run)


def written(
    folder: Path, system: System, of: Sources, told: Sequence[Sequence[Told]], run: str
) -> list[Path]:
    """What robots have told, as files."""
    folder.mkdir(exist_ok=True)
    files = []
    for pid, story in enumerate(told):
        files.append(folder / f"{pid}.jsonl")
        whose = Whose(run, pid, Subject(of, system, Fraction(0)))
        writer = PartWriter(files[-1], lambda whose=whose: whose)  # type: ignore[misc]
        for one in story:
            writer.tell(one)
        assert writer.trouble is None
    return files


def lines_of(path: Path) -> list[Line]:
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()]


def write_lines(path: Path, lines: Sequence[Line], *, number: bool = True) -> None:
    """Write a part that was changed; its lines are numbered anew, as nobody else would."""
    texts = [json.dumps(line | {"n": n} if number else line) for n, line in enumerate(lines)]
    path.write_text("".join(f"{text}\n" for text in texts), "utf-8")
