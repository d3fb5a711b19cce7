"""Scalars that the air carries: smoke, heat and fuel, semi-Lagrangian; what they do to the air, and how they burn."""
