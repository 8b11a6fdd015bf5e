"""The course of a campaign: which runs are there, which come next, and when it is over.

Where intervals end the runs of a value, it is decided on the first runs by seed without a gap. So a
campaign ends after the same runs, whoever makes how many of them at a time: runs that were made
beyond are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import Struct, field

from koord.api.campaign_figures import Until, is_look, settled
from koord.api.campaign_runs import Order, Row


class _Group(Struct):
    """The runs of one value: ``orders`` in the order of seeds, of which ``enough`` are enough."""

    orders: list[Order]
    rows: dict[tuple[str, int], Row] = field(default_factory=dict)
    first: list[Row] = field(default_factory=list)  #: without a gap
    enough: int | None = None


class Course:
    """The course of a campaign, made of its orders, value after value."""

    def __init__(self, orders: Sequence[Order], until: Until | None) -> None:
        self.numbers = {order.key: number for number, order in enumerate(orders)}
        self._until = until
        self._groups: dict[str, _Group] = {}
        for order in orders:
            self._groups.setdefault(order.swept, _Group([])).orders.append(order)

    def add(self, row: Row) -> None:
        """Note a run that was made; one of no order is left out."""
        if row.key not in self.numbers:
            return
        group = self._groups[row.swept]
        group.rows[row.key] = row
        while group.enough is None:
            if len(group.first) == len(group.orders):
                group.enough = len(group.orders)
                return
            following = group.rows.get(group.orders[len(group.first)].key)
            if following is None:
                return
            group.first.append(following)
            if self._until is not None and is_look(len(group.first)):
                enough = settled(group.first, self._until)
                group.enough = None if enough is None else enough[0]

    @property
    def made(self) -> int:
        """How many runs are there that count."""
        return sum(
            len(group.rows) if group.enough is None else group.enough
            for group in self._groups.values()
        )

    @property
    def is_over(self) -> bool:
        """True if no run is missing."""
        return all(group.enough is not None for group in self._groups.values())

    def is_whole(self, rows: Sequence[Row]) -> bool:
        """Return whether a campaign is over with these runs."""
        orders = [order for group in self._groups.values() for order in group.orders]
        other = Course(orders, self._until)
        for row in rows:
            other.add(row)
        return other.is_over

    def missing(self) -> list[Order]:
        """The orders that are left, as far as is known now."""
        return [
            order
            for group in self._groups.values()
            if group.enough is None
            for order in group.orders
            if order.key not in group.rows
        ]

    def wanted(self) -> Iterator[Order]:
        """Yield the orders that are left, until there are enough runs of a value."""
        for group in self._groups.values():
            for order in group.orders:
                if group.enough is not None:
                    break
                if order.key not in group.rows:
                    yield order

    def rows(self) -> list[Row]:
        """The runs that are there, in the order of values and seeds."""
        rows = list[Row]()
        for group in self._groups.values():
            orders = group.orders if group.enough is None else group.orders[: group.enough]
            rows += [group.rows[order.key] for order in orders if order.key in group.rows]
        return rows
