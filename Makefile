# Two commands: `make paper` runs the paper's study, `make test` runs the tests. Each sets up .venv by itself.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: paper calibration skeleton test smoke lint bench clean
.DELETE_ON_ERROR:

# The paper's study, all that its claims are judged by, figures (in figures/), verdicts, and one page about everything.
PAPER := paper ellipse mgdk power-law efficiency outliers starts bias anisotropic markers posterior
paper: $(VENV)/.run results/cost.parquet
	@set -e; \
	echo "The paper's 1000 trials, and ten studies that its claims are judged by:"; \
	runs=$$($(BIN)/study run $(PAPER:%=configs/%.toml)); \
	set -- $$runs; printf '  %s\n' "$$@"; first=$$1; \
	$(BIN)/study figures "$$1" fig2_error --out figures; \
	$(BIN)/study figures "$$2" fig3_gdke_ellipse fig4_ugdk_ellipse fig5_methods --out figures; \
	$(BIN)/study figures "$$3" fig6_mgdk --out figures; \
	$(BIN)/study figures "$$4" fig7_power_law --out figures; \
	$(BIN)/study figures "$$5" fig_efficiency --out figures; \
	shift 10; $(BIN)/study figures "$$1" fig_posterior fig_calibration --out figures; \
	$(BIN)/study claims $$runs --cost results/cost.parquet; \
	$(BIN)/study report $$runs --cost results/cost.parquet --bench results/bench.csv --out results/report.html; \
	echo "The reference run in this repository, and this one:"; \
	$(BIN)/study diff results/paper "$$first"

# What fits cost on this machine: operations counted, seconds measured. Made once.
results/cost.parquet: $(VENV)/.run
	$(BIN)/study cost --out $@

# Posteriors of many trials: are they, and the estimators' own error ellipsoids, right as often as they say? Minutes.
calibration: $(VENV)/.run
	@set -e; \
	for config in calibration whole-sphere; do \
	    run=$$($(BIN)/study run configs/$$config.toml); \
	    $(BIN)/study posterior "$$run"; \
	    $(BIN)/study figures "$$run" fig_calibration; \
	done

# A body that moves, made here, so that nothing is downloaded: its joints, its skeleton, a figure, a page that shows it.
BODY := results/recordings/body
skeleton: $(VENV)/.mocap
	@set -e; \
	echo "A synthetic body, noise of 2 mm, a twentieth of the samples missing:"; \
	$(BIN)/study synthetic --noise 0.002 --gaps 0.05 --out $(BODY)/body.c3d; \
	echo; echo "Its joints, fitted once:"; \
	$(BIN)/study joints $(BODY)/body.c3d; \
	echo; echo "Its skeleton in every frame:"; \
	$(BIN)/study skeleton $(BODY)/body.c3d --calibration $(BODY); \
	echo; echo "Open $(BODY)/viewer.html in a browser; the figure is $(BODY)/fig1_skeleton.png"

# On two workers; those of a file stay together, for they share what is made once.
JOBS ?= 2
test: $(VENV)/.dev
	$(BIN)/python -m pytest -q -n $(JOBS) --dist loadfile

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

# Ratios to the limits of this machine and to other people's code, and growth; stored in results/bench.csv.
bench: $(VENV)/.bench
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

$(VENV)/.mocap: $(VENV)/.run
	$(INSTALL) -e '.[mocap]'
	touch $@

$(VENV)/.bench: $(VENV)/.dev
	$(INSTALL) -e '.[bench]'
	touch $@

$(VENV)/.dev: $(VENV)/.run
	$(INSTALL) -e '.[dev]'
	touch $@
