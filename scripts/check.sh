#!/usr/bin/env bash
# What CI checks beside the tests: lint, format, types, import layers. Run it with the virtual environment on PATH.
set -euo pipefail
cd "$(dirname "$0")/.."
ruff check .
ruff format --check .
mypy
lint-imports --no-logo
