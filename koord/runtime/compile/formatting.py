"""Formatting of generated Python, as formatters do it.

Only what the compiler writes is known here. Lists in brackets are broken one item a line, with a
comma behind the last, which formatters keep; chains of operators before each operator.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator

from msgspec import Struct

WIDTH = 88
_STEP = "    "

_PRECEDENCE: dict[type[ast.operator], int] = {
    ast.Add: 0,
    ast.Sub: 0,
    ast.Mult: 1,
    ast.Div: 1,
    ast.FloorDiv: 1,
    ast.Mod: 1,
}


def formatted(lines: Iterable[str]) -> str:
    """Format the logical lines of a module to its text."""
    return "\n".join(part for line in lines for part in _laid_out(line)) + "\n"


def _laid_out(line: str) -> list[str]:
    bare = line.lstrip(" ")
    if len(line) <= WIDTH or bare.startswith(('"""', "#")) or "  # " in bare:
        return [line]
    indent = line[: len(line) - len(bare)]
    opens = bare.endswith(":")
    word = "elif " if bare.startswith("elif ") else "if "
    source = bare.removeprefix("el")
    statement = ast.parse(f"{source} pass" if opens else source).body[0]
    return list(_Layout(source, word).statement(statement, indent))


class _Layout(Struct, frozen=True):
    """The layout of one logical line; ``source`` is the line without its indentation.

    It holds ``if`` where the line has another ``word``.
    """

    source: str
    word: str

    # --- statements -----------------------------------------------------------------------------

    def statement(self, s: ast.stmt, indent: str) -> Iterator[str]:
        match s:
            case ast.Assign(targets=[target], value=value):
                yield from self.right_side(value, indent, f"{self.text(target)} = ", "")
            case ast.AnnAssign(target=target, annotation=annotation, value=ast.expr() as value):
                head = f"{self.text(target)}: {self.text(annotation)} = "
                yield from self.right_side(value, indent, head, "")
            case ast.Return(value=ast.expr() as value):
                yield from self.right_side(value, indent, "return ", "")
            case ast.If(test=test):
                yield from self.right_side(test, indent, self.word, ":")
            case ast.For(target=target, iter=over):
                yield from self.right_side(over, indent, self.head_of_for(target), ":")
            case ast.Expr(value=value):
                yield from self.right_side(value, indent, "", "")
            case ast.FunctionDef():
                yield from self.definition(s, indent)
            case ast.ImportFrom(module=module, names=names):
                yield f"{indent}from {module} import ("
                yield from (f"{indent}{_STEP}{alias.name}," for alias in names)
                yield f"{indent})"
            case _:
                yield indent + self.source

    def head_of_for(self, target: ast.expr) -> str:
        end = self.source.index(" in ", self._offset(target.end_col_offset or 0))
        return self.source[: end + 4]

    def definition(self, s: ast.FunctionDef, indent: str) -> Iterator[str]:
        assert s.returns is not None
        yield f"{indent}def {s.name}("
        for argument in s.args.args:
            of = "" if argument.annotation is None else f": {self.text(argument.annotation)}"
            yield f"{indent}{_STEP}{argument.arg}{of},"
        yield f"{indent}) -> {self.text(s.returns)}:"

    def right_side(self, e: ast.expr, indent: str, prefix: str, suffix: str) -> list[str]:
        """Lay out an expression that may get parentheses of its own when it is broken."""
        if self.fits(e, indent, prefix, suffix):
            return [f"{indent}{prefix}{self.text(e)}{suffix}"]
        if isinstance(e, ast.BoolOp | ast.BinOp | ast.Compare | ast.UnaryOp):
            inline = self.inline(e, indent, prefix, suffix)
            if inline is not None:
                return inline
            inner = self.broken(e, indent + _STEP, "", "")
            # Formatters would break inside of several operands, which nobody can read.
            kept = "  # fmt: skip" if self.may_be_inline(e) else ""
            return [f"{indent}{prefix}(", *inner, f"{indent}){suffix}{kept}"]
        return self.broken(e, indent, prefix, suffix)

    def may_be_inline(self, e: ast.expr) -> bool:
        """Return whether formatters put no parentheses around the whole expression."""
        if isinstance(e, ast.UnaryOp):
            return self.may_be_inline(e.operand)
        if not isinstance(e, ast.BoolOp | ast.BinOp | ast.Compare):
            return self.has_brackets(e)
        parts = list(self.operands(e))
        first, last = parts[0][1], parts[-1][1]
        return len(parts) == 2 and (self.has_brackets(last) or self.begins_with_bracket(first))

    def inline(
        self, e: ast.expr, indent: str, prefix: str, suffix: str, *, nested: bool = False
    ) -> list[str] | None:
        """Lay out an expression without brackets around the whole, if that is possible.

        It is for two operands, of which the last ends in brackets, or the first begins with some.
        Operands of a ``nested`` expression may be more.
        """
        if isinstance(e, ast.UnaryOp):
            word = "not " if isinstance(e.op, ast.Not) else "-"
            return self.inline_operand(e.operand, indent, f"{prefix}{word}", suffix)
        parts = list(self.operands(e))
        first, last = parts[0][1], parts[-1][1]
        if len(parts) != 2 and not nested:
            return None
        if not (self.has_brackets(last) or self.begins_with_bracket(first)):
            return None
        start, end = self.span(e)
        head = self.source[start : self.outer_start(last)]
        if self.has_brackets(last):
            lines = self.inline_operand(last, indent, prefix + head, suffix)
            if lines is not None and len(lines[0]) <= WIDTH:
                return lines
        if len(parts) == 2:
            tail = self.source[self.outer_end(first) : end]
            tail += ")" if self.bracketed(last) and not tail.endswith(")") else ""
            lines = self.inline_operand(first, indent, prefix, f"{tail}{suffix}")
            if lines is not None and max(map(len, lines)) <= WIDTH:
                return [*lines[:-1], f"{lines[-1]}  # fmt: skip"]
        return None

    def inline_operand(
        self, e: ast.expr, indent: str, prefix: str, suffix: str
    ) -> list[str] | None:
        if self.bracketed(e):
            inner = self.broken(e, indent + _STEP, "", "")
            return [f"{indent}{prefix}(", *inner, f"{indent}){suffix}"]
        if isinstance(e, ast.UnaryOp | ast.BoolOp | ast.BinOp | ast.Compare):
            return self.inline(e, indent, prefix, suffix, nested=True)
        lines = self.exploded(e, indent, prefix, suffix)
        return lines if len(lines) > 1 else None

    def begins_with_bracket(self, e: ast.expr) -> bool:
        if isinstance(e, ast.BoolOp | ast.BinOp | ast.Compare) and not self.bracketed(e):
            return self.begins_with_bracket(next(self.operands(e))[1])
        displayed = isinstance(e, ast.Tuple | ast.Dict) and self.has_brackets(e)
        return displayed or self.bracketed(e)

    def has_brackets(self, e: ast.expr) -> bool:
        """Return whether an operand ends in nonempty brackets, or stands in brackets."""
        if self.bracketed(e):
            return True
        match e:
            case ast.Call(args=arguments, keywords=keywords):
                return bool(arguments or keywords)
            case ast.Tuple(elts=elements):
                return bool(elements)
            case ast.Dict(keys=keys):
                return bool(keys)
            case ast.UnaryOp(operand=operand):
                return self.has_brackets(operand)
            case ast.BoolOp() | ast.BinOp() | ast.Compare():
                return self.has_brackets(list(self.operands(e))[-1][1])
            case _:
                return False

    # --- expressions ----------------------------------------------------------------------------

    def broken(self, e: ast.expr, indent: str, prefix: str, suffix: str) -> list[str]:
        """Lay out an expression inside brackets, on as many lines as it needs."""
        if self.fits(e, indent, prefix, suffix):
            return [f"{indent}{prefix}{self.text(e)}{suffix}"]
        return self.exploded(e, indent, prefix, suffix)

    def exploded(self, e: ast.expr, indent: str, prefix: str, suffix: str) -> list[str]:
        """Lay out an expression that does not fit on a line."""
        match e:
            case ast.Call(func=func, args=[ast.GeneratorExp() as made]):
                inner = self.generator(made, indent + _STEP)
                return self.around(f"{self.text(func)}(", inner, indent, prefix, f"){suffix}")
            case ast.Call(func=func, args=arguments, keywords=keywords) if arguments or keywords:
                items = self.items(arguments, indent + _STEP)
                for keyword in keywords:
                    head = f"{keyword.arg}="
                    items += self.broken(keyword.value, indent + _STEP, head, ",")
                return self.around(f"{self.text(func)}(", items, indent, prefix, f"){suffix}")
            case ast.Call(func=ast.Attribute(value=value, attr=attribute)):
                return self.operand(value, indent, prefix, f".{attribute}(){suffix}")
            case ast.Tuple(elts=elements) if elements:
                items = self.items(elements, indent + _STEP)
                return self.around("(", items, indent, prefix, f"){suffix}")
            case ast.Dict(keys=keys, values=values) if keys:
                items = []
                for key, value in zip(keys, values, strict=True):
                    assert key is not None
                    items += self.broken(value, indent + _STEP, f"{self.text(key)}: ", ",")
                return self.around("{", items, indent, prefix, f"}}{suffix}")
            case ast.Attribute(value=value, attr=attribute):
                return self.operand(value, indent, prefix, f".{attribute}{suffix}")
            case ast.Subscript(value=ast.Call() | ast.Subscript() as value, slice=index):
                return self.operand(value, indent, prefix, f"[{self.text(index)}]{suffix}")
            case ast.Starred(value=value):
                return self.operand(value, indent, f"{prefix}*", suffix)
            case ast.UnaryOp(operand=operand):
                word = "not " if isinstance(e.op, ast.Not) else "-"
                return self.operand(operand, indent, f"{prefix}{word}", suffix)
            case ast.BoolOp() | ast.BinOp() | ast.Compare():
                return self.chain(e, indent, prefix, suffix)
            case _:
                return [f"{indent}{prefix}{self.text(e)}{suffix}"]

    def around(
        self, opening: str, inner: list[str], indent: str, prefix: str, closing: str
    ) -> list[str]:
        return [f"{indent}{prefix}{opening}", *inner, f"{indent}{closing}"]

    def items(self, elements: Iterable[ast.expr], indent: str) -> list[str]:
        return [line for element in elements for line in self.broken(element, indent, "", ",")]

    def generator(self, e: ast.GeneratorExp, indent: str) -> list[str]:
        (clause,) = e.generators
        head = f"for {self.text(clause.target)} in "
        one = f"{self.text(e.elt)} {head}{self.text(clause.iter)}"
        if len(indent) + len(one) <= WIDTH:
            return [f"{indent}{one}"]
        return [
            *self.broken(e.elt, indent, "", ""),
            *self.broken(clause.iter, indent, head, ""),
        ]

    def operand(self, e: ast.expr, indent: str, prefix: str, suffix: str) -> list[str]:
        """Lay out an operand, with the brackets that it has in the source."""
        if not self.bracketed(e):
            return self.broken(e, indent, prefix, suffix)
        if len(indent) + len(prefix) + len(self.text(e)) + len(suffix) + 2 <= WIDTH:
            return [f"{indent}{prefix}({self.text(e)}){suffix}"]
        inner = self.broken(e, indent + _STEP, "", "")
        return [f"{indent}{prefix}(", *inner, f"{indent}){suffix}"]

    def chain(self, e: ast.expr, indent: str, prefix: str, suffix: str) -> list[str]:
        """Lay out operands of one precedence, an operator before each but the first."""
        parts = list(self.operands(e))
        lines: list[str] = []
        for number, (word, operand) in enumerate(parts):
            head = prefix if number == 0 else f"{word} "
            tail = suffix if number + 1 == len(parts) else ""
            lines += self.operand(operand, indent, head, tail)
        return lines

    def operands(self, e: ast.expr) -> Iterator[tuple[str, ast.expr]]:
        match e:
            case ast.BoolOp(values=values):
                # Formatters break `and` and `or` alike.
                own = "and" if isinstance(e.op, ast.And) else "or"
                for value in values:
                    if isinstance(value, ast.BoolOp) and not self.bracketed(value):
                        inner = list(self.operands(value))
                        yield own, inner[0][1]
                        yield from inner[1:]
                    else:
                        yield own, value
            case ast.BinOp(left=left, right=right):
                same = isinstance(left, ast.BinOp) and not self.bracketed(left)
                if same and _level(left) == _level(e):
                    yield from self.operands(left)
                else:
                    yield "", left
                yield self.between(left, right), right
            case ast.Compare(left=left, comparators=[right]):
                yield "", left
                yield self.between(left, right), right

    # --- the source -----------------------------------------------------------------------------

    def fits(self, e: ast.expr, indent: str, prefix: str, suffix: str) -> bool:
        return len(indent) + len(prefix) + len(self.text(e)) + len(suffix) <= WIDTH

    def text(self, e: ast.expr) -> str:
        start, end = self.span(e)
        return self.source[start:end]

    def span(self, e: ast.expr) -> tuple[int, int]:
        return self._offset(e.col_offset), self._offset(e.end_col_offset or 0)

    def _offset(self, of_bytes: int) -> int:
        """Convert a column of Python's syntax tree, which counts bytes, to characters."""
        return len(self.source.encode()[:of_bytes].decode())

    def bracketed(self, e: ast.expr) -> bool:
        start, end = self.span(e)
        return self.source[start - 1 : start] == "(" and self.source[end : end + 1] == ")"

    def outer_start(self, e: ast.expr) -> int:
        return self.span(e)[0] - (1 if self.bracketed(e) else 0)

    def outer_end(self, e: ast.expr) -> int:
        return self.span(e)[1] + (1 if self.bracketed(e) else 0)

    def between(self, left: ast.expr, right: ast.expr) -> str:
        return self.source[self.span(left)[1] : self.span(right)[0]].strip(" ()")


def _level(e: ast.expr) -> int:
    assert isinstance(e, ast.BinOp)
    return _PRECEDENCE[type(e.op)]
