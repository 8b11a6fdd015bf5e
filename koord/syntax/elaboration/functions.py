"""Elaboration of functions: the program's own, and the library's that are called."""

from __future__ import annotations

from collections.abc import Iterator

from koord.syntax import ast, core
from koord.syntax.diagnostics import Note
from koord.syntax.elaboration.body import BodyScope, Elaboration, Where
from koord.syntax.elaboration.coercion import fit
from koord.syntax.elaboration.findings import DiagnosticLog
from koord.syntax.elaboration.library import signature
from koord.syntax.elaboration.phrases import listed
from koord.syntax.elaboration.symbols import Role, Signature
from koord.syntax.types import BOOL, FLOAT, INT, Type
from koord.syntax.walk import nodes


def in_order(session: Elaboration) -> list[core.Function | core.External]:
    """Sort functions, each after those that it calls. Recursion is an error, reported once a cycle.

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
    """Check that statements only call functions that have a fixed answer."""
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


_KINDS = {
    ast.External.FUNCTION: core.ExternalKind.FUNCTION,
    ast.External.FRESH: core.ExternalKind.FRESH,
}


def declare_functions(session: Elaboration, definitions: list[ast.FunDef]) -> None:
    """Declare the program's own functions."""
    own = session.functions.own
    for definition in definitions:
        name = definition.name
        if name.name == "?":
            continue
        first = own.get(name.name)
        if first is not None:
            session.findings.error(
                "K208",
                name.span,
                f"the function `{name.name}` is declared twice",
                "give one of them another name",
                (Note(first.definition.name.span, "first declared here"),),
            )
            continue
        own[name.name] = signature(session, definition, name.name, library=False)
    _infer_results(session)


def _infer_results(session: Elaboration) -> None:
    """Find the types of results that are not declared, of what functions return. [E-CALL]

    A function may call others whose results are found first; one that calls itself has none.
    """
    left = [own for own in session.functions.own.values() if own.definition.result is None]
    while left:
        before = len(left)
        left = [own for own in left if not _inferred(session, own)]
        if len(left) == before:
            break


def _inferred(session: Elaboration, wanted: Signature) -> bool:
    """Return whether all that a function returns has a type, which is that of its result."""
    statements = wanted.definition.body
    if isinstance(statements, ast.External):
        return False
    site = session.sites.next
    body = _body(session, wanted, DiagnosticLog(), Where.FUNCTION)
    found: list[Type | None] = []
    body.returned = found
    body.block(statements)
    session.sites.next = site  # it is elaborated again
    types = [type_ for type_ in found if type_ is not None]
    if not types or len(types) < len(found):
        return False
    wanted.result = FLOAT if set(types) == {INT, FLOAT} else types[0]
    return True


def define_functions(session: Elaboration) -> None:
    """Elaborate the program's own functions, and those of the library that are called."""
    table = session.functions
    for own in table.own.values():
        table.wanted.add(own.name)
        _define(session, own, session.findings)
    while table.pending:
        wanted = table.pending.pop()
        if not wanted.library:
            continue
        findings = DiagnosticLog()
        if not wanted.sound:
            findings.errors += 1
        else:
            _define(session, wanted, findings)
        if findings.errors:
            _unfit(session, wanted, findings)


def _unfit(session: Elaboration, wanted: Signature, findings: DiagnosticLog) -> None:
    """Report that a function of the library does not fit the program's own `Task`."""
    told = findings.in_order()
    task = session.types.declared.get("Task")
    notes = (Note(task.span, "`Task` is declared here"),) if task is not None else ()
    session.findings.error(
        "K245",
        session.functions.origins[wanted.name],
        f"`{wanted.written}` of the library cannot work with this program's `Task`"
        + (f": {told[0].message}" if told else ""),
        "add what is missing to `Task`, or leave its declaration out: `Task` is predefined",
        notes,
    )


def _define(session: Elaboration, wanted: Signature, findings: DiagnosticLog) -> None:
    definition = wanted.definition
    if isinstance(definition.body, ast.External):
        made: core.Function | core.External | None = _external(session, wanted, findings)
    else:
        made = _function(session, wanted, definition.body, findings)
    if made is not None:
        session.functions.elaborated[wanted.name] = made


def _body(
    session: Elaboration, wanted: Signature, findings: DiagnosticLog, where: Where
) -> BodyScope:
    """Elaborate a body with the parameters in scope."""
    body = BodyScope(session, where, None, findings, library=wanted.library)
    body.origin = session.functions.origins.get(wanted.name) if wanted.library else None
    for decl, type_ in zip(wanted.definition.parameters, wanted.parameters, strict=True):
        known = body.frames[0].get(decl.name.name)
        if known is not None:
            findings.error(
                "K208",
                decl.name.span,
                f"the parameter `{decl.name.name}` is declared twice",
                None,
                (Note(known.declared.span, "first declared here"),),
            )
        if decl.initial is not None:
            findings.error("K240", decl.initial.span, "a parameter has no initial value")
        body.declare(decl.name, type_, Role.PARAMETER)
    return body


def _function(
    session: Elaboration, wanted: Signature, statements: ast.Block, findings: DiagnosticLog
) -> core.Function | None:
    body = _body(session, wanted, findings, Where.FUNCTION)
    body.result = wanted.result
    block = body.block(statements)
    definition = wanted.definition
    session.functions.calls[wanted.name] = body.calls
    if definition.requires or definition.ensures:
        place = (*definition.requires, *definition.ensures)[0]
        findings.error(
            "K240",
            place.span,
            "only an external function has a summary",
            "what a function with a body computes is known",
        )
    if wanted.result is None and not _returns_something(statements):
        findings.error(
            "K228",
            definition.name.span,
            f"`{definition.name.name}` computes nothing: it has no result",
            "declare its type, as in `def fun f(int a) -> int:`; what changes variables belongs "
            "in an event",
        )
    elif statements and not returns(statements):
        findings.error(
            "K222",
            definition.name.span,
            f"`{definition.name.name}` can end without a `return`",
            "end it with `return …`",
        )
    if not wanted.sound or wanted.result is None:
        return None
    parameters = _parameters(body, wanted)
    return core.Function(
        wanted.name,
        parameters,
        wanted.result,
        block,
        body.bound,
        wanted.written,
        span=definition.span,
    )


def _returns_something(statements: ast.Block) -> bool:
    return any(isinstance(s, ast.Return) and s.value is not None for s in nodes(statements))


def _parameters(body: BodyScope, wanted: Signature) -> tuple[core.Variable, ...]:
    return tuple(
        core.Variable(core.Home.BOUND, slot, name, type_)
        for slot, (name, type_) in enumerate(
            zip(wanted.parameter_names, wanted.parameters, strict=True)
        )
        if type_ is not None
    )


def returns(statements: ast.Block) -> bool:
    """Return whether the statements always end in a ``return``."""
    for s in statements:
        match s:
            case ast.Return():
                return True
            case ast.If(arms=arms, otherwise=otherwise):
                blocks = [block for _, block in arms]
                if otherwise is not None and all(map(returns, [*blocks, otherwise])):
                    return True
            case ast.Atomic(body=inner):
                if returns(inner):
                    return True
    return False


def _external(
    session: Elaboration, wanted: Signature, findings: DiagnosticLog
) -> core.External | None:
    definition = wanted.definition
    if definition.result is None:
        findings.error(
            "K240",
            definition.name.span,
            f"the external function `{definition.name.name}` has no result",
            "declare its type, as in `def fun f(int a) -> int: extern`",
        )
        return None
    requires: list[core.Expr | None] = []
    ensures: list[core.Expr | None] = []
    calls: list[str] = []
    bound = 0
    for condition in definition.requires:
        body = _body(session, wanted, findings, Where.SUMMARY_REQUIRES)
        body.bound += 1  # the slot of the answer
        requires.append(_condition(body, condition))
        bound, calls = max(bound, body.bound), [*calls, *body.calls]
    for condition in definition.ensures:
        body = _body(session, wanted, findings, Where.SUMMARY)
        result = ast.Ident("result", span=definition.name.span)
        if any(decl.name.name == "result" for decl in definition.parameters):
            findings.error(
                "K208", definition.name.span, "`result` names the answer: rename the parameter"
            )
        body.declare(result, wanted.result, Role.RESULT)
        ensures.append(_condition(body, condition))
        bound, calls = max(bound, body.bound), [*calls, *body.calls]
    session.functions.calls[wanted.name] = calls
    if not wanted.sound or wanted.result is None:
        return None
    parameters = _parameters(_body(session, wanted, DiagnosticLog(), Where.SUMMARY), wanted)
    answer = core.Variable(core.Home.BOUND, len(parameters), "result", wanted.result)
    assert isinstance(definition.body, ast.External)
    return core.External(
        wanted.name,
        parameters,
        answer,
        _KINDS[definition.body],
        tuple(condition for condition in requires if condition is not None),
        tuple(condition for condition in ensures if condition is not None),
        max(bound, len(parameters) + 1),
        written=wanted.written,
        span=definition.span,
    )


def _condition(body: BodyScope, condition: ast.Expr) -> core.Expr | None:
    what = "what a summary says"
    made = fit(body, body.expr(condition, BOOL), BOOL, condition.span, what)
    if made is not None:
        check_promises(body, made)
    return made


def check_promises(body: BodyScope, condition: core.Expr) -> None:
    """Report quantifiers over all values of a type that cannot be checked. [EXTERNAL]

    Of what is said of all values, some can be tried, and the rest taken on trust. Of what is denied
    of all, required of a caller, or said of some one value, nothing can be.
    """
    if body.where is Where.SUMMARY_REQUIRES:
        for node in _about_all(condition):
            body.error(
                "K310",
                node.span,
                "a duty of callers that speaks of every value of a type can be checked nowhere",
                "say it of the arguments, or of the elements of a list",
            )
        return
    for node in _denied(condition, denied=False):
        body.error(
            "K310",
            node.span,
            "a summary says something of every value of a type, but does not deny it",
            "`forall` over a type stands neither behind `not` nor left of `implies`, and there is "
            "no `exists` over a type",
        )


def _about_all(node: object) -> Iterator[core.Quantified]:
    for below in nodes(node):
        if isinstance(below, core.Quantified) and isinstance(below.domain, core.AllValues):
            yield below


def _denied(e: core.Expr, *, denied: bool) -> Iterator[core.Quantified]:
    """The quantifiers over all values of a type that are negated, or existential."""
    match e:
        case core.Quantified(domain=core.AllValues(), body=body, quantifier=quantifier):
            if denied or quantifier is not core.QuantifierKind.FORALL:
                yield e
            else:
                yield from _denied(body, denied=denied)
        case core.Quantified(body=body, domain=domain):
            yield from _about_all(domain)
            yield from _denied(body, denied=denied)
        case core.Unary(op=core.UnaryOp.NOT, operand=operand):
            yield from _denied(operand, denied=not denied)
        case core.Binary(op=core.BinaryOp.AND | core.BinaryOp.OR, left=left, right=right):
            yield from _denied(left, denied=denied)
            yield from _denied(right, denied=denied)
        case core.Binary(op=core.BinaryOp.IMPLIES, left=left, right=right):
            yield from _denied(left, denied=not denied)
            yield from _denied(right, denied=denied)
        case _:
            yield from _about_all(e)
