"""``koord deploy --ssh`` and ``--systemd``: robots on their own computers. (P-SSH, P-UNIT)"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from argparse import ArgumentTypeError
from pathlib import Path

from koord.api.command_lines import deploy_flags, systemd_unit
from koord.api.deploy_request import DeployRequest
from koord.api.deployed import Deployed
from koord.api.progress import Progress
from koord.api.remote import Login, RemoteLine, RemoteRequest, deploy_over_ssh
from koord.cli.arguments import settings
from koord.cli.deployed import Board
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.files import DASH
from koord.cli.fitting import fit_request, fitted
from koord.cli.preflight import Question
from koord.cli.progress import Interruption
from koord.cli.terminal import visible

#: What only has a meaning with ``--ssh``: the argument, and its flag.
_OF_SSH = {
    "user": "--user",
    "identity": "--identity",
    "koord": "--koord",
    "ssh_config": "--ssh-config",
    "logs": "--logs",
    "attach": "--attach",
}


def add_ssh(parser: argparse.ArgumentParser) -> None:
    """Add the flags of robots' own computers."""
    parser.add_argument(
        "--ssh",
        action="store_true",
        help="run all robots, each on its own computer: that at the ip of its device",
    )
    parser.add_argument(
        "--user", metavar="NAME", help="with --ssh: who logs in (as OpenSSH is configured)"
    )
    parser.add_argument(
        "--identity", metavar="FILE", help="with --ssh: a private key (as OpenSSH is configured)"
    )
    parser.add_argument(
        "--koord", metavar="PATH", help="with --ssh: the command there, ~/ is the home (koord)"
    )
    parser.add_argument("--ssh-config", metavar="FILE", help="with --ssh: instead of ~/.ssh/config")
    parser.add_argument(
        "--logs", metavar="DIR", help="with --ssh: keep what each robot says, as DIR/PID.log"
    )
    parser.add_argument(
        "--attach",
        action="store_true",
        help="with --ssh: start nothing, and take the last run there up: follow it, stop it with "
        "Ctrl-C, fetch what it has written",
    )
    parser.add_argument(
        "--systemd",
        action="store_true",
        help="with --pid: print a unit of systemd that runs this command, and end",
    )


def check_ssh(arguments: argparse.Namespace) -> None:
    """Raise ArgumentTypeError for flags that do not go together."""
    if arguments.systemd and arguments.pid is None:
        raise ArgumentTypeError("--systemd prints the unit of one robot: say --pid I")
    if not arguments.ssh:
        for name, flag in _OF_SSH.items():
            if getattr(arguments, name):
                raise ArgumentTypeError(f"{flag} is for --ssh, which is not there")
        return
    if arguments.attach and (arguments.arm or arguments.preflight):
        raise ArgumentTypeError("--attach starts nothing: leave --arm and --preflight out")
    if arguments.restart:
        raise ArgumentTypeError("--restart is for processes on this machine: see --systemd")
    if arguments.live is not None:
        raise ArgumentTypeError("--live is not for --ssh: robots show their own page with --pid")


def run_over_ssh(arguments: argparse.Namespace, request: DeployRequest) -> Deployed | None:
    """Run robots on their own computers; None: there were errors, which are printed.

    Raises KoordError.
    """
    report = DiagnosticReport()
    wanted = fit_request(arguments, report, located=not request.dry_run)
    found = None if wanted is None else fitted(wanted, report)
    report.print(sys.stderr, as_json=False)
    if wanted is None or found is None:
        return None
    if not arguments.json:
        print(visible(str(found.problem)), flush=True)
    koord = arguments.koord or "koord"
    login = Login(arguments.user, arguments.identity, koord, arguments.ssh_config)
    run = RemoteRequest(wanted, found, request, login, arguments.logs, arguments.attach)
    question = Question(answer=True if arguments.yes else None)
    with Interruption(patient=True) as interruption, Board() as board:

        def show(told: Progress) -> None:
            if isinstance(told, RemoteLine):
                board.announce(told.message)
            else:
                board.say(told.message)

        return deploy_over_ssh(run, show, interruption, approve=question.ask)


def print_unit(arguments: argparse.Namespace, request: DeployRequest) -> int:
    """Print a unit of systemd for one robot. Raises ArgumentTypeError. (P-UNIT)"""
    if DASH in (arguments.file, arguments.config, arguments.site, *arguments.properties):
        raise ArgumentTypeError("--systemd: a service has no standard input, name files")
    if arguments.arm and not arguments.yes:
        raise ArgumentTypeError("--systemd: nobody can be asked when it starts: --arm needs --yes")
    koord = shutil.which(sys.argv[0]) or sys.argv[0]
    files = [f"--with={Path(one).resolve()}" for one in arguments.properties]
    if arguments.site is not None:
        files.append(f"--site={Path(arguments.site).resolve()}")
    files += [f"{flag}={Path(path).resolve()}" for flag, path in _kept(request) if path]
    params = settings(arguments.settings)
    words = (
        str(Path(koord).resolve()),
        "deploy",
        *(str(Path(one).resolve()) for one in (arguments.file, arguments.config)),
        *deploy_flags(request, params, arguments.delta),
        *files,
    )
    title = f"koord: robot {arguments.pid} of {Path(arguments.file).name}"
    print(systemd_unit(title, words, os.getcwd()), end="")
    return 0


def _kept(request: DeployRequest) -> tuple[tuple[str, str | None], ...]:
    return (
        ("--trace", request.trace),
        ("--record", request.record),
        ("--rests-on", request.rests_on),
    )
