"""What was found before anything is armed, as a table, and the question whether to arm."""

from __future__ import annotations

import argparse
import json
import select
import sys
from argparse import ArgumentTypeError
from contextlib import suppress

from koord.api.preflight import Check, Finding, Preflight
from koord.cli.exits import Exit
from koord.cli.terminal import Paint, Style, is_terminal, style_of, visible

_PAINTS = {
    Finding.GOOD: None,
    Finding.DOUBTFUL: Paint.WARNING,
    Finding.BAD: Paint.ERROR,
    Finding.PENDING: Paint.NOTE,
}


def check_answerable(arguments: argparse.Namespace) -> None:
    """Raise ArgumentTypeError if a question will be asked that nobody can answer."""
    if arguments.yes and not arguments.arm:
        raise ArgumentTypeError("--yes answers the question of --arm, which is not there")
    asks = arguments.arm and not (arguments.yes or arguments.preflight or arguments.dry_run)
    if asks and not is_terminal(sys.stdin):
        raise ArgumentTypeError(
            "--arm asks before anything is armed, and there is no terminal to answer on: say --yes "
            "to answer in advance (what is bad is refused all the same)"
        )


def table(preflight: Preflight, style: Style) -> list[str]:
    """What was found, robots with the same together."""
    groups: dict[Check, list[int]] = {}
    for pid, checks in sorted(preflight.checks.items()):
        for check in checks:
            groups.setdefault(check, []).append(pid)
    names = list(dict.fromkeys(check.name for check in groups))
    rows = sorted(groups.items(), key=lambda row: (names.index(row[0].name), row[1]))
    whose = [", ".join(map(str, pids)) for pids in groups.values()]
    wide = max([len("robots"), *map(len, whose)])
    long = max([len("check"), *map(len, names)])
    lines = [f"{'check':<{long}}  {'robots':<{wide}}  found"]
    for check, pids in rows:
        found = check.finding.value
        paint = _PAINTS[check.finding]
        shown = f"{found:<8}" if paint is None else style.paint(f"{found:<8}", paint)
        cure = f"; {check.cure}" if check.cure else ""
        told = visible(f"{check.text}{cure}")
        lines.append(
            f"{check.name:<{long}}  {', '.join(map(str, pids)):<{wide}}  {shown}  {told}".rstrip()
        )
    return lines


def show_preflight(preflight: Preflight, *, as_json: bool) -> int:
    """Print what was found; return the exit code."""
    if as_json:
        print(json.dumps(preflight.to_dict(), indent=2))
    else:
        _print(preflight)
        _print_hindrances(preflight)
    return Exit.OK if preflight.is_good else Exit.VIOLATED


def _print(preflight: Preflight) -> None:
    for line in table(preflight, style_of(sys.stdout)):
        print(line)
    sys.stdout.flush()


def _print_hindrances(preflight: Preflight) -> None:
    for line in preflight.hindrances:
        print(visible(f"not armed: {line}"), flush=True)


class Question:
    """The question whether to arm; ``answer``: what was said in advance."""

    def __init__(self, answer: bool | None) -> None:
        self._answer = answer
        self._is_at_end = False
        self._shown: tuple[object, ...] | None = None  #: what the last table was about

    def ask(self, preflight: Preflight) -> bool | None:
        """Show what is new, and return the answer if there is one by now."""
        if not preflight.is_settled:
            return None
        self._show(preflight)
        if self._answer is not None:
            return self._answer
        return self._heard() if preflight.is_good else None

    def _show(self, preflight: Preflight) -> None:
        """Show the table, again if a finding has changed: its texts do all the time."""
        about = tuple(
            (pid, check.name, check.finding)
            for pid, checks in sorted(preflight.checks.items())
            for check in checks
        )
        if about == self._shown:
            return
        self._shown = about
        _print(preflight)
        if self._answer is None:
            _print_hindrances(preflight)
            if preflight.is_good:
                while self._heard() is not None and not self._is_at_end:
                    pass  # what was typed before the question is no answer to it
                print("arm these robots? [y/N] ", end="", flush=True)

    def _heard(self) -> bool | None:
        """The answer on the terminal; its end is a no."""
        with suppress(OSError, ValueError):
            if not select.select([sys.stdin], [], [], 0)[0]:
                return None
            line = sys.stdin.readline()
            self._is_at_end = not line
            return line.strip().lower() in ("y", "yes")
        self._is_at_end = True
        return False
