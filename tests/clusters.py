"""Questions that wait for the test that asks them, and clusters in processes of this machine."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from msgspec import Struct

from koord.verify.helpers import PortableWork
from koord.verify.job_process import JobChannel

#: The folder that has koord and its tests.
ROOT = Path(__file__).parents[1]

#: A scheduler and workers that tell where they are, and end when nobody listens any more.
_CLUSTER = """
import sys
{first}
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers={workers}, threads_per_worker=1, dashboard_address=":0",
                      silence_logs=50, processes={processes}, protocol="tcp") as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""

#: What has to come first for workers to find no koord; they are threads of the scheduler's process.
WITHOUT_KOORD = """
from importlib import metadata
def version(name, found=metadata.version):
    if name == "koord":
        raise metadata.PackageNotFoundError(name)
    return found(name)
metadata.version = version
"""


class Squared(PortableWork, frozen=True):
    """A question that is answered at once."""

    number: int

    def __call__(self, tell: JobChannel) -> int:
        return self.number * self.number


class Refused(PortableWork, frozen=True):
    """A question that raises an error of the language, or a mistake of ours."""

    is_ours: bool

    def __call__(self, tell: JobChannel) -> int:
        from koord.syntax.diagnostics import refusal

        if self.is_ours:
            raise ZeroDivisionError
        raise refusal("K901", "file.krd", "there is no such file")


class Dying(PortableWork, frozen=True):
    """A question at which its process dies."""

    def __call__(self, tell: JobChannel) -> int:
        import signal

        tell.note("soon dead")
        os.kill(os.getpid(), signal.SIGKILL)
        return 0


class Held(PortableWork, frozen=True):
    """A question that tells who is at it by one pipe, and waits until another is written to."""

    begins: str
    goes_on: str
    number: int

    def __call__(self, tell: JobChannel) -> int:
        tell.note("begun")
        with open(self.begins, "w") as begins:
            begins.write(f"{os.getppid()} {os.getpid()}\n")
            begins.flush()
            with open(self.goes_on) as goes_on:
                goes_on.read()
        return self.number


class Pipes(Struct, frozen=True):
    """The two pipes of a held question."""

    begins: Path
    goes_on: Path

    @staticmethod
    def at(folder: Path) -> Pipes:
        """New pipes in a folder."""
        pipes = Pipes(folder / "begins", folder / "goes on")
        os.mkfifo(pipes.begins)
        os.mkfifo(pipes.goes_on)
        return pipes

    def held(self, number: int) -> Held:
        """The question that they hold."""
        return Held(str(self.begins), str(self.goes_on), number)

    def go_on(self) -> None:
        """Let the question go on."""
        self.goes_on.write_text("go on")


@contextmanager
def local_cluster(
    workers: int = 1, *, folder: Path = ROOT, first: str = ""
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A cluster of workers on loopback: its address, and the process that it hangs on.

    Workers have the koord of a ``folder``. What is to be done ``first`` is done for all of them.
    """
    script = _CLUSTER.format(workers=workers, first=first, processes=not first)
    process = subprocess.Popen(
        [sys.executable, "-c", script],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        cwd=folder,
    )
    assert process.stdout is not None
    with process:
        try:
            yield process.stdout.readline().strip(), process
        finally:
            process.communicate()


@contextmanager
def worker_of_this_process() -> Iterator[str]:
    """A cluster whose only worker is a thread of this process: its address."""
    import distributed

    local: Any = distributed.LocalCluster  # it says nothing of its types
    with local(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        protocol="tcp",
        dashboard_address=":0",
        silence_logs=50,
    ) as cluster:
        yield cluster.scheduler_address
