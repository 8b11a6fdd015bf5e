"""A process that answers one question, started by a worker of a cluster.

Workers have threads of their own, and what asks solvers forks: so each question has a process to
itself, which ends with the worker. ``python -m koord.verify.answering FD PARENT``: the question
comes by the connection FD, and what is said about it goes back by it.
"""

from __future__ import annotations

import pickle
import sys
from functools import partial
from multiprocessing.connection import Connection

from koord.verify.forked import Sender
from koord.verify.helpers import Parcel, PortableWork
from koord.verify.job_process import JobChannel, do_work
from koord.verify.running_code import code_here


def answered(parcel: Parcel, tell: JobChannel) -> object:
    """Answer a question. Raises KoordError if other code asks it, and what its work raises."""
    question = pickle.loads(parcel.checked(code_here()))
    assert isinstance(question, PortableWork)
    return question(tell)


def main(descriptor: int, parent: int) -> None:
    """Answer the question that comes by a connection, and end."""
    line = Connection(descriptor)
    parcel = line.recv()
    assert isinstance(parcel, Parcel)
    do_work(partial(answered, parcel), parent, Sender(descriptor))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
