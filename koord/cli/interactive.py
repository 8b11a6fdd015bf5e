"""``koord run --interactive``: the user picks the next robot and event, and may take it back."""

from __future__ import annotations

import sys
from collections.abc import Callable

from msgspec import Struct

from koord.api.stepping import Option, Shift, Stepper
from koord.cli.tables import RunTable, ShownStep
from koord.semantics.rounds import IllegalStepError

HELP = """\
  a number   take that turn; Enter alone takes the first one
  r          let the other robots of this round move as the runtime would
  u          undo the last step
  s          show the whole configuration
  q          quit (so does the end of the input)"""


class Interactive(Struct):
    """A dialogue about a run by hand. ``play`` holds it; then ``stepper`` is where it has come."""

    stepper: Stepper
    table: RunTable

    def play(self, keep: Callable[[], None]) -> None:
        """Ask and move until the user quits, or the run ends. What is asked about is kept first."""
        _tell(*self.table.start(self.stepper.begin()))
        print("h lists what can be typed here")
        while not self.stepper.is_over:
            if not self.stepper.run.waiting:
                self._show(self.stepper.evolve())
                continue
            keep()
            if not self._ask():
                return

    def _ask(self) -> bool:
        """One question and what follows from it; False to quit."""
        print()
        print(self.table.heading(self.stepper.run.round))
        options: list[Option] = []
        for option in self.stepper.options():
            said = f"robot {option.robot}: {option.event or 'skip'}"
            if option.loses:
                print(f"       {said} (its lock is taken)")
                continue
            options.append(option)
            print(f"  {len(options):>3}  {said}")
        answer = _typed(f"which turn (1 to {len(options)}, h)? ")
        match answer:
            case None | "q":
                return False
            case "h" | "?" | "help":
                print(HELP)
            case "u":
                print("undone" if self.stepper.undo() else "there is nothing to undo")
            case "s":
                _tell(*self.table.start(self.stepper.taken[-1]))
            case "r":
                for made in self.stepper.finish_round():
                    self._show(made)
            case "":
                self._make(options[0])
            case _ if answer.isdecimal() and 1 <= int(answer[:9]) <= len(options):
                self._make(options[int(answer[:9]) - 1])
            case _:
                print(f"{answer!r} is none of the numbers; h lists what can be typed here")
        return True

    def _make(self, option: Option) -> None:
        try:
            made = self.stepper.make(option)
        except IllegalStepError as refused:
            print(f"not allowed, by rule {refused.rule}: {refused.reason}")
            return
        self._show(made)

    def _show(self, made: Shift) -> None:
        step = made.taken.step
        lines = list(self.table.rows([ShownStep(step, made.before.configuration, made.taken.lost)]))
        if step.rule == "SKIP" and not lines:
            lines = [f"  {step.robot}  skip"]
        _tell(*lines)


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
