"""Computers of robots for tests: SSH servers in this process, with a `koord` that acts as told."""

from __future__ import annotations

import asyncio
import errno
import os
import threading
from collections.abc import Coroutine
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import asyncssh

from koord.version import __version__

T = TypeVar("T")

#: Acts as the files in its home say: `version`, `says` (on standard error), `prints`, `code`; it
#: goes on until `go` is there, or until it is told to stop. It notes its words and its signals.
_KOORD = """#!/bin/sh
if [ "$1" = --version ]; then echo "koord $(cat ~/version)"; exit 0; fi
kind=deploy
for word; do
    echo "$word" >>~/words
    [ "$word" = --preflight ] && kind=preflight
done
echo "${KOORD_KEY-none}" >~/key
trap 'echo TERM >>~/signals; echo "stops safely" >&2; stopped=1' TERM
cat ~/says >&2
stopped=
until [ -e ~/go ] || [ "$stopped" ]; do sleep 0.02; done
[ "$stopped" ] && sleep 0.2  # a second signal would be noted as well
[ -e ~/part ] && cp ~/part part.jsonl
[ -e ~/record ] && cp ~/record run.mcap
cat ~/$kind.json
exit "$(cat ~/code)"
"""


class _Files(asyncssh.SFTPServer):
    """Files of a home, on a disk that may be full, or that nobody may write."""

    def __init__(self, channel: Any, computer: FakeComputer) -> None:
        super().__init__(channel, chroot=os.fsencode(computer.home))
        self._computer = computer

    def write(self, file_obj: object, offset: int, data: bytes) -> Any:
        if self._computer.disk == "full":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if self._computer.disk == "forbidden":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        kept = data[:-1] if self._computer.disk == "forgetful" else data
        super().write(file_obj, offset, kept)
        return len(data)


class FakeComputer:
    """A robot's computer: an address, a home, and what its `koord` does."""

    def __init__(self, host: str, home: Path) -> None:
        self.host, self.home, self.disk = host, home, "good"
        self.port = 0
        self.host_key = asyncssh.generate_private_key("ssh-ed25519")
        self.connections: set[Any] = set()
        self.listener: asyncssh.SSHAcceptor | None = None
        home.mkdir()
        koord = home / "koord"
        koord.write_text(_KOORD, "utf-8")
        koord.chmod(0o755)
        self.acts(version=__version__, says="", code="0")
        self.acts(**{"deploy.json": "", "preflight.json": "", "go": ""})

    def acts(self, **texts: str) -> None:
        """Say what its `koord` does."""
        for name, text in texts.items():
            (self.home / name).write_text(text, "utf-8")

    def waits(self) -> None:
        """Let its `koord` go on until it is told to stop."""
        (self.home / "go").unlink()

    def noted(self, name: str) -> list[str]:
        """The lines that its `koord` has noted."""
        file = self.home / name
        return file.read_text("utf-8").split("\n")[:-1] if file.exists() else []

    def files(self, pattern: str) -> list[Path]:
        """Files of the run in its home."""
        return sorted((self.home / ".koord" / "runs").glob(f"*/*/{pattern}"))


class FakeFleet:
    """Computers with one user, who has a key. Within the context their servers run."""

    def __init__(self, folder: Path, robots: int) -> None:
        self.folder = folder
        self.key = asyncssh.generate_private_key("ssh-ed25519")
        self.accepted = [self.key]
        self.computers = [
            FakeComputer(f"127.0.0.{pid + 1}", folder / f"home{pid}") for pid in range(robots)
        ]
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)

    def __enter__(self) -> FakeFleet:
        self._thread.start()
        for one in self.computers:
            self.listen(one)
        self.key.write_private_key(self.folder / "id")
        (self.folder / "id").chmod(0o600)
        self.know(*self.computers)
        hosts = [f"Host {one.host}\n  Port {one.port}\n" for one in self.computers]
        every = f"Host *\n  IdentityFile {self.folder}/id\n  IdentityAgent none\n"
        every += f"  UserKnownHostsFile {self.folder}/known\n"
        (self.folder / "config").write_text("".join(hosts) + every, "utf-8")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        for one in self.computers:
            one.acts(go="")  # nothing goes on there
            self.cut(one)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def know(self, *computers: FakeComputer) -> None:
        """Know the host keys of these, and no others."""
        lines = [
            f"[{one.host}]:{one.port} {one.host_key.export_public_key().decode()}"
            for one in computers
        ]
        (self.folder / "known").write_text("".join(lines), "utf-8")

    def listen(self, computer: FakeComputer) -> None:
        """Let a computer be reached."""
        computer.listener = self._done(self._listening(computer))
        computer.port = computer.listener.get_port()

    def cut(self, computer: FakeComputer) -> None:
        """Cut all connections to a computer, and let it be reached no more."""
        self._done(self._cut(computer))

    def _done(self, coroutine: Coroutine[object, object, T]) -> T:
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop).result(10.0)

    async def _listening(self, computer: FakeComputer) -> asyncssh.SSHAcceptor:
        class Server(asyncssh.SSHServer):
            def connection_made(self, conn: Any) -> None:
                computer.connections.add(conn)

        return await asyncssh.listen(
            computer.host,
            computer.port,
            server_factory=Server,
            server_host_keys=[computer.host_key],
            authorized_client_keys=asyncssh.import_authorized_keys(
                "".join(key.export_public_key().decode() for key in self.accepted)
            ),
            process_factory=lambda process: self._run(computer, process),
            sftp_factory=lambda channel: _Files(channel, computer),
            encoding=None,
            reuse_address=True,
        )

    async def _run(self, computer: FakeComputer, process: Any) -> None:
        path = os.environ["PATH"]
        child = await asyncio.create_subprocess_shell(
            process.command,
            cwd=computer.home,
            env={"HOME": str(computer.home), "PATH": path},
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        out, err = await child.communicate()
        process.stdout.write(out)
        process.stderr.write(err)
        process.exit(child.returncode)

    async def _cut(self, computer: FakeComputer) -> None:
        if computer.listener is not None:
            computer.listener.close()
            await computer.listener.wait_closed()
            computer.listener = None
        for one in computer.connections:
            one.abort()
        computer.connections.clear()
