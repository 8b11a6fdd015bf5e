"""``koord conform``: the conformance kit, on a driver."""

from __future__ import annotations

import argparse
import os
import sys
import textwrap
from argparse import ArgumentTypeError
from typing import TYPE_CHECKING

from koord.api.conform import Conformance, ConformRequest, conform_request, read_options, told
from koord.cli.arguments import add_json
from koord.cli.exits import Exit
from koord.cli.progress import Interruption, LiveLine
from koord.cli.terminal import Paint, Style, style_of, visible
from koord.syntax.source import counted

if TYPE_CHECKING:
    from koord.api.conform import Finding

#: The widest verdict and the widest name of a check.
_VERDICT, _NAME = 8, 13

_PAINTS = {"passed": Paint.ADDED, "failed": Paint.ERROR, "skipped": Paint.WARNING}


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--driver", metavar="NAME", help="a name that `koord drivers` lists, or module:object"
    )
    parser.add_argument(
        "--options", metavar="FILE", help="the driver's options, as under `options:` (.yaml)"
    )
    parser.add_argument(
        "--peer",
        metavar="PEER",
        help="the other side of its wire: px4, ardupilot, crazyflie, ros1, ros2, or a command, "
        "which is started, frozen and ended",
    )
    parser.add_argument("--vehicle", metavar="TYPE", help="the type of vehicle: CAR, DIFF, QUAD")
    parser.add_argument(
        "--at", metavar="X,Y,Z", type=_point, help="where the vehicle stands, in metres"
    )
    parser.add_argument(
        "--heading", metavar="RAD", type=float, default=0.0, help="where it points to, from east"
    )
    parser.add_argument(
        "--room", metavar="M", type=float, default=4.0, help="so much room is about it (4)"
    )
    parser.add_argument(
        "--arm", action="store_true", help="let a vehicle move that is no simulated one: up to 2 m"
    )
    parser.add_argument(
        "--virtual-time",
        action="store_true",
        default=None,
        help="the vehicle is in this process, and moves by the times that its driver is told",
    )
    parser.add_argument(
        "--only", metavar="CHECK", action="append", default=[], help="make this check; repeatable"
    )
    parser.add_argument(
        "-j",
        "--jobs",
        metavar="N",
        type=int,
        default=1,
        help="make so many groups of checks at once, each against a peer of its own (1; 10 are "
        "all); a command has {free}, {domain} or {job} for that, and so have the options",
    )
    add_json(parser, "what the checks found")
    parser.epilog = (
        "exit codes: 0 no check failed, 1 a check failed, 2 a mistake in the arguments or the "
        "options, 3 all checks were skipped, 130 ended by Ctrl-C: the vehicle is brought to rest "
        "first. Checks that are skipped say why, and what would let them be made"
    )


def main(arguments: argparse.Namespace) -> int:
    sys.path.insert(0, os.getcwd())  # of a driver that is not installed
    request = ConformRequest(
        driver=arguments.driver,
        options=None if arguments.options is None else read_options(arguments.options),
        vehicle=arguments.vehicle,
        peer=arguments.peer,
        at_m=arguments.at,
        heading_rad=arguments.heading,
        room_m=arguments.room,
        arm=arguments.arm,
        virtual_time=arguments.virtual_time,
        only=tuple(arguments.only),
        jobs=arguments.jobs,
    )
    style = style_of(sys.stdout)
    with Interruption(patient=True) as interruption, LiveLine(sys.stderr) as line:

        def show(finding: Finding) -> None:
            if not arguments.json:
                line.clear()
                print("\n".join(_lines(finding, style)), flush=True)

        conformance = conform_request(
            request, lambda told: line.show(told.message), interruption, show
        )
    print(conformance.to_json() if arguments.json else _summary(conformance))
    return _code(conformance)


def _lines(finding: Finding, style: Style) -> list[str]:
    verdict = finding.verdict.value
    head = style.paint(f"{verdict:<{_VERDICT}}", _PAINTS[verdict])
    gap = " " * (_VERDICT + _NAME)
    wrapped = textwrap.wrap(visible(told(finding)), style.width - len(gap)) or [""]
    return [f"{head}{finding.check:<{_NAME}}{wrapped[0]}", *(f"{gap}{one}" for one in wrapped[1:])]


def _summary(conformance: Conformance) -> str:
    found = [counted(len(conformance.findings), "check")]
    found += [
        f"{number} {verdict}"
        for verdict in ("passed", "failed", "skipped")
        if (number := conformance.count(verdict))
    ]
    if conformance.interrupted:
        found.append("interrupted")
    return f"{visible(conformance.driver)}, {conformance.vehicle}: {', '.join(found)}"


def _code(conformance: Conformance) -> Exit:
    if conformance.failed:
        return Exit.VIOLATED
    if conformance.interrupted:
        return Exit.INTERRUPTED
    return Exit.OK if conformance.ok else Exit.UNKNOWN


def _point(text: str) -> tuple[float, float, float]:
    try:
        x, y, *z = (float(word) for word in text.split(","))
        (up,) = z or [0.0]
    except ValueError:
        raise ArgumentTypeError(f"{text!r} is no place; write 1.0,2.0,0.0") from None
    return x, y, up
