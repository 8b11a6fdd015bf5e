"""The computer of one robot, over SSH. Needs ``koord[ssh]``. (P-SSH)"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any

import asyncssh

from koord.runtime.remote.connecting import CONNECT_S, connected
from koord.runtime.remote.logins import (
    RUNS,
    Login,
    LostError,
    RemoteEnd,
    RemoteError,
    RemoteFile,
    RemotePlace,
)
from koord.runtime.remote.scripts import (
    is_there_command,
    start_command,
    start_script,
    stop_command,
    version_command,
)

#: A copy may take so long, in seconds.
_COPY_S = 60.0

#: How often is looked what a command has said.
_LOOK_S = 0.2

#: How often a lost connection is tried again.
_AGAIN_S = 2.0

#: What is read at a time.
_BLOCK, _LARGE_BLOCK = 1 << 16, 1 << 20

#: What the shell answers for a command that is not there, or that it may not start.
_NO_COMMAND, _NO_PERMISSION = 127, 126


class Computer:
    """The computer of one robot, with the folder of the run there."""

    def __init__(
        self, pid: int, host: str, login: Login, folder: PurePosixPath, tell: Callable[[str], None]
    ) -> None:
        self.place = RemotePlace(host, folder)
        self.lost_at_s: float | None = None  #: since when there is no connection
        self.stops = False  #: what runs there is to be told to stop
        self.given_up = ""  #: why nobody waits for it any more
        self._login, self._tell = login, tell
        self._connection: asyncssh.SSHClientConnection | None = None
        self._sftp: asyncssh.SFTPClient | None = None

    # --- before the run -------------------------------------------------------------------------

    async def open(self, version: str) -> None:
        """Connect, and see that this version of koord is there. Raises RemoteError."""
        await self._first()
        koord = self._login.koord
        done = await self._run(version_command(koord))
        said = _text(done.stdout).strip()
        if done.returncode == _NO_COMMAND:
            story = f"there is no command {koord}"
            raise RemoteError(story, "install koord there, or say where it is: `koord=`")
        if done.returncode == _NO_PERMISSION:
            raise RemoteError(f"{koord} may not be executed there", "chmod +x, or `koord=`")
        if done.returncode != 0 or not said.startswith("koord "):
            shown = (_text(done.stderr).strip() or said or "nothing").splitlines()[-1][:200]
            story = f"`{koord} --version` ends with exit code {done.returncode}, and says: {shown}"
            raise RemoteError(story, "see what it does there, or say where koord is: `koord=`")
        there = said.removeprefix("koord ")
        if there != version:
            story = f"koord {there} is there, and {version} here"
            raise RemoteError(story, f"pip install koord=={version} there, or {there} here")

    async def copy(self, files: Iterable[RemoteFile]) -> None:
        """Copy files to the folder there, and see that they arrived. Raises RemoteError."""
        async with self._used(_COPY_S) as sftp:
            await self._make(sftp, self.place.folder)
            for file in files:
                await self._put(sftp, file)

    async def start(self, name: str, words: Sequence[str], *, has_key: bool) -> None:
        """Start a command there, which goes on whoever is connected. Raises RemoteError."""
        script = RemoteFile(f"{name}.sh", start_script(name, words, has_key=has_key))
        await self.copy([script])
        done = await self._run(start_command(self.place.folder, name))
        if done.returncode != 0:
            said = _text(done.stderr).strip() or f"exit code {done.returncode}"
            raise RemoteError(f"{name}.sh cannot be started: {said}")

    async def runs(self) -> tuple[str, ...]:
        """The folders of runs there in which this robot was started. Raises RemoteError."""
        async with self._used(CONNECT_S) as sftp:
            names = await sftp.listdir(str(RUNS)) if await sftp.exists(str(RUNS)) else ()
            own = self.place.folder.name
            found = [
                one for one in names if await sftp.exists(str(RUNS / one / own / "deploy.pid"))
            ]
        return tuple(found)

    def take_up(self, run: str) -> None:
        """Go on with a run that was started before."""
        self.place = RemotePlace(self.place.host, RUNS / run / self.place.folder.name)

    # --- while it runs --------------------------------------------------------------------------

    async def follow(self, name: str) -> RemoteEnd:
        """Tell what a command says, line by line, until it has ended or is given up.

        A connection that is lost is made again. (P-SSH-GOES-ON)
        """
        tail = _Tail(self.place.folder / f"{name}.log", self._tell)
        stopped = known = False
        while not self.given_up:
            try:
                if self.lost_at_s is not None:
                    await self._again()
                    known = False
                if not known:
                    await self._find(name)
                    known = True
                async with self._used(CONNECT_S) as sftp:
                    code = await _code(sftp, self.place.folder / f"{name}.code")
                    await tail.read(sftp)
                    if code is not None:
                        tail.close()
                        printed = await _bytes(sftp, self.place.folder / f"{name}.out")
                        return RemoteEnd(code, printed, tail.last)
                if self.stops and not stopped:
                    await self._run(stop_command(self.place.folder, name))
                    stopped = True
                await asyncio.sleep(_LOOK_S)
            except LostError as lost:
                if not self.given_up:
                    self._is_lost(str(lost))
                    await asyncio.sleep(_AGAIN_S)
            except RemoteError as error:
                return RemoteEnd(None, lost=error.message)
        return RemoteEnd(None, lost=self.given_up)

    async def stop(self, name: str) -> None:
        """Tell a command once more to stop, which is: at once. Raises LostError."""
        await self._run(stop_command(self.place.folder, name))

    async def fetch(self, name: str, target: Path) -> bool:
        """Fetch a file; return whether it is there. Raises RemoteError and OSError."""
        part, path = target.with_name(f"{target.name}.part"), str(self.place.folder / name)
        try:
            if self.lost_at_s is not None:
                await self._connect()
            with part.open("wb") as copy:
                async with self._used(CONNECT_S) as sftp:
                    if not await sftp.exists(path):
                        return False
                while block := await self._read(path, copy.tell()):
                    copy.write(block)
            part.replace(target)
        except LostError as lost:
            raise RemoteError(str(lost)) from None
        finally:
            part.unlink(missing_ok=True)
        return True

    async def _read(self, path: str, offset: int) -> bytes:
        """Read a part of a file. Raises LostError and RemoteError."""
        async with self._used(CONNECT_S) as sftp, sftp.open(path, "rb") as file:
            return await _block(file, offset, _LARGE_BLOCK)

    def let_go(self) -> None:
        """Let go of the computer for good. What runs there goes on."""
        self.given_up = self.given_up or "nobody follows it"
        self._close()

    # --- the connection -------------------------------------------------------------------------

    def _close(self) -> None:
        if self._connection is not None:
            self._connection.abort()
        self._connection = self._sftp = None

    async def _first(self) -> None:
        """Connect. Raises RemoteError."""
        try:
            await self._connect()
        except LostError as lost:
            cure = "is it on, in this network, and is its SSH server running?"
            raise RemoteError(f"it cannot be reached: {lost}", cure) from None

    async def _again(self) -> None:
        """Connect anew. Raises LostError."""
        try:
            await self._connect()
        except RemoteError as error:  # of who has the address meanwhile
            raise LostError(error.message) from None
        self._tell("connected again")

    async def _find(self, name: str) -> None:
        """Raise RemoteError if a command has neither ended nor is running; and LostError."""
        done = await self._run(is_there_command(self.place.folder, name))
        if done.returncode != 0:
            raise RemoteError("its process is gone: the computer was started anew, say")

    async def _connect(self) -> None:
        """Connect. Raises RemoteError if it refuses, LostError if it does not answer."""
        self._close()
        self._connection = await connected(self.place.host, self._login)
        try:
            async with asyncio.timeout(CONNECT_S):
                self._sftp = await self._connection.start_sftp_client()
        except TimeoutError:
            raise LostError(f"no answer within {CONNECT_S:g} s") from None
        except asyncssh.SFTPError as error:
            raise RemoteError(f"it has no SFTP: {error.reason}", "as `Subsystem sftp`") from None
        except asyncssh.Error as error:
            raise LostError(error.reason) from None
        except OSError as error:
            raise LostError(error.strerror or str(error)) from None
        self.lost_at_s = None

    def _is_lost(self, why: str) -> None:
        self._close()
        if self.lost_at_s is None:
            self.lost_at_s = asyncio.get_running_loop().time()
            self._tell(f"the connection is lost ({why}): the robot goes on; connecting again …")

    async def _run(self, command: str) -> Any:
        """Run a short command there. Raises LostError."""
        if self._connection is None:
            raise LostError("there is no connection")
        try:
            async with asyncio.timeout(CONNECT_S):
                return await self._connection.run(command, check=False, stdin=asyncssh.DEVNULL)
        except TimeoutError:
            raise LostError(f"no answer within {CONNECT_S:g} s") from None
        except (asyncssh.DisconnectError, asyncssh.ChannelOpenError) as error:
            raise LostError(error.reason) from None
        except OSError as error:
            raise LostError(error.strerror or str(error)) from None

    @asynccontextmanager
    async def _used(self, limit_s: float | None) -> AsyncIterator[asyncssh.SFTPClient]:
        """Within the context files there are used. Raises LostError, and RemoteError."""
        if self._sftp is None:
            raise LostError("there is no connection")
        try:
            async with asyncio.timeout(limit_s):
                yield self._sftp
        except TimeoutError:
            raise LostError(f"no answer within {limit_s:g} s") from None
        except (asyncssh.SFTPConnectionLost, asyncssh.SFTPNoConnection) as error:
            raise LostError(error.reason) from None
        except asyncssh.SFTPError as error:
            raise RemoteError(f"{self.place.folder}: {error.reason}", _cure(error)) from None
        except asyncssh.DisconnectError as error:
            raise LostError(error.reason) from None
        except OSError as error:
            raise LostError(error.strerror or str(error)) from None

    async def _make(self, sftp: asyncssh.SFTPClient, folder: PurePosixPath) -> None:
        """Make a folder for its owner alone, and those around it."""
        for one in (*reversed(folder.parents[:-1]), folder):
            if not await sftp.exists(str(one)):
                # Of several robots on one computer another one may be quicker.
                with suppress(asyncssh.SFTPFailure, asyncssh.SFTPFileAlreadyExists):
                    await sftp.mkdir(str(one), asyncssh.SFTPAttrs(permissions=0o700))
        if not await sftp.isdir(str(folder)):
            raise RemoteError(f"{folder} cannot be made there", "is there room, and may you write?")

    async def _put(self, sftp: asyncssh.SFTPClient, file: RemoteFile) -> None:
        """Write a file for its owner alone, and compare what arrived. (P-SSH-COPY)"""
        path = self.place.folder / file.name
        await self._make(sftp, path.parent)
        attributes = asyncssh.SFTPAttrs(permissions=0o600)
        async with sftp.open(str(path), "wb", attributes) as there:
            await there.write(file.data)
        await sftp.chmod(str(path), 0o600)
        arrived = await _bytes(sftp, path)
        if arrived != file.data:
            story = (
                f"{path} did not arrive as it is here ({len(arrived)} of {len(file.data)} bytes)"
            )
            raise RemoteError(story, "is there room on its disk?")


class _Tail:
    """The lines of a file that grows."""

    def __init__(self, path: PurePosixPath, tell: Callable[[str], None]) -> None:
        self._path, self._tell = str(path), tell
        self._read, self._rest = 0, b""
        self.last = ""  #: the last line that is not empty

    async def read(self, sftp: asyncssh.SFTPClient) -> None:
        """Tell the lines that are new."""
        if not await sftp.exists(self._path):
            return
        async with sftp.open(self._path, "rb") as file:
            while block := await _block(file, self._read):
                self._read += len(block)
                *lines, self._rest = (self._rest + block).split(b"\n")
                for line in lines:
                    self._say(line)

    def close(self) -> None:
        """Tell the rest, which is no whole line."""
        if self._rest:
            self._say(self._rest)

    def _say(self, line: bytes) -> None:
        text = _text(line)
        self.last = text.strip() or self.last
        self._tell(text)


def _cure(error: asyncssh.SFTPError) -> str:
    if isinstance(error, asyncssh.SFTPPermissionDenied):
        return "who logs in there may not write it: chown, or another `user=`"
    return "is there room on its disk?"


async def _code(sftp: asyncssh.SFTPClient, path: PurePosixPath) -> int | None:
    if not await sftp.exists(str(path)):
        return None
    text = _text(await _bytes(sftp, path)).strip()
    return int(text) if text.isdigit() else None


async def _bytes(sftp: asyncssh.SFTPClient, path: PurePosixPath) -> bytes:
    async with sftp.open(str(path), "rb") as file:
        return await _block(file, size=-1)


async def _block(
    file: asyncssh.SFTPClientFile, offset: int | None = None, size: int = _BLOCK
) -> bytes:
    """Read a part of a file that was opened for bytes."""
    read: Any = await file.read(size, offset)
    return bytes(read)


def _text(raw: str | bytes | None) -> str:
    return raw.decode(errors="replace") if isinstance(raw, bytes) else raw or ""
