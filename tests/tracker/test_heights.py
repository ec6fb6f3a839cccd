"""Plots without heights: they take those of their tracks, or are as uncertain as those."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from tertia import simulate
from tertia.geo import SystemPlane
from tertia.metrics import nees
from tertia.sensors import Bias, Radar
from tertia.tracker import Plots, Tracker, TrackTable, track

PLANE = SystemPlane(50.0, 14.0)
SITES = ((50.0, 14.0, 300.0), (50.65, 15.86, 450.0), (48.42, 16.79, 600.0))
ACCURACY = {
    "range_sigma": 50.0,
    "azimuth_sigma": np.radians(0.08),
    "scan_period": 4.0,
    "bias": Bias(),
}


def scene(
    seed: int, radars: list[Radar], share: float
) -> tuple[Plots, simulate.RadarPlots, object]:
    """Simulate 30 aircraft, some of them climbing, of whose plots a share has no height."""
    random = np.random.default_rng([18, seed])
    traffic = simulate.dense_traffic(30, area=(200e3, 200e3), duration=400.0, rng=random)
    middle = np.mean([radar.position[:2] for radar in radars], axis=0)
    low, rate = random.uniform(3e3, 9e3, (30, 1)), random.choice([0.0, 0.0, 8.0, -6.0], (30, 1))
    height = low + rate * np.linspace(0.0, 400.0, traffic.position.shape[1])
    traffic = replace(traffic, position=traffic.position + middle, height=height)
    record = simulate.radar_plots(traffic, radars, rng=random)
    plots = record.plots
    missing = random.random(len(plots)) < share
    height = np.where(missing, np.nan, plots.height)
    return (
        Plots(plots.time, plots.range, plots.azimuth, sensor=plots.sensor, height=height),
        record,
        traffic,
    )


def on_the_earth(count: int) -> list[Radar]:
    return [PLANE.radar(*site, **ACCURACY) for site in SITES[:count]]


def in_space(count: int) -> list[Radar]:
    return [replace(one, frame=None) for one in on_the_earth(count)]


def consistency(table: TrackTable, record: simulate.RadarPlots, traffic: object) -> float:
    """Return the mean of the normalised squared errors of positions per axis."""
    table = table[(table.plot >= 0) & (table.time > 100.0)]
    target = record.target[table.plot]
    truth, _ = traffic.at(target, table.time)
    known = (target >= 0) & np.isfinite(truth).all(axis=1)
    error = (table.position - truth)[known]
    return float(np.mean(nees(error, table.covariance[known, :2, :2]))) / 2


@pytest.mark.parametrize("place", [on_the_earth, in_space])
@pytest.mark.parametrize(
    ("share", "most", "limit"), [(0.1, 31, 1.2), (0.3, 31, 1.2), (1.0, 32, 1.5)]
)
def test_missing_heights_cost_no_track(place, share, most, limit):
    radars = place(3)
    plots, record, traffic = scene(0, radars, share)
    table = track(plots, radars)
    assert 30 <= len(np.unique(table.track)) <= most
    assert consistency(table, record, traffic) < limit


def test_a_single_radar_without_heights_says_how_little_it_knows():
    radars = on_the_earth(1)
    plots, record, traffic = scene(1, radars, 1.0)
    table = track(plots, radars)
    assert 30 <= len(np.unique(table.track)) <= 32
    assert consistency(table, record, traffic) < 1.6
    # nobody has reported a height
    assert np.isnan(table.height).all()


def test_a_height_that_comes_late_moves_its_track():
    radar = on_the_earth(1)[0]
    time = np.arange(0.0, 200.0, 4.0)
    truth = np.column_stack(
        [20e3 + 150.0 * time, np.full(len(time), 5e3), np.full(len(time), 10e3)]
    )
    rho, azimuth, _ = radar.site.geodetic_to_polar(*PLANE.to_geodetic(truth))
    height = np.where(time < 120.0, np.nan, 10e3)
    table = track(Plots(time, rho, azimuth, height=height), [radar])
    error = np.linalg.norm(table.position - truth[:, :2], axis=1)
    sigma = np.sqrt(np.trace(table.covariance[:, :2, :2], axis1=1, axis2=2))
    before, after = (table.time > 60.0) & (table.time < 120.0), table.time > 160.0
    assert len(np.unique(table.track)) == 1
    # at the level of the traffic, which nobody knows
    assert np.all(error[before] > 500.0)
    assert np.all(error[before] < 2.0 * sigma[before])
    assert np.all(error[after] < 45.0)
    assert np.all(sigma[after] < 80.0)


def test_scans_give_what_the_recording_gives():
    radars = on_the_earth(2)
    plots, *_ = scene(2, radars, 0.5)
    order = np.argsort(plots.time, kind="stable")
    plots = plots[order]
    whole = Tracker(radars, n_threads=2).update(plots)
    single = Tracker(radars, n_threads=1)
    found = single.update(plots)
    np.testing.assert_array_equal(whole.covariance, found.covariance)
    tracker = Tracker(radars)
    tracker.update(plots[plots.time < 200.0], time=200.0)
    copy = pickle.loads(pickle.dumps(tracker))
    rest = plots[plots.time >= 200.0]
    one, other = tracker.update(rest), copy.update(rest)
    np.testing.assert_array_equal(one.position, other.position)
    np.testing.assert_array_equal(one.covariance, other.covariance)


def test_a_plane_without_any_height_has_horizontal_ranges():
    radar = Radar(range_sigma=50.0, azimuth_sigma=0.001, scan_period=4.0)
    time = np.arange(0.0, 80.0, 4.0)
    table = track(Plots(time, 8e3 + 100.0 * time, 0.0), [radar])
    np.testing.assert_allclose(table.position[-1], [0.0, 8e3 + 100.0 * time[-1]], atol=1.0)


def test_a_height_that_is_impossible_is_not_used():
    radar = on_the_earth(1)[0]
    time = np.arange(0.0, 40.0, 4.0)
    plots = Plots(time, np.full(10, 9e3), 0.5, height=np.where(time == 20.0, 30e3, 5e3))
    table = track(plots, [radar])
    assert len(table) == 10
    np.testing.assert_allclose(table.height, 5e3, atol=1.0)
    overhead = Tracker([radar]).update(Plots([0.0], [9e3], 0.5, height=9.4e3))
    assert overhead.track_of_plot[0] == -3


@pytest.mark.parametrize(
    ("period", "rate"), [(4.0, 15.0), (4.0, -40.0), (10.0, 25.0), (12.0, 40.0)]
)
def test_a_climb_is_shown_at_once_and_a_wrong_height_is_not(period, rate):
    random = np.random.default_rng(5)
    radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=period)
    time = period * np.arange(30.0)
    climb = (time - 9.4 * period).clip(0.0, 12.0 * period)
    truth = np.column_stack([40e3 + 150.0 * time, np.full(30, 30e3), 7000.0 + rate * climb])
    height = np.round(truth[:, 2] / 30.48) * 30.48
    height[[6, 16, 27]] = 11_000.0, 300.0, 9000.0
    height[18] = np.nan
    rho = np.linalg.norm(truth, axis=1) + 50.0 * random.standard_normal(30)
    azimuth = np.arctan2(*truth[:, :2].T) + radar.azimuth_sigma * random.standard_normal(30)
    plots = Plots(time, rho, azimuth, height=height, icao_address=np.full(30, 5))
    table = track(plots, [radar])
    assert len(np.unique(table.track)) == 1
    of = np.searchsorted(time, table.time)
    assert np.all(np.abs(table.height - truth[of, 2]) < 50.0)
    # the rate four scans after a change
    for scans, expected in ((range(9), 0.0), (range(14, 22), rate), (range(26, 30), 0.0)):
        assert np.all(np.abs(table.vertical_rate - expected)[np.isin(of, scans)] < 4.0)
