"""Which map sits in which channel of which file: the named packings of engines, as data.

Names are ours (`core.conventions`): "back" is the light from behind the smoke, "front" the light from the
viewer's side. Engine shaders have z AWAY from the viewer, so their "+z" map is our ``back``; nothing but the
order of channels depends on it, and the order is below.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from sixway.core.color import decode_srgb, encode_srgb
from sixway.core.config import Config
from sixway.core.conventions import DIRECTIONS

Transfer = Literal["srgb", "linear"]
AlphaMode = Literal["premultiplied", "straight"]

NEUTRAL = {"emissive": 0.0, "occlusion": 1.0, "motion_x": 0.5, "motion_y": 0.5, "zero": 0.0, "one": 1.0}
"""Value written where the frames have no such channel. Motion of half the range is no motion."""

CARRIED = (*DIRECTIONS, "alpha", *NEUTRAL)
"""Every name that a packing may use. ``zero`` and ``one`` are constants and carry nothing."""


@dataclass(frozen=True, kw_only=True)
class Texture:
    """One file. channels: what R, G, B, A hold: 1 (grey), 3 or 4 names.

    rgb: the curve of R, G and B in files of whole numbers. A is always linear: sRGB texture formats decode
    RGB only, so a map that sits in A is stored linear beside three that are sRGB. Float files are linear.
    """

    suffix: str
    channels: tuple[str, ...]
    rgb: Transfer = "srgb"

    def __post_init__(self) -> None:
        if len(self.channels) not in (1, 3, 4):
            raise ValueError(f"texture {self.suffix!r} has {len(self.channels)} channels; a file holds 1, 3 or 4")
        if unknown := [name for name in self.channels if name not in CARRIED]:
            raise ValueError(f"texture {self.suffix!r} names {unknown}; known are {', '.join(CARRIED)}")

    def transfer(self, channel: int) -> Transfer:
        """The curve of one channel in a file of whole numbers."""
        return "linear" if channel == 3 else self.rgb


@dataclass(frozen=True, kw_only=True)
class Packing:
    """Named channel layout of one engine or tool.

    stacked: the textures lie above one another in one file, the first on top. source: where the layout was seen.
    Maps are packed alpha-premultiplied, as they are baked, unless the caller asks for straight ones.
    """

    name: str
    textures: tuple[Texture, ...]
    source: str
    stacked: bool = False

    def __post_init__(self) -> None:
        if not self.textures:
            raise ValueError(f"packing {self.name!r} has no texture; name at least one")
        suffixes = [texture.suffix for texture in self.textures]
        if len(set(suffixes)) != len(suffixes):
            raise ValueError(f"packing {self.name!r} uses a suffix twice: {suffixes}")
        if self.stacked and len({(len(texture.channels), texture.rgb) for texture in self.textures}) > 1:
            raise ValueError(f"packing {self.name!r} stacks textures of different channel counts or curves")

    @property
    def carried(self) -> tuple[str, ...]:
        """Names of the channels that the files hold, each once, constants left out."""
        names = dict.fromkeys(name for texture in self.textures for name in texture.channels)
        return tuple(name for name in names if name not in ("zero", "one"))


def _texture(suffix: str, *channels: str, rgb: Transfer = "srgb") -> Texture:
    return Texture(suffix=suffix, channels=channels, rgb=rgb)


_ALL = (
    Packing(
        name="unity",
        textures=(
            _texture("RTBA", "right", "top", "back", "alpha"),
            _texture("LBFE", "left", "bottom", "front", "emissive"),
        ),
        source="Unity HDRP/URP six-way shader and the VFXToolbox Blender baker: read in their files",
    ),
    Packing(
        name="o3de_tlrb",
        textures=(
            _texture("TLRB", "top", "left", "right", "bottom"),
            _texture("FB", "front", "back", "zero", "one"),
            _texture("opacity", "alpha", rgb="linear"),
        ),
        source="O3DE six-point lighting tutorial, mode TopLeftRightBottom_FrontBack: read; opacity is a map of its own",
    ),
    Packing(
        name="o3de_rlt",
        textures=(
            _texture("RLT", "right", "left", "top", "one"),
            _texture("BBF", "bottom", "back", "front", "one"),
            _texture("opacity", "alpha", rgb="linear"),
        ),
        source="O3DE six-point lighting tutorial, mode RightLeftTop_BottomBackFront: read in its later revisions "
        "(the first had L, R, T / F, Bk, Bt)",
    ),
    Packing(
        name="embergen_tlrb",
        textures=(
            _texture("TLRB", "top", "left", "right", "bottom"),
            _texture("EA", "emissive", "emissive", "emissive", "alpha"),
        ),
        source="EmberGen's four-way capture: second hand; the file with emissive and alpha is our choice",
    ),
    Packing(
        name="embergen_tlr_bbf",
        textures=(
            _texture("TLR", "top", "left", "right", "alpha"),
            _texture("BBF", "bottom", "back", "front", "emissive"),
        ),
        source="EmberGen's 'Six Point 1' = T, L, R: second hand; the second file's order and both A are our choice",
    ),
    Packing(
        name="godot_tea",
        textures=(
            _texture("RTB", "right", "top", "back"),
            _texture("LBF", "left", "bottom", "front"),
            _texture("TEA", "alpha", "emissive", "occlusion", rgb="linear"),
        ),
        source="Godot-Six-Way and Blazium's module: channels read; its 'transparency' used as alpha",
    ),
    Packing(
        name="paradox_stacked",
        textures=(
            _texture("RTB", "right", "top", "back", "alpha"),
            _texture("LBF", "left", "bottom", "front", "emissive"),
        ),
        source="a Paradox particle shader, RTB above LBF in one file: read; the lower half's A is our choice",
        stacked=True,
    ),
    Packing(
        name="unreal_4way",
        textures=(
            _texture("MEA", "motion_x", "motion_y", "emissive", "alpha", rgb="linear"),
            _texture("TLRB", "top", "left", "right", "bottom", rgb="linear"),
        ),
        source="an Unreal four-way tutorial: second hand; front and back are estimated by its material; sRGB off",
    ),
    Packing(
        name="rlt_bbf",
        textures=(
            _texture("RLT", "right", "left", "top"),
            _texture("BBF", "bottom", "back", "front"),
            _texture("color", "one", "one", "one", "alpha"),
        ),
        source="peeweek/Unity-URP-SmokeLighting (MIT): read; alpha is in a colour atlas of its own",
    ),
)
PACKINGS: Mapping[str, Packing] = {packing.name: packing for packing in _ALL}

_SHORT = {
    **{name: name for name in CARRIED},
    **{"r": "right", "l": "left", "t": "top", "b": "bottom", "bt": "bottom", "f": "front", "bk": "back"},
    **{"a": "alpha", "e": "emissive", "ao": "occlusion", "mx": "motion_x", "my": "motion_y", "0": "zero", "1": "one"},
}


class TextureConfig(Config):
    """One file of a packing in YAML: its channels in the order R, G, B, A and the curve of R, G and B."""

    channels: list[str]
    rgb: Transfer = "srgb"


class PackingConfig(Config):
    """A free packing in YAML: ``textures: {RTBA: {channels: [right, top, back, alpha]}, ...}``."""

    textures: dict[str, TextureConfig]
    stacked: bool = False


def packing_from_config(config: PackingConfig, *, name: str) -> Packing:
    """A free mapping read from YAML. Raises ValueError naming what does not fit."""
    textures = tuple(
        Texture(suffix=_checked_suffix(suffix), channels=tuple(_full(c) for c in texture.channels), rgb=texture.rgb)
        for suffix, texture in config.textures.items()
    )
    return Packing(name=name, textures=textures, source="free mapping", stacked=config.stacked)


def parse_packing(text: str) -> Packing:
    """A named packing, or a free mapping like ``RTBA=right,top,back,alpha LBF=l,b,f TEA:linear=a,e,ao``.

    Raises ValueError for anything else, with the names that exist.
    """
    if text in PACKINGS:
        return PACKINGS[text]
    if "=" not in text:
        raise ValueError(
            f"packing {text!r} is not known; take one of {', '.join(PACKINGS)}, a .yaml file, "
            "or a mapping like 'RTBA=right,top,back,alpha LBFE=left,bottom,front,emissive'"
        )
    textures = []
    for part in text.split():
        head, _, names = part.partition("=")
        suffix, _, rgb = head.partition(":")
        if rgb not in ("", "srgb", "linear"):
            raise ValueError(f"packing {part!r}: the curve {rgb!r} must be srgb or linear")
        channels = tuple(_full(name) for name in names.split(","))
        textures.append(
            Texture(suffix=_checked_suffix(suffix), channels=channels, rgb="linear" if rgb == "linear" else "srgb")
        )
    return Packing(name="free", textures=tuple(textures), source="free mapping")


def _full(name: str) -> str:
    if name.lower() not in _SHORT:
        raise ValueError(
            f"channel {name!r} is not known; known are {', '.join(CARRIED)} and short forms r l t b f bk a e"
        )
    return _SHORT[name.lower()]


def _checked_suffix(suffix: str) -> str:
    if not (suffix.isascii() and suffix.replace("_", "").isalnum() and len(suffix) <= 32):
        raise ValueError(
            f"texture suffix {suffix!r} must be 1 to 32 letters, digits or _; it becomes part of a file name"
        )
    return suffix


def pack(
    image: Float[np.ndarray, "*frame c"], channels: tuple[str, ...], packing: Packing
) -> list[Float[np.ndarray, "*frame _"]]:
    """The linear pictures of a packing's textures, in its order; neutral values where a channel is absent.

    Raises ValueError where a map or alpha that the packing needs is missing from `channels`.
    """
    if missing := [name for name in packing.carried if name not in channels and name not in NEUTRAL]:
        raise ValueError(f"packing {packing.name} needs {missing}, the frames hold {channels}; bake them again")
    planes = {name: image[..., i] for i, name in enumerate(channels)}
    blank = image.shape[:-1]
    return [
        np.stack(
            [
                planes[name] if name in planes else np.full(blank, NEUTRAL[name], image.dtype)
                for name in texture.channels
            ],
            axis=-1,
        )
        for texture in packing.textures
    ]


def unpack(
    pictures: list[Float[np.ndarray, "*frame _"]], packing: Packing
) -> tuple[Float[np.ndarray, "*frame c"], tuple[str, ...]]:
    """The channels that a packing carries, by name, in the order of `CARRIED`: the inverse of :func:`pack`.

    A name that stands in several places is read from the first. Raises ValueError for pictures that do not
    fit the packing.
    """
    if len(pictures) != len(packing.textures):
        raise ValueError(f"packing {packing.name} has {len(packing.textures)} textures, got {len(pictures)}")
    planes: dict[str, np.ndarray] = {}
    for picture, texture in zip(pictures, packing.textures, strict=True):
        if picture.shape[-1] != len(texture.channels):
            raise ValueError(
                f"{texture.suffix} of {packing.name} has {len(texture.channels)} channels, got {picture.shape[-1]}"
            )
        for i, name in enumerate(texture.channels):
            planes.setdefault(name, picture[..., i])
    names = tuple(name for name in CARRIED if name in packing.carried)
    return np.stack([planes[name] for name in names], axis=-1), names


def encode(picture: Float[np.ndarray, "*frame k"], texture: Texture) -> Float[np.ndarray, "*frame k"]:
    """Linear values to the code values of a file of whole numbers, in [0, 1]; what lies outside is clipped."""
    planes = [
        encode_srgb(picture[..., i]) if texture.transfer(i) == "srgb" else picture[..., i]
        for i in range(picture.shape[-1])
    ]
    return np.clip(np.stack(planes, axis=-1), 0.0, 1.0)


def decode(coded: Float[np.ndarray, "*frame k"], texture: Texture) -> Float[np.ndarray, "*frame k"]:
    """The inverse of :func:`encode`."""
    planes = [
        decode_srgb(coded[..., i]) if texture.transfer(i) == "srgb" else coded[..., i] for i in range(coded.shape[-1])
    ]
    return np.stack(planes, axis=-1)
