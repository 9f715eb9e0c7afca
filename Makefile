# Everything sets itself up: a virtual environment in .venv from requirements.lock, once. When nothing has
# changed since, no network is used and a target starts at once.
#
#   make demo [MATERIAL=pellet] [SCALE=1.7] [BUDGET=16] [SEED=1] calibrate a material, live in the terminal
#   make serve                                                   start the service and stay
#   make test | slow | lint                                      the tests, the long tests, the linters
#   make lock                                                    bring requirements.lock up to date
#   make clean                                                   remove .venv and caches (not var/, the data)

SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help

BIN := .venv/bin
# The first of these that is 3.11 or newer builds the environment; `make PYTHON=/path/to/python3` chooses another.
PYTHON ?=
PYTHONS := $(PYTHON) python3.11 python3.12 python3.13 python3
# The stamp's name says what the environment was built from and where: another lock file, or the folder
# moved, is another stamp.
KEY := $(shell { cat requirements.lock pyproject.toml .ci/set-up; pwd -P; } | git hash-object --stdin)
STAMP := .venv/ready-$(KEY)

MATERIAL ?= pellet
SCALE ?=
BUDGET ?=
SEED ?=
TESTS ?=

.PHONY: help setup demo serve test slow lint lock clean

help:
	@sed -n 's/^#  *make/make/p' Makefile

$(STAMP):
	@PYTHONS="$(PYTHONS)" bash .ci/set-up "$(STAMP)"

setup: $(STAMP)

demo: $(STAMP)
	@$(BIN)/talus demo --material "$(MATERIAL)" \
	  $(if $(SCALE),--scale "$(SCALE)") $(if $(BUDGET),--budget "$(BUDGET)") $(if $(SEED),--seed "$(SEED)")

serve: $(STAMP)
	@exec $(BIN)/talus serve

test: $(STAMP)
	@$(BIN)/python -m pytest -m "not slow and not browser" $(TESTS)

slow: $(STAMP)
	@$(BIN)/python -m pytest -m "slow or browser" $(TESTS)

lint: $(STAMP)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports

# No header, no notes and no index: the file names packages, versions and hashes, and no address.
lock: $(STAMP)
	@$(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --generate-hashes --no-header \
	  --no-annotate --no-emit-index-url --no-emit-find-links --group dev pyproject.toml --output-file requirements.lock
	@! grep -n '://' requirements.lock

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
