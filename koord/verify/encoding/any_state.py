"""Any configuration at the end of a round, reachable or not: where induction starts."""

from __future__ import annotations

from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store
from koord.semantics.domain import conjunction, disjunction
from koord.semantics.storage import Storage
from koord.syntax import core
from koord.syntax.analysis.footprint import Footprint, WriteExtent, footprint, statuses
from koord.syntax.core import BinaryOp, Home
from koord.syntax.system import Status, System
from koord.syntax.types import INT
from koord.verify.encoding.symbols import Unknowns
from koord.verify.encoding.terms import Term, Terms


class Arbitrary:
    """Makes such configurations of one system."""

    def __init__(self, system: System, unknowns: Unknowns) -> None:
        self.system = system
        self.unknowns = unknowns
        self.footprint: Footprint = footprint(self.system.program)
        self.statuses: tuple[frozenset[Status], ...] = statuses(self.system.program)

    @property
    def d(self) -> Terms:
        return self.unknowns.d

    def configuration(self, initial: Configuration[Term], label: str) -> Configuration[Term]:
        """Any configuration at the end of a round, reachable or not: where induction starts.

        It has in common with ``initial`` what no event ever changes.
        """
        program = self.system.program
        shared = {Home.ALLREAD: program.allread, Home.ALLWRITE: program.allwrite}
        stores = {Home.ALLREAD: initial.store.allread, Home.ALLWRITE: initial.store.allwrite}
        store = Store(
            *(
                tuple(
                    self._any(label, home, 0, declaration, before)
                    for declaration, before in zip(shared[home], stores[home], strict=True)
                )
                for home in (Home.ALLREAD, Home.ALLWRITE)
            )
        )
        robots = tuple(
            self._any_robot(i, state, store, label) for i, state in enumerate(initial.robots)
        )
        return Configuration(robots, store, 0)

    def _any(
        self,
        label: str,
        home: Home,
        kind: int,
        declaration: core.Declaration,
        before: Storage[Term],
    ) -> Storage[Term]:
        variable = declaration.variable
        written = self.footprint.get((home, kind, variable.slot), WriteExtent.NEVER)
        return self.unknowns.storage(f"{variable.name}{label}", variable.type, before, written)

    def _any_robot(
        self, robot: int, state: Robot[Term], store: Store[Term], label: str
    ) -> Robot[Term]:
        d, agent = self.d, self.system.agent(robot)
        status = d.fresh(f"status@{robot}", INT)
        ran = d.fresh(f"ran@{robot}", INT)
        possible = disjunction(
            d,
            [
                d.binary(BinaryOp.EQ, status, d.const(int(s), INT))
                for s in sorted(self.statuses[state.kind])
            ],
        )
        inside = [
            d.binary(BinaryOp.LE, d.const(NO_EVENT, INT), ran),
            d.binary(BinaryOp.LT, ran, d.const(len(agent.events), INT)),
        ]
        self.unknowns.constraints.append(conjunction(d, [possible, *inside]))
        where = f"@{robot}{label}"
        return replace(
            state,
            locals=tuple(
                self._any(where, Home.LOCAL, state.kind, declaration, before)
                for declaration, before in zip(agent.locals, state.locals, strict=True)
            ),
            ports=tuple(
                self._any(where, Home.PORT, state.kind, port.declaration, before)
                for port, before in zip(agent.ports, state.ports, strict=True)
            ),
            copy=store,
            status=status,
            ran=ran,
        )
