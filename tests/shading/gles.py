"""Fragment shaders in a real OpenGL ES 3 without a window: EGL and GLES by ctypes, Mesa's software renderer will do.

python gles.py JOBS.npz RESULT.npz, in a process of its own: Mesa brings another LLVM than Dr.Jit does. JOBS holds
``NAME/source`` and ``NAME/size`` (height, width), and textures ``NAME/texture/UNIFORM`` [h, w, 4]; RESULT holds
[h, w, 4] float32 for each NAME, or ``error``. Row 0 of textures and results is the first in memory.
"""

import ctypes
import os
import sys
from ctypes import POINTER, byref, c_char_p, c_float, c_int, c_uint, c_void_p

import numpy as np

_VERTEX = """#version 300 es
void main() {
  gl_Position = vec4(vec2(gl_VertexID % 2, gl_VertexID / 2) * 4.0 - 1.0, 0.0, 1.0);
}
"""


class Unavailable(RuntimeError):
    """No OpenGL ES 3 here."""


def connect() -> ctypes.CDLL:
    """A current context without a surface; the GLES library."""
    os.environ.setdefault("LIBGL_ALWAYS_SOFTWARE", "1")
    try:
        egl, gl = ctypes.CDLL("libEGL.so.1"), ctypes.CDLL("libGLESv2.so.2")
    except OSError as error:
        raise Unavailable(f"no EGL or GLES library: {error}") from error
    for name in ("eglGetPlatformDisplay", "eglCreateContext"):
        getattr(egl, name).restype = c_void_p
    egl.eglCreateContext.argtypes = egl.eglMakeCurrent.argtypes = [c_void_p] * 4
    display = c_void_p(egl.eglGetPlatformDisplay(0x31DD, None, None))  # EGL_PLATFORM_SURFACELESS_MESA
    if not display or not egl.eglInitialize(display, None, None):
        raise Unavailable("EGL has no display without a surface")
    egl.eglBindAPI(0x30A0)  # EGL_OPENGL_ES_API
    config, count = c_void_p(), c_int()
    wanted = (c_int * 5)(0x3033, 1, 0x3040, 0x40, 0x3038)  # a pixel buffer, not a window; OpenGL ES 3
    egl.eglChooseConfig(display, wanted, byref(config), 1, byref(count))
    context = egl.eglCreateContext(display, config, None, (c_int * 3)(0x3098, 3, 0x3038)) if count.value else None
    if not context or not egl.eglMakeCurrent(display, None, None, context):
        raise Unavailable("EGL makes no OpenGL ES 3 context")
    gl.glGetString.restype = c_char_p
    return gl


def compiled(gl: ctypes.CDLL, source: str) -> int:
    """A program; raises RuntimeError with the compiler's words."""
    program = gl.glCreateProgram()
    for kind, text in ((0x8B31, _VERTEX), (0x8B30, source)):
        shader = gl.glCreateShader(kind)
        gl.glShaderSource(shader, 1, byref(c_char_p(text.encode())), None)
        gl.glCompileShader(shader)
        gl.glAttachShader(program, shader)
        _check(gl.glGetShaderiv, gl.glGetShaderInfoLog, shader, 0x8B81)
    gl.glLinkProgram(program)
    _check(gl.glGetProgramiv, gl.glGetProgramInfoLog, program, 0x8B82)
    return program


def _check(status: object, log: object, thing: int, which: int) -> None:
    good, text = c_int(), ctypes.create_string_buffer(4096)
    status(thing, which, byref(good))  # type: ignore[operator]
    if not good.value:
        log(thing, 4096, None, text)  # type: ignore[operator]
        raise RuntimeError(text.value.decode())


def _texture(gl: ctypes.CDLL, pixels: np.ndarray | None, size: tuple[int, int]) -> int:
    name = c_uint()
    gl.glGenTextures(1, byref(name))
    gl.glBindTexture(0x0DE1, name)
    data = None if pixels is None else np.ascontiguousarray(pixels, np.float32).ctypes.data_as(c_void_p)
    gl.glTexImage2D(0x0DE1, 0, 0x8814, size[1], size[0], 0, 0x1908, 0x1406, data)  # RGBA32F
    for parameter in (0x2800, 0x2801):
        gl.glTexParameteri(0x0DE1, parameter, 0x2600)  # nearest
    return name.value


def run(gl: ctypes.CDLL, source: str, size: tuple[int, int], textures: dict[str, np.ndarray]) -> np.ndarray:
    """The shader's output `colour` at every pixel, [h, w, 4] float32."""
    program = compiled(gl, source)
    gl.glUseProgram(program)
    target, frame = _texture(gl, None, size), c_uint()
    gl.glGenFramebuffers(1, byref(frame))
    gl.glBindFramebuffer(0x8D40, frame)
    gl.glFramebufferTexture2D(0x8D40, 0x8CE0, 0x0DE1, target, 0)
    if gl.glCheckFramebufferStatus(0x8D40) != 0x8CD5:
        raise Unavailable("this OpenGL ES renders to no float textures")
    for unit, (name, pixels) in enumerate(textures.items()):
        gl.glActiveTexture(0x84C0 + unit)
        _texture(gl, pixels, pixels.shape[:2])
        gl.glUniform1i(gl.glGetUniformLocation(program, name.encode()), unit)
    gl.glViewport(0, 0, size[1], size[0])
    gl.glDrawArrays(0x0004, 0, 3)
    pixels = np.zeros((*size, 4), np.float32)
    gl.glReadPixels(0, 0, size[1], size[0], 0x1908, 0x1406, pixels.ctypes.data_as(POINTER(c_float)))
    if error := gl.glGetError():
        raise RuntimeError(f"OpenGL error {error:#x}")
    return pixels


def main() -> None:
    results: dict[str, np.ndarray] = {}
    with np.load(sys.argv[1]) as jobs:
        try:
            gl = connect()
            results["renderer"] = np.array(gl.glGetString(0x1F01).decode())
            for name in (key.removesuffix("/source") for key in jobs if key.endswith("/source")):
                prefix = f"{name}/texture/"
                textures = {key.removeprefix(prefix): jobs[key] for key in jobs if key.startswith(prefix)}
                height, width = (int(side) for side in jobs[f"{name}/size"])
                try:
                    results[name] = run(gl, str(jobs[f"{name}/source"]), (height, width), textures)
                except RuntimeError as error:
                    results[f"{name}/error"] = np.array(str(error))
        except Unavailable as error:
            results["unavailable"] = np.array(str(error))
    np.savez(sys.argv[2], **results)


if __name__ == "__main__":
    main()
