"""From smoke to lightmaps with no path tracing: march the guide that the net was trained on, then ask it."""

import os

import numpy as np
from jaxtyping import Float

from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium, SixWayLightmap
from sixway.guide.config import stored_guide
from sixway.guide.march import GuideMarcher
from sixway.inference.predict import Predictor, predict


class LightmapBaker:
    """Predicts lightmaps for frame after frame of one kind of smoke.

    extinction_per_m: how dense the smoke is to be; albedo and anisotropy are those of the training. medium: all three.
    scale: factor that brings map values to about 1, as nets answer and textures hold them.
    Raises ConfigError if the net's guide cannot be marched by this version, ValueError if its card is incomplete.
    """

    def __init__(self, predictor: Predictor, *, extinction_per_m: float, device: str) -> None:
        card = predictor.card
        config = stored_guide(card.guide, source="the net's guide")
        missing = {"albedo", "hg_g"} - card.medium.keys()
        if missing:
            raise ValueError(f"the net's card does not tell the medium's {sorted(missing)}; export or train it again")
        self.medium = Medium(extinction_per_m=extinction_per_m, albedo=card.medium["albedo"], hg_g=card.medium["hg_g"])
        self.scale = card.scale
        self._predictor = predictor
        self._marcher = GuideMarcher(config, self.medium, device=device, threads=os.cpu_count() or 1)

    def bake(self, frame: DensityFrame, camera: Camera, *, seed: int) -> SixWayLightmap:
        """Six maps and alpha of one frame as `camera` sees it, linear, M = pi L / E."""
        return self.bake_with_depth(frame, camera, seed=seed)[0]

    def bake_with_depth(
        self, frame: DensityFrame, camera: Camera, *, seed: int
    ) -> tuple[SixWayLightmap, Float[np.ndarray, "h w"]]:
        """The lightmap, and the guide's metres along each ray to the first smoke, infinite where there is none."""
        guide = self._marcher.march(frame, camera, seed=seed)
        return predict(self._predictor, guide), guide.depth_m
