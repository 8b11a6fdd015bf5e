"""``koord estop [CONFIG]``: stop robots at once, whatever they do."""

from __future__ import annotations

import argparse

from koord.api.orders import USUAL_S, OrderReport, estop
from koord.cli.arguments import add_json, add_site, pids, seconds
from koord.cli.diagnostics import report_error
from koord.cli.exits import Exit
from koord.cli.terminal import visible
from koord.syntax.diagnostics import KoordError


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "config",
        metavar="CONFIG",
        nargs="?",
        help="the configuration with which they were deployed, with its key (all robots that you "
        "have deployed on this machine)",
    )
    add_callees(parser)
    parser.add_argument(
        "--test", action="store_true", help="stop nobody, and show who would have been stopped"
    )
    parser.epilog = (
        f"{EXITS}. Afterwards `koord order CONFIG reset` and `koord order CONFIG start` let robots "
        "move again. This is no replacement of a switch that takes the power away"
    )


#: The exit codes of orders.
EXITS = "exit codes: 0 all robots have answered, and have done it, 1 not all, 2 errors in the input"


def add_callees(parser: argparse.ArgumentParser) -> None:
    """Add the flags that say who is called, and for how long."""
    add_site(parser)
    parser.add_argument(
        "--robots", metavar="PIDS", type=pids, help="these robots only, such as 0,2"
    )
    parser.add_argument(
        "--timeout",
        metavar="SECONDS",
        type=seconds,
        default=USUAL_S,
        help=f"call who does not answer for so long ({USUAL_S:g})",
    )
    add_json(parser, "what each robot answers")


def main(arguments: argparse.Namespace) -> int:
    report = estop(
        arguments.config,
        site=arguments.site,
        robots=arguments.robots,
        test=arguments.test,
        timeout_s=arguments.timeout,
    )
    return show(report, arguments)


def show(report: OrderReport, arguments: argparse.Namespace) -> int:
    """Show what robots answered; return the exit code."""
    if report.warnings:
        report_error(KoordError(report.warnings), as_json=False)
    if arguments.json:
        print(report.to_json())
    else:
        for line in table(report):
            print(visible(line))
    return Exit.OK if report.ok else Exit.VIOLATED


def table(report: OrderReport) -> list[str]:
    """The answers as a table, and who is missing."""
    width = max([len("robot"), *(len(str(one.pid)) for one in report.robots)])
    where = ""
    lines = [f"{'robot':>{width}}  {report.wanted.value}"]
    for one in report.robots:
        if one.where != where:
            where = one.where
            lines.append(where)
        lines.append(f"{one.pid:>{width}}  {one}")
    missing = [str(one.pid) for one in report.robots if not one.is_done]
    if missing:
        lines.append(f"NOT done by all: {', '.join(missing)}")
    elif not report.robots:
        lines.append("there was nobody to call")
    return lines
