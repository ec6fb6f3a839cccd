"""Velocities that come with positions: in filters, in the choice of plots, and in first plots."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from checks import in_region
from tracker.flights import predicted
from tracker.test_positions import DURATION, PACE, SETTLED, SIGMA, reports, rms

from tertia import simulate
from tertia.kalman import SingerModel
from tertia.metrics import nees
from tertia.sensors import PositionSensor, Radar
from tertia.tracker import CvModel, Plots, Tracker, smooth_tracks, track


def scene(seed, interval=4.0, count=20, velocity_sigmas=(0.5, 3.0)):
    """Straight flights that report positions and velocities; plots and their targets."""
    random = np.random.default_rng([31, seed])
    traffic = simulate.dense_traffic(
        count, area=(120e3, 120e3), turning_share=0.0, duration=DURATION, rng=random
    )
    time, target, position, covariance = reports(traffic, interval, (15.0, 40.0), 0.95, random)
    _, truth = traffic.at(target, time)
    sigma = random.uniform(*velocity_sigmas, (len(time), 2))
    spread = sigma[:, :, np.newaxis] * sigma[:, np.newaxis]
    spread[:, [0, 1], [1, 0]] *= -0.3
    noise = random.normal(size=(len(time), 2, 1))
    velocity = truth + (np.linalg.cholesky(spread) @ noise)[..., 0]
    plots = Plots(
        time,
        position=position,
        covariance=covariance,
        velocity=velocity,
        velocity_covariance=spread,
    )
    sensor = PositionSensor(update_interval=interval, detection_probability=0.95)
    return traffic, sensor, plots, target


def known(traffic, plots, target):
    """Errors and normalised squares of Kalman filters that know whose plots they have."""
    errors, squares = [], []
    for own in range(len(traffic.position)):
        rows = np.flatnonzero(target == own)
        rows = rows[np.argsort(plots.time[rows])]
        mean, covariance = np.zeros(4), np.diag([1e12, 1e12, 175.0**2, 175.0**2])
        states, matrices, last = [], [], plots.time[rows[0]]
        for row in rows:
            t, last = plots.time[row] - last, plots.time[row]
            mean, covariance = predicted(mean, covariance, t, SIGMA**2 * PACE)
            r = np.zeros((4, 4))
            r[:2, :2], r[2:, 2:] = plots.covariance[row], plots.velocity_covariance[row]
            gain = covariance @ np.linalg.inv(covariance + r)
            mean = mean + gain @ (np.append(plots.position[row], plots.velocity[row]) - mean)
            covariance = covariance - gain @ covariance
            states.append(mean)
            matrices.append(covariance)
        times = plots.time[rows]
        truth = np.hstack(traffic.at(np.full(len(times), own), times))
        late = (times > SETTLED) & np.isfinite(truth).all(axis=1)
        error = (np.array(states) - truth)[late]
        errors.append(error)
        squares.append(nees(error, np.array(matrices)[late]) / 4.0)
    return np.concatenate(errors), np.concatenate(squares)


def judged(traffic, table, target):
    """Errors and normalised squares of a table of tracks."""
    table = table[(table.plot >= 0) & (table.time > SETTLED)]
    own = target[table.plot]
    truth = np.hstack(traffic.at(own, table.time))
    there = np.isfinite(truth).all(axis=1)
    error = (np.hstack([table.position, table.velocity]) - truth)[there]
    return error, nees(error, table.covariance[there]) / 4.0


def wandering(seed, count=30, interval=5.0):
    """Targets whose velocities are random walks as in the model: plots, true states, the sensor."""
    random = np.random.default_rng([37, seed])
    step, steps = 0.5, 600
    velocity = random.normal(0.0, 120.0, (count, 1, 2)) + np.cumsum(
        random.normal(0.0, SIGMA * np.sqrt(PACE * step), (count, steps, 2)), axis=1
    )
    position = random.uniform(-6e4, 6e4, (count, 1, 2)) + step * np.cumsum(velocity, axis=1)
    every = round(interval / step)
    index = random.integers(0, every, (count, 1)) + every * np.arange(steps // every)
    seen = random.random(index.shape) < 0.95
    target, index = np.nonzero(seen)[0], index[seen]
    truth = np.hstack([position[target, index], velocity[target, index]])
    noise = random.normal(size=truth.shape) * [25.0, 25.0, 1.5, 1.5]
    measured = truth + noise
    plots = Plots(step * index, position=measured[:, :2], velocity=measured[:, 2:])
    sensor = PositionSensor(
        position_sigma=25.0,
        velocity_sigma=1.5,
        update_interval=interval,
        detection_probability=0.95,
    )
    return plots, truth, sensor


def test_covariances_hold_where_targets_move_as_in_the_model():
    """Monte Carlo: NEES of tracks and of smoothed tracks, and the coverage of 95 % ellipses."""
    found = {"tracks": [], "smoothed": []}
    for seed in range(4):
        plots, truth, sensor = wandering(seed)
        table = track(plots, [sensor], motion=CvModel(SIGMA))
        assert len(np.unique(table.track)) <= 31
        smoothed = smooth_tracks(plots, [sensor], table, motion=CvModel(SIGMA))
        for name, one in (("tracks", table), ("smoothed", smoothed)):
            rows = one[(one.plot >= 0) & (one.time > SETTLED)]
            error = np.hstack([rows.position, rows.velocity]) - truth[rows.plot]
            inside = in_region(error[:, 2:], rows.covariance[:, 2:, 2:])
            found[name].append([nees(error, rows.covariance) / 4.0, inside])
    for parts in found.values():
        square, inside = np.mean(np.concatenate(parts, axis=1), axis=1)
        assert 0.93 < square < 1.07
        assert 0.93 < inside < 0.97


def without(plots):
    return Plots(plots.time, position=plots.position, covariance=plots.covariance)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_velocities_are_used_as_by_a_filter_that_knows_whose_plots_they_are(seed):
    traffic, sensor, plots, target = scene(seed)
    table = track(plots, [sensor], motion=CvModel(SIGMA))
    assert len(np.unique(table.track)) <= 21
    error, square = judged(traffic, table, target)
    best, expected = known(traffic, plots, target)
    assert rms(error) < 1.02 * rms(best)
    assert rms(error[:, 2:]) < 1.02 * rms(best[:, 2:])
    assert 0.95 < np.mean(square) / np.mean(expected) < 1.05
    alone, _ = judged(traffic, track(without(plots), [sensor], motion=CvModel(SIGMA)), target)
    assert rms(error[:, 2:]) < 0.75 * rms(alone[:, 2:])


@pytest.mark.parametrize("motion", ["imm", "window", SingerModel(0.01, 20.0, 1.0, exact=True)])
def test_velocities_make_every_motion_better(motion):
    traffic, sensor, plots, target = scene(3)
    error, square = judged(traffic, track(plots, [sensor], motion=motion), target)
    alone, before = judged(traffic, track(without(plots), [sensor], motion=motion), target)
    assert rms(error[:, 2:]) < 0.6 * rms(alone[:, 2:])
    assert rms(error) < rms(alone)
    assert np.mean(square) < max(1.3, 1.1 * np.mean(before))


def test_wrong_velocities_are_left_out_and_their_positions_are_not():
    traffic, sensor, plots, target = scene(4)
    random = np.random.default_rng(5)
    velocity = plots.velocity.copy()
    wrong = random.random(len(plots)) < 0.1
    velocity[wrong] = random.uniform(-250.0, 250.0, (np.count_nonzero(wrong), 2))
    spoilt = replace(plots, velocity=velocity)
    table = track(spoilt, [sensor], motion=CvModel(SIGMA))
    assert len(np.unique(table.track)) <= 21
    error, square = judged(traffic, table, target)
    best, _ = known(traffic, plots, target)
    assert rms(error[:, 2:]) < 1.25 * rms(best[:, 2:])
    assert np.mean(square) < 1.3
    # so are those beside one another in smoothed tracks
    late, _ = judged(traffic, smooth_tracks(spoilt, [sensor], table), target)
    right, _ = judged(traffic, smooth_tracks(plots, [sensor], table), target)
    assert rms(late[:, 2:]) < 1.5 * rms(right[:, 2:])
    # their positions are those of the tracks
    assert np.mean(table.track_of_plot[wrong] > 0) > 0.98


@pytest.mark.parametrize("wrong", [-1.0, 0.5])
def test_a_sensor_whose_velocities_are_all_wrong_has_the_tracks_of_its_positions(wrong):
    traffic, sensor, plots, target = scene(5)
    spoilt = replace(plots, velocity=wrong * plots.velocity)
    table = track(spoilt, [sensor], motion=CvModel(SIGMA))
    assert len(np.unique(table.track)) <= 22
    error, _ = judged(traffic, table, target)
    alone, _ = judged(traffic, track(without(plots), [sensor], motion=CvModel(SIGMA)), target)
    assert rms(error) < 1.1 * rms(alone)


def test_velocities_tell_apart_targets_whose_paths_cross():
    """Two pairs of vessels pass one another with reports half a minute apart."""
    rng = np.random.default_rng(8)
    time = np.arange(0.0, 900.0, 30.0)
    swapped = np.zeros(2)
    for _ in range(20):
        course = rng.uniform(0, 2 * np.pi)
        ahead = np.array([np.sin(course), np.cos(course)])
        paths = [(s * 8.0 * (time[:, np.newaxis] - 450.0)) * ahead for s in (1.0, -1.0)]
        truth = np.concatenate([paths[0], paths[1] + rng.normal(0, 40.0, 2)])
        speed = np.repeat([8.0, -8.0], len(time))[:, np.newaxis] * ahead
        own = np.repeat([0, 1], len(time))
        position = truth + rng.normal(0.0, 30.0, truth.shape)
        velocity = speed + rng.normal(0.0, 0.2, truth.shape)
        sensor = PositionSensor(position_sigma=30.0, velocity_sigma=0.2, update_interval=30.0)
        times = np.tile(time, 2) + np.repeat([0.0, 1.0], len(time))
        for k, plots in enumerate(
            (Plots(times, position=position), Plots(times, position=position, velocity=velocity))
        ):
            table = track(plots, [sensor], profile="vessel")
            used = table.plot >= 0
            pairs = {*zip(table.track[used].tolist(), own[table.plot[used]].tolist(), strict=True)}
            swapped[k] += len(pairs) > 2
    assert swapped[1] == 0 < swapped[0]


def test_a_track_knows_its_velocity_from_the_first_plot_on():
    sensor = PositionSensor(position_sigma=20.0, velocity_sigma=1.0)
    plots = Plots(
        np.arange(4.0), position=np.outer(np.arange(4.0), [200.0, 0.0]), velocity=[[200.0, 0.0]] * 4
    )
    table = track(plots, [sensor])
    # one in fifty is wrong
    assert np.allclose(table.velocity[0], [200.0, 0.0], atol=10.0)
    sigma = np.sqrt(np.diagonal(table.covariance, axis1=1, axis2=2))
    assert 10.0 < sigma[0, 2] < 60.0
    assert np.all(sigma[1:, 2:] < 1.2)


def test_two_in_a_bunch_begin_as_two_tracks():
    """Vessels a few hundred metres apart report once a minute: velocities tell whose is whose."""
    rng = np.random.default_rng(11)
    time = np.arange(0.0, 600.0, 60.0)
    first = rng.uniform(0.0, 2000.0, (12, 1, 2))
    speed = rng.uniform(-12.0, 12.0, (12, 1, 2))
    truth = first + speed * time[:, np.newaxis]
    position = (truth + rng.normal(0.0, 15.0, truth.shape)).reshape(-1, 2)
    velocity = (speed + rng.normal(0.0, 0.2, truth.shape)).reshape(-1, 2)
    times = (time + rng.uniform(0.0, 10.0, (12, 1))).ravel()
    sensor = PositionSensor(position_sigma=15.0, velocity_sigma=0.2, update_interval=60.0)
    own = np.repeat(np.arange(12), len(time))
    table = track(Plots(times, position=position, velocity=velocity), [sensor], profile="vessel")
    pairs = {*zip(table.track.tolist(), own[table.plot].tolist(), strict=True)}
    assert len(np.unique(table.track)) == 12
    assert len(pairs) == 12


def final_rows(tracker, plots, order, *, saved=False):
    """Times, states and covariances of final rows of plots that come in this order."""
    parts = []
    for k, some in enumerate(np.array_split(order, 60)):
        parts.append(tracker.update(plots[some]))
        if saved and k == 30:
            tracker = pickle.loads(pickle.dumps(tracker))
    parts.append(tracker.finish())
    columns = [
        np.column_stack(
            [part.time, part.position, part.velocity, part.covariance.reshape(len(part), 16)]
        )[part.final]
        for part in parts
    ]
    rows = np.concatenate(columns)
    return rows[np.lexsort(rows.T[::-1])]


def test_late_velocities_have_their_say_with_a_lag_and_without():
    traffic, sensor, plots, target = scene(6, count=8)
    order = np.argsort(plots.time)
    plots, target = plots[order], target[order]
    random = np.random.default_rng(9)

    def late(seconds):
        many = random.random(len(plots)) < 0.3
        return np.argsort(plots.time + np.where(many, seconds, 0.0), kind="stable")

    def tracker():
        return Tracker([sensor], motion=CvModel(SIGMA), lag=10.0)

    expected = final_rows(tracker(), plots, np.arange(len(plots)))
    np.testing.assert_array_equal(final_rows(tracker(), plots, late(8.0), saved=True), expected)
    # without a lag a plot may be late by a scan
    soon = late(3.5)
    live = Tracker([sensor], motion=CvModel(SIGMA))
    squares = []
    for part in [live.update(plots[some]) for some in np.array_split(soon, 120)]:
        rows = part[(part.plot >= 0) & (part.time > SETTLED)]
        truth = np.hstack(traffic.at(target[soon[rows.plot]], rows.time))
        there = np.isfinite(truth).all(axis=1)
        error = (np.hstack([rows.position, rows.velocity]) - truth)[there]
        squares.append(nees(error, rows.covariance[there]) / 4.0)
    assert 0.5 < np.mean(np.concatenate(squares)) < 1.1


def test_hypotheses_and_smoothed_tracks_use_velocities():
    traffic, sensor, plots, target = scene(7)
    table = track(plots, [sensor], motion=CvModel(SIGMA), association="mht")
    error, square = judged(traffic, table, target)
    best, _ = known(traffic, plots, target)
    assert rms(error[:, 2:]) < 1.05 * rms(best[:, 2:])
    assert 0.6 < np.mean(square) < 1.1
    smoothed = smooth_tracks(plots, [sensor], table, motion=CvModel(SIGMA))
    late, squares = judged(traffic, smoothed, target)
    alone = smooth_tracks(without(plots), [sensor], table, motion=CvModel(SIGMA))
    before, _ = judged(traffic, alone, target)
    assert rms(late[:, 2:]) < 0.8 * rms(error[:, 2:])
    assert rms(late) < 0.95 * rms(before)
    assert rms(late[:, 2:]) < 0.95 * rms(before[:, 2:])
    assert 0.6 < np.mean(squares) < 1.1


def test_smoothed_tracks_are_those_of_least_squares():
    """With one model, smoothed states are the weighted mean of all positions and velocities."""
    rng = np.random.default_rng(12)
    time = np.arange(0.0, 80.0, 4.0)
    truth = np.array([0.0, 1e4]) + np.outer(time, [150.0, -80.0])
    position = truth + rng.normal(0.0, 30.0, truth.shape)
    velocity = np.array([150.0, -80.0]) + rng.normal(0.0, 2.0, truth.shape)
    velocity[7] = [900.0, 0.0]  # left out
    sensor = PositionSensor(position_sigma=30.0, velocity_sigma=2.0, update_interval=4.0)
    plots = Plots(time, position=position, velocity=velocity)
    tracks = track(plots, [sensor], motion="imm")
    assert np.array_equal(tracks.plot, np.arange(20))
    found = smooth_tracks(plots, [sensor], tracks, motion=CvModel(1e-6))
    right = np.arange(len(time)) != 7
    rows = np.concatenate(
        [np.column_stack([np.ones_like(time), time]) / 30.0,
         np.column_stack([np.zeros(19), np.ones(19)]) / 2.0]
    )  # fmt: skip
    for axis in (0, 1):
        seen = np.concatenate([position[:, axis] / 30.0, velocity[right, axis] / 2.0])
        (begin, speed), *_ = np.linalg.lstsq(rows, seen)
        np.testing.assert_allclose(found.velocity[:, axis], speed, rtol=1e-4)
        np.testing.assert_allclose(found.position[:, axis], begin + speed * time, atol=0.1)
    spread = np.linalg.inv(rows.T @ rows)
    np.testing.assert_allclose(found.covariance[0, 0, 0], spread[0, 0], rtol=1e-3)
    np.testing.assert_allclose(found.covariance[0, 2, 2], spread[1, 1], rtol=1e-3)


def test_what_cannot_be_a_velocity_is_refused():
    radar = Radar(range_sigma=50.0, azimuth_sigma=0.001, scan_period=4.0)
    sensor = PositionSensor(position_sigma=10.0)
    with pytest.raises(ValueError, match=r"^velocity is given, but position is None$"):
        Plots([0.0], velocity=[[1.0, 2.0]])
    with pytest.raises(ValueError, match=r"^velocity_covariance is given, but velocity is None$"):
        Plots([0.0], position=[[1.0, 2.0]], velocity_covariance=np.eye(2)[np.newaxis])
    nan = [[np.nan, np.nan]]
    plots = Plots([0.0], 1e4, 0.0, sensor=1, position=nan, velocity=[[1.0, 2.0]])
    with pytest.raises(ValueError, match=r"^plots.velocity\[0\] belongs to sensors\[1\], which"):
        track(plots, [sensor, radar], registration=False)
    # without a covariance or a sigma it is not used
    time = np.arange(10.0)
    plots = Plots(time, position=np.outer(time, [10.0, 0.0]), velocity=[[99.0, 0.0]] * 10)
    alone = Plots(time, position=plots.position)
    found, expected = track(plots, [sensor]), track(alone, [sensor])
    np.testing.assert_array_equal(found.covariance, expected.covariance)
    np.testing.assert_array_equal(found.velocity, expected.velocity)
