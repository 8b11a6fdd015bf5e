"""Which slices of a system there are to ask about: one of all claims, and those of single ones."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax.analysis.always_met import always_met, primed, promises_of
from koord.syntax.analysis.auxiliary import Var, auxiliary, variables
from koord.syntax.core import Home
from koord.syntax.source import Span
from koord.syntax.system import System
from koord.verify.claims import Claim, claims_of, liveness_of
from koord.verify.reachability_goals import Aim, reachability_goals_of
from koord.verify.reduction.influence import Answers, Cone, Happens, Influence, Part
from koord.verify.reduction.problems import Identity, identity
from koord.verify.reduction.slicing import sliced


class Slices(Struct, frozen=True, dict=True):
    """The slices of one system, by the claims that they are for."""

    system: System

    @cached_property
    def influence(self) -> Influence:
        return Influence(self.system)

    @cached_property
    def everything(self) -> frozenset[Part]:
        """All variables and events of the system."""
        program = self.system.program
        found: set[Part] = {*variables(program)}
        for kind, agent in enumerate(program.agents):
            found.update(Happens(kind, position) for position in range(len(agent.events)))
        return frozenset(found)

    @cached_property
    def claims(self) -> dict[Identity, Claim]:
        """The claims about the system, by what they have in each slice."""
        claims = (*claims_of(self.system), *liveness_of(self.system))
        return {identity(claim): claim for claim in claims}

    def cone(self, claims: Iterable[Claim]) -> Cone:
        """The cone of influence of some claims, all together."""
        return self.influence.cone(claims)

    def returning(self, claims: Iterable[Claim]) -> Cone:
        """What a lasso that breaks claims about whole runs has to come back to. [AUXILIARY]"""
        stated = [claim.stated for claim in claims if claim.stated is not None]
        spared = auxiliary(self.system, stated)
        return self.influence.closed({*self.cone(claims), *(self.everything - spared)})

    def whole(self, claims: Iterable[Claim]) -> Cone:
        """All that any claim can depend on, and all else."""
        return self.influence.closed({*self.cone(claims), *self.everything})

    def extent(self, cone: Cone) -> frozenset[Part]:
        """The variables and events in a cone: what else is in it hangs on them."""
        return cone & self.everything

    def name(self, part: Part) -> str:
        """What the text calls a variable or an event."""
        program = self.system.program
        match part:
            case Happens(kind=kind, position=position):
                return program.agents[kind].events[position].name
            case Var(home=Home.LOCAL, kind=int(kind), slot=slot):
                return program.agents[kind].locals[slot].variable.name
            case Var(home=Home.PORT, kind=int(kind), slot=slot):
                return program.agents[kind].ports[slot].declaration.variable.name
            case Var(home=Home.ALLREAD, slot=slot):
                return program.allread[slot].variable.name
            case Var(home=Home.ALLWRITE, slot=slot):
                return program.allwrite[slot].variable.name
            case _:
                raise AssertionError(f"{part} has no name")

    def slice_of(self, cone: Cone) -> System:
        """The system without what is outside of a cone; itself if that is nothing."""
        if self.extent(cone) == self.everything:
            return self.system
        return replace(self.system, program=sliced(self.influence, cone))

    def common(self) -> System:
        """The system without what no claim about configurations can depend on."""
        claims = claims_of(self.system)
        part = self.slice_of(self.cone(claims))
        # A claim that the slice's own text does not make is asked of the whole.
        same = [identity(claim) for claim in claims_of(part)] == [identity(c) for c in claims]
        return part if same else self.system

    def happening(self) -> System:
        """The system without what has no influence on whether anything happens in it.

        Nothing is left out that could keep a run from starting or from going on: what happens in
        the slice happens in the system.
        """
        events = (part for part in self.everything if isinstance(part, Happens))
        cone = self.influence.closed({*self.cone(self.claims.values()), *events})
        if not self._goes_on_without(cone):
            return self.system
        part = self.slice_of(cone)
        if part is self.system:
            return part
        same = _aims(part) == _aims(self.system) and set(Slices(part).claims) == set(self.claims)
        return part if same else self.system

    def _goes_on_without(self, cone: Cone) -> bool:
        """Whether a run of a slice can always be completed to one of the system. [T-CONE]"""
        program, influence = self.system.program, self.influence
        stated = (influence.reads(each.condition, None) for each in program.assumptions)
        starts = all(not reads or reads & cone for reads in stated)
        answers = all(Answers(e.name) in cone or not e.ensures for e in program.externals)
        return (
            starts
            and answers
            and all(
                influence.restricted(contract, promise, kind) & cone
                or (primed(promise) and primed(promise) <= always_met(self.system, kind))
                for kind, agent in enumerate(program.agents)
                for contract, promise in promises_of(agent)
            )
        )


def _aims(system: System) -> set[tuple[Aim, str, Span]]:
    """What should happen in a system."""
    return {(goal.aim, goal.subject, goal.span) for goal in reachability_goals_of(system).all}
