"""The plugin of pytest: claims are tests, failures show runs, and nobody else is disturbed."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from pathlib import Path

import pytest

import koord
from koord.cli.main import main
from tests.sampling import first
from tests.test_startup import modules_after

COUNTER = """\
local:
  int x = 0
Step:
  pre: x < 9
  eff: x = x + 1
invariant Low: forall i: x@i >= 0
"""
BROKEN = COUNTER + "invariant Small: forall i: x@i < 2\n"
VACUOUS = COUNTER + "Never:\n  pre: x < 0\n  eff: x = 7\n"
UNKNOWN = """\
local:
  int x = 0
Step:
  eff: x = x + 2
invariant Odd: forall i: x@i != 91
"""
#: No inductive step of a few rounds knows that numbers are even.
BY_INDUCTION = "--engine induction --robots 2 --rounds 4"


@pytest.fixture(scope="module", autouse=True)
def loaded() -> None:
    """All that a verification may load: what is loaded within a run of pytest is loaded anew by
    the next one, beside what was made of the old.
    """
    for room in ("syntax", "semantics", "traces", "sampling", "kernels", "verify"):
        folder = str(Path(koord.__file__).parent / room)
        for one in pkgutil.walk_packages([folder], f"koord.{room}."):
            import_module(one.name)
    for name in (
        "api.verdict_documents",
        "api.fairness",
        "api.traces",
        "refinement.compiled_replay",
    ):
        import_module(f"koord.{name}")
    import_module("koord.cli.counterexamples")
    import_module("koord.plugins.program_items")


@pytest.fixture
def project(pytester: pytest.Pytester) -> pytest.Pytester:
    """A project with a program that is right and one that is not, verified quickly."""
    pytester.makefile(".krd", right=COUNTER, wrong=BROKEN)
    pytester.makeini("[pytest]\nkoord_verify = --robots 2 --rounds 4 --jobs 1\n")
    return pytester


def run(project: pytest.Pytester, *words: str) -> pytest.RunResult:
    # Else warnings are errors there as they are here.
    return project.runpytest_inprocess("-p", "no:cacheprovider", "-W", "always", *words)


# --- programs as files of tests -------------------------------------------------------------------


def test_each_claim_is_a_test(project: pytest.Pytester) -> None:
    result = run(project, "--koord", "-v")
    result.assert_outcomes(passed=6, failed=1)
    result.stdout.fnmatch_lines(
        [
            "right.krd::Low PASSED*",
            "right.krd::no fault PASSED*",
            "right.krd::not vacuous PASSED*",
            "wrong.krd::Small FAILED*",
        ]
    )


def test_a_failure_shows_the_run_as_the_command_line_does(
    project: pytest.Pytester, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["verify", "wrong.krd", "--robots", "2", "--rounds", "4", "--jobs", "1"])
    story = capsys.readouterr().out.split("Small: broken")[1].split("violated: ")[0]
    assert "round 2" in story
    result = run(project, "wrong.krd")
    assert "Small: broken" + story.rstrip() in result.stdout.str()
    assert "Traceback" not in result.stdout.str()


def test_only_what_is_selected_is_verified(
    project: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    from koord.api.verify import verify_each

    asked: list[tuple[str, ...]] = []

    def noted(questions, options, tell, interrupted):  # type: ignore[no-untyped-def]
        asked.append(options.properties)
        return verify_each(questions, options, tell, interrupted)

    monkeypatch.setattr("koord.plugins.program_items.verify_each", noted)
    run(project, "wrong.krd::Low", "wrong.krd::no fault").assert_outcomes(passed=2)
    assert asked == [("Low", "no fault")], "once for both"
    run(project, "right.krd").assert_outcomes(passed=3)
    assert asked[1:] == [()], "all of them, and what verdicts are worth"


def test_nothing_is_collected_unless_it_is_asked_for(project: pytest.Pytester) -> None:
    project.makepyfile("def test_nothing(): pass")
    run(project).assert_outcomes(passed=1)
    run(project, ".").assert_outcomes(passed=1)
    run(project, "right.krd").assert_outcomes(passed=3)
    project.makeini("[pytest]\nkoord_files = r*.krd\nkoord_verify = --robots 2\n")
    run(project).assert_outcomes(passed=4)


def test_a_program_says_how_it_is_verified(project: pytest.Pytester) -> None:
    said = f"# koord verify: --robots 1..2 --with more.krd --property More\n{COUNTER}"
    folder = project.mkdir("inner")
    (folder / "said.krd").write_text(said, encoding="utf-8")
    (folder / "more.krd").write_text("invariant More: forall i: x@i < 10\n", encoding="utf-8")
    result = run(project, "inner/said.krd", "-v")
    result.assert_outcomes(passed=4)
    result.stdout.fnmatch_lines(["*::More?1 robots? PASSED*", "*::More?2 robots? PASSED*"])
    result = run(project, "inner/said.krd", "--koord-verify", "--robots 1", "-v")
    result.assert_outcomes(passed=2)


@pytest.mark.slow
def test_params_are_set(project: pytest.Pytester) -> None:
    text = "param int most = 1\n" + COUNTER.replace("x < 9", "x < most")
    (project.path / "most.krd").write_text(text + "invariant Most: forall i: x@i < 2\n")
    run(project, "most.krd").assert_outcomes(passed=4)
    run(project, "most.krd", "--koord-verify", "--set most=5").assert_outcomes(passed=3, failed=1)


@pytest.mark.parametrize(
    ("choice", "outcomes"),
    [
        ("fail", {"passed": 1, "failed": 1}),
        ("warn", {"passed": 2, "warnings": 1}),
    ],
)
def test_what_is_unknown_becomes_what_is_said(
    project: pytest.Pytester, choice: str, outcomes: dict[str, int]
) -> None:
    project.makefile(".krd", odd=UNKNOWN)
    words = ["odd.krd", "--koord-verify", BY_INDUCTION, "--deselect", "odd.krd::not vacuous"]
    given = [] if choice == "fail" else ["--koord-unknown", choice]
    result = run(project, *words, *given, "-rx")
    result.assert_outcomes(**outcomes)
    result.stdout.fnmatch_lines(["*Odd is unknown*"])


@pytest.mark.parametrize(
    ("choice", "outcomes"),
    first(
        1,
        [
            ("fail", {"passed": 2, "failed": 1}),
            ("warn", {"passed": 3, "warnings": 1}),
        ],
    ),
)
def test_what_is_vacuous_is_told(
    project: pytest.Pytester, choice: str, outcomes: dict[str, int]
) -> None:
    project.makefile(".krd", idle=VACUOUS)
    project.makeini(f"[pytest]\nkoord_vacuous = {choice}\nkoord_verify = --robots 2\n")
    result = run(project, "idle.krd", "-rx")
    result.assert_outcomes(**outcomes)
    result.stdout.fnmatch_lines(["*verdicts say less than they seem to*", "*Never*"])


# --- what is wrong --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    first(
        2,
        [
            (COUNTER.replace("x + 1", "y + 1"), "*error K201: `y` is not declared*"),
            ("# koord verify: --robots no\n" + COUNTER, "*flags of koord verify: *--robots*"),
            ("# koord verify: --json\n" + COUNTER, "*flags of koord verify: *--json*"),
            ("# koord verify: --help\n" + COUNTER, "*--help is for the command line*"),
            ("# koord verify: 'open\n" + COUNTER, "*flags of koord verify: No closing quotation*"),
            (
                "# koord verify: --property Lo\n" + COUNTER,
                "*no property 'Lo'; there are Low, no fault*",
            ),
            ("# koord verify: --with not.krd\n" + COUNTER, "*not.krd: error K901: cannot be read*"),
            ("# koord verify: --set a=1 --set a=2\n" + COUNTER, "*--set gives a two values*"),
            ("invariant Low: 1 < 2\n", "*there is no program in this file*"),
        ],
    ),
)
def test_mistakes_are_errors_of_collection(project: pytest.Pytester, text: str, said: str) -> None:
    (project.path / "bad.krd").write_text(text, encoding="utf-8")
    result = run(project, "bad.krd")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines([said])
    assert "Traceback" not in result.stdout.str()
    assert result.stderr.str() == ""


def test_properties_alone_are_no_test_unless_they_are_named(project: pytest.Pytester) -> None:
    (project.path / "more.krd").write_text("invariant More: forall i: x@i < 10\n")
    run(project, "--koord").assert_outcomes(passed=6, failed=1)


def test_a_choice_that_there_is_not_is_refused_at_once(project: pytest.Pytester) -> None:
    project.makeini("[pytest]\nkoord_unknown = pass\n")
    result = run(project)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    said = "ERROR: koord_unknown is 'pass', and has to be one of fail, xfail, warn"
    result.stderr.fnmatch_lines([said])


def test_warnings_of_koord_are_warnings_of_pytest(project: pytest.Pytester) -> None:
    (project.path / "odd.krd").write_text(COUNTER.replace("int x = 0", "int x = 0\n  int y = 0"))
    result = run(project, "odd.krd")
    result.assert_outcomes(passed=3, warnings=1)
    result.stdout.fnmatch_lines(["*KoordWarning: odd.krd:3:7: K403*"])


def test_where_warnings_are_errors_so_are_those_of_koord(project: pytest.Pytester) -> None:
    (project.path / "odd.krd").write_text(COUNTER.replace("int x = 0", "int x = 0\n  int y = 0"))
    result = run(project, "odd.krd", "-W", "error")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["odd.krd:3:7: K403: the variable `y` is never used"])


# --- the fixture ----------------------------------------------------------------------------------


def test_the_fixture_verifies_and_fails_with_the_run(project: pytest.Pytester) -> None:
    project.makepyfile(
        """
        import koord

        def test_right(koord_verify):
            report = koord_verify("right.krd", robots=2, rounds=4)
            assert report.verdict("Low").holds

        def test_loaded(koord_verify):
            koord_verify(koord.load("right.krd"), robots=2, rounds=4)

        def test_wrong(koord_verify):
            koord_verify("wrong.krd", robots=2, rounds=4)

        def test_one_property(koord_verify):
            koord_verify("wrong.krd", robots=2, rounds=4, properties=["Low"])

        def test_missing(koord_verify):
            koord_verify("missing.krd")

        def test_choice(koord_verify):
            koord_verify("odd.krd", robots=2, engine="induction", unknown="pass")
        """
    )
    project.makefile(".krd", odd=UNKNOWN)
    result = run(project)
    result.assert_outcomes(passed=3, failed=3)
    said = ["*Small: broken in round 2*", "*missing.krd: error K901*", "unknown='pass' has to*"]
    result.stdout.fnmatch_lines(said)
    assert "program_items.py" not in result.stdout.str(), "no traceback of koord"


@pytest.mark.slow
def test_the_fixture_finds_programs_beside_the_test(project: pytest.Pytester) -> None:
    folder = project.mkdir("inner")
    (folder / "own.krd").write_text(COUNTER, encoding="utf-8")
    text = "def test_own(koord_verify): koord_verify('own.krd', robots=2, rounds=4)\n"
    (folder / "test_own.py").write_text(text, encoding="utf-8")
    run(project, "inner").assert_outcomes(passed=1)


def test_the_fixture_is_told_what_becomes_of_unknown(project: pytest.Pytester) -> None:
    project.makefile(".krd", odd=UNKNOWN)
    project.makepyfile(
        """
        def test_odd(koord_verify):
            koord_verify("odd.krd", robots=2, rounds=4, engine="induction", unknown="xfail")
        """
    )
    run(project, "--koord-unknown", "fail").assert_outcomes(xfailed=1)


# --- other projects -------------------------------------------------------------------------------


def test_a_project_without_programs_loads_nothing_of_koord() -> None:
    """But the plugin itself: neither msgspec, nor any room below."""
    plugin = modules_after("import koord.plugins.pytest_plugin") - modules_after("import pytest")
    assert {name for name in plugin if name.partition(".")[0] == "koord"} == {
        "koord",
        "koord.plugins",
        "koord.plugins.choices",
        "koord.plugins.pytest_plugin",
    }
    assert plugin - {name for name in plugin if name.startswith("koord")} == set()


def test_pytest_finds_the_plugin(pytestconfig: pytest.Config) -> None:
    assert pytestconfig.pluginmanager.has_plugin("koord")
    names = {
        Path(str(one.__file__)).name
        for one in pytestconfig.pluginmanager.get_plugins()
        if getattr(one, "__name__", "").startswith("koord.plugins")
    }
    assert names == {"pytest_plugin.py"}
