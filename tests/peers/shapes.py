"""Koord's types as C: a struct of values and a struct of storage for each. [VALUE] [ATOM]"""

from __future__ import annotations

from dataclasses import dataclass, field

from koord.syntax.types import (
    ArrayType,
    BoolType,
    EnumType,
    IntType,
    ListType,
    MapType,
    QueueType,
    RecordType,
    Robots,
    StringType,
    Type,
)

#: Lists and maps have room for so many elements; a run that needs more makes the answer unsure.
ROOM = 5


class NotCoveredError(Exception):
    """The program has a construct that is not translated; the message is its name."""


@dataclass
class Shapes:
    """The C types made so far, in an order in which C can read them."""

    robots: int
    numbers: dict[Type, int] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._atom("0", "int")
        self.lines.append("static int eq0(int a, int b) { return a == b; }")

    def number(self, type_: Type) -> int:
        """Which C types stand for a type; they are made if there are none yet."""
        if isinstance(type_, IntType | BoolType | EnumType | StringType):
            return 0
        if type_ not in self.numbers:
            self._make(type_)
        return self.numbers[type_]

    def value(self, type_: Type) -> str:
        number = self.number(type_)
        return f"V{number}" if number else "int"

    def storage(self, type_: Type) -> str:
        return f"S{self.number(type_)}"

    def size(self, type_: ArrayType) -> int:
        return self.robots if type_.size is Robots.ALL else type_.size

    def count(self, type_: Type, value: str) -> str:
        """The number of elements of a C value."""
        return str(self.size(type_)) if isinstance(type_, ArrayType) else f"{value}.n"

    def _make(self, type_: Type) -> None:
        match type_:
            case RecordType(fields=fields):
                parts = [(f"f{n}", t) for n, (_, t) in enumerate(fields)]
            case ArrayType(element=element):
                parts = [(f"items[{n}]", element) for n in range(self.size(type_))]
            case ListType(element=element) | QueueType(element=element):
                self._container(type_, [("items", element)])
                return
            case MapType(key=key, value=value):
                self._container(type_, [("keys", key), ("items", value)])
                return
            case _:
                raise NotCoveredError(type(type_).__name__)
        self._tree(type_, parts)

    def _new(self, type_: Type) -> int:
        self.numbers[type_] = len(self.numbers) + 1
        return self.numbers[type_]

    def _tree(self, type_: Type, parts: list[tuple[str, Type]]) -> None:
        """A record or an array: storage has a part for each of theirs."""
        members = parts
        if isinstance(type_, ArrayType):
            members = [(f"items[{self.size(type_)}]", type_.element)]
        values = " ".join(f"{self.value(t)} {name};" for name, t in members)
        storage = " ".join(f"{self.storage(t)} {name};" for name, t in members)
        n = self._new(type_)
        read = " ".join(f"v.{p} = read{self.number(t)}(&p->{p});" for p, t in parts)
        write = " ".join(f"write{self.number(t)}(&p->{p}, v.{p});" for p, t in parts)
        equal = " && ".join(f"eq{self.number(t)}(a.{p}, b.{p})" for p, t in parts)
        self.lines += [
            f"typedef struct {{ {values} }} V{n};",
            f"typedef struct {{ {storage} }} S{n};",
            f"static V{n} read{n}(const S{n} *p) {{ V{n} v; {read} return v; }}",
            f"static void write{n}(S{n} *p, V{n} v) {{ {write} }}",
            f"static int eq{n}(V{n} a, V{n} b) {{ return {equal or '1'}; }}",
        ]

    def _container(self, type_: Type, members: list[tuple[str, Type]]) -> None:
        """A list, queue or map: one atom."""
        values = " ".join(f"{self.value(t)} {name}[{ROOM}];" for name, t in members)
        equals = {name: f"eq{self.number(t)}" for name, t in members}
        n = self._new(type_)
        self.lines.append(f"typedef struct {{ int n; {values} }} V{n};")
        self._atom(str(n), f"V{n}")
        if isinstance(type_, MapType):
            key, same = self.value(type_.key), equals["keys"]
            self.lines += [
                f"static int find{n}(const V{n} *m, {key} k) {{ int i; "
                f"for (i = 0; i < m->n; i++) if ({same}(m->keys[i], k)) return i; "
                "return -1; }",
                f"static int place{n}(V{n} *m, {key} k) {{ int i = find{n}(m, k); "
                f"if (i < 0) {{ if (m->n == {ROOM}) TOO_LARGE(); i = m->n++; m->keys[i] = k; }} "
                "return i; }",
                f"static void drop{n}(V{n} *m, int i) {{ for (; i + 1 < m->n; i++) {{ "
                "m->keys[i] = m->keys[i + 1]; m->items[i] = m->items[i + 1]; } m->n--; "
                "memset(&m->keys[m->n], 0, sizeof m->keys[0]); "
                "memset(&m->items[m->n], 0, sizeof m->items[0]); }",
            ]
            each = f"int j = find{n}(&b, a.keys[i]); "
            each += f"if (j < 0 || !{equals['items']}(a.items[i], b.items[j])) return 0;"
        else:
            self.lines += [
                f"static void drop{n}(V{n} *m, int i) {{ for (; i + 1 < m->n; i++) "
                "m->items[i] = m->items[i + 1]; m->n--; "
                "memset(&m->items[m->n], 0, sizeof m->items[0]); }",
            ]
            each = f"if (!{equals['items']}(a.items[i], b.items[i])) return 0;"
        self.lines.append(
            f"static int eq{n}(V{n} a, V{n} b) {{ int i; if (a.n != b.n) return 0; "
            f"for (i = 0; i < a.n; i++) {{ {each} }} return 1; }}"
        )

    def _atom(self, n: str, value: str) -> None:
        self.lines += [
            f"typedef struct {{ int set; {value} v; }} S{n};",
            f"static {value} read{n}(const S{n} *p) {{ if (!p->set) LEAVE(FAULT); return p->v; }}",
            f"static void write{n}(S{n} *p, {value} v) {{ p->set = 1; p->v = v; }}",
        ]
