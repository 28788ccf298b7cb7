# Every target sets up what it needs: a .venv in this folder, built from requirements.lock, with mannbv installed editable.
# Without make: see environment.md.

# any Python from 3.11 on
PYTHON ?= python3
# make run: the scene, where its results go; make run, lab, notebooks: any further options
SCENE ?= flat
OUT ?= out/compare
ARGS ?=
# make test: how many test files, and then notebooks, run side by side
WORKERS ?= 2

VENV := .venv
PY := $(VENV)/bin/python
READY := $(VENV)/.ready
REPORTS := out/tests
# Several workers share the cores, so each keeps to one thread.
PYTEST := OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(PY) -m pytest -n $(WORKERS) --dist loadfile -ra
# JupyterLab refuses to start as root, the usual user of a container, unless told so.
AS_ROOT := $(if $(filter 0,$(shell id -u)),--allow-root)

.DEFAULT_GOAL := help
.PHONY: help setup run test test-generic exercises lab explore notebooks lint lock clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(READY) ## the environment alone (every other target sees to it by itself)

run: $(READY) ## the main job: five robots, four strategies, one plan -> tables, a figure, out/compare/results.json
	$(strip $(PY) -m mannbv compare $(SCENE) --out $(OUT) $(ARGS))

test: $(READY) ## pytest, every notebook under strict nbval, then the reader's copies, which must run
	@rm -rf $(REPORTS) && mkdir -p $(REPORTS)
	$(PYTEST) tests --junitxml=$(REPORTS)/pytest.xml
	@ls notebooks/*.ipynb >/dev/null 2>&1 || { echo "notebooks/ holds no notebook: nothing would be checked" >&2; exit 1; }
	$(PYTEST) -c tools/nbval.ini --rootdir=. notebooks --junitxml=$(REPORTS)/notebooks.xml
	$(PY) tools/course.py $(REPORTS)/course
	$(PYTEST) -c tools/course.ini --rootdir=. $(REPORTS)/course --junitxml=$(REPORTS)/course.xml

test-generic: $(READY) ## the notebooks of both editions, compiled for a processor without extras
	NUMBA_CPU_NAME=generic $(PYTEST) -c tools/nbval.ini --rootdir=. notebooks --junitxml=$(REPORTS)/generic.xml
	$(PY) tools/course.py $(REPORTS)/course
	NUMBA_CPU_NAME=generic $(PYTEST) -c tools/course.ini --rootdir=. $(REPORTS)/course --junitxml=$(REPORTS)/generic-course.xml

exercises: $(READY) ## the reader's copies of the notebooks, exercises empty, into course/; what you changed there stays
	$(PY) tools/course.py

lab: exercises ## JupyterLab on the reader's copies in course/
	$(strip $(PY) -m jupyterlab course $(AS_ROOT) $(ARGS))

explore: $(READY) ## all explorers on one page without code, under Voilà
	$(strip $(PY) -m voila notebooks/explore.ipynb $(ARGS))

notebooks: $(READY) ## run every notebook and store its outputs, byte for byte the same each time
	$(strip $(PY) tools/notebooks.py $(ARGS))

lint: $(READY) ## ruff over code and notebooks, pyright over the package
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m basedpyright --pythonpath $(PY)

lock: $(READY) ## rewrite requirements.lock from what .venv holds
	$(PY) tools/lock.py

clean: ## remove caches, builds, test reports and out/compare; other results and .venv stay
	rm -rf $(REPORTS) out/compare build dist .pytest_cache .ruff_cache .hypothesis .coverage*
	find . -name .venv -prune -o \( -name __pycache__ -o -name .ipynb_checkpoints \) -type d -exec rm -rf {} +

# The stamp is touched last, so an interrupted set-up starts again; pip keeps what is already right.
# Matplotlib builds its font cache here: later, its notice of doing so would land in a notebook's output.
$(READY): pyproject.toml requirements.lock
	@$(PY) -m pip --version >/dev/null 2>&1 || { \
	  command -v $(PYTHON) >/dev/null || { echo "mannbv needs Python 3.11 or newer, and there is no $(PYTHON): install one, or name it: make PYTHON=/path/to/python3" >&2; exit 1; }; \
	  $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "mannbv needs Python 3.11 or newer, and $(PYTHON) is older: name a newer one: make PYTHON=/path/to/python3.12" >&2; exit 1; }; \
	  $(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "$(PYTHON) lacks the venv module: install it (Debian, Ubuntu: apt install python3-venv), or name another Python: make PYTHON=/path/to/python3" >&2; exit 1; }; \
	  $(PYTHON) -m venv --clear $(VENV); }
	@echo "Installing requirements.lock into $(VENV): from nothing a minute or more, and 2 GB"
	$(PY) -m pip install --quiet -r requirements.lock
	$(PY) -m pip install --quiet --no-deps --no-build-isolation -e .
	@$(PY) -c 'import matplotlib.font_manager'
	@touch $@
