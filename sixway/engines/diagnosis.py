"""Which packing and fault a set of pictures has: every hypothesis is undone, and what comes out is judged.

A hypothesis says what each channel holds. Reading the pictures by it gives six maps and alpha; the better they
look like maps of smoke (`evidence`), the likelier it is. Hypotheses that predict the same content are one class.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from sixway.core.conventions import DIRECTIONS
from sixway.engines.evidence import Normal, layout, rim, size, tone
from sixway.engines.faults import HEALTHY, Content, Fault, Hypothesis, curve, faults_of, healthy, suppose
from sixway.engines.packing import NEUTRAL, PACKINGS, Packing

# Measured on the tuning bakes of scripts/validate_packings.py (--fit prints them). "along" is the axis of a side
# light, "across" the other one.
_ALONG = (Normal(1.25, 0.5), Normal(0.95, 0.45))
_ACROSS = (Normal(0.0, 0.25), Normal(0.0, 0.25))
_SIDE = (Normal(0.0, 0.25), Normal(0.0, 0.25), Normal(0.0, 0.2))
_FRONT = (Normal(0.0, 0.4), Normal(-0.55, 0.4), Normal(0.35, 0.3))
_BACK = (Normal(-0.55, 0.45), Normal(0.45, 0.4), Normal(-0.5, 0.5))
_DEPTH_ACROSS = (Normal(0.0, 0.35), Normal(0.0, 0.35))
_TONE = (Normal(0.97, 0.06), Normal(0.7, 0.3), Normal(-0.1, 0.5), Normal(2.3, 0.7))
_ANYTHING = Normal(0.0, 0.3)  # any measurement of a map in pictures that are none: their light is from nowhere
_SIZE = Normal(-1.0, 1.0)  # the only thing that tells of curves without alpha, and weakly
_RIM = Normal(0.0, 0.1)

_LAYOUT_WEIGHT = 0.7  # the measurements of one map are not independent
_FAULT_PRIOR = -3.0
_ORDER_PRIOR = -9.0  # of one in 720 orders, and more than one fault
_NO_SMOKE_PRIOR = -9.0  # as maps in any order: who asks has six-way maps, if perhaps strange ones
_KEEPS_ORDER = ("none", "opaque", "straight", "inverted", "alpha curved", "colour too dark", "colour too bright")
_FIRE_PRIOR = -12.0  # most smoke does not burn, and what burns shows in a channel that is not judged otherwise
_CONTRADICTION = -40.0
_BLANK = 1.5 / 255.0
_LARGEST_TILE_PX = 64
_TOLD_BY_ALPHA = ("colour too dark", "colour too bright", "straight")
"""Faults that only the relation of the maps to alpha can show."""
NO_SMOKE = ("no packing", Fault("no six-way maps of smoke"))
"""What noise and photographs are called."""


@dataclass(frozen=True)
class Pictures:
    """Textures as stored: [n, h, w, k] code values in [0, 1] (linear if `floats`), one tile size for all.

    k is 1 or 4: what has three channels reads as opaque. Raises ValueError for other counts and for sizes that differ.
    """

    textures: tuple[Float[np.ndarray, "n h w _"], ...]
    floats: bool = False

    def __post_init__(self) -> None:
        shapes = {picture.shape[:3] for picture in self.textures}
        if len(shapes) != 1:
            raise ValueError(f"the textures differ in size (frames, h, w): {sorted(shapes)}; give one flipbook's")
        if bad := [picture.shape[-1] for picture in self.textures if picture.shape[-1] not in (1, 4)]:
            raise ValueError(f"textures of {bad} channels; a texture has 1 or 4")

    @cached_property
    def blank(self) -> frozenset[tuple[int, int]]:
        """Channels (texture, number) that hold one value all over."""
        return frozenset(
            (t, i)
            for t, picture in enumerate(self.textures)
            for i in range(picture.shape[-1])
            if float(np.ptp(picture[..., i])) < _BLANK
        )

    @cached_property
    def twins(self) -> frozenset[tuple[tuple[int, int], tuple[int, int]]]:
        """Pairs of channels that are the same picture, blank ones left out."""
        places = [(t, i) for t, picture in enumerate(self.textures) for i in range(picture.shape[-1])]
        alive = [place for place in places if place not in self.blank]
        planes = {(t, i): self.textures[t][..., i] for t, i in alive}
        return frozenset(
            (a, b) for a, b in combinations(alive, 2) if float(np.abs(planes[a] - planes[b]).max()) < _BLANK
        )


def opaque(picture: Float[np.ndarray, "*frame k"]) -> Float[np.ndarray, "*frame c"]:
    """Three channels with an A of ones, as every reader completes them; others as they are."""
    return np.concatenate([picture, np.ones_like(picture[..., :1])], axis=-1) if picture.shape[-1] == 3 else picture


def shrunk(picture: Float[np.ndarray, "n h w k"]) -> Float[np.ndarray, "n a b k"]:
    """Every so many pixels, so that a tile has at most 64 px a side, which is plenty for the evidence.

    Pixels are left out, not averaged: averages of code values follow another curve where smoke is thin.
    """
    step = -(-max(picture.shape[1:3]) // _LARGEST_TILE_PX)
    return picture[:, ::step, ::step]


@dataclass(frozen=True)
class Suspicion:
    """One class of hypotheses that look the same. confidence: its part of the belief, in [0, 1]."""

    members: tuple[tuple[str, Fault], ...]
    confidence: float

    @property
    def packing(self) -> str:
        """The simplest member's packing."""
        return self.members[0][0]

    @property
    def fault(self) -> Fault:
        """The simplest member's fault."""
        return self.members[0][1]


def diagnose(
    pictures: Pictures, packings: Iterable[Packing] = tuple(PACKINGS.values()), *, stacked: Pictures | None = None
) -> list[Suspicion]:
    """All classes of hypotheses, the likeliest first; confidences sum to 1. `NO_SMOKE` is one of them.

    The last textures of a packing may be missing. stacked: the upper and lower halves of a single file, for the
    packings that stack their textures; without it these are left out. Beside single faults, maps in any other order
    are considered ("rearranged"), so that a set which no single fault explains is not forced into one. Raises
    ValueError where no packing has so many textures with so many channels.
    """
    judges = {False: _Judge(pictures), **({True: _Judge(stacked)} if stacked else {})}
    classes: dict[tuple[bool, object], list[tuple[float, Hypothesis]]] = {}
    no_smoke = -np.inf
    for packing in packings:
        judge = judges.get(packing.stacked)
        if judge is None or not judge.fits(packing):
            continue
        base = healthy(packing, floats=pictures.floats)
        single = []
        for fault in (HEALTHY, *faults_of(packing)):
            hypothesis = suppose(base, fault)
            if fault.kind in _TOLD_BY_ALPHA and not judge.has_alpha(base):
                hypothesis = replace(base, fault=fault)  # the same to us: it joins the class of the healthy packing
            single.append(hypothesis)
        for hypothesis in single:
            belief, as_anything = judge.beliefs(hypothesis)
            no_smoke = max(no_smoke, as_anything + _NO_SMOKE_PRIOR)
            belief += 0.0 if hypothesis.fault == HEALTHY else _FAULT_PRIOR
            key = (packing.stacked, judge.signature(hypothesis))
            classes.setdefault(key, []).append((belief, hypothesis))
        for hypothesis in single:
            if hypothesis.fault.kind in _KEEPS_ORDER:
                other = judge.rearranged(hypothesis)
                key = (packing.stacked, judge.signature(other))
                if key not in classes:
                    classes[key] = [(judge.beliefs(other)[0] + _ORDER_PRIOR, other)]
    if not classes:
        counts = [picture.shape[-1] for picture in pictures.textures]
        raise ValueError(f"no packing has {len(counts)} textures of {counts} channels; name it with --packing")
    # A class is as likely as its likeliest member: that it has many names does not make it likelier.
    best = {key: max(belief for belief, _ in members) for key, members in classes.items()}
    top = max(no_smoke, *best.values())
    total = np.exp(no_smoke - top) + sum(np.exp(belief - top) for belief in best.values())
    suspicions = [Suspicion((NO_SMOKE,), float(np.exp(no_smoke - top) / total))]
    for key in best:
        ordered = sorted(classes[key], key=lambda member: (-member[0], member[1].packing.name))
        members = tuple((h.packing.name, h.fault) for _, h in ordered)
        suspicions.append(Suspicion(members, float(np.exp(best[key] - top) / total)))
    return sorted(suspicions, key=lambda suspicion: -suspicion.confidence)


class _Judge:
    """Judges hypotheses about one set of pictures; whatever several of them share is measured once."""

    def __init__(self, pictures: Pictures) -> None:
        self._pictures = pictures
        self._planes: dict[tuple[int, int, int], np.ndarray] = {}
        self._layouts: dict[object, np.ndarray] = {}
        self._tones: dict[object, float] = {}

    def fits(self, packing: Packing) -> bool:
        """Whether a packing has at least the textures at hand, grey ones where it has grey ones."""
        expected = [len(texture.channels) == 1 for texture in packing.textures]
        given = [picture.shape[-1] == 1 for picture in self._pictures.textures]
        return len(given) <= len(expected) and all(e or not g for g, e in zip(given, expected, strict=False))

    def _seen(self, hypothesis: Hypothesis) -> list[tuple[tuple[int, int], Content]]:
        """Each channel at hand with what it should hold."""
        return [
            ((t, i), content)
            for t, contents in enumerate(hypothesis.textures[: len(self._pictures.textures)])
            for i, content in enumerate(_completed(contents, self._pictures.textures[t].shape[-1]))
        ]

    def rearranged(self, hypothesis: Hypothesis) -> Hypothesis:
        """The hypothesis with its maps in the order that suits the pictures best (an assignment problem)."""
        seen = [(place, content) for place, content in self._seen(hypothesis) if content.role in DIRECTIONS]
        seen = [(place, content) for place, content in seen if place not in self._pictures.blank]
        if not seen:
            return hypothesis
        keys = tuple((*place, content.curve) for place, content in seen)
        opacity = next(((*p, c.curve) for p, c in self._seen(hypothesis) if c.role in ("alpha", "transmittance")), None)
        inverted = any(c.role == "transmittance" for _, c in self._seen(hypothesis))
        if opacity and opacity[:2] in self._pictures.blank:
            return hypothesis
        rows = layout(self._read(keys, opacity, inverted, hypothesis.straight)[0])
        odds = np.array([[_layout_belief(role, row) for role in DIRECTIONS] for row in rows])
        places, roles = linear_sum_assignment(odds, maximize=True)
        found = {seen[i][0]: DIRECTIONS[j] for i, j in zip(places, roles, strict=True)}
        textures = tuple(
            tuple(replace(c, role=found.get((t, i), c.role)) for i, c in enumerate(contents))
            for t, contents in enumerate(hypothesis.textures)
        )
        order = tuple(c.role for contents in textures for c in contents if c.role in DIRECTIONS)
        also = () if hypothesis.fault == HEALTHY else (f"and {hypothesis.fault}",)
        return replace(hypothesis, fault=Fault("rearranged", (*order, *also)), textures=textures)

    def has_alpha(self, hypothesis: Hypothesis) -> bool:
        """Whether alpha should be among the channels at hand."""
        return any(content.role == "alpha" for _, content in self._seen(hypothesis))

    def signature(self, hypothesis: Hypothesis) -> object:
        """Equal for hypotheses that predict the same pictures: the equivalence classes."""
        parts = []
        for place, content in self._seen(hypothesis):
            role, times = content.role, content.curve
            if role in NEUTRAL and place in self._pictures.blank:
                role, times = "nothing", 0
            parts.append((place, role, times))
        return tuple(parts), hypothesis.straight

    def beliefs(self, hypothesis: Hypothesis) -> tuple[float, float]:
        """Log likelihood, up to a constant, of the pictures under a hypothesis; and the same if what it takes for maps
        of smoke were just any pictures."""
        maps: dict[str, tuple[int, int, int]] = {}
        alpha: tuple[int, int, int] | None = None
        inverted = False
        belief = 0.0
        for place, content in self._seen(hypothesis):
            blank = place in self._pictures.blank
            value = float(self._pictures.textures[place[0]][0, 0, 0, place[1]])
            match content.role:
                case "zero" | "one" as role:
                    belief += 0.0 if blank and abs(value - (role == "one")) < _BLANK else _CONTRADICTION
                case "emissive":
                    belief += (0.0 if value < _BLANK else _CONTRADICTION) if blank else _FIRE_PRIOR
                case "alpha" | "transmittance":
                    belief += _CONTRADICTION if blank else 0.0
                    alpha, inverted = (*place, content.curve), content.role == "transmittance"
                case role if role in DIRECTIONS:
                    belief += _CONTRADICTION if blank else 0.0
                    maps[role] = (*place, content.curve)
        named = [key[:2] for key in (*maps.values(), *((alpha,) if alpha else ()))]
        belief += _CONTRADICTION * sum(pair in self._pictures.twins for pair in combinations(sorted(named), 2))
        usable = {role: key for role, key in maps.items() if key[:2] not in self._pictures.blank}
        if not usable or (alpha and alpha[:2] in self._pictures.blank):
            return belief + _CONTRADICTION, belief + _CONTRADICTION
        keys = tuple(sorted(usable.values()))
        state = (keys, alpha, inverted, hypothesis.straight)
        if state not in self._layouts:
            planes, opacity = self._read(keys, alpha, inverted, hypothesis.straight)
            self._layouts[state] = layout(planes)
            self._tones[state] = _tone_belief(planes, opacity)
        rows = dict(zip(keys, self._layouts[state], strict=True))
        belief += self._tones[state]
        as_smoke = sum(_layout_belief(role, rows[key]) for role, key in usable.items())
        as_anything = sum(_ANYTHING.log_odds(float(value)) for key in usable.values() for value in rows[key])
        return belief + _LAYOUT_WEIGHT * as_smoke, belief + _LAYOUT_WEIGHT * as_anything

    def _read(
        self, keys: Sequence[tuple[int, int, int]], alpha: tuple[int, int, int] | None, inverted: bool, straight: bool
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Premultiplied linear maps [n, h, w, c] and alpha, read as the hypothesis says."""
        maps = np.stack([self._plane(*key) for key in keys], axis=-1)
        if alpha is None:
            return maps, None
        opacity = self._plane(*alpha)
        opacity = 1.0 - opacity if inverted else opacity
        return (maps * opacity[..., None] if straight else maps), opacity

    def _plane(self, texture: int, channel: int, times: int) -> np.ndarray:
        key = (texture, channel, times)
        if key not in self._planes:
            self._planes[key] = curve(self._pictures.textures[texture][..., channel].astype(np.float64), -times)
        return self._planes[key]


def _tone_belief(maps: np.ndarray, alpha: np.ndarray | None) -> float:
    if alpha is None:
        return _SIZE.log_odds(size(maps))
    belief = sum(n.log_odds(v) for n, v in zip(_TONE, tone(maps, alpha), strict=True) if np.isfinite(v))
    return belief + _RIM.log_odds(rim(maps))


def _completed(contents: tuple[Content, ...], channels: int) -> tuple[Content, ...]:
    """As readers complete a texture: grey in R, G and B, opaque where the packing has no A."""
    colour = contents * 3 if len(contents) == 1 and channels == 4 else contents
    return (*colour, Content("one", 0)) if len(colour) == 3 else colour


def _layout_belief(role: str, row: np.ndarray) -> float:
    x, y, normal_x, normal_y, thick, steep, part = (float(v) for v in row)
    match role:
        case "right" | "left":
            sign = 1.0 if role == "right" else -1.0
            along, across, depth = (sign * x, sign * normal_x), (y, normal_y), _SIDE
        case "top" | "bottom":
            sign = 1.0 if role == "top" else -1.0
            along, across, depth = (sign * y, sign * normal_y), (x, normal_x), _SIDE
        case _:
            depth = _FRONT if role == "front" else _BACK
            odds = [n.log_odds(v) for n, v in zip(_DEPTH_ACROSS, (x, normal_x), strict=True)]
            odds += [n.log_odds(v) for n, v in zip(_DEPTH_ACROSS, (y, normal_y), strict=True)]
            return sum(odds) + sum(n.log_odds(v) for n, v in zip(depth, (thick, steep, part), strict=True))
    odds = [n.log_odds(v) for n, v in zip(_ALONG, along, strict=True)]
    odds += [n.log_odds(v) for n, v in zip(_ACROSS, across, strict=True)]
    odds += [n.log_odds(v) for n, v in zip(depth, (thick, steep, part), strict=True)]
    return sum(odds)


def named(suspicions: Sequence[Suspicion], least: float = 0.5) -> Suspicion | None:
    """The likeliest class, or None ("undecidable") where that is `NO_SMOKE` or has less than that confidence."""
    told = suspicions and suspicions[0].confidence >= least and suspicions[0].members[0] != NO_SMOKE
    return suspicions[0] if told else None
