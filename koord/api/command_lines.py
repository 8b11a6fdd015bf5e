"""Requests for deployments as words of a command line: for another computer, for a service."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from fractions import Fraction

from koord.api.deploy_request import DeployRequest
from koord.runtime.deploy.supervision import STOP_S
from koord.syntax.literals import ParamValue, literal


def deploy_flags(
    request: DeployRequest, params: Mapping[str, ParamValue], delta_s: Fraction | None
) -> Iterator[str]:
    """Yield the flags of ``koord deploy`` that say what a request says, but for files.

    Whoever may arm was asked already: ``--yes`` is one of them.
    """
    if request.pid is not None:
        yield f"--pid={request.pid}"
    if request.rounds is not None:
        yield f"--rounds={request.rounds}"
    if delta_s is not None:
        yield f"--delta={delta_s}"
    if request.run is not None:
        yield f"--run={request.run}"
    if request.state is not None:
        yield f"--state={request.state}"
    if request.loss:
        yield f"--lose={request.loss!r}"
    flags = {
        "--as-fast-as-possible": request.as_fast_as_possible,
        "--fresh": request.fresh,
        "--dry-run": request.dry_run,
        "--arm": request.arm,
        "--yes": request.arm,
        "--preflight": request.preflight,
    }
    yield from (flag for flag, is_given in flags.items() if is_given)
    yield from (f"--allow-model={port}" for port in request.allow_models)
    yield from (f"--set={name}={literal(value)}" for name, value in params.items())


def systemd_unit(title: str, words: Iterable[str], folder: str) -> str:
    """The text of a unit of systemd that runs a command of koord in a folder. (P-UNIT)

    It has the time to land, ends its watchdog last, and is started again if it crashes: not if
    it was told to stop, nor if it refuses.
    """
    line = " ".join(map(_word, words))
    return f"""\
[Unit]
Description={title.replace("%", "%%")}
Wants=network-online.target
After=network-online.target

[Service]
WorkingDirectory={folder.replace("%", "%%")}
ExecStart={line}
KillMode=mixed
TimeoutStopSec={STOP_S + 5:g}
Restart=on-failure
RestartSec=2
RestartPreventExitStatus=1 2 3 129 130 143
SuccessExitStatus=143

[Install]
WantedBy=multi-user.target
"""


def _word(word: str) -> str:
    """A word as systemd reads it."""
    escaped = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return escaped if re.fullmatch(r"[\w@%+=:,./\\-]+", word) else f'"{escaped}"'
