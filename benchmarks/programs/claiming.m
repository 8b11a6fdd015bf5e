-- The claiming model for rumur and CMurphi: one robot claims a free task or completes its own.
-- A round of koord's is some of these steps by different robots, at most one of them a claim, so
-- that both reach the same configurations. `claiming.py` sets other sizes.
const
  ROBOTS: 3;
  TASKS: 4;

type
  robot: scalarset(ROBOTS);
  task: scalarset(TASKS);
var
  onTask: array[robot] of boolean;
  mine: array[robot] of task;       -- undefined: none yet
  owner: array[task] of robot;      -- undefined: free

startstate "init"
begin
  for i: robot do
    onTask[i] := false;
    undefine mine[i];
  endfor;
  undefine owner;
endstartstate;

ruleset i: robot; k: task do
  rule "assign"
    !onTask[i] & isundefined(owner[k])
  ==>
  begin
    onTask[i] := true;
    mine[i] := k;
    owner[k] := i;
  endrule;
endruleset;

ruleset i: robot do
  rule "complete"
    onTask[i]
  ==>
  begin
    onTask[i] := false;
  endrule;
endruleset;

invariant "Exclusive"
  forall i: robot do forall j: robot do
    i != j & !isundefined(mine[i]) & !isundefined(mine[j]) -> mine[i] != mine[j]
  endforall endforall;

invariant "Owned"
  forall i: robot do
    !isundefined(mine[i]) -> !isundefined(owner[mine[i]]) & owner[mine[i]] = i
  endforall;
