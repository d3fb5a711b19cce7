"""Metrics against closed forms, against skimage, and against bad input."""

import math

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from sixway.metrics.flip import flip, flip_picture
from sixway.metrics.images import check_mask, check_pair
from sixway.metrics.psnr import FrameError, mse, psnr, summarise_psnr
from sixway.metrics.ssim import ssim
from sixway.metrics.temporal import temporal_error, warp_previous

Images = tuple[np.ndarray, np.ndarray]

REFUSED = (ValueError, TypeError)
"""Wrong shapes and dtypes: where annotations are checked at run time, that TypeError comes first."""


@pytest.fixture
def images(rng: np.random.Generator) -> Images:
    """A predicted and a reference image in [0, 1], [24, 30, 3] float32."""
    reference = rng.random((24, 30, 3), dtype=np.float32)
    noise = 0.05 * rng.standard_normal((24, 30, 3), dtype=np.float32)
    return np.clip(reference + noise, 0.0, 1.0), reference


def test_psnr_of_a_constant_error() -> None:
    grey = np.full((5, 6, 8), 0.5, np.float32)
    assert psnr(predicted=grey + np.float32(0.1), reference=grey) == pytest.approx(20.0, abs=1e-4)
    assert psnr(predicted=grey, reference=grey) == math.inf


def test_psnr_is_skimage_psnr(images: Images) -> None:
    predicted, reference = images
    expected = peak_signal_noise_ratio(reference, predicted, data_range=1.0)
    assert psnr(predicted=predicted, reference=reference) == pytest.approx(expected, rel=1e-5)


def test_a_mask_counts_its_own_pixels() -> None:
    reference = np.zeros((4, 8, 1), np.float32)
    predicted = reference.copy()
    predicted[:, :2] = 0.2
    mask = np.zeros((4, 8), bool)
    mask[:, :4] = True
    error = mse(predicted=predicted, reference=reference, mask=mask)
    assert error.mse == pytest.approx(0.02) and error.coverage == 0.5
    nothing = mse(predicted=predicted, reference=reference, mask=np.zeros_like(mask))
    assert math.isnan(nothing.mse) and nothing.coverage == 0.0


def test_a_summary_gives_both_averages_and_counts_the_rest() -> None:
    errors = [
        FrameError(mse=1e-2, coverage=1.0),
        FrameError(mse=1e-4, coverage=0.5),
        FrameError(mse=0.0, coverage=0.5),
        FrameError(mse=math.nan, coverage=0.0),
    ]
    summary = summarise_psnr(errors)
    assert summary.mean_of_psnr_db == pytest.approx(30.0)
    assert summary.psnr_of_mean_mse_db == pytest.approx(-10.0 * math.log10((1e-2 + 1e-4) / 3.0))
    assert (summary.frames, summary.perfect, summary.empty) == (4, 1, 1)
    assert summary.lowest_db == pytest.approx(20.0) and summary.highest_db == math.inf
    assert summary.mean_coverage == pytest.approx(0.5)


def test_a_summary_of_perfect_or_empty_frames() -> None:
    perfect = summarise_psnr([FrameError(mse=0.0, coverage=1.0)])
    assert perfect.mean_of_psnr_db == perfect.psnr_of_mean_mse_db == math.inf
    empty = summarise_psnr([FrameError(mse=math.nan, coverage=0.0)])
    assert math.isnan(empty.mean_of_psnr_db) and math.isnan(empty.psnr_of_mean_mse_db)
    with pytest.raises(ValueError, match="at least one"):
        summarise_psnr([])


def test_ssim_is_skimage_ssim(images: Images) -> None:
    predicted, reference = images
    expected = structural_similarity(
        reference,
        predicted,
        data_range=1.0,
        channel_axis=-1,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
    )
    assert ssim(predicted=predicted, reference=reference) == pytest.approx(float(expected), abs=1e-4)
    everywhere = ssim(predicted=predicted, reference=reference, mask=np.ones((24, 30), bool))
    assert everywhere == pytest.approx(ssim(predicted=predicted, reference=reference))
    assert ssim(predicted=reference, reference=reference) == pytest.approx(1.0)


def test_ssim_needs_room_for_its_window() -> None:
    small = np.zeros((10, 40, 3), np.float32)
    with pytest.raises(ValueError, match="11 x 11"):
        ssim(predicted=small, reference=small)


def test_flip_of_equal_images_is_zero(images: Images) -> None:
    score = flip(predicted=images[1], reference=images[1])
    assert score.mean == 0.0 and score.error_map.shape == (24, 30) and score.error_map.max() == 0.0


def test_flip_is_the_mean_of_its_map(images: Images) -> None:
    score = flip(predicted=images[0], reference=images[1])
    assert 0.0 < score.mean < 1.0
    assert score.mean == pytest.approx(float(score.error_map.mean()), rel=1e-4)


def test_flip_of_black_and_white_is_nearly_one() -> None:
    black = np.zeros((32, 32, 3), np.float32)
    assert flip(predicted=black, reference=black + 1.0).mean > 0.9


def test_flip_of_grey_is_flip_of_equal_colours(images: Images) -> None:
    grey = [image[..., :1] for image in images]
    colour = [np.repeat(image, 3, axis=-1) for image in grey]
    assert flip(predicted=grey[0], reference=grey[1]).mean == flip(predicted=colour[0], reference=colour[1]).mean


def test_flip_picture_is_coloured(images: Images) -> None:
    picture = flip_picture(predicted=images[0], reference=images[1])
    assert picture.shape == (24, 30, 3) and 0.0 <= picture.min() and picture.max() <= 1.0


def test_flip_refuses_what_its_package_would_score(images: Images) -> None:
    predicted, reference = images
    wrong = {
        "float32": (predicted.astype(np.float64), reference),
        "0, 1": (predicted + 2.0, reference),
        "channels": (predicted[..., :2], reference[..., :2]),
    }
    for rule, (first, second) in wrong.items():
        with pytest.raises(ValueError, match=rule):
            flip(predicted=first, reference=second)


@pytest.mark.parametrize("metric", [mse, psnr, ssim, flip])
def test_nan_and_other_shapes_raise(metric, images: Images) -> None:  # type: ignore[no-untyped-def]
    predicted, reference = images
    broken = predicted.copy()
    broken[3, 4, 1] = np.nan
    with pytest.raises(ValueError, match="1 NaN"):
        metric(predicted=broken, reference=reference)
    with pytest.raises(REFUSED):
        metric(predicted=predicted[:-1], reference=reference)


def test_the_door_names_what_is_wrong(images: Images) -> None:
    with pytest.raises(ValueError, match="one shape"):
        check_pair(images[0][:-1], images[1])
    with pytest.raises(ValueError, match="at least one pixel"):
        check_pair(images[0][:0], images[1])


def test_a_mask_of_numbers_or_of_another_shape_raises(images: Images) -> None:
    with pytest.raises(ValueError, match="boolean"):
        check_mask(np.ones((24, 30)), images[1])
    with pytest.raises(ValueError, match="boolean"):
        check_mask(np.ones((5, 5), bool), images[1])


def test_what_moves_with_the_flow_has_no_temporal_error(rng: np.random.Generator) -> None:
    canvas = rng.random((20, 26, 2))
    previous, current = canvas[2:18, 3:23], canvas[1:17, 1:21]  # moved 2 px right and 1 px down
    flow = np.broadcast_to(np.array([2.0, 1.0]), (16, 20, 2)).copy()
    error = temporal_error(current=current, previous=previous, flow=flow)
    assert error.mean_abs == pytest.approx(0.0, abs=1e-12)
    assert error.coverage == pytest.approx(15 * 18 / (16 * 20))
    assert temporal_error(current=current, previous=previous, flow=0.0 * flow).mean_abs > 0.1


def test_half_a_pixel_is_interpolated() -> None:
    ramp = np.tile(np.arange(8.0)[None, :, None], (4, 1, 1))
    flow = np.zeros((4, 8, 2))
    flow[..., 0] = 0.5
    warped, known = warp_previous(ramp, flow)
    np.testing.assert_allclose(warped[:, 1:, 0], ramp[:, 1:, 0] - 0.5)
    assert not known[:, 0].any() and known[:, 1:].all()


def test_temporal_error_counts_the_mask() -> None:
    previous, current = np.zeros((4, 6, 1)), np.full((4, 6, 1), 0.25)
    mask = np.zeros((4, 6), bool)
    mask[:, :3] = True
    error = temporal_error(current=current, previous=previous, flow=np.zeros((4, 6, 2)), mask=mask)
    assert (error.mean_abs, error.coverage) == (0.25, 0.5)
    with pytest.raises(REFUSED):
        temporal_error(current=current, previous=previous, flow=np.zeros((4, 6, 3)))
