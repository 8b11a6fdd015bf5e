"""What every test can count on: the same examples in every run, and no clock that fails them."""

from __future__ import annotations

import gc

import pytest
from hypothesis import is_hypothesis_test, settings

from koord.verify.processes import keep_freed_memory
from tests.sampling import one_of_each

COMMON = settings(derandomize=True, deadline=None, print_blob=False)
settings.register_profile("default", COMMON, max_examples=20)
settings.register_profile("slow", COMMON, max_examples=100)


def pytest_configure(config: pytest.Config) -> None:
    """All examples where all slow tests are run, and a fifth of them elsewhere."""
    all_of_them = "slow" in config.option.markexpr.replace("not slow", "")
    is_sample = config.getoption("one_of_each")
    settings.load_profile("slow" if all_of_them and not is_sample else "default")


def pytest_sessionstart() -> None:
    """Many tests ask Z3 in this process, and not in one of their own."""
    keep_freed_memory()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--one-of-each",
        action="store_true",
        help="of each test of which nothing runs by default one case, as tests/sampling.py says",
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
        items[:] = one_of_each(items)
