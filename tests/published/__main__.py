"""What becomes of every published program, configuration and scene.

    python -m tests.published FOLDER [--json FILE] [--only WORD]

takes every program (``.krd``, ``.koord``) and every configuration or scene (``.yml``, ``.yaml``)
below a folder; equal files count once. A program is *accepted*; accepted *with warnings* of old
forms; *migrated* by ``koord migrate --stub``, which declares what nobody declares; or rejected,
with its codes. What comes out of a migration has to stay as it is, and a program that is
accepted has to mean what it did. Files that are meant to be bad have to be rejected for what they
are bad for (``expected.py``).

Programs that are not rejected are compiled, and runs of them judged by the rules. Those that move
are simulated to their end with the configurations of their repository, one of each set of
vehicles, from where a scene with robots of these names says, else from where the seed says. How a
run ends is the program's matter: robots of some come too near to each other, and some fault.

The exit code is 0 if all became what it should; 1 if not, or if something raised an exception; 2
if there is no program; 130 after Ctrl-C, with what was found until then.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

import msgspec

from tests.published import documents, programs, runs
from tests.published.documents import Document
from tests.published.programs import Finding, Outcome
from tests.published.runs import Ran

Asked = TypeVar("Asked", bound=Path | Finding)
Found = TypeVar("Found")


class Result(msgspec.Struct):
    """What became of all files, as far as they were looked at."""

    programs: list[Finding] = msgspec.field(default_factory=list)
    documents: list[Document] = msgspec.field(default_factory=list)
    ran: list[Ran] = msgspec.field(default_factory=list)
    interrupted: bool = False

    @property
    def ok(self) -> bool:
        findings = [*self.programs, *(one.finding for one in self.documents)]
        return all(one.outcome.is_wanted for one in findings) and not any(
            one.trouble for one in self.ran
        )


def _each(asked: Iterable[Asked], look: Callable[[Asked], Found], into: list[Found]) -> None:
    """Look at files or at what was found of them, and tell of each what became of it."""
    chosen = list(asked)
    for done, each in enumerate(chosen):
        path = each if isinstance(each, Path) else each.path
        _progress(f"{done} of {len(chosen)}: {path.name}")
        into.append(look(each))
        one = into[-1].finding if isinstance(into[-1], Document) else into[-1]
        _progress("")
        print(one)
        is_wanted = isinstance(one, Finding) and one.outcome.is_wanted
        if isinstance(one, Finding | Ran) and one.trouble and not is_wanted:
            print(one.trouble)


def _progress(text: str) -> None:
    """Show how far it is, where somebody looks."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)


def looked_at(folder: Path, only: str) -> Result:
    """What becomes of all files below a folder whose names contain a word."""
    result = Result()

    def named(endings: tuple[str, ...]) -> list[Path]:
        return [path for path in programs.files(folder, endings) if only in path.name]

    try:
        _each(named(programs.ENDINGS), programs.judged, result.programs)
        print()
        _each(programs.files(folder, documents.ENDINGS), documents.judged, result.documents)
        print()
        kept = [one for one in result.programs if one.source is not None]
        _each(kept, lambda finding: runs.ran(finding, result.documents), result.ran)
    except KeyboardInterrupt:
        result.interrupted = True
        print("interrupted: this is what was found until then")
    return result


def _table(result: Result) -> None:
    """How many of each there are."""
    print()
    of_documents = [one.finding.outcome for one in result.documents]
    print("programs  files  what became of them")
    for outcome in Outcome:
        many = sum(one.outcome is outcome for one in result.programs)
        print(f"{many:8} {of_documents.count(outcome):6}  {outcome.value}")
    print(f"{len(result.programs):8} {len(of_documents):6}  in all")
    simulations = [one for each in result.ran for one in each.simulations if one.is_run]
    judged = sum(one.runs for one in result.ran)
    print(f"{len(result.ran):8}         compiled, {judged} runs judged by the rules")
    print(f"{sum(bool(one.simulations) for one in result.ran):8}         simulated", end="")
    print(f" in {len(simulations)} runs to their ends")


def _json(result: Result) -> bytes:
    """The result as JSON."""
    made = {
        "version": 1,
        "ok": result.ok,
        "interrupted": result.interrupted,
        "programs": [_file(one) for one in result.programs],
        "documents": [
            {**_file(one.finding), "robots": list(one.kinds)} for one in result.documents
        ],
        "ran": [
            {
                "file": one.finding.path.name,
                "runs": one.runs,
                "steps": one.steps,
                "faults": one.faults,
                "simulations": one.simulations,
                "trouble": one.trouble,
            }
            for one in result.ran
        ],
    }
    return msgspec.json.format(msgspec.json.encode(made), indent=2) + b"\n"


def _file(one: Finding) -> dict[str, object]:
    return {
        "file": one.path.name,
        "outcome": one.outcome.value,
        "codes": one.codes,
        "trouble": one.trouble,
    }


def main(arguments: list[str]) -> int:
    """Print what becomes of each file, and how many of each there are."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.published", description=__doc__.splitlines()[0] if __doc__ else ""
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all that was found, too")
    parser.add_argument("--only", default="", metavar="WORD", help="programs with this in a name")
    try:
        asked = parser.parse_args(arguments)
    except SystemExit as ended:
        return int(ended.code or 0)
    if not asked.folder.is_dir():
        print(f"{asked.folder} is no folder", file=sys.stderr)
        return 2
    result = looked_at(asked.folder, asked.only)
    _table(result)
    if asked.json is not None:
        asked.json.write_bytes(_json(result))
    if result.interrupted:
        return 130
    if not result.programs:
        return 2
    return int(not result.ok)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
