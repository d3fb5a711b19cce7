"""The dataset card: what a dataset holds, in what units, how noisy, made by what. Written beside the manifest."""

from collections import Counter
from pathlib import Path

from sixway.core.store import write_text
from sixway.data.manifest import Manifest
from sixway.generation.plan import Plan

CARD = "CARD.md"


def write_card(folder: Path, manifest: Manifest, plan: Plan) -> None:
    """Write `CARD.md` from a finished manifest and the plan that it was made by."""
    write_text(folder / CARD, "\n\n".join(_sections(manifest, plan)) + "\n")


def _sections(manifest: Manifest, plan: Plan) -> list[str]:
    config = plan.config
    made = manifest.provenance
    return [
        f"# Dataset {manifest.name}",
        f"Six-way lightmaps of simulated smoke. Commit {made['commit']}, {made['hardware']}, seed {config.seed}. "
        "Frames can be made again bit by bit on the same kind of machine: `python data_gen/generate.py CONFIG --out "
        "FOLDER`, with the config that `manifest.json` holds.",
        "## What is in it",
        _table(["split", "size", "pictures", "density x"], _counts(manifest)),
        _table(["simulation", "split", "scenario", "seed", "frames", "views", "density folder"], _simulations(plan)),
        "Splits are by simulation: no frame or view of a test simulation is ever trained on. Rows 2i and 2i + 1 of a "
        "packed array are consecutive frames of one view. A view sees the smoke `density_scale` times as dense.",
        "## Units",
        "\n".join(f"- {name}: {meaning}" for name, meaning in manifest.conventions.items()),
        f"Brightness scale {manifest.scale:.4f}"
        + (f", emissive scale {manifest.emissive_scale:.4f}" if manifest.emissive_scale else ", no fire")
        + f". Smoke: extinction {config.medium.extinction_per_m:g} 1/m at density 1, albedo {config.medium.albedo:g}, "
        f"Henyey-Greenstein g {config.medium.hg_g:g}. Obstacles hide smoke and cast no shadow.",
        "## References",
        f"Method {config.reference.method}, bounces `{config.reference.bounces}` (`single`: none indirect, `paper`: "
        f"one, `multi`: all), {config.reference.samples} samples, {config.test_samples_factor} times as many to score.",
        _noise(manifest),
        "## Guides",
        "\n".join(f"- `{name}`: {', '.join(guide.channels)}" for name, guide in config.guides.items()),
        "Their settings stand in `manifest.json`.",
        "## Packed arrays (float16, SHA-256)",
        _table(["file", "channels", "SHA-256"], _arrays(manifest)),
    ]


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _counts(manifest: Manifest) -> list[list[str]]:
    rows = []
    for group in manifest.groups:
        scales = Counter(sample.density_scale for sample in group.samples)
        told = ", ".join(f"{scale:g}" for scale in sorted(scales))
        if len(scales) > 6:
            told = f"{min(scales):g} to {max(scales):g}"
        rows.append([group.split, f"{group.width_px} x {group.height_px}", str(len(group.samples)), told])
    return rows


def _simulations(plan: Plan) -> list[list[str]]:
    return [
        [
            simulation.name,
            simulation.split,
            Path(entry.scenario).stem,
            str(simulation.scenario.seed),
            str(len(simulation.frames)),
            str(len(simulation.views)),
            f"`{plan.density(simulation).path}`",
        ]
        for entry, simulation in zip(plan.config.simulations, plan.simulations, strict=True)
    ]


def _noise(manifest: Manifest) -> str:
    told = []
    if manifest.noise_psnr_db is not None:
        told.append(
            f"Two test references that differ in their seed alone agree to {manifest.noise_psnr_db:.1f} dB (sRGB), so "
            f"a perfect net scores about {manifest.noise_psnr_db + 3.01:.1f} dB, bias apart."
        )
    if manifest.noise is not None:
        told.append(
            f"Standard error of a map, where it was measured: median {manifest.noise.median_rmse:.4f} of white, worst "
            f"{manifest.noise.worst_rmse:.4f} (`{manifest.noise.worst_frame}`)."
        )
    return " ".join(told) or "Their noise was not measured."


def _arrays(manifest: Manifest) -> list[list[str]]:
    return [
        [f"`{array.path}`", ", ".join(array.channels), f"`{array.sha256}`"]
        for group in manifest.groups
        for array in group.arrays.values()
    ]
