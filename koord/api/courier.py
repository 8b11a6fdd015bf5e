"""The courier: a process between those who ask and the workers of a Dask cluster.

The library of the cluster has threads, and a process with threads cannot well be forked, as those
who ask are. So it is in a process of its own. Whoever asks sends a question by a socket; the
courier hands it to the scheduler, passes on what the worker says, and cancels it if the line is
closed, however that was. When who started the courier has ended, so does the courier, and the
scheduler takes from the workers what they are at.
"""

from __future__ import annotations

import os
import pickle
import secrets
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, Listener, Pipe, wait
from select import select
from typing import Any

from msgspec import Struct, field

from koord.api.dask_cluster import connected, this_worker, unwanted
from koord.runtime.motion.libraries import require
from koord.syntax.diagnostics import KoordError, refusal
from koord.verify.forked import Receiver, Sender, ready
from koord.verify.helpers import Helpers, Parcel, lost
from koord.verify.job_process import Begun, Found, Lasting, Unanswered, end_of
from koord.verify.running_code import code_here

#: How often a worker looks whether anybody still waits for its answer, in seconds.
_LOOK_S = 0.2

#: How long a courier may take to cancel what is out there, in seconds.
_ENDING_S = 5.0


class Cluster(Struct):
    """A cluster that answers questions, with the number of workers that it had at first.

    ``died`` counts workers that ended while they were at one, when all is over.
    """

    helpers: Helpers
    workers: int
    died: int = 0


@contextmanager
def cluster_at(
    address: str, tell: Callable[[str], None], interrupted: Callable[[], bool]
) -> Iterator[Cluster]:
    """Within the context, the workers of the scheduler at an address answer questions.

    Raises KoordError if there is none, or if a worker runs other code; and KeyboardInterrupt if it
    is ``interrupted`` before it is reached.
    """
    require(("distributed",), "cluster")
    tell(f"looking for the cluster at {address}")
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "koord.api.courier", address],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=said,
            start_new_session=True,  # Ctrl-C is for who asks, who says when it is enough
        )
        assert process.stdin is not None
        assert process.stdout is not None
        with process:
            try:
                cluster = _heard(process.stdout.fileno(), interrupted)
                if isinstance(cluster, KoordError):
                    raise cluster
                if cluster is None:
                    said.seek(0)
                    last = said.read().decode(errors="replace").strip().rpartition("\n")[2]
                    raise refusal("K935", "<cluster>", f"the cluster is not reached: {last}")
                assert isinstance(cluster, Cluster)
                yield cluster
                process.stdin.close()
                died = _heard(process.stdout.fileno(), lambda: False)
                cluster.died = died if isinstance(died, int) else 0
            finally:
                process.stdin.close()
                try:
                    process.wait(_ENDING_S)
                except subprocess.TimeoutExpired:
                    process.kill()


def _heard(descriptor: int, interrupted: Callable[[], bool]) -> object:
    """What the courier says next; None if it has ended."""
    while not select([descriptor], [], [], _LOOK_S)[0]:
        if interrupted():
            raise KeyboardInterrupt
    content = b""
    while more := os.read(descriptor, 2**16):
        content += more
        with suppress(pickle.UnpicklingError, EOFError):
            return pickle.loads(content)
    return None


# --- the process of the courier -------------------------------------------------------------------


class _Courier(Struct):
    """The courier at work: who waits for which answer, and how often it was begun."""

    client: Any
    topic: str
    waiting: dict[str, Sender] = field(default_factory=dict)
    begun: Counter[str] = field(default_factory=Counter)
    lock: Any = field(default_factory=threading.Lock)

    def serve(self, line: Connection) -> None:
        """Have one question answered."""
        key = f"koord-{secrets.token_hex(8)}"
        with line, suppress(OSError, EOFError):
            parcel = line.recv()
            with self.lock:
                self.waiting[key] = Sender(line.fileno())
            future = self.client.submit(
                answered, parcel, self.topic, key, key=key, pure=False, retries=0
            )
            done, sends = Pipe(duplex=False)
            future.add_done_callback(lambda _: sends.close())
            wait([line, done])  # nothing comes by the line but its end
            with self.lock:
                del self.waiting[key]
            if done.poll():
                Sender(line.fileno()).send_pickled(self._outcome(future))
            else:
                self.client.cancel([future])

    def hear(self, event: tuple[float, tuple[str, bytes]]) -> None:
        """Pass on what a worker says of a question."""
        key, said = event[1]
        with self.lock, suppress(OSError):
            if isinstance(pickle.loads(said), Begun):
                self.begun[key] += 1
            if key in self.waiting:
                self.waiting[key].send_pickled(said)

    @property
    def died(self) -> int:
        """How many workers ended while they were at a question."""
        return sum(times - 1 for times in self.begun.values())

    def _outcome(self, future: Any) -> bytes:
        if future.status == "finished":
            found: bytes = future.result()
            return found
        if future.status in ("cancelled", "lost"):
            return pickle.dumps(Found(None, lost()))
        error = future.exception()
        if type(error).__name__ == "KilledWorker":
            why = f"each of {error.allowed_failures + 1} workers ended before it was done"
            return pickle.dumps(Unanswered(why))
        return pickle.dumps(Found(None, _unable("a worker", f"{type(error).__name__}: {error}")))


def _unable(who: str, why: str) -> KoordError:
    story = f"{who} of the cluster cannot answer: {why}"
    return refusal("K947", "<cluster>", story, "install the same version on all machines")


def _checked(client: Any) -> int:
    """The number of workers that are there. Raises KoordError if one has no koord."""
    found = client.get_versions(packages=["koord"])["workers"]
    for address, versions in found.items():
        if not isinstance(versions, dict) or versions["packages"].get("koord") is None:
            raise _unable(f"the worker {address}", "koord is not installed there")
    return len(found)


def main(address: str) -> None:
    """Carry questions until standard input is closed."""
    answer = sys.stdout.buffer
    try:
        client = connected(address)
        workers = _checked(client)
    except KoordError as error:
        answer.write(pickle.dumps(error))
        answer.flush()
        os._exit(1)
    courier = _Courier(client, f"koord-{secrets.token_hex(8)}")
    client.subscribe_topic(courier.topic, courier.hear)
    key = secrets.token_bytes(32)
    with Listener(None, "AF_UNIX", 128, authkey=key) as listener:
        path = str(listener.address)
        threading.Thread(target=_accept, args=(listener, courier), daemon=True).start()
        answer.write(pickle.dumps(Cluster(Helpers(path, key, code_here()), workers)))
        answer.flush()
        sys.stdin.buffer.read()
        with suppress(OSError):
            answer.write(pickle.dumps(courier.died))
            answer.flush()
        with suppress(Exception):  # the scheduler may be gone
            client.close(timeout=2)
    os._exit(0)


def _accept(listener: Listener, courier: _Courier) -> None:
    while True:
        try:
            line = listener.accept()
        except OSError:
            return
        except Exception:  # somebody without the key
            continue
        threading.Thread(target=courier.serve, args=(line,), daemon=True).start()


# --- on a worker ----------------------------------------------------------------------------------


def answered(parcel: Parcel, topic: str, key: str) -> bytes:
    """Answer a question on a Dask worker, in a process of its own; return what it says at last."""
    worker, is_unwanted = this_worker(), unwanted()

    def tell(said: bytes) -> None:
        worker.log_event(topic, (key, said))

    tell(pickle.dumps(Begun(str(worker.address))))
    ours, theirs = Pipe()
    command = [sys.executable, "-m", "koord.verify.answering"]
    process = subprocess.Popen(
        [*command, str(theirs.fileno()), str(os.getpid())],
        pass_fds=[theirs.fileno()],
        stdin=subprocess.DEVNULL,
    )
    theirs.close()
    with ours:
        try:
            ours.send(parcel)
            return _said_at_last(Receiver(ours.fileno()), tell, is_unwanted)
        except (EOFError, OSError):
            process.kill()
            return pickle.dumps(Unanswered(end_of(process.wait())))
        finally:
            process.kill()
            process.wait()


def _said_at_last(
    line: Receiver, tell: Callable[[bytes], None], is_unwanted: Callable[[], bool]
) -> bytes:
    """Pass on what a process says; return its result. Raises EOFError if it dies."""
    import time

    until = None
    while not is_unwanted():
        if not ready([line], _LOOK_S):
            if until is not None and until <= time.monotonic():
                return pickle.dumps(Unanswered("", is_overdue=True))
            continue
        said = line.receive()
        match said:
            case Found():
                return pickle.dumps(said)
            case Lasting(until=moment):  # as clocks go on this machine
                until = moment
            case _:
                tell(pickle.dumps(said))
    return pickle.dumps(Unanswered("nobody waited for it any more"))


if __name__ == "__main__":
    # By the name that others know it by, for what is pickled.
    from koord.api import courier

    courier.main(sys.argv[1])
