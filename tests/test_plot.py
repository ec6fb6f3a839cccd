"""Pictures: what is drawn is what was measured and estimated."""

import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import pytest
import scipy.stats
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

import tertia
from tertia import fusion, metrics, plot, screening, simulate, smoothing
from tertia.flightplan import FlightPlan
from tertia.fusion import fuse_series
from tertia.kalman import SingerModel
from tertia.location import Location, Station, locate
from tertia.tracker import Plots, Radar, TrackTable, track
from tertia.trajectory import Trajectory, reconstruct

Y = [12.4, 11.8, 40.0, 12.1, 12.9, 11.5, 20.0, 12.2, 12.0, 11.9]
X = [[10.0, 20.0, 5.0], [13.0, 21.0, 4.0]]
S = [
    [[4.0, 1.0, 0.5], [1.0, 2.0, 0.0], [0.5, 0.0, 1.0]],
    [[1.0, -0.5, 0.0], [-0.5, 3.0, 1.0], [0.0, 1.0, 2.0]],
]


@pytest.fixture(autouse=True)
def no_window() -> Iterator[None]:
    mpl.use("Agg")
    yield
    plt.close("all")


def line(ax: Axes, label: str) -> npt.NDArray[np.float64]:
    """Return the points of the line with this label, shape (n, 2)."""
    (found,) = (a for a in ax.get_lines() if a.get_label() == label)
    assert isinstance(found, Line2D)
    return np.asarray(found.get_xydata(), dtype=np.float64)


def band(ax: Axes) -> tuple[float, float]:
    (found,) = ax.patches
    assert isinstance(found, Rectangle)
    return found.get_y(), found.get_y() + found.get_height()


def blocks(ax: Axes) -> LineCollection:
    (found,) = (c for c in ax.collections if c.get_label() == "block mean")
    assert isinstance(found, LineCollection)
    return found


def labels(ax: Axes) -> list[str]:
    legend = ax.get_legend()
    assert legend is not None
    return sorted(text.get_text() for text in legend.get_texts())


def north() -> npt.NDArray[np.float64]:
    return tertia.simulate.direction_finder(105, bearing=359.0, bursts_per_100=2, rng=4).theta


def test_measurements_are_drawn_once_and_continuously_across_north() -> None:
    theta = north()
    estimate = tertia.estimate_bearing(theta)
    ax = plot.bearing(theta, estimate)
    kept, flagged = line(ax, "measurement"), line(ax, "anomalous")
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
def test_groups_have_their_means_extents_and_weights(
    method: Literal["robust", "corrected", "paper"],
) -> None:
    theta = north()
    estimate = tertia.estimate_bearing(theta, method=method)
    assert estimate.block_means is not None
    assert estimate.block_weights is not None
    # a block of which every measurement is anomalous has no mean
    has_mean = np.isfinite(estimate.block_means)
    number, weights = np.flatnonzero(has_mean), estimate.block_weights[has_mean]
    assert method != "robust" or len(number) < 10
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


def test_groups_where_measurements_are_missing() -> None:
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
    everything = ["anomalous", "bearing", "block mean", "measurement", "± 2 sigma"]
    estimate = tertia.estimate_bearing(theta)
    assert labels(plot.bearing(theta, estimate)) == everything
    assert plot.bearing(theta, estimate, legend=False).get_legend() is None
    quiet = [1.0, 2.0, 1.5, 1.2, 1.8]
    assert labels(plot.bearing(quiet, tertia.estimate_bearing(quiet))) == everything[1:]


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
    assert line(ax, "anomalous").tolist() == [[2, 40.0], [6, 20.0]]
    assert line(ax, "replacement").tolist() == [[2, found.cleaned[2]], [6, found.cleaned[6]]]
    mean, threshold = float(found.mean), float(found.threshold)
    assert line(ax, "mean")[:, 1].tolist() == [mean, mean]
    assert band(ax) == pytest.approx((mean - threshold, mean + threshold), rel=1e-12)
    assert ax.get_title() == "2 of 10 anomalous"
    expected = ["anomalous", "mean", "mean ± threshold", "measurement", "replacement"]
    assert labels(ax) == expected


def test_screening_that_excludes() -> None:
    y = [*Y, float("nan")]
    ax = plot.screening(y, screening.leave_one_out(y, replace=False, nan_policy="omit"))
    assert "replacement" not in labels(ax)
    assert ax.get_title() == "2 of 10 anomalous"
    assert plot.screening(Y, screening.leave_one_out(Y), legend=False).get_legend() is None


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (
            lambda e, s: plot.bearing([Y, Y], e),
            r"theta has shape \(2, 10\); one sample of shape \(N,\) can be drawn",
        ),
        (lambda e, s: plot.bearing(3.0, e), r"theta has shape \(\); one sample"),
        (
            lambda e, s: plot.bearing(Y[1:], e),
            r"theta has shape \(9,\), but estimate was made of shape \(10,\)",
        ),
        (
            lambda e, s: plot.bearing(Y, e, block_size=5),
            "block_size is 5, which makes 2 blocks of 10 measurements; estimate has 1",
        ),
        (lambda e, s: plot.bearing(Y, e, block_size=1), "block_size is 1; it must be between 2"),
        (lambda e, s: plot.screening([Y], s), r"y has shape \(1, 10\); one sample of shape"),
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


@pytest.mark.parametrize("components", [(0, 1), (2, 0), [1, 2]])
@pytest.mark.parametrize("probability", [0.5, 0.95])
def test_combination(components: Sequence[int], probability: float) -> None:
    result = fusion.fuse(X, S)
    ax = plot.combination(X, S, result, components=components, probability=probability)
    quantile = scipy.stats.chi2.ppf(probability, 2)
    drawn = [("estimate 0", X[0], S[0]), ("estimate 1", X[1], S[1])]
    pair = list(components)
    for label, centre, covariance in [*drawn, ("fused", result.mean, result.covariance)]:
        points = line(ax, label)
        expected = np.asarray(centre)[pair]
        assert points[0].tolist() == expected.tolist()
        assert np.isnan(points[1]).all()
        off = points[2:] - expected
        inverse = np.linalg.inv(np.asarray(covariance)[np.ix_(pair, pair)])
        np.testing.assert_allclose((off @ inverse * off).sum(axis=1), quantile, rtol=1e-12)
        # all the way round
        np.testing.assert_allclose(points[2], points[-1], rtol=1e-12)
        np.testing.assert_allclose(points[2:-1].mean(axis=0), expected, rtol=1e-12)
    assert (ax.get_xlabel(), ax.get_ylabel()) == (f"component {pair[0]}", f"component {pair[1]}")
    assert labels(ax) == ["estimate 0", "estimate 1", "fused"]
    widths = [a.get_linewidth() for a in ax.get_lines()]
    assert widths[-1] > max(widths[:-1])


def test_combination_title_aspect_and_legend() -> None:
    result = fusion.fuse(X, S)
    ax = plot.combination(X, S, result, probability=0.6827)
    assert ax.get_title() == "12.49 ± 0.85, 21.1 ± 1.0; p-value 0.45"
    legend = ax.get_legend()
    assert legend is not None
    assert legend.get_title().get_text() == "68.27 % ellipses"
    assert ax.get_aspect() == 1.0
    _, given = plt.subplots()
    assert plot.combination(X, S, result, equal=False, legend=False, ax=given) is given
    assert (given.get_aspect(), given.get_legend()) == ("auto", None)
    assert len(plt.get_fignums()) == 2
    ax.figure.canvas.draw()


def test_combination_of_many_estimates() -> None:
    six, seven = np.tile(S[0], (6, 1, 1)), np.tile(S[0], (7, 1, 1))
    x = np.arange(21.0).reshape(7, 3)
    ax = plot.combination(x[:6], six, fusion.fuse(x[:6], six))
    assert labels(ax) == [*(f"estimate {k}" for k in range(6)), "fused"]
    looks = [(a.get_color(), a.get_marker()) for a in ax.get_lines()]
    assert len({c for c, _ in looks}) == len({m for _, m in looks}) == 7
    ax = plot.combination(x, seven, fusion.fuse(x, seven))
    assert labels(ax) == ["estimate", "fused"]
    assert len(ax.get_lines()) == 8


def test_combination_with_a_scalar() -> None:
    result = fusion.fuse_scalar([3, 4], np.eye(2), [0.6, 0.8], 5.2, 0.1)
    ax = plot.combination([[3, 4]], [np.eye(2)], result)
    assert labels(ax) == ["estimate 0", "fused"]
    assert ax.get_title() == "3.12 ± 0.80, 4.16 ± 0.61; p-value 0.84"


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_combination_of_components_of_different_size(scale: float) -> None:
    units = np.array([1.0, scale, 1.0])
    x, s = X * units, S * np.outer(units, units)
    ax = plot.combination(x, s, fusion.fuse(x, s), equal=False)
    plain = plot.combination(X, S, fusion.fuse(X, S))
    for label in labels(ax):
        expected = line(plain, label) * units[:2]
        np.testing.assert_allclose(line(ax, label), expected, rtol=1e-12)


def test_combination_of_singular_covariances() -> None:
    crossed = np.array([[[4.0, 4.0], [4.0, 4.0]], [[1.0, -1.0], [-1.0, 1.0]]])
    result = fusion.FusedEstimate(np.zeros(2), np.eye(2), crossed, 0.0, 2, 1.0)
    points = line(plot.combination(np.zeros((2, 2)), crossed, result), "estimate 0")[2:]
    # a line
    np.testing.assert_allclose(points[:, 0], points[:, 1], rtol=1e-12)
    np.testing.assert_allclose(points.max(), 2 * np.sqrt(-2 * np.log(0.05)), rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (
            {"estimates": [X, X]},
            ValueError,
            r"estimates has shape \(2, 2, 3\), but result has 3 components; \(K, 3\) can be drawn",
        ),
        ({"estimates": np.empty((0, 3))}, ValueError, r"estimates has shape \(0, 3\)"),
        ({"estimates": [[1, 2], [3, 4]]}, ValueError, r"estimates has shape \(2, 2\)"),
        (
            {"covariances": S[0]},
            ValueError,
            r"covariances has shape \(3, 3\); for estimates of shape \(2, 3\) it must be \(2, 3",
        ),
        (
            {"result": fusion.fuse([X], [S])},
            ValueError,
            r"result has a batch of shape \(1,\); one combination can be drawn",
        ),
        ({"components": (0, 3)}, ValueError, r"components\[1\] is 3; result has 3 components"),
        ({"components": (-1, 0)}, ValueError, r"components\[0\] is -1; it must be between 0"),
        ({"components": (1, 1)}, ValueError, "components are both 1; they must be distinct"),
        ({"components": (0, 1, 2)}, ValueError, "components is .*; it must be two numbers"),
        ({"components": 1}, ValueError, "components is 1; it must be two numbers"),
        ({"components": (0, 1.5)}, TypeError, r"components\[1\] is 1.5"),
        ({"probability": 1.0}, ValueError, "probability is 1.0; it must be between 0 and 1"),
        ({"probability": float("nan")}, ValueError, "probability is nan"),
        ({"probability": "high"}, TypeError, "probability"),
        ({"equal": "no"}, TypeError, "equal is 'no'"),
        ({"estimates": [[np.nan, 1, 2], X[1]]}, ValueError, r"estimates\[0, 0\] is nan"),
        (
            {"covariances": [S[0], np.diag([1.0, -1.0, 1.0])]},
            ValueError,
            r"covariances\[1\] has a variance that is not positive in the components drawn",
        ),
        (
            {"covariances": [np.eye(3) + 2 * np.eye(3)[::-1], S[1]], "components": (0, 2)},
            ValueError,
            r"covariances\[0\] is indefinite in the components drawn",
        ),
    ],
)
def test_errors_of_combination(
    arguments: dict[str, Any], error: type[Exception], message: str
) -> None:
    right: dict[str, Any] = {"estimates": X, "covariances": S, "result": fusion.fuse(X, S)}
    with pytest.raises(error, match=message):
        plot.combination(**(right | arguments))
    assert not plt.get_fignums()


def test_text_is_not_a_measurement() -> None:
    with pytest.raises(TypeError, match="theta"):
        plot.bearing(["a"] * 10, tertia.estimate_bearing(Y))


def test_missing_matplotlib(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r"needs Matplotlib: pip install 'tertia\[plot\]'"):
        plot.bearing(Y, tertia.estimate_bearing(Y))
    with pytest.raises(ImportError, match="needs Matplotlib"):
        plot.combination(X, S, fusion.fuse(X, S))
    with pytest.raises(ImportError, match="needs Matplotlib"):
        plot.fusion(plots(), fuse_series(plots(), R, MODEL))
    with pytest.raises(ImportError, match="needs Matplotlib"):
        plot.consistency([1.0])
    with pytest.raises(ImportError, match="needs Matplotlib"):
        plot.trajectory(PLANE, path_of_plane())


@pytest.mark.parametrize(
    ("value", "sigma", "expected"),
    [
        (358.4772, 0.3051, ("358.48", "0.31")),
        (358.4772, 0.0996, ("358.48", "0.10")),
        (358.4772, 3.051, ("358.5", "3.1")),
        (358.4772, 30.51, ("358", "31")),
        (12345.6, 456.0, ("12346", "456")),
        (0.123456, 0.00012, ("0.12346", "0.00012")),
        (10.1, 0.0, ("10.1", "0")),
    ],
)
def test_rounding_to_sigma(value: float, sigma: float, expected: tuple[str, str]) -> None:
    assert plot.rounded(value, sigma) == expected


MODEL = SingerModel(5.0, 0.05, 0.003)
R = [[0.1**2], [0.1**2], [0.2**2]]


def plots() -> npt.NDArray[np.float64]:
    """Three sensors across north; the second becomes noisier, the third has far outliers."""
    sigma = np.array([[0.1], [0.1], [0.2]]) * np.ones(60)
    sigma[1, 30:] *= 5
    z = simulate.radars(
        MODEL,
        60,
        sigma=sigma,
        detection_probability=0.9,
        angle=358.0,
        rate=0.02,
        period=360.0,
        rng=3,
    ).z
    z[2, 20], z[2, 40] = (z[0, [20, 41]] + [30.0, -30.0]) % 360
    return z


def legend_of(ax: Axes) -> list[str]:
    (legend,) = ax.figure.legends
    return [text.get_text() for text in legend.get_texts()]


def lines_of(ax: Axes, label: str) -> list[npt.NDArray[np.float64]]:
    return [np.asarray(a.get_xydata()) for a in ax.get_lines() if a.get_label() == label]


def test_fusion_draws_every_plot_about_the_track_and_flags_outliers() -> None:
    z = plots()
    result = fuse_series(z, R, MODEL, method="adaptive", period=360.0)
    top, _, _ = plot.fusion(z, result, period=360.0, measurement_variance=R)
    off = (z - result.mean[:, 0] + 180) % 360 - 180
    low, high = top.get_ylim()
    kept = np.where(result.outlier, np.nan, off)
    assert low == -high
    assert high > max(np.nanmax(np.abs(kept)), 2 * result.sigma[2:, 0].max())
    assert high < 5 < np.nanmax(np.abs(off))
    inner = 0.97 * high
    for k in range(3):
        drawn = line(top, f"sensor {k}")
        seen = np.flatnonzero(~np.isnan(z[k]))
        assert drawn[:, 0].tolist() == seen.tolist()
        np.testing.assert_allclose(drawn[:, 1], np.clip(off[k, seen], -inner, inner), rtol=1e-12)
    inside = result.outlier & (np.abs(off) <= inner)
    assert sorted(line(top, "outlier")[:, 0]) == sorted(np.nonzero(inside)[1])
    for label, chosen in (("above", off > inner), ("below", off < -inner)):
        found = line(top, f"outlier, {label}")
        assert sorted(found[:, 0]) == sorted(np.nonzero(result.outlier & chosen)[1])
        assert len(found)
    markers = {a.get_label(): (a.get_marker(), a.get_color()) for a in top.get_lines()}
    names = ["sensor 0", "sensor 1", "sensor 2", "outlier", "outlier, above", "outlier, below"]
    assert len({markers[name][0] for name in names}) == 6
    assert len({markers[name][1] for name in names}) == 4
    outliers = np.count_nonzero(result.outlier)
    assert top.get_title() == f"60 steps of 3 sensors, {outliers} outliers"
    assert legend_of(top) == ["fused ± 2 sigma", *names, "sigma as stated"]
    assert top.get_ylabel() == "plot − fused (°)"


def test_fusion_draws_band_weights_and_noise() -> None:
    z = plots()
    result = fuse_series(z, R, MODEL, method="adaptive", period=360.0)
    top, middle, bottom = plot.fusion(z, result, period=360.0, measurement_variance=R)
    (band_,) = top.collections
    known = np.isfinite(result.sigma[:, 0])
    vertices = band_.get_paths()[0].vertices
    assert vertices[:, 1].max() == pytest.approx(2 * result.sigma[known, 0].max(), rel=1e-12)
    assert vertices[:, 1].min() == pytest.approx(-2 * result.sigma[known, 0].max(), rel=1e-12)
    for k, (drawn, own) in enumerate(
        zip(lines_of(middle, "_weight"), lines_of(middle, "_own"), strict=True)
    ):
        np.testing.assert_array_equal(drawn[:, 1], result.weights[k, :, 0])
        at = np.flatnonzero(~np.isnan(z[k]) & ~np.isnan(result.weights[k, :, 0]))
        np.testing.assert_array_equal(own, np.column_stack([at, result.weights[k, at, 0]]))
    believed, stated = lines_of(bottom, "_believed"), lines_of(bottom, "_stated")
    for k in range(3):
        np.testing.assert_array_equal(believed[k][:, 1], np.sqrt(result.noise_variance[k]))
        np.testing.assert_array_equal(stated[k][:, 1], np.full(60, np.sqrt(R[k][0])))
    assert bottom.get_yscale() == "log"
    assert middle.get_xlim() == bottom.get_xlim() == top.get_xlim()
    top.figure.canvas.draw()
    texts = [tick.get_text() for tick in bottom.get_yticklabels()]
    assert {"0.1", "0.5", "1"} < set(texts)


def test_fusion_of_quiet_sensors_has_a_linear_scale_and_no_outliers() -> None:
    z = 1.0 + 0.01 * np.random.default_rng(0).standard_normal((2, 30))
    result = fuse_series(z, 0.01**2, MODEL)
    assert not result.outlier.any()
    top, _, bottom = plot.fusion(z, result, sensors=["north", "south"])
    assert legend_of(top) == ["fused ± 2 sigma", "north", "south"]
    assert bottom.get_yscale() == "linear"
    assert bottom.get_ylim()[0] == 0
    assert not lines_of(bottom, "_stated")
    assert (top.get_ylabel(), bottom.get_xlabel()) == ("plot − fused", "step")
    assert top.get_title() == "30 steps of 2 sensors, 0 outliers"


@pytest.mark.parametrize("kind", ["numbers", "dates"])
def test_fusion_over_times_in_a_figure_that_is_given(kind: str) -> None:
    z = plots()
    result = fuse_series(z, R, MODEL, period=360.0)
    times: Any = 5.0 * np.arange(60) + 100
    if kind == "dates":
        times = np.datetime64("2026-01-01T00:00:00", "s") + times.astype("timedelta64[s]")
    figure = plt.figure(layout="constrained")
    part = figure.subfigures(1, 2)[1]
    panels = plot.fusion(z, result, times=times, period=360.0, figure=part, legend=False)
    assert [ax.figure for ax in panels] == [part] * 3
    assert part.axes == list(panels)
    assert not part.legends
    assert len(plt.get_fignums()) == 1
    drawn = next(a for a in panels[1].get_lines() if a.get_label() == "_weight")
    np.testing.assert_array_equal(drawn.get_xdata(orig=True), times)
    assert panels[2].get_xlabel() == "time"
    figure.canvas.draw()
    texts = [tick.get_text() for tick in panels[2].get_xticklabels()]
    assert ("00:05" in texts) == (kind == "dates")


def test_fusion_without_weights() -> None:
    z = plots()
    result = fuse_series(z, R, MODEL, method="central", period=360.0)
    _, middle, _ = plot.fusion(z, result, period=360.0)
    assert [text.get_text() for text in middle.texts] == ["no weights"]


def test_fusion_of_many_sensors_and_of_nothing() -> None:
    z = np.random.default_rng(0).standard_normal((9, 20))
    top, _, bottom = plot.fusion(z, fuse_series(z, 1.0, MODEL))
    looks = {(a.get_color(), a.get_marker()) for a in top.get_lines() if a.get_marker() != "None"}
    assert len(looks) >= 9
    lines_ = {(a.get_color(), a.get_linestyle()) for a in bottom.get_lines()}
    assert len(lines_) == 9
    nothing = np.full((1, 3), np.nan)
    top, _, _ = plot.fusion(nothing, fuse_series(nothing, 1.0, MODEL))
    assert top.get_title() == "3 steps of 1 sensor, 0 outliers"
    top.figure.canvas.draw()


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"z": plots()[0]}, ValueError, r"z has shape \(60,\); one record of shape \(K, steps\)"),
        (
            {"z": plots()[:, 1:]},
            ValueError,
            r"z has shape \(3, 59\), but result was made of shape \(3, 60\)",
        ),
        ({"sensors": ["a"]}, ValueError, "sensors has 1 names; z has 3 sensors"),
        ({"times": np.arange(59)}, ValueError, r"times has shape \(59,\); it must be \(60,\)"),
        ({"times": ["x"] * 60}, TypeError, "times has dtype"),
        (
            {"measurement_variance": [1.0, 2.0]},
            ValueError,
            r"measurement_variance has shape \(1, 2\)",
        ),
        ({"period": "x"}, TypeError, "period is 'x'"),
    ],
)
def test_errors_of_fusion(arguments: dict[str, Any], error: type[Exception], message: str) -> None:
    z = plots()
    right = {"z": z, "result": fuse_series(z, R, MODEL, period=360.0), "period": 360.0}
    with pytest.raises(error, match=message):
        plot.fusion(**(right | arguments))
    assert not plt.get_fignums()


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
    ax = plot.consistency(values, times=[10, 20, 30], ax=given)
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
        ([1.0], {"times": [1, 2]}, ValueError, r"times has shape \(2,\); it must be \(1,\)"),
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
    ax = plot.smoothing(y, result, axis=1, times=5.0 * np.arange(30), ax=given, legend=False)
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
        ({"times": np.arange(3)}, ValueError, r"times has shape \(3,\); it must be \(8,\)"),
        ({"width": "x"}, TypeError, "width is 'x'"),
        ({"result": 1}, TypeError, "result is 1; it must be a LocalPolynomial"),
        (
            {"result": smoothing.local_polynomial(np.zeros((2, 8)), 5)},
            ValueError,
            r"result has a batch of shape \(2,\); one series can be drawn",
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


PLACES = [[0.0, 0.0, 5.0], [2000.0, 300.0, 9.0], [400.0, 2600.0, 0.0]]
STATIONS = [
    Station(place, range_sigma=10.0, azimuth_sigma=0.005, elevation_sigma=0.005, name=name)
    for place, name in zip(PLACES, ["west", "east", None], strict=True)
]
PLANE = [
    Station(station.position[:2], range_sigma=10.0, azimuth_sigma=0.005) for station in STATIONS
]
INSTANTS = 40


def measured_from(stations: list[Station]) -> dict[str, npt.NDArray[np.float64]]:
    """Return what stations measure of a straight path; the first range has three faults."""
    t = np.arange(float(INSTANTS))
    path = np.column_stack([20 * t, 1500 + 5 * t, 300 + t])[:, : len(stations[0].position)]
    measured = simulate.stations(stations, path, rng=4).measurements
    measured["range"][20:23, 0] += 150.0
    for values in measured.values():
        values[9] = np.nan
    return measured


def path_of_space(**options: Any) -> Trajectory:
    return reconstruct(STATIONS, 2.0 * np.arange(INSTANTS), **measured_from(STATIONS), **options)


def path_of_plane() -> Trajectory:
    return reconstruct(PLANE, 2.0 * np.arange(INSTANTS), **measured_from(PLANE))


def test_trajectory_draws_stations_path_fixes_and_faults() -> None:
    result = path_of_space()
    panels = plot.trajectory(STATIONS, result)
    assert list(panels) == ["plan", "height", "range", "azimuth", "elevation"]
    plan = panels["plan"]
    drawn = [line(plan, "station"), *lines_of(plan, "_station")]
    np.testing.assert_array_equal(np.vstack(drawn), np.array(PLACES)[:, :2])
    assert [text.get_text() for text in plan.texts] == ["west", "east"]
    np.testing.assert_array_equal(line(plan, "trajectory"), result.position[:, :2])
    np.testing.assert_array_equal(line(plan, "single instant"), result.fixes.position[:, :2])
    faulty = np.asarray(result.outlier.count) > 0
    assert faulty[20:23].all()
    np.testing.assert_array_equal(line(plan, "with a fault"), result.position[faulty, :2])
    count = int(np.sum(result.outlier.count))
    assert plan.get_title() == f"39 of 40 instants located, {count} faults"
    assert plan.get_aspect() == 1.0
    assert {"trajectory", "with a fault", "± 2 sigma", "west", "station 2"} <= set(legend_of(plan))


@pytest.mark.parametrize("probability", [0.5, 0.95])
def test_trajectory_draws_some_ellipses(probability: float) -> None:
    result = path_of_space()
    plan = plot.trajectory(STATIONS, result, probability=probability)["plan"]
    points = line(plan, f"{100 * probability:.10g} % ellipse")
    gaps = np.flatnonzero(np.isnan(points[:, 0]))
    ellipses = [points[a + 1 : b] for a, b in pairwise(gaps)]
    assert len(ellipses) == 10
    chosen = np.linspace(0, INSTANTS - 1, 10).round().astype(int)
    quantile = scipy.stats.chi2.ppf(probability, 2)
    for at, ellipse in zip(chosen, ellipses, strict=True):
        off = ellipse - result.position[at, :2]
        np.testing.assert_allclose(
            metrics.nees(off, result.covariance[at, :2, :2]), quantile, rtol=1e-9
        )


def test_trajectory_draws_the_height_and_its_band() -> None:
    result = path_of_space()
    height = plot.trajectory(STATIONS, result)["height"]
    smooth, fixes = (np.asarray(a.get_xydata()) for a in height.get_lines())
    np.testing.assert_array_equal(smooth, np.column_stack([result.time, result.position[:, 2]]))
    np.testing.assert_array_equal(fixes[:, 1], result.fixes.position[:, 2])
    (band_,) = height.collections
    vertices = np.concatenate([path.vertices for path in band_.get_paths()])[:, 1]
    for sign in (-2, 2):
        edge = result.position[:, 2] + sign * result.sigma[:, 2]
        assert np.max(np.min(np.abs(vertices[:, np.newaxis] - edge), axis=0)) < 1e-9
    low, high = height.get_ylim()
    assert low < np.nanmin(vertices) < np.nanmax(vertices) < high


def test_trajectory_draws_residuals_by_station_and_flags_faults() -> None:
    result = path_of_space()
    panels = plot.trajectory(STATIONS, result)
    ax, values = panels["range"], result.residual.range
    assert values is not None
    assert result.outlier.range is not None
    assert ax.get_ylabel() == "range / sigma"
    kept = np.where(result.outlier.range, np.nan, values)
    inner = max(3.0, np.nanmax(np.abs(kept)))
    for k, name in enumerate(["west", "east", "station 2"]):
        seen = np.flatnonzero(~np.isnan(values[:, k]))
        drawn = line(ax, name)
        assert drawn[:, 0].tolist() == result.time[seen].tolist()
        np.testing.assert_allclose(drawn[:, 1], np.clip(values[seen, k], -inner, inner), rtol=1e-12)
    above = line(ax, "outlier, above")
    assert {40.0, 42.0, 44.0} <= set(above[:, 0])
    assert ax.get_ylim()[1] > inner
    assert panels["height"].get_xlim() == ax.get_xlim() == panels["elevation"].get_xlim()
    assert panels["elevation"].get_xlabel() == "time"


def test_single_instants_and_range_differences() -> None:
    measured = measured_from(PLANE)
    distance = measured.pop("range")
    fixes = locate(
        PLANE,
        **measured,
        range_difference=distance[:, 1:] - distance[:, :1],
        range_difference_sigma=15.0,
    )
    panels = plot.trajectory(PLANE, fixes, legend=False)
    assert list(panels) == ["plan", "azimuth", "range_difference"]
    plan, ax = panels["plan"], panels["range_difference"]
    assert "trajectory" not in [a.get_label() for a in plan.get_lines()]
    np.testing.assert_array_equal(line(plan, "single instant"), fixes.position)
    assert (ax.get_ylabel(), ax.get_xlabel()) == ("range difference / sigma", "instant")
    # the first station has none
    assert line(ax, "station 0").size == 0
    assert line(ax, "station 1")[:, 0].tolist() == np.flatnonzero(fixes.success).tolist()
    assert np.count_nonzero(fixes.success) > 30
    assert not ax.figure.legends
    ax.figure.canvas.draw()


def test_trajectory_over_dates_in_a_figure_that_is_given() -> None:
    result = path_of_plane()
    times = np.datetime64("2026-01-01T00:00:00", "s") + 60 * np.arange(INSTANTS)
    figure = plt.figure(layout="constrained")
    part = figure.subfigures(2, 1)[1]
    panels = plot.trajectory(PLANE, result, times=times, figure=part)
    assert list(panels) == ["plan", "range", "azimuth"]
    assert {ax.figure for ax in panels.values()} == {part}
    assert len(plt.get_fignums()) == 1
    figure.canvas.draw()
    texts = [tick.get_text() for tick in panels["azimuth"].get_xticklabels()]
    assert "00:10" in texts


def test_fixes_far_off_do_not_set_the_scale() -> None:
    result = path_of_space()
    near = plot.trajectory(STATIONS, result)
    # less than the share that need not be seen
    result.fixes.position[3] += 1e6
    wide = plot.trajectory(STATIONS, result, times=np.arange(INSTANTS))
    limit = 2e5
    assert near["plan"].get_xlim()[1] < limit
    for name in ("plan", "height"):
        assert max(map(abs, wide[name].get_ylim())) < 1e6


def test_stations_that_move_are_drawn_along_their_way() -> None:
    way = np.array(PLACES)[0, :2] + np.column_stack([np.arange(40.0), np.zeros(40)])
    moving = [Station(way, range_sigma=10.0, azimuth_sigma=0.005), *PLANE[1:]]
    result = reconstruct(moving, np.arange(40.0), **measured_from(PLANE))
    plan = plot.trajectory(moving, result)["plan"]
    np.testing.assert_array_equal(line(plan, "station"), way)


def test_nothing_that_can_be_located() -> None:
    empty = np.full((4, 3), np.nan)
    fixes = locate(PLANE, azimuth=empty, range=empty)
    panels = plot.trajectory(PLANE, fixes)
    assert panels["plan"].get_title() == "0 of 4 instants located, 0 faults"
    panels["plan"].figure.canvas.draw()
    space = locate(STATIONS, azimuth=empty, range=empty)
    plot.trajectory(STATIONS, space)["height"].figure.canvas.draw()


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"result": 1}, TypeError, "result is 1; it must be a Trajectory or a Location"),
        (
            {"result": "instant"},
            ValueError,
            r"result has positions of shape \(2,\); \(N, D\) can be drawn",
        ),
        ({"stations": STATIONS}, ValueError, r"stations has shape \(3, 3\) and result \(40, 2\)"),
        ({"stations": PLANE[:2]}, ValueError, "stations has 2 stations, but result was made of 3"),
        ({"times": np.arange(3)}, ValueError, r"times has shape \(3,\); it must be \(40,\)"),
        ({"probability": 1.0}, ValueError, "probability is 1.0; it must be between 0 and 1"),
        ({"legend": "no"}, TypeError, "legend is 'no'"),
    ],
)
def test_errors_of_trajectory(
    arguments: dict[str, Any], error: type[Exception], message: str
) -> None:
    right: dict[str, Any] = {"stations": PLANE, "result": path_of_plane()}
    if arguments.get("result") == "instant":
        one: Location = locate(PLANE, **{k: v[0] for k, v in measured_from(PLANE).items()})
        arguments = {"result": one}
    with pytest.raises(error, match=message):
        plot.trajectory(**(right | arguments))
    assert not plt.get_fignums()


def air_radars() -> list[Radar]:
    noise = {"range_sigma": 50.0, "azimuth_sigma": 0.002}
    return [
        Radar((0.0, 0.0, 500.0), scan_period=4.0, name="west", **noise),
        Radar((30e3, 0.0), scan_period=5.0, **noise),
    ]


def air_plots() -> Plots:
    """Return plots without errors of an aircraft that turns at 100 s, 5500 m high, some missing."""
    columns = []
    for k, radar in enumerate(air_radars()):
        time = np.arange(0.3 * k, 200.0, radar.scan_period)
        angle = np.clip((time - 100) / 50, 0, 1) * np.pi / 2
        turn = 200 * 50 / (np.pi / 2)
        east = 10e3 + turn * (1 - np.cos(angle)) + 200 * np.maximum(time - 150, 0)
        north = 20e3 + 200 * np.minimum(time, 100) + turn * np.sin(angle)
        seen = np.arange(time.size) % 9 > 0
        way = np.column_stack([east, north]) - radar.position[:2]
        up = 5500.0 - (radar.position[2] if len(radar.position) == 3 else 0.0)
        slant = np.hypot(np.hypot(*way.T), up)
        columns.append(np.array([time, slant, np.arctan2(*way.T), np.full(time.size, k)])[:, seen])
    t, r, azimuth, radar_of = np.hstack(columns)
    return Plots(t, r, azimuth, sensor=radar_of.astype(int), height=5500.0)


def air_tracks() -> TrackTable:
    return track(air_plots(), air_radars())


def test_tracks_draw_positions_turns_plots_plans_and_radars() -> None:
    table, plan = air_tracks(), FlightPlan([[10e3, 20e3], [10e3, 46e3], [90e3, 46e3]], 200.0)
    ax = plot.tracks(table, air_radars(), plots=air_plots(), plans=[plan])
    assert ax.get_title() == "1 track"
    drawn = line(ax, "track")
    order = np.argsort(table.time, kind="stable")
    np.testing.assert_allclose(drawn[:-1], table.position[order] / 1e3)
    turning = line(ax, "manoeuvre")[:-1]
    assert np.isfinite(turning[:, 0]).tolist() == (table.turn_probability[order] > 0.5).tolist()
    assert 0 < np.sum(table.manoeuvre) < len(table)
    np.testing.assert_array_equal(line(ax, "plan")[:-1], plan.waypoints / 1e3)
    np.testing.assert_array_equal(line(ax, "radar"), [[0.0, 0.0]])
    # slant ranges are drawn on the ground: all plots lie on the path
    for place in line(ax, "plot"):
        assert np.min(np.hypot(*(table.position / 1e3 - place).T)) < 0.9
    first = line(ax, "plot")[np.argmin(air_plots().time)]
    np.testing.assert_allclose(first, [10.0, 20.0 + 0.2 * air_plots().time.min()], atol=1e-4)
    assert [text.get_text() for text in ax.texts] == ["west", str(table.track[0])]
    # the plan goes on far away, and does not set the scale
    assert ax.dataLim.x1 < 60.0
    told = ["track", "manoeuvre", "95 % ellipse", "radar", "plan", "plot"]
    legend = ax.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == told


def test_ellipses_of_tracks_have_the_probability_they_claim() -> None:
    table = air_tracks()
    ax = plot.tracks(table, probability=0.5, legend=False)
    assert ax.get_legend() is None
    points = line(ax, "50 % ellipse") * 1e3
    parts = np.split(points, np.flatnonzero(np.isnan(points[:, 0])))
    parts = [part[~np.isnan(part[:, 0])] for part in parts]
    parts = [part for part in parts if len(part)]
    assert len(parts) == 3
    for part in parts:
        centre = (part.max(axis=0) + part.min(axis=0)) / 2
        row = np.argmin(np.hypot(*(table.position - centre).T))
        distances = metrics.nees(part - table.position[row], table.covariance[row, :2, :2])
        np.testing.assert_allclose(distances, scipy.stats.chi2.ppf(0.5, 2), rtol=1e-6)


def test_tracks_without_any() -> None:
    table = air_tracks()
    nothing = table[np.zeros(len(table), dtype=bool)]
    ax = plot.tracks(nothing, air_radars(), plots=air_plots())
    assert ax.get_title() == "0 tracks"
    assert ax.dataLim.y1 > 40.0
    assert plot.update_probability(nothing, air_radars()).get_title() == "0 scans"


def test_probability_of_update_counts_hits_and_misses() -> None:
    table = air_tracks()
    known = table[table.confirmed]
    ax = plot.update_probability(table, air_radars())
    share = np.mean(known.plot >= 0)
    assert share < 0.95
    assert ax.get_title() == f"{100 * share:.1f} % of {len(known)} scans"
    own = known[known.sensor == 0]
    distance = np.hypot(*own.position.T) / 1e3
    container, *_ = ax.containers
    data = np.asarray(container.lines[0].get_xydata())
    width = distance.max() / 12
    for middle, value in data:
        inside = np.abs(distance - middle) <= width / 2 + 1e-9
        assert value == pytest.approx(np.mean(own.plot[inside] >= 0))
    legend = ax.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["west", "radar 1"]


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"table": 3}, TypeError, "table is 3"),
        ({"radars": [3]}, TypeError, r"radars\[0\] is 3"),
        ({"radars": []}, ValueError, "a radar that is not among the 0 given"),
        ({"probability": 1.0}, ValueError, "probability"),
    ],
)
def test_errors_of_tracks(arguments: Any, error: type[Exception], message: str) -> None:
    right: dict[str, Any] = {"table": air_tracks(), "radars": air_radars(), "plots": air_plots()}
    with pytest.raises(error, match=message):
        plot.tracks(**(right | arguments))
    if "probability" not in arguments:
        with pytest.raises(error, match=message):
            plot.update_probability(
                **{k: v for k, v in (right | arguments).items() if k != "plots"}
            )
