"""Seeded mistakes in what stands beside the commands: projects, installations."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

NEW = "tests/cli/test_new.py"
DOCTOR = "tests/cli/test_doctor.py"
MODULES = "tests/cli/test_module_files.py"
SARIF = "tests/cli/test_sarif.py"
PYTEST = "tests/plugins/test_pytest_plugin.py"
NOTEBOOK = "tests/plugins/test_notebook.py"

TOOLS = (
    Mutant(
        "names of programs are markup",
        "api.results.html_table",
        "cell if isinstance(cell, Html) else escape(str(cell))",
        "str(cell)",
        (NOTEBOOK,),
    ),
    Mutant(
        "a test of a claim that is unknown passes",
        "plugins.program_items._become",
        'choice == "fail"',
        'choice == "never"',
        (PYTEST,),
    ),
    Mutant(
        "all programs of a project are collected",
        "plugins.pytest_plugin.pytest_collect_file",
        'is_named or is_like or parent.config.getoption("koord")',
        "True",
        (PYTEST,),
    ),
    Mutant(
        "columns of places count from zero",
        "api.sarif._region",
        "forms.Region(span.line, span.column, span.end_line, end_column)",
        "forms.Region(span.line, max(1, span.column - 1), span.end_line, end_column)",
        (SARIF,),
    ),
    Mutant(
        "what is unknown counts as violated",
        "api.sarif._of_verdict",
        'made.kind, made.level = "open", "none"',
        "pass",
        (SARIF,),
    ),
    Mutant(
        "code flows begin with the end",
        "api.sarif._flow",
        "list(_steps(verdict, run))",
        "list(_steps(verdict, run))[::-1]",
        (SARIF,),
    ),
    Mutant(
        "a new project replaces what is there",
        "api.new.new",
        "os.path.lexists(path)",
        "False",
        (NEW,),
    ),
    Mutant(
        "what is wanted and missing is no problem",
        "api.doctor.Doctor.problems",
        "name in self.wanted",
        "False",
        (DOCTOR,),
    ),
    Mutant(
        "a package that cannot be loaded is as good as one that can",
        "api.doctor._package",
        'f"{type(error).__name__}: {error}"',
        "None",
        (DOCTOR,),
    ),
    Mutant(
        "modules are what they were compiled from once",
        "cli.module_files._Loader._read",
        "content[:8] != _BEGIN or known != here",
        "content[:8] != _BEGIN",
        (MODULES,),
    ),
    Mutant(
        "modules are read whoever compiled them",
        "cli.module_files._Loader._read",
        "content[:8] != _BEGIN or known != here",
        "known != here",
        (MODULES,),
    ),
    Mutant(
        "a package is looked for in its first folder only",
        "cli.module_files.Finder.find_spec",
        "len(path) != 1",
        "not path",
        (MODULES,),
    ),
)
