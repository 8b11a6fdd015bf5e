"""Work that can be done on another machine, and helpers who do it there.

What a forked process does may hang on all that is known here: circuits, what a solver was told.
Portable work is a question that has all that it is about in it, as data, so that it has the same
answer wherever it is asked. It is sent with the name of the code that asks it, for other code may
answer otherwise.
"""

from __future__ import annotations

import os

from msgspec import Struct

from koord.syntax.diagnostics import KoordError, refusal
from koord.verify.forked import Receiver
from koord.verify.job_process import JobChannel


class PortableWork(Struct, frozen=True):
    """Work that is the same on every machine: it can be pickled, and hangs on nothing else.

    Neither moments nor threads, files nor solvers are in it. Asked here, it is work as any other.
    """

    def __call__(self, tell: JobChannel) -> object:
        """Answer the question."""
        raise NotImplementedError


class Parcel(Struct, frozen=True):
    """A question as it is sent, with its digest and the code that asks it."""

    code: str
    digest: str
    content: bytes

    @staticmethod
    def of(question: PortableWork, code: str) -> Parcel:
        """Pack a question."""
        import pickle

        content = pickle.dumps(question)
        return Parcel(code, _digest(content), content)

    def checked(self, code: str) -> bytes:
        """The pickled question. Raises KoordError if other code asked it, or it came damaged."""
        if code != self.code:
            raise other_code("a worker", code, self.code)
        if _digest(self.content) != self.digest:
            raise refusal("K947", "<cluster>", "a question came damaged to a worker", "ask again")
        return self.content


def other_code(who: str, theirs: str, ours: str) -> KoordError:
    """The error that somebody on a cluster runs other code, whose answers may be others."""
    story = f"{who} of the cluster has {theirs}, and this is {ours}"
    return refusal("K947", "<cluster>", story, "install the same version on all machines")


def lost() -> KoordError:
    """The error that the cluster is not there any more."""
    story = "the connection to the cluster is lost: its scheduler ended, or the network did"
    hint = "start the scheduler and its workers, and ask again; or leave out `--cluster`"
    return refusal("K935", "<cluster>", story, hint)


class Helpers(Struct, frozen=True):
    """Others who answer questions, behind a socket of this machine.

    Plain data, so that each process that is forked can ask by itself: there is no thread here that
    a fork would lose.
    """

    socket: str
    key: bytes
    code: str

    def ask(self, question: PortableWork) -> Receiver:
        """Send a question; what is said about it comes by the line. To close it is to cancel it.

        Raises KoordError if they are gone.
        """
        from multiprocessing import AuthenticationError
        from multiprocessing.connection import Client

        try:
            with Client(self.socket, authkey=self.key) as line:
                line.send(Parcel.of(question, self.code))
                return Receiver(os.dup(line.fileno()))
        except (OSError, EOFError, AuthenticationError):
            raise lost() from None


def _digest(content: bytes) -> str:
    import hashlib

    return hashlib.sha256(content).hexdigest()
