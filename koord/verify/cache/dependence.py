"""What verdicts depend on: a question, a claim, and the parts of the program that were looked at.

A verdict on a claim is a fact about a slice: the parts that engines looked at, which are closed
under influence. It is one about another program, too, if the parts of the same names are closed
there, and make a slice of the same form: what holds in the slice holds in the program. [T-CONE]
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.analysis.auxiliary import Var, variables
from koord.syntax.core import Home
from koord.syntax.system import System
from koord.verify.cache.forms import Form, digest, named
from koord.verify.claims import Claim, ClaimKind, claims_of, liveness_of
from koord.verify.engine_names import Engine
from koord.verify.reduction.influence import Answers, BodyVariable, Happens, Matter, Part
from koord.verify.reduction.slicing import Slices

#: The parts of a program by their names, in order.
Names = tuple[str, ...]


class Question(Struct, frozen=True):
    """What is asked of a system, apart from its claims: all else that verdicts depend on.

    ``version`` is that of the programs that answer. Limits of time are not among it: whoever has
    more of it may learn more, but nothing else.
    """

    rounds: int
    engine: Engine | None = None
    seed: int = 0
    version: str = ""

    @property
    def text(self) -> str:
        engine = "auto" if self.engine is None else self.engine.value
        return f"rounds {self.rounds}; engine {engine}; seed {self.seed}; version {self.version}"


class Dependences(Struct, frozen=True, dict=True):
    """The dependences of verdicts on one system, as keys to find verdicts by."""

    system: System
    question: Question
    _forms: dict[Names, Form | None] = field(default_factory=dict)

    @cached_property
    def slices(self) -> Slices:
        return Slices(self.system)

    @cached_property
    def claims(self) -> tuple[Claim, ...]:
        """All claims about the system."""
        return (*claims_of(self.system), *liveness_of(self.system))

    def asked(self, claim: Claim) -> str:
        """The digest of a claim by names, and of all that is asked: where verdicts are looked for.

        Several programs may ask this; which one is meant, :meth:`key` says.
        """
        system = self.system
        fleet = f"{[system.program.agents[k].name for k in system.kinds]} {system.delta_s}"
        return digest("verdict", self.question.text, fleet, named(system.program, claim))

    @property
    def lineage(self) -> str:
        """The digest of what stays the same while somebody changes a program.

        What is found by it is of some program of that name, and has to be checked.
        """
        system = self.system
        agents = [system.program.agents[k].name for k in system.kinds]
        return digest("lineage", system.program.name, repr(agents), self.question.version)

    def key(self, claim: Claim, names: Names) -> str | None:
        """The key of a verdict that is a fact about the slice with parts of these names.

        None if there is no such slice here: some part is not there, or others influence it.
        """
        form = self._form(names)
        if form is None:
            return None
        return digest(self.question.text, *names, form.text, form.claim(claim))

    def layout(self, names: Names) -> str:
        """The layout of a slice that there is: which variable has which slot."""
        form = self._form(names)
        assert form is not None
        return form.numbering.layout

    def looked_at(self, claim: Claim, lemmas: Iterable[Names], *, whole: bool) -> Names:
        """The names of the parts that engines have looked at for a verdict on a claim.

        For a claim about states they are those that any such claim depends on, unless the ``whole``
        program was asked. For one about whole runs invariants about anything may have helped.
        ``lemmas`` are the parts that verdicts depend on which were known before: they may hold
        for reasons that nobody looked at again.
        """
        if whole or claim.kind is ClaimKind.LIVENESS:
            cone = self.slices.whole(self.claims)
        elif self.slices.common() is self.system:
            cone = self.slices.whole(claims_of(self.system))
        else:
            cone = self.slices.cone(claims_of(self.system))
        known = {part for names in lemmas for name in names if (part := self._part(name))}
        if not known <= cone:
            cone = self.slices.influence.closed(cone | known)
        return tuple(sorted(self._name(part) for part in _counting(cone)))

    def happening(self) -> Form:
        """The form of all that has an influence on whether events happen."""
        part = self.slices.happening()
        if part is self.system:
            return Form.of(part, frozenset({*self.slices.everything, Matter.WHOLE_RUNS}))
        return Form.of(part, self.slices.of_events())

    # --- parts by names -------------------------------------------------------------------------

    @cached_property
    def _by_part(self) -> dict[Part, str]:
        """The names of variables and events; of several alike with their numbers among those."""
        program = self.system.program
        found: dict[Part, str] = {}
        count: dict[str, int] = {}
        parts: list[Part] = [
            *variables(program),
            *(
                Happens(kind, position)
                for kind, agent in enumerate(program.agents)
                for position in range(len(agent.events))
            ),
        ]
        for part in parts:
            name = _named(program, part)
            count[name] = number = count.get(name, 0) + 1
            found[part] = name if number == 1 else f"{name} ({number})"
        return found

    @cached_property
    def _by_name(self) -> dict[str, Part]:
        return {name: part for part, name in self._by_part.items()}

    def _name(self, part: Part) -> str:
        match part:
            case Matter():
                return f"matter {part.name}"
            case Answers(function=function):
                return f"answers {function}"
            case _:
                return self._by_part[part]

    def _part(self, name: str) -> Part | None:
        word, _, rest = name.partition(" ")
        if word == "matter":
            return Matter.__members__.get(rest)
        if word == "answers":
            return Answers(rest)
        return self._by_name.get(name)

    def _form(self, names: Names) -> Form | None:
        if names not in self._forms:
            self._forms[names] = self._formed(names)
        return self._forms[names]

    def _formed(self, names: Names) -> Form | None:
        parts = [self._part(name) for name in names]
        found = frozenset(part for part in parts if part is not None)
        if None in parts:
            return None
        cone = self.slices.influence.closed(found)
        if frozenset(_counting(cone)) != found:
            return None
        return Form.of(self.slices.slice_of(cone), found)


def _counting(cone: Iterable[Part]) -> Iterator[Part]:
    """The parts of a cone that it is made of: bound variables of bodies follow from these."""
    return (part for part in cone if not isinstance(part, BodyVariable))


def _named(program: core.Program, part: Part) -> str:
    match part:
        case Happens(kind=kind, position=position):
            agent = program.agents[kind]
            return f"event {agent.name}.{agent.events[position].name}"
        case Var(home=Home.LOCAL, kind=int(kind), slot=slot):
            agent = program.agents[kind]
            return f"local {agent.name}.{agent.locals[slot].variable.name}"
        case Var(home=Home.PORT, kind=int(kind), slot=slot):
            agent = program.agents[kind]
            port = agent.ports[slot]
            return f"port {agent.name}.{port.module}.{port.declaration.variable.name}"
        case Var(home=Home.ALLREAD, slot=slot):
            return f"allread {program.allread[slot].variable.name}"
        case Var(home=Home.ALLWRITE, slot=slot):
            return f"allwrite {program.allwrite[slot].variable.name}"
        case _:
            raise AssertionError(f"{part} is not declared")
