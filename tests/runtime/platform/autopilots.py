"""Simulated autopilots in processes of their own."""

from __future__ import annotations

import multiprocessing
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from typing import Any

from koord.testing.autopilot.machine import Settings
from koord.testing.autopilot.serving import serve
from koord.testing.sockets import Address

SPAWN = multiprocessing.get_context("spawn")


@contextmanager
def running(target: Callable[..., None], *arguments: Any) -> Iterator[BaseProcess]:
    """A process, which is ended at last."""
    process = SPAWN.Process(target=target, args=arguments, daemon=True)
    process.start()
    try:
        yield process
    finally:
        process.kill()
        process.join()


@contextmanager
def autopilot(settings: Settings) -> Iterator[Address]:
    """An autopilot in a process of its own; yields where it is."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("127.0.0.1", 0))
        with running(serve, bound, settings):
            yield bound.getsockname()
