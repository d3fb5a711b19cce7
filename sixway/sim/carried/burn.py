"""Fire: fuel that is hot enough turns into heat, soot, more gas, and a flame that is seen.

Each voxel burns on its own, in the manner of Feldman, O'Brien & Arikan 2003 (above its ignition temperature fuel burns
at a rate, and releases heat, soot and gas in proportion), with the reaction coordinate of Nguyen, Fedkiw & Jensen 2002
as the flame. No oxygen is counted.

**Expansion.** The lattice gas has no divergence to set, so hot gas is added as mass: s per step and cell [1/step] gives
div u = s once the weak sound waves have left. The gas comes with the speed of the air around it,
f_q += w_q s (1 + 3 c_q . u): at rest (w_q s alone) it would brake the flow by the same rate. No radial force instead:
a force is balanced by pressure in the fireball, and pushes nothing where the fire is even.
"""

import numpy as np
import warp as wp
from pydantic import Field

from sixway.bands import RowBands
from sixway.core.config import Config
from sixway.sim.carried import burn_kernels
from sixway.sim.carried.scalars import Scalars

NEEDED = ("density", "temperature", "fuel", "flame")


class BurnConfig(Config):
    """How fuel burns. Fuel is a concentration, 1 where there is nothing else."""

    ignition_k: float = Field(default=300.0, ge=0.0, le=5000.0)
    """Fuel burns from this temperature on [K above ambient]."""
    burn_rate_per_s: float = Field(default=4.0, gt=0.0, le=1000.0)
    """Part of the fuel that burns in a second, exponentially."""
    heat_k: float = Field(default=1500.0, ge=0.0, le=10000.0)
    """What burning a unit of fuel adds to the temperature [K], up to `hottest_k`."""
    soot: float = Field(default=0.5, ge=0.0, le=100.0)
    """Smoke density from a unit of fuel."""
    expansion: float = Field(default=2.0, ge=0.0, le=20.0)
    """Volumes of new gas from a volume of pure fuel, unitless; heat_k / 293 is what an ideal gas would do."""
    most_expansion_per_step: float = Field(default=0.02, gt=0.0, le=0.1)
    """Most growth of a cell in a lattice step. A fireball of radius R cells then blows at most R / 3 times that at its
    rim, which should stay below 0.2 cells/step; what is beyond is not added."""
    flame_life_s: float = Field(default=0.4, gt=0.0, le=100.0)
    """How long gas stays a flame after its fuel has burnt [s]."""
    emission_per_m: float = Field(default=20.0, ge=0.0, le=10000.0)
    """Emission of a fresh flame that is `hottest_k` hot [1/m], relative to a white light of radiance 1."""
    hottest_k: float = Field(default=1500.0, gt=0.0, le=10000.0)
    """Burning heats no gas beyond it: what a source keeps feeding would heat up for ever [K above ambient]."""
    ambient_k: float = Field(default=293.0, gt=0.0, le=1000.0)
    """Temperature of the air around [K]."""


class Burner:
    """Burns the fields "density", "temperature" [K above ambient], "fuel" and "flame" (1 just lit, 0 out) of `scalars`.

    Raises ValueError if one of them is missing.
    """

    def __init__(self, config: BurnConfig, scalars: Scalars, *, device: str, threads: int = 1) -> None:
        missing = [name for name in NEEDED if name not in scalars.names]
        if missing:
            raise ValueError(f"fields {scalars.names} cannot burn without {missing}; add them to the scalars")
        self.config = config
        self._scalars = scalars
        self._device = wp.get_device(device)
        self._bands = RowBands(self._device, threads=threads)
        z, y, x = (n // scalars.refinement for n in scalars.shape_zyx)
        self._cells = (z, y, x)
        self.mass_source = wp.zeros((z + 2, y + 2, x + 2), dtype=wp.float32, device=self._device)
        """Growth of each cell a lattice step [1/step] until the next `burn`, with a shell of zeros."""
        self._emission = wp.zeros(scalars.shape_zyx, dtype=wp.float32, device=self._device)

    def burn(self, *, seconds: float, steps: float) -> None:
        """Let the fire go on for `seconds`, which are `steps` lattice steps; writes `mass_source`.

        The new gas thins the smoke and the fuel that it pushes away; without that, growing gas would make smoke.
        """
        config, fields = self.config, self._scalars.fields
        inputs = [
            self._scalars.refinement,
            config.ignition_k,
            float(-np.expm1(-config.burn_rate_per_s * seconds)),
            config.heat_k,
            config.hottest_k,
            config.soot,
            config.expansion,
            config.most_expansion_per_step,
            float(steps),
            seconds / config.flame_life_s,
            *(fields[name] for name in NEEDED),
        ]
        self._bands.launch(burn_kernels.react, dim=self._cells, inputs=inputs, outputs=[self.mass_source])

    def emission(self) -> wp.array:
        """Emission [1/m] of each voxel now, float32 [z, y, x]: flame times absolute temperature to the fourth."""
        config, fields = self.config, self._scalars.fields
        inputs = [
            config.emission_per_m,
            config.ambient_k,
            config.ambient_k + config.hottest_k,
            fields["flame"].flatten(),
            fields["temperature"].flatten(),
        ]
        out = self._emission.flatten()
        self._bands.launch(burn_kernels.glow, dim=out.shape, inputs=inputs, outputs=[out])
        return self._emission
