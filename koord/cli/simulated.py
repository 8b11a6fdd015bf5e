"""What a simulated run came to, as text and as JSON."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

from msgspec import to_builtins
from rich.console import Console
from rich.table import Table

from koord.cli.fitting import NO_FILE
from koord.cli.progress import LiveLine
from koord.cli.simulating import Job
from koord.cli.terminal import Paint, style_of, visible
from koord.runtime.motion.planning import Hindrance
from koord.runtime.motion.world import World
from koord.sim.bounds import moves
from koord.sim.measuring import Figures
from koord.sim.running import Broken, Ending, Simulation, still_words
from koord.sim.standing import Standing

#: More robots, tasks and broken claims than this are summed up in a line.
_MOST_ROWS = 24


def heading(job: Job) -> str:
    """What is run."""
    scene = job.scene
    name = job.configuration.name
    program, *more = (*job.problem.texts, *([] if name == NO_FILE else [name]))
    with_ = f" with {', '.join(more)}" if more else ""
    counts = {n: scene.names.count(n) for n in dict.fromkeys(scene.names)}
    who = ", ".join(f"{count} {device}" for device, count in counts.items())
    agents = job.loaded.core.agents
    if len(agents) > 1:
        of = ", ".join(f"{job.kinds.count(k)} {agent.name}" for k, agent in enumerate(agents))
        who = f"{of}; on {who}"
    count = len(scene.robots)
    robots = f"{count} robot{'' if count == 1 else 's'} ({who})"
    other = job.problem.other_fleet
    robots += "" if other is None else f" ({other} in the text)"
    chance = f", by chance: {', '.join(job.by_chance)}" if job.by_chance else ""
    values = ", ".join((robots, *job.problem.values, f"seed {scene.seed}"))
    told = visible(f"{program}{with_}: {values}{chance}")
    is_given = job.configuration.bounded and name != NO_FILE
    if is_given or not moves(job.loaded.core):
        return told
    return f"{told}\nno bounds are given: the world reaches {bounds_words(scene.world)}"


# --- the report -----------------------------------------------------------------------------------


def table(simulation: Simulation, wall_s: float) -> Iterator[str]:
    """What each robot came to, and all of them together."""
    figures = simulation.figures()
    yield from _drawn(_robots(simulation, figures))
    yield from _drawn(_together(simulation, figures, wall_s))


def _drawn(one: Table) -> list[str]:
    text = io.StringIO()
    Console(file=text, width=max(60, style_of(sys.stdout).width), no_color=True).print(one)
    return [line.rstrip() for line in text.getvalue().splitlines()]


def _robots(simulation: Simulation, figures: Figures) -> Table:
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
        made.add_row(str(pid), visible(simulation.scene.names[pid]), *cells)
    left = len(figures.robots) - _MOST_ROWS
    if left > 0:
        made.add_row("…", f"and {left} more", *[""] * len(columns))
    return made


def _together(simulation: Simulation, figures: Figures, wall_s: float) -> Table:
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
        wanted = f"; safe from {simulation.scene.safety_m:.2f} m on" * (
            simulation.scene.safety_m > 0
        )
        place = f"robots {one} and {other} after {near.time_s:.1f} s"
        made.add_row("separation", f"at least {near.distance_m:.2f} m ({place}{wanted})")
    skips = sum(robot.skips for robot in figures.robots)
    blocked = sum(robot.blocked for robot in figures.robots)
    events = sum(robot.events for robot in figures.robots)
    made.add_row("events", f"{events}, and {skips} skips, {blocked} of them for a lock")
    made.add_row("messages", f"{figures.messages} in {figures.rounds} rounds")
    if simulation.looked:
        looks = sum(simulation.looked.values())
        made.add_row("claims", f"{len(simulation.looked)}, looked at {looks} times")
    speed = figures.time_s / wall_s if wall_s > 0 else 0.0
    made.add_row("time", f"{figures.time_s:.1f} s in {wall_s:.1f} s, {speed:.0f} × real time")
    made.add_row("trace", figures.digest[:16])
    return made


def conclusion(job: Job, simulation: Simulation) -> Iterator[str]:
    """How the run ended, and what was broken."""
    style = style_of(sys.stdout)
    yield ""
    for broken in simulation.broken[:_MOST_ROWS]:
        yield f"{style.paint('broken', Paint.ERROR)}: {visible(_told(broken))}"
    if len(simulation.broken) > _MOST_ROWS:
        yield f"  and {len(simulation.broken) - _MOST_ROWS} more"
    yield from _standing(job, simulation)
    assert simulation.ending is not None
    match simulation.ending:
        case Ending.FAULT:
            ended = simulation.fault
            assert ended is not None
            whose = "" if ended.robot is None else f" of robot {ended.robot}"
            said = style.paint("fault", Paint.ERROR)
            kind, place = ended.fault.kind.value, visible(ended.fault.place)
            yield f"{said}: {kind}{whose}, after {simulation.time_s:.1f} s, at {place}"
        case Ending.VIOLATED:
            pass
        case ending if simulation.broken:
            count = len(simulation.broken)
            yield f"{ending.value}; {count} claim{'' if count == 1 else 's'} broken"
        case ending if simulation.standing:
            yield f"{ending.value}; {still_words(len(simulation.standing))}"
        case ending:
            yield f"{style.paint('done', Paint.ADDED)}: {ending.value}"


def _standing(job: Job, simulation: Simulation) -> Iterator[str]:
    """The robots that stand still, and what can be done."""
    style = style_of(sys.stdout)
    for one in simulation.standing[:_MOST_ROWS]:
        yield f"{style.paint('stuck', Paint.ERROR)}: {standing_words(one)}"
    if len(simulation.standing) > _MOST_ROWS:
        yield f"  and {len(simulation.standing) - _MOST_ROWS} more"
    if any(one.hindrance is Hindrance.OUTSIDE for one in simulation.standing):
        where = bounds_words(job.scene.world)
        yield f"  the world reaches {where}: `world: {{bounds: …}}` in a configuration says how far"


def bounds_words(world: World) -> str:
    """From where to where a world reaches."""
    low, high = (f"({', '.join(f'{c:g}' for c in corner)})" for corner in (world.low, world.high))
    return f"from {low} to {high}"


def standing_words(one: Standing) -> str:
    """Who stands still, since when, and why."""
    return f"robot {one.robot} stands still since {one.since_s:.1f} s: {one.words}"


class Noticed:
    """Tells on standard error which robots stand still, as it is seen."""

    def __init__(self, line: LiveLine) -> None:
        self._line, self._count = line, 0

    def tell(self, simulation: Simulation) -> None:
        """Tell of those that are new."""
        for one in simulation.noticed[self._count : _MOST_ROWS]:
            self._line.clear()
            print(standing_words(one), file=sys.stderr, flush=True)
        self._count = len(simulation.noticed)


def _told(broken: Broken) -> str:
    who = ""
    if broken.robots:
        many = "robots" if len(broken.robots) > 1 else "robot"
        who = f" of {many} {' and '.join(map(str, broken.robots))}"
    where = ""
    if broken.place is not None:
        where = f" at ({', '.join(f'{c:.2f}' for c in broken.place)})"
    words = f": {broken.words}" if broken.words else ""
    return f"{broken.claim}{who}, after {broken.time_s:.2f} s{where}{words}"


def progress(simulation: Simulation) -> str:
    """How far a run has come."""
    figures = simulation.gauge
    done, tasks = figures.visited, figures.tasks
    said = f"{simulation.time_s:.1f} s simulated"
    return f"{said}, {done} of {tasks} tasks" if tasks else said


def as_document(
    job: Job, simulation: Simulation, wall_s: float, more: Mapping[str, Any] = MappingProxyType({})
) -> str:
    """The run as JSON."""
    figures = simulation.figures()
    assert simulation.ending is not None
    document = {
        "format": "koord-simulated",
        "version": 1,
        "program": job.loaded.source.name,
        "problem": job.problem.document(),
        "seed": job.scene.seed,
        "ending": simulation.ending.name.lower(),
        **to_builtins(figures),
        "devices": job.scene.names,
        "safety_m": job.scene.safety_m,
        "bounds": {"low": job.scene.world.low, "high": job.scene.world.high}
        | {"given": job.configuration.bounded and job.configuration.name != NO_FILE},
        "wall_s": wall_s,
        "claims": simulation.looked,
        "by_chance": job.by_chance,
        "broken": [to_builtins(broken) for broken in simulation.broken],
        "standing": [
            {"robot": one.robot, "since_s": one.since_s, "why": one.hindrance.name.lower()}
            | {"words": one.words}
            for one in simulation.standing
        ],
        "fault": None
        if simulation.fault is None
        else to_builtins(simulation.fault.fault)
        | {"kind": simulation.fault.fault.kind.value, "robot": simulation.fault.robot},
        **more,
    }
    return json.dumps(document, indent=2) + "\n"
