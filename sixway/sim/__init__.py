"""Smoke: a lattice-Boltzmann wind on a coarse grid carries density on a finer one."""
