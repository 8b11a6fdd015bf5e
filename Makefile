# make check   format, lint, strict types, fast tests: what has to pass before a commit
# make slow    the deep searches and the long fuzzing runs
# make bench   the tables of benchmarks/
# make format  put the layout right

PYTHON ?= python3
VENV   ?= .venv
JOBS   ?= 2

# for how long `make slow` fuzzes the reading of programs, and that of traces
FUZZ_SECONDS ?= 60

BIN       := $(VENV)/bin
INSTALLED := $(VENV)/.installed
ATHERIS   := $(VENV)/.atheris

BENCHMARKS := $(filter-out benchmarks/harness.py,$(sort $(wildcard benchmarks/*.py)))

.PHONY: check format lint types test slow fuzz bench clean

check: lint types test

lint: $(INSTALLED)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(INSTALLED)
	$(BIN)/mypy

test: $(INSTALLED)
	$(BIN)/pytest -q -n $(JOBS)

slow: $(INSTALLED)
	$(BIN)/pytest -q -n $(JOBS) -m slow
	$(MAKE) fuzz

fuzz: $(INSTALLED) $(ATHERIS)
	$(BIN)/python -m tests.fuzz.fuzz_text -max_total_time=$(FUZZ_SECONDS)
	$(BIN)/python -m tests.fuzz.fuzz_trace -max_total_time=$(FUZZ_SECONDS)

bench: $(INSTALLED)
	@wrong=; for program in $(BENCHMARKS); do \
		echo "== $$program"; $(BIN)/python $$program || wrong="$$wrong $$program"; \
	done; test -z "$$wrong" || { echo "wrong answers:$$wrong"; exit 1; }

format: $(INSTALLED)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

$(INSTALLED): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "koord needs Python 3.11 or newer; say which with make PYTHON=...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q -e '.[dev]'
	@touch $@

# There is no wheel of atheris for every Python. Without it the fuzzing says so, and is left out.
$(ATHERIS): $(INSTALLED)
	@if $(BIN)/python -m pip install -q --only-binary atheris -e '.[fuzz]'; then touch $@; else \
		echo "atheris cannot be installed for this Python"; fi

clean:
	rm -rf $(VENV) build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
