# Two commands: `make paper` runs the paper's study, `make test` runs the tests. Each sets up .venv by itself.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Modules are translated when they are first imported, and kept so whatever the environment says: to translate all of
# them takes longer than installing, and to translate those of a command anew takes it seconds each time.
unexport PYTHONDONTWRITEBYTECODE
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt

.PHONY: paper article calibration skeleton test test-slow test-all smoke lint numbers tables bench benchmark mutants docs clean
.DELETE_ON_ERROR:

# Tables that the documents quote.
STORED := docs/assets/tables

# The paper's study, the studies that its claims need, figures (in figures/), and one page about everything. The findings
# are printed last; `study claims` prints the verdicts.
STUDIES := paper ellipse mgdk power-law efficiency outliers starts bias anisotropic markers posterior
CONFIGS := $(STUDIES:%=configs/%.toml)
DRAW = $(BIN)/study figures --out figures
# Figures that the documents have from these studies.
PICTURES := fig2_error fig3_gdke_ellipse fig4_ugdk_ellipse fig5_methods fig6_mgdk fig7_power_law fig_efficiency \
    fig_posterior
paper: $(VENV)/.compiled results/cost.parquet
	@set -e; \
	echo "The paper's 1000 trials, and ten studies that its claims need:"; \
	$(BIN)/study run $(CONFIGS); \
	echo "The reference run in this repository, and this one:"; \
	differ=0; $(BIN)/study diff results/paper configs/paper.toml || differ=$$?; \
	echo "Figures, and one page about everything. What was found:"; \
	$(BIN)/study report $(CONFIGS) --cost results/cost.parquet --bench $(STORED)/bench.csv --readings $(STORED)/readings.csv \
	    --figures results/figures --claims --out results/report.html; \
	cp $(PICTURES:%=results/figures/%.png) $(PICTURES:%=results/figures/%.svg) figures/; \
	exit $$differ

# The cost of fits on this machine: operations counted, seconds measured. Made once.
results/cost.parquet: $(VENV)/.run
	$(BIN)/study cost --out $@

# The replication report from the stored tables, results/article.pdf, with metadata.yaml and codecheck.yml.
article: $(VENV)/.article
	$(BIN)/python tools/make_article.py

# Posteriors of many trials: how often they, and the estimators' own error ellipsoids, cover the truth.
calibration: $(VENV)/.run
	@set -e; \
	for name in calibration whole-sphere; do \
	    $(BIN)/study run configs/$$name.toml; \
	    $(BIN)/study posterior configs/$$name.toml || [ $$? -eq 3 ]; \
	    $(BIN)/study figures configs/$$name.toml fig_calibration; \
	done; \
	$(DRAW) configs/calibration.toml fig_calibration

QUOTED := regret regret-circles published efficiency robustness robust precision map misfit coverage sweep zip

# A synthetic recording, so that nothing is downloaded: its joints, its skeleton, a figure, a page that shows it.
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

# On two workers; the tests of a file stay together, because they share fixtures. The end says why tests are skipped.
JOBS ?= 2
PYTEST = $(BIN)/python -m pytest -q -rs -n $(JOBS) --dist loadfile
test: $(VENV)/.tested
	$(PYTEST) -m "not slow"

# The tests that take long: levels and coverages of all trials, of which `make test` has a quarter, and fits in four
# dimensions and more, whose loops the compiler takes long for.
test-slow: $(VENV)/.tested
	$(PYTEST) -m "slow and not quarter"

# Both at once, for continuous integration: a test that runs with all of its trials needs no quarter of them.
test-all: $(VENV)/.tested
	$(PYTEST) -m "not quarter"

# A small study of everything, for continuous integration.
smoke: $(VENV)/.run
	$(BIN)/study run configs/smoke.toml --plan --figures --summary

# Checks of the code, and of the documents as far as they need no run: numbers, tables made from the package, and the
# site with its links and its navigation.
SITE := NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
lint: $(VENV)/.docs
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python tools/bound_numbers.py
	$(BIN)/python tools/run_blocks.py --made docs/*.md
	$(SITE)

# Write the numbers of the stored tables into the documents; `make lint` fails where they differ.
numbers: $(VENV)/.dev
	$(BIN)/python tools/bound_numbers.py --write

# Compute the stored tables and draw the figures that the documents have, besides that of `make bench`. Takes minutes.
tables: paper
	@set -e; \
	$(BIN)/study run $(QUOTED:%=configs/%.toml); \
	$(BIN)/study run benchmarks/em_vmf.toml --plugin benchmarks/em_vmf.py; \
	$(BIN)/study readings --cost results/cost.parquet --out $(STORED)/readings.csv; \
	for name in regret regret-circles; do $(BIN)/study regret $$name --csv $(STORED)/$$name.csv; done; \
	for name in regret robustness map misfit coverage zip; do $(DRAW) configs/$$name.toml fig_$$name; done; \
	$(DRAW) configs/sweep.toml fig_nested; \
	$(DRAW) configs/bias.toml fig_bias; \
	$(BIN)/study certify --table $(STORED)/certify.csv; \
	$(BIN)/python tools/reference_tables.py; \
	$(BIN)/python benchmarks/em_vmf.py; \
	$(BIN)/python benchmarks/stopping.py; \
	$(BIN)/python benchmarks/limits.py; \
	$(BIN)/python benchmarks/ask.py

# The ranking of circle and sphere fits, from the archive in benchmarks/archive. METHOD=FILE puts a file's methods into
# it, ALL=1 computes it anew; CIRCLES=FOLDER has published numbers, SCANS=FOLDER scans; see benchmarks/*.py.
benchmark: $(VENV)/.bench
	$(BIN)/python benchmarks/ranking.py $(if $(METHOD),--method $(METHOD)) $(if $(ALL),--all) $(CIRCLES)
	$(if $(CIRCLES),$(BIN)/python benchmarks/given.py $(CIRCLES) $(SCANS))

# Speed as ratios to the limits of this machine and to other packages; stored in docs/assets/tables/bench.csv.
bench: $(VENV)/.bench
	$(BIN)/python -m pytest -q benchmarks --benchmark-group-by=group --benchmark-columns=min,median,rounds

# Mutants of a module, one token each, that its tests do not notice: make mutants MODULE=study/… TESTS=tests/…
mutants: $(VENV)/.dev $(VENV)/.run
	$(BIN)/python benchmarks/mutants.py $(MODULE) $(TESTS)

# The site of the documents, in site/. Every code block and command of a page is run, and prints what the page says.
docs: $(VENV)/.docs $(VENV)/.run
	$(BIN)/python tools/run_blocks.py docs/*.md
	$(SITE)
	@echo "Open site/index.html in a browser"

clean:
	rm -rf $(VENV) build site *.egg-info
	find . -name __pycache__ -prune -exec rm -rf {} +

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "needs Python 3.11 or newer; set PYTHON=…")'
	@echo "A virtual environment in $(VENV), for packages of the versions in constraints.txt:"
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(VENV)/bin/python pyproject.toml constraints.txt
	$(INSTALL) -e .
	touch $@

# The loops are compiled once, so that no study waits for the compiler: those of a small study ...
$(VENV)/.run: $(VENV)/.installed
	@echo "Loops are compiled, once after an installation or an update; some seconds:"
	@$(BIN)/study compile configs/smoke.toml
	touch $@

# ... and with them those of the paper's studies, and scalar code for the table of costs. The two studies that need most
# loops come first, one in two dimensions and one in three: two processes then seldom wait for each other.
FIRST := configs/ellipse.toml configs/efficiency.toml
$(VENV)/.compiled: $(VENV)/.installed
	@echo "Loops are compiled, once after an installation or an update; half a minute:"
	@$(BIN)/study compile --costs $(FIRST) configs/smoke.toml $(filter-out $(FIRST),$(CONFIGS))
	touch $(VENV)/.run $@

# ... and with them those of fits with their intervals, which most tests call.
$(VENV)/.tested: $(VENV)/.dev
	@echo "Loops are compiled for the tests, once after an installation or an update; a minute:"
	@$(BIN)/study compile --circles configs/smoke.toml
	touch $(VENV)/.run $@

$(VENV)/.mocap: $(VENV)/.run
	$(INSTALL) -e '.[mocap]'
	touch $@

$(VENV)/.bench: $(VENV)/.dev
	$(INSTALL) -e '.[bench]'
	touch $@

$(VENV)/.docs: $(VENV)/.dev
	$(INSTALL) -e '.[docs]'
	touch $@

$(VENV)/.article: $(VENV)/.installed
	$(INSTALL) -e '.[article]'
	touch $@

$(VENV)/.dev: $(VENV)/.installed
	$(INSTALL) -e '.[dev]'
	touch $@
