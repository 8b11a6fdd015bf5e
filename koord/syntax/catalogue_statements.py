"""The stories of K214 to K225: statements, functions and their calls."""

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
            bounds of `for i = a, b:` are therefore made of numbers, params, `pid`, `numAgents`,
            lengths of lists, and the numbers that the loops around it are at. A loop that may end
            earlier leaves with `break`.""",
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
            where a reader and a verifier find them. Functions and `environment:` blocks have
            variables of their own, which are gone when the body ends.""",
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
    )
}
