"""``koord verify --export``: the question itself, in a file for other tools."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from koord import __version__
from koord.cli.diagnostics import Report, report_error
from koord.cli.exits import Exit
from koord.cli.files import DASH, check_writable, write_atomically
from koord.cli.inputs import LoadedProgram, Reading, load_programs
from koord.cli.systems import system_of
from koord.semantics.configurations import System
from koord.syntax.diagnostics import KoordError

if TYPE_CHECKING:
    from koord.verify.bits.exporting import Format

#: What a program can be written as; see :class:`koord.verify.bits.exporting.Format`.
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
    system = system_of(program.program, arguments.robots[0], arguments.delta)
    try:
        if arguments.export == "tla":
            return _write_module(program, system, arguments)
        return _write(program, system, arguments)
    except KoordError as error:  # of what the other language cannot say
        report_error(error, as_json=False, sources=report.sources.values())
        return Exit.BAD_INPUT


def _write_module(program: LoadedProgram, system: System, arguments: argparse.Namespace) -> int:
    from koord.verify.tla.module import module

    path = Path(program.source.name if arguments.output == DASH else arguments.output)
    name = path.stem
    if arguments.output == DASH:
        name = "M_" + re.sub(r"\W", "_", name, flags=re.ASCII)
    elif not _NAME.fullmatch(name) or path.suffix != ".tla":
        raise argparse.ArgumentTypeError(
            f"--export tla: a module has the name of its file, and {path.name!r} is none; "
            "write letters, digits and _, and .tla"
        )
    lines = module(system, name, tuple(arguments.names), _comment(program, system))
    _put("".join(f"{line}\n" for line in lines).encode(), arguments.output)
    return Exit.OK


def _comment(program: LoadedProgram, system: System) -> str:
    return f"{program.source.name}, {system.robots} robots, by koord {__version__}"


def _put(content: bytes, output: str) -> None:
    if output == DASH:
        sys.stdout.write(content.decode())
    else:
        write_atomically(output, content)


def _write(program: LoadedProgram, system: System, arguments: argparse.Namespace) -> int:
    from koord.semantics.machine import NotFiniteError
    from koord.verify.bits.exporting import problem

    try:
        written = problem(
            system,
            tuple(arguments.names),
            _format(arguments),
            arguments.rounds,
            _comment(program, system),
        )
    except NotFiniteError as error:
        print(f"koord verify: not to be written as bits: {error}", file=sys.stderr)
        return Exit.UNKNOWN
    for note in written.notes:
        print(f"koord verify: {note}", file=sys.stderr)
    _put(written.content, arguments.output)
    return Exit.OK


def _format(arguments: argparse.Namespace) -> Format:
    """What is asked for; AIGER has a binary form, in files of a name of their own."""
    from koord.verify.bits.exporting import Format

    asked = Format(arguments.export)
    binary = asked is Format.AIGER and arguments.output.endswith(".aig")
    return Format.AIG if binary else asked
