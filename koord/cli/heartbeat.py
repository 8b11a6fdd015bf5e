"""``koord heartbeat [CONFIG]``: robots move for as long as this runs: a dead-man's switch."""

from __future__ import annotations

import argparse
import select
import sys
from contextlib import suppress

from koord.api.orders import HeartbeatHeard, RobotAnswer, heartbeat
from koord.api.progress import Progress
from koord.cli.arguments import add_site, pids
from koord.cli.estop import table
from koord.cli.exits import Exit
from koord.cli.progress import Interruption
from koord.cli.terminal import is_terminal, visible


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "config",
        metavar="CONFIG",
        nargs="?",
        help="the configuration with which they are deployed, with its key (all robots that you "
        "deploy on this machine)",
    )
    add_site(parser)
    parser.add_argument(
        "--robots", metavar="PIDS", type=pids, help="these robots only, such as 0,2"
    )
    parser.epilog = (
        "Robots whose configuration says `safety: {heartbeat: 1}` move only while they hear this "
        "command, and hold a second after it ends, is killed, or loses the network. On a terminal "
        "Enter is an e-stop. exit codes: 130 ended with Ctrl-C, 143 by SIGTERM, 129 by SIGHUP, 0 "
        "after an e-stop that all robots have answered, 1 not all, 2 errors in the input"
    )


def main(arguments: argparse.Namespace) -> int:
    watched = is_terminal(sys.stdin)
    if watched:
        print("heartbeats; Enter is an e-stop, Ctrl-C lets robots hold", flush=True)
    with Interruption(patient=True) as interruption:
        board = _Board()
        report = heartbeat(
            arguments.config,
            site=arguments.site,
            robots=arguments.robots,
            pressed=_is_pressed if watched else None,
            progress=board.show,
            cancellation=interruption,
        )
    if report is None:
        return Exit.INTERRUPTED
    for line in table(report):
        print(visible(line))
    return Exit.OK if report.ok else Exit.VIOLATED


def _is_pressed() -> bool:
    """Return whether somebody has pressed Enter; a terminal that has gone away counts as well."""
    with suppress(OSError, ValueError):
        if not select.select([sys.stdin], [], [], 0)[0]:
            return False
        sys.stdin.readline()
    return True


class _Board:
    """Lines of what changes about robots."""

    def __init__(self) -> None:
        self._said: dict[int, str] = {}

    def show(self, told: Progress) -> None:
        if isinstance(told, HeartbeatHeard):
            for one in told.robots:
                self._say(one)

    def _say(self, one: RobotAnswer) -> None:
        text = "does not answer" if one.state is None else one.state
        if self._said.get(one.pid) != text:
            self._said[one.pid] = text
            print(visible(f"robot {one.pid}: {text}"), flush=True)
