"""Connections by SSH, as OpenSSH is configured, and why there is none. (P-SSH)"""

from __future__ import annotations

import asyncio
import os
from shlex import quote
from typing import Any

import asyncssh

from koord.runtime.remote.logins import Login, LostError, RemoteError

#: A computer that does not answer for so long is not reached, in seconds.
CONNECT_S = 15.0

#: A connection that is silent is asked so often for a sign of life, and so many may be missing.
_ALIVE_S, _MOST_MISSING = 5, 3

#: The text of a file that knows no host.
_NOBODY = b"# nobody\n"


async def connected(host: str, login: Login) -> asyncssh.SSHClientConnection:
    """Connect. Raises RemoteError if that is refused, LostError if nobody answers."""
    options = _options(host, login)
    try:
        async with asyncio.timeout(CONNECT_S):
            return await asyncssh.connect(host, options=options)
    except TimeoutError:
        raise LostError(f"no answer within {CONNECT_S:g} s") from None
    except asyncssh.HostKeyNotVerifiable:
        story = "its host key is not known here, or is another one than it was"
        cure = (
            f"`ssh {_named(login, host)}` shows its fingerprint: compare, and say yes; if "
            f"the computer was set up anew, `ssh-keygen -R {host}` forgets the old one first"
        )
        raise RemoteError(story, cure) from None
    except asyncssh.PermissionDenied:
        cure = (
            f"`ssh-copy-id {_named(login, host)}`, or say `user=`, `identity=`; a key "
            "with a passphrase has to be in the agent: `ssh-add`"
        )
        raise RemoteError("none of your keys is accepted there", cure) from None
    except asyncssh.DisconnectError as error:
        raise LostError(error.reason) from None
    except OSError as error:
        raise LostError(error.strerror or str(error)) from None


def _options(host: str, login: Login) -> asyncssh.SSHClientConnectionOptions:
    """How to connect. Raises RemoteError."""
    config: Any = () if login.config is None else [login.config]
    keys: Any = () if login.identity is None else [login.identity]
    try:
        options = asyncssh.SSHClientConnectionOptions(
            host=host,
            config=config,
            username=() if login.user is None else login.user,
            client_keys=keys,
            password=None,
            preferred_auth="publickey",
            keepalive_interval=_ALIVE_S,
            keepalive_count_max=_MOST_MISSING,
        )
    except (asyncssh.KeyImportError, asyncssh.KeyEncryptionError) as error:
        cure = "a key with a passphrase: `ssh-add FILE`, and leave `identity=` out"
        raise RemoteError(f"the key cannot be used: {error}", cure) from None
    except asyncssh.ConfigParseError as error:
        raise RemoteError(f"OpenSSH's configuration cannot be read: {error}") from None
    except OSError as error:
        story = f"{error.filename} cannot be read: {error.strerror}"
        raise RemoteError(story, "see `identity=`, `config=`") from None
    if options.known_hosts is None:
        story = "OpenSSH's configuration says that no host key is to be verified"
        raise RemoteError(story, "leave out `UserKnownHostsFile none` for this host")
    if isinstance(options.known_hosts, list):
        # As OpenSSH has it, a file that is not there knows nobody.
        there = [file for file in options.known_hosts if os.path.exists(file)]
        known: Any = there or _NOBODY
        return asyncssh.SSHClientConnectionOptions(options, known_hosts=known)
    return options


def _named(login: Login, host: str) -> str:
    """A host, as commands of OpenSSH take it."""
    config = "" if login.config is None else f"-F {quote(login.config)} "
    return config + (host if login.user is None else f"{login.user}@{host}")
