"""Pictures of samples: what is drawn is what was measured and estimated."""

from collections.abc import Callable
from typing import Literal

import numpy as np
import numpy.typing as npt
import pytest
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Rectangle
from pictures import labels, line

import tertia
from tertia import plot, screening

Y = [12.4, 11.8, 40.0, 12.1, 12.9, 11.5, 20.0, 12.2, 12.0, 11.9]


def band(ax: Axes) -> tuple[float, float]:
    (found,) = ax.patches
    assert isinstance(found, Rectangle)
    return found.get_y(), found.get_y() + found.get_height()


def blocks(ax: Axes) -> LineCollection:
    (found,) = (c for c in ax.collections if c.get_label() == "block mean")
    assert isinstance(found, LineCollection)
    return found


def north() -> npt.NDArray[np.float64]:
    return tertia.simulate.direction_finder(105, bearing=359.0, bursts_per_100=2, rng=4).theta


def test_measurements_are_drawn_once_and_continuously_across_north() -> None:
    theta = north()
    estimate = tertia.estimate_bearing(theta)
    ax = plot.bearing(theta, estimate)
    kept, flagged = line(ax, "measurement"), line(ax, "outlier")
    assert flagged[:, 0].tolist() == np.flatnonzero(estimate.outlier).tolist()
    drawn = np.concatenate([kept, flagged])
    drawn = drawn[drawn[:, 0].argsort()]
    assert drawn[:, 0].tolist() == list(range(105))
    np.testing.assert_allclose(drawn[:, 1] % 360, theta, rtol=0, atol=1e-9)
    assert np.abs(drawn[:, 1] - estimate.value).max() < 40


@pytest.mark.parametrize("period", [360.0, 2 * np.pi, None])
def test_estimate_and_band(period: float | None) -> None:
    theta = np.random.default_rng(0).normal(1.0, 0.1, 50)
    estimate = tertia.estimate_bearing(theta, period=period)
    ax = plot.bearing(theta, estimate, period=period)
    value, sigma = float(estimate.value), float(estimate.sigma)
    assert line(ax, "bearing")[:, 1].tolist() == [value, value]
    assert band(ax) == pytest.approx((value - 2 * sigma, value + 2 * sigma), rel=1e-12)
    assert ax.get_title() == f"{value:.3f} ± {sigma:.3f}"
    units = {360.0: "bearing (°)", 2 * np.pi: "bearing (rad)", None: "bearing"}
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("measurement", units[period])


def test_tick_labels_are_wrapped_back() -> None:
    theta = [350.0, 10.0, 0.0, 355.0, 5.0, 358.0]
    ax = plot.bearing(theta, tertia.estimate_bearing(theta))
    ax.set_yticks([-10.0, -0.2, -1e-16, 0.0, 5.0, 360.0, 370.0])
    texts = [tick.get_text() for tick in ax.get_yticklabels()]
    assert texts == ["350", "359.8", "0", "0", "5", "0", "10"]


@pytest.mark.parametrize("method", ["robust", "corrected", "paper"])
def test_blocks_have_their_means_extents_and_weights(
    method: Literal["robust", "corrected", "paper"],
) -> None:
    theta = north()
    if method == "robust":
        theta[20:40] = (theta[20:40] + 30) % 360
    estimate = tertia.estimate_bearing(theta, method=method)
    assert estimate.block_means is not None
    assert estimate.block_weights is not None
    # a block of which every measurement is an outlier has no mean
    has_mean = np.isfinite(estimate.block_means)
    number, weights = np.flatnonzero(has_mean), estimate.block_weights[has_mean]
    if method == "robust":
        assert estimate.block_weights[2:4].max() < 0.02
    found = blocks(plot.bearing(theta, estimate))
    segments = np.array(found.get_segments())
    expected = estimate.block_means[has_mean] % 360
    np.testing.assert_allclose(segments[:, 0, 1] % 360, expected, rtol=0, atol=1e-9)
    assert np.abs(segments[:, :, 1] - estimate.value).max() < 40
    assert segments[:, 0, 0].tolist() == (10 * number - 0.5).tolist()
    # the last block takes the remainder
    assert segments[:, 1, 0].tolist() == [104.5 if j == 9 else 10 * j + 9.5 for j in number]
    opacity = np.asarray(found.get_colors())[:, 3]
    np.testing.assert_allclose(opacity, 0.25 + 0.75 * weights / weights.max(), rtol=1e-12)


def test_blocks_where_measurements_are_missing() -> None:
    theta = np.random.default_rng(0).normal(0, 2, 105)
    theta[5:25] = np.nan
    estimate = tertia.estimate_bearing(theta, nan_policy="omit")
    ax = plot.bearing(theta, estimate)
    segments = np.array(blocks(ax).get_segments())
    # 85 are there: eight blocks, of which the first reaches over the gap
    assert segments[:, :, 0].tolist()[:2] == [[-0.5, 29.5], [29.5, 39.5]]
    assert len(segments) == 8
    kept = line(ax, "measurement")
    assert np.isnan(kept[np.isin(kept[:, 0], range(5, 25)), 1]).all()
    assert np.isfinite(band(ax)).all()


@pytest.mark.parametrize("method", ["mean", "k-sigma"])
def test_methods_without_blocks(method: Literal["mean", "k-sigma"]) -> None:
    ax = plot.bearing(Y, tertia.estimate_bearing(Y, method=method), block_size=3)
    assert not ax.collections
    assert "block mean" not in labels(ax)


def test_legend_names_what_there_is() -> None:
    theta = north()
    everything = ["bearing", "block mean", "measurement", "outlier", "± 2 sigma"]
    estimate = tertia.estimate_bearing(theta)
    assert labels(plot.bearing(theta, estimate)) == everything
    assert plot.bearing(theta, estimate, legend=False).get_legend() is None
    quiet = [1.0, 2.0, 1.5, 1.2, 1.8]
    everything.remove("outlier")
    assert labels(plot.bearing(quiet, tertia.estimate_bearing(quiet))) == everything


def test_axes_given_are_used_and_nothing_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plt, "show", lambda: pytest.fail("plt.show was called"))
    _, axes = plt.subplots(1, 2)
    assert plot.bearing(Y, tertia.estimate_bearing(Y), ax=axes[0]) is axes[0]
    assert plot.screening(Y, screening.leave_one_out(Y), ax=axes[1]) is axes[1]
    assert len(plt.get_fignums()) == 1
    axes[0].figure.canvas.draw()


def test_screening_that_replaces() -> None:
    found = screening.leave_one_out(Y)
    ax = plot.screening(Y, found)
    assert line(ax, "measurement").tolist() == [[i, Y[i]] for i in (0, 1, 3, 4, 5, 7, 8, 9)]
    assert line(ax, "outlier").tolist() == [[2, 40.0], [6, 20.0]]
    assert line(ax, "replacement").tolist() == [[2, found.cleaned[2]], [6, found.cleaned[6]]]
    mean, threshold = float(found.mean), float(found.threshold)
    assert line(ax, "mean")[:, 1].tolist() == [mean, mean]
    assert band(ax) == pytest.approx((mean - threshold, mean + threshold), rel=1e-12)
    assert ax.get_title() == "2 of 10 outliers"
    expected = ["mean", "mean ± threshold", "measurement", "outlier", "replacement"]
    assert labels(ax) == expected


def test_screening_that_excludes() -> None:
    y = [*Y, float("nan")]
    ax = plot.screening(y, screening.leave_one_out(y, replace=False, nan_policy="omit"))
    assert "replacement" not in labels(ax)
    assert ax.get_title() == "2 of 10 outliers"
    assert plot.screening(Y, screening.leave_one_out(Y), legend=False).get_legend() is None


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (
            lambda e, s: plot.bearing([Y, Y], e),
            r"theta has shape \(2, 10\); only one sample of shape \(N,\) can be drawn",
        ),
        (lambda e, s: plot.bearing(3.0, e), r"theta has shape \(\); only one sample"),
        (
            lambda e, s: plot.bearing(Y[1:], e),
            r"theta has shape \(9,\), but estimate was made of shape \(10,\)",
        ),
        (
            lambda e, s: plot.bearing(Y, e, block_size=5),
            "block_size is 5, which makes 2 blocks of 10 measurements; estimate has 1",
        ),
        (lambda e, s: plot.bearing(Y, e, block_size=1), "block_size is 1; it must be between 2"),
        (lambda e, s: plot.screening([Y], s), r"y has shape \(1, 10\); only one sample of shape"),
        (
            lambda e, s: plot.screening([*Y, 1.0], s),
            r"y has shape \(11,\), but screening was made of shape \(10,\)",
        ),
    ],
)
def test_errors(
    draw: Callable[[tertia.BearingEstimate, screening.Screening], Axes], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        draw(tertia.estimate_bearing(Y), screening.leave_one_out(Y))
    assert not plt.get_fignums()


def test_text_is_not_a_measurement() -> None:
    with pytest.raises(TypeError, match="theta"):
        plot.bearing(["a"] * 10, tertia.estimate_bearing(Y))
