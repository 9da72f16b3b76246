# Every target does its own set-up: Python 3.11 or later with pip, and make, are enough.
# PYTHON=/path/to/python chooses another Python; VENV=folder another place for the packages.
SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

VENV ?= .venv
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11 python; do \
	"$$p" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo "$$p" && break; \
	done)
BIN := $(VENV)/bin
READY := $(VENV)/.ready
PYTEST := $(BIN)/python -m pytest
# Tests run on all cores.  Most of the time of the fast ones and of derivatives is compilation: it
# is done without optimisation, by XLA's quicker emitters, and kept for the next run.  Threads of
# OpenBLAS would only wait for each other.  With 64-bit types on the other slow tests compile as
# users do.
DERIVATIVES := tests/fairing/test_derivatives.py tests/fairing/local_fairing/test_programs.py
SPREAD := --numprocesses auto --dist worksteal
FAST := $(PYTEST) -m "not slow and not data" $(SPREAD)
# Annotations are checked by the fast tests; the slow ones run as users do.
SLOW := CONTOURFAIR_CHECKED=0 $(PYTEST) -m "slow or data" $(SPREAD)
CHEAP := --xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false
QUICK := OPENBLAS_NUM_THREADS=1 XLA_FLAGS="$${XLA_FLAGS:-} $(CHEAP)" \
	JAX_COMPILATION_CACHE_DIR=$(abspath $(VENV))/compiled \
	JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS=0.1

# Mutants of each package (0 for all), what chooses them, and packages (all if none).
MUTANTS ?= 25
SEED ?= 0
OF ?=
GROUP = import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["dependency-groups"]["mutants"])

.PHONY: help setup demo test test-all test-slow mutants lint types format bench tables figures lock \
	clean

help: ## This list.
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 12

setup: $(READY) ## Make the environment and install the locked packages.

$(READY): requirements.lock pyproject.toml
	@if [ -z "$(PYTHON)" ]; then \
		echo "Python 3.11 or later is needed and was not found; try make PYTHON=/path/to/python" >&2; \
		exit 1; fi
	@if ! $(BIN)/python -m pip --version >/dev/null 2>&1; then \
		echo "making $(VENV) with $$($(PYTHON) --version)"; $(PYTHON) -m venv $(VENV); fi
	@echo "installing the locked packages (minutes the first time)"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes \
		-r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps \
		--no-build-isolation --editable .
	@touch $@

demo: $(READY) ## Fair the bundled terrain: table, picture, finer samples, contours in demo/.
	$(BIN)/python -m contourfair_jax.demo

test: $(READY) ## The fast tests, with 64-bit types on, then those that must also pass with them off.
	$(QUICK) JAX_ENABLE_X64=1 $(FAST)
	$(QUICK) JAX_ENABLE_X64=0 $(FAST)

test-slow: $(READY) ## What `test` leaves out: slow tests, and tests on real data where it is there.
	$(QUICK) JAX_ENABLE_X64=1 $(SLOW) $(DERIVATIVES)
	OPENBLAS_NUM_THREADS=1 JAX_ENABLE_X64=1 $(SLOW) --durations=15 \
		$(DERIVATIVES:%=--ignore=%)
	$(QUICK) JAX_ENABLE_X64=0 $(SLOW)

test-all: test test-slow ## All tests.

mutants: $(READY) ## Draw MUTANTS=25 changes of the code per package, OF=contours of one; do tests see them?
	$(BIN)/python -c "import cosmic_ray" 2>/dev/null || $(BIN)/python -m pip install --quiet \
		--disable-pip-version-check $$($(BIN)/python -c '$(GROUP)')
	$(BIN)/python tests/mutation/run.py --mutants $(MUTANTS) --seed $(SEED) --rest $(OF)

lint: $(READY) ## Style.
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

format: $(READY) ## Put the code into the style that `lint` asks for.
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

types: $(READY) ## Static types.
	$(BIN)/pyright

bench: $(READY) ## Run every benchmark (long) and rewrite the tables of the documents.
	$(BIN)/python -m benchmarks all

tables: $(READY) ## Rewrite the tables of the documents from the stored results.
	$(BIN)/python -m benchmarks tables

figures: demo ## Redraw the stored pictures: those of the notebooks, and the demo's.
	for notebook in notebooks/*.py; do \
		CONTOURFAIR_FIGURES=notebooks/pictures $(BIN)/python "$$notebook"; done
	$(BIN)/python -c "from PIL import Image; Image.open('demo/comparison.png').convert('RGB') \
		.quantize(128).save('notebooks/pictures/demo.png', optimize=True)"

lock: $(READY) ## Renew the lock file from pyproject.toml.
	$(BIN)/uv pip compile pyproject.toml --all-extras --group dev --universal --upgrade \
		--generate-hashes --no-emit-index-url --custom-compile-command "make lock" \
		--quiet --output-file requirements.lock

clean: ## Remove the environment and all that was made.
	rm -rf $(VENV) demo .pytest_cache .ruff_cache .hypothesis build dist
