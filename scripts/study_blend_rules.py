"""How near to the truth can six maps come? Blend rules, spherical harmonics and 14 directions against traced light.

SIXWAY_REAL_VOLUMES=DIR python scripts/study_blend_rules.py --work runs/blend_rules --write

Every light of every volume is traced on its own (`trace_lit`), some 70 a volume; they are kept in the folder
`--work`, so that a run that was stopped goes on. `--write` makes docs/blend_rules.md and its picture.
"""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import warp as wp
from line_chart import Panel, Series, write_charts
from measurement import Measurement, parser
from study_volumes import OPTICAL_DEPTH, StudyVolume, study_volumes

from sixway.core.color import encode_srgb
from sixway.core.conventions import DIRECTIONS, TO_LIGHT
from sixway.core.frames import Camera
from sixway.core.store import atomic_path, write_text
from sixway.reference.lights import DirectionalLight
from sixway.reference.lit import trace_lit
from sixway.shading.blend import blend_weights

DOCS = Path(__file__).parents[1] / "docs"
RULES = ("squared", "paper_abs", "abs_normalised", "smoothstep")
ODD_POWER = 1.4
POWERS = np.arange(1.0, 3.01, 0.1)
SIZE_PX, BLOCK_PX = 48, 2
"""Pictures are compared after averaging blocks of pixels: what rules get wrong is smooth, what is noise is not."""
SAMPLES, MAP_SAMPLES, FIT_SAMPLES = 32, 256, 64
"""Paths a pixel of the lights asked for, of axes and corners, and of the directions between them."""
TWICE = 8
"""Lights that are traced a second time, which tells the noise of all."""
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(3.0)
AXES = np.array([TO_LIGHT[name] for name in DIRECTIONS])


def everywhere(count: int) -> np.ndarray:
    """Unit vectors spread evenly over the sphere (Fibonacci's spiral)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=-1)


def random_directions(count: int, seed: int) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def harmonics(to_light: np.ndarray, degree: int) -> np.ndarray:
    """Polynomials that span spherical harmonics up to that degree, [n, (degree + 1)^2]; the fit takes any scale."""
    x, y, z = to_light.T
    low = [np.ones_like(x), x, y, z]
    return np.stack(low if degree == 1 else [*low, x * y, y * z, x * z, x * x - y * y, 3 * z * z - 1], axis=-1)


def barycentric(to_light: np.ndarray) -> np.ndarray:
    """Weights of the 6 axes and 8 corners, [n, 14]: the light's direction is between three of them, on the plane of
    one axis, that of its largest part, and two corners."""
    weights = np.zeros((len(to_light), 14))
    for row, vector in enumerate(to_light):
        main, _, third = np.argsort(-np.abs(vector))
        sign = np.where(vector < 0.0, -1.0, 1.0)
        other = sign.copy()
        other[third] *= -1.0  # the two corners differ along the smallest part
        near = np.zeros(3)
        near[main] = sign[main]
        ends = np.stack([near, sign / np.sqrt(3.0), other / np.sqrt(3.0)])
        parts = np.linalg.solve(ends.T, vector)
        names = np.concatenate([AXES, CORNERS])
        for end, part in zip(ends, parts / parts.sum(), strict=True):
            weights[row, int(np.argmax(names @ end))] += part
    return weights


def powers(to_light: np.ndarray, exponent: float) -> np.ndarray:
    """|w|^p / sum |w|^p on the six maps."""
    parts = np.maximum(to_light @ AXES.T, 0.0) ** exponent
    return parts / parts.sum(axis=-1, keepdims=True)


def even_and_odd(to_light: np.ndarray) -> np.ndarray:
    """(w^2 + sign |w|^1.4) / 2 for each map, w along its axis: `squared` is (w^2 + sign w^2) / 2.

    Exact on the axes, sums to 1; maps on the far side get a little less than nothing.
    """
    part = to_light @ AXES.T
    return 0.5 * (part**2 + np.sign(part) * np.abs(part) ** ODD_POWER)


def traced(volume: StudyVolume, towards: np.ndarray, *, samples: int, seed: int, store: Path) -> np.ndarray:
    """One picture for each direction towards a sun of colour 1, averaged, [n, h, w]; kept in the file `store`."""
    if store.is_file():
        return averaged(np.load(store))
    camera = Camera.around(volume.frame.grid, yaw_deg=25.0, pitch_deg=10.0, width_px=SIZE_PX, height_px=SIZE_PX)
    pictures = []
    for number, (x, y, z) in enumerate(towards.tolist()):
        sun = DirectionalLight(to_light=(x, y, z))
        lit = trace_lit(volume.frame, camera, volume.medium, [sun], samples=samples, seed=seed + number)
        pictures.append(lit[..., 0])
    with atomic_path(store) as temporary, temporary.open("wb") as file:
        np.save(file, np.stack(pictures))
    return averaged(np.stack(pictures))


def averaged(pictures: np.ndarray) -> np.ndarray:
    count, side = len(pictures), SIZE_PX // BLOCK_PX
    return pictures.reshape(count, side, BLOCK_PX, side, BLOCK_PX).mean(axis=(2, 4))


def study(volume: StudyVolume, *, lights: int, basis: int, work: Path) -> dict[str, np.ndarray]:
    """Squared sRGB error of each method for each light, and ``noise`` and ``angle`` [deg from the nearest axis]."""
    name = volume.name.replace(" ", "_")
    asked = random_directions(lights, seed=11)
    corners, between = np.concatenate([AXES, CORNERS]), everywhere(basis - 14)
    maps = traced(volume, corners, samples=MAP_SAMPLES, seed=1000, store=work / f"{name}_maps.npy")
    more = traced(volume, between, samples=FIT_SAMPLES, seed=1100, store=work / f"{name}_{basis}_more.npy")
    known, bases = np.concatenate([corners, between]), np.concatenate([maps, more])
    surer = np.sqrt(np.repeat([MAP_SAMPLES, FIT_SAMPLES], [len(corners), len(between)]))[:, None]
    truth = traced(volume, asked, samples=SAMPLES, seed=2000, store=work / f"{name}_{lights}_truth.npy")
    again = traced(volume, asked[:TWICE], samples=SAMPLES, seed=3000, store=work / f"{name}_again.npy")
    exposure = 1.0 / np.percentile(bases[:6], 99.9)

    def shown(pictures: np.ndarray) -> np.ndarray:
        return np.clip(encode_srgb(np.maximum(pictures, 0.0) * exposure), 0.0, 1.0)

    def error(weights: np.ndarray, pictures: np.ndarray) -> np.ndarray:
        mixed = np.tensordot(weights, pictures, axes=(1, 0))
        return ((shown(mixed) - shown(truth)) ** 2).mean(axis=(1, 2))

    six = bases[:6].reshape(6, -1)
    best = np.linalg.lstsq(six.T, truth.reshape(len(asked), -1).T, rcond=None)[0].T
    errors = {rule: error(blend_weights(asked, rule), bases[:6]) for rule in RULES}
    errors |= {f"power {p:.1f}": error(powers(asked, float(p)), bases[:6]) for p in POWERS}
    errors["even + odd"] = error(even_and_odd(asked), bases[:6])
    errors["best weights of each light"] = error(best, bases[:6])
    for degree in (1, 2):
        fit = np.linalg.lstsq(surer * harmonics(known, degree), surer * bases.reshape(len(known), -1), rcond=None)[0]
        errors[f"SH L{degree}"] = error(harmonics(asked, degree), fit.reshape(-1, *bases.shape[1:]))
    errors["14 directions"] = error(barycentric(asked), bases[:14])
    noise = 0.5 * ((shown(truth[:TWICE]) - shown(again)) ** 2).mean()
    angle = np.degrees(np.arccos(np.abs(asked).max(axis=-1)))
    return {**errors, "noise": np.array([noise]), "angle": angle}


def psnr(squared: np.ndarray | float) -> float:
    return float(-10.0 * np.log10(np.maximum(np.mean(squared), 1e-12)))


def without_noise(squared: np.ndarray, noise: float) -> np.ndarray:
    """What would be left if the traced lights had no noise: it is independent of what is compared with them."""
    return np.maximum(np.mean(squared) - noise, 1e-7)


def main() -> int:
    options = parser(__doc__.splitlines()[0])
    options.add_argument("--work", type=Path, required=True, help="folder for what is traced")
    options.add_argument("--write", action="store_true", help="make docs/blend_rules.md and its picture")
    chosen = options.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    chosen.work.mkdir(parents=True, exist_ok=True)
    lights, basis = (8, 18) if chosen.quick else (32, 32)
    result = Measurement({"lights": lights, "basis": basis, "size_px": SIZE_PX, "samples": SAMPLES}, repetitions=1)
    found = {}
    for volume in study_volumes(quick=chosen.quick):
        found[volume.name] = study(volume, lights=lights, basis=basis, work=chosen.work)
        print(f"{volume.name}: squared {psnr(found[volume.name]['squared']):.2f} dB", file=sys.stderr, flush=True)
    methods = [name for name in next(iter(found.values())) if name not in ("noise", "angle")]
    clean = {m: [psnr(without_noise(f[m], float(f["noise"][0]))) for f in found.values()] for m in methods}
    best_power = max((m for m in methods if m.startswith("power")), key=lambda m: float(np.mean(clean[m])))
    shown = [*RULES, best_power, "even + odd", "best weights of each light", "SH L1", "SH L2", "14 directions"]
    for method in shown:
        result.add(f"{method}, mean over volumes", float(np.mean(clean[method])), "dB")
    result.add("noise of one traced light", float(np.mean([psnr(f["noise"]) for f in found.values()])), "dB")
    if chosen.write:
        write_text(DOCS / "blend_rules.md", page(found, clean, shown, lights, basis))
        write_charts(DOCS / "images/blend_rules.png", [by_angle(found, shown), by_power(found, clean)], width_px=520)
    return result.finish(chosen.json)


def by_angle(found: dict[str, dict[str, np.ndarray]], shown: list[str]) -> Panel:
    angle = np.concatenate([f["angle"] for f in found.values()])
    edges = np.quantile(angle, np.linspace(0.0, 1.0, 6))
    edges[-1] += 1e-9
    series = []
    for method in ("squared", "paper_abs", "even + odd", "SH L1", "SH L2", "14 directions"):
        squared = np.concatenate([np.maximum(f[method] - f["noise"], 1e-7) for f in found.values()])
        means = [psnr(squared[(angle >= low) & (angle < high)]) for low, high in pairwise(edges)]
        series.append(Series(label=method, x=0.5 * (edges[:-1] + edges[1:]), y=np.array(means)))
    return Panel(
        title="Error by angle", x_label="light's angle from the nearest axis [deg]", y_label="PSNR [dB]",
        series=series, legend="bottom left",
    )  # fmt: skip


def by_power(found: dict[str, dict[str, np.ndarray]], clean: dict[str, list[float]]) -> Panel:
    series = [
        Series(
            label=name,
            x=POWERS,
            y=np.array([clean[f"power {p:.1f}"][number] - clean["squared"][number] for p in POWERS]),
        )
        for number, name in enumerate(list(found)[:6])
    ]
    return Panel(
        title="Weights |w|^p / sum", x_label="p (1: abs_normalised, 2: squared)", y_label="PSNR above squared [dB]",
        series=series, legend="bottom right",
    )  # fmt: skip


def page(
    found: dict[str, dict[str, np.ndarray]], clean: dict[str, list[float]], shown: list[str], lights: int, basis: int
) -> str:
    noise = [psnr(f["noise"]) for f in found.values()]
    maps = {"SH L1": "4", "SH L2": "9", "14 directions": "14"}
    rows = [
        f"| {m} | {maps.get(m, '6')} | "
        + " | ".join(f"{v:.2f}" for v in clean[m])
        + f" | **{np.mean(clean[m]):.2f}** |"
        for m in shown
    ]
    return "\n".join(
        [
            "# Blend rules against traced light",
            "",
            "Made by `python scripts/study_blend_rules.py`; do not edit.",
            "",
            f"{lights} suns in random directions for each of {len(found)} volumes, each traced on its own "
            f"(`trace_lit`, one indirect bounce, {SAMPLES} paths a pixel, {SIZE_PX} x {SIZE_PX} px, optical depth "
            f"{OPTICAL_DEPTH:g}), against mixtures of maps traced with {MAP_SAMPLES} paths ({FIT_SAMPLES} for those "
            f"that only the harmonics use). All are averaged over {BLOCK_PX} x {BLOCK_PX} px. PSNR [dB] of the mean "
            "squared error in sRGB, whole picture, 99.9th percentile of the six maps at white. The noise of the traced "
            "lights, measured by tracing some of them twice, is subtracted; without that no method could exceed "
            f"{min(noise):.1f} to {max(noise):.1f} dB.",
            "",
            f"| method | maps | {' | '.join(found)} | mean |",
            f"|---|---|{'---|' * (len(found) + 1)}",
            *rows,
            "",
            "- `squared`, `paper_abs`, `abs_normalised`, `smoothstep`: the rules of `sixway.shading.blend`.",
            "- `power p`: |w|^p / sum |w|^p with the p that is best on average.",
            f"- `even + odd`: (w^2 + sign(w) |w|^{ODD_POWER:g}) / 2 for each map, w along its axis; `squared` has 2 "
            f"for {ODD_POWER:g}. Far maps get weights down to -0.07. The exponent was chosen on these very volumes.",
            "- `best weights of each light`: least squares on the true picture, which no rule can know: what six maps "
            "could do at best with one weight a map and light.",
            f"- `SH L1`, `SH L2`: harmonics fitted pixel by pixel to {basis} traced directions.",
            "- `14 directions`: six axes and eight corners, barycentric between the three nearest.",
            "",
            "![PSNR by angle, and by exponent](images/blend_rules.png)",
            "",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
