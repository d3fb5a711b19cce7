"""One process or many: under `torchrun` the same command trains on several devices."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import nn
from torch.nn.parallel import DistributedDataParallel


@dataclass(frozen=True)
class Ranks:
    """This process among all: rank 0 logs and saves."""

    rank: int = 0
    count: int = 1

    @property
    def is_first(self) -> bool:
        return self.rank == 0

    def wrap(self, net: nn.Module) -> nn.Module:
        """Average gradients over the processes; the net itself where there is one."""
        return net if self.count == 1 else DistributedDataParallel(net)


@contextmanager
def process_group(device: str) -> Iterator[tuple[Ranks, str]]:
    """Join the group that `torchrun` opened, if it did; yields the ranks and this process's device."""
    if "WORLD_SIZE" not in os.environ:
        yield Ranks(), device
        return
    on_cuda = device.startswith("cuda")
    if on_cuda:  # before the group: nccl binds to the current device
        device = f"cuda:{os.environ.get('LOCAL_RANK', '0')}"
        torch.cuda.set_device(device)
    torch.distributed.init_process_group("nccl" if on_cuda else "gloo")
    try:
        yield Ranks(torch.distributed.get_rank(), torch.distributed.get_world_size()), device
    finally:
        torch.distributed.destroy_process_group()
