"""The same shading in GLSL ES 3.00 (WebGL2): functions to put before a shader's own `main`."""

from importlib.resources import files

CHAPTERS = ("blend", "near", "slab", "colour", "ambient", "shadow", "compose")
"""Each is a file in `glsl`; they know nothing of one another, but slab needs blend, and ambient takes maps laid out as
there."""

_HEAD = "#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp sampler2D;\n"


def glsl(*chapters: str) -> str:
    """The text of the chapters (all of them by default), in their order, behind the version line.

    Raises ValueError for a chapter that does not exist.
    """
    unknown = [name for name in chapters if name not in CHAPTERS]
    if unknown:
        raise ValueError(f"there is no GLSL chapter {unknown[0]!r}; known: {', '.join(CHAPTERS)}")
    folder = files("sixway.shading") / "glsl"
    return _HEAD + "\n".join((folder / f"{name}.glsl").read_text(encoding="utf-8") for name in chapters or CHAPTERS)
