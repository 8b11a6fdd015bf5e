"""Dask: clusters of workers that make runs and answer questions; loaded where one is asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from koord.syntax.diagnostics import refusal

#: A scheduler that does not answer for so long is not there, in seconds.
CONNECT_S = 10


def engine() -> Any:
    """The library, which says nothing of its types."""
    import distributed

    return distributed


def connected(address: str) -> Any:
    """A client of the scheduler at an address. Raises KoordError if there is none."""
    import asyncio

    try:
        asyncio.run(asyncio.wait_for(_greet(address), CONNECT_S + 1))
        return engine().Client(address, timeout=CONNECT_S)
    except (OSError, ValueError, TypeError) as error:  # the last of these: of keys for TLS
        why = str(error) or "whoever is there says nothing"
        story = f"there is no Dask scheduler at {address}: {why}"
        raise refusal("K935", "<cluster>", story, "start one with: dask scheduler") from None


async def _greet(address: str) -> None:
    """Connect once: a client would wait for ever for somebody who accepts it and says nothing."""
    security = engine().Security().get_connection_args("client")
    comm = await engine().comm.connect(address, timeout=CONNECT_S, **security)
    await comm.close()


def this_worker() -> Any:
    """The worker in one of whose threads this is called."""
    return engine().get_worker()


def unwanted() -> Callable[[], bool]:
    """A function that says whether nobody waits any more for the task that a worker is at.

    When who asks has ended, however that was, the scheduler takes the task from the worker; but the
    worker does not end what goes on in its thread. So the task looks itself.
    """
    from distributed import worker

    module: Any = worker
    tasks, key = this_worker().state.tasks, module.thread_state.key

    def is_unwanted() -> bool:
        task = tasks.get(key)
        return task is None or task.state != "executing"

    return is_unwanted
