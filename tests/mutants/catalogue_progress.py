"""Mistakes in proofs of progress for every number of robots: premises forgotten. [T-PROGRESS]"""

from __future__ import annotations

from tests.mutants.mutant import Mutant

PREMISES = "tests/verify/engines/every_n/test_progress.py"

RACES = "tests/verify/strategy/test_liveness_race.py"

FOUND = "tests/verify/strategy/test_found_lemmas.py"
LEMMAS = "tests/verify/engines/every_n/test_progress_lemmas.py"

LEAST = "tests/verify/engines/every_n/test_progress_least.py"

RINGS = "tests/verify/engines/every_n/test_progress_rings.py"

_QUESTIONS = "verify.engines.every_n.progress_questions"
_STATEMENTS = "verify.engines.every_n.progress_statements"

_RACE = (
    "RaceTurn({}, self.pool, self.steps, part.stage, lambda ledger: bool(ledger.open()), "
    "patience=row.patience)"
)

PROGRESS = (
    # (settles)
    Mutant(
        "a measure may grow",
        f"{_QUESTIONS}.RoundQuestions.grows",
        "[larger, negative, faulty, fails]",
        "[negative, faulty, fails]",
        (PREMISES,),
    ),
    Mutant(
        "a statement may become true again",
        f"{_QUESTIONS}.RoundQuestions.grows",
        "[here, new, self.said.negated(old)]",
        "[here, new, old, self.said.negated(old)]",
        (PREMISES,),
    ),
    Mutant(
        "a measure falls for ever",
        f"{_QUESTIONS}.RoundQuestions.grows",
        "[larger, negative, faulty, fails]",
        "[larger, faulty, fails]",
        (PREMISES,),
    ),
    Mutant(
        "measures settle in any order",
        "verify.engines.every_n.progress._Search._settled",
        "questions.changing(questions.settling(left))",
        "questions.changing(left)",
        (PREMISES,),
    ),
    Mutant(
        "what help reads may change",
        f"{_QUESTIONS}.RoundQuestions.helping_unmoved",
        "not met.intersection(reads)",
        "True",
        (LEAST,),
    ),
    Mutant(
        "the first of those who wait is the first of all",
        f"{_QUESTIONS}.StateQuestion._suppose_least",
        "conjunction(d, [when, is_one(other)])",
        "conjunction(d, [when, said.is_one(other, core.RobotRange())])",
        (LEAST,),
    ),
    Mutant(
        "what goes round need not come nearer",
        "verify.engines.every_n.progress._Search._go_round",
        "not questions.settling([measure])",
        "False",
        (RINGS,),
    ),
    # (helps)
    Mutant(
        "who helps stops to help",
        f"{_QUESTIONS}.RoundQuestions._refuses",
        "[self.said.negated(self.said.helps(help_, robot, self.after))]",
        "[self.said.negated(self.said.helps(help_, robot, self.before))]",
        (PREMISES,),
    ),
    Mutant(
        "who helps runs something that changes nothing",
        f"{_QUESTIONS}.RoundQuestions._refuses",
        "[runs, self.said.negated(self.said.ready(robot, self.step.start.robot))]",
        "[self.said.negated(self.said.ready(robot, self.step.start.robot))]",
        (PREMISES,),
    ),
    Mutant(
        "who helps is not ready",
        f"{_QUESTIONS}.RoundQuestions._refuses",
        "[runs, self.said.negated(self.said.ready(robot, self.step.start.robot))]",
        "[runs]",
        (PREMISES,),
    ),
    Mutant(
        "a robot that stopped is ready to help",
        f"{_STATEMENTS}.Statements.ready",
        "[here, self._awake(state(kind, robot)), holds, sound]",
        "[here, holds, sound]",
        (PREMISES,),
    ),
    Mutant(
        "what is expected is expected without a reason",
        f"{_QUESTIONS}.RoundQuestions._refuses",
        "ways.append(self.said.negated(self._promises(help_, robot, self.before)))",
        "pass",
        (PREMISES,),
    ),
    Mutant(
        "what is expected is so already",
        f"{_QUESTIONS}.RoundQuestions._refuses",
        "ways.append(self._kept(help_, robot, self.after))",
        "pass",
        (PREMISES,),
    ),
    Mutant(
        "a run lets nothing be expected",
        f"{_QUESTIONS}.RoundQuestions._refuses",
        "d.binary(BinaryOp.AND, runs, self.said.negated(promised))",
        "d.binary(BinaryOp.AND, runs, promised)",
        (PREMISES,),
    ),
    Mutant(
        "what falls as time passes may fall by nothing",
        f"{_QUESTIONS}.RoundQuestions._stays",
        "d.binary(BinaryOp.LE, new, d.binary(BinaryOp.SUB, old, least))",
        "d.binary(BinaryOp.LE, new, old)",
        (PREMISES,),
    ),
    Mutant(
        "what falls as time passes may grow",
        f"{_QUESTIONS}.RoundQuestions._stays",
        "[self.said.negated(enough), negative, faulty, fails]",
        "[negative, faulty, fails]",
        (PREMISES,),
    ),
    # (somebody)
    Mutant(
        "nobody needs to help",
        f"{_QUESTIONS}.StateQuestion.somebody",
        "not self.asking.failing(asked) and not self.asking.limits",
        "not self.asking.limits",
        (PREMISES,),
    ),
    # (granted)
    Mutant(
        "who is granted a lock may wait for ever",
        f"{_QUESTIONS}.RoundQuestions.runs_in_vain",
        "bool(self.step.asking.sift(asked, self._given))",
        "False",
        (PREMISES,),
    ),
    Mutant(
        "who can run another event asks for a lock",
        f"{_STATEMENTS}.Statements._asks",
        "ways.append(d.binary(BinaryOp.IMPLIES, here, off))",
        "pass",
        (PREMISES,),
    ),
    Mutant(
        "what is not granted for the sake of the goal is not asked for",
        "verify.engines.every_n.progress._Search._is_enough",
        "self._somebody_helps(self.help, self.locks)",
        "self._somebody_helps(self.help, self._classes())",
        (PREMISES,),
    ),
    # what stands around
    Mutant(
        "lemmas of progress need no proof",
        "verify.engines.every_n.progress_lemmas.Lemmas.proved",
        "[claim for claim in claims if claim in shown.proved]",
        "list(claims)",
        (LEMMAS,),
    ),
    Mutant(
        "what leads to a goal lasts",
        f"{_QUESTIONS}.RoundQuestions.lasting",
        "[said for said in phrases if said not in lost]",
        "list(phrases)",
        (PREMISES,),
    ),
    Mutant(
        "robots that enter lock classes are forgotten",
        f"{_QUESTIONS}.RoundQuestions._of_some",
        "[conjunction(d, [*others, says(self.robot)]), *(says(w) for w in self._winners)]",
        "[conjunction(d, [*others, says(self.robot)])]",
        (PREMISES,),
    ),
    Mutant(
        "likely lemmas need no proof",
        "verify.engines.every_n.liveness_engine._holding",
        "[claim for claim in likely if claim in shown.proved]",
        "list(likely)",
        (PREMISES, FOUND),
    ),
    Mutant(
        "a slice has words for all that was found of others",
        "verify.strategy.liveness._said_of",
        "speaks_of(program, stated)",
        "program",
        (FOUND,),
    ),
    Mutant(
        "what was found for claims about states is not handed on",
        "verify.strategy.verification._Verification._of_runs",
        "tuple(dict.fromkeys(x for v in everyone for x in v.lemmas))",
        "()",
        (FOUND,),
    ),
    Mutant(
        "proofs of progress do not say that they rest on fairness about locks",
        "verify.engines.every_n.liveness_engine.fairness_of",
        '("locks", bool(proof.locks))',
        '("locks", False)',
        (PREMISES,),
    ),
    Mutant(
        "proofs of progress do not say what is expected",
        "verify.engines.every_n.liveness_engine.fairness_of",
        "each.expectation is not None",
        "each.expectation is not None and each.expectation < 0",
        (PREMISES,),
    ),
    Mutant(
        "progress of every number rests on what holds of this number",
        "verify.strategy.liveness._Asking.on_opaque",
        "self.everyone if of_everyone else self.proved",
        "self.proved",
        (PREMISES,),
    ),
    Mutant(
        "whoever may help is taken to help",
        "verify.engines.every_n.progress._Search._is_enough",
        "set(self.help) >= set(self.likely) and set(self.locks) >= set(self._classes())",
        "True",
        (PREMISES,),
    ),
    Mutant(
        "locks that may be asked for are taken to be granted",
        "verify.engines.every_n.progress._Search._is_enough",
        "set(self.locks) >= set(self._classes())",
        "True",
        (PREMISES, LEMMAS),
    ),
    # races
    Mutant(
        "what engines of races about whole runs find out besides is lost",
        "verify.strategy.liveness._ApartTurn.work",
        "ledger.vacuities += self.workers.tools.vacuities",
        "pass",
        (RACES,),
    ),
    Mutant(
        "what is found out besides elsewhere is not told",
        "verify.ledger.Ledger.take",
        "self.vacuities += extract.vacuities",
        "pass",
        (RACES,),
    ),
    Mutant(
        "circuits of whole runs ask as many questions as ever",
        "verify.engines.bits.liveness_engine._tries",
        "tuple((replace(each, questions=few) for each in QUICKLY))",
        "QUICKLY",
        (RACES,),
    ),
    Mutant(
        "whoever races about whole runs is asked alone",
        "verify.strategy.liveness._Asking._race",
        _RACE.format("first, beside"),
        _RACE.format("beside, first"),
        (RACES,),
    ),
)
