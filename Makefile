# Two commands: `make paper` runs the paper's study, `make test` runs the tests. Each sets up .venv by itself.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: paper efficiency test smoke lint bench clean
.DELETE_ON_ERROR:

# The paper's study, its figures (in figures/) and a printed summary.
paper: $(VENV)/.run
	@set -e; \
	echo "The paper's 1000 trials, its ellipses, its two markers and its power law:"; \
	paper=$$($(BIN)/study run configs/paper.toml); echo "  $$paper"; \
	ellipse=$$($(BIN)/study run configs/ellipse.toml); echo "  $$ellipse"; \
	mgdk=$$($(BIN)/study run configs/mgdk.toml); echo "  $$mgdk"; \
	power=$$($(BIN)/study run configs/power-law.toml); echo "  $$power"; \
	$(BIN)/study figures "$$paper" fig2_error --out figures; \
	$(BIN)/study figures "$$ellipse" fig3_gdke_ellipse fig4_ugdk_ellipse fig5_methods --out figures; \
	$(BIN)/study figures "$$mgdk" fig6_mgdk --out figures; \
	$(BIN)/study figures "$$power" fig7_power_law --out figures; \
	$(BIN)/study summary "$$paper"

# Beyond the paper: every estimator against the bound, over noise and angle.
efficiency: $(VENV)/.run
	@set -e; \
	run=$$($(BIN)/study run configs/efficiency.toml); echo "  $$run"; \
	$(BIN)/study figures "$$run" fig_efficiency --out figures

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

# The plan of a study compiles its loops, which are then kept: no study has to wait for it.
$(VENV)/.run: $(VENV)/bin/python pyproject.toml constraints.txt
	$(INSTALL) -e .
	$(BIN)/study plan configs/smoke.toml >/dev/null
	touch $@

$(VENV)/.dev: $(VENV)/.run
	$(INSTALL) -e '.[dev]'
	touch $@
