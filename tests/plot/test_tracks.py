"""Pictures of tracks of many targets."""

from typing import Any

import numpy as np
import pytest
import scipy.stats
from pictures import line

from tertia import metrics, plot
from tertia.flightplan import FlightPlan
from tertia.tracker import Plots, Radar, TrackTable, track


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
    assert 0 < np.count_nonzero(table.turn_probability > 0.5) < len(table)
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
    expected = ["track", "manoeuvre", "95 % ellipse", "radar", "plan", "plot"]
    legend = ax.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == expected


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
