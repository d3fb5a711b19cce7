"""The air: a lattice-Boltzmann flow with ghost cells, bounce-back walls, inlets and open sides."""
