"""``koord order CONFIG stop|start|land|reset``: what people say to robots that run."""

from __future__ import annotations

import argparse

from koord.api.orders import ORDERS, order
from koord.cli.estop import EXITS, add_callees, show


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "config", metavar="CONFIG", help="the configuration with which they were deployed"
    )
    parser.add_argument(
        "order",
        choices=[one.value for one in ORDERS],
        help="stop: hold until start, and land or stop for good after a while; start: go on; "
        "land: end where they are; reset: after an e-stop, before start",
    )
    add_callees(parser)
    parser.epilog = f"{EXITS}. `koord estop CONFIG` stops robots at once"


def main(arguments: argparse.Namespace) -> int:
    report = order(
        arguments.config,
        arguments.order,
        site=arguments.site,
        robots=arguments.robots,
        timeout_s=arguments.timeout,
    )
    return show(report, arguments)
