# make demo: set up everything and replay a simulated cut.   make test: set up everything and run the tests.
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
PYTHON ?= python3

.PHONY: demo test test-fast check bench paper recordings setup clean

demo: $(READY)
	$(BIN)/chatter-monitor replay replay_data/bar_turning.flac --config config/lathe.toml

test: $(READY)
	$(BIN)/python -m pytest

# What to run while developing: without the statistics over thousands of windows.
test-fast: $(READY)
	$(BIN)/python -m pytest -m "not slow and not system"

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(READY)
	$(BIN)/python -m benchmarks.tracker_speed
	$(BIN)/python -m benchmarks.tracker_accuracy
	$(BIN)/python -m benchmarks.simulator
	$(BIN)/python -m benchmarks.identification

# The figures of the paper with the numbers beside them, in docs/paper.
paper: $(READY)
	$(BIN)/python -m docs.paper

# The simulated recordings of replay_data, bit by bit the same.
recordings: $(READY)
	$(BIN)/python -m replay_data.make

setup: $(READY)

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "chatter-monitor needs Python 3.11 or newer"; exit 2; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { apt-get update -q && apt-get install -y -q python3-venv; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) out build *.egg-info
