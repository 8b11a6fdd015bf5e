"""Translation of a program with its robots: INIT, robots' turns one at a time, the round's end.

``snap`` is what all robots have for copies until the round is over [REFRESH]; ``moved`` are those
that had their turn, ``taken`` the lock classes that are entered.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import count

from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import Home, PropertyKind, Start
from koord.syntax.system import System
from koord.syntax.types import INT, ArrayType, ListType, contains, within
from koord.syntax.walk import nodes, reached, statements, written
from koord.verify.export.tla.expressions import (
    Scope,
    check_type,
    chosen,
    function_name,
    name_of,
    refused,
    text,
    unset,
    values,
)
from koord.verify.export.tla.statements import TlaWriter, constant

_ALL = "<<loc, store, snap, status, ran, moved, taken>>"

#: Names that the module itself uses.
_OWN = re.compile(
    "[aikmqv][0-9]*|[bn]|loc|store|snap|status|ran|moved|taken|Robots|None|Unbound|Least|Greatest|Quotient|Remainder|"
    "Within|Memory|View|Stopping|Over|Took|Skip|Turn|Environment|Next|Init|Spec|Begun|Kind|Obliged|"
    "Event|Started[0-9]*|(pre|eff|fun)_.*|self|index|last|old|new|then|before|st|event|memory|"
    "Int|Nat|Cardinality|IsFiniteSet|Print|PrintT|Assert|JavaTime|TLC.*|Permutations|SortSeq|"
    "RandomElement|Any|ToString"
)

#: A robot's turn, whatever its events are. [EVENT-TRANS] [END-EVENT] [END-PROG]
_TURNS = r"""
Least(a, b) == IF a < b THEN a ELSE b
Greatest(a, b) == IF a < b THEN b ELSE a
Quotient(a, b) == IF b < 0 THEN (0 - a) \div (0 - b) ELSE a \div b
Remainder(a, b) == IF b < 0 THEN 0 - ((0 - a) % (0 - b)) ELSE a % b
Within(index, last) ==
    IF index \in 0..last THEN index ELSE Assert(FALSE, "an index is out of range")

Memory(self) ==
    [l |-> loc[self], c |-> snap, s |-> store, b |-> Unbound, k |-> {}, st |-> "running",
     f |-> "next", v |-> 0]
View ==
    [l |-> <<>>, c |-> store, s |-> store, b |-> Unbound, k |-> {}, st |-> "running",
     f |-> "next", v |-> 0]

Stopping(old, new) ==
    IF "stopped" \in {old, new} THEN "stopped" ELSE IF "asked" \in {old, new} THEN "asked" ELSE old

Over(self, st, event) ==
    LET then == [status EXCEPT ![self] = Stopping(@, st)]
        before == IF moved = {} THEN [i \in Robots |-> None] ELSE ran
    IN  /\ moved' = moved \cup {self}
        /\ ran' = [before EXCEPT ![self] = event]
        /\ status' = IF moved' = Robots /\ \A i \in Robots: then[i] # "running"
                     THEN [i \in Robots |-> "stopped"] ELSE then
        /\ UNCHANGED snap

Took(self, m, event) ==
    /\ m.k \cap taken = {}
    /\ loc' = [loc EXCEPT ![self] = m.l]
    /\ store' = m.s
    /\ taken' = taken \cup m.k
    /\ Over(self, m.st, event)
""".strip()

#: What is made of the events. [SELECT] [SKIP] [REFRESH] [ENV-TRANS]
_ROUNDS = r"""
Skip(self) ==
    /\ status[self] = "stopped" \/ ~Obliged(self)
    /\ UNCHANGED <<loc, store, taken>>
    /\ Over(self, "running", None)

Turn(self) == self \notin moved /\ (Skip(self) \/ Event(self))

Environment ==
    /\ moved = Robots
    /\ snap' = store
    /\ moved' = {}
    /\ taken' = {}
    /\ UNCHANGED <<loc, store, status, ran>>

Next == Environment \/ \E self \in Robots: Turn(self)
""".strip()


def module(system: System, name: str, names: tuple[str, ...], comment: str) -> Iterator[str]:
    """Translate to the lines of a module. Raises KoordError for what cannot be translated.

    ``names`` are the properties that are wanted; none means all. Liveness is left out.
    """
    program = _settled(system.program)
    system = replace(system, program=program)
    _check(program)
    writer = TlaWriter(_longest(system))
    stated = [
        p
        for p in program.properties
        if p.kind in (PropertyKind.INVARIANT, PropertyKind.AT_ROUND)
        and (not names or p.name in names)
    ]
    blank = frozenset(
        entry.variable for entry in _declarations(program) if entry.initial is Start.UNSET
    )
    here = Scope(program, system.kinds, "View", "", blank=blank)
    yield f"{'-' * 20} MODULE {name} {'-' * 20}"
    yield f"\\* {comment}"
    yield "\\*"
    yield f"\\* TLC: java -cp tla2tools.jar tlc2.TLC -deadlock -config {name}.cfg {name}.tla"
    yield f"\\* In {name}.cfg:"
    yield "\\*   INIT Init"
    yield "\\*   NEXT Next"
    yield from (f"\\*   INVARIANT {invariant_name(p.name)}" for p in stated)
    yield "\\* A fault (an index out of range, a division by zero) is an error of TLC's evaluation."
    yield "EXTENDS Integers, FiniteSets, TLC"
    yield "VARIABLES loc, store, snap, status, ran, moved, taken"
    yield f"Robots == 0..{system.robots - 1}"
    yield "None == <<>>"
    # No operator takes None with a number, a Boolean or a string: what is unset is an error.
    yield f"Unbound == [k \\in 0..{_bounds(program)} |-> None]"
    yield _TURNS
    inside = replace(here, memory="m", me="self")
    yield from _functions(program, inside, writer)
    yield from _events(system, inside, writer)
    yield _ROUNDS
    yield from _init(system, inside, writer)
    for p in stated:
        holds = text(p.condition, here)
        holds = f"(moved = {{}} => {holds})" if p.kind is PropertyKind.AT_ROUND else holds
        yield f"{invariant_name(p.name)} == {holds}"
    yield f"Spec == Init /\\ [][Next]_{_ALL}"
    yield "=" * 60


def invariant_name(name: str) -> str:
    """The operator's name for a property: its own, unless the module uses that."""
    return f"{name}_" if _OWN.fullmatch(name) else name_of(name)


def _check(program: core.Program) -> None:
    for agent in program.agents:
        for module_ in agent.modules:
            raise refused(f"the module {module_.name}", module_.span, "leave modules out")
        for place in (p for node in nodes(agent.init) for p in written(node)):
            if place.variable.home is Home.ALLWRITE:
                hint = "give it an initial value where it is declared"
                raise refused("an allwrite variable that INIT writes", place.span, hint)
    for entry in _declarations(program):
        check_type(entry.variable.type, entry.span)
        if contains(entry.variable.type, ListType):
            raise refused("a list that is kept", entry.span, "use an array: its length is known")
    starting = [e.initial for e in _declarations(program)] + [a.init for a in program.agents]
    for node in (n for part in starting for n in reached(program, part)):
        # Until INIT is over, entries of other robots are unset.
        if isinstance(node, core.Read) and node.place.variable.home is Home.ALLREAD:
            raise refused("a shared array that INIT reads", node.span, "read it in an event")


def _settled(program: core.Program) -> core.Program:
    """The program with locals left unset whose arbitrary start is never read.

    That is of those that INIT writes in any case, and that nothing of INIT reads.
    """

    def settled(agent: core.Agent, entry: core.Declaration) -> core.Declaration:
        starting = (agent.init, *(e.initial for e in agent.locals if e is not entry))
        seen = [n for n in reached(program, starting) if isinstance(n, core.Read)]
        whole = [s.place for s in agent.init if isinstance(s, core.Assign)]
        is_read = any(n.place.variable == entry.variable for n in seen)
        if core.Place(entry.variable) in whole and not is_read:
            return replace(entry, initial=Start.UNSET)
        return entry

    agents = [
        replace(
            agent,
            locals=tuple(
                settled(agent, e) if e.initial is Start.ARBITRARY else e for e in agent.locals
            ),
        )
        for agent in program.agents
    ]
    return replace(program, agents=tuple(agents))


def _declarations(program: core.Program) -> list[core.Declaration]:
    own = [entry for agent in program.agents for entry in agent.locals]
    return [*program.allwrite, *program.allread, *own]


def _longest(system: System) -> int:
    """The largest size of any array."""
    types = [t for e in _declarations(system.program) for t in within(e.variable.type)]
    sizes = [t.size for t in types if isinstance(t, ArrayType) and isinstance(t.size, int)]
    return max([system.robots, *sizes])


def _bounds(program: core.Program) -> int:
    agents = [x for a in program.agents for x in (a.init_bound, *(e.bound for e in a.events))]
    return max([*agents, *(f.bound for f in program.functions), 0])


def _functions(program: core.Program, of: Scope, writer: TlaWriter) -> Iterator[str]:
    """The functions that are called, callees first."""
    agents = tuple((a.init, a.events) for a in program.agents)
    stated = tuple(p.condition for p in program.properties)
    starting = tuple(entry.initial for entry in _declarations(program))
    assumed = tuple(a.condition for a in program.assumptions)
    whole = (*agents, *stated, *assumed, *starting)
    called = {n.function for n in reached(program, whole) if isinstance(n, core.Call)}
    for function in program.functions:
        if function.name not in called:
            continue
        parameters = [f"a{p.slot}" for p in function.parameters]
        given = "".join(f", !.b[{p.slot}] = a{p.slot}" for p in function.parameters)
        start = f'm == [memory EXCEPT !.f = "next"{given}]'
        head = "".join(f", {parameter}" for parameter in parameters)
        yield f"{function_name(function.name)}(memory, self{head}) =="
        yield f"    LET {start} IN {writer.block(function.body, of)}.v"


def _events(system: System, of: Scope, writer: TlaWriter) -> Iterator[str]:
    program = system.program
    choices, duties = [], []
    for kind, agent in enumerate(program.agents):
        robots = f"{{{', '.join(str(i) for i, k in enumerate(system.kinds) if k == kind)}}}"
        for position, event in enumerate(agent.events):
            name = f"{agent.name}_{event.name}" if len(program.agents) > 1 else event.name
            yield f"pre_{name}(self) == LET m == Memory(self) IN {text(event.guard, of)}"
            yield f"eff_{name}(self) == LET m == Memory(self) IN {writer.block(event.effect, of)}"
            choices.append(
                f'self \\in {robots} /\\ status[self] # "stopped" /\\ pre_{name}(self)'
                f" /\\ Took(self, eff_{name}(self), <<{kind}, {position}>>)"
            )
            if event.urgent:
                classes = f"{{{', '.join(map(str, sorted(event.lock_classes)))}}}"
                free = f"{classes} \\cap taken = {{}}"
                duties.append(f"self \\in {robots} /\\ {free} /\\ pre_{name}(self)")
    yield "Obliged(self) == " + (" \\/ ".join(f"({x})" for x in duties) or "FALSE")
    yield "Event(self) ==" + "".join(f"\n    \\/ {choice}" for choice in choices)


def _picks(program: core.Program, of: Scope) -> tuple[dict[str, str], dict[str, str]]:
    """The inputs of INIT, each with the set of its values: shared ones, and ones per robot.

    [CHOOSE]
    """
    common = {_start(e): _any(e, of) for e in program.allwrite if e.initial is Start.ARBITRARY}
    own = [*program.allread, *(entry for agent in program.agents for entry in agent.locals)]
    each = {_start(e): _any(e, of) for e in own if e.initial is Start.ARBITRARY}
    for agent in program.agents:
        loops = [s for s in statements(agent.init) if isinstance(s, core.ForRange | core.ForEach)]
        repeated = {id(node) for loop in loops for node in nodes(loop)}
        for node in nodes(agent.init):
            if isinstance(node, core.Choose):
                each[chosen(node.site)] = _range(node, of, is_repeated=id(node) in repeated)
    return common, each


def _range(choice: core.Choose, of: Scope, *, is_repeated: bool) -> str:
    if is_repeated:
        raise refused("choose in a loop", choice.span, "choose outside of loops")
    if choice.type != INT:
        raise refused("choose among floats", choice.span, "choose among integers")
    low, high = (constant(bound, of, "choose") for bound in (choice.low, choice.high))
    if low > high:
        raise refused("choose among nothing", choice.span, "give the lower bound first")
    return f"({low})..({high})"


def _start(entry: core.Declaration) -> str:
    """The name of an arbitrary variable's start value: kinds may share slots."""
    variable = entry.variable
    return re.sub(r"\W", "_", f"{variable.home.value}_{variable.slot}_{variable.type}")


def _any(entry: core.Declaration, of: Scope) -> str:
    type_ = entry.variable.type
    if entry.variable.home is Home.ALLREAD:
        assert isinstance(type_, ArrayType)
        type_ = type_.element
    found = values(type_, of)
    if found is None:
        what = f"{entry.variable.name}, which starts as any value there is,"
        hint = "give it an initial value, or choose one in `init:`"
        raise refused(what, entry.span, hint)
    return found


def _init(system: System, of: Scope, writer: TlaWriter) -> Iterator[str]:
    """Translate INIT. [INIT]"""
    program = system.program
    common, each = _picks(program, of)
    empty = ", ".join(f"{name_of(e.variable.name)} |-> 0" for e in program.allwrite)
    own = [f"{name_of(e.variable.name)} |-> [i \\in Robots |-> 0]" for e in program.allread]
    shared = ", ".join([*([empty] if empty else []), *own])
    blank = f"[{shared}]" if shared else "<<>>"
    begins, starts = (["common"] if common else []), (["pick"] if each else [])
    start = (
        f'[l |-> <<>>, c |-> {blank}, s |-> {blank}, b |-> Unbound, k |-> {{}}, st |-> "running", '
        'f |-> "next", v |-> 0]'
    )
    assigns = [(e, _place(e.variable)) for e in program.allwrite]
    begun = f"Begun{_given(begins)}"
    yield f"{begun} == LET m == {start} IN {_begun(assigns, replace(of, picks='common'), writer)}"
    cases = []
    for kind, agent in enumerate(program.agents):
        fields = ", ".join(f"{name_of(e.variable.name)} |-> 0" for e in agent.locals)
        memory = f"[{begun} EXCEPT !.l = {f'[{fields}]' if fields else '<<>>'}]"
        assigns = [(e, _place(e.variable)) for e in agent.locals]
        assigns += [(e, _own(e.variable)) for e in program.allread]
        own_start = _begun(assigns, replace(of, picks="pick"), writer)
        after = writer.block(agent.init, replace(of, memory="n", picks="pick"))
        given = _given(["self", *begins, *starts])
        yield f"Started{kind}{given} == LET m == {memory} IN LET n == {own_start} IN {after}"
        cases.append((kind, f"Started{kind}{given}"))
    yield f"Kind == [self \\in Robots |-> {_by_robot(list(map(str, system.kinds)))}]"
    picked = "".join(f"IF Kind[self] = {kind} THEN {e} ELSE " for kind, e in cases[:-1])
    yield f"Started{_given(['self', *begins, *starts])} == {picked}{cases[-1][1]}"
    i = f"Started{_given(['i', *begins, *(['picks[i]'] if each else [])])}"
    entries = "".join(
        f", !.{name_of(e.variable.name)} = [i \\in Robots |-> {i}.s.{name_of(e.variable.name)}[i]]"
        for e in program.allread
    )
    yield "Init =="
    sets = [f"common \\in {_records(common)}"] if common else []
    sets += [f"picks \\in [Robots -> {_records(each)}]"] if each else []
    if sets:
        yield f"    \\E {', '.join(sets)}:"
    yield f"    /\\ loc = [i \\in Robots |-> {i}.l]"
    yield f"    /\\ store = {f'[{begun}.s EXCEPT {entries[2:]}]' if entries else f'{begun}.s'}"
    yield "    /\\ snap = store"
    yield f"    /\\ status = [i \\in Robots |-> {i}.st]"
    yield "    /\\ ran = [i \\in Robots |-> None]"
    yield "    /\\ moved = {} /\\ taken = {}"
    for assumption in program.assumptions:
        holds = text(assumption.condition, replace(of, memory="View", me=""))
        yield f"    /\\ {holds}"


def _begun(assigns: list[tuple[core.Declaration, core.Place]], of: Scope, writer: TlaWriter) -> str:
    """The memory after the declarations' initial values, in order."""
    memory, steps = "m", []
    names = count()
    for entry, place in assigns:
        name = f"i{next(names)}"
        here = of.at(memory)
        if entry.initial is Start.UNSET:
            kept = place.variable.type if not place.steps else place.steps[-1].type
            value = unset(kept, of)
        elif entry.initial is Start.ARBITRARY:
            value = f"{of.picks}.{_start(entry)}"
        else:
            value = text(entry.initial, here)
        steps.append(f"{name} == {writer.assigned(place, value, here)}")
        memory = name
    return f"(LET {' '.join(steps)} IN {memory})" if steps else memory


def _given(names: Sequence[str]) -> str:
    return f"({', '.join(names)})" if names else ""


def _records(parts: dict[str, str]) -> str:
    return f"[{', '.join(f'{name}: {of}' for name, of in parts.items())}]"


def _place(variable: core.Variable) -> core.Place:
    return core.Place(variable)


def _own(variable: core.Variable) -> core.Place:
    """A robot's own entry of an allread variable."""
    assert isinstance(variable.type, ArrayType)
    return core.Place(variable, (core.IndexStep(core.Pid(INT), variable.type.element),))


def _by_robot(values: list[str]) -> str:
    chosen = "".join(f"IF self = {n} THEN {value} ELSE " for n, value in enumerate(values[:-1]))
    return chosen + values[-1]
