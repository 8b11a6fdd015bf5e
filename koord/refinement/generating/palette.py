"""Palettes of generated programs: sizes, types, and paths from variables to their parts."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from functools import lru_cache
from random import Random

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    POS,
    PRESENT,
    STRING,
    ArrayType,
    EnumType,
    ListType,
    MapType,
    QueueType,
    RecordType,
    SequenceType,
    SetType,
    Type,
)


class Profile(Struct, frozen=True):
    """The parameters of generated programs: sizes are inclusive ranges, rates probabilities.

    ``finite`` programs have finitely many reachable configurations: integers stay in a small range,
    lists do not grow for ever, and whatever is left open has finitely many answers.
    """

    finite: bool
    robots: tuple[int, int]
    agents: tuple[int, int]
    shared: tuple[int, int]
    locals: tuple[int, int]
    modules: tuple[int, int]
    functions: tuple[int, int]
    externals: tuple[int, int]
    events: tuple[int, int]
    statements: tuple[int, int]
    depth: int  #: of expressions
    nesting: int  #: of statements
    faulty: float  #: indices, divisors and keys that may be wrong
    unset: float  #: variables without an initial value
    urgent: float
    arbitrary: float  #: variables that start arbitrary
    calculates: bool = True  #: if not, integers are robots: stored, compared, used as indices


GENERAL = Profile(
    finite=False,
    robots=(1, 3),
    agents=(1, 2),
    shared=(1, 3),
    locals=(1, 3),
    modules=(0, 2),
    functions=(0, 2),
    externals=(0, 2),
    events=(1, 3),
    statements=(1, 4),
    depth=3,
    nesting=2,
    faulty=0.12,
    unset=0.08,
    urgent=0.2,
    arbitrary=0.1,
)

#: As ``GENERAL``, with little that goes wrong: runs come to their last round.
CALM = replace(GENERAL, faulty=0.01, unset=0.01)

#: As ``GENERAL``, with longer bodies in which more goes wrong, or nearly.
WILD = replace(GENERAL, statements=(2, 5), faulty=0.3, unset=0.1, urgent=0.4)


class Palette(Struct, frozen=True):
    """Types to choose from: ``scalars`` for keys and leaves, ``all`` for variables."""

    scalars: tuple[Type, ...]
    all: tuple[Type, ...]


def palette(random: Random, *, finite: bool) -> Palette:
    """Make a palette: a few named types, and containers of them."""
    colour = EnumType("Colour", ("red", "green", "blue")[: random.randint(2, 3)])
    scalars: list[Type] = [INT, BOOL, colour]
    if not finite:
        scalars += [INT, FLOAT, FLOAT, STRING]
    elif random.random() < 0.3:
        scalars += [FLOAT, STRING]
    pair = RecordType("Pair", (("a", random.choice(scalars)), ("b", random.choice(scalars))))
    nested = RecordType("Nested", (("pair", pair), ("c", random.choice(scalars))))
    task = RecordType("Item", (("done", BOOL), ("owner", INT)))
    whole: list[Type] = [*scalars, *scalars, pair, nested, task]
    if not finite:
        whole.append(POS)
    keys: list[Type] = [colour, INT, BOOL]
    element = random.choice([*scalars, pair, task])
    whole += [
        ArrayType(element, random.randint(1, 3)),
        ArrayType(ArrayType(random.choice(scalars), 2), 2),
        ListType(random.choice([*scalars, pair, task])),
        ListType(ListType(random.choice(scalars))),
        QueueType(random.choice([*scalars, pair])),
        _keyed(random.choice(keys), random.choice([*scalars, pair])),
        RecordType("Holder", (("items", ListType(random.choice(scalars))), ("flag", BOOL))),
    ]
    return Palette(tuple(scalars), tuple(whole))


def _keyed(key: Type, value: Type) -> MapType:
    """A map, or a set in the place of a map to truth values."""
    return SetType(key, PRESENT) if value == BOOL else MapType(key, value)


class Way(Enum):
    """The kinds of steps to a part."""

    FIELD = "field"
    INDEX = "index"
    KEY = "key"


class Stage(Struct, frozen=True):
    """A step of a path: ``above`` is the type it starts from, ``type`` the one it leads to."""

    way: Way
    above: Type
    type: Type
    position: int = 0


Path = tuple[Stage, ...]


def paths(type_: Type, depth: int = 3) -> Iterator[Path]:
    """Every path of at most ``depth`` steps into a value of a type, the empty one first."""
    yield ()
    if depth == 0:
        return
    for stage in _stages(type_):
        for rest in paths(stage.type, depth - 1):
            yield (stage, *rest)


def end(type_: Type, path: Path) -> Type:
    """The type that a path leads to."""
    return path[-1].type if path else type_


def _stages(type_: Type) -> Iterator[Stage]:
    match type_:
        case RecordType(fields=fields):
            for position, (_, field) in enumerate(fields):
                yield Stage(Way.FIELD, type_, field, position)
        case SequenceType(element=element):
            yield Stage(Way.INDEX, type_, element)
        case MapType(value=value):
            yield Stage(Way.KEY, type_, value)
        case _:
            return


@lru_cache(maxsize=4096)
def typed_paths(type_: Type) -> tuple[tuple[Path, Type], ...]:
    """The paths into a value of a type, each with the type that it leads to."""
    return tuple((path, end(type_, path)) for path in paths(type_))


def is_sure(path: Path) -> bool:
    """Return whether the place exists for all lengths of lists and keys of maps."""
    return all(
        stage.way is Way.FIELD or (stage.way is Way.INDEX and isinstance(stage.above, ArrayType))
        for stage in path
    )
