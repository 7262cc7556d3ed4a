# Two commands: `make paper` runs the paper's study, `make test` runs the tests. Each sets up .venv by itself.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: paper test smoke lint bench reference clean
.DELETE_ON_ERROR:

# The paper's study, its figures (in figures/) and a printed summary.
paper: $(VENV)/.run
	@set -e; \
	echo "The paper's 1000 trials, its ellipses and its power law:"; \
	paper=$$($(BIN)/study run configs/paper.toml); echo "  $$paper"; \
	ellipse=$$($(BIN)/study run configs/ellipse.toml); echo "  $$ellipse"; \
	power=$$($(BIN)/study run configs/power-law.toml); echo "  $$power"; \
	$(BIN)/study figures "$$paper" "$$ellipse" "$$power" --out figures; \
	$(BIN)/study summary "$$paper"

test: $(VENV)/.dev
	$(BIN)/python -m pytest -q

# A small study of everything, for continuous integration.
smoke: $(VENV)/.run
	@set -e; \
	$(BIN)/study plan configs/smoke.toml; \
	run=$$($(BIN)/study run configs/smoke.toml); \
	$(BIN)/study figures "$$run"; \
	$(BIN)/study summary "$$run"

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/.dev
	$(BIN)/python -m pytest -q benchmarks --benchmark-group-by=group --benchmark-columns=min,median,rounds

clean:
	rm -rf $(VENV) build *.egg-info
	find . -name __pycache__ -prune -exec rm -rf {} +

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "needs Python 3.11 or newer; set PYTHON=…")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: $(VENV)/bin/python pyproject.toml constraints.txt
	$(INSTALL) -e .
	touch $@

$(VENV)/.dev: $(VENV)/.run
	$(INSTALL) -e '.[dev]'
	touch $@
