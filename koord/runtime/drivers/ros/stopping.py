"""What a watchdog stops a vehicle of ROS with, in a process of its own. (P-WATCHDOG)"""

from __future__ import annotations

import time
from importlib import import_module
from typing import Any

from koord.runtime.drivers.ros.commands import BASE, SINKING_MPS, header
from koord.runtime.drivers.ros.graph import Fields, Graph
from koord.runtime.drivers.ros.options import Wire
from koord.runtime.drivers.ros.poses import NotAPoseError, fix_of

#: How long it waits for who is to be stopped, and how often it looks.
_WAIT_S, _LOOK_S = 10.0, 0.01


class Stopping:
    """The last words to a vehicle, again and again.

    What drives is told zero, what flies by velocities to come down, and what goes to places to be
    where it is, on the ground if it flies.
    """

    def __init__(
        self,
        graph: str,
        where: Any,
        command: tuple[str, str],
        positions: tuple[str, str] | None,
        ground_m: float | None,
    ) -> None:
        """Join a graph (``module:class``), and wait until somebody hears. Raises TimeoutError.

        ``command`` and ``positions`` are topics with their types; ``ground_m`` is for what flies.
        """
        module, _, name = graph.partition(":")
        self._graph: Graph = getattr(import_module(module), name)(where, 1)
        self._sender = self._graph.publish(Wire(*command))
        self._poses = None if positions is None else self._graph.listen(Wire(*positions))
        self._ground_m = ground_m
        self._place: Fields | None = None
        ends_at = time.monotonic() + _WAIT_S
        while not self._sender.is_heard:
            if time.monotonic() > ends_at:
                raise TimeoutError(self._graph.why_unheard(self._sender.wire))
            time.sleep(_LOOK_S)

    def stop(self) -> None:
        """Tell the vehicle once to stop."""
        down = 0.0 if self._ground_m is None else -SINKING_MPS
        twist: Fields = {"linear": {"z": down}}
        match self._sender.wire.type_name:
            case "Twist":
                self._sender.send(twist)
            case "TwistStamped":
                self._sender.send({"header": header(BASE), "twist": twist})
            case "PoseStamped":
                self._stay()
            case _:
                self._sender.send({"header": header(BASE)})  # all else is 0

    def _stay(self) -> None:
        if self._place is None:
            self._place = self._here()
        if self._place is not None:
            self._sender.send(self._place)

    def _here(self) -> Fields | None:
        """The place that was told last, as a place to be at; one that is told now counts."""
        message = None if self._poses is None else self._poses.take()
        if message is None:
            return None
        try:
            fix = fix_of(message)
        except NotAPoseError:
            return None
        x, y, z = fix.position_m
        w, i, j, k = fix.attitude
        place = {"x": x, "y": y, "z": z if self._ground_m is None else self._ground_m}
        pose = {"position": place, "orientation": {"x": i, "y": j, "z": k, "w": w}}
        return {"header": header(fix.frame), "pose": pose}

    def close(self) -> None:
        """Leave the graph."""
        self._graph.close()
