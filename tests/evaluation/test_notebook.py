"""The notebook shows a report as it is."""

import json
import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from sixway import evaluate

NOTEBOOK = Path(__file__).parents[2] / "notebooks/report.ipynb"


def executed(report: Path, monkeypatch: pytest.MonkeyPatch) -> nbformat.NotebookNode:
    monkeypatch.setenv("SIXWAY_REPORT", str(report))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    return NotebookClient(notebook, kernel_name="python3", timeout=60).execute()


def outputs(notebook: nbformat.NotebookNode, kind: str) -> list[str]:
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    return [output.data[kind] for cell in cells for output in cell.outputs if kind in output.get("data", {})]


def test_the_notebook_shows_tables_and_sheets(
    trained_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert evaluate.main([str(trained_run), "--out", str(tmp_path)]) == 0
    notebook = executed(tmp_path, monkeypatch)
    report = json.loads((tmp_path / "report.json").read_text())
    psnr, per_map, perceived = outputs(notebook, "text/html")
    for name, summary in report["methods"].items():
        assert name in psnr and name in per_map
        maps = summary["psnr"]["maps"]
        assert f"{maps['psnr_of_mean_mse_db']:.2f} ({maps['mean_of_psnr_db']:.2f})" in psnr
        assert f"{summary['per_map_psnr_db']['back']:.2f}" in per_map
    assert f"{report['methods']['net']['perceived']['maps_flip']:.4f}" in perceived
    assert f"{report['ceiling_psnr_db']:.2f} dB" in outputs(notebook, "text/markdown")[0]
    sheets = outputs(notebook, "image/png")
    assert len(sheets) == len(list(tmp_path.glob("contact_sheet_*.png"))) >= 2
    assert nbformat.read(NOTEBOOK, as_version=4) == stripped()  # running it changed no file


def stripped() -> nbformat.NotebookNode:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    return notebook


def test_the_notebook_is_kept_without_outputs_and_defines_no_metric() -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert notebook == stripped()
    code = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    imported = set(re.findall(r"^(?:from|import) (\w+)", code, flags=re.MULTILINE))
    assert imported == {"html", "json", "os", "pathlib", "IPython"}  # nothing to compute with


def test_a_missing_report_says_how_to_make_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(CellExecutionError, match=r"no report here; run: python -m sixway\.evaluate"):
        executed(tmp_path, monkeypatch)
