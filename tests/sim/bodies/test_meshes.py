"""Mesh files, read with suspicion, and their distance."""

import resource
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sixway.sim.bodies.distance_field import distance_field
from sixway.sim.bodies.meshes import Surface, read_surface

BUNNY = Path(__file__).parents[3] / "configs" / "sim" / "meshes" / "bunny.ply"

CORNERS = np.array([[x, y, z] for z in (0.0, 3.0) for y in (0.0, 2.0) for x in (0.0, 4.0)])
QUADS = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
TRIANGLES = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))])
"""A box of 4 x 2 x 3, its faces counter-clockwise seen from outside."""


def write_obj(path: Path, vertices: np.ndarray, triangles: np.ndarray, head: str = "") -> Path:
    lines = [head, *(f"v {x} {y} {z}" for x, y, z in vertices), *(f"f {a} {b} {c}" for a, b, c in triangles + 1)]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_stl(path: Path, vertices: np.ndarray, triangles: np.ndarray) -> Path:
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *vertices[t].ravel(), 0) for t in triangles)
    path.write_bytes(bytes(80) + struct.pack("<I", len(triangles)) + body)
    return path


def write_ply(path: Path, vertices: np.ndarray, triangles: np.ndarray) -> Path:
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = [*(f"{x} {y} {z}" for x, y, z in vertices), *(f"3 {a} {b} {c}" for a, b, c in triangles)]
    path.write_text(head + "\n".join(rows) + "\n")
    return path


def sphere(*, rings: int = 24) -> tuple[np.ndarray, np.ndarray]:
    """A closed sphere of radius 1: rings of latitude, twice as many points around."""
    around = 2 * rings
    v, u = np.meshgrid(np.pi * np.arange(1, rings) / rings, 2 * np.pi * np.arange(around) / around, indexing="ij")
    middle = np.stack([np.sin(v) * np.cos(u), np.cos(v), -np.sin(v) * np.sin(u)], axis=-1).reshape(-1, 3)
    vertices = np.concatenate([[[0.0, 1.0, 0.0]], middle, [[0.0, -1.0, 0.0]]])
    last, triangles = len(vertices) - 1, []
    for n in range(around):
        m = (n + 1) % around
        triangles += [(0, 1 + n, 1 + m), (last, last - around + m, last - around + n)]
        for ring in range(rings - 2):
            a, b = 1 + ring * around + n, 1 + ring * around + m
            triangles += [(a, a + around, b + around), (a, b + around, b)]
    return vertices, np.array(triangles)


WRITERS = {".obj": write_obj, ".stl": write_stl, ".ply": write_ply}


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_box_is_read_from_every_format(tmp_path: Path, suffix: str) -> None:
    box = read_surface(WRITERS[suffix](tmp_path / f"box{suffix.upper()}", CORNERS + 7.0, TRIANGLES))
    assert (len(box.vertices), len(box.faces), box.open_edges, box.flipped_edges) == (8, 12, 0, 0)
    assert np.allclose(box.half_extent, [0.5, 0.25, 0.375])  # centred, longest edge 1
    points = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.8, 0.65, 0.375], [0.0, -0.5, 0.1], [0.6, 0.35, 0.475]])
    assert np.allclose(box.signed_distance(points), [-0.25, -0.1, 0.5, 0.25, np.sqrt(3 * 0.1**2)])


def test_a_mesh_that_is_inside_out_is_turned(tmp_path: Path) -> None:
    box = read_surface(write_ply(tmp_path / "box.ply", CORNERS, TRIANGLES[:, ::-1]))
    assert box.signed_distance(np.zeros((1, 3)))[0] < 0.0


def test_open_and_flipped_edges_are_counted(tmp_path: Path) -> None:
    lidless = read_surface(write_ply(tmp_path / "lidless.ply", CORNERS, TRIANGLES[:-2]))
    assert (lidless.open_edges, lidless.flipped_edges) == (4, 0)
    flipped = TRIANGLES.copy()
    flipped[0] = flipped[0, ::-1]
    assert read_surface(write_ply(tmp_path / "flipped.ply", CORNERS, flipped)).flipped_edges == 3


def test_lone_vertices_do_not_count(tmp_path: Path) -> None:
    stray = np.concatenate([CORNERS, [[np.nan, 0.0, 0.0], [1e9, 0.0, 0.0]]])
    assert np.allclose(read_surface(write_ply(tmp_path / "box.ply", stray, TRIANGLES)).half_extent, [0.5, 0.25, 0.375])


def test_the_exact_distance_of_a_sphere_is_the_textbook_one(tmp_path: Path, rng: np.random.Generator) -> None:
    ball = read_surface(write_ply(tmp_path / "ball.ply", *sphere()))
    points = rng.uniform(-0.8, 0.8, (200, 3))
    # facets of a 48-gon sag by 0.5 (1 - cos(pi / 48)) at most in each direction
    assert np.allclose(ball.signed_distance(points), np.linalg.norm(points, axis=1) - 0.5, atol=2 * 0.0011)


def test_the_field_is_the_exact_distance(tmp_path: Path, rng: np.random.Generator) -> None:
    ball = read_surface(write_ply(tmp_path / "ball.ply", *sphere(rings=12)))
    field = distance_field(ball, 24)
    assert field.missing == 0.0
    samples = np.stack(np.meshgrid(*[np.arange(n) for n in field.values.shape], indexing="ij"), axis=-1)
    which = samples.reshape(-1, 3)[rng.choice(samples.size // 3, 300, replace=False)]
    points = which[:, ::-1] * field.spacing - field.half_extent
    assert np.allclose(field.values[tuple(which.T)], ball.signed_distance(points), atol=1e-6)
    assert np.allclose(field.sample(points), ball.signed_distance(points), atol=1e-6)
    between = rng.uniform(-0.5, 0.5, (200, 3))
    assert np.allclose(field.sample(between), ball.signed_distance(between), atol=0.35 * field.spacing)
    assert field.sample(np.array([[3.0, 0.0, 0.0]]))[0] == pytest.approx(2.5, abs=0.1)


def test_a_bunny_without_its_soles_is_still_a_bunny(tmp_path: Path) -> None:
    whole = read_surface(BUNNY)
    assert (whole.open_edges, whole.flipped_edges) == (0, 0) and BUNNY.stat().st_size < 200_000
    height = whole.vertices[whole.faces][:, :, 1]
    keeps_bounds = height.min(axis=1) == height.min()  # else the mesh would be centred anew
    open_faces = whole.faces[(height.max(axis=1) > -0.455) | keeps_bounds]
    cut = read_surface(write_ply(tmp_path / "open.ply", whole.vertices, open_faces))
    assert cut.open_edges > 50  # four paws
    closed, guessed = distance_field(whole, 32), distance_field(cut, 32)
    assert closed.missing == 0.0 and 0.0 < guessed.missing < 0.05
    assert closed.values.shape == guessed.values.shape
    differ = (closed.values < 0.0) != (guessed.values < 0.0)
    assert np.count_nonzero(differ) < 0.02 * np.count_nonzero(closed.values < 0.0)
    assert np.all(np.nonzero(differ)[1] <= 5)  # the margin of two samples and three above it: the soles alone
    # the guessed part has a distance that a ramp can use: nowhere does it jump
    for axis in range(3):
        assert np.abs(np.diff(guessed.values, axis=axis)).max() < 2.0 * guessed.spacing


def test_a_mesh_that_is_too_open_is_refused_with_its_edges(tmp_path: Path) -> None:
    vertices, triangles = sphere(rings=12)
    bowl = triangles[vertices[triangles][:, :, 1].max(axis=1) < 0.3]
    surface = read_surface(write_ply(tmp_path / "bowl.ply", vertices, bowl))
    with pytest.raises(ValueError, match=r"bowl.ply: is not watertight.*outline is missing.*24 open edges.*close"):
        distance_field(surface, 24)
    mixed = triangles.copy()
    mixed[::2] = mixed[::2, ::-1]
    with pytest.raises(ValueError, match=r"mixed.ply: (is not watertight|encloses nothing)"):
        distance_field(read_surface(write_ply(tmp_path / "mixed.ply", vertices, mixed)), 24)


def test_sheets_and_plates_too_thin_to_sample_are_refused(tmp_path: Path) -> None:
    wave = np.array([[0, 0, 0], [1, 0, 0.1], [0, 1, 0.1], [1, 1, 0.0]])
    sheet = read_surface(write_ply(tmp_path / "sheet.ply", wave, np.array([[0, 1, 2], [1, 3, 2]])))
    with pytest.raises(ValueError, match=r"sheet.ply: is not watertight.*4 open edges"):
        distance_field(sheet, 24)
    plate = read_surface(write_ply(tmp_path / "plate.ply", CORNERS * [1.0, 1.0, 0.01], TRIANGLES))
    with pytest.raises(ValueError, match=r"plate.ply: encloses nothing at 24 samples.*raise `resolution`"):
        distance_field(plate, 24)


PLY = "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
HUGE = (PLY.format(10**12) + "element face 1\nproperty list uchar int vertex_indices\nend_header\n").encode()


def box_with(index: int, value: float) -> np.ndarray:
    spoilt = CORNERS.copy()
    spoilt[index, 0] = value
    return spoilt


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("empty.ply", b"", "has 0 bytes.*export it again"),
        ("words.obj", b"this is no mesh\n", "words.obj: (is no readable|holds no triangles)"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "points.obj: (is no readable|holds no triangles)"),
        ("bytes.stl", bytes(range(256)) * 3, "bytes.stl: is no readable .stl mesh"),
        ("cut.stl", bytes(80) + struct.pack("<I", 10**9) + bytes(100), "cut.stl: (is no readable|holds no triangles)"),
        ("huge.ply", HUGE, "huge.ply: is no readable .ply mesh"),
        ("none.stl", bytes(84), "none.stl: (is no readable|holds no triangles)"),
        ("index.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 1\nf 1 2 9\n", "index.obj: (is no readable|a triangle names)"),
    ],
)
def test_files_that_are_no_meshes_are_refused(tmp_path: Path, name: str, content: bytes, told: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=told):
        read_surface(tmp_path / name)


def test_too_many_triangles_are_refused_before_they_are_worked_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sixway.sim.bodies.meshes._MOST_FACES", 11)
    with pytest.raises(ValueError, match=r"box.ply: has 12 triangles, more than 11; decimate"):
        read_surface(write_ply(tmp_path / "box.ply", CORNERS, TRIANGLES))


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e35])
@pytest.mark.parametrize("suffix", WRITERS)
def test_vertices_that_are_no_finite_numbers_are_refused(tmp_path: Path, suffix: str, value: float) -> None:
    path = WRITERS[suffix](tmp_path / f"bad{suffix}", box_with(3, value), TRIANGLES)
    with pytest.raises(ValueError, match=f"bad{suffix}: (has vertices that are no finite|is no readable)"):
        read_surface(path)


def test_flat_large_and_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"flat.ply: is flat.*thickness"):
        read_surface(write_ply(tmp_path / "flat.ply", CORNERS * [1.0, 1.0, 0.0], TRIANGLES))
    with pytest.raises(ValueError, match=r"there is no such mesh file"):
        read_surface(tmp_path / "none.ply")
    with (tmp_path / "large.stl").open("wb") as file:
        file.truncate((64 << 20) + 1)
    with pytest.raises(ValueError, match=r"large.stl: has 67108865 bytes.*decimate"):
        read_surface(tmp_path / "large.stl")


def test_no_file_that_a_mesh_names_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "trap.mtl").write_text("newmtl trap\nmap_Kd trap.png\n")
    obj = write_obj(tmp_path / "box.obj", CORNERS, TRIANGLES, head="mtllib trap.mtl\nusemtl trap")
    ply = write_ply(tmp_path / "box.ply", CORNERS, TRIANGLES)
    ply.write_text(ply.read_text().replace("1.0\n", "1.0\ncomment TextureFile trap.mtl\n", 1))
    read_surface(write_stl(tmp_path / "warm.stl", CORNERS, TRIANGLES))  # all modules are loaded by now
    opened, real = [], open
    import builtins
    import io

    def watched(file: object, *args: object, **kwargs: object) -> object:
        opened.append(Path(str(file)).name)
        return real(file, *args, **kwargs)

    monkeypatch.setattr(builtins, "open", watched)
    monkeypatch.setattr(io, "open", watched)
    for path in (obj, ply):
        assert len(read_surface(path).faces) == 12
    assert set(opened) <= {"box.obj", "box.ply"} and opened


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_damaged_file_is_read_or_refused_but_nothing_else(tmp_path: Path, data: st.DataObject) -> None:
    suffix = data.draw(st.sampled_from(list(WRITERS)))
    content = bytearray(WRITERS[suffix](tmp_path / f"whole{suffix}", CORNERS, TRIANGLES).read_bytes())
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    content = content[: data.draw(st.integers(1, len(content)))]
    path = tmp_path / f"damaged{suffix}"
    path.write_bytes(content)
    try:
        surface = read_surface(path)
    except ValueError as error:
        assert str(path) in str(error)
    else:
        assert isinstance(surface, Surface) and np.isfinite(surface.vertices).all()


def test_a_header_that_lies_takes_no_memory(tmp_path: Path) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    (tmp_path / "huge.ply").write_bytes(HUGE)
    with pytest.raises(ValueError):
        read_surface(tmp_path / "huge.ply")
    (tmp_path / "ascii.ply").write_bytes(HUGE.replace(b"binary_little_endian", b"ascii"))
    with pytest.raises(ValueError):
        read_surface(tmp_path / "ascii.ply")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB
