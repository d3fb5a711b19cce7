"""Axes, names and units that every room shares. Nothing else may restate them.

World: right-handed, y up, metres. Camera (billboard) frame: +x image right, +y image up,
+z TOWARDS the viewer. Volumes are ``[z, y, x]`` with x contiguous; images are ``[h, w, c]`` with
row 0 on top. Vectors are (x, y, z).
"""

from typing import Literal

DIRECTIONS = ("right", "left", "top", "bottom", "front", "back")
"""The six lights. A name says where the light COMES FROM, in the camera frame."""

TO_LIGHT: dict[str, tuple[float, float, float]] = {
    "right": (1.0, 0.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
    "top": (0.0, 1.0, 0.0),
    "bottom": (0.0, -1.0, 0.0),
    "front": (0.0, 0.0, 1.0),
    "back": (0.0, 0.0, -1.0),
}
"""Unit vector from the smoke towards each light, camera frame."""

OPPOSITE = {
    "right": "left",
    "left": "right",
    "top": "bottom",
    "bottom": "top",
    "front": "back",
    "back": "front",
}

LIGHTMAP_CHANNELS = (*DIRECTIONS, "alpha", "emissive")
"""Channels of a six-way lightmap, in the order in which the net and its files keep them.

The six maps hold M = pi * L / E: scattered radiance towards the camera, on black (so
alpha-premultiplied), for a directional light of irradiance E; a white Lambertian facing the light
reads 1. ``alpha`` = 1 - transmittance. ``emissive`` is the camera-visible emission integral.
"""

ADAPTER_PAIRS = (
    ("front", "back"),
    ("left", "right"),
    ("top", "bottom"),
    ("alpha", "emissive"),
)
"""Channels that share one adapter behind the decoder (seeds: neural six-way lightmaps, Fig. 3)."""

FLIP_HORIZONTAL = {"left": "right", "right": "left"}
FLIP_VERTICAL = {"top": "bottom", "bottom": "top"}
"""Channel that a mirrored image must be read from; names not listed stay where they are."""

Bounces = Literal["single", "paper", "multi"]
"""Indirect bounces of the reference: none, one (at most two scattering events), unlimited."""
