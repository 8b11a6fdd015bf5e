"""And-inverter graphs: Boolean functions built of conjunction and negation, each kept once.

A *literal* is an even number for a node and the odd one behind it for its negation; 0 is false and
1 is true. Nodes come after what they are made of, so a walk in order of number is bottom-up.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from msgspec import Struct, field

FALSE = 0
TRUE = 1

#: What stands in the place of fan-ins of nodes that are inputs.
_LEAF = -1


class Graph(Struct):
    """An and-inverter graph. ``names`` are those of its inputs, by node."""

    left: list[int] = field(default_factory=lambda: [_LEAF])
    right: list[int] = field(default_factory=lambda: [_LEAF])
    names: dict[int, str] = field(default_factory=dict)
    uses: list[int] = field(default_factory=lambda: [0])  #: how many nodes are made of a node
    _known: dict[tuple[int, int], int] = field(default_factory=dict)

    def input(self, name: str) -> int:
        """The literal of a new input."""
        node = len(self.left)
        self.left.append(_LEAF)
        self.right.append(_LEAF)
        self.uses.append(0)
        self.names[node] = name
        return 2 * node

    def both(self, a: int, b: int) -> int:
        """Conjunction of two literals, simplified where one or two levels show how."""
        if a > b:
            a, b = b, a
        if a == FALSE or a == b ^ 1:
            return FALSE
        if a in (TRUE, b):
            return b
        known = self._known.get((a, b))
        if known is not None:
            return known
        simpler = self._absorbed(a, b)
        if simpler is None:
            simpler = self._absorbed(b, a)
        if simpler is None:
            node = len(self.left)
            self.left.append(a)
            self.right.append(b)
            self.uses.append(0)
            self.uses[a >> 1] += 1
            self.uses[b >> 1] += 1
            simpler = 2 * node
        self._known[a, b] = simpler
        return simpler

    def _absorbed(self, a: int, b: int) -> int | None:
        """Simplify ``a and b`` where ``b`` is a conjunction with ``a``, or the negation of one."""
        node = b >> 1
        first, second = self.left[node], self.right[node]
        if first == _LEAF:
            return None
        if b & 1:  # a and not (first and second)
            if first == a ^ 1 or second == a ^ 1:
                return a
            if first == a:
                return self.both(a, second ^ 1)
            if second == a:
                return self.both(a, first ^ 1)
            return None
        if a in (first, second):
            return b
        return FALSE if a ^ 1 in (first, second) else None

    def either(self, a: int, b: int) -> int:
        return self.both(a ^ 1, b ^ 1) ^ 1

    def differ(self, a: int, b: int) -> int:
        """Exclusive or of two literals."""
        if a < 2:
            return b ^ a
        if b < 2:
            return a ^ b
        # Of the two that are each other's negation only one is built.
        sign = (a ^ b) & 1
        a, b = a & ~1, b & ~1
        return self.both(self.both(a, b) ^ 1, self.both(a ^ 1, b ^ 1) ^ 1) ^ sign

    def choose(self, condition: int, then: int, other: int) -> int:
        """If-then-else: ``then`` where the condition holds, ``other`` elsewhere."""
        if condition < 2:
            return then if condition else other
        if then == other:
            return then
        if then < 2 or then == condition or then == condition ^ 1:
            # Where the condition holds, ``then`` is a constant.
            constant = then if then < 2 else (then ^ condition) ^ 1
            if constant & 1:
                return self.either(condition, other)
            return self.both(condition ^ 1, other)
        if other < 2 or other == condition or other == condition ^ 1:
            constant = other if other < 2 else other ^ condition
            if constant & 1:
                return self.either(condition ^ 1, then)
            return self.both(condition, then)
        if then == other ^ 1:
            return self.differ(condition, other)
        return self.both(self.both(condition, then) ^ 1, self.both(condition ^ 1, other) ^ 1) ^ 1

    def all_of(self, literals: Iterable[int]) -> int:
        """A conjunction, built as a balanced tree."""
        parts = sorted(set(literals))
        while len(parts) > 1:
            pairs = [self.both(parts[k], parts[k + 1]) for k in range(0, len(parts) - 1, 2)]
            parts = pairs + parts[len(parts) - len(parts) % 2 :]
        return parts[0] if parts else TRUE

    def any_of(self, literals: Iterable[int]) -> int:
        """A disjunction, built as a balanced tree."""
        return self.all_of(x ^ 1 for x in literals) ^ 1

    # --- looking at them ------------------------------------------------------------------------

    def is_input(self, node: int) -> bool:
        return node > 0 and self.left[node] == _LEAF

    def conjuncts(self, literal: int) -> list[int]:
        """The literals of a nested conjunction."""
        found: dict[int, None] = {}
        stack = [literal]
        seen: set[int] = set()
        while stack:
            x = stack.pop()
            if x in seen:
                continue
            seen.add(x)
            if x & 1 or self.left[x >> 1] == _LEAF:
                found[x] = None
            else:
                stack += (self.right[x >> 1], self.left[x >> 1])
        return [x for x in found if x != TRUE]

    def ways(self, literal: int) -> list[int]:
        """Literals one of which holds wherever the literal does: the parts of a disjunction.

        Of a conjunction they are those of its widest part. It is its own only way if it has none.
        """
        if literal & 1:
            return [x ^ 1 for x in self.conjuncts(literal ^ 1)]
        within = (self.ways(x) for x in self.conjuncts(literal) if x & 1)
        return max(within, key=len, default=[literal])

    def cone(self, literals: Iterable[int]) -> list[int]:
        """The nodes that literals depend on, inputs included, bottom-up."""
        stack = [x >> 1 for x in literals]
        seen: set[int] = set()
        left, right = self.left, self.right
        while stack:
            node = stack.pop()
            if node in seen or node == 0:
                continue
            seen.add(node)
            if left[node] != _LEAF:
                stack += (left[node] >> 1, right[node] >> 1)
        return sorted(seen)

    def values(
        self, literals: Sequence[int], given: Mapping[int, bool], *, otherwise: bool = False
    ) -> list[bool]:
        """Evaluate literals for given values of the inputs (by node)."""
        value: dict[int, int] = {0: 0}
        left, right = self.left, self.right
        for node in self.cone(literals):
            a = left[node]
            if a == _LEAF:
                value[node] = int(given.get(node, otherwise))
            else:
                b = right[node]
                value[node] = (value[a >> 1] ^ (a & 1)) & (value[b >> 1] ^ (b & 1))
        return [bool(value[x >> 1] ^ (x & 1)) for x in literals]

    def substituted(self, literal: int, meaning: Mapping[int, int]) -> int:
        """Substitute literals for inputs (by node)."""
        (found,) = self.all_substituted([literal], meaning)
        return found

    def all_substituted(self, literals: Sequence[int], meaning: Mapping[int, int]) -> list[int]:
        """Substitute literals for nodes, inputs or not, in several literals at once."""
        new: dict[int, int] = {0: 0}
        for node in self.cone(literals):
            a, b = self.left[node], self.right[node]
            if node in meaning:
                new[node] = meaning[node]
            elif a == _LEAF:
                new[node] = 2 * node
            else:
                new[node] = self.both(new[a >> 1] ^ (a & 1), new[b >> 1] ^ (b & 1))
        return [new[x >> 1] ^ (x & 1) for x in literals]
