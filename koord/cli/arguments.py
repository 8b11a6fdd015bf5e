"""Converters of flags: each checks a value, with a message that says what would be right.

The functions are argparse ``type=`` converters: they raise ``ArgumentTypeError``, which ends as
``koord verify: error: argument --robots: …`` and exit code 2. A command may raise it too, where
two flags do not go together.
"""

from __future__ import annotations

import argparse
import re
from argparse import ArgumentTypeError
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import TYPE_CHECKING

from koord.api.progress import MOST_JOBS
from koord.api.robots import ANY_NUMBER, AS_STATED, FleetSize
from koord.cli.files import DASH
from koord.syntax.core import LEAST_DELTA_S, MOST_DELTA_S, MOST_ROBOTS, USUAL_ROBOTS
from koord.syntax.literals import NumberOutOfRangeError, read_number, read_value

if TYPE_CHECKING:
    from koord.syntax.literals import ParamValue

MOST_ROUNDS = 1_000_000_000
MOST_VIOLATIONS = 1_000
MOST_RUNS = 1_000_000
MOST_SWEPT = 1_000
#: Of times and paces; no clock and no timer counts further.
LEAST_MEASURE, MOST_MEASURE = Fraction(1, 10**9), 10**9

_NAME = r"[^\W\d]\w*\Z"
_RATIO = r"([+-]?[0-9]{1,100})/([0-9]{1,100})\Z"


def fleet(text: str) -> FleetSize:
    """Parse a fleet: ``3`` or ``Car=2,Drone=1``."""
    if "=" not in text:
        return FleetSize(_whole(text, "robots", 1, MOST_ROBOTS))
    kinds: dict[str, int] = {}
    for part in text.split(","):
        name, _, count = part.partition("=")
        if not re.match(_NAME, name):
            raise ArgumentTypeError(f"{name!r} is no kind of robot; write Car=2,Drone=1")
        if name in kinds:
            raise ArgumentTypeError(f"{name} is given twice")
        kinds[name] = _whole(count, name, 0, MOST_ROBOTS)
    total = sum(kinds.values())
    if not 1 <= total <= MOST_ROBOTS:
        raise ArgumentTypeError(f"there must be 1 to {MOST_ROBOTS} robots, not {total}")
    return FleetSize(total, tuple(kinds.items()))


def fleets(text: str) -> tuple[FleetSize, ...]:
    """Parse fleets: ``2..10``: one of each size; ``any``: every number of robots at once.

    Otherwise the one fleet that :func:`fleet` reads.
    """
    if text == "any":
        return (ANY_NUMBER,)
    low, dots, high = text.partition("..")
    if not dots:
        return (fleet(text),)
    if not low or not high:
        raise ArgumentTypeError(f"{text!r} is no sweep; write 2..10, or any")
    least = _whole(low, "robots", 1, MOST_ROBOTS)
    most = _whole(high, "robots", 1, MOST_ROBOTS)
    if most < least:
        raise ArgumentTypeError(f"{text!r} has no number of robots; write {most}..{least}")
    return tuple(FleetSize(total) for total in range(least, most + 1))


def rounds(text: str) -> int:
    """Parse a number of rounds; 0 means the first configuration only."""
    return _whole(text, "rounds", 0, MOST_ROUNDS)


def pids(text: str) -> tuple[int, ...]:
    """Robots by their pids, such as ``0,2``."""
    return tuple(_whole(one, "a pid", 0, MOST_ROBOTS - 1) for one in text.split(","))


def violations(text: str) -> int:
    return _whole(text, "violations", 1, MOST_VIOLATIONS)


def runs(text: str) -> int:
    return _whole(text, "runs", 1, MOST_RUNS)


def jobs(text: str) -> int:
    return _whole(text, "jobs", 1, MOST_JOBS)


def particles(text: str) -> int:
    return _whole(text, "particles", 2, MOST_RUNS)


def processes(text: str) -> int:
    return _whole(text, "processes", 1, MOST_JOBS)


def planners(text: str) -> int:
    return _whole(text, "planners", 0, MOST_JOBS)


def seed(text: str) -> int:
    return _whole(text, "a seed", 0, 2**64 - 1)


def seconds(text: str) -> float:
    """Parse a positive time in seconds, no longer than clocks can count."""
    return _measure(text.removesuffix("s"), text, " seconds")


def pace(text: str) -> float:
    """Parse the pace: seconds of a run per second of wall time."""
    return _measure(text, text, "")


def _measure(amount_text: str, text: str, unit: str) -> float:
    amount = number(amount_text)
    if amount <= 0:
        raise ArgumentTypeError(f"{text!r} is not more than 0{unit}")
    if not LEAST_MEASURE <= amount <= MOST_MEASURE:
        raise ArgumentTypeError(f"it must be from 1e-9 to 1e9{unit}, not {text!r}")
    return float(amount)


def delta(text: str) -> Fraction:
    """Parse the length of a round, exactly: ``0.1`` is a tenth."""
    amount = number(text)
    if amount <= 0:
        raise ArgumentTypeError(f"δ must be positive: {text!r} is not more than 0 seconds")
    if not LEAST_DELTA_S <= amount <= MOST_DELTA_S:
        raise ArgumentTypeError(f"δ must be from 1e-9 to 1e5 seconds, not {text!r}: write 0.1")
    return amount


def number(text: str) -> Fraction:
    """Parse an exact number: ``4``, ``0.25``, ``1e-3``, ``1/3``."""
    if ratio := re.match(_RATIO, text):
        if int(ratio[2]) == 0:
            raise ArgumentTypeError(f"{text!r} divides by zero")
        return Fraction(int(ratio[1]), int(ratio[2]))
    amount = _number(text)
    if amount is None:
        raise ArgumentTypeError(f"{text!r} is not a number")
    return Fraction(amount)


def _number(text: str) -> int | Fraction | None:
    """Parse a number; None if the text is none. One that is out of range is refused."""
    try:
        return read_number(text)
    except NumberOutOfRangeError as error:
        raise ArgumentTypeError(str(error)) from None


def setting(text: str) -> tuple[str, ParamValue]:
    """Parse ``name=value``: an int, a float, true or false, a word, or a list of them.

    Floats become exact fractions, as everywhere in the semantics.
    """
    left, equals, right = text.partition("=")
    if not equals:
        raise ArgumentTypeError(f"{text!r} has no value; write {left or 'name'}=value")
    if not re.match(_NAME, left):
        raise ArgumentTypeError(f"{left!r} is not the name of a param; write name=value")
    return left, value(right)


def value(text: str) -> ParamValue:
    """Parse a literal: ``4``, ``0.5``, ``true``, ``"text"``, ``pick``, ``[1, 2, [3]]``."""
    try:
        return read_value(text)
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from None


def sweep(text: str) -> tuple[str, tuple[ParamValue, ...]]:
    """Parse ``robots=2..8`` or ``speed=0.5,1``: a name and the values that it takes in turn."""
    left, equals, right = text.partition("=")
    if not equals or not re.match(_NAME, left):
        raise ArgumentTypeError(f"{text!r} is no sweep; write robots=2..8")
    low, dots, high = right.partition("..")
    if dots:
        least, most = _whole(low, left, 0, MOST_ROUNDS), _whole(high, left, 0, MOST_ROUNDS)
        if not least <= most < least + MOST_SWEPT:
            raise ArgumentTypeError(f"{right!r} is not from 1 to {MOST_SWEPT} values")
        return left, tuple(range(least, most + 1))
    values = value(f"[{right}]")
    assert isinstance(values, tuple)
    if not values:
        raise ArgumentTypeError(f"{text!r} has no values")
    return left, values


def until(text: str) -> tuple[str, float]:
    """Parse ``time=0.5``: a figure of runs, and how far its interval may reach."""
    name, equals, right = text.partition("=")
    reach = _number(right) if equals else None
    if reach is None or reach <= 0:
        raise ArgumentTypeError(f"{text!r} is no precision; write time=0.5")
    return name, float(reach)


def settings(pairs: Iterable[tuple[str, ParamValue]]) -> Mapping[str, ParamValue]:
    """The values of all ``--set``. Raises ArgumentTypeError if one name is given two values."""
    chosen: dict[str, ParamValue] = {}
    for key, given in pairs:
        if key in chosen and chosen[key] != given:
            raise ArgumentTypeError(f"--set gives {key} two values")
        chosen[key] = given
    return chosen


def _whole(text: str, what: str, least: int, most: int) -> int:
    amount = _number(text)
    if not isinstance(amount, int):
        raise ArgumentTypeError(f"{text!r} is not a whole number")
    if not least <= amount <= most:
        raise ArgumentTypeError(f"{what} must be from {least} to {most}, not {text}")
    return amount


# --- groups of flags that several commands share --------------------------------------------------


def add_files(parser: argparse.ArgumentParser, *, several: bool = True) -> None:
    """Add the argument of programs' files; standard input can be read once only."""
    parser.add_argument(
        "files" if several else "file",
        metavar="FILE",
        nargs="+" if several else None,
        help="a program (.krd); - is standard input",
    )


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add ``--set`` and ``--with``, which belong to reading a program."""
    parser.add_argument(
        "--set",
        dest="settings",
        metavar="NAME=VALUE",
        type=setting,
        action="append",
        default=[],
        help="the value of a param: tasks=10, speed=0.5, slow=true, 'spots=[1, 2]'",
    )
    parser.add_argument(
        "--with",
        dest="properties",
        metavar="FILE",
        action="append",
        default=[],
        help="a file of further properties; may be given several times",
    )


def add_bounds(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    """Add ``--robots``, ``--rounds``, ``--delta``, ``--seed``. Several fleets make a sweep."""
    more = "; 2..10: one after the other; any: every number of them at once" if several else ""
    parser.add_argument(
        "--robots",
        metavar="N",
        type=fleets if several else fleet,
        default=(AS_STATED,) if several else AS_STATED,
        help=f"how many robots, or how many of each kind: Car=2,Drone=1{more} "
        f"(as the program states with `param int numAgents`; else {USUAL_ROBOTS})",
    )
    parser.add_argument(
        "--rounds", metavar="R", type=rounds, default=20, help="how many rounds (20)"
    )
    parser.add_argument(
        "--delta",
        metavar="SECONDS",
        type=delta,
        help="the length of a round, exactly: 0.1 or 1/30 (as the program states with "
        "`param float delta`; else 0.1)",
    )
    parser.add_argument(
        "--seed", metavar="S", type=seed, default=0, help="what every random choice hangs on (0)"
    )


def add_site(parser: argparse.ArgumentParser) -> None:
    """Add the flag for what a configuration does not say. (P-SITE)"""
    parser.add_argument(
        "--site",
        metavar="FILE",
        help="what CONFIG does not say of the place: its world, the network, safety, ... (.yaml)",
    )


def add_json(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("--json", action="store_true", help=f"print {what} as JSON")


def add_sarif(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument(
        "--sarif",
        metavar="FILE",
        help=f"write {what} to FILE as SARIF 2.1.0 besides, for code hosts and editors",
    )


def add_trace(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument(
        "--trace",
        metavar="FILE",
        help=f"write {what} to FILE, as JSON; to FILE.itf.json in the form of TLA+ tools",
    )


def add_html(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument(
        "--html",
        metavar="FILE",
        help=f"show {what} in FILE, a page for browsers that loads nothing",
    )


def read_by(arguments: argparse.Namespace) -> list[str]:
    """The files that a command reads which runs a program with a configuration."""
    given = (arguments.file, arguments.config, arguments.site, *arguments.properties)
    return [path for path in given if path is not None]


def check_files(paths: Iterable[str]) -> None:
    """Check that standard input is read once only. Raises ArgumentTypeError."""
    if list(paths).count(DASH) > 1:
        raise ArgumentTypeError("- (standard input) is named twice")
