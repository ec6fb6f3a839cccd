"""Plots: into the plane, and which of them cannot be used."""

from dataclasses import replace

import numpy as np
import pytest
from tracker.flights import RADAR, line, scene

from tertia import simulate
from tertia.tracker import Plots, PlotStatus, Radar, Tracker, track


def test_a_plot_in_the_plane_is_that_of_the_source():
    radar = Radar(range_sigma=75.0, azimuth_sigma=np.radians(0.1), scan_period=10.0)
    position, covariance = Plots([0.0], [150e3], 30.0, degrees=True).to_cartesian([radar])
    shrunk = np.exp(-(radar.azimuth_sigma**2) / 2)
    np.testing.assert_allclose(position[0] * shrunk, [75000, 129903.8105676658], rtol=1e-12)
    expected = [[52810.4395890071, -27242.5262485441], [-27242.5262485441, 21353.4798630024]]
    # the covariance at the position without the bias
    np.testing.assert_allclose(covariance[0], expected, rtol=1e-5)
    close = Radar(range_sigma=75.0, azimuth_sigma=1e-9, scan_period=10.0)
    _, covariance = Plots([0.0], [150e3], [1.0]).to_cartesian([close])
    assert np.all(np.linalg.eigvalsh(covariance) > 0)


def test_the_mean_of_plots_far_away_has_no_bias():
    radar = Radar(range_sigma=1.0, azimuth_sigma=np.radians(2.0), scan_period=10.0)
    azimuth = 0.7 + radar.azimuth_sigma * np.random.default_rng(3).standard_normal(400_000)
    position, _ = Plots(np.zeros(400_000), 300e3, azimuth).to_cartesian([radar])
    toward = np.array([np.sin(0.7), np.cos(0.7)])
    # the bias would be 183 m; the standard error of the mean is 0.6 m
    assert abs(position.mean(axis=0) @ toward - 300e3) < 3.0


def test_bad_plots_are_refused_and_lose_no_track():
    good = line(30)
    bad = Plots(
        [20.0, np.nan, 24.0, 28.0, 32.0, 1e18, 24.0, 1e7],
        [np.nan, 40e3, 0.0, 500e3, -3.0, 40e3, 1e300, 40e3],
        0.1,
    )
    both = Plots(
        np.concatenate([good.time, bad.time]),
        np.concatenate([good.range, bad.range]),
        np.concatenate([good.azimuth, bad.azimuth]),
    )
    found = track(both, [RADAR])
    invalid, far = PlotStatus.INVALID, PlotStatus.OUT_OF_RANGE
    statuses = [invalid, invalid, invalid, far, invalid, invalid, invalid, PlotStatus.CLOCK_ERROR]
    assert found.track_of_plot[30:].tolist() == statuses
    assert all(PlotStatus(status).message for status in statuses)
    np.testing.assert_array_equal(found.position, track(good, [RADAR]).position)
    above = Plots([0.0], [9000.0], [0.3], height=9000.0)
    assert Tracker([RADAR]).update(above).track_of_plot.tolist() == [PlotStatus.AT_SENSOR]


def test_a_wrong_clock_loses_no_track():
    good = line(30)
    tracker = Tracker([RADAR])
    for k in range(30):
        tracker.update(good[[k]])
        if k == 15:
            stray = Plots([good.time[k] + 5000.0], [20e3], [0.3])
            assert tracker.update(stray).track_of_plot[0] == PlotStatus.CLOCK_ERROR
        if k == 20:
            late = Plots([good.time[k] - 50.0], [20e3], [0.3])
            assert tracker.update(late).track_of_plot[0] == PlotStatus.LATE
    last = tracker.update(line(31)[[30]])
    assert last.track.tolist() == [1]


def test_a_silence_is_believed_when_a_second_plot_comes():
    tracker = Tracker([RADAR])
    tracker.update(line(10))
    later = line(10, start=3600.0)
    assert tracker.update(later[[0]]).track_of_plot[0] == PlotStatus.CLOCK_ERROR
    found = tracker.update(later[1:])
    assert np.all(found.track_of_plot > 1)


@pytest.mark.parametrize("lag", [0.0, 12.0])
def test_two_plots_with_a_wrong_clock_end_no_stream(lag):
    """Others come at their time together with them, and after them."""
    good = line(30)
    tracker, refused, last = Tracker([RADAR], lag=lag), 0, set()
    for k in range(30):
        time, distance = np.repeat(good.time[k], 6), np.repeat(good.range[k], 6)
        azimuth = good.azimuth[k] + 0.3 * np.arange(6)
        if k in {10, 15, 20}:
            time = np.append(time, time[:2] + 3600.0)
            distance, azimuth = np.append(distance, distance[:2]), np.append(azimuth, azimuth[:2])
        found = tracker.update(Plots(time, distance, azimuth))
        refused += np.count_nonzero(found.track_of_plot == PlotStatus.CLOCK_ERROR)
        last = set(found.track.tolist())
    assert len(last) == 6
    assert refused == 6 or lag > 0


def scan(k, by=0.0):
    """Return the times, ranges and azimuths of six aircraft in a scan; `by` is added to times."""
    good, azimuth = line(30)[[k]], 0.3 * np.arange(6)
    return np.repeat(good.time + by, 6), np.repeat(good.range, 6), good.azimuth + azimuth


def followed(tracker, times):
    """Update a tracker by six aircraft in scans at shifted times; return how many it takes."""
    used = []
    for k, by in enumerate(times):
        found = tracker.update(Plots(*scan(k, by)))
        used.append(np.count_nonzero(found.track_of_plot > 0))
    return used, set(found.track.tolist())


@pytest.mark.parametrize("lag", [0.0, 12.0])
def test_a_scan_with_a_wrong_clock_ends_no_stream(lag):
    used, last = followed(Tracker([RADAR], lag=lag), [3600.0 * (k == 15) for k in range(30)])
    assert used[15] == 0
    assert sum(used[16:]) == 6 * 14
    assert len(last) == 6


@pytest.mark.parametrize("lag", [0.0, 12.0])
def test_a_tracker_starts_anew_when_its_clock_is_set_back(lag):
    times = [-600.0 * (k >= 15) for k in range(30)]
    with pytest.warns(UserWarning, match="starts anew there") as told:
        used, last = followed(Tracker([RADAR], lag=lag), times)
    assert len(told) == 1
    assert min(used[20:]) == 6
    assert len(last) == 6


def test_a_sensor_whose_clock_is_set_back_is_told_once_and_stops_no_other():
    tracker = Tracker([RADAR, RADAR], registration=False)

    def status(k):
        both = (np.concatenate(two) for two in zip(scan(k), scan(k, -60.0), strict=True))
        return tracker.update(Plots(*both, sensor=np.repeat([0, 1], 6))).track_of_plot

    for k in range(10):
        tracker.update(Plots(*scan(k)))
    with pytest.warns(UserWarning, match=r"sensors\[1\]: its plots go on .* before") as told:
        found = [status(k) for k in range(10, 30)]
    assert len(told) == 1
    assert np.all(np.stack(found)[:, :6] > 0)
    assert np.all(np.stack(found)[:, 6:] == PlotStatus.LATE)


def test_midnight():
    plots = line(40, start=86400.0 - 80.0)
    wrapped = Plots(plots.time % 86400.0, plots.range, plots.azimuth)
    expected = track(plots, [RADAR])
    found = track(wrapped, [RADAR], clock_period=86400.0)
    np.testing.assert_array_equal(found.position, expected.position)
    tracker = Tracker([RADAR], clock_period=86400.0)
    numbers = {int(n) for k in range(40) for n in tracker.update(wrapped[[k]]).track}
    assert numbers == {1}


def test_duplicates_make_no_second_track():
    plots = line(40)
    order = np.repeat(np.arange(40), 2)
    found = track(plots[order], [RADAR])
    assert np.all(found.track_of_plot == np.tile([1, PlotStatus.DUPLICATE], 40))
    near = np.sort(np.concatenate([np.arange(40), np.arange(0, 40, 4)]))
    shifted = plots.range[near] + 40.0 * np.diff(near, prepend=-1).astype(bool)
    found = track(Plots(plots.time[near], shifted, plots.azimuth[near]), [RADAR])
    assert len(np.unique(found.track)) == 1


@pytest.mark.parametrize("count", [1, 2])
def test_copies_with_later_times_are_no_plots_of_their_own(count):
    """As from a second network line, which stamps its own times; radars are registered."""
    radars = [replace(RADAR, position=[2e4 * k, 0.0]) for k in range(count)]
    traffic = simulate.dense_traffic(8, area=(6e4, 6e4), rng=5)
    plots = simulate.radar_plots(traffic, radars, rng=6).plots
    later = plots.time + np.random.default_rng(7).uniform(0.2, 1.5, len(plots))
    row, time = np.tile(np.arange(len(plots)), 2), np.append(plots.time, later)
    twice = replace(plots[row], time=time)
    found, alone = track(twice, radars), track(plots, radars)
    assert np.mean(found.track_of_plot[len(plots) :] == PlotStatus.DUPLICATE) > 0.97
    assert len(np.unique(found.track)) == len(np.unique(alone.track))
    tracker, order = Tracker(radars), np.argsort(time)
    parts = np.split(order, np.searchsorted(time[order], np.arange(1.0, time.max())))
    tables = [tracker.update(twice[part]) for part in parts]
    numbers = np.concatenate([table.track for table in tables])
    assert len(np.unique(numbers)) == len(np.unique(alone.track[alone.confirmed]))
    # in the next scan, a plot at the same place is a new one
    standing = Plots(RADAR.scan_period * np.arange(9.0), 40e3, 0.5)
    assert np.all(track(standing, [RADAR]).track_of_plot != PlotStatus.DUPLICATE)


def test_the_order_of_plots_does_not_matter():
    radar, _, seen = scene(41, n=15)
    order = np.random.default_rng(1).permutation(len(seen))
    one, other = track(seen.plots, [radar]), track(seen.plots[order], [radar])
    np.testing.assert_array_equal(one.position, other.position)
    np.testing.assert_array_equal(one.plot[one.plot >= 0], order[other.plot[other.plot >= 0]])


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"time": [[0.0]]}, r"time has shape \(1, 1\)"),
        ({"range": [1.0, 2.0, 3.0]}, r"range has shape \(3,\)"),
        ({"sensor": [0.5, 0.5]}, "sensor has dtype float64"),
        ({"time": ["a", "b"]}, r"time\[0\] is 'a'"),
        ({"identity": np.array([1, 2**63 + 5], dtype=np.uint64)}, r"identity\[1\] is 9223"),
    ],
)
def test_wrong_plots_are_refused(columns, message):
    with pytest.raises((ValueError, TypeError), match=message):
        Plots(**{"time": [0.0, 1.0], "range": 1.0, "azimuth": 0.0, **columns})


def test_a_plot_of_an_unknown_radar_is_refused():
    tracker = Tracker([RADAR])
    with pytest.raises(ValueError, match=r"sensor\[1\] is 4; it must be the index"):
        tracker.update(Plots([0.0, 1.0], 10e3, 0.1, sensor=[0, 4]))
    with pytest.raises(TypeError, match="it must be Plots"):
        tracker.update([1.0])
    with pytest.raises(ValueError, match=r"sensor\[1\] is 1; it must be the index"):
        Plots([0.0, 1.0], 10e3, 0.1, sensor=[0, 1]).to_cartesian([RADAR])
    with pytest.raises(ValueError, match="time is nan"):
        tracker.update(line(3), time=np.nan)
    with pytest.raises(ValueError, match="seconds is nan"):
        tracker.extrapolate(np.nan)


def test_no_plots_are_no_tracks():
    nothing = Plots([], [], [], sensor=[], identity=[])
    assert len(nothing) == 0
    assert len(track(nothing, [RADAR])) == 0
