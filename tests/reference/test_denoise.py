"""The denoiser brings noisy maps nearer to converged ones, and leaves alone what is not noise."""

import sys

import numpy as np
import pytest

from sixway.core.color import encode_srgb
from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium, SixWayLightmap
from sixway.reference.denoise import denoise
from sixway.reference.lightmaps import trace_lightmaps

SMOKE = Medium(extinction_per_m=8.0)


def of_constants(values: tuple[float, ...], alpha: float) -> SixWayLightmap:
    constants = np.array([*values, alpha, 0.3], np.float32)
    return SixWayLightmap(channels=LIGHTMAP_CHANNELS, image=np.tile(constants, (64, 80, 1)))


class TestWithTheLibrary:
    @pytest.fixture(autouse=True)
    def _oidn(self) -> None:
        pytest.importorskip("mitsuba_oidn")

    @pytest.mark.parametrize("quality", ["fast", "high"])
    def test_noisy_maps_come_nearer_to_converged_ones(self, blob_frame: DensityFrame, quality) -> None:
        """Every one of the six, so no map was put in another's place; and by more than half of its error."""
        camera = Camera.around(blob_frame.grid, yaw_deg=40.0, pitch_deg=10.0, width_px=64, height_px=64)
        converged = trace_lightmaps(blob_frame, camera, SMOKE, samples=32)
        noisy = trace_lightmaps(blob_frame, camera, SMOKE, samples=16, method="path", seed=1)
        filtered = denoise(noisy, quality=quality)

        def error(lightmap: SixWayLightmap) -> np.ndarray:
            scale = np.float32(1.0 / converged.maps.max())
            return ((encode_srgb(lightmap.maps * scale) - encode_srgb(converged.maps * scale)) ** 2).mean((0, 1))

        assert (error(filtered) < 0.5 * error(noisy)).all()

    def test_light_is_kept(self, blob_frame: DensityFrame) -> None:
        camera = Camera.around(blob_frame.grid, yaw_deg=40.0, width_px=64, height_px=64)
        noisy = trace_lightmaps(blob_frame, camera, SMOKE, samples=16, method="path", seed=1)
        np.testing.assert_allclose(denoise(noisy).maps.mean((0, 1)), noisy.maps.mean((0, 1)), rtol=0.02)

    def test_constants_stay(self) -> None:
        """Away from the border, where the filter knows too little; also far above white."""
        values = (0.02, 0.1, 0.5, 1.0, 4.0, 20.0)
        filtered = denoise(of_constants(values, 0.8)).maps[16:-16, 16:-16]
        means = filtered.mean((0, 1))
        np.testing.assert_allclose(means, values, rtol=0.02)
        np.testing.assert_allclose(filtered / means, 1.0, atol=0.02)

    def test_black_stays_black(self) -> None:
        assert denoise(of_constants((0.0,) * 6, 0.0)).maps.max() < 1e-4

    def test_alpha_and_emissive_stay_and_the_argument_too(self) -> None:
        rng = np.random.default_rng(0)
        lightmap = SixWayLightmap(channels=LIGHTMAP_CHANNELS, image=rng.random((32, 32, 8), np.float32))
        before = lightmap.image.copy()
        filtered = denoise(lightmap)
        for channel in ("alpha", "emissive"):
            np.testing.assert_array_equal(filtered[channel], lightmap[channel])
        np.testing.assert_array_equal(lightmap.image, before)
        assert filtered.maps.std() < 0.5 * lightmap.maps.std()


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mitsuba_oidn", None)
    with pytest.raises(ModuleNotFoundError, match=r"sixway\[denoise\]"):
        denoise(of_constants((0.5,) * 6, 0.5))
