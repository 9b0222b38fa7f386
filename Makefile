# The menu. Every target works on a fresh machine with Python >= 3.11.
PYTHON ?= python3
BIN := .venv/bin

RSL_RL := $(shell grep -o 'rsl-rl-lib[^"]*' pyproject.toml)

.PHONY: help quickstart install test oldest lint docs studies bench lock clean

help:
	@echo "make quickstart | test | oldest | lint | docs | studies | bench | lock | clean"

.venv/.uv:
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet "uv>=0.8,<1"
	@touch $@

# "compat" is a plain path, which also wins in the folder above a clone named transferkit.
.venv/.installed: .venv/.uv requirements.lock pyproject.toml
	VIRTUAL_ENV=.venv $(BIN)/uv pip install --quiet --compile-bytecode -r requirements.lock
	VIRTUAL_ENV=.venv $(BIN)/uv pip install --quiet --no-deps --config-setting editable_mode=compat -e .
	@touch $@

install: .venv/.installed

quickstart: install
	$(BIN)/transferkit quickstart

test: install
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow"

# PPO leans on rsl_rl's own update, so it is tested with the oldest that is allowed, too; the lock has the newest.
oldest: install
	$(BIN)/uv pip install --quiet --no-deps --resolution lowest --python $(BIN)/python --target .venv/oldest "$(RSL_RL)"
	PYTHONPATH=.venv/oldest $(BIN)/python -m pytest -n 2 -m "not slow" tests/trainers/ppo

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/pyright

docs: install
	$(BIN)/sphinx-build -W --keep-going -b html docs docs/_build/html

studies: install
	$(BIN)/python -m experiments.study --all --check

bench: install
	$(BIN)/python -m experiments.bench

lock:
	VIRTUAL_ENV=.venv $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
		--extra dev --no-emit-index-url --custom-compile-command "make lock" pyproject.toml -o requirements.lock

clean:
	rm -rf .venv build docs/_build runs
