"""From the scores of frames to what a report says: averages, and tables by simulation, size and density."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from sixway.core.conventions import DIRECTIONS
from sixway.evaluation.score import FrameScores
from sixway.metrics.psnr import FrameError, summarise_psnr

SPARSE = 0.01
"""Frames where less than this share of the pixels is smoke are counted apart: a black picture is easy."""

_MOST_ROWS = 12
"""Cameras or densities that a table lists; drawn ones are as many as there are frames."""

Picks = Callable[[FrameScores], bool]

_KINDS: dict[str, Callable[[FrameScores], FrameError]] = {
    "maps": lambda r: r.maps,
    "maps_masked": lambda r: r.maps_masked,
    "alpha": lambda r: r.alpha,
    "shaded": lambda r: r.shaded,
    "shaded_masked": lambda r: r.shaded_masked,
}


@dataclass(frozen=True, kw_only=True)
class Headline:
    """The frames behind the one number that people quote: smallest image size, density as simulated.

    Other sizes and densities have rows of their own, so that none is averaged away.
    """

    size: tuple[int, int]
    density_scale: float

    @classmethod
    def of(cls, rows: Sequence[FrameScores]) -> "Headline":
        """Density 1 or, where the split has none, the one nearest to it."""
        density = min((r.sample.density_scale for r in rows), key=lambda scale: abs(math.log(scale)))
        sizes = [r.size for r in rows if r.sample.density_scale == density]
        return cls(size=min(sizes, key=lambda size: size[0] * size[1]), density_scale=density)

    def holds(self, row: FrameScores) -> bool:
        return row.size == self.size and row.sample.density_scale == self.density_scale


def is_sparse(row: FrameScores) -> bool:
    return row.maps_masked.coverage < SPARSE


def summarise(rows: Sequence[FrameScores]) -> dict[str, Any]:
    """Averages over frames as plain JSON values; NaN and infinity become None. Raises ValueError for no frames.

    emissive: over the frames that burn, None if none does. flicker_ratio: temporal error over the truth's own.
    """
    by_simulation = {
        name: summarise_psnr([r.maps for r in rows if r.sample.simulation == name]).psnr_of_mean_mse_db
        for name in sorted({r.sample.simulation for r in rows})
    }
    burning = [r.emissive for r in rows if r.emissive is not None]
    perceived = _perceived(rows)
    worst = max(rows, key=lambda r: r.maps.mse)
    return {
        "frames": len(rows),
        "sparse_frames": sum(map(is_sparse, rows)),
        "psnr": _psnr(rows),
        "emissive": _summary(burning) if burning else None,
        "per_map": {
            name: _summary([r.per_map[name] for r in rows])
            | {"masked": _summary([r.per_map_masked[name] for r in rows])}
            | {metric: perceived.get(f"{name}_{metric}") for metric in ("ssim", "flip")}
            for name in DIRECTIONS
        },
        "perceived": {key: value for key, value in perceived.items() if key.partition("_")[0] not in DIRECTIONS},
        "perceived_frames": sum("maps_flip" in r.perceived for r in rows),
        "flicker_ratio": _ratio(perceived),
        "worst_simulation": min(by_simulation, key=lambda name: by_simulation[name]),
        "worst_frame": describe(worst),
    }


def breakdown(scores: Mapping[str, Sequence[FrameScores]], headline: Headline) -> dict[str, list[dict[str, Any]]]:
    """Rows {label, frames, coverage, methods} for each axis: simulation, view, size, density, coverage.

    simulation, view: in the headline's size and density; a simulation that has no such frames shows all of its own.
    size and density: each with the other as in the headline. `apart_db` of a row is the net's mean PSNR over
    these frames minus that over the headline's, both of the same moments and cameras (of all, if they share none).
    """
    net = next(iter(scores.values()))
    quoted = [r for r in net if headline.holds(r)]
    sizes = sorted({r.size for r in net if r.sample.density_scale == headline.density_scale})
    densities = sorted({r.sample.density_scale for r in net if r.size == headline.size})[:_MOST_ROWS]
    return {
        "simulation": [
            _row(scores, *_of_simulation(name, quoted, headline)) for name in sorted({r.sample.simulation for r in net})
        ],
        "view": [
            _row(scores, _view_label(view), lambda r, v=view: headline.holds(r) and _view(r) == v)
            for view in sorted({_view(r) for r in quoted})[:_MOST_ROWS]
        ],
        "size": [
            _beside(scores, f"{width} x {height}", replace(headline, size=(height, width)), headline)
            for height, width in sizes
        ],
        "density": [
            _beside(scores, f"x{density:g}", replace(headline, density_scale=density), headline)
            for density in densities
        ],
        "coverage": [
            row
            for row in (
                _row(scores, f"smoke on {SPARSE:.0%} of the pixels or more", lambda r: not is_sparse(r)),
                _row(scores, f"less than {SPARSE:.0%}", is_sparse),
                _row(scores, "the whole split", lambda r: True),
            )
            if row["frames"]
        ],
    }


def describe(row: FrameScores) -> dict[str, Any]:
    """One frame as a line of a table."""
    sample = row.sample
    return {
        "simulation": sample.simulation,
        "view": sample.view,
        "frame": sample.frame,
        "height_px": row.size[0],
        "width_px": row.size[1],
        "density_scale": sample.density_scale,
        "yaw_deg": sample.yaw_deg,
        "pitch_deg": sample.pitch_deg,
        "margin": sample.margin,
        "coverage": row.maps_masked.coverage,
        "maps_db": _number(row.maps.psnr_db),
        "maps_masked_db": _number(row.maps_masked.psnr_db) if row.maps_masked.coverage > 0.0 else None,
        "shaded_db": _number(row.shaded.psnr_db),
    }


def _row(scores: Mapping[str, Sequence[FrameScores]], label: str, picks: Picks) -> dict[str, Any]:
    picked = {name: [r for r in rows if picks(r)] for name, rows in scores.items()}
    net = next(iter(picked.values()))
    return {
        "label": label,
        "frames": len(net),
        "coverage": math.fsum(r.maps_masked.coverage for r in net) / len(net) if net else 0.0,
        "methods": {name: {"psnr": _psnr(rows)} for name, rows in picked.items() if rows},
    }


def _of_simulation(name: str, quoted: Sequence[FrameScores], headline: Headline) -> tuple[str, Picks]:
    if any(r.sample.simulation == name for r in quoted):
        return name, lambda r: headline.holds(r) and r.sample.simulation == name
    return f"{name} (at no size and density of the headline)", lambda r: r.sample.simulation == name


def _beside(
    scores: Mapping[str, Sequence[FrameScores]], label: str, other: Headline, headline: Headline
) -> dict[str, Any]:
    """A row of another size or density, and how far the net's mean PSNR is from the headline's."""
    net = next(iter(scores.values()))
    these, quoted = ([r for r in net if condition.holds(r)] for condition in (other, headline))
    if shared := {_smoke_and_view(r) for r in these} & {_smoke_and_view(r) for r in quoted}:
        these, quoted = ([r for r in rows if _smoke_and_view(r) in shared] for rows in (these, quoted))
    own, quoted_mean = (summarise_psnr([r.maps for r in rows]).mean_of_psnr_db for rows in (these, quoted))
    return _row(scores, label, other.holds) | {"apart_db": _number(own - quoted_mean)}


def _smoke_and_view(row: FrameScores) -> tuple[object, ...]:
    return row.sample.simulation, row.sample.frame, _view(row)


def _view(row: FrameScores) -> tuple[float, float, float]:
    return row.sample.yaw_deg, row.sample.pitch_deg, row.sample.margin


def _view_label(view: tuple[float, float, float]) -> str:
    return "yaw {:g}, pitch {:g}, margin {:g}".format(*view)


def _psnr(rows: Sequence[FrameScores]) -> dict[str, dict[str, Any]]:
    return {kind: _summary([pick(r) for r in rows]) for kind, pick in _KINDS.items()}


def _summary(errors: Sequence[FrameError]) -> dict[str, Any]:
    seen = [error.mse for error in errors if error.coverage > 0.0]
    values = asdict(summarise_psnr(errors)) | {"mse": float(np.mean(seen)) if seen else None}
    return {key: _number(value) if isinstance(value, float) else value for key, value in values.items()}


def _perceived(rows: Sequence[FrameScores]) -> dict[str, float]:
    values: dict[str, list[float]] = {}
    for row in rows:
        for key, value in row.perceived.items():
            if math.isfinite(value):  # a frame without smoke has no temporal error
                values.setdefault(key, []).append(value)
    return {key: float(np.mean(values[key])) for key in sorted(values)}


def _ratio(perceived: Mapping[str, float]) -> float | None:
    own, truth = perceived.get("temporal_error"), perceived.get("temporal_error_of_truth")
    return own / truth if own is not None and truth else None


def _number(value: float) -> float | None:
    """JSON knows no infinity or NaN."""
    return value if math.isfinite(value) else None
