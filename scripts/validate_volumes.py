"""A trained net on volumes unlike its training data, against the path-traced truth of the same views.

python scripts/validate_volumes.py runs/cpu FOLDER --out volumes --json volumes.json

A solid rabbit and a solid torus, and from FOLDER: a cloud, the smoke of Mitsuba's tutorial and a Mantaflow fire.
Density is scaled as `sixway.bake` does. These volumes are held out: nothing may be tuned to them. A row is missed
where the net is worse than its guide's own maps. The sheets show the worst view of each volume, not the best.
"""

import os
import statistics
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp
from measurement import Measurement, parser

from sixway.core.color import encode_srgb
from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, GuideMap, Medium, SixWayLightmap
from sixway.evaluation.pictures import contact_sheet
from sixway.guide.config import stored_guide
from sixway.guide.march import GuideMarcher
from sixway.inference.predict import OnnxPredictor, Predictor, load_predictor, predict
from sixway.metrics.psnr import psnr
from sixway.models.card import NetCard
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.sim.bodies.distance_field import distance_field
from sixway.sim.bodies.meshes import read_surface
from sixway.volumes.extinction import extinction_for_optical_depth
from sixway.volumes.read import Up
from sixway.volumes.sequence import open_sequence

BUNNY = Path(__file__).parents[1] / "configs/sim/meshes/bunny.ply"
FILES: dict[str, tuple[str, Up]] = {
    "teapot cloud": ("shadeops_teapot_cloud.nvdb", "y"),
    "Mitsuba tutorial": ("mitsuba_tutorial_volume.vol", "z"),
    "Mantaflow fire": ("mantaflow_fire/fluid_data_*.vdb", "z"),
}
"""Files below the folder, and the axis that points up in them."""

SHADOWED = 0.02
"""Foreground: where the true alpha exceeds this."""


@dataclass(frozen=True)
class Volume:
    """Frames of one kind of smoke and the extinction that all of them share."""

    name: str
    frames: tuple[DensityFrame, ...]
    extinction_per_m: float

    @classmethod
    def solid(cls, name: str, distance: np.ndarray) -> "Volume":
        """Density 1 inside, with an edge of one voxel. distance: signed, in voxels, negative inside."""
        density = np.clip(0.5 - distance, 0.0, 1.0).astype(np.float32)
        frame = DensityFrame(density=density, grid=Grid.centred(density.shape))
        return cls(name, (frame,), extinction_for_optical_depth(frame))


@dataclass(frozen=True)
class View:
    """One view by net, guide and reference. sRGB of the six maps times the net's scale, [h, w, 6]."""

    title: str
    guide: GuideMap
    predicted: SixWayLightmap
    truth: SixWayLightmap
    card: NetCard

    def net_db(self, *, foreground: bool = False) -> float:
        mask = self.truth["alpha"] > SHADOWED if foreground else None
        return psnr(predicted=self.maps(self.predicted), reference=self.maps(self.truth), mask=mask)

    def guide_db(self) -> float:
        return psnr(predicted=self.maps(self.guide), reference=self.maps(self.truth))

    def emissive_db(self, shown: SixWayLightmap | GuideMap) -> float:
        return psnr(predicted=self.emissive(shown), reference=self.emissive(self.truth))

    def maps(self, shown: SixWayLightmap | GuideMap) -> np.ndarray:
        return srgb(np.stack([shown[name] for name in DIRECTIONS], axis=-1), self.card.scale)

    def emissive(self, shown: SixWayLightmap | GuideMap) -> np.ndarray:
        return srgb(shown["emissive"][..., None], self.card.emissive_scale or self.card.scale)

    def encoded(self, shown: SixWayLightmap) -> np.ndarray:
        """As the net answers, [8, h, w]; no emissive is 0."""
        layers = [self.maps(shown), shown["alpha"][..., None]]
        layers.append(self.emissive(shown) if "emissive" in shown.channels else np.zeros_like(layers[1]))
        return np.ascontiguousarray(np.moveaxis(np.concatenate(layers, axis=-1), -1, 0))

    def write_sheet(self, path: Path) -> None:
        contact_sheet(
            path,
            guide=np.ascontiguousarray(np.moveaxis(self.guide.image, -1, 0)),
            guide_channels=self.guide.channels,
            scale=self.card.scale,
            emissive_scale=self.card.emissive_scale,
            predicted=self.encoded(self.predicted),
            truth=self.encoded(self.truth),
            has_emissive="emissive" in self.truth.channels and self.card.has_emissive,
        )


def main() -> int:
    options = parser((__doc__ or "").splitlines()[0])
    options.add_argument("net", type=Path, help="run folder, or an .onnx file (its own size)")
    options.add_argument("folder", type=Path, nargs="?", help="folder with the volumes (default: the solid ones alone)")
    options.add_argument("--out", type=Path, help="write contact sheets into this folder")
    chosen = options.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    samples, yaws = (2, (30.0,)) if chosen.quick else (16, (0.0, 35.0, 110.0))
    predictor = load_predictor(chosen.net, device="cpu")
    sizes = (
        (predictor.card.width_px,) if isinstance(predictor, OnnxPredictor) else (64,) if chosen.quick else (128, 256)
    )
    about = {"net": str(chosen.net), "sizes_px": sizes, "yaws_deg": yaws, "samples": samples, "bounces": "paper"}
    result = Measurement(about, repetitions=1)
    for volume in volumes(chosen.folder, quick=chosen.quick):
        for size in sizes:
            views = validate(result, predictor, volume, size, samples=samples, yaws=yaws)
            if chosen.out:
                worst = min(views, key=View.net_db)
                file = chosen.out / f"{volume.name.lower().replace(' ', '_')}_{size}.png"
                worst.write_sheet(file)
                print(f"{file}: {worst.title}, net {worst.net_db():.1f} dB")
    return result.finish(chosen.json)


def volumes(folder: Path | None, *, quick: bool) -> Iterator[Volume]:
    resolution = 48 if quick else 96
    field = distance_field(read_surface(BUNNY), resolution)
    yield Volume.solid("solid rabbit", field.values / field.spacing)
    yield Volume.solid("solid torus", torus(resolution))
    for name, (pattern, up) in FILES.items() if folder else ():
        paths = sorted(folder.glob(pattern))
        if not paths:
            print(f"{folder / pattern}: not there, left out")
            continue
        sequence = open_sequence(paths[len(paths) // 2 :][:1] if quick else paths, up=up)
        frames = tuple(sequence.read(number) for number in range(len(sequence.paths)))
        yield Volume(name, frames, sequence.extinction_per_m)


def torus(resolution: int) -> np.ndarray:
    """Distance [voxels] to a torus that leans towards a corner, its ring 0.3 and its tube 0.12 of the box."""
    centres = (np.arange(resolution) + 0.5) / resolution - 0.5
    points = np.stack(np.meshgrid(centres, centres, centres, indexing="ij"), axis=-1)
    axis = np.array([2.0, 2.0, 1.0]) / 3.0
    along = points @ axis
    across = np.sqrt(np.maximum((points**2).sum(-1) - along**2, 0.0))
    return (np.hypot(across - 0.3, along) - 0.12) * resolution


def validate(
    result: Measurement, predictor: Predictor, volume: Volume, size: int, *, samples: int, yaws: tuple[float, ...]
) -> list[View]:
    """All frames of a volume from every yaw; rows of their scores."""
    card = predictor.card
    medium = Medium(extinction_per_m=volume.extinction_per_m, albedo=card.medium["albedo"], hg_g=card.medium["hg_g"])
    config = stored_guide(card.guide, source="the net's guide")
    marcher = GuideMarcher(config, medium, device="cpu", threads=os.cpu_count() or 1)
    tracer = LightmapTracer(ReferenceConfig(samples=samples), medium, device="cpu")
    views: list[View] = []
    baked: list[float] = []
    for number, frame in enumerate(volume.frames):
        cameras = [Camera.around(frame.grid, yaw_deg=yaw, margin=0.8, width_px=size, height_px=size) for yaw in yaws]
        truths = tracer.trace_views(frame, cameras, seeds=range(len(cameras)))
        for yaw, camera, truth in zip(yaws, cameras, truths, strict=True):
            start = time.perf_counter()
            guide = marcher.march(frame, camera, seed=0)
            predicted = predict(predictor, guide)
            baked.append(time.perf_counter() - start)
            views.append(View(f"frame {number}, yaw {yaw:g}", guide, predicted, truth, card))
    again = tracer.trace(volume.frames[0], cameras[0], seed=1000)
    report(result, f"{volume.name}, {size}^2", views, again)
    result.add(f"{volume.name}, {size}^2: guide and net", 1e3 * statistics.median(baked), "ms")
    return views


def report(result: Measurement, label: str, views: list[View], again: SixWayLightmap) -> None:
    """Means of the views' PSNR of the six maps in sRGB, full frame. again: the first view's truth, another seed."""
    nets, guides = [view.net_db() for view in views], None
    if set(DIRECTIONS) <= set(views[0].guide.channels):
        guides = [view.guide_db() for view in views]
        result.add(f"{label}: guide as it is", statistics.mean(guides), "dB")
    floor = statistics.mean(guides) if guides else None
    result.add(f"{label}: net, {len(views)} views", statistics.mean(nets), "dB", at_least=floor)
    result.add(f"{label}: net, worst view", min(nets), "dB")
    if guides:
        least = min(net - guide for net, guide in zip(nets, guides, strict=True))
        result.add(f"{label}: least that the net adds to a view", least, "dB")
    result.add(f"{label}: net, foreground alone", statistics.mean(view.net_db(foreground=True) for view in views), "dB")
    burning = [view for view in views if "emissive" in view.truth.channels and view.truth["emissive"].any()]
    if burning and views[0].card.has_emissive:
        if "emissive" in views[0].guide.channels:
            shown = statistics.mean(view.emissive_db(view.guide) for view in burning)
            result.add(f"{label}: guide as it is, emissive", shown, "dB")
        predicted = statistics.mean(view.emissive_db(view.predicted) for view in burning)
        result.add(f"{label}: net, emissive", predicted, "dB")
    first = views[0]
    ceiling = psnr(predicted=first.maps(again), reference=first.maps(first.truth)) + 3.01
    result.add(f"{label}: ceiling, of the truth's noise", ceiling, "dB")


def srgb(light: np.ndarray, scale: float) -> np.ndarray:
    return encode_srgb(np.maximum(light, 0.0) * np.float32(scale)).astype(np.float32)


if __name__ == "__main__":
    sys.exit(main())
