"""How people reach the robots of a configuration. (O-KEY)"""

from __future__ import annotations

from koord.runtime.configuration.forms import Carrier
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.orders.lines import Addresses, Reach, Routes


def reach_of(configuration: RunConfiguration, pids: tuple[int, ...]) -> Reach:
    """The addresses or routes of some robots of a configuration."""
    talk = configuration.talk
    if talk.carrier is Carrier.ZENOH:
        return Routes(pids, talk.connect, talk.listen)
    return Addresses(tuple((pid, configuration.robots[pid].address) for pid in pids))
