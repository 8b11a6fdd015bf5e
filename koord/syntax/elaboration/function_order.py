"""Who calls whom: the order of functions, recursion, answers that are not fixed."""

from __future__ import annotations

from koord.syntax import core
from koord.syntax.elaboration.body import Elaboration
from koord.syntax.elaboration.phrases import listed


def in_order(session: Elaboration) -> list[core.Function | core.External]:
    """The functions, each behind those that it calls. Recursion is an error, told once a cycle.

    The summary of an external function may speak of the function itself ("symmetric").
    """
    table = session.functions
    done: dict[str, core.Function | core.External | None] = {}
    for name in [*table.own, *sorted(table.elaborated)]:
        start = table.own[name].name if name in table.own else name
        path: list[str] = []
        stack: list[tuple[str, bool]] = [(start, False)]
        while stack:
            current, leaving = stack.pop()
            if leaving:
                path.pop()
                done.setdefault(current, table.elaborated.get(current))
                continue
            if current in done:
                continue
            if current in path:
                cycle = path[path.index(current) :]
                if len(cycle) > 1 or not _is_external(session, current):
                    _recursion(session, cycle)
                continue
            path.append(current)
            stack.append((current, True))
            stack.extend((called, False) for called in reversed(table.calls.get(current, [])))
    return [made for made in done.values() if made is not None]


def check_logical_calls(session: Elaboration) -> None:
    """Statements call functions of fixed answers only."""
    table = session.functions
    for name, span in session.logical_calls:
        stack, seen = [name], {name}
        while stack:
            current = stack.pop()
            made = table.elaborated.get(current)
            if isinstance(made, core.External) and made.kind is core.ExternalKind.FRESH:
                way = "" if current == name else f" (it calls `{current}`)"
                session.findings.error(
                    "K309",
                    span,
                    f"`{name}` may answer anew at each call{way}: a statement cannot speak of it",
                    "keep its answer in a variable, and speak of that",
                )
                break
            called = [n for n in table.calls.get(current, []) if n not in seen]
            seen.update(called)
            stack.extend(called)


def _is_external(session: Elaboration, name: str) -> bool:
    return isinstance(session.functions.elaborated.get(name), core.External)


def _recursion(session: Elaboration, cycle: list[str]) -> None:
    own = [session.functions.own[name] for name in cycle if name in session.functions.own]
    if not own:
        raise AssertionError(f"the library is recursive: {cycle}")
    first = min(own, key=lambda known: (known.definition.span.line, known.definition.span.column))
    start = cycle.index(first.name)
    names = [*cycle[start:], *cycle[:start], first.name]
    if len(cycle) == 1:
        message = f"`{first.written}` calls itself"
    else:
        message = f"{listed(sorted(set(names)))} call each other: {' → '.join(names)}"
    session.findings.error(
        "K216",
        first.definition.name.span,
        message,
        "functions are not recursive, so that every event ends: use a `for` loop",
    )
