"""How noisy the references are: by every frame's record, and by test frames traced once more with another seed."""

import numpy as np

from sixway.core.color import encode_srgb
from sixway.core.conventions import DIRECTIONS
from sixway.core.exr import read_exr
from sixway.core.store import read_json, write_json
from sixway.data.manifest import NoiseSummary
from sixway.generation.stages import TARGET_CHANNELS, Generation
from sixway.generation.traced import HalvedTracer

_PROBES = 4
_OTHER_SEED = 0x0DDBA11


def summarised(noise_rmse: dict[str, float], *, scale: float) -> NoiseSummary:
    """The noise of all references, told by their paths, in the brightness of the dataset.

    noise_rmse: linear, of each frame's maps, as `Traced` says.
    """
    values = np.array(list(noise_rmse.values())) * scale
    worst = max(noise_rmse, key=noise_rmse.__getitem__)
    return NoiseSummary(median_rmse=float(np.median(values)), worst_rmse=float(values.max()), worst_frame=worst)


def reference_noise_psnr_db(job: Generation, *, scale: float) -> float | None:
    """PSNR [dB] between two test references that differ in their seed alone; sRGB maps, brightness scaled.

    Each carries noise, so their difference has twice its variance: against one of them a perfect net
    scores 3.01 dB more than this (bias apart). None without test simulations or where both are equal.
    Kept in ``noise.json`` beside the frames that it speaks of.
    """
    rows = [(s, v, f) for s in job.plan.simulations if s.split == "test" for f in s.frames for v in s.views]
    if not rows:
        return None
    rows = rows[:: max(1, len(rows) // _PROBES)][:_PROBES]
    kept = job.store(job.plan.target(rows[0][0], rows[0][1])).path / "noise.json"
    names = [[job.plan.target(s, v).path, f] for s, v, f in rows]
    if kept.is_file() and (known := read_json(kept))["rows"] == names:
        linear_mse = np.array(known["mse_by_scale"].get(f"{scale:.6g}", np.nan))
        if np.isfinite(linear_mse):
            return _psnr(float(linear_mse))
    reference = job.plan.reference(rows[0][0])
    tracer = HalvedTracer(reference, job.plan.config.medium.medium, device=job.tracer_device)
    errors = []
    for simulation, view, frame in rows:
        path = job.store(job.plan.target(simulation, view)).frame_path(frame, ".exr")
        first = read_exr(path, TARGET_CHANNELS)
        seed = job.plan.frame_seed(simulation, frame) ^ _OTHER_SEED
        again = tracer.trace_views(view.seen(job.read_density(simulation, frame)), [view.camera], seed=seed)
        second = next(again).lightmap.image
        lit = slice(0, len(DIRECTIONS))
        errors.append(np.mean((encode_srgb(first[..., lit] * scale) - encode_srgb(second[..., lit] * scale)) ** 2))
    mse = float(np.mean(errors))
    write_json(kept, {"rows": names, "mse_by_scale": {f"{scale:.6g}": mse}})
    return _psnr(mse)


def _psnr(mse: float) -> float | None:
    return -10.0 * float(np.log10(mse)) if mse > 0.0 else None
