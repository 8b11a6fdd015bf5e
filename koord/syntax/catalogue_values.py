"""The stories of K226 to K231: values that are not known, lost or of the wrong sort."""

from __future__ import annotations

from koord.syntax.catalogue_entry import Entry, error

ENTRIES: dict[str, Entry] = {
    entry.code: entry
    for entry in (
        error(
            "K226",
            "a value is not known where it is needed",
            """Initial values are computed before the first round: they know numbers, params,
            `numAgents`, and (except under `allwrite:`, which is one for all robots) `pid`. They
            know no variables and no sensors: assign those in `init:`. The values of params are
            known before the run: they know numbers and other params only.""",
            """
            using Motion
            local:
              pos home = Motion.psn
            Return:
              eff: Motion.target = home
            """,
            """
            using Motion
            local:
              pos home
            init:
              home = Motion.psn
            Return:
              eff: Motion.target = home
            """,
        ),
        error(
            "K227",
            "the size of an array is not known beforehand",
            """`T[k]` has exactly `k` elements, in every run: `k` is a number or a `param int`, or
            `numAgents`. A list that grows is declared as `T[]`.""",
            """
            local:
              int cells[2 * numAgents]
            Mark:
              eff: cells[0] = pid
            """,
            """
            param int n = 6
            local:
              int cells[n]
            Mark:
              eff: cells[0] = pid
            """,
        ),
        error(
            "K228",
            "a value is lost, or there is none",
            """Calls that change a list (`append`, `remove`, `pop`) and `assign` stand as statements
            of their own and give no value, except in `v = pop(q)`. Calls of functions give a value
            and change nothing: as statements they would do nothing. A function without a result
            could do nothing either.""",
            """
            local:
              int[] seen = []
              int n = 0
            See:
              eff: n = length(append(seen, pid))
            """,
            """
            local:
              int[] seen = []
              int n = 0
            See:
              eff: append(seen, pid)
                   n = length(seen)
            """,
        ),
        error(
            "K229",
            "an operation does not apply to this type",
            """Arithmetic is for numbers; positions can be added, subtracted, and multiplied or
            divided by a number; `%` is for two `int`. Orders compare numbers, `==` two values of
            one type. Indices, loops and `length` want a list, a queue, an array or a map.""",
            """
            local:
              bool here = true
              int n = 0
            Count:
              eff: n = n + here
            """,
            """
            local:
              bool here = true
              int n = 0
            Count:
              eff: if here: n = n + 1
            """,
        ),
        error(
            "K230",
            "nothing says what an empty list or map holds",
            """`[]` and `{}` take their type from their place: the variable that they are assigned
            to, the parameter that they are given for, the value that they are compared with.""",
            """
            local:
              int n = 0
            Count:
              eff: n = length([])
            """,
            """
            local:
              int[] none = []
              int n = 0
            Count:
              eff: n = length(none)
            """,
        ),
        error(
            "K231",
            "this is nested too deep",
            """Expressions and blocks stand inside each other at most 120 deep. No text that a
            person wrote comes near that; a text that a program wrote can be cut into parts.""",
            "local:\n  int n = 0\nCount:\n  eff: n = " + "n + " * 150 + "n\n",
            """
            local:
              int n = 0
            Count:
              eff: n = n * 151
            """,
        ),
    )
}
