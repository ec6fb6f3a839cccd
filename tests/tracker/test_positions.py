"""Sensors that report positions: alone, at any rate, and together with a radar."""

import pickle

import numpy as np
import pytest
from checks import assert_refused, in_region
from tracker.flights import predicted

from tertia import simulate
from tertia.metrics import nees
from tertia.sensors import Bias, PositionSensor, Radar
from tertia.tracker import CvModel, Plots, PlotStatus, Tracker, TrackTable, track

# a constant acceleration noise for the tracker and the filter that knows all: 0.3 m/s2 over 4 s
SIGMA, PACE = 0.3, 4.0
DURATION, SETTLED = 240.0, 60.0


def reports(traffic, interval, sigmas, detected, random):
    """Return times, targets, positions and covariances of a sensor that sees all flights."""
    count = len(traffic.position)
    each = [
        np.arange(start, DURATION - 0.01, interval) for start in random.uniform(0, interval, count)
    ]
    time = np.concatenate(each)
    target = np.repeat(np.arange(count), [len(one) for one in each])
    kept = random.random(len(time)) < detected
    time, target = time[kept], target[kept]
    truth, _ = traffic.at(target, time)
    sigma = random.uniform(*sigmas, (len(time), 2))
    covariance = sigma[:, :, np.newaxis] * sigma[:, np.newaxis]
    covariance[:, 0, 1] *= 0.5
    covariance[:, 1, 0] *= 0.5
    root = np.linalg.cholesky(covariance)
    noise = random.normal(size=(len(time), 2, 1))
    return time, target, truth + (root @ noise)[..., 0], covariance


def scene(seed):
    """Return 20 straight flights, a radar, multilateration, ADS-B, their plots, and the targets."""
    random = np.random.default_rng([26, seed])
    radar = Radar(
        (-70e3, 0.0), range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0, bias=Bias()
    )
    wam = PositionSensor(update_interval=1.0, detection_probability=0.9, bias=Bias())
    adsb = PositionSensor(update_interval=2.0, detection_probability=0.95, bias=Bias())
    traffic = simulate.dense_traffic(
        20, area=(120e3, 120e3), turning_share=0.0, duration=DURATION, rng=random
    )
    record = simulate.radar_plots(traffic, [radar], rng=random)
    seen = record.plots
    none = np.full((len(seen), 2), np.nan)
    parts = [
        (seen.time, seen.range, seen.azimuth, seen.height, 0, none, record.target),
    ]
    covariances = [np.full((len(seen), 2, 2), np.nan)]
    for sensor, numbers in ((1, (1.0, (20.0, 60.0), 0.9)), (2, (2.0, (15.0, 40.0), 0.95))):
        time, target, position, covariance = reports(traffic, *numbers, random)
        nothing = np.full(len(time), np.nan)
        parts.append((time, nothing, nothing, nothing, sensor, position, target))
        covariances.append(covariance)
    time, rho, azimuth, height, _, position, target = (
        np.concatenate([np.atleast_1d(part[k]) for part in parts]) for k in range(7)
    )
    sensor = np.repeat([0, 1, 2], [len(part[0]) for part in parts])
    plots = Plots(
        time, rho, azimuth, sensor=sensor, height=height, position=position,
        covariance=np.concatenate(covariances),
    )  # fmt: skip
    return traffic, [radar, wam, adsb], plots, target


def who_knows_all(traffic, sensors, plots, target):
    """Return errors and normalised squares of one Kalman filter per target, of its own plots."""
    polar = np.flatnonzero(plots.sensor == 0)
    z, r = plots.position.copy(), plots.covariance.copy()
    if len(polar):
        z[polar], r[polar] = plots[polar].to_cartesian(sensors[:1])
    errors, squares = [], []
    for own in range(len(traffic.position)):
        rows = np.flatnonzero(target == own)
        rows = rows[np.argsort(plots.time[rows])]
        mean, covariance = (
            np.append(z[rows[0]], [0.0, 0.0]),
            np.diag([0.0, 0.0, 175.0**2, 175.0**2]),
        )
        covariance[:2, :2] = r[rows[0]]
        states, matrices, last = [], [], plots.time[rows[0]]
        for row in rows[1:]:
            t, last = plots.time[row] - last, plots.time[row]
            mean, covariance = predicted(mean, covariance, t, SIGMA**2 * PACE)
            gain = covariance[:, :2] @ np.linalg.inv(covariance[:2, :2] + r[row])
            mean = mean + gain @ (z[row] - mean[:2])
            covariance = covariance - gain @ covariance[:2]
            states.append(mean)
            matrices.append(covariance)
        times = plots.time[rows[1:]]
        truth = np.hstack(traffic.at(np.full(len(times), own), times))
        late = (times > SETTLED) & np.isfinite(truth).all(axis=1)
        error = (np.array(states) - truth)[late]
        errors.append(error)
        squares.append(nees(error, np.array(matrices)[late]))
    return np.concatenate(errors), np.concatenate(squares)


def rms(error):
    return np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1)))


@pytest.mark.parametrize("without", [None, 0, 1, 2])
def test_all_sensors_together_are_as_good_as_a_filter_that_knows_whose_plots_they_are(without):
    traffic, sensors, plots, target = scene(0)
    kept = plots.sensor != (-1 if without is None else without)
    plots, target = plots[kept], target[kept]
    table = track(plots, sensors, motion=CvModel(SIGMA))
    assert len(np.unique(table.track)) <= 21
    table = table[(table.plot >= 0) & (table.time > SETTLED)]
    own = target[table.plot]
    truth = np.hstack(traffic.at(np.maximum(own, 0), table.time))
    known = (own >= 0) & np.isfinite(truth).all(axis=1)
    error = (np.hstack([table.position, table.velocity]) - truth)[known]
    square = nees(error, table.covariance[known])
    best, expected = who_knows_all(traffic, sensors, plots, target)
    assert rms(error) < 1.03 * rms(best)
    assert 0.95 < np.mean(square) / np.mean(expected) < 1.05


@pytest.mark.parametrize(("copies", "step"), [(1, 0.2), (3, 1.0)])
def test_a_target_may_report_more_often_than_expected(copies, step):
    time = np.repeat(np.arange(0.0, 60.0, step), copies)
    truth = np.column_stack([100.0 * time, 50.0 * time])
    noise = np.random.default_rng(2).normal(0.0, 10.0, truth.shape)
    sensors = [PositionSensor(position_sigma=10.0)]
    plots = Plots(time, position=truth + noise)
    table = track(plots, sensors)
    assert len(np.unique(table.track)) == 1
    assert len(table) > 0.97 * len(time)
    live = Tracker(sensors)
    for second in range(60):
        some = (time >= second) & (time < second + 1)
        live.update(plots[some], time=second + 1.0)
    last = live.update(plots[:0], time=60.5)
    assert len(np.unique(last.track)) <= 1


def test_copies_of_a_false_report_confirm_nothing():
    plots = Plots(np.full(20, 5.0), position=np.random.default_rng(3).normal(0.0, 10.0, (20, 2)))
    assert len(Tracker([PositionSensor(position_sigma=10.0)]).update(plots)) == 0


def test_a_track_without_reports_ends():
    sensor = PositionSensor(position_sigma=10.0, update_interval=2.0)
    tracker = Tracker([sensor])
    time = np.arange(0.0, 30.0, 2.0)
    tracker.update(Plots(time, position=np.column_stack([80.0 * time, 0.0 * time])))
    missed = tracker.update(Plots([], position=np.empty((0, 2))), time=37.0)
    assert np.all(missed.plot == -1)
    np.testing.assert_allclose(missed.time, [30.0, 32.0, 34.0, 36.0], atol=0.5)
    tracker.update(Plots([], position=np.empty((0, 2))), time=60.0)
    assert len(tracker.extrapolate(0.0)[0]) == 0


def test_what_cannot_be_used():
    nan = np.full((2, 2), np.nan)
    bad = np.array([nan, [[1.0, 2.0], [2.0, 1.0]], np.eye(2), np.eye(2)])
    plots = Plots(np.arange(4.0), position=[[0, 0], [0, 0], [np.nan, 0], [5, 5]], covariance=bad)
    status = Tracker([PositionSensor()]).update(plots).track_of_plot
    assert status[:3].tolist() == [
        PlotStatus.NO_QUALITY, PlotStatus.NO_QUALITY, PlotStatus.INVALID,
    ]  # fmt: skip
    assert status[3] > 0
    # a plot of a radar is no position, and the other way round
    radar = Radar(range_sigma=50.0, azimuth_sigma=0.001, scan_period=4.0)
    found = Tracker([radar, PositionSensor()]).update(Plots([0.0, 0.0], 1e4, 0.1, sensor=[0, 1]))
    assert found.track_of_plot.tolist() == [1, PlotStatus.INVALID]


def test_wrong_arguments():
    assert_refused(lambda: PositionSensor(position_sigma=0.0), ValueError, "position_sigma")
    assert_refused(lambda: PositionSensor(update_interval=1e-6), ValueError, "update_interval")
    assert_refused(lambda: PositionSensor(bias=3), TypeError, "bias")
    assert_refused(lambda: Plots([0.0], position=[[0.0]]), ValueError, "position has shape")
    assert_refused(lambda: Plots([0.0], covariance=np.eye(2)[None]), ValueError, "position")
    skew = [[[1.0, 2.0], [0.0, 1.0]]]
    assert_refused(
        lambda: Plots([0.0], position=[[0.0, 0.0]], covariance=skew), ValueError, "symmetric"
    )
    one = [PositionSensor()]
    assert_refused(lambda: Tracker(one, registration=True), ValueError, "registration")
    assert_refused(lambda: Tracker([3]), TypeError, "sensors")


@pytest.mark.parametrize("association", ["gnn", "mht"])
def test_a_saved_tracker_goes_on_to_the_last_bit(association):
    _, sensors, plots, _ = scene(1)
    live = Tracker(sensors, association=association)
    for begin in np.arange(0.0, 60.0, 4.0):
        live.update(plots[(plots.time >= begin) & (plots.time < begin + 4.0)], time=begin + 4.0)
    other = pickle.loads(pickle.dumps(live))
    for begin in np.arange(60.0, 80.0, 4.0):
        now = plots[(plots.time >= begin) & (plots.time < begin + 4.0)]
        one, two = (tracker.update(now, time=begin + 4.0) for tracker in (live, other))
        assert len(one) > 0
        np.testing.assert_array_equal(one.track_of_plot, two.track_of_plot)
        np.testing.assert_array_equal(one.covariance, two.covariance)


def test_several_hypotheses_leave_one_track_per_target():
    _, sensors, plots, target = scene(2)
    table = track(plots, sensors, association="mht")
    assert len(np.unique(table.track)) <= 21
    used = table.plot >= 0
    assert np.mean(used) > 0.9
    assert len(np.unique(table.plot[used])) > 0.97 * len(target)


def test_late_reports_change_nothing_whatever_their_order():
    _, sensors, plots, _ = scene(3)
    some = np.flatnonzero(plots.time < 60.0)
    some = some[np.argsort(plots.time[some], kind="stable")]
    late = some[
        np.argsort(plots.time[some] + np.random.default_rng(4).uniform(0.0, 4.0, len(some)))
    ]
    tables = []
    for order in (some, late):
        live = Tracker(sensors, lag=8.0)
        rows = [live.update(plots[order[k : k + 100]]) for k in range(0, len(order), 100)]
        rows = [one[one.final] for one in (*rows, live.finish())]
        tables.append(np.vstack([np.hstack([one.position, one.velocity]) for one in rows]))
    np.testing.assert_array_equal(*tables)


def test_latency_is_taken_out():
    time = np.arange(0.0, 60.0, 2.0)
    position = np.column_stack([80.0 * time, 0.0 * time])
    late = PositionSensor(position_sigma=10.0, update_interval=2.0, bias=Bias(time=0.5))
    found = track(Plots(time + 0.5, position=position), [late])
    np.testing.assert_allclose(found.time, time)
    np.testing.assert_allclose(found.position[-1], position[-1], atol=0.01)


def test_any_number_of_threads_gives_the_same():
    _, sensors, plots, _ = scene(5)
    tables = [track(plots, sensors, n_threads=n) for n in (1, 4)]
    np.testing.assert_array_equal(tables[0].covariance, tables[1].covariance)
    np.testing.assert_array_equal(tables[0].plot, tables[1].plot)


def test_positions_are_columns_of_tables():
    plots = Plots([0.0, 1.0], position=[[1.0, 2.0], [3.0, 4.0]], covariance=[np.eye(2)] * 2)
    table = plots.to_polars()
    assert table["east_m"].to_list() == [1.0, 3.0]
    assert table["covariance_east_north_m2"].to_list() == [0.0, 0.0]


def vessels(seed):
    """Return reports of sixteen vessels under way, every two to ten seconds, and their paths."""
    random = np.random.default_rng(seed)
    start, speed = random.uniform(-6e3, 6e3, (16, 2)), random.uniform(3.0, 11.0, 16)
    course, turn = random.uniform(0.0, 2 * np.pi, 16), random.uniform(-0.002, 0.002, 16)
    time = [np.round(np.cumsum(random.choice([2.0, 3.3, 6.0, 10.0], 200))) for _ in range(16)]
    time = [one[one < 1000.0] for one in time]
    target = np.repeat(np.arange(16), [len(one) for one in time])

    def truth(target, time):
        # a circle of radius speed / turn
        way, centre = course[target] + turn[target] * time, speed[target] / turn[target]
        east = centre * (np.cos(course[target]) - np.cos(way))
        north = centre * (np.sin(way) - np.sin(course[target]))
        return start[target] + np.column_stack([east, north])

    time = np.concatenate(time)
    position = truth(target, time) + random.normal(0.0, 5.0, (len(time), 2))
    return Plots(time, position=position, identity=211_000_000 + target), target, truth


@pytest.mark.parametrize("lag", [0.0, 200.0])
def test_reports_much_more_often_than_the_longest_interval_are_processed_in_order(lag):
    # such as of AIS: every 2 to 10 s under way, every 180 s at anchor
    plots, target, truth = vessels(1)
    order = np.argsort(plots.time, kind="stable")
    plots, target = plots[order], target[order]
    sensor = PositionSensor(position_sigma=5.0, update_interval=180.0)
    options = {"profile": "vessel", "identity_error_probability": 1e-9}
    live = Tracker([sensor], **options)
    seconds = np.arange(0.0, 1000.0, 2.0)
    calls = [
        live.update(plots[(plots.time >= now) & (plots.time < now + 2.0)], time=now + 2.0)
        for now in seconds
    ]
    figures = []
    for found in (TrackTable.join(calls), track(plots, [sensor], lag=lag, **options)):
        assert len(np.unique(found.track)) == 16
        table = found[(found.plot >= 0) & (found.time > 300.0)]
        # each row is the state at the time of its own report
        assert np.mean(np.abs(table.time - plots.time[table.plot]) < 1.0) > 0.99
        error = table.position - truth(target[table.plot], table.time)
        assert np.mean(in_region(error, table.covariance[:, :2, :2])) > 0.93
        figures.append(rms(error))
    assert figures[1] < 1.02 * figures[0]


def drones(seed):
    """Return 5 Hz positions of six drones without identities, which turn, and their paths."""
    random = np.random.default_rng(seed)
    fine = np.arange(0.0, 60.2, 0.01)
    rate = np.repeat(random.choice([-0.6, 0.0, 0.6], (6, 7)), 900, axis=1)[:, : len(fine)]
    course = random.uniform(0.0, 2 * np.pi, (6, 1)) + 0.01 * np.cumsum(rate, axis=1)
    way = 0.12 * np.cumsum(np.stack([np.sin(course), np.cos(course)], axis=2), axis=1)
    path = random.uniform(-200.0, 200.0, (6, 1, 2)) + way
    time = np.sort(np.arange(0.0, 60.0, 0.2) + random.uniform(0.0, 0.2, (6, 1)), axis=1)
    target = np.repeat(np.arange(6), time.shape[1])

    def truth(target, time):
        return path[target, np.round(100.0 * time).astype(int)]

    time = np.round(time.ravel(), 2)
    position = truth(target, time) + random.normal(0.0, 0.5, (len(time), 2))
    order = np.argsort(time, kind="stable")
    return Plots(time[order], position=position[order]), target[order], truth


@pytest.mark.parametrize("beside", [False, True])
def test_reports_without_identities_may_come_more_often_than_stated(beside):
    plots, target, truth = drones(1)
    radar = Radar((-2e3, 0.0), range_sigma=5.0, azimuth_sigma=0.01, scan_period=4.0, bias=Bias())
    figures = []
    for interval in (1.0, 0.2):
        sensor = PositionSensor(position_sigma=0.5, update_interval=interval, bias=Bias())
        # the radar sees nothing
        sensors = [sensor, radar] if beside else [sensor]
        table = track(plots, sensors, profile="drone")
        assert len(np.unique(table.track)) == 6
        table = table[table.plot >= 0]
        assert len(table) > 0.99 * len(plots)
        assert np.all(table.time == plots.time[table.plot])
        error = table.position - truth(target[table.plot], table.time)
        assert np.mean(in_region(error, table.covariance[:, :2, :2])) > 0.93
        figures.append(rms(error))
    assert figures[0] < 1.05 * figures[1]


def test_targets_with_an_extent_may_report_more_often_than_stated():
    plots, target, truth = drones(1)
    figures = []
    for interval in (1.0, 0.2):
        sensor = PositionSensor(
            position_sigma=0.5, update_interval=interval, target_extent=1.0, bias=Bias()
        )
        table = track(plots, [sensor], profile="drone")
        table = table[table.plot >= 0]
        figures.append(rms(table.position - truth(target[table.plot], table.time)))
    assert figures[0] < 1.05 * figures[1]


@pytest.mark.parametrize("late", [0.0, 0.2])
def test_a_message_that_two_receivers_report_counts_once(late):
    random, time = np.random.default_rng(12), np.arange(0.0, 200.0)
    truth = np.column_stack([180.0 * time, 60.0 * time])
    position = truth + random.normal(0.0, 15.0, truth.shape)
    plots = Plots(
        np.concatenate([time, time + late]),
        position=np.tile(position, (2, 1)),
        sensor=np.repeat([0, 1], 200),
        icao_address=7,
    )
    receiver = PositionSensor(position_sigma=15.0, bias=Bias())
    table = track(plots, [receiver, receiver])
    assert np.sum(table.track_of_plot == PlotStatus.DUPLICATE) == 200
    alone = track(plots[:200], [receiver])
    np.testing.assert_array_equal(table.position, alone.position)
    # at the same place but later, a report of another receiver is new
    parked = Plots([0.0, 1.0, 2.0, 3.0], position=[[5.0, 5.0]] * 4, sensor=[0, 1, 0, 1], identity=3)
    table = track(parked, [receiver, receiver])
    assert np.all(table.track_of_plot != PlotStatus.DUPLICATE)


def test_copies_of_reports_with_the_same_time_do_no_harm():
    time = np.arange(0.0, 400.0)
    position = np.column_stack([180.0 * time, 60.0 * time]) + np.random.default_rng(2).normal(
        0.0, 15.0, (400, 2)
    )
    plots = Plots(np.repeat(time, 2), position=np.repeat(position, 2, axis=0), icao_address=7)
    sensor = PositionSensor(position_sigma=15.0, bias=Bias())
    table = track(plots, [sensor])
    assert len(np.unique(table.track)) == 1
    assert np.mean(table.track_of_plot == 1) > 0.99


@pytest.mark.parametrize("identity", [-1, 7])
@pytest.mark.parametrize("lag", [0.0, 5.0])
def test_rows_that_come_twice_are_one_report(identity, lag):
    """As in a recording that was written twice."""
    time = np.arange(0.0, 120.0)
    noise = np.random.default_rng(8).normal(0.0, 5.0, (120, 2))
    place = np.column_stack([100.0 * time, 20.0 * time]) + noise
    once = Plots(time, position=place, identity=identity)
    thrice = Plots(np.tile(time, 3), position=np.tile(place, (3, 1)), identity=identity)
    sensor = PositionSensor(position_sigma=5.0)
    alone, copied = (track(plots, [sensor], lag=lag) for plots in (once, thrice))
    np.testing.assert_array_equal(copied.position, alone.position)
    np.testing.assert_array_equal(copied.covariance, alone.covariance)


def test_positions_of_two_sensors_without_identities_count_once():
    time, late = np.arange(0.0, 120.0), 0.3
    noise = np.random.default_rng(9).normal(0.0, 5.0, (120, 2))
    place = np.column_stack([100.0 * time, 20.0 * time]) + noise
    sensors = [PositionSensor(position_sigma=5.0, bias=Bias()) for _ in range(2)]
    twice = Plots(
        np.append(time, time + late), position=np.tile(place, (2, 1)), sensor=np.repeat([0, 1], 120)
    )
    table = track(twice, sensors)
    assert np.all(table.track_of_plot[120:] == PlotStatus.DUPLICATE)
    np.testing.assert_array_equal(table.position, track(twice[:120], sensors).position)


def test_an_old_position_that_is_reported_again_is_not_used():
    random = np.random.default_rng(4)
    time = np.arange(0.0, 200.0)
    truth = np.column_stack([180.0 * time, 60.0 * time])
    position = truth + random.normal(0.0, 15.0, truth.shape)
    old = np.zeros(len(time), bool)
    for begin in (40, 90, 140):
        old[begin : begin + 8] = True
        position[old & (time >= begin)] = position[begin - 1]
    plots = Plots(time, position=position, icao_address=0x4CA123)
    sensor = PositionSensor(position_sigma=15.0, update_interval=2.0)
    for lag in (0.0, 20.0):
        table = track(plots, [sensor], lag=lag)
        np.testing.assert_array_equal(table.track_of_plot[old], PlotStatus.DUPLICATE)
        assert len(np.unique(table.track)) == 1
        late = (table.time > 10.0) & (table.plot >= 0)
        error = table.position - np.column_stack([180.0 * table.time, 60.0 * table.time])
        assert np.max(np.hypot(*error[late].T)) < 60.0


@pytest.mark.parametrize("interval", [1.0, 10.0])
def test_a_vehicle_that_has_stopped_reports_the_same_position(interval):
    # it brakes with 3 m/s² from 12 m/s; positions are rounded to a metre
    time = np.arange(0.0, 120.0, interval)
    way = 12.0 * np.minimum(time, 60.0) + np.clip(time - 60.0, 0.0, 4.0) * (
        12.0 - 1.5 * np.clip(time - 60.0, 0.0, 4.0)
    )
    plots = Plots(time, position=np.round(np.column_stack([way, 0.0 * way])), icao_address=5)
    sensor = PositionSensor(position_sigma=2.0, update_interval=interval)
    table = track(plots, [sensor], profile="road")
    assert np.all(table.track_of_plot > 0)
    assert len(np.unique(table.track)) == 1


@pytest.mark.parametrize("latency", [0.0, 0.3])
def test_trusted_radars_show_how_late_positions_are(latency: float) -> None:
    """Registration is the default, as the time of reported positions is not known exactly."""
    rng = np.random.default_rng(87)
    time = np.tile(np.arange(0.0, 240.0, 1.0), 8)
    target = np.repeat(np.arange(8), 240)
    course = target * np.pi / 4
    velocity = 200.0 * np.column_stack([np.sin(course), np.cos(course)])
    start = rng.uniform(-2e4, 2e4, (8, 2))
    place = start[target] + time[:, np.newaxis] * velocity
    # a radar sees each target every four seconds
    seen = time % 4 == 0
    count, missing = seen.sum(), np.full(time.size, np.nan)
    distance = np.hypot(*place[seen].T) + 50.0 * rng.standard_normal(count)
    azimuth = np.arctan2(*place[seen].T) + 1e-3 * rng.standard_normal(count)
    reported = place + 15.0 * rng.standard_normal(place.shape)
    when = np.concatenate([time[seen], time + latency])
    order = np.argsort(when, kind="stable")
    owner = np.concatenate([target[seen], target])[order]
    plots = Plots(
        when[order],
        np.concatenate([distance, missing])[order],
        np.concatenate([azimuth, missing])[order],
        sensor=np.repeat([0, 1], [count, time.size])[order],
        position=np.concatenate([np.full((count, 2), np.nan), reported])[order],
        icao_address=owner + 1,
    )
    radar = Radar([0, 0], range_sigma=50.0, azimuth_sigma=1e-3, scan_period=4.0, bias=Bias())
    table = track(plots, [radar, PositionSensor(position_sigma=15.0, update_interval=1.0)])
    table = table[(table.plot >= 0) & (table.time > 60.0)]
    row = owner[table.plot]
    truth = start[row] + table.time[:, np.newaxis] * velocity[240 * row]
    assert np.mean(in_region(table.position - truth, table.covariance[:, :2, :2])) > 0.9
