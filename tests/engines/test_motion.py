"""Motion vectors: closed forms for the blend, followed flows, coding, and books that carry them."""

import json
from pathlib import Path

import numpy as np
import pytest

from sixway.core.alpha import dilated
from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.exr import read_exr, write_exr
from sixway.engines.book import read_book
from sixway.engines.flipbook import decimate, every_frame, loop, retime
from sixway.engines.motion import (
    FLOW_CHANNELS,
    MotionVectors,
    blend,
    carried_outwards,
    decoded,
    motion_vectors,
    sampled,
    travelled,
    with_motion,
)
from sixway.engines.packing import PACKINGS, parse_packing
from sixway.engines.texture import read_picture
from sixway.pack import estimated_flows
from sixway.pack import main as pack_main
from sixway.unpack import main as unpack_main

HEIGHT, WIDTH = 24, 32


def blob(x: float, y: float) -> np.ndarray:
    """A Gaussian at a place [px], [h, w, 1]."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    return np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 18.0, dtype=np.float32)[..., None]


def even_flow(right: float, down: float) -> np.ndarray:
    return np.broadcast_to(np.array([right, down], np.float32), (HEIGHT, WIDTH, 2)).copy()


def test_sampling_reads_to_the_right_and_down() -> None:
    picture = np.arange(12, dtype=np.float32).reshape(3, 4, 1)
    got = sampled(picture, np.broadcast_to(np.array([1.0, 1.0], np.float32), (3, 4, 2)))
    np.testing.assert_array_equal(got[..., 0], [[5, 6, 7, 7], [9, 10, 11, 11], [9, 10, 11, 11]])
    half = sampled(picture, np.broadcast_to(np.array([0.5, 0.0], np.float32), (3, 4, 2)))
    np.testing.assert_array_equal(half[0, :, 0], [0.5, 1.5, 2.5, 3.0])


@pytest.mark.parametrize("part", [0.0, 0.25, 0.5, 1.0])
def test_a_moving_blob_is_found_on_its_way(part: float) -> None:
    """Where linear blending shows two blobs, motion vectors show one, in the right place."""
    flow = even_flow(8.0, -4.0)
    first, second, between = blob(10.0, 14.0), blob(18.0, 10.0), blob(10.0 + 8.0 * part, 14.0 - 4.0 * part)
    got = blend(first, second, flow, flow, part)
    np.testing.assert_allclose(got, between, atol=0.02)
    linear = (1.0 - part) * first + part * second
    if 0.0 < part < 1.0:
        assert np.abs(linear - between).max() > 0.2
    with pytest.raises(ValueError, match="between 0 and 1"):
        blend(first, second, flow, flow, 1.5)


def test_flows_are_followed_frame_by_frame() -> None:
    """In a flow that doubles x every frame, smoke at x is at 4 x two frames later and at x / 2 one before."""
    columns = np.arange(WIDTH, dtype=np.float32)
    stretching = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    stretching[..., 0] = columns
    flows = [stretching] * 4
    np.testing.assert_allclose(travelled(flows, 0, 2.0)[0, :7, 0], 3.0 * columns[:7], atol=1e-4)
    np.testing.assert_allclose(travelled(flows, 0, 0.5)[0, :, 0], 0.5 * columns, atol=1e-4)
    changing = [even_flow(float(number), 0.0) for number in range(4)]
    assert travelled(changing, 1, 2.0)[0, 0, 0] == 3.0  # 1 + 2
    assert travelled(changing, 1, 5.0)[0, 0, 0] == 1 + 2 + 3 + 3 + 3  # the last goes on
    assert travelled(changing, 3, -2.0)[0, 0, 0] == -3.0  # -(2 + 1)
    assert travelled(changing, 0, -1.0)[0, 0, 0] == 0.0


@pytest.mark.parametrize("y", ["up", "down"])
def test_stored_values_keep_sign_scale_and_stillness(y: str) -> None:
    flows = np.stack([even_flow(3.2, 1.2)] * 4)
    flows[:, 0, 0] = 0.0
    flows[:, 1, 1] = (-1.6, 0.0)
    alphas = np.ones(flows.shape[:3], np.float32)
    vectors = motion_vectors(every_frame(4), flows, alphas, span=1.0, y=y)
    assert vectors.scale == pytest.approx(3.2 / WIDTH) and vectors.coded.min() >= 0.0 and vectors.coded.max() <= 1.0
    still = vectors.coded[0, 0, 0]
    np.testing.assert_array_equal(still, [0.5, 0.5])
    stored = 0.5 + 0.5 * (1.2 / HEIGHT) / vectors.scale * (-1.0 if y == "up" else 1.0)
    np.testing.assert_allclose(vectors.coded[2, 10, 10], [1.0, stored], atol=1e-6)
    np.testing.assert_allclose(decoded(vectors.coded, scale=vectors.scale, y=y)[0], flows[0], atol=1e-5)


def test_motion_is_carried_beyond_the_edge_of_the_smoke() -> None:
    flows, alphas = np.zeros((2, HEIGHT, WIDTH, 2), np.float32), np.zeros((2, HEIGHT, WIDTH), np.float32)
    flows[:, 8:16, 8:16], alphas[:, 8:16, 8:16] = (2.0, 0.0), 1.0
    flows[:, 20, 20], alphas[:, 20, 20] = (500.0, 0.0), 0.001  # too thin to be seen
    vectors = motion_vectors(every_frame(2), flows, alphas, span=1.0, y="down")
    np.testing.assert_allclose(vectors.coded[..., 0], 1.0)
    assert vectors.scale == pytest.approx(2.0 / WIDTH)


def test_carried_motion_is_smooth_and_what_is_known_stays() -> None:
    known = np.zeros((32, 32), bool)
    known[10:20, 10:20] = True
    flow = np.zeros((32, 32, 2), np.float32)
    flow[10:20, 10:15], flow[10:20, 15:20] = (-1.0, 0.0), (1.0, 0.0)
    carried = carried_outwards(flow, known)
    np.testing.assert_array_equal(carried[known], flow[known])

    def steepest(field: np.ndarray) -> float:  # over the rows below the smoke
        return float(np.abs(np.diff(field[22:, :, 0], axis=1)).max())

    assert steepest(carried) < 0.4 * steepest(dilated(flow, known))
    assert carried[15, 8, 0] < -0.3 and carried[15, 21, 0] > 0.3


def test_plans_lengthen_and_mix_the_motion() -> None:
    flows = np.stack([even_flow(1.0, 0.0)] * 8)
    alphas = np.ones(flows.shape[:3], np.float32)

    def px(plan, span: float) -> float:
        vectors = motion_vectors(plan, flows, alphas, span=span, y="down")
        return float(decoded(vectors.coded, scale=vectors.scale, y="down")[1, 5, 5, 0])

    assert px(decimate(every_frame(8), 4), 4.0) == pytest.approx(4.0, rel=1e-5)
    assert px(loop(every_frame(8), 3), 1.0) == pytest.approx(1.0, rel=1e-5)
    assert px(retime(every_frame(8), 4), 7.0 / 4.0) == pytest.approx(1.75, rel=1e-5)
    with pytest.raises(ValueError, match="more than 0"):
        px(every_frame(8), 0.0)
    with pytest.raises(ValueError, match="NaN"):
        motion_vectors(every_frame(8), flows * np.nan, alphas, span=1.0, y="up")


def test_no_motion_at_all_is_half_everywhere() -> None:
    nothing = np.zeros((2, 4, 4, 2), np.float32)
    vectors = motion_vectors(every_frame(2), nothing, nothing[..., 0], span=1.0, y="up")
    assert (vectors.coded == 0.5).all() and vectors.scale == 1.0


def test_a_packing_gets_a_texture_for_motion_only_if_it_needs_one() -> None:
    assert [texture.suffix for texture in with_motion(PACKINGS["unity"]).textures] == ["RTBA", "LBFE", "MV"]
    assert with_motion(PACKINGS["unreal_4way"]) is PACKINGS["unreal_4way"]
    with pytest.raises(ValueError, match="free mapping, such as '(.*)'") as refused:
        with_motion(PACKINGS["paradox_stacked"])
    advised = str(refused.value).split("'")[1]
    assert with_motion(parse_packing(advised)) == parse_packing(advised)


@pytest.fixture
def maps(tmp_path: Path) -> Path:
    """Eight frames of a blob that goes (+1, -0.5) px a frame, with that flow in their layers."""
    for number in range(8):
        image = np.repeat(blob(8.0 + number, 14.0 - 0.5 * number), len(LIGHTMAP_CHANNELS), axis=-1)
        frame = np.concatenate([0.8 * image, even_flow(1.0, -0.5)], axis=-1)
        write_exr(tmp_path / f"maps/frame_{number:04d}.exr", frame, (*LIGHTMAP_CHANNELS, *FLOW_CHANNELS))
    return tmp_path / "maps"


@pytest.mark.parametrize(("packing", "kind", "step"), [("unity", "png", 255), ("unreal_4way", "exr", 2048)])
def test_books_carry_motion_and_give_it_back(packing: str, kind: str, step: int, maps: Path, tmp_path: Path) -> None:
    arguments = f"--out {tmp_path}/a --packing {packing} --format {kind} --every 2 --motion layers --motion-y down"
    assert pack_main([str(maps), *arguments.split()]) == 0
    said = json.loads((tmp_path / "a.json").read_text())
    scale = said["motion"]["scale"]
    assert said["motion"]["y"] == "down" and scale == pytest.approx(2.0 / WIDTH)
    assert "uv - t v_A" in said["motion"]["meaning"]
    picture = read_picture(tmp_path / f"a_{'MV.png' if packing == 'unity' else 'MEA.exr'}").values[0]
    shown = 2.0 * picture[HEIGHT // 2, WIDTH // 2, :2] - 1.0  # as a shader reads it
    np.testing.assert_allclose(shown * scale, [2.0 / WIDTH, -1.0 / HEIGHT], atol=2.0 * scale / step)
    book = read_book(tmp_path / "a.json")
    index = [book.channels.index(name) for name in FLOW_CHANNELS]
    np.testing.assert_allclose(book.frames[1, 12, 16, index], [2.0, -1.0], atol=2.0 * scale * WIDTH / step)
    assert unpack_main([f"{tmp_path}/a.json", "--out", f"{tmp_path}/back"]) == 0
    back = read_exr(tmp_path / "back/frame_0002.exr", FLOW_CHANNELS)
    np.testing.assert_allclose(back[12, 16], [2.0, -1.0], atol=2.0 * scale * WIDTH / step)


def test_estimated_motion_is_near_the_true_one(maps: Path, tmp_path: Path) -> None:
    assert pack_main([str(maps), *f"--out {tmp_path}/e --format exr --motion estimate --motion-y down".split()]) == 0
    book = read_book(tmp_path / "e.json")
    flow = book.frames[..., [book.channels.index(name) for name in FLOW_CHANNELS]]
    thick = book.frames[..., book.channels.index("alpha")] > 0.3
    np.testing.assert_allclose(flow[2:6][thick[2:6]].mean(0), [1.0, -0.5], atol=0.1)
    one = estimated_flows(1, lambda number: np.ones((8, 8, 8), np.float32), LIGHTMAP_CHANNELS)
    assert (one == 0.0).all() and one.shape == (1, 8, 8, 2)


def test_a_missing_layer_or_place_is_told(maps: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_exr(maps / "frame_0005.exr", np.zeros((HEIGHT, WIDTH, 8), np.float32), LIGHTMAP_CHANNELS)
    out = ["--out", f"{tmp_path}/x"]
    assert pack_main([str(maps), *out, "--motion", "layers"]) == 2
    error = capsys.readouterr().err
    assert "frame_0005.exr" in error and "--motion" in error and "estimate" in error
    assert pack_main([str(maps), *out, "--motion", "layers", "--packing", "paradox_stacked"]) == 2
    assert "free mapping" in capsys.readouterr().err
    assert not list(tmp_path.glob("x*"))


def test_sidecars_that_promise_motion_without_a_texture_are_refused(maps: Path, tmp_path: Path) -> None:
    assert pack_main([str(maps), "--out", f"{tmp_path}/s", "--format", "exr"]) == 0
    path = tmp_path / "s.json"
    said = json.loads(path.read_text())
    assert said["motion"] is None
    said["motion"] = {"scale": 0.1, "y": "up"}
    path.write_text(json.dumps(said))
    with pytest.raises(ValueError, match="no texture holds"):
        read_book(path)
    said["motion"] = {"scale": 0.1, "y": "left"}
    path.write_text(json.dumps(said))
    with pytest.raises(ValueError, match="motion"):
        read_book(path)


def test_vectors_must_fit_the_book(maps: Path) -> None:
    from sixway.engines.book import BookStyle, write_book

    style = BookStyle(packing=with_motion(PACKINGS["unity"]), kind="exr", grid=None)
    wrong = MotionVectors(coded=np.full((2, 4, 4, 2), 0.5, np.float32), scale=1.0, y="up")
    with pytest.raises(ValueError, match="do not fit"):
        write_book(
            maps / "x",
            style,
            plan=every_frame(3),
            channels=LIGHTMAP_CHANNELS,
            shape_px=(4, 4),
            read=lambda number: np.zeros((4, 4, 8), np.float32),
            motion=wrong,
        )
