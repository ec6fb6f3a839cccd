"""The notebooks run from the first cell to the last, and are kept without results."""

import gzip
import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from places import EXAMPLES

FLIGHT = EXAMPLES / "recorded_flight.ipynb"


def cells(notebook: Path, kind: str) -> list[dict[str, Any]]:
    book = json.loads(notebook.read_text(encoding="utf-8"))
    assert (book["nbformat"], book["nbformat_minor"]) == (4, 5)
    return [cell for cell in book["cells"] if cell["cell_type"] == kind]


def execute(notebook: Path) -> dict[str, Any]:
    """Run the code of a notebook in one namespace, and return it."""
    names: dict[str, Any] = {}
    for cell in cells(notebook, "code"):
        exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
    return names


@pytest.mark.parametrize("notebook", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda one: one.name)
def test_is_kept_without_results(notebook: Path) -> None:
    for cell in cells(notebook, "code"):
        assert cell["outputs"] == []
        assert cell["execution_count"] is None


def circles(path: Path) -> None:
    """Write a recording like that of the library traffic: circles, with noise of 20 m."""
    time = np.arange(0.0, 1500.0, 4.0)
    random, angle = np.random.default_rng(1), time / 60.0
    place = 3000.0 * np.column_stack([np.sin(angle), np.cos(angle)])
    place += 20.0 * random.standard_normal(place.shape)
    table = {
        "timestamp": (1e3 * (1.5e9 + time)).tolist(),
        "latitude": (30.0 + place[:, 1] / 110_850.0).tolist(),
        "longitude": (-95.0 + place[:, 0] / 96_490.0).tolist(),
        "groundspeed": np.round(np.full(len(time), 50.0 * 3600 / 1852)).tolist(),
    }
    rows = [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
    path.parent.mkdir(parents=True)
    path.write_bytes(gzip.compress(json.dumps(rows).encode()))


@pytest.mark.parametrize("recording", ["of traffic", "circles"])
def test_a_recorded_flight(recording: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the recording where traffic is installed, and with another one everywhere."""
    pytest.importorskip("pandas")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    if recording == "circles":
        circles(tmp_path / "traffic/data/samples/featured/texas_longhorn.json.gz")
        (tmp_path / "traffic/__init__.py").touch()
        monkeypatch.syspath_prepend(tmp_path)
    elif importlib.util.find_spec("traffic") is None:
        pytest.skip("traffic is not installed")
    names = execute(FLIGHT)
    pyplot.close("all")
    assert names["within"] > 0.9
    assert len(names["path"]) == len(names["seen"]) > 300
    assert names["path"]["smoothing_outlier"].sum() < 5
