"""Pictures of one target over time."""

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import scipy.stats
from matplotlib import pyplot as plt
from pictures import legend_of, line, lines_of

from tertia import metrics, plot, simulate
from tertia.location import Location, Station, locate
from tertia.trajectory import Trajectory, reconstruct

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
    """Return what stations measure of a straight path; the first range has three outliers."""
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


def test_trajectory_draws_stations_path_fixes_and_outliers() -> None:
    result = path_of_space()
    panels = plot.trajectory(STATIONS, result)
    assert list(panels) == ["plan", "height", "range", "azimuth", "elevation"]
    plan = panels["plan"]
    drawn = [line(plan, "station"), *lines_of(plan, "_station")]
    np.testing.assert_array_equal(np.vstack(drawn), np.array(PLACES)[:, :2])
    assert [text.get_text() for text in plan.texts] == ["west", "east"]
    np.testing.assert_array_equal(line(plan, "trajectory"), result.position[:, :2])
    np.testing.assert_array_equal(line(plan, "single instant"), result.fixes.position[:, :2])
    wrong = np.asarray(result.outlier.count) > 0
    assert wrong[20:23].all()
    np.testing.assert_array_equal(line(plan, "with an outlier"), result.position[wrong, :2])
    count = int(np.sum(result.outlier.count))
    assert plan.get_title() == f"39 of 40 instants located, {count} outliers"
    assert plan.get_aspect() == 1.0
    assert {"trajectory", "with an outlier", "± 2 sigma", "west", "station 2"} <= set(
        legend_of(plan)
    )


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


def test_trajectory_draws_residuals_by_station_and_flags_outliers() -> None:
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
    panels = plot.trajectory(PLANE, result, time=times, figure=part)
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
    wide = plot.trajectory(STATIONS, result, time=np.arange(INSTANTS))
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
    assert panels["plan"].get_title() == "0 of 4 instants located, 0 outliers"
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
        ({"time": np.arange(3)}, ValueError, r"time has shape \(3,\); it must be \(40,\)"),
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


def test_heights_that_azimuths_do_not_tell_have_no_panel() -> None:
    azimuth = measured_from(STATIONS)["azimuth"]
    path = reconstruct(STATIONS, 2.0 * np.arange(INSTANTS), azimuth=azimuth)
    for result in (path, locate(STATIONS, azimuth=azimuth)):
        assert list(plot.trajectory(STATIONS, result)) == ["plan", "azimuth"]


def test_no_instants() -> None:
    nothing = locate(PLANE, range=np.empty((0, 3)))
    panels = plot.trajectory(PLANE, nothing, figure=plt.figure())
    assert panels["plan"].get_title() == "0 of 0 instants located, 0 outliers"
