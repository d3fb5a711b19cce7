"""How well is motion seen in smoke? Endpoint errors on simulations that no estimator has seen, and what a pair costs.

python scripts/validate_flow.py --json flow.json --write docs/validation.md

Two kinds of pairs, each of mean motion of 2 px over the smoke or a little more. `moved`: the first picture is made from
the second by the simulator's motion, so the flow is exact. `simulated`: two frames as they are; the simulator's motion
is then the mean of layers that move apart, and steady streams look still, so no estimator can reach 0. The share of
the change between the frames that a flow leaves unexplained stands beside it, for the simulator's own motion as well.

`--quick` simulates the same scenarios coarsely. OpenCV is a development extra; where it is absent, so are its rows.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from statistics import mean

import numpy as np
import torch
import warp as wp
from measurement import Measurement, median_seconds, parser, write_section
from torch import Tensor

from sixway.core.config import load_config
from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.losses.flow import FlowLoss
from sixway.models.flow_lucas_kanade import LucasKanade
from sixway.models.flow_warp import warp
from sixway.models.flownet import SHIPPED, load_flownet
from sixway.training.flow import FlowTrainConfig
from sixway.training.flow_data import FlowData, FlowDataConfig
from sixway.training.flow_pairs import FlowPairs, MovingClip, endpoint_error, moved_pair, simulated_pair

CONFIG = Path(__file__).parents[1] / "configs/train/flow.yaml"
MOTION_PX = 2.0
EPE_BOUND_PX = 0.5
SHARE_BOUND = 0.25

Estimator = Callable[[Tensor, Tensor], Tensor]


def main() -> int:
    options = parser(__doc__.splitlines()[0])
    options.add_argument(
        "--weights", type=Path, default=SHIPPED, help="folder of the FlowNet (default: the shipped one)"
    )
    options.add_argument("--pairs", type=int, default=8, help="pairs of each kind from every clip (default: 8)")
    options.add_argument("--write", type=Path, help="Markdown file that gets the table")
    arguments = options.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    clips = unseen_clips(quick=arguments.quick)
    estimators = the_estimators(arguments.weights)
    pairs_a_clip = 2 if arguments.quick else arguments.pairs
    about = {"pairs": pairs_a_clip * len(clips), "threads": torch.get_num_threads(), "quick": arguments.quick}
    result = Measurement(config=about, repetitions=3 if arguments.quick else 15)
    for kind, make in (("moved", moved_pair), ("simulated", simulated_pair)):
        pairs = [make(clip, frame, stride) for clip in clips for frame, stride in strides_of(clip, pairs_a_clip)]
        accuracy(result, kind, pairs, estimators)
    costs(result, estimators)
    if arguments.write:
        write_section(arguments.write, "flow", markdown(result))
    return result.finish(arguments.json)


def unseen_clips(*, quick: bool) -> list[MovingClip]:
    """The test split, made where it is missing."""
    config = load_config(FlowTrainConfig, CONFIG)
    clips = coarse(config.clips) if quick else config.clips
    data = FlowData.read(clips, scenarios_from=CONFIG.parent, folder=Path(config.data))
    for name in data.make(("test",), device="cpu", threads=torch.get_num_threads()):
        print(f"simulated {name}")
    return [MovingClip(clip) for clip in data.clips("test")]


def coarse(config: FlowDataConfig) -> FlowDataConfig:
    sources = [
        source.model_copy(update={"yaws_deg": source.yaws_deg[:1], "set": (*source.set, "resolution=tiny")})
        for source in config.sources
        if source.split == "test"
    ]
    return config.model_copy(update={"sources": tuple(sources), "frames": 8})


def strides_of(clip: MovingClip, count: int) -> list[tuple[int, int]]:
    """Frames spread over the clip, each with the smallest stride whose motion averages `MOTION_PX` over the smoke."""
    chosen = []
    for frame in np.linspace(0, len(clip) - 1, count + 1)[:-1].astype(int).tolist():
        for stride in range(1, len(clip) - frame):
            flow = clip.flow(frame, stride)
            if endpoint_error(torch.zeros_like(flow), flow, clip.alpha[frame : frame + 1]).item() >= MOTION_PX:
                chosen.append((frame, stride))
                break
    return chosen


def the_estimators(weights: Path) -> dict[str, Estimator]:
    estimators: dict[str, Estimator] = {
        "zero flow": lambda first, second: torch.zeros_like(first).expand(-1, 2, -1, -1),
        "Lucas-Kanade": LucasKanade(),
        "FlowNet": load_flownet(weights),
    }
    try:
        import cv2
    except ImportError:
        print("OpenCV is not installed (pip install opencv-python-headless): its rows are left out")
        return estimators
    dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)

    def farneback(first: np.ndarray, second: np.ndarray, flow: None) -> np.ndarray:
        return cv2.calcOpticalFlowFarneback(first, second, flow, 0.5, 4, 15, 3, 5, 1.2, 0)

    return estimators | {"OpenCV DIS (medium)": of_bytes(dis.calc), "OpenCV Farneback": of_bytes(farneback)}


def of_bytes(find: Callable[[np.ndarray, np.ndarray, None], np.ndarray]) -> Estimator:
    """OpenCV sees pictures of 8 bits."""

    def estimate(first: Tensor, second: Tensor) -> Tensor:
        one, two = ((255.0 * p[0, 0].clamp(0.0, 1.0)).round().byte().numpy() for p in (first, second))
        return torch.from_numpy(find(one, two, None)).permute(2, 0, 1)[None]

    return estimate


@torch.no_grad()
def accuracy(result: Measurement, kind: str, pairs: list[FlowPairs], estimators: dict[str, Estimator]) -> None:
    errors = {
        name: mean(endpoint_error(find(p.first, p.second), p.flow, p.alpha).item() for p in pairs)
        for name, find in estimators.items()
    }
    zero = errors["zero flow"]
    result.add(f"{kind}: motion", zero, "px", at_least=MOTION_PX if kind == "simulated" else None)
    for name, error in errors.items():
        if name == "zero flow":
            continue
        bound = kind == "moved" and name == "FlowNet"
        result.add(f"{kind}: {name}: endpoint error", error, "px", at_most=EPE_BOUND_PX if bound else None)
        result.add(f"{kind}: {name}: of no flow's", error / zero, "", at_most=SHARE_BOUND if bound else None)
    for name, find in estimators.items():
        if name != "zero flow":
            left = mean(unexplained(p, find(p.first, p.second)) for p in pairs)
            result.add(f"{kind}: {name}: change unexplained", left, "")
    result.add(f"{kind}: simulator's motion: change unexplained", mean(unexplained(p, p.flow) for p in pairs), "")


def unexplained(pair: FlowPairs, flow: Tensor) -> float:
    """Difference of the pictures that is left when the second is moved by the flow, as a share of all of it."""
    left = ((warp(pair.second, flow) - pair.first).abs() * pair.alpha).sum()
    return float(left / ((pair.second - pair.first).abs() * pair.alpha).sum())


def costs(result: Measurement, estimators: dict[str, Estimator]) -> None:
    """Milliseconds a pair of 128 x 128 px; of the loss, for four pairs as a batch has them."""
    first, second = (torch.rand(1, 1, 128, 128, generator=torch.Generator().manual_seed(i)) for i in (1, 2))

    def milliseconds(work: Callable[[], object]) -> float:
        return 1e3 * median_seconds(work, repetitions=result.repetitions, wait=lambda: None)

    for name, find in estimators.items():
        if name != "zero flow":
            with torch.no_grad():
                result.add(f"cost: {name}: a pair", milliseconds(lambda find=find: find(first, second)), "ms")
    target = torch.rand(8, len(LIGHTMAP_CHANNELS), 128, 128)
    predicted = torch.rand(8, len(LIGHTMAP_CHANNELS), 128, 128, requires_grad=True)
    for name in ("Lucas-Kanade", "FlowNet"):
        loss = FlowLoss(estimators[name])  # type: ignore[arg-type]
        with torch.no_grad():
            kept = loss.flow_of(target)
        for how, known in (("true flow kept", kept), ("true flow found", None)):
            spent = milliseconds(lambda loss=loss, known=known: loss(predicted, target, known).backward())
            result.add(f"cost: {name}: loss and gradient of 4 pairs, {how}", spent, "ms")


def markdown(result: Measurement) -> str:
    lines = ["| measured | value | bound |", "|---|---|---|"]
    lines += [f"| {row['name']} | {row['value']:.3g} {row['unit']} | {row['bound']} |" for row in result.rows]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
