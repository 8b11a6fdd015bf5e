"""The parts of a deployed run while it goes on: files that robots write, and where they lie."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from shlex import quote

from msgspec import Struct, field

from koord.api.files import no_folder
from koord.api.fitting import Fitted, slack_of
from koord.api.merge import Merged, merge
from koord.api.progress import Cancellation, Listener
from koord.api.traces import sources_of
from koord.refinement.instrumented_robot import instrumented
from koord.refinement.parts import PartWriter, Whose
from koord.refinement.running import Compiled, ready
from koord.runtime.deploy.job import CannotTakePartError, Job
from koord.runtime.deploy.member import Member
from koord.runtime.transports.transport import TransportError
from koord.syntax.analysis.limits import excesses
from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.source import counted, visible
from koord.syntax.system import System
from koord.traces.codec import Subject


class Parts(Struct, frozen=True):
    """The parts of a run, each in a file, and the robots that write them."""

    subject: Subject
    made: Compiled
    files: Mapping[int, Path]  #: by pid
    aside: Path | None = None  #: where the parts of an earlier run are, that was killed
    writers: dict[int, PartWriter] = field(default_factory=dict)  #: of this process

    @staticmethod
    def of(fitted: Fitted, job: Job, files: Mapping[int, Path], aside: Path | None = None) -> Parts:
        """Parts in these files."""
        program = fitted.program
        system = System(program.core, fitted.kinds, fitted.delta_s)
        slack = slack_of(fitted, is_exact=job.platforms is None)
        subject = Subject(sources_of(program), system, slack)
        return Parts(subject, ready(program.core, job.classes), files, aside)

    def member(self, job: Job, pid: int) -> Member:
        """Make a robot that writes its part."""

        def whose() -> Whose:
            return Whose(f"{job.run} {made.run.hex()}", pid, self.subject)

        writer = self.writers[pid] = PartWriter(self.files[pid], whose)
        made = instrumented(job, pid, self.made, self.subject.system, writer.tell)
        return made

    @property
    def folder(self) -> Path:
        return next(iter(self.files.values())).parent

    def merged(self, progress: Listener, cancellation: Cancellation | None) -> Merged:
        """The trace of the run, which is over. Raises KoordError and CancelledError."""
        there = [file for file in self.files.values() if file.exists()]
        return merge(there, progress=progress, cancellation=cancellation)

    def unmerged(self, trace: str) -> KoordError:
        """What is told where nobody waited for the trace: the parts are left."""
        story = f"it was not made, as that was interrupted: what robots told is in {self.folder}"
        return refusal("K918", visible(trace), visible(story), merging(self.folder, trace))

    def remove(self) -> None:
        """Remove the files, of which there is a trace or a recording."""
        remove(self.files.values())

    def tails(self) -> dict[int, PartTail]:
        """What is new in each file, by pid."""
        return {pid: PartTail(file) for pid, file in self.files.items()}

    @property
    def trouble(self) -> KoordError | None:
        """Why a robot of this process could not write all of its part, if so."""
        for writer in self.writers.values():
            if writer.trouble is not None:
                what = counted(writer.missed, "report")
                story = f"{what} could not be written, and are missing: {writer.trouble.strerror}"
                return refusal("K903", visible(str(writer.path)), story)
        return None


def check_judgeable(fitted: Fitted) -> None:
    """Raise KoordError where the program is too large for the reference to judge its runs."""
    found = excesses(fitted.program.core, fitted.kinds)
    if found:
        raise KoordError(found)


def folder_of(file: str) -> Path:
    """The folder of robots' parts while the run goes on, beside its trace or recording."""
    return Path(f"{file}.parts")


@contextmanager
def part_files(
    folder: Path, pids: Iterable[int], *, goes_on: bool = False
) -> Iterator[tuple[dict[int, Path], Path | None]]:
    """The files of robots' parts, by pid, in a folder.

    What lies there is that of a run that was killed: it is set aside, unless that run ``goes_on``.
    Yields also where it is then. Raises KoordError.
    """
    files = {pid: folder / f"{pid}.jsonl" for pid in pids}
    try:
        aside = None if goes_on else _set_aside(folder)
        is_new = not folder.exists()
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise no_folder(folder, error) from None
    try:
        yield files, aside
    except (TransportError, CannotTakePartError):
        if is_new:
            remove(files.values())
        raise
    finally:
        with suppress(OSError):  # others' parts may be there
            folder.rmdir()


def _set_aside(folder: Path) -> Path | None:
    """Rename a folder in which there is anything; return its new name. Raises OSError."""
    if not folder.is_dir() or not any(folder.iterdir()):
        return None
    names = (folder.with_name(f"{folder.name}.{n}") for n in count(1))
    aside = next(name for name in names if not name.exists())
    return folder.rename(aside)


def merging(folder: Path, trace: str) -> str:
    """The command that merges the parts in a folder."""
    return f"koord merge {quote(str(folder))}/*.jsonl -o {quote(trace)}"


def remove(files: Iterable[Path]) -> None:
    """Remove the files of parts, and their folder if nothing else is there."""
    folders = set()
    for file in files:
        file.unlink(missing_ok=True)
        folders.add(file.parent)
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


class PartTail(Struct):
    """What is new in a part that grows."""

    file: Path
    read: int = 0

    def lines(self) -> list[bytes]:
        """The whole lines that were added since the last call, without their ends."""
        if not self.file.exists():
            return []
        with self.file.open("rb") as part:
            part.seek(self.read)
            new, end, _ = part.read().rpartition(b"\n")
        self.read += len(new) + len(end)
        return new.split(b"\n") if end else []
