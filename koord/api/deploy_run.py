"""The run of a deployment: one robot in this process, or all of them, each in its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from msgspec.structs import replace

from koord.api.deploy_followed import Deployment, FollowedRun
from koord.api.deployed import Deployed
from koord.api.files import no_folder
from koord.runtime.chaos.network import Faults
from koord.runtime.chaos.unreliable import Unreliable
from koord.runtime.deploy.job import Job
from koord.runtime.deploy.joining import knock
from koord.runtime.deploy.local import Launch, local_plan, transport_of
from koord.runtime.deploy.news import News
from koord.runtime.deploy.running import Runner
from koord.runtime.deploy.supervised import SupervisedProcesses
from koord.runtime.orders.lines import Addresses, Reach, robots_of
from koord.runtime.orders.places import Access, left
from koord.runtime.orders.reach import reach_of
from koord.runtime.transports.transport import Transport, TransportError
from koord.runtime.transports.udp import Udp
from koord.runtime.wire.frames import order_key
from koord.syntax.diagnostics import KoordError

#: Where a robot notes where it is, if nobody says.
_STATE = ".koord"

#: How long processes are waited for at a time.
_WAIT_S = 0.2


def run_one(of: Deployment, pid: int) -> Deployed:
    """Run one robot, in this process.

    Raises KoordError, TransportError and CannotTakePartError.
    """
    job = of.job
    # Nothing is written before it is sure that this robot can talk to the others.
    try:
        transport = _lossy(transport_of(job.configuration, job.run, pid), of, pid)
    except TransportError:
        with suppress(OSError):
            knock(job.party(pid), job.configuration.robots[pid].address)
        raise
    with ExitStack() as stack:
        stack.callback(transport.close)
        stack.enter_context(_found_here(job, reach_of(job.configuration, (pid,))))
        job = stack.enter_context(_noting(job, of.request.state or _STATE))
        followed = FollowedRun(replace(of, job=job), stack)
        runner = Runner(
            job,
            pid,
            transport,
            make=followed.make,
            keeps=followed.keeps,
        )
        followed.begin()

        def report(news: News) -> None:
            statuses = {pid: news.status}
            if followed.look(statuses):
                runner.go()
            followed.hear([news])
            followed.tell(statuses)

        def is_told_to_stop() -> bool:
            looking = followed.looking
            refused = looking is not None and looking.is_over and not looking.is_approved
            return refused or of.is_cancelled()

        last = runner.run(is_told_to_stop, report)
        report(runner.news())
        return followed.ended({pid: last})


def run_all(of: Deployment) -> Deployed:
    """Run all robots, each in a process.

    Raises KoordError, TransportError and CannotTakePartError.
    """
    job, request = of.job, of.request
    with ExitStack() as stack:
        state, scratch = request.state, None
        if state is None and request.restart:
            state = scratch = stack.enter_context(TemporaryDirectory(prefix="koord-"))
        if state is not None:
            job = stack.enter_context(_noting(job, state))
        plan = local_plan(job.configuration, job.robots)
        stack.enter_context(_found_here(job, Addresses(tuple(enumerate(plan.addresses)))))
        followed = FollowedRun(replace(of, job=job), stack)
        launch = Launch(
            job,
            plan,
            followed.make,
            lambda plan, pid: _lossy(Udp(plan, pid), of, pid),
            keeps=followed.keeps,
            scratch=scratch,
            processes=request.processes,
            wrap=lambda transport, pid: _lossy(transport, of, pid),
        )
        fleet = SupervisedProcesses(launch, restarts=request.restart)
        stack.callback(fleet.close)
        followed.tell({})
        followed.begin()
        while not fleet.is_over:
            news = fleet.turn(_WAIT_S)
            match followed.look(fleet.statuses):
                case True:
                    fleet.go()
                case False:
                    fleet.stop()
                case None:
                    pass
            followed.hear(news, fleet.processes, is_sure=fleet.is_accepted)
            followed.tell(fleet.statuses, fleet.processes)
            if of.is_cancelled():
                fleet.stop()
        followed.tell(fleet.statuses, fleet.processes)
        return followed.ended(fleet.statuses, fleet.processes, fleet.stuck)


def _lossy(transport: Transport, of: Deployment, pid: int) -> Transport:
    """A network that loses what it is to lose."""
    loss = of.request.loss
    if not loss:
        return transport
    faults = Faults(loss=loss, least_delay_s=0.0, most_delay_s=0.0)
    return Unreliable(transport, faults, of.job.configuration.seed + pid)


def _found_here(job: Job, reach: Reach) -> AbstractContextManager[object]:
    """Let people of this machine find the robots of this process. (O-HERE)"""
    is_whole = len(robots_of(reach)) == job.robots
    access = Access(order_key(job.key), job.encrypts, reach, is_whole)
    return left(job.configuration.name, access)


@contextmanager
def _noting(job: Job, path: str) -> Iterator[Job]:
    """The run with a folder of journals, which is made if need be.

    A start that is refused leaves no empty one. Raises KoordError.
    """
    folder = Path(path)
    made = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise no_folder(folder, error) from None
    job = replace(job, journals=folder)
    try:
        yield job
    except (KoordError, TransportError):
        for one in made:
            with suppress(OSError):  # others may have noted something
                one.rmdir()
        raise
