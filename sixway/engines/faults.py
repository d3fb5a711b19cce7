"""What goes wrong with packed six-way textures, one fault at a time, and the pictures that each leaves.

A hypothesis is a packing with at most one fault; it predicts what every channel of every file holds. Two
hypotheses that predict the same content look the same: no validator can tell them apart.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float

from sixway.core.color import decode_srgb, encode_srgb
from sixway.core.conventions import DIRECTIONS, FLIP_HORIZONTAL, FLIP_VERTICAL
from sixway.engines.packing import NEUTRAL, Packing

CONSTANT = ("zero", "one")
UNSEEN = ("occlusion", "motion_x", "motion_y")
"""Channels about which six-way maps say nothing."""


@dataclass(frozen=True)
class Content:
    """What one channel holds. role: a name of `packing.CARRIED`, or ``transmittance`` (an inverted alpha).

    curve: how often the sRGB curve was applied: 0 linear, 1 sRGB, 2 twice, -1 undone once too often.
    """

    role: str
    curve: int


@dataclass(frozen=True)
class Fault:
    """A single fault. kind: see :func:`faults_of`; names: the channels that it concerns."""

    kind: str
    names: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.kind} {'/'.join(self.names)}" if self.names else self.kind


HEALTHY = Fault("none")

_RENAMES: Mapping[str, Mapping[str, str]] = {
    "mirrored left-right": FLIP_HORIZONTAL,
    "mirrored top-bottom": FLIP_VERTICAL,
    "turned by 180 degrees": {**FLIP_HORIZONTAL, **FLIP_VERTICAL},
}


@dataclass(frozen=True)
class Hypothesis:
    """A packing, a fault, and the contents they predict: one tuple a texture, in the order R, G, B, A."""

    packing: Packing
    fault: Fault
    textures: tuple[tuple[Content, ...], ...]
    straight: bool = False


def healthy(packing: Packing, *, floats: bool) -> Hypothesis:
    """The packing as it should be. floats: the files hold linear floats."""
    textures = tuple(
        tuple(
            Content(name, 0 if floats or texture.transfer(i) == "linear" else 1)
            for i, name in enumerate(texture.channels)
        )
        for texture in packing.textures
    )
    return Hypothesis(packing, HEALTHY, textures)


def faults_of(packing: Packing) -> Iterator[Fault]:
    """Every single fault that a packing can have.

    swapped a/b: two channels in one another's place. textures swapped: the two files of maps. mirrored, turned:
    the pictures, not the names. colour too dark / too bright: R, G, B of the maps miss an sRGB curve / have one too
    many. alpha curved: alpha is sRGB-coded. A curved: so is a map that sits in A. straight: maps divided by
    alpha. missing a: zeros. opaque: alpha is 1. inverted: alpha holds transmittance.
    """
    names = [name for name in packing.carried if name not in UNSEEN]
    yield from (Fault("swapped", pair) for pair in combinations(names, 2))
    maps = _map_textures(packing)
    if len(maps) == 2 and len({len(packing.textures[i].channels) for i in maps}) == 1:
        yield Fault("textures swapped")
    yield from (Fault(kind) for kind in _RENAMES)
    yield Fault("colour too dark")
    yield Fault("colour too bright")
    yield Fault("alpha curved")
    if any(texture.channels[3:] and texture.channels[3] in DIRECTIONS for texture in packing.textures):
        yield Fault("A curved")
    yield Fault("straight")
    yield from (Fault("missing", (name,)) for name in names)
    yield Fault("opaque")
    yield Fault("inverted")


def _map_textures(packing: Packing) -> list[int]:
    return [i for i, texture in enumerate(packing.textures) if set(texture.channels) & set(DIRECTIONS)]


def suppose(base: Hypothesis, fault: Fault) -> Hypothesis:
    """The contents that `fault` leaves of a healthy packing."""

    def each(change: dict[str, str]) -> Hypothesis:
        textures = tuple(tuple(replace(c, role=change.get(c.role, c.role)) for c in t) for t in base.textures)
        return replace(base, fault=fault, textures=textures)

    def curved(step: int, where: set[int], roles: tuple[str, ...]) -> Hypothesis:
        textures = tuple(
            tuple(replace(c, curve=c.curve + step) if c.role in roles and i in where else c for i, c in enumerate(t))
            for t in base.textures
        )
        return replace(base, fault=fault, textures=textures)

    match fault.kind:
        case "none":
            return base
        case "swapped":
            a, b = fault.names
            return each({a: b, b: a})
        case "textures swapped":
            first, second = _map_textures(base.packing)
            # The roles trade places, the curves stay with the files that hold them.
            textures = list(base.textures)
            for here, there in ((first, second), (second, first)):
                pairs = zip(base.textures[here], base.textures[there], strict=True)
                textures[here] = tuple(replace(content, role=other.role) for content, other in pairs)
            return replace(base, fault=fault, textures=tuple(textures))
        case kind if kind in _RENAMES:
            return each(dict(_RENAMES[kind]))
        case "colour too dark":
            return curved(-1, {0, 1, 2}, DIRECTIONS)
        case "colour too bright":
            return curved(+1, {0, 1, 2}, DIRECTIONS)
        case "alpha curved":
            return curved(+1, {0, 1, 2, 3}, ("alpha",))
        case "A curved":
            return curved(+1, {3}, DIRECTIONS)
        case "straight":
            return replace(base, fault=fault, straight=True)
        case "missing":
            return each({fault.names[0]: "zero"})
        case "opaque":
            return each({"alpha": "one"})
        case "inverted":
            return each({"alpha": "transmittance"})
    raise ValueError(f"unknown fault {fault.kind!r}; see faults_of")


def curve(linear: np.ndarray, times: int) -> np.ndarray:
    """The sRGB curve applied `times` times, undone for negative numbers; values are clipped to [0, 1] first."""
    value = np.clip(linear, 0.0, 1.0)
    for _ in range(abs(times)):
        value = encode_srgb(value) if times > 0 else decode_srgb(value)
    return value


def damaged(
    image: Float[np.ndarray, "*frame c"], channels: tuple[str, ...], hypothesis: Hypothesis
) -> list[Float[np.ndarray, "*frame _"]]:
    """The pictures of a hypothesis, as code values, from a healthy linear frame (maps straight where it says so).

    Mirrored faults mirror the pictures themselves; their maps keep their channels.
    """
    planes = {name: image[..., i] for i, name in enumerate(channels)}
    planes = {**{name: np.full(image.shape[:-1], value, np.float32) for name, value in NEUTRAL.items()}, **planes}
    planes["transmittance"] = 1.0 - planes["alpha"]
    kind = hypothesis.fault.kind
    if kind in _RENAMES:
        hypothesis = healthy_of(hypothesis)
    pictures = [np.stack([curve(planes[c.role], c.curve) for c in texture], axis=-1) for texture in hypothesis.textures]
    if "left-right" in kind or "turned" in kind:
        pictures = [picture[..., :, ::-1, :] for picture in pictures]
    if "top-bottom" in kind or "turned" in kind:
        pictures = [picture[..., ::-1, :, :] for picture in pictures]
    return pictures


def healthy_of(hypothesis: Hypothesis) -> Hypothesis:
    """The same packing and curves without a fault that only renames."""
    back = _RENAMES[hypothesis.fault.kind]
    textures = tuple(tuple(replace(c, role=back.get(c.role, c.role)) for c in t) for t in hypothesis.textures)
    return replace(hypothesis, fault=HEALTHY, textures=textures)
