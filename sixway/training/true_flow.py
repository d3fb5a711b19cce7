"""The flow of the true frames, estimated once: it is the same at every step, and half the flow loss's cost."""

import hashlib
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save
from torch import nn

from sixway.core.progress import track
from sixway.core.store import atomic_path, content_hash
from sixway.data.dataset import SmokeDataset
from sixway.losses.flow import FlowEstimator, FlowLoss
from sixway.models.encoding import encode_lightmap


@torch.no_grad()
def true_flows(dataset: SmokeDataset, loss: FlowLoss, folder: Path, *, device: str) -> list[np.ndarray]:
    """`FlowLoss.flow_of` every true pair of the dataset: for each group float16 [n/2, 2, h, w], memory-mapped.

    [px; right, down] on the pixels of the first frame. Kept in `folder` under the hash of estimator and
    dataset; what is there is not estimated again.
    """
    made_by = content_hash([dataset.identity, loss.estimator.name, _weights_hash(loss.estimator)])
    paths = [folder / f"{made_by}_{group.height_px}x{group.width_px}.npy" for group in dataset.groups]
    for number, (group, path) in enumerate(zip(dataset.groups, paths, strict=True)):
        if path.is_file():
            continue
        flows = np.empty((len(group.samples) // 2, 2, group.height_px, group.width_px), np.float16)
        for row in track(range(len(flows)), total=len(flows), label=f"true flow {group.height_px}x{group.width_px}"):
            target = encode_lightmap(dataset.pair(number, row).target.to(device), scale=dataset.scale)
            flows[row] = loss.flow_of(target)[0].cpu().numpy()
        with atomic_path(path) as temporary:
            np.save(temporary, flows)
    return [np.load(path, mmap_mode="r") for path in paths]


def _weights_hash(estimator: FlowEstimator) -> str:
    """Two trainings of one network are two estimators."""
    weights = estimator.state_dict() if isinstance(estimator, nn.Module) else {}
    return hashlib.sha256(save({name: values.cpu().contiguous() for name, values in weights.items()})).hexdigest()
