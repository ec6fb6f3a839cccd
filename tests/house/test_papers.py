"""What the page on the papers claims, by computing it, or by the tables that it links to."""

import re
from pathlib import Path

import numpy as np
import pytest
from checks import covariances

from tertia import weights

DOCS = Path(__file__).parents[2] / "docs"
PAPERS = (DOCS / "papers.md").read_text(encoding="utf-8")


def table(page: str, name: str) -> list[list[str]]:
    """Return the cells of a table of a page, without its head."""
    text = (DOCS / page).read_text(encoding="utf-8")
    found = re.search(rf"<!-- table: {name} -->\n(.*?)\n<!-- end -->", text, re.S)
    assert found is not None
    rows = [line.strip("| ").split(" | ") for line in found[1].splitlines() if line[:1] == "|"]
    return rows[2:]


def test_the_divisor_of_3_is_harmless_as_the_paper_linearises() -> None:
    n, m = 10, 2
    true = covariances(m, 2, seed=1)
    right = weights.weight_covariance(true, n, convention="known-mean")
    read_at_sigma = weights.weight_covariance(true, n, convention="paper")
    np.testing.assert_allclose(read_at_sigma, (n / (n - 1)) ** 2 * right, rtol=1e-12)
    assert (n / (n - 1)) ** 2 == pytest.approx(1.23, abs=0.005)
    # about the mean of (3), which is n / (n - 1) Σ
    p = weights.jacobian(n / (n - 1) * true)
    factor = weights.covariance_factor(n, "paper")
    centred = p @ weights.covariance_of_covariance(true, factor) @ np.swapaxes(p, -1, -2)
    np.testing.assert_allclose(centred.sum(axis=0), right, rtol=1e-12, atol=1e-15)
    assert "ratio 1.000" in PAPERS
    assert "23 % at n = 10" in PAPERS


def test_what_is_said_of_the_window_is_in_its_tables() -> None:
    rows = [row for row in table("tracker-motion.md", "conforming") if row[0].endswith(" window")]
    assert len(rows) == 3
    lost, ratio, nees = ({float(row[k].rstrip("%")) for row in rows} for k in (9, 2, 8))
    assert lost == {0.0}
    assert (min(ratio), max(ratio)) == (1.23, 1.27)
    assert (min(nees), max(nees)) == (1.60, 1.81)
    *fixed, by_scan = table("tracker-paper.md", "guards")
    cells = [cell.split(", ") for row in (*fixed, by_scan) for cell in row[1:]]
    assert {gone for gone, _ in cells} == {"0.0%"}
    worst, best = (
        max(float(cell.split(", ")[1].rstrip("%")) for row in rows for cell in row[1:])
        for rows in (fixed, [by_scan])
    )
    assert f"up to {best} % of the plots in turns are not in the track" in PAPERS
    assert f"otherwise up to {worst} %" in PAPERS


def test_what_is_said_of_predictions_is_in_its_table() -> None:
    better = [1 / float(row[3]) for row in table("tracker-plans.md", "extrapolation")]
    assert (round(min(better)), round(max(better))) == (5, 8)
    assert "five to eight times smaller" in PAPERS


def test_what_is_said_of_the_first_paper_is_in_its_table() -> None:
    rows = {row[0]: row for row in table("bearing.md", "claims")}
    assert rows["RMSE at N = 100"][2] == "0.71°"
    assert rows["classical over paper, N = 100"][2] == "1.30"
    assert "0.71° and 1.30, with groups of 5" in PAPERS
    assert rows["95 % interval of ten trials, N = 100"][2] == "0.63 to 2.66"
