"""``koord sim --processes``: each robot in a process of its own, over UDP, as time goes by."""

from __future__ import annotations

import argparse
import secrets
import time
from collections.abc import Iterator
from contextlib import ExitStack

from msgspec import Struct

from koord.cli.concluding import concluded
from koord.cli.deploy import Interrupts
from koord.cli.deployed import Board, summary
from koord.cli.exits import Exit
from koord.cli.keeping import watched
from koord.cli.simulated import heading
from koord.cli.simulated_traces import Tracing
from koord.cli.simulating import Job
from koord.runtime.deploy.local import Fleet, Launch, launched
from koord.runtime.deploy.networks import local_plan
from koord.runtime.deploy.running import Job as Deployment
from koord.runtime.proposals import INIT_ROUND, Decision
from koord.runtime.transports.transport import TransportError
from koord.sim.following import Followed
from koord.sim.processes import Maker
from koord.sim.running import Ending
from koord.syntax.diagnostics import refusal

#: How long processes are waited for at a time.
_WAIT_S = 0.2

#: In a run without a pace no time passes while somebody plans: nobody is to be late for that.
_UNHURRIED_S = 5.0


class _Late(Struct):
    """How many proposals came too late for their rounds, of those that were told of."""

    count: int = 0


def simulate(arguments: argparse.Namespace, job: Job, tracing: Tracing | None) -> int:
    """Run the robots, tell what they did, and return the exit code. Raises KoordError."""
    followed = job.followed(
        keep_going=arguments.keep_going, summaries=arguments.check_summaries, tracing=tracing
    )
    pace = arguments.pace or (1.0 if arguments.live else None)
    deployment = Deployment(
        job.cast().classes,
        job.kinds,
        job.configuration,
        secrets.token_bytes(32),
        f"sim {secrets.token_hex(4)}",
        delta_s=job.scene.delta_s,
        pace_s=0.0 if pace is None else job.scene.delta_s / pace,
        rounds=round(job.limit_s(arguments.rounds, arguments.time) / job.scene.delta_s),
        journals=None,
        unhurried_s=_UNHURRIED_S,
    )
    if not arguments.json:
        print(f"{heading(job)}\n{len(job.kinds)} processes")
    began = time.perf_counter()
    late = _Late()
    try:
        # What is told keeps the pace of the processes by itself.
        with (
            watched(arguments, followed, tracing, paced=False) as over,
            ExitStack() as stack,
        ):
            fleet = _launched(stack, Maker(job.cast(), job.scene, job.supplied()), deployment)
            for decision in _rounds(stack, fleet, deployment, followed, late):
                if tracing is not None:
                    if decision.round == INIT_ROUND:
                        tracing.begun(decision, followed)
                    else:
                        tracing.round(decision, followed)
                over(followed.time_s)
            died = fleet.died
    except TransportError as error:
        hint = error.hint or None
        raise refusal("K933", job.configuration.name, error.message, hint) from None
    wall_s = time.perf_counter() - began
    lines = summary(fleet.statuses, deployment).splitlines()[1:]
    lines += [f"the process of robot {pid} was ended" for pid in died]
    code = concluded(
        arguments, job, followed, tracing, wall_s, more={"late": late.count}, lines=lines
    )
    in_trouble = died or any(status.trouble for status in fleet.statuses.values())
    return Exit.VIOLATED if code == Exit.OK and in_trouble else code


def _launched(stack: ExitStack, maker: Maker, deployment: Deployment) -> Fleet:
    plan = local_plan(deployment.configuration, deployment.robots)
    fleet = launched(Launch(deployment, plan, maker, keeps_moments=True))
    stack.callback(fleet.join)
    stack.callback(fleet.kill)
    return fleet


def _rounds(
    stack: ExitStack, fleet: Fleet, deployment: Deployment, followed: Followed, late: _Late
) -> Iterator[Decision]:
    """All rounds of all robots, until their run is over. Raises TransportError."""
    interrupts = stack.enter_context(Interrupts(at_once=fleet.kill))
    board = stack.enter_context(Board(deployment.robots, deployment.rounds))
    is_stopped = False
    while not fleet.is_over:
        for _, moments in fleet.news(_WAIT_S):
            late.count += sum(moment.late for moment in moments)
            followed.hear(moments)
        yield from followed.rounds()
        board.show(fleet.statuses)
        board.is_stopping = interrupts.count > 0
        # Of a robot whose process has died nothing more is told: the run is known up to here.
        is_known = followed.ending is None and not fleet.died
        if not is_stopped and (interrupts.count or not is_known):
            is_stopped = True
            fleet.stop()
        if fleet.failures:
            raise fleet.failures[0]
    yield from followed.rounds(is_over=True)
    if followed.ending is None:
        followed.end(_ending(deployment, followed, is_interrupted=interrupts.count > 0))


def _ending(deployment: Deployment, followed: Followed, *, is_interrupted: bool) -> Ending:
    if is_interrupted:
        return Ending.INTERRUPTED
    is_whole = deployment.rounds is not None and followed.engine.round >= deployment.rounds
    return Ending.LIMIT if is_whole else Ending.SILENT
