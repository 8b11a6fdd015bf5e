"""``koord verify --export``: the question itself, in a file for other tools."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from koord.api.files import write_atomically
from koord.api.programs import Program
from koord.api.robots import system_of
from koord.api.verify import check_names
from koord.cli.diagnostics import Report, report_error
from koord.cli.exits import Exit
from koord.cli.files import DASH, check_writable
from koord.cli.inputs import Reading, load_programs
from koord.cli.progress import LiveLine
from koord.cli.terminal import visible
from koord.semantics.every_number import NotFiniteError
from koord.syntax.budget import OutOfPatienceError, Patience
from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.source import NOWHERE
from koord.syntax.system import System
from koord.version import __version__

if TYPE_CHECKING:
    from koord.verify.engines.bits.circuit_files import Format

#: What a program can be written as; see :class:`koord.verify.engines.bits.circuit_files.Format`.
FORMATS = ("aiger", "vmt", "smt2", "tla")

#: Names of modules.
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


def add_export(parser: argparse.ArgumentParser) -> None:
    """Add the flags."""
    parser.add_argument(
        "--export",
        choices=FORMATS,
        help="verify nothing: write the claims as a problem for other tools",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        default=DASH,
        help="where --export writes to; a name in .aig makes AIGER binary (-)",
    )


def export(arguments: argparse.Namespace) -> int:
    """Write the claims about one program as a problem."""
    if len(arguments.files) > 1 or len(arguments.robots) > 1 or arguments.robots[0].any_number:
        raise argparse.ArgumentTypeError("--export takes one program and one number of robots")
    if arguments.output != DASH:
        check_writable(arguments.output, (*arguments.files, *arguments.properties))
    report = Report()
    programs = load_programs(arguments.files, Reading.of(arguments), report)
    report.print(sys.stderr, as_json=False)
    if report.errors:
        return Exit.BAD_INPUT
    (program,) = programs
    system = system_of(program.core, arguments.robots[0], arguments.delta)
    asked = _Asked(program, _within(system, arguments.timeout), arguments)
    _check_names(asked)
    try:
        with LiveLine(sys.stderr) as line:
            line.show(f"writing {arguments.export}")
            content, notes = _written(asked)
    except KoordError as error:  # of what the other language cannot say
        report_error(_with_others(error, asked), as_json=False, sources=report.sources.values())
        return Exit.BAD_INPUT
    except OutOfPatienceError:
        print("koord verify: the time was up, and nothing is written", file=sys.stderr)
        return Exit.UNKNOWN
    for note in (*notes, *_left_out(asked)):
        print(f"koord verify: {note}", file=sys.stderr)
    if arguments.output == DASH:
        sys.stdout.write(content.decode())
    else:
        write_atomically(arguments.output, content)
    return Exit.OK


class _Asked(Struct, frozen=True):
    """A program that is to be written, and how."""

    program: Program
    system: System
    arguments: argparse.Namespace

    @property
    def comment(self) -> str:
        problem = self.program.problem(self.system.kinds, self.system.delta_s)
        return f"{visible(str(problem))}, by koord {__version__}"


def _within(system: System, seconds: float | None) -> System:
    """A system of which nobody waits for longer."""
    from koord.verify.effort import Deadline

    return replace(system, patience=Patience(Deadline.after(seconds).passed))


def _check_names(asked: _Asked) -> None:
    """Something has to be in the file. Raises ArgumentTypeError."""
    from koord.verify.claims import claims_of, liveness_of

    names = asked.arguments.names
    stated = [claim.name for claim in claims_of(asked.system)]
    of_runs = [claim.name for claim in liveness_of(asked.system)]
    check_names(names, [*stated, *of_runs])
    if names and not set(names) & set(stated):
        raise argparse.ArgumentTypeError(
            f"--property: {names[0]!r} is about whole runs, which --export leaves out"
        )


def _written(asked: _Asked) -> tuple[bytes, tuple[str, ...]]:
    """The file, and what it says more loosely. Raises KoordError, and OutOfPatienceError."""
    if asked.arguments.export == "tla":
        return _module(asked), ()
    from koord.verify.export.problems import problem

    names, rounds = tuple(asked.arguments.names), asked.arguments.rounds
    try:
        found = problem(asked.system, names, _format(asked.arguments), rounds, asked.comment)
    except NotFiniteError as error:
        place = asked.program.source.name if error.span == NOWHERE else error.span
        message = f"the program cannot be written for solvers: {error.what}"
        raise refusal("K944", place, message) from error
    return found.content, found.notes


def _module(asked: _Asked) -> bytes:
    from koord.verify.export.tla.module import module

    output = asked.arguments.output
    path = Path(asked.program.source.name if output == DASH else output)
    name = path.stem
    if output == DASH:
        name = "M_" + re.sub(r"\W", "_", name, flags=re.ASCII)
    elif not _NAME.fullmatch(name) or path.suffix != ".tla":
        raise argparse.ArgumentTypeError(
            f"--export tla: a module has the name of its file, and {path.name!r} is none; "
            "write letters, digits and _, and .tla"
        )
    lines = module(asked.system, name, tuple(asked.arguments.names), asked.comment)
    return "".join(f"{line}\n" for line in lines).encode()


def _left_out(asked: _Asked) -> Iterator[str]:
    """What the file does not ask."""
    from koord.verify.claims import ClaimKind, claims_of, liveness_of

    names = asked.arguments.names
    beyond = [(claim.name, "it is about whole runs") for claim in liveness_of(asked.system)]
    if asked.arguments.export == "tla":
        beyond += [
            (claim.name, "TLC looks for faults by itself, and for nothing else but invariants")
            for claim in claims_of(asked.system)
            if claim.kind in (ClaimKind.LOST_UPDATE, ClaimKind.CONTRACT)
        ]
    for name, why in beyond:
        if not names or name in names:
            yield f"not in the file: {name}: {why}"


#: How long it may take to find out whether another export takes a program, each in seconds.
_TRIED_S = 3.0


def _with_others(error: KoordError, asked: _Asked) -> KoordError:
    """A refusal with what does take the program, as far as that is soon found out."""
    taken, unclear = list[str](), False
    for flags in (("smt2",), ("aiger", "vmt"), ("tla",)):
        if asked.arguments.export not in flags:
            takes = _takes(flags[0], asked)
            taken += flags if takes else ()
            unclear = unclear or takes is None
    if not taken and unclear:
        return error
    *several, last = [f"`--export {flag}`" for flag in taken] or [""]
    others = f"{', '.join(several)} and {last} take" if several else f"{last} takes"
    cure = f"{others} this program as it is" if last else "no other export takes this program"
    return KoordError(
        tuple(
            replace(found, hint=f"{found.hint}; {cure}" if found.hint else cure)
            for found in error.diagnostics
        )
    )


def _takes(flag: str, asked: _Asked) -> bool | None:
    """Whether an export takes a program; None if that is not soon found out."""
    arguments = argparse.Namespace(**vars(asked.arguments))
    arguments.export, arguments.output, arguments.rounds = flag, DASH, min(1, arguments.rounds)
    system = _within(asked.system, _TRIED_S)
    try:
        _written(replace(asked, system=system, arguments=arguments))
    except KoordError:
        return False
    except OutOfPatienceError:
        return None
    return True


def _format(arguments: argparse.Namespace) -> Format:
    """What is asked for; AIGER has a binary form, in files of a name of their own."""
    from koord.verify.engines.bits.circuit_files import Format

    asked = Format(arguments.export)
    binary = asked is Format.AIGER and arguments.output.endswith(".aig")
    return Format.AIG if binary else asked
