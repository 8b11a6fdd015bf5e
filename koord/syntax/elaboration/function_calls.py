"""Overload resolution: the function that a call means, and its arguments."""

from __future__ import annotations

from collections.abc import Sequence

from koord.syntax import ast, core
from koord.syntax.diagnostics import Note
from koord.syntax.elaboration.body import LOGICAL, BodyScope, Where
from koord.syntax.elaboration.coercion import POISON, accepts, fit
from koord.syntax.elaboration.library import library_signatures
from koord.syntax.elaboration.symbols import Signature
from koord.syntax.source import Span
from koord.syntax.types import FLOAT, INT, Type, show


def candidates(body: BodyScope, name: str) -> Sequence[Signature]:
    """The functions that a call by this name can mean."""
    table = body.session.functions
    own = table.own.get(name)
    if own is None:
        return library_signatures(body.session, name)
    if body.library:
        for known in library_signatures(body.session, name):
            if (known.parameters, known.result) == (own.parameters, own.result):
                return (own,)
        return library_signatures(body.session, name)
    return (own,)


def library_call(
    body: BodyScope, name: str, arguments: tuple[core.Expr, ...], span: Span
) -> core.Expr | None:
    """Elaborate a call of the library's function of that name whose types fit."""
    for signature in library_signatures(body.session, name):
        if _matches(signature, [argument.type for argument in arguments]):
            return _made(body, signature, arguments, span)
    raise AssertionError(f"the library has no {name} for these types")


def is_named(body: BodyScope, e: ast.Call) -> bool:
    """Return whether an argument has a name, which is reported."""
    for argument in e.arguments:
        if argument.name is not None:
            body.error(
                "K218",
                argument.span,
                "arguments of functions have no names",
                "only fields are named, where a record is made",
            )
            return True
    return False


def call(body: BodyScope, e: ast.Call, known: Sequence[Signature]) -> core.Expr | None:
    """Elaborate a call of one of the functions that the name can mean."""
    if is_named(body, e):
        return None
    fitting = [s for s in known if len(s.parameters) == len(e.arguments)]
    if not fitting:
        if known:
            body.note(e.function.span, known[0])
        for argument in e.arguments:
            body.expr(argument.value, POISON)
        _wrong_count(body, e, known)
        return None
    signature, arguments = _chosen(body, e, fitting)
    if signature is None:
        return None
    body.note(e.function.span, signature)
    fitted = [
        fit(body, value, wanted, argument.value.span, f"{_ordinal(place)} of `{signature.written}`")
        for place, (value, wanted, argument) in enumerate(
            zip(arguments, signature.parameters, e.arguments, strict=True)
        )
    ]
    sound = [value for value in fitted if value is not None]
    if len(sound) < len(fitted):
        return None
    return _made(body, signature, tuple(sound), e.span)


def _chosen(
    body: BodyScope, e: ast.Call, fitting: list[Signature]
) -> tuple[Signature | None, list[core.Expr | None]]:
    """The function meant, by number and then types of arguments; and the arguments."""
    if len(fitting) == 1:
        only = fitting[0]
        return only, [
            body.expr(argument.value, wanted or POISON)
            for argument, wanted in zip(e.arguments, only.parameters, strict=True)
        ]
    arguments = [
        body.expr(argument.value, _common(fitting, place))
        for place, argument in enumerate(e.arguments)
    ]
    types = [argument.type for argument in arguments if argument is not None]
    if len(types) < len(arguments):
        return None, arguments
    for signature in fitting:
        if _matches(signature, types):
            return signature, arguments
    shown = ", ".join(show(type_) for type_ in types)
    body.error(
        "K204",
        e.span,
        f"no `{e.function.name}` takes ({shown})",
        "there are " + "; ".join(_shown(signature) for signature in fitting),
    )
    return None, arguments


def _common(fitting: list[Signature], place: int) -> Type | None:
    """The type that all the candidates want at this place, if they agree."""
    wanted = {signature.parameters[place] for signature in fitting}
    return wanted.pop() if len(wanted) == 1 else None


def _matches(signature: Signature, types: Sequence[Type]) -> bool:
    return len(signature.parameters) == len(types) and all(
        wanted is not None and (accepts(wanted, given) or (wanted == FLOAT and given == INT))
        for wanted, given in zip(signature.parameters, types, strict=True)
    )


def _shown(signature: Signature) -> str:
    types = ", ".join(show(type_) if type_ else "?" for type_ in signature.parameters)
    return f"`{signature.written}({types})`"


_ORDINALS = ("the first", "the second", "the third", "the fourth", "the fifth")


def _ordinal(place: int) -> str:
    return (_ORDINALS[place] if place < len(_ORDINALS) else f"number {place + 1}") + " argument"


def _wrong_count(body: BodyScope, e: ast.Call, known: Sequence[Signature]) -> None:
    if not known:
        return
    counts = sorted({len(signature.parameters) for signature in known})
    wanted = " or ".join(str(count) for count in counts)
    few = "argument" if counts == [1] else "arguments"
    notes = tuple(
        Note(signature.definition.name.span, "declared here")
        for signature in known
        if not signature.library
    )
    body.findings.error(
        "K217",
        e.span,
        f"`{e.function.name}` takes {wanted} {few}, not {len(e.arguments)}",
        "it is called as " + " or ".join(_called(signature) for signature in known),
        notes,
    )


def _called(signature: Signature) -> str:
    parts = [
        f"{show(type_) if type_ else '?'} {name}"
        for type_, name in zip(signature.parameters, signature.parameter_names, strict=True)
    ]
    return f"`{signature.written}({', '.join(parts)})`"


def _made(
    body: BodyScope, signature: Signature, arguments: tuple[core.Expr, ...], span: Span
) -> core.Expr | None:
    if body.where is Where.CONSTANT:
        body.error("K226", span, "the value of a function is not known before the run")
        return None
    body.calls.append(signature.name)
    body.session.functions.want(signature, body.origin or span)
    body.session.mark_used(signature.definition.name)
    if not signature.sound:
        return None
    if signature.result is None:
        body.error("K228", span, f"`{signature.written}` gives no value")
        return None
    if body.where in LOGICAL:
        body.session.logical_calls.append((signature.name, span))
    make = core.ExternalCall if signature.external else core.Call
    return make(signature.name, arguments, signature.result, body.fresh_site(), span=span)
