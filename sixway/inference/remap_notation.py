"""Curves on maps and alpha as a user writes them down on a command line."""

import math
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import ValidationError

from sixway.core.config import Config
from sixway.shading.remap import Contrast, Curve, Remap

Model = TypeVar("Model", bound=Config)


def parse_remap(
    *, low_high: str | None, contrast: str | None, curve: str | None, to: str | None, alpha: str | None
) -> Remap | None:
    """What the options ``--map-range``, ``--map-contrast``, ``--map-curve``, ``--map-to`` and ``--alpha-curve`` ask
    for; None if none of them is given. Raises ValueError, which names the option."""
    if contrast is not None and curve is not None:
        raise ValueError(f"--map-contrast {contrast} and --map-curve {curve}: one shape at a time; leave one out")
    if all(text is None for text in (low_high, contrast, curve, to, alpha)):
        return None
    shape = parse_contrast(contrast) if contrast is not None else _curve("--map-curve", curve)
    remap = Remap(shape=shape, alpha=_curve("--alpha-curve", alpha))
    for option, field, text in (("--map-range", "from_range", low_high), ("--map-to", "to_range", to)):
        if text is not None:
            remap = _checked(option, text, Remap, {**dict(remap), field: _pair(option, text)})
    return remap


def parse_contrast(text: str) -> Contrast:
    """``INTENSITY`` or ``INTENSITY:PIVOT``."""
    numbers = _numbers(text, 1) or _numbers(text, 2)
    if numbers is None:
        raise ValueError(f"--map-contrast {text!r} is not INTENSITY or INTENSITY:PIVOT")
    return _checked("--map-contrast", text, Contrast, dict(zip(("intensity", "pivot"), numbers, strict=False)))


def _curve(option: str, text: str | None) -> Curve | None:
    if text is None:
        return None
    points = tuple(_numbers(point, 2) for point in text.split(","))
    if None in points:
        raise ValueError(f"{option} {text!r} is not VALUE:RESULT,VALUE:RESULT,...")
    return _checked(option, text, Curve, {"points": points})


def _pair(option: str, text: str) -> tuple[float, ...]:
    pair = _numbers(text, 2)
    if pair is None:
        raise ValueError(f"{option} {text!r} is not A:B")
    return pair


def _numbers(text: str, count: int) -> tuple[float, ...] | None:
    try:
        numbers = tuple(float(part) for part in text.split(":"))
    except ValueError:
        return None
    return numbers if len(numbers) == count and all(map(math.isfinite, numbers)) else None


def _checked(option: str, text: str, model: type[Model], values: Mapping[str, Any]) -> Model:
    """The model of the values; a ValueError with its first complaint."""
    try:
        return model(**values)
    except ValidationError as error:
        first = error.errors()[0]
        reason = str(first.get("ctx", {}).get("error", first["msg"]))
        raise ValueError(f"{option} {text}: {reason}") from error
