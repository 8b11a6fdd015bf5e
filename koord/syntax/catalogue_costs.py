"""The stories of K247 to K249: programs that cost more than anybody can pay."""

from __future__ import annotations

from koord.syntax.catalogue_entry import error

ENTRIES = {
    entry.code: entry
    for entry in (
        error(
            "K247",
            "this takes too many steps",
            """An event, and a statement about a configuration, takes ten million steps at most. A
            step is a statement, an operator, or a part of a value that is read or written; both
            branches of an `if` count, loops count as often as they go round at most (a `break` may
            come late), and calls count with all that the function does. So functions that call
            each other twice grow quickly: twenty of them are a million steps. Let loops go over
            what is needed, or do a part of the work in each round. With more robots,
            `for i = 0, numAgents` and `forall i` take more.""",
            """
            local:
              int sum = 0
            Add:
              eff:
                for i = 0, 100000:
                  for k = 0, 100000:
                    sum = sum + k
            """,
            """
            local:
              int sum = 0
              int row = 0
            Add:
              pre: row < 100000
              eff:
                for k = 0, 100:
                  sum = sum + k
                row = row + 1
            """,
        ),
        error(
            "K248",
            "this has too many parts",
            """All variables of a run together have a million parts at most: numbers, truth values,
            and so on. An array has as many as its elements have together, a record as its fields;
            a list counts with the length that an assumption gives it, or as one element. Locals
            and ports count once for each robot. Arrays of arrays grow quickly: a list takes the
            room that its elements need.""",
            """
            local:
              int[2000][2000] seen
            Mark:
              eff: seen[0][0] = pid
            """,
            """
            local:
              int[200][200] seen
            Mark:
              eff: seen[0][0] = pid
            """,
        ),
        error(
            "K249",
            "this is too deep, with all that it calls",
            """A call counts as if the function's body stood in its place. Expressions and blocks
            then stand inside each other at most 160 deep, where a loop or a quantifier counts
            twice; and records and lists are made of each other at most 40 deep. No program that a
            person wrote comes near that; one that a program wrote can let functions call fewer
            others one inside the other.""",
            "\n".join(
                [
                    "def fun f0(int a) -> int:\n  return a + 1",
                    *(
                        f"def fun f{n}(int a) -> int:\n  return 2 * f{n - 1}(a)"
                        for n in range(1, 60)
                    ),
                    "local:\n  int n = 0\nCount:\n  eff: n = f59(n)\n",
                ]
            ),
            """
            def fun f(int a) -> int:
              return a + 1
            local:
              int n = 0
            Count:
              eff: n = f(f(f(n)))
            """,
        ),
    )
}
