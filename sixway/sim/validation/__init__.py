"""Textbook problems with known answers, run through the simulator: for `scripts/validate_sim.py` and the tests."""
