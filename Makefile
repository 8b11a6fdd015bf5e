# make check   format, lint, strict types, fast tests: what has to pass before a commit
# make slow    the deep searches and the long fuzzing runs
# make bench   the tables of benchmarks/
# make format  put the layout right

PYTHON ?= python3
VENV   ?= .venv
JOBS   ?= 2

BIN       := $(VENV)/bin
INSTALLED := $(VENV)/.installed

BENCHMARKS := $(filter-out benchmarks/harness.py,$(sort $(wildcard benchmarks/*.py)))

.PHONY: check format lint types test slow bench clean

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

clean:
	rm -rf $(VENV) build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
