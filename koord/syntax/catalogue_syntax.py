"""The stories of K101 to K143: characters, layout, forms of lines."""

from __future__ import annotations

from msgspec.structs import replace

from koord.syntax.catalogue_entry import Entry, error

_EVENT = """
local:
  int x = 0
  bool b = false
Go:
  pre: x == 0
  eff:
"""


def _in_event(*lines: str) -> str:
    """A program whose one event has these lines in its effect."""
    return _EVENT + "".join(f"    {line}\n" for line in lines)


def _sum(terms: int) -> tuple[str, ...]:
    """An assignment of a long sum, twenty terms a line."""
    rows = [" + ".join(["x"] * min(20, terms - start)) for start in range(0, terms, 20)]
    return ("x = (", *(f"  {row} +" for row in rows[:-1]), f"  {rows[-1]})")


_CHARACTERS = (
    error(
        "K101",
        "a character is not part of the language",
        """Programs are written with the letters a to z, digits, and the signs of the language. Any
        other character may stand in comments and, unless it is a control character, in strings.
        Such characters often come along when a listing is copied: typographic quotation marks, the
        `$` of typesetting, spaces that look like spaces but are others.""",
        _in_event("x = $1"),
        _in_event("x = 1"),
    ),
    error(
        "K102",
        "a string has no end",
        """A string begins and ends with `"` on one line. A line break in it is written `\\n`, and a
        quotation mark `\\"`.""",
        """
        using Log
        Hello:
          eff: stdout << "hello
        """,
        """
        using Log
        Hello:
          eff: stdout << "hello"
        """,
    ),
    error(
        "K103",
        "a number is not written like this",
        """Numbers are `42`, `0.5`, `1e-3`: a digit stands before and behind the point. A name
        begins with a letter or `_`, so a digit followed by letters is neither. Numbers of more
        than 400 digits, and those beyond 1e400, are refused.""",
        _in_event("x = 3rd"),
        _in_event("x = 3"),
    ),
    error(
        "K104",
        "a backslash in a string means nothing here",
        """In a string `\\n` is a line break, `\\t` a tab, `\\"` a quotation mark, and `\\\\` the
        backslash itself. There are no others.""",
        """
        using Log
        Hello:
          eff: stdout << "C:\\dir"
        """,
        """
        using Log
        Hello:
          eff: stdout << "C:\\\\dir"
        """,
    ),
    error(
        "K105",
        "a line is indented with a tab",
        """Indentation says which block a line belongs to, and how wide a tab is differs from one
        editor to the next. So indentation is made of spaces only. It is told once a file; errors
        of indentation are not looked for then.""",
        """
        local:
        <TAB>int x = 0
        Go:
          eff: x = 1
        """,
        """
        local:
            int x = 0
        Go:
          eff: x = 1
        """,
    ),
    error(
        "K106",
        "the file is too large",
        """A file of more than a million characters is not read: it is most likely no program. A
        program of ten thousand lines is a third as long.""",
        """
        // the file has 20000 times these two lines
        // which say nothing, many times over
        """,
        """
        local:
          int x = 0
        Go:
          eff: x = 1
        """,
    ),
    error(
        "K108",
        "brackets or blocks stand too deep inside each other",
        """Brackets may stand inside each other a hundred deep, and blocks sixty-four deep. What
        works on programs may then call itself and never runs out of stack. No reader follows
        that deep either: give inner pieces names of their own.""",
        _in_event(f"x = {'(' * 101}x{')' * 101}"),
        _in_event(f"x = {'(' * 100}x{')' * 100}"),
    ),
    error(
        "K109",
        "an expression is too deep",
        """Each operator in a row puts the ones before it one deeper into the tree of an expression:
        `a + b + c` is `(a + b) + c`. More than two hundred deep is refused, as is a body of more
        than two hundred conditions. Add up with a loop, or give pieces names of their own.""",
        _in_event(*_sum(220)),
        _in_event("for i = 0, 220:", "  x = x + 1"),
    ),
)

_LAYOUT = (
    error(
        "K110",
        "a line is indented deeper, but no block is open",
        """A line may only stand deeper than the one before it if that one opens a block, that is,
        ends with `:`, or began a body behind its `:`. The line is read as if it stood at the level
        of the one before it, and so are those below it that are indented alike.""",
        _in_event("x = 1", "  b = true"),
        _in_event("x = 1", "b = true"),
    ),
    error(
        "K111",
        "an indentation is that of no open block",
        """A line that is indented less than the one before it goes on with one of the blocks that
        are open, and has exactly its indentation.""",
        _in_event("if b:", "    x = 1", "  x = 2"),
        _in_event("if b:", "    x = 1", "x = 2"),
    ),
    error(
        "K112",
        "a line may belong to two blocks",
        """A body may begin on the line of its head and go on in deeper-indented lines. If several
        bodies begin on one line, a line below belongs to the one that it is aligned with, or to
        the last one if it stands deeper than all. Any other could mean any of them: put the inner
        body on lines of its own.""",
        """
        local:
          int x = 0
          bool b = false
        Go:
          eff: if b: x = 1
            x = 2
        """,
        """
        local:
          int x = 0
          bool b = false
        Go:
          eff:
            if b: x = 1
            x = 2
        """,
    ),
    error(
        "K113",
        "a body is missing",
        """What ends with `:` has a body: behind the colon on the same line, or in deeper-indented
        lines below. A line at the same level does not belong to it. `pass` is a body that does
        nothing.""",
        _in_event("if b:", "x = 1"),
        _in_event("if b:", "  x = 1"),
    ),
    error(
        "K114",
        "`:` is missing",
        """A colon stands between the head of a section, a block or a property and its body, also
        if the body is on the same line: `else: atomic: x = 1`.""",
        _in_event("if b", "  x = 1"),
        _in_event("if b:", "  x = 1"),
    ),
    error(
        "K115",
        "`:` stands where no block can begin",
        """A colon opens a block behind the heads of sections, and behind `if`, `elif`, `else`,
        `for` and `atomic`. Besides it stands in quantifiers and in maps. Declarations are written
        `int x`, not `x: int`.""",
        _in_event("x = 1:"),
        _in_event("x = 1"),
    ),
    error(
        "K116",
        "`else` or `elif` without `if`",
        """`elif` and `else` stand at the indentation of their `if`, and nothing but its body stands
        between them.""",
        _in_event("if b:", "  x = 1", "b = true", "else:", "  x = 2"),
        _in_event("if b:", "  x = 1", "else:", "  x = 2", "b = true"),
    ),
    error(
        "K117",
        "`else` on the line of its `if`",
        """One line may hold an `if` with its body, but `else` and `elif` begin lines of their own,
        at the indentation of the `if`.""",
        _in_event("if b: x = 1 else: x = 2"),
        _in_event("if b: x = 1", "else: x = 2"),
    ),
    error(
        "K119",
        "a statement goes on below without brackets",
        """The end of a line ends a statement, unless a bracket is open. Only the expressions of
        `pre`, `assume`, `requires`, `ensures`, `invariant` and `eventually` go on below by
        themselves, where a line ends with an operator or the next begins with one (not with
        `-`, which may begin a condition of its own).""",
        _in_event("x = x", "  + 1"),
        _in_event("x = (x", "  + 1)"),
    ),
    error(
        "K120",
        "a bracket is not closed",
        """A line goes on until every bracket is closed. Where one never is, the line is taken to
        end before the next one that is indented like it, or that begins with a keyword of a
        statement. The place shown is that of the open bracket.""",
        _in_event("x = (x + 1", "b = true"),
        _in_event("x = (x + 1)", "b = true"),
    ),
    error(
        "K121",
        "a bracket is closed by one of another kind",
        """`(` is closed by `)`, `[` by `]`, `{` by `}`, the last one opened first.""",
        _in_event("x = (x + 1]"),
        _in_event("x = (x + 1)"),
    ),
    error(
        "K122",
        "a closing bracket closes nothing",
        """There are more closing brackets than opening ones before it.""",
        _in_event("x = (x + 1))"),
        _in_event("x = (x + 1)"),
    ),
)

_LINES = (
    error(
        "K130",
        "something else is expected",
        """The line is well up to the place shown; what stands there cannot follow. The message
        names what could.""",
        _in_event("x = max(x,, 1)"),
        _in_event("x = max(x, 1)"),
    ),
    error(
        "K131",
        "a keyword is used as a name",
        """Keywords begin sections and statements or are operators, and cannot be names. Words that
        are needed in one place only can: `at`, `round`, `result`, `extern`, `fresh`, `list`, `map`,
        `queue`, `choose`, `ran`, `module`, `adt`, `fun`, `sensors`, `actuators`, `environment`,
        `contract`, `requires`, `ensures`.""",
        """
        local:
          int init = 0
        Go:
          eff: pass
        """,
        """
        local:
          int start = 0
        Go:
          eff: pass
        """,
    ),
    error(
        "K132",
        "`=` and `==` are confused",
        """`=` gives a variable a value and makes a statement; `==` asks whether two values are
        equal and is part of an expression. The line is read as it was most likely meant.""",
        _in_event("if x = 1: b = true"),
        _in_event("if x == 1: b = true"),
    ),
    error(
        "K133",
        "a word or sign of another language",
        """`and`, `or`, `not` are also written `&&`, `||`, `!`; there is no `&` and `|`, no `+=`, no
        `;`. `elif` is the one word for "else if". Loops are bounded, `for i = 0, n:` and
        `for x in list:`, so there is no `while`.""",
        _in_event("x += 1"),
        _in_event("x = x + 1"),
    ),
    error(
        "K134",
        "comparisons do not chain",
        """`0 < x < 9` would compare a truth value with `9`. Compare twice.""",
        _in_event("b = 0 < x < 9"),
        _in_event("b = 0 < x and x < 9"),
    ),
    error(
        "K135",
        "a line holds more than one thing",
        """One statement or declaration stands on a line, and `eventually` has one property.""",
        _in_event("x = 1 b = true"),
        _in_event("x = 1", "b = true"),
    ),
    error(
        "K136",
        "a value stands where a statement or a place is expected",
        """A value alone does nothing: assign it, or call something. What is assigned to is a
        variable, an element `x[i]`, a field or a port; not what a function answers.""",
        _in_event("x + 1"),
        _in_event("x = x + 1"),
    ),
    error(
        "K137",
        "a declaration has several names",
        """Each variable is declared on a line of its own, with its type.""",
        """
        local:
          int x, y
        Go:
          eff: x = 1
        """,
        """
        local:
          int x
          int y
        Go:
          eff: x = 1
        """,
    ),
    error(
        "K138",
        "a quantifier binds something that is not a name",
        """`forall i, j:` is over robots, `forall k in 0, n:` over a range, `forall t in list:` over
        the elements of a list, `forall Car c:` over the robots of a kind. Behind `in` and a first
        value a comma makes the upper bound of a range, not another name.""",
        """
        local:
          int x = 0
        Go:
          eff: x = 1
        invariant Small: forall 1: x <= 1
        """,
        """
        local:
          int x = 0
        Go:
          eff: x = 1
        invariant Small: forall i: x@i <= 1
        """,
    ),
    error(
        "K139",
        "a declaration or loop is not written like this",
        """A declaration is a type and a name, `int x` or `int x = 3`; a parameter likewise. A loop
        over a range is `for i = 0, n:`, from the first bound up to and excluding the second, both
        ints; one over a list is `for x in list:`, and with its indices, or over a map,
        `for k, v in list:`.""",
        _in_event("for i in 0, 3: x = i"),
        _in_event("for i = 0, 3: x = i"),
    ),
    error(
        "K141",
        "a line does not belong where it stands",
        """At the left margin stand sections and events; in an event `pre:` and `eff:`, in a module
        `sensors:`, `actuators:`, `environment:` and contracts; statements stand below `eff:`,
        `init:`, `environment:` or a function. Often only the indentation is wrong. Of several
        such lines in a row the first is told.""",
        """
        local:
          int x = 0
        Go:
          x = 1
        """,
        """
        local:
          int x = 0
        Go:
          eff: x = 1
        """,
    ),
    error(
        "K142",
        "a block stands there twice",
        """An event has one `pre:` and one `eff:`, a module one `environment:`. Sections, however,
        may repeat.""",
        """
        local:
          int x = 0
        Go:
          pre: x == 0
          pre: x < 1
          eff: x = 1
        """,
        """
        local:
          int x = 0
        Go:
          pre: x == 0 and x < 1
          eff: x = 1
        """,
    ),
    error(
        "K143",
        "an event has no effect",
        """`pre:` may be left out and then always holds; `eff:` may not. `eff: pass` does
        nothing.""",
        """
        local:
          int x = 0
        Go:
          pre: x == 0
        """,
        """
        local:
          int x = 0
        Go:
          pre: x == 0
          eff: x = 1
        """,
    ),
)

ENTRIES: dict[str, Entry] = {
    entry.code: replace(entry, bad=entry.bad.replace("<TAB>", "\t"))
    for entry in (*_CHARACTERS, *_LAYOUT, *_LINES)
}
