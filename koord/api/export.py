"""Export of a program's claims as a problem for other tools."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from koord.api.files import write_atomically
from koord.api.programs import Loadable, Program, program_of
from koord.api.progress import Cancellation, CancelledError, Listener, asker, teller
from koord.api.results import ArgumentError, Result
from koord.api.robots import Robots, Seconds, delta_of, fleet_of, system_of
from koord.api.verify import check_names, in_process
from koord.syntax.budget import Budget, OutOfBudgetError
from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.source import NOWHERE, visible
from koord.syntax.system import System
from koord.version import __version__

if TYPE_CHECKING:
    from koord.verify.job_process import JobChannel

#: What a program can be written as: circuits, transition systems, one question about some rounds, a
#: module of TLA+.
FORMATS = ("aiger", "vmt", "smt2", "tla")

#: Names of modules.
NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)

#: How long it may take to find out whether another export takes a program, each in seconds.
_TRIED_S = 3.0


class Exported(Result, frozen=True):
    """An exported problem. ``notes`` say what is missing in it, or over-approximated."""

    form: str
    content: bytes
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, object]:
        """The fields as plain data; bytes that are no text are escaped."""
        text = self.content.decode(errors="backslashreplace")
        return {"form": self.form, "content": text, "notes": list(self.notes)}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a file, whole or not at all. Raises :class:`koord.KoordError`."""
        write_atomically(os.fspath(path), self.content)

    def __repr__(self) -> str:
        return f"<Exported {self.form}: {len(self.content)} bytes>"


class Wanted(Struct, frozen=True):
    """The request for an export: program, robots, form and bounds.

    ``module`` is the name of a module of TLA+; None: one that is made of the program's.
    """

    program: Program
    system: System
    form: str
    properties: tuple[str, ...] = ()
    rounds: int = 20
    timeout_s: float | None = None
    module: str | None = None
    binary: bool = False

    @property
    def comment(self) -> str:
        """The comment at the head of the file."""
        problem = self.program.problem(self.system.kinds, self.system.delta_s)
        return f"{visible(str(problem))}, by koord {__version__}"


def export(
    program: Loadable,
    form: str,
    *,
    robots: Robots = None,
    rounds: int = 20,
    delta_s: Seconds = None,
    properties: Sequence[str] = (),
    timeout_s: float | None = None,
    module: str | None = None,
    binary: bool = False,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> Exported:
    """Export the claims about a program for other tools; nothing is verified.

    ``form`` is ``"aiger"`` (``binary`` or as text), ``"vmt"``, ``"smt2"``, which asks about so many
    ``rounds``, or ``"tla"``, a module of that name. ``robots``, ``delta_s`` and ``properties`` are
    those of :func:`koord.verify`.

    Raises :class:`koord.KoordError` for what the other language cannot say, with what can,
    :class:`koord.ArgumentError` for arguments that do not fit, TimeoutError after ``timeout_s``
    seconds, and :class:`koord.CancelledError` after ``cancellation``.

    >>> koord.export("task.krd", "vmt", robots=3).save("task.vmt")
    """
    loaded, fleet = program_of(program), fleet_of(robots)
    if form not in FORMATS:
        raise ArgumentError("form", f"there is no {form!r}; there are {', '.join(FORMATS)}")
    if fleet.any_number:
        raise ArgumentError("robots", "an export needs a number of robots")
    if module is not None and not NAME.fullmatch(module):
        raise ArgumentError("module", f"{module!r} is no name: write letters, digits and _")
    system = system_of(loaded.core, fleet, delta_of(delta_s))
    wanted = Wanted(loaded, system, form, tuple(properties), rounds, timeout_s, module, binary)
    try:
        return exported(wanted, teller(progress), asker(cancellation))
    except KeyboardInterrupt:
        if cancellation is None or not cancellation.requested:
            raise
        raise CancelledError("while the file was written") from None


def exported(
    wanted: Wanted, tell: Callable[[str], None], interrupted: Callable[[], bool]
) -> Exported:
    """As :func:`export`, for a request. Raises KeyboardInterrupt if it is ``interrupted``."""
    _check_names(wanted)

    def work(tell: JobChannel) -> Exported:
        tell(f"writing {wanted.form}")
        try:
            return _written(wanted)
        except KoordError as error:  # of what the other language cannot say
            raise _with_others(error, wanted) from None

    try:
        made = in_process(work, tell, interrupted)
    except OutOfBudgetError:
        raise TimeoutError("the time was up, and nothing is written") from None
    return replace(made, notes=(*made.notes, *_left_out(wanted)))


def _check_names(wanted: Wanted) -> None:
    """Check that some claim is in the file. Raises ArgumentError."""
    from koord.verify.claims import claims_of, liveness_of

    names = wanted.properties
    stated = [claim.name for claim in claims_of(wanted.system)]
    of_runs = [claim.name for claim in liveness_of(wanted.system)]
    check_names(names, [*stated, *of_runs])
    if names and not set(names) & set(stated):
        about = f"{names[0]!r} is about whole runs, which exports leave out"
        raise ArgumentError("properties", about)


def _written(wanted: Wanted) -> Exported:
    """The file, and its over-approximations. Raises KoordError, and OutOfBudgetError."""
    from koord.verify.effort import Deadline

    deadline = Deadline.after(wanted.timeout_s)
    system = replace(wanted.system, budget=Budget(deadline.passed))
    if wanted.form == "tla":
        return Exported(wanted.form, _module(wanted, system), ())
    from koord.semantics.every_number import NotFiniteError
    from koord.verify.engines.bits.circuit_files import Format
    from koord.verify.export.smtlib import problem

    form = Format.AIG if wanted.form == "aiger" and wanted.binary else Format(wanted.form)
    try:
        found = problem(system, wanted.properties, form, wanted.rounds, wanted.comment)
    except NotFiniteError as error:
        place = wanted.program.name if error.span == NOWHERE else error.span
        message = f"the program cannot be written for solvers: {error.what}"
        raise refusal("K944", place, message) from error
    return Exported(wanted.form, found.content, found.notes)


def _module(wanted: Wanted, system: System) -> bytes:
    from pathlib import Path

    from koord.verify.export.tla.module import module

    name = wanted.module
    if name is None:
        name = "M_" + re.sub(r"\W", "_", Path(wanted.program.name).stem, flags=re.ASCII)
    lines = module(system, name, wanted.properties, wanted.comment)
    return "".join(f"{line}\n" for line in lines).encode()


def _left_out(wanted: Wanted) -> Iterator[str]:
    """Yield the reasons why claims are not in the file."""
    from koord.verify.claims import ClaimKind, claims_of, liveness_of

    names = wanted.properties
    beyond = [(claim.name, "it is about whole runs") for claim in liveness_of(wanted.system)]
    if wanted.form == "tla":
        beyond += [
            (claim.name, "TLC looks for faults by itself, and for nothing else but invariants")
            for claim in claims_of(wanted.system)
            if claim.kind in (ClaimKind.LOST_UPDATE, ClaimKind.CONTRACT)
        ]
    for name, why in beyond:
        if not names or name in names:
            yield f"not in the file: {name}: {why}"


def _with_others(error: KoordError, wanted: Wanted) -> KoordError:
    """A refusal that names exports which do take the program, as far as a short trial tells."""
    taken, unclear = list[str](), False
    for forms in (("smt2",), ("aiger", "vmt"), ("tla",)):
        if wanted.form not in forms:
            takes = _takes(forms[0], wanted)
            taken += forms if takes else ()
            unclear = unclear or takes is None
    if not taken and unclear:
        return error
    *several, last = [f"`form='{form}'`" for form in taken] or [""]
    others = f"{', '.join(several)} and {last} take" if several else f"{last} takes"
    cure = f"{others} this program as it is" if last else "no other export takes this program"
    return KoordError(
        tuple(
            replace(found, hint=f"{found.hint}; {cure}" if found.hint else cure)
            for found in error.diagnostics
        )
    )


def _takes(form: str, wanted: Wanted) -> bool | None:
    """Return whether an export takes a program; None if a short trial does not tell."""
    rounds = min(1, wanted.rounds)
    trial = replace(wanted, form=form, rounds=rounds, timeout_s=_TRIED_S, module=None, binary=False)
    try:
        _written(trial)
    except KoordError:
        return False
    except OutOfBudgetError:
        return None
    return True
