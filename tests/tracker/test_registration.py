"""Systematic errors of radars, found while tracking."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from checks import assert_refused, assert_same, in_region

from tertia import _core, metrics, simulate
from tertia.metrics import nees
from tertia.sensors import RADAR_LIMITS, Bias, Radar
from tertia.tracker import Plots, Tracker, track
from tertia.tracker._recording import tracked
from tertia.tracker._registrar import _AMPLE, Registrar, _thinned
from tertia.tracker._registrar import scans as scans_of
from tertia.tracker._start import _time_of_most_pairs

RADARS = [
    Radar([east, 0.0], range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0 + k)
    for k, east in enumerate((-5e4, 5e4))
]
PLOTS = ("time", "range", "azimuth", "sensor", "height", "identity")
BIAS = Bias(range=[-60.0, 120.0], azimuth=[0.0, 0.12], time=[0.0, 0.1], degrees=True)


def recording(seed=1, bias=BIAS, **options):
    traffic = simulate.dense_traffic(20, area=(1e5, 1e5), turning_share=0.1, rng=seed)
    return simulate.radar_plots(traffic, RADARS, bias=bias, rng=seed + 50, **options).plots


def scans(plots, period=4.0):
    """The plots of each period, and the time at which it ends."""
    ends = np.arange(plots.time[0], plots.time[-1] + period, period) + period
    edges = np.concatenate([[0], np.searchsorted(plots.time, ends)])
    return [(plots[a:b], end) for a, b, end in zip(edges, edges[1:], ends, strict=False)]


def followed(plots, **options):
    tracker = Tracker(RADARS, **options)
    tables = [tracker.update(some, time=end) for some, end in scans(plots)]
    return tracker, tables


def away(table, best):
    """Root mean square of the distances from the states at the same plots, per axis."""
    table = table[table.plot >= 0]
    _, here, there = np.intersect1d(table.plot, best.plot, return_indices=True)
    return np.sqrt(np.mean((table.position[here] - best.position[there]) ** 2))


def columns(bias, suffix=""):
    kinds = ("range", "range_gain", "azimuth", "time")
    return np.stack([np.asarray(getattr(bias, kind + suffix)) for kind in kinds], axis=-1)


def test_errors_are_found_and_taken_out():
    plots = recording()
    tracker, tables = followed(plots, registration=True)
    off = columns(tracker.bias) - columns(BIAS)
    sigma = columns(tracker.bias, "_sigma")
    assert np.all(np.abs(off) < 3.5 * sigma)
    limits = columns(RADAR_LIMITS, "_sigma")
    assert np.all(sigma[:, [0, 2]] < 0.4 * limits[[0, 2]])
    last = np.concatenate([np.unique(table.track) for table in tables[-5:]])
    assert len(np.unique(last)) == 20


def test_covariances_include_what_is_not_known():
    plots = recording()
    with_errors = followed(plots, registration=True)[1]
    trusted = [replace(one, bias=BIAS[k]) for k, one in enumerate(RADARS)]
    without = Tracker(trusted)
    known = [without.update(some, time=end) for some, end in scans(plots)]
    wide, narrow = (
        np.median(np.trace(np.concatenate([t.covariance for t in tables]), axis1=1, axis2=2))
        for tables in (with_errors[5:15], known[5:15])
    )
    # 1.2 while the noise that stands for the errors was counted besides the errors
    assert wide > 1.1 * narrow
    for table in with_errors:
        assert np.all(np.linalg.eigvalsh(table.covariance) > 0)
        np.testing.assert_array_equal(table.covariance, np.swapaxes(table.covariance, 1, 2))


def drawn(random):
    value = columns(RADAR_LIMITS, "_sigma") * random.standard_normal((len(RADARS), 4))
    kinds = ("range", "range_gain", "azimuth", "time")
    return Bias(**{kind: value[:, j] for j, kind in enumerate(kinds)})


def test_first_tracks_are_as_good_as_they_say():
    random, squares, known = np.random.default_rng(3), [], []
    for seed in range(30):
        # normal: a uniform error has a third of the variance that the tracker assumes
        bias = drawn(random)
        traffic = simulate.dense_traffic(20, area=(1e5, 1e5), turning_share=0.1, rng=seed)
        record = simulate.radar_plots(traffic, RADARS, bias=bias, rng=seed + 50)
        late = np.asarray(bias.time)[record.plots.sensor]
        place, _ = traffic.at(record.target, record.plots.time - late)
        tracker = Tracker(RADARS)
        # before a start that large errors have
        tables = [tracker.update(some, time=end) for some, end in scans(record.plots)[:8]]
        for table in tables:
            seen = table.plot >= 0
            error = table.position[seen] - place[table.plot[seen]]
            near = np.hypot(*error.T) < 2000.0
            squares.append(nees(error[near], table.covariance[seen][near][:, :2, :2]) / 2)
        off = columns(tracker.bias) - columns(bias)
        known.append((off / columns(tracker.bias, "_sigma")) ** 2)
    # what all clocks have in common is as good as the prior; of uniform errors this is .26
    assert 0.5 < np.mean(np.array(known)[..., 3]) < 1.6
    # .77 while the noise that stands for errors was counted besides them
    assert 0.8 < np.nanmean(np.concatenate(squares)) < 1.25


@pytest.mark.parametrize("radar", [0, 1])
@pytest.mark.parametrize("difference", [0.6, 1.2])
def test_either_of_two_clocks_may_be_the_wrong_one(difference, radar):
    late = np.zeros(len(RADARS))
    late[radar] = difference
    traffic = simulate.dense_traffic(20, area=(1e5, 1e5), turning_share=0.1, rng=2)
    record = simulate.radar_plots(traffic, RADARS, bias=Bias(time=late), rng=5)
    tracker, tables = followed(record.plots)
    table = tables[0].join(tables)
    rows = table[(table.plot >= 0) & (table.time > 60.0)]
    place, _ = traffic.at(np.maximum(record.target[rows.plot], 0), rows.time)
    # .65 while the mean of both clocks was believed, none while the wrong one was
    assert np.mean(in_region(rows.position - place, rows.covariance[:, :2, :2])) > 0.9
    bias = tracker.bias
    assert abs(bias.time[radar] - bias.time[1 - radar] - difference) < 0.1
    assert np.all(np.abs(bias.time - late) < 2.0 * np.asarray(bias.time_sigma))


def test_one_radar_determines_nothing():
    plots = recording(2)
    tracker = Tracker(RADARS[:1], registration=True)
    for some, end in scans(plots[plots.sensor == 0]):
        tracker.update(some, time=end)
    np.testing.assert_array_equal(columns(tracker.bias), 0.0)
    # what drifts stays as uncertain as the prior
    sigma = columns(tracker.bias, "_sigma")[0]
    np.testing.assert_allclose(sigma, columns(RADAR_LIMITS, "_sigma"), rtol=1e-9)


def test_stated_errors_of_a_single_radar_are_in_its_covariances():
    random, squares = np.random.default_rng(21), []
    for seed in range(8):
        sigma = {"range_sigma": 100.0, "azimuth_sigma": 0.15}
        own = random.normal(0.0, list(sigma.values()))
        bias = Bias(range=[own[0], 0.0], azimuth=[own[1], 0.0], degrees=True)
        traffic = simulate.dense_traffic(15, area=(1e5, 1e5), turning_share=0.0, rng=seed)
        record = simulate.radar_plots(traffic, RADARS, bias=bias, rng=seed + 50)
        first = record.plots.sensor == 0
        radar = replace(RADARS[0], bias=Bias(**sigma, degrees=True))
        table = track(record.plots[first], [radar])
        table = table[(table.plot >= 0) & (table.time > 60.0)]
        truth, _ = traffic.at(record.target[first][table.plot], table.time)
        known = np.isfinite(truth).all(axis=1)
        off = (table.position - truth)[known]
        squares.append(np.mean(nees(off, table.covariance[known][:, :2, :2])))
    # one draw of the errors a seed; 20 and more if they are not included
    assert np.mean(squares) / 2.0 < 2.0


def test_errors_drift_as_their_bias_says():
    plots, known = recording(), []
    given = [RADAR_LIMITS, Bias(range_sigma=100.0, azimuth_sigma=0.1, time_sigma=0.1, degrees=True)]
    drifts = [(0.0, None), (1.0, 30e3), (0.5, 15e3), (1.0, 3e3)]
    given += [replace(given[1], drift_share=share, drift_time=time) for share, time in drifts]
    for bias in given:
        tracker = Tracker([replace(one, bias=bias) for one in RADARS])
        for some, end in scans(plots):
            tracker.update(some, time=end)
        known.append(columns(tracker.bias, "_sigma"))
    default = followed(plots)[0].bias
    limits, silent, constant, drifting, half, fast = known
    np.testing.assert_array_equal(limits, columns(default, "_sigma"))
    np.testing.assert_array_equal(silent, constant)
    np.testing.assert_array_equal(half, drifting)
    unknown = constant > 0.0
    assert np.all(constant[unknown] < drifting[unknown])
    assert np.all(drifting[unknown] < fast[unknown])


def test_a_sudden_change_is_found():
    found = []
    for seed in range(3):
        plots = recording(seed, Bias(azimuth=[0.0, 0.2], degrees=True), bias_start=150.0)
        tracker, _ = followed(plots, registration=True)
        found += [(time, radar) for time, radar in tracker._registrar.changes]
        assert np.degrees(tracker.bias.azimuth)[1] - np.degrees(
            tracker.bias.azimuth[0]
        ) == pytest.approx(0.2, abs=0.03)
    assert len(found) == 3
    assert all(150.0 < time < 210.0 for time, _ in found)


def test_a_copy_goes_on_to_the_last_bit():
    plots = recording(3)
    parts = scans(plots)
    tracker = Tracker(RADARS, registration=True)
    for some, end in parts[:30]:
        tracker.update(some, time=end)
    saved, copied = pickle.loads(pickle.dumps(tracker)), copy.copy(tracker)
    for some, end in parts[30:40]:
        one, *others = [each.update(some, time=end) for each in (tracker, saved, copied)]
        for other in others:
            np.testing.assert_array_equal(one.covariance, other.covariance)
            np.testing.assert_array_equal(one.position, other.position)
    for each in (saved, copied):
        np.testing.assert_array_equal(columns(tracker.bias), columns(each.bias))


def test_a_damaged_state_is_refused():
    tracker, _ = followed(recording(3)[:200], registration=True)
    saved = tracker._registrar.__getstate__()["_core"]
    for at in (0, len(saved) // 2, len(saved) - 1):
        broken = bytearray(saved)
        broken[at] ^= 1
        assert_refused(
            lambda broken=broken: _core.Registrar.from_state(bytes(broken)),
            ValueError,
            "not the state",
        )


def test_wrong_arguments():
    for sensor in (-1, 2):
        plots = Plots([0.0], 1e4, 0.1, sensor=sensor)
        assert_refused(lambda plots=plots: BIAS.correct(plots), ValueError, "plot of sensor")
    assert_refused(lambda: Tracker(RADARS, registration="on"), TypeError, "registration is 'on'")


@pytest.mark.parametrize("beyond", [0.1, 0.3, 0.5, 1.0])
@pytest.mark.parametrize("offset", [0.0, 350.0])
def test_large_errors_make_no_second_tracks(beyond, offset):
    bias = Bias(azimuth=[0.0, beyond], range=[0.0, offset], degrees=True)
    plots = recording(6, bias)
    tracker, tables = followed(plots)
    found = tracker.bias
    assert np.degrees(found.azimuth[1] - found.azimuth[0]) == pytest.approx(beyond, abs=0.02)
    # from the eighth scan on: before that, nobody can know
    later = np.unique(np.concatenate([table.track for table in tables[9:]]))
    assert 20 <= len(later) <= 21
    whole = track(plots, RADARS)
    assert 20 <= len(np.unique(whole.track)) <= 21
    if beyond > 0.2 or offset:
        best = track(recording(6, None), [replace(radar, bias=Bias()) for radar in RADARS])
        bare = track(plots, RADARS, registration=False)
        assert away(bare, best) > 1.5 * away(whole, best)
    # 0.3 degrees alone make no second tracks: two radars that see a target in one scan begin one
    if beyond > 0.3 or offset:
        assert len(np.unique(bare.track)) > 30


@pytest.mark.parametrize("beyond", [0.5, 1.0, -3.0, 11.0])
def test_a_sudden_change_beyond_the_gates_is_found(beyond):
    plots = recording(7, Bias(azimuth=[0.0, beyond], degrees=True), bias_start=120.0)
    tracker, tables = followed(plots)
    ((time, radar), *others) = tracker._registrar.changes
    assert radar == 1
    assert 120.0 < time < 135.0
    assert not others
    assert len(np.unique(np.concatenate([table.track for table in tables]))) <= 21


@pytest.mark.parametrize("seed", [28, 32, 41])
def test_a_clock_that_jumps_makes_no_second_tracks(seed):
    # plots outside the gates begin tracks before enough blocks tell of the change
    plots = recording(seed, Bias(time=[0.0, 1.0]), bias_start=150.0)
    tracker, tables = followed(plots)
    assert tracker._registrar.changes
    # 22 while these were confirmed
    assert len(np.unique(np.concatenate([table.track for table in tables]))) == 20


def test_no_track_is_confirmed_by_a_radar_that_is_held(monkeypatch):
    plots = recording(9, Bias())
    monkeypatch.setattr(Registrar, "held", property(lambda _: [False, True]))
    _, tables = followed(plots[plots.time < 30.0])
    assert not any(map(len, tables))
    _, tables = followed(plots[(plots.time < 30.0) & (plots.sensor == 0)])
    assert len(np.unique(np.concatenate([table.track for table in tables]))) > 15


def test_tracks_move_when_the_errors_do(monkeypatch):
    plots = recording(9, Bias())
    tracker, _ = followed(plots[plots.time < 40.0])
    same = pickle.loads(pickle.dumps(tracker))
    learn = Registrar.learn

    def learn_more(*given, **more):
        number, time, by = learn(*given, **more)
        return number, time, by + np.array([300.0, -100.0, 0.0, 0.0])

    last = plots[(plots.time >= 40.0) & (plots.time < 44.0)]
    tracker.update(last)
    monkeypatch.setattr(Registrar, "learn", learn_more)
    same.update(last)
    ((track, place), (other, moved)) = (one.extrapolate(0.0) for one in (tracker, same))
    np.testing.assert_array_equal(track, other)
    np.testing.assert_allclose(moved - place, np.tile([300.0, -100.0], (len(track), 1)), atol=1e-6)


def few(plots, target):
    """The plots of two aircraft more than a chain of pairs needs."""
    return plots[np.isin(target, np.unique(target[target >= 0])[:5])]


@pytest.mark.parametrize("seed", [6, 7, 8])
def test_no_aircraft_has_two_tracks_from_the_first_row_on(seed):
    plots = recording(seed, Bias(azimuth=[0.0, 0.5], degrees=True))
    _, tables = followed(plots)
    begin = min(np.min(table.time) for table in tables if len(table))
    assert 11.0 < begin - plots.time[0] < 20.0
    assert len(np.unique(np.concatenate([table.track for table in tables]))) == 20
    # plots keep their numbers
    for table in tables[9:]:
        seen = table.plot >= 0
        np.testing.assert_allclose(plots.time[table.plot[seen]], table.time[seen], atol=0.3)


def test_new_tracks_after_the_start_have_new_numbers():
    # too few aircraft for three scans
    traffic = simulate.dense_traffic(20, area=(1e5, 1e5), turning_share=0.1, rng=6)
    bias = Bias(azimuth=[0.0, 0.5], degrees=True)
    record = simulate.radar_plots(traffic, RADARS, bias=bias, rng=56)
    _, tables = followed(few(record.plots, record.target))
    before = np.unique(np.concatenate([table.track for table in tables[:8]]))
    after = np.unique(np.concatenate([table.track for table in tables[10:]]))
    assert len(before) >= 5
    assert len(after) == 5
    assert not np.intersect1d(before, after).size


def test_a_recording_in_any_order():
    plots = recording(8)
    order = np.random.default_rng(1).permutation(len(plots))
    one, other = track(plots, RADARS), track(plots[order], RADARS)
    np.testing.assert_array_equal(one.time, other.time)
    np.testing.assert_array_equal(one.covariance, other.covariance)
    seen = one.plot >= 0
    np.testing.assert_array_equal(one.plot[seen], order[other.plot[seen]])
    np.testing.assert_array_equal(one.track_of_plot[order], other.track_of_plot)


def test_trusted_radars_and_single_ones_are_left_alone():
    plots = recording(9)
    trusted = [replace(one, bias=Bias()) for one in RADARS]
    for sensors, some in ((trusted, plots), (RADARS[:1], plots[plots.sensor == 0])):
        one, other = track(some, sensors), track(some, sensors, registration=False)
        np.testing.assert_array_equal(one.position, other.position)
        np.testing.assert_array_equal(one.covariance, other.covariance)


def test_a_silent_radar_is_no_change():
    plots = recording(10, Bias())
    silent = (plots.sensor == 1) & (plots.time > 100.0) & (plots.time < 200.0)
    tracker, _ = followed(plots[~silent])
    assert tracker._registrar.changes == []


def test_noise_that_grows_suddenly_is_noticed():
    traffic = simulate.dense_traffic(20, area=(1e5, 1e5), turning_share=0.1, rng=11)
    noisy = [RADARS[0], replace(RADARS[1], azimuth_sigma=2.5 * RADARS[1].azimuth_sigma)]
    before, after = (simulate.radar_plots(traffic, r, rng=12).plots for r in (RADARS, noisy))
    early, late = before[before.time < 150.0], after[after.time >= 150.0]
    columns = {name: np.concatenate([getattr(early, name), getattr(late, name)]) for name in PLOTS}
    tracker, found = Tracker(RADARS), {}
    for some, end in scans(Plots(**columns)):
        tracker.update(some, time=end)
        found[end] = tracker._registrar.noise[:, 1] / RADARS[0].azimuth_sigma
    settled = np.array([ratio for end, ratio in found.items() if 100.0 < end < 150.0])
    assert np.all(settled < 1.25)
    # within 30 s, and of this radar alone
    later = np.array([ratio for end, ratio in found.items() if end > 180.0])
    assert np.all((later[:, 1] > 2.0) & (later[:, 1] < 3.2))
    assert np.all(later[:, 0] < 1.35)
    assert tracker._registrar.changes == []


def test_large_errors_are_found_with_many_targets():
    # more than are compared: some are chosen by their identities, the same for all radars
    traffic = simulate.dense_traffic(400, area=(120e3, 120e3), duration=36.0, rng=1)
    seen = simulate.radar_plots(traffic, RADARS, rng=2).plots
    off = np.where(seen.sensor == 1, np.radians(1.0), 0.0)
    seen = replace(seen, azimuth=seen.azimuth + off)
    assert len(_thinned(seen, 2)) < 0.8 * len(seen)
    assert len(np.unique(_thinned(seen, 2).identity)) == _AMPLE
    # also if most plots have no identity, as with many false plots
    rare = replace(seen, identity=np.where(np.arange(len(seen)) % 5 < 2, seen.identity, -1))
    assert len(np.unique(_thinned(rare, 2).identity)) == _AMPLE
    azimuth = np.degrees(tracked(seen, RADARS)[1].azimuth)
    assert azimuth[1] - azimuth[0] == pytest.approx(1.0, abs=0.06)  # four sigma
    # nothing is left out where there are few targets, or few identities
    some = seen[seen.identity < np.sort(np.unique(seen.identity))[_AMPLE]]
    assert len(_thinned(some, 2)) == len(some)
    nameless = replace(seen, identity=np.full(len(seen), -1))
    assert len(_thinned(nameless, 2)) == len(nameless)


def test_targets_of_several_sensors_are_compared_first():
    count = 3 * _AMPLE
    sensor = np.repeat([0, 1], count)
    # the last ten of one sensor are the first ten of the other
    identity = np.arange(2 * count) - 10 * sensor
    some = np.zeros(2 * count)
    found = _thinned(Plots(some, some + 5e4, some, sensor=sensor, identity=identity), 2)
    assert set(range(count - 10, count)) <= set(found.identity)
    assert len(np.unique(found.identity)) == 2 * _AMPLE - 10


def without_heights(seed):
    """Plots of radars that measure slant ranges of targets whose heights nobody knows."""
    high = [replace(one, position=[*one.position, 0.0]) for one in RADARS]
    traffic = simulate.dense_traffic(20, area=(1e5, 1e5), turning_share=0.1, rng=seed)
    options = {"height_missing_probability": 1.0, "rng": seed + 50}
    return high, simulate.radar_plots(traffic, high, **options).plots


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_unknown_heights_are_no_errors_of_ranges(seed):
    """They made the ranges of both radars 300 to 800 m too long, with a sigma of 20 m."""
    radars, plots = without_heights(seed)
    tracker = Tracker(radars)
    table = tracker._track(plots, None, recording=True)
    off, sigma = columns(tracker.bias), columns(tracker.bias, "_sigma")
    assert np.all(np.abs(off) < 4.0 * sigma)
    assert np.abs(off[:, 0]).max() < 150
    assert len(np.unique(table.track)) == 20


def lasting(plots, target, seed, kept=0.7):
    """Plots whose errors are alike from scan to scan."""
    random = np.random.default_rng(seed)
    distance, azimuth = plots.range.copy(), plots.azimuth.copy()
    for k, radar in enumerate(RADARS):
        for one in range(20):
            own = np.flatnonzero((plots.sensor == k) & (target == one))
            error = random.standard_normal((2, len(own)))
            for i in range(1, len(own)):
                error[:, i] = kept * error[:, i - 1] + np.sqrt(1 - kept**2) * error[:, i]
            distance[own] += radar.range_sigma * error[0]
            azimuth[own] += radar.azimuth_sigma * error[1]
    return replace(plots, range=distance, azimuth=azimuth % (2 * np.pi))


def test_errors_that_last_are_in_the_first_rows_too():
    """The first plots were tracked before the noise was known: their NEES was 2.6."""
    exact = [replace(one, range_sigma=0.01, azimuth_sigma=1e-6) for one in RADARS]
    found = []
    for seed in (1, 2, 3):
        traffic = simulate.dense_traffic(20, area=(1e5, 1e5), turning_share=0.1, rng=seed)
        ideal = simulate.radar_plots(traffic, exact, rng=seed + 50)
        table = track(lasting(ideal.plots, ideal.target, seed), RADARS)
        rows = table[(table.plot >= 0) & (table.time < 150.0)]
        place = ideal.plots[rows.plot]
        radar = np.array([one.position for one in RADARS])[place.sensor]
        ground = np.sqrt(place.range**2 - place.height**2)
        way = np.column_stack([np.sin(place.azimuth), np.cos(place.azimuth)])
        error = rows.position - (radar + ground[:, np.newaxis] * way)
        found.append(metrics.nees(error, rows.covariance[:, :2, :2]) / 2)
    assert 0.7 < np.mean(np.concatenate(found)) < 1.5


def test_scans_of_a_recording_with_a_wrong_time() -> None:
    """One plot years away costs no work for the scans between."""
    time = np.r_[np.arange(0.0, 100.0, 0.5), 1.7e12, np.nan]
    parts = scans_of(time, 4.0)
    assert [len(part) for part in parts] == [8] * 25 + [2]
    assert np.concatenate(parts).tolist() == list(range(len(time)))
    # the last plot is in the last whole scan
    assert [len(part) for part in scans_of(np.arange(0.0, 13.0), 4.0)] == [4, 4, 5]


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_large_errors_are_found_although_a_plot_of_each_scan_has_no_time(wrong):
    bias = Bias(azimuth=[0.0, 4.0], degrees=True)
    plots = recording(3, bias)
    best, found = Tracker(RADARS, registration=True), Tracker(RADARS, registration=True)
    for some, end in scans(plots)[:12]:
        best.update(some, time=end)
        more = some[np.r_[np.arange(len(some)), 0]]
        found.update(replace(more, time=np.r_[some.time, wrong]), time=end)
    np.testing.assert_array_equal(columns(found.bias), columns(best.bias))
    assert np.degrees(found.bias.azimuth)[1] == pytest.approx(4.0, abs=0.2)


def test_tracks_of_one_instant_have_no_time_of_most_pairs():
    table = track(recording(3), RADARS)[:1]
    assert _time_of_most_pairs([table, table], [4.0, 5.0]) is None


@pytest.mark.parametrize(
    ("column", "wrong", "end", "message"),
    [
        ("sensor", 2, None, r"plots.sensor\[{at}\] is 2; it must be the index of one of the 2"),
        ("time", np.nan, np.nan, "time is nan"),
    ],
)
def test_a_refused_call_changes_nothing(column, wrong, end, message):
    """Also if the scans before the wrong one could be tracked."""
    plots, tracker = recording(), Tracker(RADARS, registration=True)
    tracker.update(plots[:200])
    part = plots[200:600]
    values = np.array(getattr(part, column))
    values[-1] = wrong
    columns = {name: getattr(part, name) for name in PLOTS} | {column: values}
    untouched = copy.copy(tracker)
    with pytest.raises(ValueError, match=message.format(at=len(part) - 1)):
        tracker.update(Plots(**columns), time=end)
    assert_same(tracker.update(part), untouched.update(part))
    assert_same(tracker.bias, untouched.bias)
