"""From a configuration to a transport."""

from __future__ import annotations

import secrets
import socket
from typing import assert_never

from koord.runtime.configuration.forms import Carrier
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.transports.routed import Routed
from koord.runtime.transports.transport import Transport, TransportError
from koord.runtime.transports.udp import Delivery, Plan, Udp, on_this_machine
from koord.syntax.forking import FORKING

#: Where ports for robots on this machine are looked for.
_FIRST_PORT, _PORTS = 20_000, 30_000

#: Others may use some of them: so many are tried.
_TRIES = 20


def plan_of(configuration: RunConfiguration) -> Plan:
    """Who is where, for UDP."""
    talk = configuration.talk
    addresses = tuple(robot.address for robot in configuration.robots)
    match talk.carrier:
        case Carrier.MULTICAST:
            assert talk.shared is not None
            # The group has a port of its own, below those of robots on one machine.
            local = all(ip.startswith("127.") for ip, _ in addresses)
            interface = "127.0.0.1" if local else talk.interface
            return Plan(addresses, Delivery.GROUP, (talk.shared, talk.port), interface)
        case Carrier.BROADCAST:
            assert talk.shared is not None
            return Plan(addresses, Delivery.SUBNET, (talk.shared, talk.port))
        case Carrier.UNICAST | Carrier.ZENOH:
            return Plan(addresses)
        case _:
            assert_never(talk.carrier)


def local_plan(configuration: RunConfiguration, robots: int) -> Plan:
    """All robots on this machine, each with a port, whatever addresses they will have outside."""
    unicast = configuration.talk.carrier is Carrier.UNICAST
    with FORKING:  # else a robot of another thread keeps the sockets that are tried here
        ports = (_FIRST_PORT + secrets.randbelow(_PORTS) for _ in range(_TRIES))
        port = next((port for port in ports if _are_free(port, robots)), _FIRST_PORT)
        if unicast or robots == 1 or not hears_itself(port):
            return on_this_machine(robots, port, group=None)
        return on_this_machine(robots, port)


def _are_free(port: int, robots: int) -> bool:
    """Whether nobody else uses the ports of a plan now."""
    try:
        for address in on_this_machine(robots, port, group=None).addresses:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
                one.bind(address)
    except OSError:
        return False
    return True


def hears_itself(port: int) -> bool:
    """Whether multicast works on this machine's loopback; in some containers it does not."""
    plan = on_this_machine(2, port)
    opened: list[Udp] = []
    try:
        opened += [Udp(plan, pid) for pid in range(2)]
        for _ in range(3):
            opened[0].tell(b"?")
            if opened[1].receive(0.1):
                return True
    except TransportError:
        pass  # whoever uses the port in earnest is told
    finally:
        for one in opened:
            one.close()
    return False


def transport_of(configuration: RunConfiguration, run: str, pid: int) -> Transport:
    """The network of one robot. Raises TransportError."""
    talk = configuration.talk
    if talk.carrier is Carrier.ZENOH:
        return Routed(run, pid, len(configuration.robots), talk.connect, talk.listen)
    return Udp(plan_of(configuration), pid)
