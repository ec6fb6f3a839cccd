"""Tracker: parity with the reference, honest covariances, tracks held and not invented."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
import tolerances
from reference import flightplan as flightplan_reference
from reference import tracker as reference

from tertia import simulate
from tertia.flightplan import FlightPlan
from tertia.tracker import (
    CvModel,
    ImmModel,
    PlanModel,
    Plots,
    PlotStatus,
    Radar,
    SingerModel,
    Tracker,
    TrackTable,
    WindowModel,
    track,
)

RADAR = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0, max_range=120e3)
MOTIONS = ["imm", "singer", "cv", "window"]


def polar(position):
    """Range and azimuth of positions."""
    return np.hypot(*position.T), np.arctan2(*position.T)


def turning_flight(steps=60, period=4.0, speed=150.0, rate=0.035):
    """A flight that turns in the middle third: times, positions, velocities."""
    fine = 100
    dt = period / fine
    w = np.zeros(steps * fine)
    w[steps * fine // 3 : 2 * steps * fine // 3] = rate
    course = np.cumsum(w) * dt
    velocity = speed * np.stack([np.cos(course), np.sin(course)], axis=-1)
    position = np.array([-20e3, 40e3]) + np.cumsum(velocity, axis=0) * dt
    return np.arange(steps) * period, position[::fine], velocity[::fine]


def noisy(position, radar, rng):
    """Plots of positions."""
    distance, azimuth = polar(position)
    n = len(position)
    return (
        distance + radar.range_sigma * rng.standard_normal(n),
        azimuth + radar.azimuth_sigma * rng.standard_normal(n),
    )


def line(n=20, period=4.0, start=0.0, seed=0):
    """Plots of one target that flies straight."""
    time = start + period * np.arange(n)
    position = np.array([10e3, 30e3]) + np.outer(time - start, [120.0, -80.0])
    rng = np.random.default_rng(seed)
    return Plots(time, *noisy(position, RADAR, rng))


PRECISE = Radar(range_sigma=15.0, azimuth_sigma=np.radians(0.02), scan_period=4.0)
SLOW = Radar(range_sigma=100.0, azimuth_sigma=np.radians(0.12), scan_period=10.0)
CORNER = [[-20e3, 40e3], [0.0, 40e3], [10e3, 70e3]]


def gaps(steps):
    """Scans that have a plot."""
    return np.setdiff1d(np.arange(steps), [9, 24, 33, 34, 50])


def sidestep(radar):
    """A turn of 2 degrees a second, gaps, and a step aside of 125 m that no model holds."""
    time, position, _ = turning_flight(period=radar.scan_period)
    position[12:] += [0.0, -125.0 * (radar is PRECISE)]
    kept = gaps(len(time))
    distance, azimuth = noisy(position, radar, np.random.default_rng(1))
    return Plots(time[kept], distance[kept], azimuth[kept])


def planned_turn(radar):
    """A flight along its plan, a little faster and with another bank."""
    before, corner, after = CORNER
    turn = flightplan_reference.turn(before, corner, after, 170.0, bank=np.radians(23))
    time = np.arange(0.0, 280.0, radar.scan_period)
    position = np.array([flightplan_reference.at(turn, s - 15e3)[0] for s in 170.0 * time])
    kept = gaps(len(time))
    distance, azimuth = noisy(position[kept], radar, np.random.default_rng(4))
    return Plots(time[kept], distance, azimuth, identity=7)


MODELS = {
    "cv": (5.0, lambda *at: reference.Straight(*at, ImmModel().straight_sigma)),
    "singer": (5.0, lambda *at: reference.Singer(*at, 1 / 60, 3.0)),
    "imm": (5.0, lambda *at: reference.Multiple(*at, ImmModel())),
    "window": (12.0, lambda *at: reference.Window(*at, 12.0)),
}


def require_parity(found, plots, radar, acceleration, begin):
    """Check all rows with plots, in units of the standard deviations."""
    z, covariance = plots.to_cartesian([radar])
    np.testing.assert_allclose(
        covariance, [reference.noise(p, radar) for p in z], rtol=1e-9, atol=1e-6
    )
    assert np.all(found.track_of_plot == 1)
    rows = found[found.plot >= 0]
    mean, expected, turns, guarded = reference.followed(plots.time, z, radar, begin, acceleration)
    sigma = np.sqrt(np.diagonal(expected, axis1=1, axis2=2))
    state = np.concatenate([rows.position, rows.velocity], axis=1)
    units = sigma[:, :, np.newaxis] * sigma[:, np.newaxis]
    zeros, tolerance = np.zeros_like(mean), tolerances.PLOTS
    np.testing.assert_allclose((state - mean) / sigma, zeros, rtol=0, atol=tolerance)
    np.testing.assert_allclose(rows.covariance / units, expected / units, rtol=0, atol=tolerance)
    np.testing.assert_allclose(rows.turn_probability, turns, rtol=0, atol=tolerance)
    return rows, guarded


@pytest.mark.parametrize("motion", ["singer", "imm", "window"])
@pytest.mark.parametrize("radar", [RADAR, PRECISE], ids=["usual", "precise"])
def test_a_motion_is_that_of_the_reference(motion, radar):
    plots = sidestep(radar)
    found = track(plots, [radar], motion=motion)
    rows, guarded = require_parity(found, plots, radar, *MODELS[motion])
    assert guarded[3:].any() or radar is RADAR
    assert np.sum(found.plot < 0) == 5
    if motion in {"imm", "window"}:
        assert rows.turn_probability[22:36].mean() > 0.7


def test_straight_flight_is_that_of_the_reference():
    plots = line(40)[gaps(40)]
    found = track(plots, [RADAR], motion="cv")
    require_parity(found, plots, RADAR, *MODELS["cv"])


@pytest.mark.parametrize(("radar", "acceleration"), [(RADAR, 12.0), (PRECISE, 12.0), (SLOW, 7.0)])
def test_the_window_along_a_plan_is_that_of_the_reference(radar, acceleration):
    plots = planned_turn(radar)
    plan = FlightPlan(CORNER, 160.0, identity=7)
    found = track(plots, [radar], motion="window", plans=[plan])

    def begin(*at):
        return reference.Window(*at, acceleration, CORNER, 160.0)

    rows, _ = require_parity(found, plots, radar, acceleration, begin)
    assert np.all(rows.conforms[3:])
    without = track(plots, [radar], motion="window")
    assert not np.allclose(found.position, without.position, rtol=0, atol=1.0)
    silent = track(plots, [radar], motion="window", plans=[plan], plan_model=PlanModel(0.0))
    np.testing.assert_array_equal(silent.position, without.position)


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


@pytest.mark.parametrize("motion", ["imm", "singer"])
def test_covariances_hold(motion):
    time, position, velocity = turning_flight()
    nees = np.full((60, len(time)), np.nan)
    for seed in range(60):
        plots = Plots(time, *noisy(position, RADAR, np.random.default_rng([7, seed])))
        found = track(plots, [RADAR], motion=motion)
        assert np.all(found.track == 1)
        covariance = found.covariance
        assert np.array_equal(covariance, np.swapaxes(covariance, 1, 2))
        assert np.linalg.eigvalsh(covariance).min() > 0
        found = found[found.plot >= 0]
        error = np.concatenate(
            [found.position - position[found.plot], found.velocity - velocity[found.plot]], axis=1
        )
        inverse = np.linalg.inv(found.covariance)
        nees[seed, found.plot] = np.einsum("ni,nij,nj->n", error, inverse, error) / 4
    mean = np.nanmean(nees, axis=0)
    # straight flight is easier than the models think; a turn of 2 degrees a second that begins at
    # once is not seen for two scans
    assert np.all(mean[:20] < 1.3)
    assert np.all(mean[23:] < (1.6 if motion == "imm" else 2.2))
    assert mean.mean() < 1.5


def scene(seed, n=40, clutter=50.0):
    """Traffic of the middle set-up, and its plots."""
    set_up = simulate.set_up("middle")
    plans = simulate.routes("middle", n, rng=seed)
    traffic = simulate.flights(plans, wind=15.0, rng=seed + 1)
    seen = simulate.radar_plots(traffic, [set_up.radar], clutter=clutter, rng=seed + 2)
    return set_up.radar, traffic, seen


@pytest.mark.parametrize("motion", ["imm", "singer"])
def test_tracks_are_held_and_not_invented(motion):
    radar, traffic, seen = scene(11)
    found = track(seen.plots, [radar], motion=motion)
    used = found.plot >= 0
    target = np.where(used, seen.target[found.plot], -2)
    best = {}
    for number in np.unique(found.track):
        of = target[(found.track == number) & used]
        values, counts = np.unique(of, return_counts=True)
        assert counts.max() / counts.sum() > 0.9, f"track {number} changes its target"
        best.setdefault(values[counts.argmax()], []).append(number)
    scans = np.ptp(seen.plots.time) / radar.scan_period
    assert len(best.pop(-1, [])) < 0.02 * scans
    assert len(best) == len(traffic)
    assert sum(len(tracks) > 1 for tracks in best.values()) <= 2
    held = [np.sum(np.isin(target, f) & found.confirmed) / np.sum(seen.target == f) for f in best]
    assert np.mean(held) > 0.96


def test_two_radars_are_better_than_one():
    other = Radar(
        [60e3, 0.0],
        range_sigma=50.0,
        azimuth_sigma=np.radians(0.08),
        scan_period=5.3,
        max_range=200e3,
    )
    rms = {}
    for radars in ([RADAR], [RADAR, other]):
        errors, squares = [], []
        for seed in range(30):
            rng = np.random.default_rng([21, seed])
            columns = []
            for index, radar in enumerate(radars):
                time = 0.7 * index + radar.scan_period * np.arange(int(240 / radar.scan_period))
                position = np.array([10e3, 30e3]) + np.outer(time, [120.0, 80.0])
                distance, azimuth = noisy(position - radar.position, radar, rng)
                columns.append((time, distance, azimuth, np.full(len(time), index)))
            time, distance, azimuth, index = np.concatenate(columns, axis=1)
            plots = Plots(time, distance, azimuth, sensor=index.astype(int))
            found = track(plots, radars)
            assert len(np.unique(found.track)) == 1
            error = found.position - np.outer(found.time, [120.0, 80.0]) - [10e3, 30e3]
            settled = found.time > 60
            errors.append(error[settled])
            inverse = np.linalg.inv(found.covariance[settled][:, :2, :2])
            squares.append(np.einsum("ni,nij,nj->n", errors[-1], inverse, errors[-1]))
        rms[len(radars)] = np.sqrt(np.mean(np.concatenate(errors) ** 2))
        assert np.mean(np.concatenate(squares)) / 2 < 1.1
    assert rms[2] < 0.8 * rms[1]


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_saved_tracker_goes_on_to_the_last_bit(motion):
    _, _, seen = scene(31, n=10, clutter=10.0)
    radar = simulate.set_up("middle").radar
    plans = simulate.routes("middle", 10, rng=31) if motion in {"imm", "window"} else []
    half = np.median(seen.plots.time)
    first, second = seen.plots[seen.plots.time < half], seen.plots[seen.plots.time >= half]
    tracker = Tracker([radar], motion=motion, plans=plans)
    tracker.update(first)
    loaded = pickle.loads(pickle.dumps(tracker))
    copied = copy.deepcopy(tracker)
    expected = tracker.update(second)
    for other in (loaded, copied):
        found = other.update(second)
        for name in TrackTable.__slots__:
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert repr(loaded) == repr(tracker)


def columns(table):
    """All columns of a table."""
    return {name: getattr(table, name) for name in TrackTable.__slots__}


def test_tracks_do_not_depend_on_the_number_of_threads():
    traffic = simulate.dense_traffic(1200, area=(120e3, 120e3), duration=12.0, rng=1)
    radars = [
        Radar((x, 0.0), range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0, max_range=150e3)
        for x in (-30e3, 0.0, 30e3)
    ]
    plots = simulate.radar_plots(traffic, radars, clutter=200.0, rng=2).plots
    one = track(plots, radars, n_threads=1)
    # stretches of three seconds have room for two threads
    assert len(plots) / 4 > 2000
    assert len(np.unique(one.track)) > 1000
    for n_threads in (2, 3, None):
        found = columns(track(plots, radars, n_threads=n_threads))
        for name, column in columns(one).items():
            np.testing.assert_array_equal(found[name], column, name)
    with pytest.raises(ValueError, match="n_threads is 0"):
        Tracker(radars, n_threads=0)


def test_a_target_may_be_seen_by_many_radars():
    rng = np.random.default_rng(5)
    places = rng.uniform(-20e3, 20e3, (7, 2))
    radars = [
        Radar(place, range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0) for place in places
    ]
    time = np.arange(0.0, 60.0, 0.5)
    radar = np.arange(len(time)) % 8
    time, radar = time[radar < 7], radar[radar < 7]
    position = np.array([10e3, 30e3]) + np.outer(time, [120.0, -80.0])
    plots = Plots(time, *noisy(position - places[radar], radars[0], rng), sensor=radar)
    tracker = Tracker(radars)
    # each plot of the first stretch begins a track, one of which goes on
    before = tracker.update(plots[:50])
    copied = pickle.loads(pickle.dumps(tracker))
    table = tracker.update(plots[50:])
    assert set(before.track_of_plot[10:]) == set(table.track_of_plot)
    assert len(set(table.track_of_plot)) == 1
    assert set(table.sensor) == set(range(7))
    assert np.all(np.hypot(*(table.position - position[table.plot]).T) < 200.0)
    np.testing.assert_array_equal(copied.update(plots[50:]).covariance, table.covariance)


def test_a_table_is_complete_wherever_it_goes():
    table = track(line(), [RADAR])
    for other in (pickle.loads(pickle.dumps(table)), copy.copy(table), table[:]):
        for name, column in columns(table).items():
            np.testing.assert_array_equal(getattr(other, name), column)
    assert table.position.shape == table.velocity.shape == (20, 2)
    assert table.covariance.shape == (20, 4, 4)
    assert all(column.flags.c_contiguous for column in columns(table).values())
    with pytest.raises(AttributeError, match="no attribute 'speed'"):
        _ = table.speed
    with pytest.raises(ValueError, match=r"time has shape \(\)"):
        line()[3]


def test_the_order_of_plots_does_not_matter():
    radar, _, seen = scene(41, n=15)
    order = np.random.default_rng(1).permutation(len(seen))
    one, other = track(seen.plots, [radar]), track(seen.plots[order], [radar])
    np.testing.assert_array_equal(one.position, other.position)
    np.testing.assert_array_equal(one.plot[one.plot >= 0], order[other.plot[other.plot >= 0]])


def test_bad_plots_are_told_and_lose_no_track():
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


def test_scans_without_plots_end_tracks():
    tracker = Tracker([RADAR], coasting=3)
    plots = line(10)
    tracker.update(plots)
    alive = [len(tracker.update(plots[:0], time=36.0 + 4.0 * k).track) for k in range(1, 8)]
    # a scan is missed a quarter of it late
    assert alive == [0, 1, 1, 1, 1, 0, 0]
    assert len(tracker.extrapolate(0.0)[0]) == 0
    assert len(Tracker([RADAR]).update(plots[:0])) == 0


def test_a_missed_scan_is_a_row_without_plot():
    plots = line(20)
    found = track(plots[np.arange(20) != 12], [RADAR])
    assert len(np.unique(found.track)) == 1
    assert np.sum(found.plot < 0) == 1
    missed = np.flatnonzero(found.plot < 0)[0]
    trace = np.trace(found.covariance, axis1=1, axis2=2)
    assert trace[missed] > trace[missed - 1]


def test_targets_that_a_beam_passes_at_once_are_no_clutter():
    # four plots in a fortieth of a scan, three in the next
    radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0, max_range=80e3)
    time = 4.0 * np.arange(3)
    at = np.array([[-15e3, 60e3], [-5e3, 60e3], [5e3, 60e3], [15e3, 60e3]])
    position = at[:, np.newaxis] + np.multiply.outer(time, [0.0, 230.0])
    rows = np.ones((4, 3), dtype=bool)
    rows[3, 1] = False
    when = np.broadcast_to(time + 0.025 * np.arange(4)[:, np.newaxis], (4, 3))[rows]
    confirmed = 0
    for seed in range(20):
        distance, azimuth = noisy(position[rows], radar, np.random.default_rng(seed))
        plots = Plots(when, distance, azimuth)
        tracker = Tracker([radar])
        tables = [tracker.update(plots[(when > t - 1) & (when < t + 1)]) for t in time]
        confirmed += np.unique(tables[-1].track[tables[-1].confirmed]).size
    # of three in each run; were they taken for clutter, a third would not be
    assert confirmed >= 58


def test_a_large_error_of_a_plot_is_hardly_a_manoeuvre():
    time = 4.0 * np.arange(60)
    position = np.array([10e3, 30e3]) + np.outer(time, [120.0, -80.0])
    distance, azimuth = noisy(position, RADAR, np.random.default_rng(4))
    spread = []
    for error in (3.9, 4.5):
        distance[-1] = np.hypot(*position[-1]) + error * RADAR.range_sigma
        found = track(Plots(time, distance, azimuth), [RADAR], motion="cv")
        # both are beyond the gate
        at = found.innovation[-1]
        assert at @ np.linalg.solve(found.innovation_covariance[-1], at) > 12.43
        assert found.plot[-1] == 59
        spread.append(np.sqrt(np.trace(found.covariance[-1, 2:, 2:])))
    # were it always, or never, taken for a manoeuvre, the covariances would be the same
    assert spread[0] < 0.9 * spread[1]


def test_crossing_targets_keep_their_tracks():
    swapped = 0
    for seed in range(20):
        rng = np.random.default_rng([51, seed])
        time = 4.0 * np.arange(50)
        first = np.array([-15e3, 40e3]) + np.outer(time, [150.0, 10.0])
        second = np.array([-15e3, 42e3]) + np.outer(time, [150.0, -10.0])
        columns = [noisy(first, RADAR, rng), noisy(second, RADAR, rng)]
        distance, azimuth = np.concatenate(columns, axis=1)
        found = track(Plots(np.tile(time, 2), distance, azimuth), [RADAR])
        target = found.plot >= 50
        for number in np.unique(found.track):
            of = target[(found.track == number) & (found.plot >= 0)]
            swapped += of[0] != of[-1]
    assert swapped <= 8


def test_identities_keep_targets_apart():
    time = 4.0 * np.arange(50)
    rng = np.random.default_rng(61)
    first = np.array([-15e3, 40e3]) + np.outer(time, [150.0, 2.0])
    second = np.array([-15e3, 40.4e3]) + np.outer(time, [150.0, -2.0])
    columns = [noisy(first, RADAR, rng), noisy(second, RADAR, rng)]
    distance, azimuth = np.concatenate(columns, axis=1)
    identity = np.repeat([0o1234, 0o4321], 50)
    found = track(Plots(np.tile(time, 2), distance, azimuth, identity=identity), [RADAR])
    for number in np.unique(found.track):
        of = identity[found.plot[(found.track == number) & (found.plot >= 0)]]
        assert len(np.unique(of)) == 1
    assert set(found.identity[found.confirmed]) == {0o1234, 0o4321}


def test_heights_keep_targets_apart_and_are_filtered():
    time = 4.0 * np.arange(60)
    rng = np.random.default_rng(62)
    position = np.array([-15e3, 40e3]) + np.outer(time, [150.0, 0.0])
    height = np.stack([np.full(60, 8000.0), 9000.0 + 10.0 * time])
    ground = np.hypot(*position.T)
    slant = np.sqrt(ground**2 + height**2) + 50 * rng.standard_normal((2, 60))
    azimuth = polar(position)[1] + RADAR.azimuth_sigma * rng.standard_normal((2, 60))
    rounded = np.round(height / 30.48) * 30.48
    plots = Plots(np.tile(time, 2), slant.ravel(), azimuth.ravel(), height=rounded.ravel())
    found = track(plots, [RADAR])
    assert len(np.unique(found.track)) == 2
    climbing = (found.plot >= 60) & (found.time > 100)
    assert np.abs(found.vertical_rate[climbing] - 10.0).max() < 3.0
    for number in np.unique(found.track):
        of = found.plot[(found.track == number) & (found.plot >= 0)] >= 60
        assert np.all(of == of[0])


CLOSE = Radar(range_sigma=15.0, azimuth_sigma=5e-4, scan_period=4.0, max_range=113e3)


def beamed(places, scans, identity, rng):
    """Plots of targets at the times at which the beam points at them."""
    distance, azimuth = np.hypot(*places.T), np.arctan2(*places.T) % (2 * np.pi)
    time = 4.0 * (scans + azimuth / (2 * np.pi))
    n = len(places)
    distance, azimuth = (
        distance + 10 * rng.standard_normal(n),
        azimuth + 5e-4 * rng.standard_normal(n),
    )
    return Plots(time, distance, azimuth, identity=identity)


@pytest.mark.parametrize("coasting", [5, 30])
def test_a_track_without_plots_takes_none_from_others(coasting):
    angle = 2 * np.pi * (np.arange(8) + 0.5) / 8
    parked = 1200 * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    vanishing = np.stack([np.full(20, 500.0), -400.0 + 40 * np.arange(20)], axis=-1)
    places = np.concatenate([np.tile(parked, (60, 1)), vanishing])
    scans = np.concatenate([np.repeat(np.arange(60), 8), np.arange(20)])
    identity = np.concatenate([np.tile(np.arange(8), 60), np.full(20, 90)])
    plots = beamed(places, scans, identity, np.random.default_rng(1))
    found = track(plots, [CLOSE], coasting=coasting, identity_error_probability=1e-9)
    assert len(np.unique(found.track)) == 9
    assert np.all(found.track_of_plot > 0)
    for target in np.unique(identity):
        assert len(np.unique(found.track_of_plot[identity == target])) == 1


@pytest.mark.parametrize("aside", [300.0, -300.0])
@pytest.mark.parametrize("silent", [0.0, 1500.0, 8000.0])
def test_a_target_that_passes_the_radar_keeps_its_track(aside, silent):
    places, scans = [], []
    for scan in range(80):
        time = 4.0 * scan
        for _ in range(30):
            place = np.array([aside, 220 * (time - 160)])
            time = 4.0 * (scan + (np.arctan2(*place) % (2 * np.pi)) / (2 * np.pi))
        if np.hypot(*place) > silent:
            places.append(place)
            scans.append(scan)
    plots = beamed(np.array(places), np.array(scans), 5, np.random.default_rng(2))
    found = track(plots, [CLOSE], coasting=30)
    assert np.all(found.track_of_plot == 1)


def test_a_manoeuvre_is_flagged_soon():
    delays = []
    for seed in range(30):
        time, position, _ = turning_flight()
        plots = Plots(time, *noisy(position, RADAR, np.random.default_rng([71, seed])))
        found = track(plots, [RADAR])
        begins = np.flatnonzero((found.turn_probability > 0.5) & (found.time >= 80.0))
        delays.append(found.time[begins[0]] - 80.0)
        assert np.mean(found.turn_probability[5:20] > 0.5) < 0.2
    assert np.median(delays) <= 20.0


def test_plans_help_and_prior_zero_is_the_plain_imm():
    plans = simulate.routes("middle", 40, rng=81)
    traffic = simulate.flights(plans, wind=20.0, rng=82)
    radar = simulate.set_up("middle").radar
    seen = simulate.radar_plots(traffic, [radar], rng=83)
    square = {"with": [], "without": []}
    for flight in range(40):
        of = seen.target == flight
        if of.sum() < 20:
            continue
        plots = seen.plots[of]
        plain = track(plots, [radar])
        silent = track(plots, [radar], plans=[plans[flight]], plan_model=PlanModel(0.0))
        np.testing.assert_allclose(silent.position, plain.position, rtol=0, atol=1e-6)
        aided = track(plots, [radar], plans=[plans[flight]])
        assert np.all(aided.plan[-5:] == 0)
        span = traffic.start[flight] + traffic.step * np.arange(traffic.count[flight])
        count = traffic.count[flight]
        for name, found in (("with", aided), ("without", plain)):
            kept = found.confirmed
            turning = np.interp(found.time, span, traffic.turning[flight, :count]) > 0.5
            true = np.stack(
                [np.interp(found.time, span, traffic.position[flight, :count, i]) for i in (0, 1)],
                axis=-1,
            )
            square[name].append(np.sum((found.position - true) ** 2, axis=1)[kept & turning])
    rms = {name: np.sqrt(np.mean(np.concatenate(values))) for name, values in square.items()}
    assert rms["with"] < 0.85 * rms["without"]


def test_a_wrong_plan_is_blocked_and_does_no_harm():
    plans = simulate.routes("middle", 40, rng=91)
    traffic = simulate.flights(plans, scenario="hijack", wind=20.0, rng=92)
    radar = simulate.set_up("middle").radar
    seen = simulate.radar_plots(traffic, [radar], rng=93)
    square = {"with": [], "without": []}
    blocked = []
    for flight in range(40):
        left, of = traffic.left[flight], seen.target == flight
        if of.sum() < 20 or np.isnan(left):
            continue
        count = traffic.count[flight]
        span = traffic.start[flight] + traffic.step * np.arange(count)
        if span[-1] < left + 60:
            continue
        tables = {
            "with": track(seen.plots[of], [radar], plans=[plans[flight]]),
            "without": track(seen.plots[of], [radar]),
        }
        for name, found in tables.items():
            after = found.confirmed & (found.time > left)
            true = np.stack(
                [np.interp(found.time, span, traffic.position[flight, :count, i]) for i in (0, 1)],
                axis=-1,
            )
            square[name].append(np.sum((found.position - true) ** 2, axis=1)[after])
        table = tables["with"]
        blocked.append(np.any(~table.conforms[(table.time > left) & (table.time < left + 60)]))
    rms = {name: np.sqrt(np.mean(np.concatenate(values))) for name, values in square.items()}
    assert rms["with"] < 1.04 * rms["without"]
    assert np.mean(blocked) > 0.9


def lost_and_turns(scenario, seed, flights=60):
    """Flights in more than one track, and squared errors in turns, of the window and by plans."""
    plans = simulate.routes("middle", flights, rng=seed)
    traffic = simulate.flights(plans, scenario=scenario, wind=20.0, rng=seed + 1)
    radar = simulate.set_up("middle").radar
    seen = simulate.radar_plots(traffic, [radar], rng=seed + 2)
    lost, squares = np.zeros(2, dtype=int), ([], [])
    for flight in range(flights):
        plots = seen.plots[seen.target == flight]
        if len(plots) < 20:
            continue
        count = traffic.count[flight]
        span = traffic.start[flight] + traffic.step * np.arange(count)
        for i, plan in enumerate(([], [plans[flight]])):
            found = track(plots, [radar], motion="window", plans=plan)
            lost[i] += len(np.unique(found.track)) > 1
            turning = np.interp(found.time, span, traffic.turning[flight, :count]) > 0.5
            columns = [traffic.position[flight, :count, axis] for axis in (0, 1)]
            true = np.stack([np.interp(found.time, span, column) for column in columns], axis=-1)
            square = np.sum((found.position - true) ** 2, axis=1)
            squares[i].append(square[turning & found.confirmed])
    return lost, [np.mean(np.concatenate(each)) for each in squares]


def test_the_window_holds_flights_that_turn_and_a_plan_makes_it_better():
    lost, (usual, aided) = lost_and_turns("conforming", 101)
    assert np.all(lost <= 1)
    assert np.sqrt(aided / usual) < 0.9


@pytest.mark.parametrize("scenario", ["wrong-turn", "straight-on"])
def test_the_window_survives_a_wrong_plan(scenario):
    lost, _ = lost_and_turns(scenario, 111)
    assert np.all(lost <= 1)


@pytest.mark.parametrize(
    ("period", "expected"), [(2.0, 12.0), (4.0, 12.0), (7.0, 9.5), (12.0, 7.0)]
)
def test_the_guard_of_the_window_depends_on_the_scan(period, expected):
    radar = Radar(range_sigma=1.0, azimuth_sigma=1e-5, scan_period=period)
    time = period * np.arange(12)
    position = np.array([10e3, 30e3]) + np.outer(time, [120.0, -80.0])
    # the guard gate ends at three and a half standard deviations of what was not noticed
    reaches = np.array([3.0, 4.0]) * expected * period**2 / 2
    kept = []
    for aside in reaches:
        moved = position + np.outer(time == time[-1], [aside, 0.0])
        found = track(Plots(time, *polar(moved)), [radar], motion="window")
        kept.append(bool(found.track_of_plot[-1] == 1))
    assert kept == [True, False]
    moved = position + np.outer(time == time[-1], [reaches[0], 0.0])
    narrow = track(Plots(time, *polar(moved)), [radar], motion="window", guard_acceleration=5.0)
    assert narrow.track_of_plot[-1] != 1


def test_a_known_wind_makes_turns_better():
    plans = simulate.routes("en-route", 30, rng=101)
    wind = np.array([30.0, -25.0])
    traffic = simulate.flights(plans, wind=wind, rng=102)
    radar = simulate.set_up("en-route").radar
    seen = simulate.radar_plots(traffic, [radar], rng=103)
    options = {
        "known": PlanModel(wind=(33.0, -29.0), wind_sigma=6.0),
        "unknown": PlanModel(wind_sigma=30.0),
        "wrong": PlanModel(wind=-wind, wind_sigma=6.0),
    }
    square = {name: [] for name in options}
    for flight in range(30):
        count = traffic.count[flight]
        span = traffic.start[flight] + traffic.step * np.arange(count)
        for name, model in options.items():
            of = seen.target == flight
            found = track(seen.plots[of], [radar], plans=[plans[flight]], plan_model=model)
            turning = np.interp(found.time, span, traffic.turning[flight, :count]) > 0.5
            true = np.stack(
                [np.interp(found.time, span, traffic.position[flight, :count, i]) for i in (0, 1)],
                axis=-1,
            )
            error = np.sum((found.position - true) ** 2, axis=1)
            square[name].append(error[found.confirmed & turning])
    rms = {name: np.sqrt(np.mean(np.concatenate(values))) for name, values in square.items()}
    assert rms["known"] < 0.95 * rms["unknown"]
    assert rms["wrong"] > 1.1 * rms["known"]


def on_plan(n=40, identity=None):
    """A flight on the leg of its plan, a plot at a time, and the plan."""
    plan = FlightPlan([[-30e3, 40e3], [40e3, 40e3], [60e3, 60e3]], 150.0, identity=0o4321)
    time = 4.0 * np.arange(n)
    position = np.array([-30e3, 40e3]) + np.outer(time, [150.0, 0.0])
    numbers = noisy(position, RADAR, np.random.default_rng(9))
    codes = np.full(n, 0o4321) if identity is None else identity
    return Plots(time, *numbers, identity=codes), plan


@pytest.mark.parametrize("motion", ["imm", "window"])
def test_a_held_plan_is_blocked_until_it_is_released(motion):
    plots, plan = on_plan()
    tracker = Tracker([RADAR], motion=motion, plans=[plan])
    plain = track(plots, [RADAR], motion=motion)
    with pytest.raises(ValueError, match="track is 1; there is no confirmed track"):
        tracker.suspend_plan(1)
    assert tracker.update(plots[:15]).conforms[-1]
    assert len(tracker.suspended_plans) == 0
    tracker.suspend_plan(1)
    np.testing.assert_array_equal(tracker.suspended_plans, [1])
    # the copy is held, too
    tracker = pickle.loads(pickle.dumps(tracker))
    held = tracker.update(plots[15:28])
    assert len(held) == 13
    assert not held.conforms.any()
    assert np.all(held.plan == 0)
    straight = held.position[-1] + 120.0 * held.velocity[-1]
    np.testing.assert_allclose(tracker.extrapolate(120.0)[1][0], straight, atol=1e-6)
    tracker.resume_plan(1)
    assert len(tracker.suspended_plans) == 0
    released = tracker.update(plots[28:])
    assert not released.conforms[:4].any()
    assert released.conforms[4:].all()
    # held before the plan was found: the plan has no say at all
    early, (plots, _) = (
        Tracker([RADAR], motion=motion, plans=[plan]),
        on_plan(identity=np.full(40, -1)),
    )
    tables = [early.update(plots[:5])]
    assert tables[0].plan[-1] == -1
    early.suspend_plan(1)
    tables += [early.update(plots[[k]]) for k in range(5, len(plots))]
    assert not any(table.conforms.any() for table in tables)
    position = np.concatenate([table.position for table in tables])
    assert tables[-1].plan[0] == 0
    np.testing.assert_allclose(position[-1], plain.position[-1], rtol=0, atol=1e-6)
    for number in (7, "1"):
        with pytest.raises((ValueError, TypeError), match="track"):
            tracker.resume_plan(number)


@pytest.mark.parametrize("code", [0o7500, 0o7600, 0o7700])
def test_an_emergency_holds_the_plan(code):
    codes = np.full(40, 0o4321)
    codes[12] = codes[20:22] = code
    plots, plan = on_plan(identity=codes)
    tracker = Tracker([RADAR], plans=[plan], emergency_codes=(0o7500, 0o7600, 0o7700))
    found = tracker.update(plots)
    # one answer may be read wrongly; what was held stays so, and the identity stays
    of = {plot: row for row, plot in enumerate(found.plot)}
    assert found.conforms[of[10] : of[20] + 1].all()
    assert not found.conforms[of[21] :].any()
    assert np.all(found.identity == 0o4321)
    assert np.all(found.track == 1)
    np.testing.assert_array_equal(tracker.suspended_plans, [1])
    # an identity like any other, where it is no emergency
    assert track(plots, [RADAR], plans=[plan]).conforms[-1]


def test_extrapolation_follows_the_plan():
    plan = FlightPlan([[-30e3, 40e3], [10e3, 40e3], [10e3, 90e3]], 150.0)
    time = 4.0 * np.arange(50)
    position = np.array([-30e3, 40e3]) + np.outer(time, [150.0, 0.0])
    plots = Plots(time, *noisy(position, RADAR, np.random.default_rng(5)))
    aided, plain = Tracker([RADAR], plans=[plan]), Tracker([RADAR])
    aided.update(plots)
    plain.update(plots)
    corner = np.array([10e3, 40e3])
    (number,), (there,) = aided.extrapolate(120.0)
    assert number == 1
    assert np.linalg.norm(plain.extrapolate(120.0)[1][0] - [17.4e3, 40e3]) < 3000
    assert there[0] < corner[0] + 500
    assert there[1] > corner[1] + 2000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sensors": []}, "sensors is empty"),
        ({"sensors": [3]}, r"sensors\[0\] is 3"),
        ({"motion": "kalman"}, "motion is 'kalman'"),
        ({"confirmation": (1, 4)}, "confirmation is 1"),
        ({"confirmation": (4, 3)}, "confirmation"),
        ({"coasting": 0}, "coasting is 0"),
        ({"max_speed": -1.0}, "max_speed"),
        ({"gate_probability": 1.0}, "gate_probability is 1"),
        ({"clutter_density": 0.0}, "clutter_density"),
        ({"identity_error_probability": 0.0}, "identity_error_probability"),
        ({"guard_acceleration": -1.0}, "guard_acceleration"),
        ({"plan_model": 0.8}, "plan_model is 0.8; it must be a PlanModel"),
        ({"motion": 3}, "motion is 3; it must be a model"),
        ({"motion": SingerModel(4.0, 0.05, 1.0)}, "it must be exact"),
        ({"emergency_codes": [-1]}, "emergency_codes is -1"),
        ({"plans": [3]}, r"plans\[0\] is 3"),
        ({"clock_period": 0.0}, "clock_period"),
        ({"sensors": RADAR}, "it must be a sequence of Radar"),
        ({"plans": FlightPlan([[0, 0], [1, 1]], 100.0)}, "it must be a sequence of FlightPlan"),
        ({"confirmation": 3}, "it must be a pair"),
        ({"plans": [FlightPlan([[0, 0], [1, 1]], 100.0)], "motion": "cv"}, "takes no plans"),
    ],
)
def test_wrong_settings_are_refused(change, message):
    with pytest.raises((ValueError, TypeError), match=message):
        Tracker(**{"sensors": [RADAR], **change})


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"time": [[0.0]]}, r"time has shape \(1, 1\)"),
        ({"range": [1.0, 2.0, 3.0]}, r"range has shape \(3,\)"),
        ({"sensor": [0.5, 0.5]}, "sensor has dtype float64"),
        ({"time": ["a", "b"]}, "time has dtype"),
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
    with pytest.raises(ValueError, match="end"):
        tracker.update(line(3), time=np.nan)
    with pytest.raises(ValueError, match="seconds is nan"):
        tracker.extrapolate(np.nan)


def test_no_plots_are_no_tracks():
    nothing = Plots([], [], [], sensor=[], identity=[])
    assert len(nothing) == 0
    assert len(track(nothing, [RADAR])) == 0


@pytest.mark.parametrize(
    "change",
    [
        {"range_sigma": 0.0},
        {"azimuth_sigma": np.nan},
        {"scan_period": -4.0},
        {"max_range": 0.0},
        {"detection_probability": 1.0},
        {"position": [1.0]},
    ],
)
def test_wrong_radars_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        Radar(**{"range_sigma": 50.0, "azimuth_sigma": 0.001, "scan_period": 4.0, **change})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ImmModel(turn_time=0.0), "turn_time"),
        (lambda: CvModel(-1.0), "straight_sigma"),
        (lambda: WindowModel(after_turn=1), "after_turn is 1"),
        (lambda: PlanModel(1.0), "flown_probability is 1.0"),
        (lambda: PlanModel(wind_sigma=np.nan), "wind_sigma"),
        (lambda: PlanModel(wind=(np.inf, 0.0)), "wind"),
        (lambda: PlanModel(wind=5.0), r"wind has shape \(\)"),
    ],
)
def test_wrong_models_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
