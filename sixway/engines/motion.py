"""Motion vectors of flipbooks: two frames pushed towards each other before they are mixed, so few frames do.

Frame A is shown at x - t v_A(x), the next one, B, at x + (1 - t) v_B(x), mixed 1 - t to t (Guerrilla Games for
Killzone 2; Lozar 2014; what Unity's VFX Graph calls Flipbook Motion Blend). Each frame has one vector a pixel, read
in both roles, so it is the mean of where the smoke goes until the next frame and where it came from since the last.

Flow here is [px; right, down]. Files hold 0.5 + 0.5 v / scale, linear, v in tile widths and tile heights.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from sixway.core.alpha import dilated
from sixway.engines.flipbook import Plan
from sixway.engines.packing import Packing, Texture

FLOW_CHANNELS = ("flow_right", "flow_down")
"""Layers of a frame on disk: how far the smoke behind each pixel goes until the next frame [px]."""

MOTION_CHANNELS = ("motion_x", "motion_y")
"""The same as packings hold it."""

Upwards = Literal["up", "down"]
"""Which way the second component counts: up where texture v does (Unity), down where it does (Unreal, Godot)."""

_SEEN = 0.02
"""Least alpha whose motion counts; thinner smoke moves as what is near it does."""

_SMOOTHED_PX = (16, 8, 4, 2, 1)
"""Distances, coarse first, over which motion is evened out where there is no smoke."""

Flow = Float[np.ndarray, "h w 2"]


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionVectors:
    """Vectors of a whole book as files hold them. coded: [n, h, w, 2] in [0, 1], 0.5 is no motion.

    scale: the motion, in tile widths and heights a shown frame, that 1 stands for (0 for -scale). y: see `Upwards`.
    """

    coded: Float[np.ndarray, "n h w 2"]
    scale: float
    y: Upwards


def with_motion(packing: Packing) -> Packing:
    """The packing with a place for motion vectors: a texture MV of its own, unless one of its channels is theirs.

    Raises ValueError for a packing of stacked textures, which have all to be of one kind.
    """
    if set(MOTION_CHANNELS) <= set(packing.carried):
        return packing
    if packing.stacked:
        raise ValueError(
            f"packing {packing.name} is one file of stacked colours and has no place for motion vectors; take a free "
            "mapping, such as 'RTBA=right,top,back,alpha LBFE=left,bottom,front,emissive MV:linear=mx,my,0'"
        )
    texture = Texture(suffix="MV", channels=(*MOTION_CHANNELS, "zero"), rgb="linear")
    return replace(packing, textures=(*packing.textures, texture))


def motion_vectors(
    plan: Plan, flows: Float[np.ndarray, "n h w 2"], alphas: Float[np.ndarray, "n h w"], *, span: float, y: Upwards
) -> MotionVectors:
    """The vectors of every shown frame.

    flows: of every source frame, until the next [px]. alphas: of the source frames; motion is carried outwards from
    where there is smoke, since a pixel that smoke moves into must know of it. span: source frames from one shown
    frame to the next. Raises ValueError unless span is positive and flows are finite.
    """
    if not span > 0.0:
        raise ValueError(f"shown frames are {span} source frames apart; it must be more than 0")
    if not np.isfinite(flows).all():
        raise ValueError("flow holds NaN or infinite values; bake the frames again")
    carried = [carried_outwards(flow, alpha >= _SEEN) for flow, alpha in zip(flows, alphas, strict=True)]
    height, width = flows.shape[1:3]
    vectors = np.zeros((len(plan), height, width, 2), np.float32)
    for number, mix in enumerate(plan):
        for source, weight in mix:
            ahead, behind = (travelled(carried, source, way) for way in (span, -span))
            vectors[number] += weight * 0.5 * (ahead - behind)
    vectors /= np.array([width, height], np.float32)
    vectors[..., 1] *= -1.0 if y == "up" else 1.0
    scale = float(np.abs(vectors).max()) or 1.0
    return MotionVectors(coded=0.5 + 0.5 * vectors / np.float32(scale), scale=scale, y=y)


def carried_outwards(flow: Flow, known: Bool[np.ndarray, "h w"]) -> Flow:
    """The flow where it is known, and smoothly on from there: pull and push alone leaves blocks."""
    height, width = known.shape
    filled = dilated(flow, known)
    for reach in _SMOOTHED_PX:
        padded = np.pad(filled, ((reach, reach), (reach, reach), (0, 0)), mode="edge")
        rows = padded[:height] + padded[reach : reach + height] + padded[2 * reach :]
        mean = (rows[:, :width] + rows[:, reach : reach + width] + rows[:, 2 * reach :]) / np.float32(9.0)
        filled = np.where(known[..., None], flow, mean)
    return filled


def decoded(coded: Float[np.ndarray, "*n h w 2"], *, scale: float, y: Upwards) -> Float[np.ndarray, "*n h w 2"]:
    """Flow [px a shown frame; right, down] of stored values."""
    height, width = coded.shape[-3:-1]
    to_px = np.array([width, -height if y == "up" else height], np.float32)
    return (2.0 * coded - 1.0) * np.float32(scale) * to_px


def travelled(flows: list[Flow], start: int, span: float) -> Flow:
    """How far the smoke at each pixel of frame `start` has gone `span` frames later (earlier, if below 0) [px].

    Step by step: each flow is read where the smoke has got to. Past either end of the book the last flow goes on.
    """
    step = 1 if span > 0.0 else -1
    total = np.zeros_like(flows[start])
    left = abs(span)
    number = start if step > 0 else start - 1
    while left > 1e-6:
        flow = flows[min(max(number, 0), len(flows) - 1)]
        there = flow if not total.any() else sampled(flow, total)
        total = total + np.float32(step * min(left, 1.0)) * there
        number, left = number + step, left - 1.0
    return total


def sampled(image: Float[np.ndarray, "h w c"], offset: Flow) -> Float[np.ndarray, "h w c"]:
    """image(x + offset), bilinear; beyond the border, the border's value. offset: [px; right, down]."""
    height, width = image.shape[:2]
    x = np.clip(np.arange(width, dtype=np.float32)[None, :] + offset[..., 0], 0.0, width - 1.0)
    y = np.clip(np.arange(height, dtype=np.float32)[:, None] + offset[..., 1], 0.0, height - 1.0)
    left, top = x.astype(np.intp), y.astype(np.intp)
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    u, v = (x - left)[..., None], (y - top)[..., None]
    above = (1.0 - u) * image[top, left] + u * image[top, right]
    below = (1.0 - u) * image[bottom, left] + u * image[bottom, right]
    return ((1.0 - v) * above + v * below).astype(image.dtype)


def blend(
    first: Float[np.ndarray, "h w c"],
    second: Float[np.ndarray, "h w c"],
    flow_first: Flow,
    flow_second: Flow,
    part: float,
) -> Float[np.ndarray, "h w c"]:
    """What a shader shows `part` of the way from one frame to the next (0 to 1); the twin of flipbook.glsl.

    flow_first, flow_second: of each frame [px a shown frame; right, down]. Linear values, premultiplied.
    """
    if not 0.0 <= part <= 1.0:
        raise ValueError(f"part {part} of the way from one frame to the next must lie between 0 and 1")
    ahead = sampled(first, -np.float32(part) * flow_first)
    behind = sampled(second, np.float32(1.0 - part) * flow_second)
    return np.float32(1.0 - part) * ahead + np.float32(part) * behind
