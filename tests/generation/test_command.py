"""What the command says to wrong input: one message, a status, nothing half-made."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sixway.generation.jobs import Shard

Generate = Callable[..., int]


@pytest.mark.parametrize("text", ["2/2", "-1/2", "a/b", "1", "1/0", "1/2/3", ""])
def test_a_wrong_shard_is_refused_with_an_example(text: str, generate: Generate, tmp_path: Path, capsys: Any) -> None:
    with pytest.raises(ValueError, match="such as 0/4"):
        Shard.parse(text)
    assert generate(tmp_path / "data", f"--shard={text}") == 2
    assert "is not I/N with 0 <= I < N, such as 0/4" in capsys.readouterr().err
    assert not (tmp_path / "data").exists()


def test_shards_share_out_everything_once() -> None:
    items = list(range(11))
    shares = [Shard(i, 4).of(items) for i in range(4)]
    assert sorted(item for share in shares for item in share) == items
    assert max(map(len, shares)) - min(map(len, shares)) <= 1


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("--workers", "0"), "--workers 0 must be at least 1"),
        (("medium.extinction_per_m=-1",), "medium.extinction_per_m"),
        (("guides.six.lihgts=[front]",), "did you mean 'lights'"),
        (("pairs_per_simulation",), "not of the form"),
    ],
)
def test_wrong_arguments_give_status_2(
    generate: Generate, tmp_path: Path, capsys: Any, more: tuple[str, ...], told: str
) -> None:
    assert generate(tmp_path / "data", *more) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ") and told in line
    assert not (tmp_path / "data").exists()


def test_no_such_config(generate: Generate, tmp_path: Path, capsys: Any) -> None:
    assert generate(tmp_path / "data", config=tmp_path / "none.yaml") == 2
    assert "none.yaml" in capsys.readouterr().err


@pytest.mark.parametrize("stage", ["march_guides", "trace_references"])
def test_a_stage_without_densities_names_the_stage_before(
    generate: Generate, tmp_path: Path, capsys: Any, stage: str
) -> None:
    assert generate(tmp_path / "data", only=(stage,)) == 2
    assert "frame_0000.npz: this density frame is missing; run the simulate stage first" in capsys.readouterr().err


def test_packing_too_early_names_the_missing_frame(own_copy: Path, generate: Generate, capsys: Any) -> None:
    path = next(own_copy.glob("target/jet_test/*/*/frame_0005.exr"))
    path.unlink()
    assert generate(own_copy, only=("pack",)) == 2
    assert f"{path}: this frame is missing; run the generation command again" in capsys.readouterr().err


@pytest.mark.parametrize("bad", [np.nan, -1.0])
def test_a_bad_density_frame_is_refused_by_name(own_copy: Path, generate: Generate, capsys: Any, bad: float) -> None:
    path = next(own_copy.glob("density/jet/*/frame_0001.npz"))
    arrays = dict(np.load(path))
    arrays["density"][3, 3, 3] = bad
    np.savez(path, **arrays)
    for stage, layer in (("march_guides", "guide_six"), ("trace_references", "target")):
        for made in own_copy.glob(f"{layer}/jet/*/*/frame_0001.exr"):
            made.unlink()
        assert generate(own_copy, only=(stage,)) == 2
        told = capsys.readouterr().err
        assert str(path) in told and "density holds 1" in told
    assert generate(own_copy, only=("verify",)) == 1
    assert f"{path}: its hash differs from the recorded one" in capsys.readouterr().err


def test_a_shard_of_every_stage_at_once_is_refused(generate: Generate, tmp_path: Path, capsys: Any) -> None:
    """Frames are shared out anew in each stage, so one job may lack what another one makes."""
    assert generate(tmp_path / "data", "--shard", "0/2") == 2
    assert "use its own driver" in capsys.readouterr().err
    assert not (tmp_path / "data").exists()
