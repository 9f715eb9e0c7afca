# Everything sets itself up: a virtual environment in .venv from requirements.lock, once; what only developers need
# (requirements-dev.lock, large) comes with the first test or lint. When nothing has changed since, no network is
# used and a target starts at once.
#
#   make demo [MATERIAL=pellet] [SCALE=1.7] [BUDGET=16] [SEED=1] calibrate a material, live in the terminal
#   make charge [MATERIAL=coke] [SCALE=4] [SEED=1] [OUT=charge]  charge the hopper through the service, with a report
#   make serve                                                   start the service and stay
#   make compare-workers [BUDGET=6]                              two workers of one thread against one of two
#   make faults [SCHEDULES=200] [SEED=1] [BACKEND=sqlite]        random schedules of faults on real jobs
#   make outages                                                 60 s without broker, 10 s without database
#   make load [FOR=60]                                            50 requests/s beside two busy workers
#   make fuzz [FOR=300] [SEED=1]                                  every check of schemathesis on the whole API
#   make secure                                                  risky calls, secrets, known holes
#   make test | slow | lint                                      the tests, the long tests, the linters
#   make test-browser                                            the pages in Debian's chromium
#   make pictures [DATA="folder ..."] [URL=...] [KEEP=folder]    docs/pictures, of real runs (makes some, or of DATA)
#   make setup | dev                                             only the environment: to run, to develop
#   make lock                                                    bring both lock files up to date
#   make clean                                                   remove .venv and caches (not var/, the data)

SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help

BIN := .venv/bin
# The first of these that is 3.11 or newer builds the environment; `make PYTHON=/path/to/python3` chooses another.
PYTHON ?=
PYTHONS := $(PYTHON) python3.11 python3.12 python3.13 python3
# A stamp's name says what the environment was built from and where: another lock file, or the folder moved, is
# another stamp.
key = $(shell { cat $(1) pyproject.toml .ci/set-up; pwd -P; } | git hash-object --stdin)
READY := .venv/ready-$(call key,requirements.lock)
DEV := .venv/dev-$(call key,requirements.lock requirements-dev.lock)

MATERIAL ?= pellet
SCALE ?=
BUDGET ?=
SEED ?=
OUT ?=
DATA ?=
URL ?=
KEEP ?=
TESTS ?=

.PHONY: help setup dev demo charge compare-workers serve test test-browser slow faults outages load fuzz secure lint lock clean

help:
	@sed -n 's/^#  *make/make/p' Makefile

$(READY):
	@PYTHONS="$(PYTHONS)" bash .ci/set-up "$(READY)" requirements.lock

$(DEV): $(READY)
	@PYTHONS="$(PYTHONS)" bash .ci/set-up "$(DEV)" requirements-dev.lock

setup: $(READY)

dev: $(DEV)

demo: $(READY)
	@$(BIN)/talus demo --material "$(MATERIAL)" \
	  $(if $(SCALE),--scale "$(SCALE)") $(if $(BUDGET),--budget "$(BUDGET)") $(if $(SEED),--seed "$(SEED)")

# coke unless MATERIAL was given: the default above is the demo's.
charge: $(READY)
	@$(BIN)/talus charge "$(if $(filter file,$(origin MATERIAL)),coke,$(MATERIAL))" --scale "$(or $(SCALE),4)" \
	  $(if $(SEED),--seed "$(SEED)") --out "$(or $(OUT),charge)"

compare-workers: $(READY)
	@$(BIN)/python -m service.client.worker_comparison $(if $(BUDGET),--budget "$(BUDGET)") \
	  $(if $(SCALE),--scale "$(SCALE)") $(if $(SEED),--seed "$(SEED)")

serve: $(READY)
	@exec $(BIN)/talus serve

# Some machines set it for all. Every process that starts would then compile its packages' sources anew: 5.9 s of
# processor time instead of 2.3 for the API's imports, 9.8 instead of 3.8 for a worker's (two busy cores).
unexport PYTHONDONTWRITEBYTECODE

# One thread of linear algebra for each process: its matrices are small, and a second thread only waits (the tests
# of the diagnosis took 3.7 times the processor time).
test test-browser slow: export OPENBLAS_NUM_THREADS := 1
# Tests wait for workers, and share the cores with each other.
test test-browser slow: export TALUS_WORKER_NICENESS := 0

test: $(DEV)
	@$(BIN)/python -m pytest -m "not slow and not browser" --numprocesses auto --maxprocesses 4 --dist loadfile $(TESTS)

test-browser: $(DEV)
	@$(BIN)/python -m pytest -m browser --numprocesses 0 tests/browser $(TESTS)

pictures: $(DEV)
	@$(BIN)/python -m tests.browser.take_pictures $(if $(DATA),--data $(DATA)) $(if $(URL),--url "$(URL)") \
	  $(if $(KEEP),--keep "$(KEEP)")

slow: $(DEV)
	@$(BIN)/python -m pytest -m "slow or browser" $(TESTS)

faults: $(DEV)
	@$(BIN)/python -m tests.faults --schedules "$(or $(SCHEDULES),200)" --seed "$(or $(SEED),1)" \
	  $(if $(BACKEND),--backend "$(BACKEND)") $(if $(LEASE),--lease "$(LEASE)") $(if $(WINDOW),--window "$(WINDOW)")

outages: $(DEV)
	@$(BIN)/python -m tests.faults.outages

load: $(DEV)
	@$(BIN)/python -m tests.load --seconds "$(or $(FOR),60)"

fuzz: $(DEV)
	@$(BIN)/python -m tests.fuzz --seconds "$(or $(FOR),300)" $(if $(SEED),--seed "$(SEED)")

secure: $(DEV)
	@$(BIN)/python -m tests.secure

lint: $(DEV)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports

# No header, no notes and no index: the files name packages, versions and hashes, and no address. The larger set is
# solved first and the smaller one from it, so that both name the same releases.
COMPILE = $(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --generate-hashes --no-header \
  --no-annotate --no-emit-index-url --no-emit-find-links pyproject.toml --group build

lock: $(READY)
	@$(COMPILE) --group dev --output-file requirements-dev.lock
	@$(COMPILE) --constraint requirements-dev.lock --output-file requirements.lock
	@! grep -n '://' requirements.lock requirements-dev.lock

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
