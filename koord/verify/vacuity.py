"""What makes verdicts say less than they seem to: nothing can start, or nothing ever happens."""

from __future__ import annotations

from koord.verify.bmc import Bounded
from koord.verify.ledger import Ledger
from koord.verify.sightings import seen_to_run
from koord.verify.solving import Effort
from koord.verify.verdicts import Vacuity

#: What the search for events that never run may cost, after random runs of so many seconds.
IDLE_S = 10.0
RUNS_S = 2.0


def vacuities(ledger: Ledger, bounded: Bounded) -> tuple[Vacuity, ...]:
    """Assumptions that contradict each other, and events that can never run within the bound."""
    deadline, effort = ledger.deadline, Effort.of_seconds(IDLE_S)
    if not bounded.start_possible(deadline, effort):
        return (Vacuity("assumptions", "no initial configuration satisfies them all"),)
    ledger.progress("looking for events that never run")
    rounds = ledger.bounds.rounds
    seen: set[tuple[int, int]] = set()
    if not ledger.subject.is_abstract:
        # Making up positions and paths that meet assumptions can cost more than it spares.
        seen = seen_to_run(ledger.system, rounds, deadline.sooner(RUNS_S), ledger.seed)
    idle = bounded.idle_events(seen, rounds, deadline, effort)
    if idle.stuck is not None:
        return (Vacuity("contracts", f"no run gets through round {idle.stuck + 1}"),)
    found = []
    for kind, position in sorted(idle.events):
        name = ledger.system.program.agents[kind].events[position].name
        found.append(Vacuity("event", f"{name} cannot run within {rounds} rounds"))
    return tuple(found)
