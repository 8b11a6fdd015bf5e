"""The stories of K214 to K231: statements, functions' calls, literals, nesting."""

from __future__ import annotations

from koord.syntax.catalogue_entry import Entry, error

ENTRIES: dict[str, Entry] = {
    entry.code: entry
    for entry in (
        error(
            "K214",
            "`atomic` inside `atomic`",
            """An `atomic` block makes the whole event exclusive: of the robots whose effect enters
            a block of one lock class in a round, one runs its event, and the others do nothing.
            A block inside a block could not add anything.""",
            """
            allwrite:
              int sum = 0
            Add:
              eff:
                atomic:
                  sum = sum + 1
                  atomic:
                    sum = sum + 1
            """,
            """
            allwrite:
              int sum = 0
            Add:
              eff:
                atomic:
                  sum = sum + 1
                  sum = sum + 1
            """,
        ),
        error(
            "K215",
            "the bound of a loop is not known at its start",
            """Every event must end, and a verifier must know how often a loop runs at most. The
            bounds of `for i = a, b:` are therefore made of numbers, params, `pid`, `numAgents` and
            lengths of lists. A loop that may end earlier leaves with `break`.""",
            """
            local:
              int n = 3
              int sum = 0
            Add:
              eff: for i = 0, n: sum = sum + i
            """,
            """
            param int most = 10
            local:
              int n = 3
              int sum = 0
            Add:
              eff:
                for i = 0, most:
                  if i >= n: break
                  sum = sum + i
            """,
        ),
        error(
            "K216",
            "a function is recursive",
            """A function that calls itself, directly or through others, might not end, and an event
            with it. Functions call others only downwards; what has to be repeated is a `for`
            loop.""",
            """
            def fun total(int n) -> int:
              if n == 0:
                return 0
              return n + total(n - 1)
            """,
            """
            def fun total(int[] parts) -> int:
              int sum = 0
              for part in parts:
                sum = sum + part
              return sum
            """,
        ),
        error(
            "K217",
            "a call has too many or too few arguments",
            """The number of arguments is that of the parameters. Some functions of the library are
            there more than once, for other numbers or types of arguments: the hint lists them.""",
            """
            local:
              pos p = pos(0, 0, 0)
            Go:
              eff: p = midpoint(p, p, p)
            """,
            """
            local:
              pos p = pos(0, 0, 0)
            Go:
              eff: p = midpoint([p, p, p])
            """,
        ),
        error(
            "K218",
            "a record is not made of its fields",
            """A record is made with one value for each field, in order or by name. Fields whose
            declaration has an initial value may be left out. Arguments of functions have no
            names.""",
            """
            def Cargo:
              float mass
              bool fragile = false
            local:
              Cargo load
            Take:
              eff: load = Cargo(fragile = true)
            """,
            """
            def Cargo:
              float mass
              bool fragile = false
            local:
              Cargo load
            Take:
              eff: load = Cargo(mass = 2.5)
            """,
        ),
        error(
            "K219",
            "`choose` stands where nothing is chosen",
            """`choose(low, high)` is any value between the bounds, a new one each time. It stands
            for what a program does not know: in `environment:` blocks, in `init:`, and in
            assumptions. A program's own choices are its events: of those that are enabled, any may
            run.""",
            """
            local:
              int dice = 0
            Throw:
              eff: dice = choose(1, 6)
            """,
            """
            local:
              int dice = 0
            init:
              dice = choose(1, 6)
            """,
        ),
        error(
            "K220",
            "`break` outside of a loop",
            "`break` leaves the innermost `for`. Here there is none.",
            """
            local:
              bool done = false
            Stop:
              eff: if done: break
                   done = true
            """,
            """
            local:
              bool done = false
            Stop:
              eff: for i = 0, 3:
                     if done: break
                     done = true
            """,
        ),
        error(
            "K221",
            "`return` outside of a function",
            """An effect has no caller to return to. To end it early, put the rest under `else:`;
            to leave a loop, use `break`.""",
            """
            local:
              int n = 0
            Count:
              eff:
                if n > 3: return
                n = n + 1
            """,
            """
            local:
              int n = 0
            Count:
              eff:
                if n <= 3:
                  n = n + 1
            """,
        ),
        error(
            "K222",
            "a function does not return its result",
            """A function with a result returns a value on every way through its body. A loop may
            run no times, so that a `return` inside of it is not enough.""",
            """
            def fun first(int[] xs) -> int:
              for x in xs:
                return x
            """,
            """
            def fun first(int[] xs) -> int:
              for x in xs:
                return x
              return -1
            """,
        ),
        error(
            "K223",
            "a variable is declared inside an event",
            """The variables of a robot are its state, and all of them are declared at the top,
            where a reader and a verifier find them. Only functions have variables of their own.""",
            """
            local:
              int n = 0
            Count:
              eff:
                int next = n + 1
                n = next
            """,
            """
            local:
              int n = 0
              int next = 0
            Count:
              eff:
                next = n + 1
                n = next
            """,
        ),
        error(
            "K224",
            "a function reaches outside of itself",
            """A function computes a value from its arguments, and does nothing else: it reads no
            variable of the program, does not know which robot calls it, and writes only variables
            that it declares. So a call means the same wherever it stands, also in a property.""",
            """
            local:
              int n = 0
            def fun next() -> int:
              return n + 1
            Count:
              eff: n = next()
            """,
            """
            local:
              int n = 0
            def fun next(int m) -> int:
              return m + 1
            Count:
              eff: n = next(n)
            """,
        ),
        error(
            "K225",
            "a statement has no place here",
            """`atomic` stands in effects; `stop`, `trystop` and output in effects and `init:`.
            Functions and environments do none of this: functions compute values, and environments
            move ports.""",
            """
            local:
              int n = 0
            init:
              atomic: n = 1
            """,
            """
            local:
              int n = 0
            init:
              n = 1
            """,
        ),
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
