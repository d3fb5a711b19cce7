"""The notebooks run on a tiny run and its data, show the report's numbers and define no metric."""

import json
import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from sixway import evaluate

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
ALL = sorted(NOTEBOOKS.glob("*.ipynb"))


def executed(name: str) -> nbformat.NotebookNode:
    notebook = nbformat.read(NOTEBOOKS / name, as_version=4)
    return NotebookClient(notebook, kernel_name="python3", timeout=240).execute()


def outputs(notebook: nbformat.NotebookNode, kind: str) -> list[str]:
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    return [output.data[kind] for cell in cells for output in cell.outputs if kind in output.get("data", {})]


def stripped(path: Path) -> nbformat.NotebookNode:
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    return notebook


def test_the_evaluation_shows_tables_and_pictures(
    trained_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert evaluate.main([str(trained_run), "--out", str(tmp_path)]) == 0
    monkeypatch.setenv("SIXWAY_REPORT", str(tmp_path))
    notebook = executed("evaluate.ipynb")
    report = json.loads((tmp_path / "report.json").read_text())
    text = "\n".join(outputs(notebook, "text/markdown"))
    for name, summary in report["methods"].items():
        assert f"| {name} |" in text
        maps = summary["psnr"]["maps"]
        assert f"{maps['mean_of_psnr_db']:.2f} ({maps['psnr_of_mean_mse_db']:.2f})" in text
        assert f"{summary['per_map']['back']['mean_of_psnr_db']:.2f}" in text
    assert f"{report['methods']['net']['perceived']['maps_flip']:.4f}" in text
    assert f"{report['ceiling_psnr_db']:.2f}" in text
    assert f"{report['methods']['net']['flicker_ratio']:.3f}" in text
    assert len(outputs(notebook, "image/png")) == 2 + len(report["pictures"])  # two charts


def test_the_dataset_shows_counts_and_pictures(tiny_dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIXWAY_DATA", str(tiny_dataset.folder))
    notebook = executed("dataset.ipynb")
    text = "\n".join(outputs(notebook, "text/markdown"))
    for split, simulation in (("train", "jet"), ("val", "jet_val"), ("test", "jet_test")):
        assert f"| {split} | {simulation} | 24 x 20 | 2 | 4 | 8 |" in text
    assert "a perfect net would score" in text
    assert len(outputs(notebook, "image/png")) == 2 + 3  # cameras, brightness, a picture of each simulation


@pytest.mark.parametrize("path", ALL, ids=lambda path: path.stem)
def test_notebooks_are_kept_without_outputs_and_define_no_metric(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    assert notebook == stripped(path)
    code = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    assert not re.search(r"sixway\.metrics|log10|sklearn|skimage|\*\* ?2", code)


def test_both_notebooks_are_there() -> None:
    assert [path.name for path in ALL] == ["dataset.ipynb", "evaluate.ipynb"]


def test_a_missing_report_says_how_to_make_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIXWAY_REPORT", str(tmp_path))
    with pytest.raises(CellExecutionError, match=r"no report here; run: python -m sixway\.evaluate"):
        executed("evaluate.ipynb")
