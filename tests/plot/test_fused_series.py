"""Pictures of fused series: plots, weights and noise as they are."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from matplotlib import pyplot as plt
from pictures import legend_of, line, lines_of

from tertia import plot, simulate
from tertia.fusion import fuse_series
from tertia.kalman import SingerModel

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


def test_fused_series_draws_every_plot_about_the_track_and_flags_outliers() -> None:
    z = plots()
    result = fuse_series(z, R, MODEL, method="adaptive", period=360.0)
    top, _, _ = plot.fused_series(z, result, period=360.0, measurement_variance=R)
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


def test_fused_series_draws_band_weights_and_noise() -> None:
    z = plots()
    result = fuse_series(z, R, MODEL, method="adaptive", period=360.0)
    top, middle, bottom = plot.fused_series(z, result, period=360.0, measurement_variance=R)
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
    estimated, stated = lines_of(bottom, "_estimated"), lines_of(bottom, "_stated")
    for k in range(3):
        np.testing.assert_array_equal(estimated[k][:, 1], np.sqrt(result.noise_variance[k]))
        np.testing.assert_array_equal(stated[k][:, 1], np.full(60, np.sqrt(R[k][0])))
    assert bottom.get_yscale() == "log"
    assert middle.get_xlim() == bottom.get_xlim() == top.get_xlim()
    top.figure.canvas.draw()
    texts = [tick.get_text() for tick in bottom.get_yticklabels()]
    assert {"0.1", "0.5", "1"} < set(texts)


def test_fused_series_of_quiet_sensors_has_a_linear_scale_and_no_outliers() -> None:
    z = 1.0 + 0.01 * np.random.default_rng(0).standard_normal((2, 30))
    result = fuse_series(z, 0.01**2, MODEL)
    assert not result.outlier.any()
    top, _, bottom = plot.fused_series(z, result, sensors=["north", "south"])
    assert legend_of(top) == ["fused ± 2 sigma", "north", "south"]
    assert bottom.get_yscale() == "linear"
    assert bottom.get_ylim()[0] == 0
    assert not lines_of(bottom, "_stated")
    assert (top.get_ylabel(), bottom.get_xlabel()) == ("plot − fused", "step")
    assert top.get_title() == "30 steps of 2 sensors, 0 outliers"


@pytest.mark.parametrize("kind", ["numbers", "dates"])
def test_fused_series_over_times_in_a_figure_that_is_given(kind: str) -> None:
    z = plots()
    result = fuse_series(z, R, MODEL, period=360.0)
    times: Any = 5.0 * np.arange(60) + 100
    if kind == "dates":
        times = np.datetime64("2026-01-01T00:00:00", "s") + times.astype("timedelta64[s]")
    figure = plt.figure(layout="constrained")
    part = figure.subfigures(1, 2)[1]
    panels = plot.fused_series(z, result, time=times, period=360.0, figure=part, legend=False)
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


def test_fused_series_without_weights() -> None:
    z = plots()
    result = fuse_series(z, R, MODEL, method="central", period=360.0)
    _, middle, _ = plot.fused_series(z, result, period=360.0)
    assert [text.get_text() for text in middle.texts] == ["no weights"]


def test_fused_series_of_many_sensors_and_of_nothing() -> None:
    z = np.random.default_rng(0).standard_normal((9, 20))
    top, _, bottom = plot.fused_series(z, fuse_series(z, 1.0, MODEL))
    looks = {(a.get_color(), a.get_marker()) for a in top.get_lines() if a.get_marker() != "None"}
    assert len(looks) >= 9
    lines_ = {(a.get_color(), a.get_linestyle()) for a in bottom.get_lines()}
    assert len(lines_) == 9
    nothing = np.full((1, 3), np.nan)
    top, _, _ = plot.fused_series(nothing, fuse_series(nothing, 1.0, MODEL))
    assert top.get_title() == "3 steps of 1 sensor, 0 outliers"
    top.figure.canvas.draw()


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (
            {"z": plots()[0]},
            ValueError,
            r"z has shape \(60,\); only one record of shape \(K, steps\)",
        ),
        (
            {"z": plots()[:, 1:]},
            ValueError,
            r"z has shape \(3, 59\), but result was made of shape \(3, 60\)",
        ),
        ({"sensors": ["a"]}, ValueError, "sensors has 1 names; z has 3 sensors"),
        ({"time": np.arange(59)}, ValueError, r"time has shape \(59,\); it must be \(60,\)"),
        ({"time": ["x"] * 60}, ValueError, r"time\[0\] is .x.; it must be a number of seconds"),
        (
            {"measurement_variance": [1.0, 2.0]},
            ValueError,
            r"measurement_variance has shape \(1, 2\)",
        ),
        ({"period": "x"}, TypeError, "period is 'x'"),
    ],
)
def test_errors_of_fused_series(
    arguments: dict[str, Any], error: type[Exception], message: str
) -> None:
    z = plots()
    right = {"z": z, "result": fuse_series(z, R, MODEL, period=360.0), "period": 360.0}
    with pytest.raises(error, match=message):
        plot.fused_series(**(right | arguments))
    assert not plt.get_fignums()
