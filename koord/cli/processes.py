"""``koord sim --processes``: each robot in a process of its own, over UDP, as time goes by."""

from __future__ import annotations

import argparse
import json
import secrets
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np

from koord.cli.deploy import Interrupts
from koord.cli.deployed import Board, summary
from koord.cli.exits import Exit
from koord.cli.simulated import heading
from koord.cli.simulating import Job
from koord.runtime.deploy.local import Fleet, Launch, launched
from koord.runtime.deploy.networks import local_plan
from koord.runtime.deploy.running import Job as Deployment
from koord.runtime.deploy.running import Moment
from koord.runtime.transports.transport import TransportError
from koord.sim.digests import BEGAN, SKIPPED, Digest
from koord.sim.processes import Maker
from koord.sim.separation import nearest
from koord.syntax.diagnostics import refusal


@dataclass
class _Heard:
    """What all robots did, by round and robot."""

    robots: int
    rounds: dict[int, dict[int, Moment]] = field(default_factory=dict)

    def hear(self, moments: Sequence[Moment]) -> None:
        for moment in moments:
            self.rounds.setdefault(moment.round, {})[moment.pid] = moment

    def whole(self) -> list[list[Moment]]:
        """The rounds that all have told of, in order."""
        numbers = sorted(number for number, of in self.rounds.items() if len(of) == self.robots)
        return [[self.rounds[n][pid] for pid in range(self.robots)] for n in numbers]


def simulate(arguments: argparse.Namespace, job: Job) -> int:
    """Run the robots, tell what they did, and return the exit code. Raises KoordError."""
    heard = _Heard(len(job.kinds))
    cast = job.cast()
    deployment = Deployment(
        cast.classes,
        job.kinds,
        job.configuration,
        secrets.token_bytes(32),
        f"sim {secrets.token_hex(4)}",
        delta_s=job.scene.delta_s,
        pace_s=0.0 if arguments.pace is None else job.scene.delta_s / arguments.pace,
        rounds=round(job.limit_s(arguments.rounds, arguments.time) / job.scene.delta_s),
        journals=None,
    )
    if not arguments.json:
        print(f"{heading(job)}, {len(job.kinds)} processes")
    try:
        fleet, interrupts = _run(Maker(cast, job.scene), deployment, heard)
    except TransportError as error:
        hint = error.hint or None
        raise refusal("K933", job.configuration.name, error.message, hint) from None
    rounds, near = heard.whole(), np.inf
    digest = Digest()
    for moments in rounds:
        positions = np.array([moment.position for moment in moments])
        digest.note(moments[0].round, np.array([_deed(job, moment) for moment in moments]))
        digest.place(positions)
        pair = nearest(positions)
        near = near if pair is None else min(near, pair.distance_m)
    broken = near < job.scene.safety_m
    late = sum(moment.late for moments in rounds for moment in moments)
    if arguments.json:
        document = {
            "format": "koord-processes",
            "version": 1,
            "rounds": len(rounds) - 1,
            "late": late,
            "separation_m": float(near) if np.isfinite(near) else None,
            "digest": digest.hexdigest(),
        }
        sys.stdout.write(json.dumps(document, indent=2) + "\n")
    else:
        print(summary(fleet.statuses, deployment))
        if np.isfinite(near):
            print(f"separation at least {near:.2f} m; safe from {job.scene.safety_m:.2f} m on")
        print(f"trace {digest.hexdigest()[:16]}")
    if broken or any(status.fault or status.trouble for status in fleet.statuses.values()):
        return Exit.VIOLATED
    return Exit.INTERRUPTED if interrupts.count else Exit.OK


def _run(maker: Maker, deployment: Deployment, heard: _Heard) -> tuple[Fleet, Interrupts]:
    """All robots, until their run is over. Raises TransportError."""
    with ExitStack() as stack:
        plan = local_plan(deployment.configuration, deployment.robots)
        fleet = launched(Launch(deployment, plan, maker, keeps_moments=True))
        stack.callback(fleet.join)
        stack.callback(fleet.kill)
        interrupts = stack.enter_context(Interrupts(at_once=fleet.kill))
        board = stack.enter_context(Board(deployment.robots, deployment.rounds))
        told = False
        while not fleet.is_over:
            for _, moments in fleet.news(0.2):
                heard.hear(moments)
            board.show(fleet.statuses)
            if interrupts.count and not told:
                told = True
                fleet.stop()
            if fleet.failures:
                raise fleet.failures[0]
    return fleet, interrupts


def _deed(job: Job, moment: Moment) -> int:
    """The position of the event that a robot ran."""
    if moment.round < 0:
        return BEGAN
    agent = job.loaded.program.agents[job.kinds[moment.pid]]
    names = [event.name for event in agent.events]
    return SKIPPED if moment.event is None else names.index(moment.event)
