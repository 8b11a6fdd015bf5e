"""What every test can count on: the same examples in every run, and no clock that fails them."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import pytest
from hypothesis import is_hypothesis_test, settings

from koord.verify.job_process import keep_freed_memory
from tests.sampling import PEERS, forks, one_of_each, waits, waits_for_robots

#: Mistakes that tests are to notice may be in what writes machine code: none is kept from another
#: run. Tests of that name a folder of their own.
os.environ.setdefault("KOORD_CACHE", "off")

#: Tests of koord's plugin run pytest on folders of their own.
pytest_plugins = ("pytester",)

COMMON = settings(derandomize=True, deadline=None, print_blob=False)
settings.register_profile("default", COMMON, max_examples=20)
settings.register_profile("slow", COMMON, max_examples=100)


def pytest_configure(config: pytest.Config) -> None:
    """All examples where all slow tests are run, and a fifth of them elsewhere.

    What is loaded is no garbage: it is not looked through until all is there.
    """
    gc.disable()
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


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave files alone of which no test is asked for: to load them all takes seconds."""
    only_waiting = config.option.markexpr == PEERS and collection_path.suffix == ".py"
    return True if only_waiting and not waits(collection_path) else None


def pytest_collection_finish() -> None:
    """What is loaded by now stays, and need not be looked through for garbage again and again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    gc.enable()


#: How much this process may grow, in bytes, before it looks for garbage.
_GROWTH = 300 * 2**20

#: On Linux, what says how many pages a process has; the second number are those in memory.
_PAGES = Path("/proc/self/statm")

_grown_from = 0


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown() -> None:
    """A context of Z3 is a few objects to Python, and 30 MB: it would be there for many tests.

    To fork a process that has two gigabytes takes a tenth of a second, and many tests do.
    """
    global _grown_from
    if _PAGES.exists() and _memory() > _grown_from + _GROWTH:
        gc.collect()
        _grown_from = _memory()


def _memory() -> int:
    return int(_PAGES.read_text("ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


def pytest_unconfigure() -> None:
    """Libraries that look for leaks at the end would take what is frozen for one."""
    gc.unfreeze()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark tests on what hypothesis makes, and those that wait for vehicles; take the sample.

    Those that fork come first: libraries that others load leave threads behind. Then come those
    that wait for robots: at the end nothing is left to be computed meanwhile.
    """
    for item in items:
        if isinstance(item, pytest.Function) and is_hypothesis_test(item.obj):
            item.add_marker("generated")
        if waits(item.path):
            item.add_marker("waits")
    items.sort(key=lambda item: (not forks(item.path), not waits_for_robots(item.path)))
    if config.getoption("one_of_each"):
        items[:] = one_of_each(items)
