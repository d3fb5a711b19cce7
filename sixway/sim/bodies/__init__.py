"""Solid bodies by their signed distances: shapes, rigid motion, meshes, and the cells that they fill."""
