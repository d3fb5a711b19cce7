#!/usr/bin/env bash
# For a machine with CUDA, under 10 minutes: tests on the device, CPU = CUDA, stage timers at 512 x 512.
# Without CUDA it runs the timers once at a small size on the CPU, says what was skipped, and ends well.
set -euo pipefail
cd "$(dirname "$0")/.."
python=${PYTHON:-python}
if "$python" -c 'import sys, torch; sys.exit(0 if torch.cuda.is_available() else 1)'; then
  "$python" -m pytest --device cuda tests/guide tests/sim tests/models tests/losses
  "$python" scripts/validate_devices.py
  "$python" scripts/bench_pipeline.py --device cuda --size 512
  "$python" scripts/bench_sim.py --device cuda --quick
else
  "$python" scripts/validate_devices.py
  "$python" scripts/bench_pipeline.py --device cpu --quick
  "$python" scripts/bench_sim.py --device cpu --quick
  echo "skipped: tests on the device and timers at 512 x 512 need CUDA"
fi
