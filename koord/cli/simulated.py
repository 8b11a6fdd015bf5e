"""Simulated runs as text."""

from __future__ import annotations

import argparse
import io
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING

from koord.api.progress import Progress
from koord.api.served_page import PageServed
from koord.api.sim_report import (
    BrokenClaim,
    Ending,
    Hindrance,
    ProgramReloaded,
    Setup,
    Simulated,
    SimulationBegun,
    SimulationOver,
    StandsStill,
    standing_words,
    still_words,
)
from koord.cli.diagnostics import DiagnosticReport
from koord.cli.progress import Interruption, LiveLine
from koord.cli.terminal import Paint, style_of, visible
from koord.syntax.source import counted

if TYPE_CHECKING:
    from rich.table import Table

#: More robots, tasks and broken claims than this are summed up in a line.
_MOST_ROWS = 24


def heading(setup: Setup) -> str:
    """The heading of a run: its program, robots and settings."""
    problem = setup.problem
    program, *more = (*problem.texts, *filter(None, [setup.configuration]))
    with_ = f" with {', '.join(more)}" if more else ""
    counts = {n: setup.devices.count(n) for n in dict.fromkeys(setup.devices)}
    who = ", ".join(f"{count} {device}" for device, count in counts.items())
    agents, kinds = problem.program.agents, problem.kinds or ()
    if len(agents) > 1:
        of = ", ".join(f"{kinds.count(k)} {agent.name}" for k, agent in enumerate(agents))
        who = f"{of}; on {who}"
    robots = f"{counted(len(setup.devices), 'robot')} ({who})"
    other = problem.other_fleet
    robots += "" if other is None else f" ({other} in the text)"
    chance = f", by chance: {', '.join(setup.by_chance)}" if setup.by_chance else ""
    values = ", ".join((robots, *problem.values, f"seed {setup.seed}"))
    told = visible(f"{program}{with_}: {values}{chance}")
    if setup.is_bounded or not setup.moves:
        return told
    return f"{told}\nno bounds are given: the world reaches {bounds_words(setup)}"


# --- the report -----------------------------------------------------------------------------------


def report(simulated: Simulated) -> Iterator[str]:
    """Describe each robot's metrics, all together, the end of the run, and broken claims."""
    yield from _drawn(_robots(simulated))
    yield from _drawn(_together(simulated))
    if simulated.processes is not None:
        late, died = simulated.processes.late, simulated.processes.died
        if late:
            yield f"{counted(late, 'proposal')} came too late"
        if died:
            who = f"{counted(len(died), 'robot')} ({', '.join(map(str, died))})"
            yield f"the process of {who} was ended"
    yield from _conclusion(simulated)


def _drawn(one: Table) -> list[str]:
    from rich.console import Console

    text = io.StringIO()
    Console(file=text, width=max(60, style_of(sys.stdout).width), no_color=True).print(one)
    return [line.rstrip() for line in text.getvalue().splitlines()]


def _robots(simulated: Simulated) -> Table:
    figures = simulated.figures
    from rich.table import Table

    made = Table(box=None, pad_edge=False)
    made.add_column("robot", justify="right")
    made.add_column("device")
    columns = ("m", "waited s", "events", "skips", "blocked", *(["tasks"] if figures.tasks else []))
    for name in columns:
        made.add_column(name, justify="right")
    for pid, of in enumerate(figures.robots[:_MOST_ROWS]):
        cells = [f"{of.distance_m:.1f}", f"{of.waited_s:.1f}"]
        cells += [str(of.events), str(of.skips), str(of.blocked)]
        cells += [str(of.tasks)] if figures.tasks else []
        made.add_row(str(pid), visible(simulated.setup.devices[pid]), *cells)
    left = len(figures.robots) - _MOST_ROWS
    if left > 0:
        made.add_row("…", f"and {left} more", *[""] * len(columns))
    return made


def _together(simulated: Simulated) -> Table:
    figures, safety_m = simulated.figures, simulated.setup.safety_m
    from rich.table import Table

    made = Table(box=None, pad_edge=False, show_header=False)
    made.add_column()
    made.add_column()
    if figures.tasks:
        done = f"{figures.tasks_done} of {len(figures.tasks)} visited"
        when = "" if figures.tasks_s is None else f", the last after {figures.tasks_s:.1f} s"
        made.add_row("tasks", done + when)
    made.add_row("distance", f"{figures.distance_m:.1f} m in all")
    near = figures.nearest
    if near is not None:
        one, other = near.robots
        wanted = f"; safe from {safety_m:.2f} m on" * (safety_m > 0)
        place = f"robots {one} and {other} after {near.time_s:.1f} s"
        made.add_row("separation", f"at least {near.distance_m:.2f} m ({place}{wanted})")
    skips = sum(robot.skips for robot in figures.robots)
    blocked = sum(robot.blocked for robot in figures.robots)
    events = sum(robot.events for robot in figures.robots)
    made.add_row("events", f"{events}, and {skips} skips, {blocked} of them for a lock")
    made.add_row("messages", f"{figures.messages} in {figures.rounds} rounds")
    if simulated.claims:
        looks = sum(simulated.claims.values())
        made.add_row("claims", f"{len(simulated.claims)}, looked at {looks} times")
    wall_s = simulated.wall_s
    speed = figures.time_s / wall_s if wall_s > 0 else 0.0
    made.add_row("time", f"{figures.time_s:.1f} s in {wall_s:.1f} s, {speed:.0f} × real time")
    made.add_row("trace", figures.digest[:16])
    return made


def _conclusion(simulated: Simulated) -> Iterator[str]:
    """Describe the end of the run, and broken claims."""
    style = style_of(sys.stdout)
    yield ""
    for broken in simulated.broken[:_MOST_ROWS]:
        yield f"{style.paint('broken', Paint.ERROR)}: {visible(_told(broken))}"
    if len(simulated.broken) > _MOST_ROWS:
        yield f"  and {len(simulated.broken) - _MOST_ROWS} more"
    yield from _standing(simulated)
    match simulated.ending:
        case Ending.FAULT:
            ended = simulated.fault
            assert ended is not None
            whose = "" if ended.robot is None else f" of robot {ended.robot}"
            said = style.paint("fault", Paint.ERROR)
            kind, place = ended.fault.kind.value, visible(ended.fault.place)
            yield f"{said}: {kind}{whose}, after {simulated.time_s:.1f} s, at {place}"
        case Ending.VIOLATED:
            pass
        case ending if simulated.broken:
            yield f"{ending.value}; {counted(len(simulated.broken), 'claim')} broken"
        case ending if simulated.standing:
            yield f"{ending.value}; {still_words(len(simulated.standing))}"
        case ending:
            yield f"{style.paint('done', Paint.ADDED)}: {ending.value}"


def _standing(simulated: Simulated) -> Iterator[str]:
    """Describe the robots that stand still, and cures."""
    style = style_of(sys.stdout)
    for one in simulated.standing[:_MOST_ROWS]:
        yield f"{style.paint('stuck', Paint.ERROR)}: {standing_words(one)}"
    if len(simulated.standing) > _MOST_ROWS:
        yield f"  and {len(simulated.standing) - _MOST_ROWS} more"
    if any(one.hindrance is Hindrance.OUTSIDE for one in simulated.standing):
        where = bounds_words(simulated.setup)
        yield f"  the world reaches {where}: `world: {{bounds: …}}` in a configuration says how far"


def bounds_words(setup: Setup) -> str:
    """Describe the bounds of a world."""
    low, high = (f"({', '.join(f'{c:g}' for c in corner)})" for corner in (setup.low, setup.high))
    return f"from {low} to {high}"


def _told(broken: BrokenClaim) -> str:
    who = ""
    if broken.robots:
        many = "robots" if len(broken.robots) > 1 else "robot"
        who = f" of {many} {' and '.join(map(str, broken.robots))}"
    where = ""
    if broken.place is not None:
        where = f" at ({', '.join(f'{c:.2f}' for c in broken.place)})"
    words = f": {broken.words}" if broken.words else ""
    return f"{broken.claim}{who}, after {broken.time_s:.2f} s{where}{words}"


class Shown:
    """Shows a simulation while it goes on, and lets Ctrl-C end it."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self.cancellation = Interruption()
        self._arguments = arguments
        self._stack = ExitStack()
        self._line = LiveLine(sys.stderr)

    def __enter__(self) -> Shown:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def hear(self, told: Progress) -> None:
        """Show the progress."""
        match told:
            case SimulationBegun():
                self._begin(told)
            case PageServed():
                print(told.message, file=sys.stderr, flush=True)
            case StandsStill():
                self._line.clear()
                print(told.message, file=sys.stderr, flush=True)
            case ProgramReloaded():
                self._line.clear()
                self._show_reload(told)
            case SimulationOver(simulated=simulated):
                self._stack.close()
                self._report(simulated)
            case _:
                self._line.show(told.message)

    def _show_reload(self, told: ProgramReloaded) -> None:
        """Show that the program was edited, what is not kept, and what is wrong with it."""
        report = DiagnosticReport()
        report.add(told.diagnostics, *told.sources)
        report.print(sys.stderr, as_json=False)
        when = f"before round {(told.round or 0) + 1}"
        print(visible(f"{when}: {told.message}"), file=sys.stderr, flush=True)

    def _begin(self, begun: SimulationBegun) -> None:
        if not self._arguments.json:
            print(heading(begun.setup))
            if begun.processes:
                print(f"programs in {begun.processes} processes")
        self._stack.enter_context(self.cancellation)
        self._stack.enter_context(self._line)

    def _report(self, simulated: Simulated) -> None:
        if self._arguments.json:
            sys.stdout.write(simulated.to_json() + "\n")
        else:
            for text in report(simulated):
                print(text)
