"""Pictures of one series: consistency of errors, smooth curves."""

from typing import Any

import numpy as np
import pytest
import scipy.stats
from matplotlib import pyplot as plt
from pictures import labels, line

from tertia import plot, smoothing


@pytest.mark.parametrize(("dimension", "probability"), [(1, 0.99), (3, 0.5)])
def test_consistency(dimension: int, probability: float) -> None:
    random = np.random.default_rng(2)
    values = random.chisquare(dimension, (4, 5, 80))
    values[:, :, :10] = np.nan
    values[0, :, 40:] = np.nan
    ax = plot.consistency(values, dimension=dimension, probability=probability)
    means = np.array([np.nanmean(values[:, :, i]) for i in range(10, 80)])
    count = np.where(np.arange(10, 80) < 40, 20, 15)
    tails = (1 - probability) / 2
    low, high = (scipy.stats.chi2.ppf(q, count * dimension) / count for q in (tails, 1 - tails))
    inside = (low <= means) & (means <= high)
    assert line(ax, "within").tolist() == [
        [i + 10, pytest.approx(means[i], rel=1e-12)] for i in np.flatnonzero(inside)
    ]
    if not inside.all():
        outside = line(ax, "outside")
        assert outside[:, 0].tolist() == (np.flatnonzero(~inside) + 10).tolist()
    assert (probability == 0.5) <= (not inside.all())
    (bounds,) = ax.collections
    vertices = bounds.get_paths()[0].vertices[:, 1]
    for bound in (*low, *high):
        assert np.min(np.abs(vertices - bound)) < 1e-9
    assert line(ax, "expected")[:, 1].tolist() == [dimension] * 2
    assert ax.get_title() == (
        f"{inside.sum()} of 70 within the bounds of {100 * probability:.10g} %; "
        f"mean {np.nanmean(values):.3g}"
    )
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("step", "normalised squared error")


def test_consistency_of_one_run_at_times() -> None:
    values = [1.0, 50.0, 0.5]
    _, given = plt.subplots()
    ax = plot.consistency(values, time=[10, 20, 30], ax=given)
    assert ax is given
    assert line(ax, "outside").tolist() == [[20, 50.0]]
    assert labels(ax) == ["99 % of means", "expected", "outside", "within"]
    assert ax.get_xlabel() == "time"
    assert plot.consistency(values, legend=False).get_legend() is None


@pytest.mark.parametrize(
    ("values", "options", "error", "message"),
    [
        (1.0, {}, ValueError, r"normalised of shape \(\) has no steps"),
        ([np.nan, np.nan], {}, ValueError, r"normalised of shape \(2,\) has no steps"),
        ([1.0], {"time": [1, 2]}, ValueError, r"time has shape \(2,\); it must be \(1,\)"),
        ([1.0], {"dimension": 0}, ValueError, "dimension is 0"),
        ([1.0], {"probability": 1.5}, ValueError, "probability is 1.5"),
        (["a"], {}, TypeError, "normalised"),
    ],
)
def test_errors_of_consistency(
    values: Any, options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        plot.consistency(values, **options)
    assert not plt.get_fignums()


def test_smoothing_draws_points_curve_and_band() -> None:
    y = np.sin(np.arange(60) / 10) + 0.3 * np.random.default_rng(1).standard_normal(60)
    y[[3, 20]] = np.nan
    y[40:56] = np.nan
    result = smoothing.local_polynomial(y)
    ax = plot.smoothing(y, result)
    there = np.flatnonzero(~np.isnan(y))
    np.testing.assert_array_equal(line(ax, "measured"), np.column_stack([there, y[there]]))
    np.testing.assert_array_equal(line(ax, "smoothed")[:, 1], result.value)
    (band_,) = ax.collections
    vertices = np.concatenate([path.vertices for path in band_.get_paths()])
    known = np.isfinite(result.sigma)
    assert not known.all()
    for sign in (-2, 2):
        edge = (result.value + sign * result.sigma)[known]
        assert np.max(np.min(np.abs(vertices[:, 1, np.newaxis] - edge), axis=0)) < 1e-12
    assert ax.get_title() == "42 of 60 instants"
    assert labels(ax) == ["measured", "smoothed", "± 2 sigma"]


def test_smoothing_draws_one_axis_of_a_track() -> None:
    y = np.random.default_rng(1).standard_normal((30, 2))
    result = smoothing.smooth(y, 1.0)
    _, given = plt.subplots()
    ax = plot.smoothing(y, result, axis=1, time=5.0 * np.arange(30), ax=given, legend=False)
    assert ax is given
    assert ax.get_legend() is None
    expected = np.column_stack([5.0 * np.arange(30), result.position[:, 1]])
    np.testing.assert_array_equal(line(ax, "smoothed"), expected)
    assert ax.get_xlabel() == "time"


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (
            {"y": np.zeros(9)},
            ValueError,
            r"y has shape \(9,\), but result was made of shape \(8,\)",
        ),
        ({"time": np.arange(3)}, ValueError, r"time has shape \(3,\); it must be \(8,\)"),
        ({"width": "x"}, TypeError, "width is 'x'"),
        ({"result": 1}, TypeError, "result is 1; it must be a LocalPolynomial"),
        (
            {"result": smoothing.local_polynomial(np.zeros((2, 8)), 5)},
            ValueError,
            r"result has a batch of shape \(2,\); only one series can be drawn",
        ),
        (
            {"result": smoothing.smooth(np.zeros((8, 2)), 1.0, jerk=1.0), "axis": 2},
            ValueError,
            "axis is 2; result has 2 axes",
        ),
    ],
)
def test_errors_of_smoothing(
    arguments: dict[str, Any], error: type[Exception], message: str
) -> None:
    y = np.arange(8.0)
    right = {"y": y, "result": smoothing.local_polynomial(y, 5)}
    with pytest.raises(error, match=message):
        plot.smoothing(**(right | arguments))
    assert not plt.get_fignums()
