"""The lattice step as generated C++: `pieces` of text, kernels over rows of fluid (`air`) and ghost cells (`edges`)."""
