# Two commands matter: `make book` builds the book, `make test` checks everything. Both set up .venv first.

# An interpreter to make .venv with; left empty, the first of these that is new enough is taken.
PYTHON ?=
PYTHON_CANDIDATES := python3.13 python3.12 python3.11 python3 python
VENV := .venv
STAMP := $(VENV)/.installed
BIN := $(VENV)/bin
# The libraries that `make bench` compares with, in an environment of their own.
PEERS := .venv-bench
# The lowest versions that pyproject.toml declares, for `make lowest`, and what finds them.
LOWEST := .venv-lowest
UV := uv==0.13.9
# Parallel test processes.
JOBS ?= 2
# The notebooks that take longest begin, so that no process waits for the last one.
LONG := your_own_radar when_a_path_looks_wrong d_panels_and_readings 15_true_covariance \
  why_is_my_covariance_too_small e_other_costs 13_the_whole_drive f_more_from_the_road
LONG := $(LONG:%=chapters/%.ipynb)
NOTEBOOKS := $(LONG) $(filter-out $(LONG),$(sort $(wildcard chapters/*.ipynb)))

# Notebooks run the same for everyone: with the kernel in .venv even if the user has another of the same name, with
# no start-up files of the user's, and with IPython's inline figures whatever backend is chosen in the shell.
export JUPYTER_PREFER_ENV_PATH := 1
export IPYTHONDIR := $(CURDIR)/$(VENV)/ipython
unexport MPLBACKEND PYTHONPATH PYTHONWARNINGS
# What is imported by dozens of kernels is compiled once.
unexport PYTHONDONTWRITEBYTECODE
# The matrices are tiny: threads of the linear algebra library only get in each other's way.
export OPENBLAS_NUM_THREADS := 1

SHELL := /bin/sh
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup book html record test test-book test-engine lowest coverage notebooks lint format bench sweep lab radarscenes nuscenes clean distclean

help: ## List what can be made (default)
	@awk 'BEGIN { FS = ":.*## " } /^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

setup: $(STAMP) ## Make .venv with the exact versions of requirements.txt

# What dozens of processes import is compiled at once, on all cores.
$(STAMP): requirements.txt pyproject.toml
	@set -e; \
	python=; \
	for candidate in $(if $(PYTHON),"$(PYTHON)",$(PYTHON_CANDIDATES)); do \
	  if "$$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then \
	    python=$$candidate; break; \
	  fi; \
	done; \
	if [ -z "$$python" ]; then \
	  echo "Python 3.11 or newer is needed; tried: $(if $(PYTHON),$(PYTHON),$(PYTHON_CANDIDATES))." >&2; \
	  for candidate in $(if $(PYTHON),"$(PYTHON)",$(PYTHON_CANDIDATES)); do \
	    version=$$("$$candidate" --version 2>/dev/null) && echo "  $$candidate is $$version" >&2; \
	  done; \
	  echo "Name one with: make PYTHON=/path/to/python3.11" >&2; \
	  exit 1; \
	fi; \
	if [ -z "$(PYTHON)" ] && $(BIN)/python -m pip --version >/dev/null 2>&1; then \
	  echo "Bringing $(VENV) up to date"; \
	else \
	  echo "Setting up $(VENV) with $$("$$python" --version) ($$python)"; \
	  "$$python" -m venv --clear $(VENV) || { \
	    echo "$$python cannot make virtual environments (on Debian: apt install python3-venv)." >&2; exit 1; }; \
	fi
	$(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check -r requirements.txt
	@$(BIN)/python -W ignore -m compileall -qq -j 0 -x /tests/ $(VENV)/lib || :
	@mkdir -p $(VENV)/ipython/profile_default
	@cp tools/ipython_kernel_config.py $(VENV)/ipython/profile_default/
	@touch $@

# The pages are built from a copy of the sources in which nothing is left to execute: the notebooks have been executed
# before, in parallel, or come with the outputs that they are stored with, which `make test` proves fresh.
SOURCE := _build/source
define copy_sources
	@rm -rf _build && mkdir -p $(SOURCE)
	@cp -R _toc.yml docutils.conf intro.md references.bib _static api chapters tools $(SOURCE)
	@sed 's/execute_notebooks: force/execute_notebooks: "off"/' _config.yml > $(SOURCE)/_config.yml
endef
define build_pages
	$(BIN)/jupyter-book build $(SOURCE) --path-output . -W -n --keep-going
	@echo
	@echo "The book: file://$(CURDIR)/_build/html/index.html"
endef

book: $(STAMP) ## Execute every notebook afresh and build the book in _build/html
	$(copy_sources)
	$(BIN)/python tools/run_notebooks.py --jobs $(JOBS) --into $(SOURCE)/chapters $(NOTEBOOKS)
	$(build_pages)

html: $(STAMP) ## Build the book from the notebooks' stored outputs, in a minute
	$(copy_sources)
	$(build_pages)

# What all processes need is compiled once, before they start.
test: $(STAMP) ## Run the tests, and every notebook against its stored outputs
	$(BIN)/python -c 'from d2d.radar import Mounting, Tracker; Tracker({"radar": Mounting()})'
	$(BIN)/python -m pytest -n $(JOBS) --dist loadscope --no-loadscope-reorder --nbval --nbval-current-env \
	  --nbval-sanitize-with tests/nbval.cfg --nbval-cell-timeout 300 $(NOTEBOOKS) tests

test-book: $(VENV)/.book-test _build/html/index.html ## Test the built book in a real browser, if one is installed
	$(BIN)/python -m pytest -n $(JOBS) --dist loadgroup tests/book

test-engine: $(VENV)/.book-test ## Compare the engine of the laboratories with d2d, in a real browser
	$(BIN)/python -m pytest tests/book/test_engine.py tests/book/test_tracker.py

$(VENV)/.book-test: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'd2d[book-test]'
	@touch $@

_build/html/index.html:
	@$(MAKE) --no-print-directory book

# Older versions warn of newer ones beneath them: here, a warning is no error. The wheels of these versions end at
# Python 3.12.
lowest: $(LOWEST)/.installed ## Test the package with the lowest versions that pyproject.toml declares
	$(LOWEST)/bin/python -m pytest -n $(JOBS) --dist loadscope -m 'not slow' -W default \
	  tests/test_*.py tests/radar tests/baselines tests/study/test_runs.py

$(LOWEST)/.installed: requirements.txt pyproject.toml
	@$(MAKE) --no-print-directory $(STAMP)
	$(BIN)/python -m venv --clear $(LOWEST)
	@echo '*' > $(LOWEST)/.gitignore
	$(LOWEST)/bin/python -m pip install --quiet --disable-pip-version-check '$(UV)'
	$(LOWEST)/bin/uv pip install --python $(LOWEST)/bin/python --resolution lowest-direct -e '.[study,track,radarscenes,ros]' \
	  $$(sed -nE 's/^((pytest|pytest-xdist|hypothesis|scikit-learn)==[^ ]+).*/\1/p' requirements.txt)
	@touch $@

coverage: $(STAMP) ## Print which lines of d2d the tests do not run; fails below 95 %
	$(BIN)/python -m pytest -q -n $(JOBS) --dist loadscope --ignore tests/chapters/test_notebooks.py \
	  --cov=d2d --cov-report=term --cov-fail-under=95 tests

notebooks: $(STAMP) ## Execute the notebooks in place, so that their stored outputs are fresh
	$(BIN)/python tools/run_notebooks.py --jobs $(JOBS) $(NOTEBOOKS)

record: $(STAMP) ## Check every claim anew and put the evidence on record, in minutes
	$(BIN)/python tools/record_claims.py

lint: $(STAMP) ## Check style, format and types
	@status=0; set -x; \
	$(BIN)/python -m ruff check || status=1; \
	$(BIN)/python -m ruff format --check || status=1; \
	$(BIN)/python -m mypy || status=1; \
	exit $$status

format: $(STAMP) ## Mend style and format where that can be done by machine
	$(BIN)/python -m ruff check --fix
	$(BIN)/python -m ruff format

bench: $(PEERS)/.installed ## Measure speed and accuracy beside other libraries, and renew the book's page on it
	$(PEERS)/bin/python -m benchmarks.run
	$(PEERS)/bin/python -m benchmarks.road $(D2D_RADARSCENES) $(D2D_NUSCENES)

# A library that cannot be installed does not stop the others; the benchmark reports that it is missing.
$(PEERS)/.installed: requirements.txt pyproject.toml
	@$(MAKE) --no-print-directory $(STAMP)
	$(BIN)/python -m venv --clear $(PEERS)
	@echo '*' > $(PEERS)/.gitignore
	@grep '^[^#]*==' requirements.txt > $(PEERS)/constraints.txt
	@for package in '-e .[study,radarscenes]' $$(sed -nE 's/^bench = \[(.*)\]/\1/p' pyproject.toml | tr -d '",'); do \
	  echo "Installing $$package"; \
	  $(PEERS)/bin/python -m pip install --quiet --disable-pip-version-check \
	    --constraint $(PEERS)/constraints.txt $$package || echo "$$package is left out" >&2; \
	done
	@touch $@

sweep: $(STAMP) ## Recompute chapters/results/exhaustive.csv: over a million registrations, in minutes
	$(BIN)/python -m d2d.study.beyond --jobs $(JOBS)

lab: $(STAMP) ## Open the notebooks in JupyterLab
	$(BIN)/python -m jupyterlab chapters

radarscenes: $(STAMP) ## Recompute chapters/results from the data set: D2D_RADARSCENES=<root>
	@if [ -z "$$D2D_RADARSCENES" ]; then \
	  echo "Say where the RadarScenes data set is: make radarscenes D2D_RADARSCENES=/path/to/RadarScenes" >&2; exit 2; \
	fi; \
	if [ ! -d "$$D2D_RADARSCENES" ]; then \
	  echo "D2D_RADARSCENES is not a folder: $$D2D_RADARSCENES" >&2; exit 2; \
	fi
	$(BIN)/python -m d2d.study.road estimates "$$D2D_RADARSCENES"
	$(BIN)/python -m d2d.study.road scores "$$D2D_RADARSCENES"

nuscenes: $(STAMP) ## Recompute chapters/results from the data set: D2D_NUSCENES=<root>
	@if [ ! -d "$$D2D_NUSCENES" ]; then \
	  echo "Say where the nuScenes data set is: make nuscenes D2D_NUSCENES=/path/to/nuscenes" >&2; exit 2; \
	fi
	$(BIN)/python -m d2d.study.road scores "$$D2D_NUSCENES"

clean: ## Remove what was built, but keep .venv
	rm -rf _build build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage htmlcov
	find . -path ./$(VENV) -prune -o -path ./.git -prune -o \
	  \( -name __pycache__ -o -name .ipynb_checkpoints \) -type d -exec rm -rf {} +

distclean: clean ## Remove the environments as well
	rm -rf $(VENV) $(PEERS) $(LOWEST)
