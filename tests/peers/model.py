"""A system as a Promela model, with the bodies of its events in C.

Promela has what the rules leave open: the order of the robots, the event or the skip of each, every
answer. C has what they fix (``rules.h``): bodies, races, locks, the end of a round. Bounded by a
number of rounds. ``found[k]`` is the first round in which claim k is seen broken: a variable
outside of SPIN's state, so that one search answers for all claims.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import count
from pathlib import Path

from msgspec import Struct

from koord.syntax import core
from koord.syntax.core import Direction, Home, PropertyKind, Start
from koord.syntax.types import INT, ArrayType, Type
from koord.syntax.walk import nodes
from tests.peers import statements
from tests.peers.bodies import Body
from tests.peers.shapes import NotCoveredError, Shapes

_HERE = Path(__file__).parent

#: The name of the claim that nothing faults.
NO_FAULT = "no fault"

#: So many answers may be asked for in one step.
_ANSWERS = 40


class Model(Struct, frozen=True):
    """Two files for SPIN, and the names of the claims by number."""

    promela: str
    rules: str  #: ``rules.h``
    claims: tuple[str, ...]


def translate(program: core.Program, kinds: tuple[int, ...], rounds: int) -> Model:
    """The model of a program with robots of these kinds. Raises NotCoveredError."""
    made = _Translation(program, kinds)
    rules = made.rules()
    return Model(_promela(len(kinds), made.most_events(), rounds), rules, tuple(made.claims))


class _Translation:
    """One program on its way to C."""

    def __init__(self, program: core.Program, kinds: tuple[int, ...]) -> None:
        self.program, self.kinds = program, kinds
        self.shapes = Shapes(len(kinds))
        self.texts: dict[str, int] = {}
        self.names = count()
        self.claims = [NO_FAULT]

    def most_events(self) -> int:
        return max((len(self.program.agents[kind].events) for kind in self.kinds), default=0)

    def rules(self) -> str:
        fields = self._state()
        functions = [statements.function(self._body(), f) for f in self.program.functions]
        externals = [statements.external(self._body(), f) for f in self.program.externals]
        bodies = [self._begin(), *map(self._agent, range(len(self.program.agents)))]
        bodies += [self._statements("assumption", [a.condition for a in self.program.assumptions])]
        stated = list(self.program.properties)
        self.claims[1:1] = [p.name for p in stated]
        bodies += [self._statements("property", [p.condition for p in stated])]
        tables = [
            self._table("static int (*init_of[KINDS])(struct Context *)", "init"),
            self._table("static int (*evolve_of[KINDS])(struct Context *)", "evolve"),
            self._table("static int (**guards_of[KINDS])(struct Context *)", "guards"),
            self._table("static int (**effects_of[KINDS])(struct Context *)", "effects"),
            self._table("static const int *urgent_of[KINDS]", "urgent"),
            self._table("static const int *classes_of[KINDS]", "classes"),
            self._table("static const int events_of[KINDS]", "events"),
        ]
        at_round = ", ".join(str(int(p.kind is PropertyKind.AT_ROUND)) for p in stated) or "0"
        return "\n".join(
            [
                f"#define ROBOTS {len(self.kinds)}",
                f"#define KINDS {len(self.program.agents)}",
                f"#define ANSWERS {_ANSWERS}",
                f"#define ASSUMPTIONS {len(self.program.assumptions)}",
                f"#define PROPERTIES {len(stated)}",
                f"#define CLAIMS {len(self.claims)}",
                f"static const int KIND[ROBOTS] = {{ {', '.join(map(str, self.kinds))} }};",
                f"static const int AT_ROUND[] = {{ {at_round} }};",
                (_HERE / "prelude.h").read_text("utf-8"),
                *self.shapes.lines,
                fields,
                *(f.partition(" {")[0] + ";" for f in functions),
                *externals,
                *functions,
                *bodies,
                *tables,
                (_HERE / "rounds.h").read_text("utf-8"),
            ]
        )

    def _table(self, heading: str, name: str) -> str:
        entries = ", ".join(f"{name}_{kind}" for kind in range(len(self.program.agents)))
        return f"{heading} = {{ {entries} }};"

    def _body(self, kind: int | None = None) -> Body:
        return Body(self.program, self.shapes, self.texts, self.names, kind)

    def _function(self, name: str, kind: int | None, text: Callable[[Body], str]) -> str:
        """A C function from a context to an int; 1 if the text does not return."""
        body = self._body(kind)
        inner = text(body)
        heading = f"static int {name}(struct Context *cx)"
        return f"{heading} {{ {body.declarations()} {inner} return 1; }}"

    # --- the state --------------------------------------------------------------------------------

    def _state(self) -> str:
        """[CONFIG]"""
        program = self.program
        own = []
        for kind, agent in enumerate(program.agents):
            for entry in agent.locals:
                variable = entry.variable
                own.append(f"{self._storage(variable.type)} a{kind}l{variable.slot};")
            for port in agent.ports:
                variable = port.declaration.variable
                own.append(f"{self._storage(variable.type)} a{kind}p{variable.slot};")
        shared = [
            f"{self._storage(entry.variable.type)} {letter}{entry.variable.slot};"
            for letter, entries in (("r", program.allread), ("w", program.allwrite))
            for entry in entries
        ]
        return (
            f"struct Shared {{ int none; {' '.join(shared)} }};\n"
            f"struct Robot {{ int moved, ran, status; {' '.join(own)} struct Shared copy; }};"
            "\nstruct System { int round, outcome, need, have, taken, faulty, broken, edge; "
            "int digits[ANSWERS]; struct Robot robots[ROBOTS]; struct Shared store; };\n"
            "struct Context { struct System *state; struct Robot *me, *out; "
            "struct Shared *copy, *store; int pid, entered, stop; };"
        )

    def _storage(self, type_: Type) -> str:
        return self.shapes.storage(type_)

    # --- bodies -----------------------------------------------------------------------------------

    def _begin(self) -> str:
        """The allwrite variables, in order of declaration. [INIT]"""
        return self._function(
            "begin_store", None,
            lambda body: " ".join(
                self._start(body, entry, entry.variable.type) for entry in self.program.allwrite
            ),
        )  # fmt: skip

    def _start(self, body: Body, entry: core.Declaration, type_: Type) -> str:
        """start(x), written to x; of an allread variable to the robot's own entry."""
        variable, v = entry.variable, body.fresh()
        if entry.initial is Start.UNSET:
            return ""
        if isinstance(entry.initial, Start):
            given = body.arbitrary(type_, entry.length)
        else:
            given = body.as_(entry.initial, type_)
        place = core.Place(variable)
        if variable.home is Home.ALLREAD:
            place = core.Place(variable, (core.IndexStep(core.Pid(INT), type_),))
        put = statements.write(body, place, v)
        return f"{{ {self.shapes.value(type_)} {v} = {given}; {put} }}"

    def _agent(self, kind: int) -> str:
        agent = self.program.agents[kind]
        parts = [self._function(f"init_{kind}", kind, lambda body: self._init(body, agent))]
        for position, event in enumerate(agent.events):
            if event.urgent and _asks(event.guard):
                raise NotCoveredError("an external call in an urgent event's guard")
            guard = self._body(kind)
            test = guard.expr(event.guard)
            parts.append(
                f"static int guard_{kind}_{position}(struct Context *cx) "
                f"{{ {guard.declarations()} return {test}; }}"
            )
            parts.append(
                self._function(f"event_{kind}_{position}", kind, partial(_effect, event.effect))
            )
        guards = [f"guard_{kind}_{n}" for n in range(len(agent.events))]
        effects = [f"event_{kind}_{n}" for n in range(len(agent.events))]
        urgent = [int(event.urgent) for event in agent.events]
        classes = [sum(1 << k for k in event.lock_classes) for event in agent.events]
        parts += [
            f"static int (*guards_{kind}[])(struct Context *) = {{ {', '.join([*guards, '0'])} }};",
            f"static int (*effects_{kind}[])(struct Context *) = "
            f"{{ {', '.join([*effects, '0'])} }};",
            f"static const int urgent_{kind}[] = {{ {', '.join(map(str, [*urgent, 0]))} }};",
            f"static const int classes_{kind}[] = {{ {', '.join(map(str, [*classes, 0]))} }};",
            f"enum {{ events_{kind} = {len(agent.events)} }};",
            self._function(f"evolve_{kind}", kind, lambda body: self._evolve(body, agent)),
        ]
        return "\n".join(parts)

    def _init(self, body: Body, agent: core.Agent) -> str:
        """Ports, locals, own entries, then the block. [INIT]"""
        entries = [*(port.declaration for port in agent.ports), *agent.locals]
        starts = [self._start(body, entry, entry.variable.type) for entry in entries]
        for entry in self.program.allread:
            assert isinstance(entry.variable.type, ArrayType)
            starts.append(self._start(body, entry, entry.variable.type.element))
        return " ".join([*starts, statements.block(body, agent.init)])

    def _evolve(self, body: Body, agent: core.Agent) -> str:
        """[ENV-MODEL] [ENV-FREE] [ENV-CONTRACT]"""
        parts = ["int held;"]
        for module in agent.modules:
            if module.environment is not None:
                parts.append(f"{{ {statements.block(body, module.environment)} }}")
                continue
            for position in module.ports:
                port = agent.ports[position]
                if port.direction is Direction.SENSOR:
                    free = core.Declaration(port.declaration.variable, Start.ARBITRARY)
                    parts.append(self._start(body, free, free.variable.type))
        for module in agent.modules:
            for contract in module.contracts:
                kept = "LEAVE(ILLEGAL);"
                if module.environment is not None:
                    kept = f"cx->state->broken |= 1 << {len(self.claims) - 1};"
                    self.claims.append(f"contract {contract.name}")
                tests = [
                    f"HOLDS(held, {body.expr(e)}); if (!held) break;" for e in contract.requires
                ]
                tests += [
                    f"HOLDS(held, {body.expr(e)}); if (!held) {{ {kept} break; }}"
                    for e in contract.ensures
                ]
                parts.append(f"do {{ {' '.join(tests)} }} while (0);")
        return " ".join(parts)

    def _statements(self, name: str, conditions: list[core.Expr]) -> str:
        parts = []
        for n, condition in enumerate(conditions):
            if _asks(condition):
                raise NotCoveredError("a choice in a statement")
            body = self._body()
            test = body.expr(condition)
            parts.append(
                f"static int {name}_{n}(struct Context *cx) "
                f"{{ {body.declarations()} return {test}; }}"
            )
        listed = ", ".join([*(f"{name}_{n}" for n in range(len(conditions))), "0"])
        parts.append(f"static int (*{name}_of[])(struct Context *) = {{ {listed} }};")
        return "\n".join(parts)


def _effect(effect: core.Block, body: Body) -> str:
    return statements.block(body, effect)


def _asks(e: core.Expr) -> bool:
    return any(isinstance(node, core.ExternalCall | core.Choose) for node in nodes(e))


# --- Promela --------------------------------------------------------------------------------------


def _promela(robots: int, events: int, rounds: int) -> str:
    """The rounds: INIT in any order, then turns in any order and the environment."""
    unmoved = "\n".join(
        f"    :: c_expr {{ !now.st.robots[{i}].moved }} -> who = {i}" for i in range(robots)
    )
    which = "\n".join(f"    :: event = {e}" for e in range(events))
    environment = "\n".join(
        f"  who = {i};\n{_step('EVOLVE')}\n"
        "  c_code { if (now.st.outcome == FAULT) now.st.faulty = 1; };\n"
        "  c_expr { now.st.outcome == DONE || now.st.outcome == FAULT };"
        for i in range(robots)
    )
    return f"""
c_decl {{
\\#include "rules.h"
}}
c_state "struct System st" "Global"

byte who;
byte event;
byte digit;

active proctype rounds() {{
atomic {{
  c_code {{ get_ready(); }};
{_step("BEGIN")}
{_CHECK}
  do
  :: c_expr {{ !ALL_MOVED }} ->
    if
{unmoved}
    fi;
{_step("INIT")}
{_CHECK}
  :: c_expr {{ ALL_MOVED }} -> break
  od;
{_step("READY")}
{_CHECK}
  who = 0;
  c_code {{ look(&now.st, 1); }};
}};
  do
  :: atomic {{ c_expr {{ now.st.round < {rounds} }} ->
  c_code {{ now.st.round++; now.st.outcome = DONE; }};
  }};
  do
  :: atomic {{ c_expr {{ !ALL_MOVED }} ->
    if
{unmoved}
    fi;
    if
    :: c_expr {{ MAY_SKIP }} -> c_code {{
        turn_over(&now.st, now.who, 0, RUNNING); now.st.outcome = DONE; }}
    :: true ->
    if
{which}
    fi;
{_step("TURN")}
    fi;
{_CHECK}
    who = 0; event = 0;
    c_code {{ look(&now.st, 0); }};
  }}
  :: atomic {{ c_expr {{ ALL_MOVED }} -> break }}
  od;
  atomic {{
{environment}
  who = 0;
  c_code {{ round_over(&now.st); }};
  c_expr {{ now.st.outcome == DONE }};
  }}
  :: c_expr {{ now.st.round == {rounds} }} -> break
  od
}}
"""


#: Where the step is none of the program's, or a fault, the run is over.
_CHECK = """  c_code { if (now.st.outcome == FAULT) fault(&now.st); };
  c_expr { now.st.outcome == DONE };"""


def _step(step: str) -> str:
    """A step, with every answer it asks for."""
    again = f"now.st.outcome = take_step(&now.st, {step}, now.who, now.event);"
    return f"""  c_code {{ {again} }};
  do
  :: c_expr {{ now.st.outcome == NEED }} ->
    digit = 0;
    do
    :: c_expr {{ now.digit + 1 < now.st.need }} -> digit++
    :: break
    od;
    c_code {{ answer(&now.st, now.digit); now.digit = 0; {again} }}
  :: c_expr {{ !(now.st.outcome == NEED) }} -> break
  od;"""
