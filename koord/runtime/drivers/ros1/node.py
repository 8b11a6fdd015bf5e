"""The node of ROS 1 that this process is, and the thread that does for it whatever may wait.

rospy has one node a process, waits for its master wherever it needs one, and never registers again
with a master that was started anew. So all of this is done in one thread, which looks at the master
again and again; a driver only looks at what that has seen. (P-ROS-MASTER)
"""

from __future__ import annotations

import atexit
import logging
import os
import threading
import time
from abc import ABC, abstractmethod
from typing import Any

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.ros.options import PACKAGES, Wire
from koord.runtime.drivers.ros1 import library
from koord.runtime.drivers.ros1.master import PATIENCE_S, UNREACHABLE, Master, Role, Seen

#: The master is looked at after this, in s.
_PERIOD_S = 0.25

#: A master that has not answered for this long is lost, in s.
_LOST_S = 2 * _PERIOD_S + PATIENCE_S

#: What was published last is given this long to leave before its topic is closed, in s.
_LAST_WORDS_S = 0.05


class End(ABC):
    """An end of a topic of this process; ``made`` is rospy's, once there is a master."""

    role: Role

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self.made: Any = None
        self.message_type: Any = library.message_type(wire.type_name)
        #: the types of those at the other end while nobody is connected; None: who is dead
        self.others: dict[str, str | None] = {}

    @property
    def told_type(self) -> str:
        """Its type as ROS 1 shows it."""
        return f"{PACKAGES[self.wire.type_name]}/{self.wire.type_name}"

    @abstractmethod
    def make(self) -> Any:
        """Open it; may wait for the master."""

    @property
    def is_connected(self) -> bool:
        return self.made is not None and self.made.get_num_connections() > 0


class Node:
    """The node of this process at one master."""

    def __init__(self, uri: str) -> None:
        self.master, self.seen = Master(uri), Seen()
        self._rospy = library.rospy()
        self._is_made = False
        self._answered_s: float | None = None
        self._ends: tuple[End, ...] = ()
        self._left: list[tuple[list[End], threading.Event]] = []
        self._lock, self._wake = threading.Lock(), threading.Event()

    def start(self) -> None:
        """Begin to look at the master."""
        threading.Thread(target=self._run, name="koord-ros1", daemon=True).start()

    @property
    def name(self) -> str:
        return self.master.caller

    @property
    def trouble(self) -> str | None:
        """Why nothing new can be connected; what is connected stays so without a master."""
        if self._is_made and self._rospy.is_shutdown():
            return f"the node {self.name} was shut down, as by `rosnode kill`: start it again"
        answered_s = self._answered_s
        if answered_s is None or time.monotonic() - answered_s > _LOST_S:
            return f"the master of ROS 1 at {self.master.uri} does not answer"
        return None

    def add(self, end: End) -> None:
        """Let an end of a topic be opened as soon as there is a master."""
        with self._lock:
            self._ends = (*self._ends, end)
        self._wake.set()

    def remove(self, ends: list[End]) -> None:
        """Close ends of topics, and wait a little until that is done."""
        done = threading.Event()
        with self._lock:
            self._ends = tuple(end for end in self._ends if end not in ends)
            self._left.append((ends, done))
        self._wake.set()
        done.wait(PATIENCE_S)

    # --- in the thread --------------------------------------------------------------------------

    def _run(self) -> None:
        while True:
            self._wake.clear()
            try:
                self.look()
            except UNREACHABLE:
                pass  # seen by how long ago it answered
            except self._rospy.ROSException:
                pass  # it was shut down
            self.close_left()
            self._wake.wait(_PERIOD_S)

    def look(self) -> None:
        """Open what is wanted, and see who is there. Raises one of UNREACHABLE."""
        seen = self.master.look()
        if not self._is_made:
            self._make()
        self.seen, self._answered_s = seen, time.monotonic()
        for end in self._ends:
            topic = f"/{end.wire.name}"
            if end.made is None:
                end.made = end.make()
            elif self.name not in seen.on(topic, end.role):
                uri = self._rospy.get_node_uri()
                self.master.register(topic, end.told_type, end.role, uri)
            if not end.is_connected:
                nodes = tuple(n for n in seen.on(topic, end.role.other) if n != self.name)
                end.others = self.master.types(topic, end.role.other, nodes)

    def _make(self) -> None:
        # rospy would set the handlers of all logging anew, and write to standard output.
        self._rospy.core.configure_logging = lambda *_: None
        for name in ("rosout", "rospy", "rosgraph"):
            logging.getLogger(name).addHandler(logging.NullHandler())
        os.environ["ROS_MASTER_URI"] = self.master.uri
        self._rospy.init_node(
            "koord",
            argv=["koord"],
            anonymous=True,  # with a name that another one has, the master would end the first
            disable_rostime=True,
            disable_rosout=True,
            disable_signals=True,
        )
        self.master.caller = self._rospy.get_name()
        self._is_made = True
        atexit.register(self._end)

    def close_left(self) -> None:
        """Close the topics that are not wanted any more."""
        while self._left:
            with self._lock:
                ends, done = self._left.pop(0)
            time.sleep(_LAST_WORDS_S)
            for end in ends:
                if end.made is not None:
                    end.made.unregister()
            done.set()

    def _end(self) -> None:
        """Say good-bye to the master, if it listens."""
        ending = threading.Thread(
            target=self._rospy.signal_shutdown, args=("koord ends",), daemon=True
        )
        ending.start()
        ending.join(PATIENCE_S)


_MADE: list[Node] = []


def node_at(stated: str | None) -> Node:
    """The node of this process; None: at the master of ROS_MASTER_URI. Raises DriverError."""
    uri = stated or os.environ.get("ROS_MASTER_URI") or "http://localhost:11311"
    if not _MADE:
        _MADE.append(Node(uri))
        _MADE[0].start()
    (made,) = _MADE
    if made.master.uri != uri:
        raise DriverError(
            f"this process is at the master {made.master.uri} of ROS 1, and cannot be at {uri} too",
            "name one `master`, or drive the vehicles by processes of their own",
        )
    return made
