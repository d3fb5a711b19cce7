# Two commands: `make demo` runs the whole pipeline, `make test` all tests. Both set up .venv first.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

# Volumes that are not part of the repository: tests and demo use them where the folder exists.
REAL_VOLUMES := $(realpath ../shared/data)
export SIXWAY_REAL_VOLUMES ?= $(REAL_VOLUMES)

.PHONY: demo test check clean

$(READY): pyproject.toml constraints/ci.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -q -c constraints/ci.txt -e ".[dev]"
	touch $(READY)

demo: $(READY)
	$(BIN)/python -m sixway.demo --out demo

test: $(READY)
	$(BIN)/python -m pytest

check: $(READY)
	PATH="$(abspath $(BIN)):$$PATH" bash scripts/check.sh

clean:
	rm -rf $(VENV) demo
