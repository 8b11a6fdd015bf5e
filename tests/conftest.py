"""What every test can count on: the same examples in every run, and no clock that fails them."""

from __future__ import annotations

import gc

import pytest
from hypothesis import is_hypothesis_test, settings

from koord.verify.processes import keep_freed_memory
from tests.sampling import is_too_long

COMMON = settings(derandomize=True, deadline=None, print_blob=False)
settings.register_profile("default", COMMON, max_examples=20)
settings.register_profile("slow", COMMON, max_examples=100)


def pytest_configure(config: pytest.Config) -> None:
    """All examples where slow tests are run, and a fifth of them elsewhere."""
    marks = config.option.markexpr
    settings.load_profile("slow" if "slow" in marks.replace("not slow", "") else "default")


def pytest_sessionstart() -> None:
    """Many tests ask Z3 in this process, and not in one of their own."""
    keep_freed_memory()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--one-of-each",
        action="store_true",
        help="of the cases of each slow test the first one, but for those of tests/sampling.py",
    )


def pytest_collection_finish() -> None:
    """What is loaded by now stays, and need not be looked through for garbage again and again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


def pytest_unconfigure() -> None:
    """Libraries that look for leaks at the end would take what is frozen for one."""
    gc.unfreeze()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Tests on what hypothesis makes are run by `make slow` again."""
    for item in items:
        if isinstance(item, pytest.Function) and is_hypothesis_test(item.obj):
            item.add_marker("generated")
    if config.getoption("one_of_each"):
        chosen: dict[str, pytest.Item] = {}
        for item in items:
            if item.get_closest_marker("slow") and not is_too_long(item.name):
                chosen.setdefault(item.nodeid.partition("[")[0], item)
        items[:] = chosen.values()
