# make check   format, lint, strict types, fast tests: what has to pass before a commit
# make slow    the deep searches and the long fuzzing runs
# make sample  one case of each deep search of which none is a fast test, in two minutes
# make peers   the same of tests against vehicles in processes of their own
# make editors  test and pack the extension of VS Code; needs Node.js
# make bench   the tables of benchmarks/
# make docs    the documentation site, in build/site
# make playground  koord in a browser, as a static page in build/playground; needs Node.js
# make format  put the layout right

PYTHON ?= python3
VENV   ?= .venv
JOBS   ?= 2

# for how long `make slow` fuzzes the reading of programs, and that of traces
FUZZ_SECONDS ?= 60

# Many tests start processes, and each would compile all that it imports.
unexport PYTHONDONTWRITEBYTECODE

# Each worker goes through half of the tests in their order, and takes of what is left of the other's.
PARALLEL  := -n $(JOBS) --dist worksteal

BIN       := $(VENV)/bin
INSTALLED := $(VENV)/.installed
COMPILED  := $(VENV)/.compiled
ATHERIS   := $(VENV)/.atheris

# peers.py prints the tables of claiming.py and every_number.py as well.
BENCHMARKS := $(filter-out $(patsubst %,benchmarks/%.py,harness claiming every_number), \
	$(sort $(wildcard benchmarks/*.py)))

.PHONY: editors check format lint types test sample peers slow fuzz bench docs playground clean

# Types are checked beside the tests: by themselves they would keep one core busy.
check: lint
	@$(MAKE) --no-print-directory --output-sync=target -j 2 types test

lint: $(INSTALLED)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(INSTALLED)
	$(BIN)/mypy

test: $(COMPILED)
	$(BIN)/pytest -q $(PARALLEL)

# what the extension of VS Code needs comes from npm
editors: $(INSTALLED)
	$(BIN)/python -m editors.generate
	cd editors/vscode && npm ci --no-fund --no-audit && npm test && npm run package

slow: $(INSTALLED)
	$(BIN)/pytest -q $(PARALLEL) -m "slow or generated"
	$(MAKE) fuzz

sample: $(INSTALLED)
	$(BIN)/pytest -q $(PARALLEL) -m "slow and not waits" --one-of-each

# They wait more than they compute: more at once than there are cores.
peers: $(INSTALLED)
	$(BIN)/pytest -q -n 5 --dist worksteal -m "slow and waits" --one-of-each

fuzz: $(INSTALLED) $(ATHERIS)
	$(BIN)/python -m tests.fuzz.fuzz_text -max_total_time=$(FUZZ_SECONDS)
	$(BIN)/python -m tests.fuzz.fuzz_trace -max_total_time=$(FUZZ_SECONDS)

bench: $(INSTALLED)
	@wrong=; for program in $(BENCHMARKS); do \
		echo "== $$program"; $(BIN)/python $$program || wrong="$$wrong $$program"; \
	done; test -z "$$wrong" || { echo "wrong answers:$$wrong"; exit 1; }

# A page that is missing, and a link or an anchor that leads nowhere, end it.
docs: $(INSTALLED)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

# what browsers have Python from comes from npm, and wheels for it from PyPI
playground: $(INSTALLED)
	$(BIN)/python -m playground

format: $(INSTALLED)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# What uv.lock says is installed, by uv if it is there, and else by pip, which checks the same hashes.
ifneq ($(shell command -v uv),)
install = UV_PROJECT_ENVIRONMENT=$(VENV) uv sync -q --locked --inexact --python $(PYTHON) --extra $(1)
else
install = $(BIN)/python .ci/locked.py $(1) >$(VENV)/$(1).txt && \
	$(BIN)/python -m pip install -q --no-compile --require-hashes --only-binary :all: -r $(VENV)/$(1).txt && \
	$(BIN)/python -m pip install -q --no-deps -e .
endif

$(INSTALLED): pyproject.toml uv.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "koord needs Python 3.11 or newer; say which with make PYTHON=...")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(call install,dev)
	@touch $@

# Each worker of the tests would compile all that they load, at the same time as the others. What
# cannot be loaded is told by the tests.
$(COMPILED): $(INSTALLED)
	@$(BIN)/pytest -q --collect-only >$@ || true

# There is no wheel of atheris for every Python. Without it the fuzzing says so, and is left out.
$(ATHERIS): $(INSTALLED)
	@if { $(call install,fuzz); }; then touch $@; else \
		echo "atheris cannot be installed for this Python"; fi

clean:
	rm -rf $(VENV) build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
