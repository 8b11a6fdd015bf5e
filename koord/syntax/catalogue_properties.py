"""The stories of K3xx: properties, contracts, environments and summaries."""

from __future__ import annotations

from koord.syntax.catalogue_entry import Entry, error

ENTRIES: dict[str, Entry] = {
    entry.code: entry
    for entry in (
        error(
            "K301",
            "a quantifier stands in a program",
            """`forall` and `exists` say things; they stand in properties, contracts and summaries.
            A program goes through robots and lists with `for`, or asks `all(…)` and `any(…)` of a
            list of truth values.""",
            """
            allread:
              bool[] ready
            Go:
              pre: forall i: ready[i]
              eff: stop
            """,
            """
            allread:
              bool[] ready
            Go:
              pre: all(ready)
              eff: stop
            """,
        ),
        error(
            "K302",
            "`@` has no meaning here",
            """`v@i` is the local, port or status of robot `i`, seen from outside: it stands in
            properties and contracts. A robot itself sees of the others only what they share. And
            where something is the same for all robots, as an `allwrite` variable is, there is no
            robot to name.""",
            """
            allwrite:
              int turn = 0
            Take:
              eff: turn = pid
            invariant: forall i: turn@i >= 0
            """,
            """
            allwrite:
              int turn = 0
            Take:
              eff: turn = pid
            invariant: turn >= 0
            """,
        ),
        error(
            "K303",
            "a primed name stands elsewhere than in `ensures:`",
            """`temp'` is the value of a port after the environment's turn. The `ensures:` of a
            contract relates it to the value before. Invariants speak of one configuration.""",
            """
            local:
              int n = 0
            Count:
              eff: n = n + 1
            invariant: n' > n
            """,
            """
            using Heater:
              sensors:
                float temp
              contract Slow:
                requires: temp > 0
                ensures: temp' < temp + 1
            invariant: temp > 0
            """,
        ),
        error(
            "K304",
            "`ran` names no event, or stands in a program",
            """`ran(Event)@i` says that robot `i` ran that event in the round just ended. It stands
            in properties, and names one event of the program.""",
            """
            local:
              int n = 0
            Count:
              eff: n = n + 1
            invariant: forall i: ran(Cuont)@i implies n@i > 0
            """,
            """
            local:
              int n = 0
            Count:
              eff: n = n + 1
            invariant: forall i: ran(Count)@i implies n@i > 0
            """,
        ),
        error(
            "K306",
            "a property speaks of every value of a type",
            """There are infinitely many positions and numbers, and a run visits few. Properties
            speak of robots, ranges and elements of lists. Only the summary of an external function
            may say something of every value.""",
            """
            allwrite:
              int top = 0
            Rise:
              eff: top = 1
            invariant: forall int k: top >= k or k > 0
            """,
            """
            allwrite:
              int top = 0
            Rise:
              eff: top = 1
            invariant: forall k in 0, 3: top >= k or k > 0
            """,
        ),
        error(
            "K307",
            "a contract speaks of more than ports",
            """A contract is kept by the device or the simulator behind a module, which knows its
            ports and no variables of the program. What relates ports and variables is an
            `invariant`.""",
            """
            local:
              float limit = 30
            using Heater:
              sensors:
                float temp
              contract Cool:
                ensures: temp' < limit
            Lower:
              eff: limit = 20
            """,
            """
            param float limit = 30
            using Heater:
              sensors:
                float temp
              contract Cool:
                ensures: temp' < limit
            """,
        ),
        error(
            "K308",
            "`choose` in a property stands alone",
            """A property chooses nothing. `x == choose(low, high)` is accepted and says that `x`
            is between the bounds, both included; so do two comparisons.""",
            """
            local:
              float x
            assume: forall i: x@i < choose(0, 1)
            """,
            """
            local:
              float x
            assume: forall i: x@i == choose(0, 1)
            """,
        ),
        error(
            "K309",
            "a statement calls a function that answers anew each time",
            """A function declared `extern fresh` (a randomised planner, say) may give another
            answer each time, also for the same arguments: a property that called it would speak of
            an answer that nobody got. Keep the answer in a variable, and speak of that.""",
            """
            using Motion
            local:
              pos[] way
            Plan:
              eff: way = findPath(Motion.psn, pos(0, 0, 0))
            invariant: length(findPath(Motion.psn, pos(0, 0, 0))) > 0
            """,
            """
            using Motion
            local:
              pos[] way = []
            Plan:
              eff: way = findPath(Motion.psn, pos(0, 0, 0))
            invariant: ran(Plan) implies length(way) > 0
            """,
        ),
        error(
            "K310",
            "what a summary says of every value of a type is more than a promise",
            """A summary may promise something of every value of a type: of some of them it can be
            tried, and of the others it is taken on trust. What it denies of all of them, requires
            of callers for all of them, or says of one without naming it, cannot be tried at
            all.""",
            """
            def fun root(int n) -> int: extern
              ensures: exists int r: r == result and r * r <= n
            local:
              int x = 0
            Go:
              eff: x = root(2)
            """,
            """
            def fun root(int n) -> int: extern
              ensures:
                result * result <= n
                forall int r: r * r <= n implies r <= result
            local:
              int x = 0
            Go:
              eff: x = root(2)
            """,
        ),
    )
}
