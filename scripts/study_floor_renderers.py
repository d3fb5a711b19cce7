"""Why a net at all? What renderers reach in the time that guide and net take, with a denoiser and without.

python scripts/study_floor_renderers.py runs/cpu --json floors.json --chart floors.png

Time from a new frame of smoke in memory to its six maps and a picture under three lights, against PSNR of the six
maps in sRGB: `cached` from its usual setting to the coarsest, few paths of `path` and of Mitsuba's volpath, each with
and without OIDN (extra `denoise`, at its fast quality), the guide alone, and guide + net. All in turn in one run;
the truth is that of bench_inference.py.
"""

import os
import statistics
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp
from bench_inference import CACHED, NET, SCENARIO, Nets, Scene, Shaded, Taken, by_net, by_tracer, judged_in_turn, smoke
from line_chart import Panel, Series, write_charts
from measurement import Measurement, parser

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.records import DensityFrame, GuideMap, SixWayLightmap
from sixway.guide.config import GuideConfig, stored_guide
from sixway.guide.march import GuideMarcher
from sixway.metrics.psnr import psnr_of_mse
from sixway.reference.denoise import denoise
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.reference.variant import use_variant

GUIDE = "guide"


def main() -> int:
    options = parser((__doc__ or "").splitlines()[0])
    options.add_argument("net", type=Path, help="run folder, or an .onnx file (its own size)")
    options.add_argument("--scenario", type=Path, default=SCENARIO, help="smoke to look at, without obstacles")
    options.add_argument("--chart", type=Path, help="draw time against PSNR into this PNG")
    chosen = options.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    if use_variant("cpu").startswith("scalar"):
        print("Mitsuba runs in scalar code only: no renderer to compare with, skipped")
        return 0
    quick = chosen.quick
    yaws = (30.0,) if quick else (30.0, 75.0)
    about = {"net": str(chosen.net), "scenario": chosen.scenario.name, "yaws_deg": yaws, "load": os.getloadavg()[0]}
    result = Measurement(about, repetitions=3)
    frame = smoke(chosen.scenario, quick=quick)
    with tempfile.TemporaryDirectory() as folder:
        nets = Nets.open(chosen.net, Path(folder))
        (size,) = nets.sizes((64 if quick else 128,))
        scenes = [Scene.traced(frame, nets.card, size, samples=256 if quick else 2048, yaw_deg=yaw) for yaw in yaws]
        points = mean_points([measured(scene, nets, size, result.repetitions) for scene in scenes])
    report(result, points, size)
    if chosen.chart:
        write_charts(chosen.chart, [chart(points, size)], width_px=720, height_px=440)
    return result.finish(chosen.json)


def measured(scene: Scene, nets: Nets, size: int, repetitions: int) -> dict[str, tuple[Taken, float]]:
    """Time and squared error of every way to the maps of one scene."""
    ways = {NET: by_net(scene, nets.onnx(size))}
    guide = stored_guide(nets.card.guide, source="the net's guide")
    if set(DIRECTIONS) <= set(guide.channels):
        ways[GUIDE] = by_guide(scene, guide)
    settings = {f"cached, {name}": config for name, config in CACHED.items()}
    settings |= {f"path, {n} paths": ReferenceConfig(method="path", samples=n) for n in (16, 64)}
    settings |= {f"stock, {n} paths a light": ReferenceConfig(method="stock", samples=n) for n in (1, 4)}
    for name, config in settings.items():
        ways |= {name: by_tracer(scene, config), f"{name}, OIDN": denoised(scene, config)}
    taken = judged_in_turn(ways, repetitions=repetitions)
    return {name: (taken[name], way.squared_error) for name, way in ways.items()}


def by_guide(scene: Scene, config: GuideConfig) -> Shaded:
    marcher = GuideMarcher(config, scene.medium, device="cpu", threads=os.cpu_count() or 1)
    return Shaded(scene, lambda frame, seed: as_lightmap(marcher.march(frame, scene.camera, seed=seed)))


def as_lightmap(guide: GuideMap) -> SixWayLightmap:
    """The guide's own six maps and 1 - T."""
    maps = [guide[name] for name in DIRECTIONS]
    image = np.stack([*maps, 1.0 - guide["transmittance"]], axis=-1)
    return SixWayLightmap(channels=LIGHTMAP_CHANNELS[:-1], image=np.maximum(image, 0.0))


def denoised(scene: Scene, config: ReferenceConfig) -> Shaded:
    tracer = LightmapTracer(config, scene.medium, device="cpu")

    def bake(frame: DensityFrame, seed: int) -> SixWayLightmap:
        return denoise(tracer.trace(frame, scene.camera, seed=seed), quality="fast")

    return Shaded(scene, bake)


@dataclass(frozen=True)
class Point:
    """What a way takes, and how near it comes to the truth."""

    milliseconds: float
    cpu_milliseconds: float
    decibels: float


def mean_points(scenes: list[dict[str, tuple[Taken, float]]]) -> dict[str, Point]:
    """Of all scenes: mean time, PSNR of the mean squared error."""
    found = {}
    for name in scenes[0]:
        taken, errors = zip(*(scene[name] for scene in scenes), strict=True)
        found[name] = Point(
            1e3 * statistics.mean(times.seconds for times in taken),
            1e3 * statistics.mean(times.cpu_seconds for times in taken),
            psnr_of_mse(statistics.mean(errors)),
        )
    return found


def report(result: Measurement, points: dict[str, Point], size: int) -> None:
    for name, point in points.items():
        result.add(f"{size}^2, {name}", point.milliseconds, "ms")
        result.add(f"{size}^2, {name}", point.cpu_milliseconds, "ms of CPU")
        result.add(f"{size}^2, {name}", point.decibels, "dB")
    net = points[NET]
    if GUIDE in points:
        guide = points[GUIDE]
        result.add(f"{size}^2, the net adds to its guide", net.decibels - guide.decibels, "dB", at_least=0.0)
    renderers = {name: point for name, point in points.items() if name not in (GUIDE, NET)}
    in_time = [name for name, point in renderers.items() if point.milliseconds <= net.milliseconds]
    if in_time:  # one that beats the net in its time is a miss
        name = max(in_time, key=lambda n: renderers[n].decibels)
        label = f"{size}^2, best renderer in the time of {NET} ({name})"
        result.add(label, renderers[name].decibels, "dB", at_most=net.decibels)
    quickest = min(renderers, key=lambda n: renderers[n].milliseconds)
    ratio = renderers[quickest].milliseconds / net.milliseconds
    result.add(f"{size}^2, quickest renderer ({quickest}) / {NET}", ratio, "x")
    as_good = [name for name, point in renderers.items() if point.decibels >= net.decibels]
    if as_good:
        name = min(as_good, key=lambda n: renderers[n].milliseconds)
        ratio = renderers[name].milliseconds / net.milliseconds
        result.add(f"{size}^2, quickest renderer as good as {NET} ({name}) / {NET}", ratio, "x")


def chart(points: dict[str, Point], size: int) -> Panel:
    def series(label: str, chosen: Callable[[str], bool]) -> Series:
        shown = [point for name, point in points.items() if chosen(name)]
        x = np.log10([point.milliseconds for point in shown])
        return Series(label=label, x=x, y=np.array([point.decibels for point in shown]), marks=True)

    kinds = [
        series(NET, lambda name: name == NET),
        series(GUIDE, lambda name: name == GUIDE),
        *(
            series(
                f"{method}{' + OIDN' * filtered}",
                lambda name, m=method, f=filtered: name.startswith(m) and name.endswith("OIDN") == f,
            )
            for method in ("cached", "path")
            for filtered in (False, True)
        ),
    ]
    return Panel(
        title=f"Six maps of {size}^2 on one CPU: PSNR in sRGB [dB] against log10 of milliseconds",
        x_label="log10(ms)",
        y_label="dB",
        series=[entry for entry in kinds if entry.x.size],
        legend="bottom right",
    )


if __name__ == "__main__":
    sys.exit(main())
