"""Tables say what the reports say, each number in the row and column that its names tell."""

import pytest

from sixway.core.conventions import DIRECTIONS
from sixway.evaluation.tables import Table, axis_table, axis_tables, both, fire_table, main_table, map_table, time_table


def psnr(db: float | None, *, frames: int = 4) -> dict:
    mse = 0.0 if db is None else 10.0 ** (-db / 10.0)
    return {
        "mean_of_psnr_db": db,
        "psnr_of_mean_mse_db": None if db is None else db - 0.5,
        "lowest_db": None if db is None else db - 1.0,
        "highest_db": None if db is None else db + 1.0,
        "frames": frames,
        "empty": 0,
        "mse": mse,
    }


def summary(db: float, *, fire: float | None = None) -> dict:
    kinds = ("maps", "maps_masked", "shaded", "shaded_masked", "alpha")
    return {
        "frames": 4,
        "psnr": {kind: psnr(db + i) for i, kind in enumerate(kinds)},
        "emissive": None if fire is None else psnr(fire, frames=2),
        "per_map": {
            name: psnr(db + i) | {"masked": psnr(db - 5.0 + i), "ssim": 0.9, "flip": 0.1}
            for i, name in enumerate(DIRECTIONS)
        },
        "perceived": {
            "maps_ssim": 0.98,
            "shaded_ssim": 0.97,
            "maps_flip": 0.03,
            "shaded_flip": 0.04,
            "temporal_error": 0.02,
            "temporal_error_of_truth": 0.016,
            "flicker_of_error": 0.004,
        },
        "flicker_ratio": 1.25,
    }


def report(db: float, **options: float) -> dict:
    def condition(label: str, db: float, apart: float | None = None) -> dict:
        row = {"label": label, "frames": 4, "coverage": 0.25, "methods": {"net": {"psnr": summary(db)["psnr"]}}}
        return row if apart is None else row | {"apart_db": apart}

    return {
        "split": "test",
        "mask_alpha": 0.02,
        "coverage": 0.25,
        "ceiling_psnr_db": 55.5,
        "headline": {"frames": 4, "width_px": 128, "height_px": 96, "density_scale": 1.0, "simulations": ["jet"]},
        "lights": [[0, 0, 1]] * 16,
        "perceived": {"every": 5, "lights": [0, 4]},
        "methods": {"net": summary(db, **options), "linear fit": summary(db - 10.0)},
        "breakdown": {
            "simulation": [condition("jet", db)],
            "view": [condition("yaw 0", db)],
            "size": [condition("128 x 96", db, 0.0), condition("256 x 192", db - 1.5, -1.5)],
            "density": [condition("x1", db, 0.0)],
            "coverage": [condition("the whole split", db)],
        },
    }


def cells(table: Table, row: str) -> dict[str, str]:
    found = next(line for line in table.rows if line[0] == row)
    return dict(zip(table.head, found, strict=True))


def test_the_main_table_has_every_metric_under_its_name() -> None:
    table = main_table({"rich": report(40.0)})
    net = cells(table, "net")
    assert net["six maps"] == "40.00 (39.50)" and net["max / min"] == "41.00 / 39.00" and net["MSE"] == "0.000100"
    assert net["smoke alone"] == "41.00 (40.50)" and net["shaded"] == "42.00 (41.50)"
    assert net["shaded, smoke"] == "43.00 (42.50)" and net["alpha"] == "44.00 (43.50)"
    assert net["SSIM maps / shaded"] == "0.9800 / 0.9700" and net["FLIP maps / shaded"] == "0.0300 / 0.0400"
    assert [row[0] for row in table.rows] == ["net", "linear fit", "ceiling (noise of the references)"]
    assert table.rows[-1][1] == "55.50"
    assert "128 x 96" in table.note and "16 fixed white lights" in table.note and "jet" in table.note


def test_two_runs_stand_in_one_table_nets_first() -> None:
    table = main_table({"rich": report(40.0), "paper": report(30.0)})
    assert [row[0] for row in table.rows][:4] == ["rich: net", "paper: net", "rich: linear fit", "paper: linear fit"]
    assert cells(table, "paper: net")["six maps"] == "30.00 (29.50)"


def test_maps_are_in_their_columns() -> None:
    table = map_table({"rich": report(40.0)})
    for i, name in enumerate(DIRECTIONS):
        assert cells(table, "net")[name] == f"{40 + i:.2f} ({39.5 + i:.2f})"
        assert cells(table, "net, smoke alone")[name] == f"{35 + i:.2f} ({34.5 + i:.2f})"
    assert cells(table, "net, FLIP")["back"] == "0.1000"


def test_conditions_go_down_and_runs_across() -> None:
    one = axis_table({"rich": report(40.0)}, "size", title="", note="")
    assert cells(one, "256 x 192") == {
        "": "256 x 192",
        "frames": "4",
        "coverage": "25.0%",
        "net": "38.50 (38.00)",
        "linear fit": "",  # not asked there
        "net, shaded": "40.50 (40.00)",
        "net, apart": "-1.50",
    }
    lone = report(30.0)
    lone["breakdown"]["size"] = lone["breakdown"]["size"][:1]
    two = axis_table({"rich": report(40.0), "paper": lone}, "size", title="", note="")
    row = cells(two, "256 x 192")
    assert row["rich: net"] == "38.50 (38.00)" and row["paper: net"] == row["paper: net, apart"] == ""
    assert len(axis_tables({"rich": report(40.0)})) == 5


def test_fire_has_a_table_where_it_burns() -> None:
    assert fire_table({"rich": report(40.0)}) is None
    table = fire_table({"rich": report(40.0, fire=33.0)})
    assert table is not None and table.rows == (("net", "33.00 (32.50)", "0.000501", "2"),)


def test_time_tells_the_ratio() -> None:
    row = cells(time_table({"rich": report(40.0)}), "net")
    assert (row["temporal error"], row["of the references"]) == ("0.02000", "0.01600")
    assert row["ratio of the first two"] == "1.250"


@pytest.mark.parametrize(("value", "text"), [(psnr(None), "inf (inf)"), (psnr(1.0) | {"empty": 4}, "no frame")])
def test_what_is_no_number_is_said(value: dict, text: str) -> None:
    assert both(value) == text


def test_markdown_keeps_its_columns() -> None:
    table = Table(title="", head=("a", "b"), rows=(("x|y", "1"),))
    assert table.markdown() == "| a | b |\n| --- | --- |\n| x\\|y | 1 |"
