"""A server of OpenSSH on the loopback, for the user who runs the tests, with a home of its own."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType

import pytest

#: Where Debian and Fedora have what serves files.
_SFTP = ("/usr/lib/openssh/sftp-server", "/usr/libexec/openssh/sftp-server")

SSHD = shutil.which("sshd", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin")

needs_sshd = pytest.mark.skipif(
    SSHD is None or not any(map(os.path.exists, _SFTP)),
    reason="OpenSSH's server is not installed (Debian: apt-get install openssh-server)",
)

_SERVER = """\
Port {port}
ListenAddress 127.0.0.1
HostKey {folder}/host
PidFile {folder}/sshd.pid
AuthorizedKeysFile {folder}/id.pub
AuthenticationMethods publickey
UsePAM no
StrictModes no
PermitRootLogin prohibit-password
Subsystem sftp {sftp}
ForceCommand {folder}/command
"""

#: The home of robots is not that of who tests.
_COMMAND = """#!/bin/sh
HOME={folder}/home && export HOME && cd "$HOME" && exec sh -c "$SSH_ORIGINAL_COMMAND"
"""

_CLIENT = """\
Host 127.0.0.1
  Port {port}
  IdentityFile {folder}/id
  IdentityAgent none
  UserKnownHostsFile {folder}/known
"""

_KOORD = """#!/bin/sh
PYTHONPATH={root} exec {python} -m koord "$@"
"""


class OpenSsh:
    """The server, with its keys and the configuration of who logs in."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.config = folder, folder / "config"
        self.home = folder / "home"
        self.home.mkdir()
        values = {
            "folder": folder,
            "port": _free_port(),
            "sftp": next(one for one in _SFTP if os.path.exists(one)),
            "root": Path(__file__).parents[2],
            "python": sys.executable,
        }
        for name in ("id", "host"):
            words = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)]
            subprocess.run(words, check=True)
        key = (folder / "host.pub").read_text("utf-8")
        (folder / "known").write_text("[127.0.0.1]:{port} ".format(**values) + key, "utf-8")
        for name, text in (("sshd_config", _SERVER), ("config", _CLIENT)):
            (folder / name).write_text(text.format(**values), "utf-8")
        for path, text in ((folder / "command", _COMMAND), (self.home / "koord", _KOORD)):
            path.write_text(text.format(**values), "utf-8")
            path.chmod(0o755)

    def __enter__(self) -> OpenSsh:
        assert SSHD is not None
        if os.geteuid() == 0:
            Path("/run/sshd").mkdir(exist_ok=True)  # as its service makes it
        words = [SSHD, "-D", "-f", str(self.folder / "sshd_config")]
        words += ["-E", str(self.folder / "sshd.log")]
        self._process = subprocess.Popen(words)
        ends_at = time.monotonic() + 10.0
        while not (self.folder / "sshd.pid").exists():
            assert time.monotonic() < ends_at, (self.folder / "sshd.log").read_text("utf-8")
            time.sleep(0.02)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        for file in self.home.glob(".koord/runs/*/*/*.pid"):
            if not file.with_suffix(".code").exists():
                os.kill(int(file.read_text("utf-8")), signal.SIGKILL)
        self.cut()
        self._process.terminate()
        self._process.wait(10.0)

    def cut(self) -> None:
        """Cut all connections that there are; others can be made."""
        words = ["ps", "-o", "pid=", "--ppid", str(self._process.pid)]
        for pid in subprocess.run(words, capture_output=True, text=True).stdout.split():
            os.kill(int(pid), signal.SIGKILL)

    def files(self, name: str) -> list[Path]:
        """Files of runs, in the order of robots."""
        return sorted(self.home.glob(f".koord/runs/*/*/{name}"))


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
        return port
