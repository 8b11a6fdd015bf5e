------------------------------ MODULE Claiming ------------------------------
\* The claiming model for TLC: one robot claims a free task or completes its own, in one step. A
\* round of koord's is some of these steps by different robots, at most one of them a claim, so that
\* both reach the same configurations.
EXTENDS Naturals

CONSTANTS ROBOTS, TASKS

VARIABLES onTask, mine, owner

Robots == 1..ROBOTS
Tasks == 1..TASKS
Nobody == 0
Nothing == 0

Init ==
    /\ onTask = [i \in Robots |-> FALSE]
    /\ mine = [i \in Robots |-> Nothing]
    /\ owner = [k \in Tasks |-> Nobody]

Assign(i, k) ==
    /\ ~onTask[i]
    /\ owner[k] = Nobody
    /\ onTask' = [onTask EXCEPT ![i] = TRUE]
    /\ mine' = [mine EXCEPT ![i] = k]
    /\ owner' = [owner EXCEPT ![k] = i]

Complete(i) ==
    /\ onTask[i]
    /\ onTask' = [onTask EXCEPT ![i] = FALSE]
    /\ UNCHANGED <<mine, owner>>

Next == \E i \in Robots : Complete(i) \/ \E k \in Tasks : Assign(i, k)

Exclusive == \A i, j \in Robots : i # j /\ mine[i] # Nothing => mine[i] # mine[j]
Owned == \A i \in Robots : mine[i] # Nothing => owner[mine[i]] = i
=============================================================================
