"""``koord run --interactive``: the user picks the next robot and event, and may take it back."""

from __future__ import annotations

import sys
from collections.abc import Callable

from msgspec import Struct, field

from koord.cli.tables import Shown, Table
from koord.sampling.monitors import Watch
from koord.sampling.policies import First, take
from koord.sampling.running import Moment, Move, Run
from koord.semantics.recordings import Step
from koord.semantics.rounds import IllegalStepError
from koord.traces.trace import Violation

HELP = """\
  a number   take that turn; Enter alone takes the first one
  r          let the other robots of this round move as the runtime would
  u          undo the last step
  s          show the whole configuration
  q          quit (so does the end of the input)"""


class Interactive(Struct):
    """A run by hand. ``play`` runs it; then ``taken`` holds its steps."""

    run: Run
    watch: Watch
    table: Table
    rounds: int
    taken: list[Step] = field(default_factory=list)
    violation: Violation | None = None
    _past: list[Moment] = field(default_factory=list)

    def play(self, keep: Callable[[], None]) -> None:
        """Ask and move until the user quits, or the run ends. What is asked about is kept first."""
        first = self.run.begin()
        self._note(first)
        _tell(*self.table.start(first))
        print("h lists what can be typed here")
        while not self._over():
            if not self.run.waiting:
                self._evolve()
                continue
            keep()
            if not self._ask():
                return

    def _over(self) -> bool:
        if self.violation is not None or self.run.configuration.fault is not None:
            return True
        begun = len(self.run.waiting) < self.run.system.robots
        return not begun and (self.run.round >= self.rounds or self.run.all_stopped)

    # --- asking ---------------------------------------------------------------------------------

    def _ask(self) -> bool:
        """One question and what follows from it; False to quit."""
        print()
        print(self.table.heading(self.run.round))
        options: list[Move] = []
        for move in self._moves():
            said = f"robot {move.robot}: {self._name(move) or 'skip'}"
            if self.run.loses(move):
                print(f"       {said} (its lock is taken)")
                continue
            options.append(move)
            print(f"  {len(options):>3}  {said}")
        answer = _typed(f"which turn (1 to {len(options)}, h)? ")
        match answer:
            case None | "q":
                return False
            case "h" | "?" | "help":
                print(HELP)
            case "u":
                self._undo()
            case "s":
                _tell(*self.table.start(self.taken[-1]))
            case "r":
                self._finish_round()
            case "":
                self._move(options[0])
            case _ if answer.isdecimal() and 1 <= int(answer[:9]) <= len(options):
                self._move(options[int(answer[:9]) - 1])
            case _:
                print(f"{answer!r} is none of the numbers; h lists what can be typed here")
        return True

    def _moves(self) -> list[Move]:
        moves = []
        for robot in self.run.waiting:
            moves += [Move(robot, event) for event in self.run.enabled(robot)]
            if self.run.may_skip(robot):
                moves.append(Move(robot, None))
        return moves

    def _name(self, move: Move) -> str | None:
        if move.event is None:
            return None
        return self.run.system.agent(move.robot).events[move.event].name

    # --- moving ---------------------------------------------------------------------------------

    def _move(self, move: Move) -> None:
        moment = self.run.moment
        try:
            step = self.run.make(move)
        except IllegalStepError as refused:
            print(f"not allowed, by rule {refused.rule}: {refused.reason}")
            return
        self._past.append(moment)
        self._show(moment, step)

    def _finish_round(self) -> None:
        policy = First()
        while self.run.waiting and not self._over():
            moment = self.run.moment
            self._past.append(moment)
            taken = take(self.run, policy.move(self.run, self.run.waiting))
            self._show(moment, taken.step, taken.lost)

    def _evolve(self) -> None:
        moment = self.run.moment
        self._past.append(moment)
        self._show(moment, self.run.evolve())

    def _show(self, moment: Moment, step: Step, lost: str | None = None) -> None:
        self._note(step)
        lines = list(self.table.rows([Shown(step, moment.configuration, lost)]))
        if step.rule == "SKIP" and not lines:
            lines = [f"  {step.robot}  skip"]
        _tell(*lines)

    def _note(self, step: Step) -> None:
        self.taken.append(step)
        self.violation = self.watch.after(step)

    def _undo(self) -> None:
        """Back to before the last program turn, also across the end of a round."""
        if not self._past:
            print("there is nothing to undo")
            return
        while self._past:
            self.run.go_back(self._past.pop())
            undone = self.taken.pop()
            if undone.rule != "ENV-TRANS":
                break
        self.violation = None
        print("undone")


def _tell(*lines: str) -> None:
    for line in lines:
        print(line)


def _typed(question: str) -> str | None:
    """What the user types, None at the end of the input."""
    try:
        return input(question).strip()
    except EOFError:
        print(file=sys.stdout)
        return None
