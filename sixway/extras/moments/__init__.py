"""The air as ten moments a cell: the encoding of Li et al. 2023 ("High-order moment-encoded kinetic simulation").

Density, velocity and stress are all that the regularised collision leaves of a cell; its 27 populations follow from
them by a Hermite series of third order. So ten floats a cell are moved instead of 27, for more arithmetic: of use
where memory is short or slow (80 bytes an update, against 216 with D3Q27). On a CPU it is slower than the populations.
"""

from sixway.extras.moments.flow import MomentFlow
from sixway.sim.flow.flow import Flow, FlowConfig


def make_flow(
    config: FlowConfig, *, shape_zyx: tuple[int, int, int], viscosity: float, device: str, threads: int = 1
) -> Flow:
    """The flow that `config.encoding` names; arguments as of `Flow`."""
    kind = MomentFlow if config.encoding == "moments" else Flow
    return kind(config, shape_zyx=shape_zyx, viscosity=viscosity, device=device, threads=threads)
