"""What robots have written on their own computers, brought here: parts, recordings, logs.

(P-SSH-GATHER)
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from koord.api.deployed import Deployed
from koord.api.deployed_parts import folder_of, merging, part_files, remove
from koord.api.files import no_folder, read_written, write_atomically
from koord.api.merge import merge
from koord.api.progress import Cancellation, CancelledError, Listener
from koord.runtime.records import DamagedRecordError, joined_records
from koord.runtime.remote.computer import Computer
from koord.runtime.remote.computers import Computers
from koord.runtime.remote.logins import RemoteError
from koord.syntax.diagnostics import Diagnostic, KoordError, refusal
from koord.syntax.source import visible

#: What a robot writes in the folder of the run on its computer.
PART, RECORD, LOG = "part.jsonl", "run.mcap", "deploy.log"


class Gathered(Struct, frozen=True):
    """Files of one name of all robots: those that are here by pid, and why others are not."""

    files: Mapping[int, Path]
    missing: tuple[Diagnostic, ...] = ()


class Gathering(Struct, frozen=True):
    """The files that people want of a run; None: they do not."""

    trace: str | None
    record: str | None
    logs: str | None
    name: str  #: of the configuration, for messages

    def fetch(self, computers: Computers, name: str, folder: Path, ending: str) -> Gathered:
        """Fetch a file of each robot to a folder. Raises KoordError."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise no_folder(folder, error) from None
        targets = {pid: folder / f"{pid}{ending}" for pid in computers.all}

        async def fetched(pid: int, computer: Computer) -> bool:
            try:
                return await computer.fetch(name, targets[pid])
            except OSError as error:
                raise RemoteError(f"{targets[pid]} cannot be written: {error.strerror}") from None

        found, wrong = computers.each(fetched, lambda: False)
        missing: list[Diagnostic] = []
        for pid, computer in computers.all.items():
            if not found.get(pid):
                why = wrong[pid].message if pid in wrong else "there is none"
                there = computer.place.file(name)
                story = f"{name} of robot {pid} was not fetched: {why}"
                hint = f"if there is one it is {there}, for scp" if pid in wrong else None
                missing += refusal("K946", self.name, story, hint).diagnostics
        files = {pid: targets[pid] for pid in sorted(found) if found[pid]}
        return Gathered(files, tuple(missing))

    def logged(self, ended: Deployed, computers: Computers) -> Deployed:
        """Fetch what robots have said, if that is wanted. Raises KoordError."""
        if self.logs is None:
            return ended
        gathered = self.fetch(computers, LOG, Path(self.logs), ".log")
        return replace(ended, unmerged=ended.unmerged + gathered.missing)

    def recorded(self, ended: Deployed, computers: Computers) -> Deployed:
        """Fetch recordings and make one of them, if that is wanted. Raises KoordError."""
        if self.record is None:
            return ended
        gathered = self.fetch(computers, RECORD, folder_of(self.record), ".mcap")
        missing = gathered.missing
        if gathered.files:
            try:
                raws = [read_written(str(file)) for file in gathered.files.values()]
                write_atomically(self.record, joined_records(raws))
                remove(gathered.files.values())
            except DamagedRecordError as error:
                story = f"the recordings in {folder_of(self.record)} cannot be joined: {error}"
                missing += refusal("K910", visible(self.record), story).diagnostics
            except KoordError as error:
                missing += error.diagnostics
        return replace(ended, unmerged=ended.unmerged + missing)

    def traced(
        self,
        ended: Deployed,
        computers: Computers,
        tell: Listener,
        cancellation: Cancellation | None,
    ) -> Deployed:
        """Fetch parts and make the trace of them, if that is wanted. Raises KoordError.

        Who cancels the run waits for its trace; who does so now does not.
        """
        if self.trace is None:
            return ended
        folder = folder_of(self.trace)
        with part_files(folder, computers.all) as (_, aside):
            gathered = self.fetch(computers, PART, folder, ".jsonl")
            ended = replace(
                ended,
                aside=None if aside is None else str(aside),
                unmerged=ended.unmerged + gathered.missing,
            )
            if not gathered.files:
                return ended
            try:
                merged = merge(
                    gathered.files.values(),
                    progress=tell,
                    cancellation=None if ended.interrupted else cancellation,
                )
                merged.trace.save(self.trace)
            except KoordError as error:
                unmerged = ended.unmerged + error.diagnostics
                return replace(ended, unmerged=unmerged, left=str(folder))
            except (CancelledError, KeyboardInterrupt):
                story = f"it was not made, as that was interrupted: parts are in {folder}"
                hint = merging(folder, self.trace)
                left = refusal("K918", visible(self.trace), visible(story), hint)
                unmerged = ended.unmerged + left.diagnostics
                return replace(ended, interrupted=True, unmerged=unmerged, left=str(folder))
            if merged.has_all_told and not gathered.missing:
                remove(gathered.files.values())
                return replace(ended, merged=merged)
            return replace(ended, merged=merged, left=str(folder))
