"""Output: ``stdout << a << b``. [OUTPUT]"""

from __future__ import annotations

from koord.syntax import ast, core
from koord.syntax.elaborate.body import Body, Where
from koord.syntax.elaborate.places import find_module
from koord.syntax.elaborate.symbols import StreamSymbol
from koord.syntax.types import STREAM

#: The stream that every program has; `using Log` declares it too.
STDOUT = "stdout"


def output(body: Body, s: ast.Output) -> core.Block:
    """Write values to a stream."""
    values = [body.expr(value) for value in s.values]
    if body.where not in (Where.EFFECT, Where.INIT):
        body.error(
            "K225", s.span, f"output has no place in {body.where.value}", "only robots write output"
        )
        return ()
    stream = _stream(body, s.stream)
    found = [value for value in values if value is not None]
    if stream is None or len(found) < len(values):
        return ()
    for value in found:
        if value.type == STREAM:
            body.error("K238", value.span, "a stream cannot be written to a stream")
            return ()
    return (core.Output(stream, tuple(found), span=s.span),)


def _stream(body: Body, e: ast.Expr) -> str | None:
    agent = body.agent
    assert agent is not None
    match e:
        case ast.Name(name=name):
            ports = [p for p in agent.ports.get(name, []) if isinstance(p, StreamSymbol)]
            if ports:
                return ports[0].stream
            if name == STDOUT and name not in agent.variables:
                return STDOUT
        case ast.Attribute(base=ast.Name(name=owner), name=ast.Ident(name=port)):
            module = find_module(body, owner)
            found = module.ports.get(port) if module is not None else None
            if isinstance(found, StreamSymbol):
                return found.stream
    before = body.findings.errors
    if body.expr(e) is None and body.findings.errors > before:
        return None
    body.error(
        "K238",
        e.span,
        "this is not a stream",
        f"write to `{STDOUT}`, or declare a `stream` under `actuators:` of a module",
    )
    return None
