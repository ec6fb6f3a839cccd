"""The centre: which tracks are of one target, their numbers, what hands decide, saved states."""

import pickle
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from checks import assert_threads, in_region
from numpy.testing import assert_allclose, assert_array_equal

from tertia import metrics, simulate
from tertia.sensors import Bias, Radar
from tertia.tertiary import FusionCentre, SensorTracks, fuse_tracks
from tertia.tracker import Plots, track

ACCURACY = {"range_sigma": 50.0, "azimuth_sigma": 1e-3}
RADARS = [
    Radar([0.0, 0.0], scan_period=4.0, max_range=250e3, bias=Bias(), **ACCURACY),
    Radar([60e3, 0.0], scan_period=5.0, max_range=250e3, bias=Bias(), **ACCURACY),
    Radar([0.0, 60e3], scan_period=6.0, max_range=250e3, bias=Bias(), **ACCURACY),
]
COVARIANCE = np.diag([2500.0, 2500.0, 25.0, 25.0])
PLACES = np.array([[30e3, 40e3], [33e3, 40e3], [-50e3, 20e3], [10e3, -80e3]])
VELOCITIES = np.array([[200.0, 0.0], [200.0, 0.0], [0.0, -150.0], [100.0, 100.0]])


def messages(
    seconds: float = 100.0, *, seed: int = 1, sensors=range(3), places=PLACES, shift=None
) -> SensorTracks:
    """Return tracks with errors that last, as those of trackers do."""
    random = np.random.default_rng(seed)
    rows = []
    for k in sensors:
        error = random.standard_normal((len(places), 4)) * [50, 50, 5, 5]
        for time in np.arange(0.3 * k, seconds, RADARS[k].scan_period):
            fresh = random.standard_normal(error.shape) * [50, 50, 5, 5]
            error = 0.6 * error + 0.8 * fresh
            for i, place in enumerate(places):
                state = np.concatenate([place + time * VELOCITIES[i], VELOCITIES[i]]) + error[i]
                if shift is not None:
                    away = state[:2] - RADARS[k].position
                    state[:2] += shift[k] * away / np.linalg.norm(away)
                rows.append((time, k, 10 * k + i, state))
    time, sensor, track, state = (np.array(column) for column in zip(*rows, strict=True))
    covariance = np.broadcast_to(COVARIANCE, (len(time), 4, 4))
    return SensorTracks(
        time, sensor, track, state[:, :2], state[:, 2:], covariance=covariance, turn_probability=0.0
    )


def last(found):
    """Return the last picture."""
    return found[found.time == found.time[-1]]


def test_tracks_of_one_target_are_one():
    found = last(fuse_tracks(messages(), RADARS))
    assert_array_equal(found.members % 10, np.arange(4)[:, np.newaxis] + np.zeros((1, 3), int))
    assert found.count == 4
    assert np.all(found.confirmed & ~found.doubtful)
    truth = PLACES + found.time[0] * VELOCITIES
    assert np.all(np.linalg.norm(found.position - truth, axis=1) < 100.0)


def test_one_target_alone_is_one():
    found = last(fuse_tracks(messages(places=PLACES[:1]), RADARS))
    assert_array_equal(found.members, [[0, 10, 20]])


@pytest.mark.parametrize(
    "method", ["tracklets", "matrix", "covariance-intersection", "static", "equal", "paper"]
)
def test_every_method_fuses(method):
    found = fuse_tracks(messages(), RADARS, method=method)
    truth = PLACES[(last(found).members[:, 0]) % 10] + last(found).time[0] * VELOCITIES
    assert np.all(np.linalg.norm(last(found).position - truth, axis=1) < 200.0)
    assert_allclose(found.covariance, np.swapaxes(found.covariance, 1, 2), rtol=1e-9, atol=1e-9)
    assert np.all(np.linalg.eigvalsh(found.covariance) > 0)


def test_numbers_last_and_the_order_of_messages_does_not_matter():
    tracks = messages()
    found = fuse_tracks(tracks, RADARS)
    names = {}
    for number, members in zip(found.track, found.members, strict=True):
        for k, member in enumerate(members.tolist()):
            if member >= 0:
                assert names.setdefault((k, member), number) == number
    shuffled = tracks[np.random.default_rng(3).permutation(len(tracks))]
    again = fuse_tracks(shuffled, RADARS)
    assert_array_equal(found.track, again.track)
    assert_array_equal(found.covariance, again.covariance)


def test_biases_are_found():
    # the range of the second radar is 300 m too long
    shift = np.array([0.0, 300.0, 0.0])
    radars = [
        Radar(
            r.position,
            scan_period=r.scan_period,
            max_range=250e3,
            bias=Bias(range_sigma=200.0, azimuth_sigma=3e-3),
            **ACCURACY,
        )
        for r in RADARS
    ]
    tracks = messages(600.0, shift=shift)
    found = last(fuse_tracks(tracks, radars))
    assert len(found) == 4
    without = last(fuse_tracks(tracks, RADARS, registration=False))
    assert len(without) > 4


def test_a_saved_centre_goes_on_to_the_last_bit():
    tracks = messages()
    whole = FusionCentre(RADARS)
    half = FusionCentre(RADARS)
    early = tracks[tracks.time <= 50.0]
    late = tracks[tracks.time > 50.0]
    for centre in (whole, half):
        centre.update(early, time=50.0)
    restored = pickle.loads(pickle.dumps(half))
    one, other = whole.update(late, time=100.0), restored.update(late, time=100.0)
    for name in type(one).__slots__:
        assert_array_equal(getattr(one, name), getattr(other, name))
    assert_array_equal(np.asarray(whole.bias.range), np.asarray(restored.bias.range))


def test_pictures_do_not_depend_on_the_number_of_threads():
    # more tracks than one thread compares at a time
    radars = [replace(radar, bias=Bias(range_sigma=150.0)) for radar in RADARS]
    random = np.random.default_rng(3)
    places, velocities = random.uniform(-1e5, 1e5, (300, 2)), random.normal(0.0, 150.0, (300, 2))
    rows = []
    for k, radar in enumerate(radars):
        for time in np.arange(0.3 * k, 60.0, radar.scan_period):
            state = np.hstack([places + time * velocities, velocities])
            state += random.standard_normal(state.shape) * [50, 50, 5, 5]
            rows.append((np.full(300, time), np.full(300, k), np.arange(300), state))
    time, sensor, number, state = (np.concatenate(column) for column in zip(*rows, strict=True))
    covariance = np.broadcast_to(COVARIANCE, (len(time), 4, 4))
    tracks = SensorTracks(time, sensor, number, state[:, :2], state[:, 2:], covariance=covariance)
    assert np.sum(np.all(last(fuse_tracks(tracks, radars, n_threads=1)).members >= 0, axis=1)) > 200
    assert_threads(lambda **threads: fuse_tracks(tracks, radars, **threads))
    restored = pickle.loads(pickle.dumps(FusionCentre(radars, n_threads=2)))
    assert restored.n_threads == 2
    with pytest.raises(ValueError, match="n_threads is 0"):
        FusionCentre(radars, n_threads=0)


def test_damaged_states_are_refused():
    state = list(FusionCentre(RADARS).__getstate__())
    saved = bytearray(state[-1])
    saved[len(saved) // 2] ^= 1
    empty = FusionCentre.__new__(FusionCentre)
    with pytest.raises(ValueError, match="not the state of a fusion centre"):
        empty.__setstate__((*state[:-1], bytes(saved)))


def test_hands_join_separate_and_release():
    # two sensors that see one target so far apart that the tests refuse them
    centre = FusionCentre(RADARS[:2], registration=False)
    tracks = messages(60.0, sensors=(0, 1), places=PLACES[:1], shift=(0.0, 1500.0))

    def advance(time):
        new = tracks[(tracks.time > time - 5.0) & (tracks.time <= time)]
        return centre.update(new, time=time)

    first = advance(5.0)
    assert len(first) == 2
    centre.join(*first.track.tolist())
    assert_array_equal(advance(10.0).members, [[0, 10]])
    centre.release(1)
    assert len(advance(15.0)) == 2
    near = FusionCentre(RADARS[:2], registration=False)
    same = messages(60.0, sensors=(0, 1), places=PLACES[:1])
    alone = same[same.sensor == 0]
    near.update(alone[alone.time <= 5.0], time=5.0)
    with pytest.raises(ValueError, match="not two targets"):
        near.join(1, 2)
    with pytest.raises(ValueError, match="no such target"):
        near.release(7)


@pytest.mark.parametrize("decide", [FusionCentre.join, FusionCentre.separate])
def test_decisions_end_with_their_tracks(decide):
    states = []
    for is_decided in (False, True):
        centre = FusionCentre(RADARS[:2], registration=False)
        for time in np.arange(0.0, 100.0, 4.0):
            count = 4 if time < 12.0 else 2
            places = np.array([[3e4, 4e4], [3e4, 4e4], [-6e4, 0.0], [-6e4, 5e3]])[:count]
            rows = SensorTracks(
                [time] * count,
                [0, 1, 0, 1][:count],
                [1, 1, 2, 2][:count],
                places,
                np.zeros((count, 2)),
            )
            found = centre.update(rows, time=time + 1.0)
            if is_decided and time == 4.0:
                decide(centre, *found.track[found.position[:, 0] < 0])
        states.append(pickle.dumps(centre))
    assert states[0] == states[1]


def test_separate_targets_stay_apart():
    centre = FusionCentre(RADARS[:2], registration=False)
    apart = messages(10.0, sensors=(0, 1), places=PLACES[:1], shift=(0.0, 3000.0))
    found = centre.update(apart, time=10.0)
    assert len(found) == 2
    centre.separate(*found.track.tolist())
    close = messages(60.0, sensors=(0, 1), places=PLACES[:1])
    close = close[close.time > 10.0]
    for time in (20.0, 30.0, 40.0):
        new = close[(close.time > time - 10.0) & (close.time <= time)]
        assert len(centre.update(new, time=time)) == 2
    centre.release(int(found.track[0]))
    new = close[(close.time > 40.0) & (close.time <= 50.0)]
    assert len(centre.update(new, time=50.0)) == 1


def test_identities_contradict():
    tracks = messages(places=PLACES[:1], sensors=(0, 1))
    names = {name: getattr(tracks, name) for name in SensorTracks.__slots__}
    different = SensorTracks(**(names | {"identity": 100 + tracks.sensor}))
    assert len(last(fuse_tracks(different, RADARS))) == 2
    equal = SensorTracks(**(names | {"identity": 100}))
    found = last(fuse_tracks(equal, RADARS))
    assert len(found) == 1
    assert found.identity[0] == 100


@pytest.mark.parametrize(
    ("kinds", "count"),
    [
        # an address decides, a callsign before a code; what has no kind in common says nothing
        ({"icao_address": 5, "mode_3a": [0o1, 0o2]}, 1),
        ({"icao_address": [5, 6], "mode_3a": 0o1}, 2),
        ({"callsign": ["CSA1", "CSA2"], "mode_3a": 0o1}, 2),
        ({"callsign": "CSA1", "mode_3a": [0o1, 0o2]}, 1),
        ({"icao_address": [5, -1], "mode_3a": [-1, 0o2]}, 1),
    ],
)
def test_the_identity_that_is_shared_least_decides(kinds, count):
    tracks = messages(places=PLACES[:1], sensors=(0, 1))
    names = {name: getattr(tracks, name) for name in SensorTracks.__slots__}
    of = {name: np.broadcast_to(value, 2)[tracks.sensor] for name, value in kinds.items()}
    found = last(fuse_tracks(SensorTracks(**(names | of)), RADARS))
    assert len(found) == count
    for name, values in of.items():
        assert set(getattr(found, name)) <= set(values)
    if count == 1 and np.min(kinds["mode_3a"]) < 0:
        assert (found.icao_address[0], found.mode_3a[0]) == (5, 0o2)


def test_what_one_sensor_sees_alone_is_doubtful():
    tracks = messages(places=PLACES[:2])
    ghost = (tracks.sensor > 0) & (tracks.track % 10 == 1)
    found = last(fuse_tracks(tracks[~ghost], RADARS))
    assert_array_equal(found.doubtful, [False, True])
    assert found.count == 1


def test_a_sensor_without_covariances():
    tracks = messages()
    names = {name: getattr(tracks, name) for name in SensorTracks.__slots__}
    bare = SensorTracks(**(names | {"covariance": None}))
    assert last(fuse_tracks(bare, RADARS, method="matrix")).count == 4


@pytest.mark.parametrize("method", ["tracklets", "matrix"])
def test_a_row_at_the_place_of_a_sensor(method):
    centre = FusionCentre(RADARS, method=method)
    for time, off in zip(np.arange(0.0, 20.0, 4.0), (30.0, -20.0, 0.0, 40.0, -30.0), strict=True):
        away = np.array([[200.0 * (time - 8.0) + off, off], [3e4, 200.0 * time + off]])
        places = RADARS[0].position[:2] + away
        rows = SensorTracks([time] * 2, 0, [1, 2], places, [[200.0, off], [off, 200.0]])
        found = centre.update(rows, time=time)
        assert len(found) == 2
        assert np.isfinite(found.position).all()
        assert np.all(np.linalg.eigvalsh(found.covariance) > 0)


def test_covariances_lose_the_asymmetry_of_rounding():
    rounded = COVARIANCE.copy()
    rounded[2, 3] += 1e-12 * rounded[2, 2]
    found = SensorTracks([1.0], 0, 1, [[1e3, 0.0]], [[0.0, 0.0]], covariance=rounded).covariance
    assert_array_equal(found, np.swapaxes(found, 1, 2))
    found = fuse_tracks(messages(), RADARS).covariance
    assert_array_equal(found, np.swapaxes(found, 1, 2))


def test_late_messages_wait():
    tracks = messages(20.0)
    centre = FusionCentre(RADARS)
    centre.update(tracks, time=10.0)
    found = centre.update(tracks[:0], time=20.0)
    assert len(found) == 4
    whole = fuse_tracks(tracks, RADARS, update_interval=10.0)
    assert_array_equal(found.position, last(whole).position)


def test_the_last_row_is_in_the_last_cycle():
    # 2104.81 + 1865 cycles of 2.5 s is 6767.3099999999995
    times = [2104.81, 6767.31]
    tracks = SensorTracks(times, 0, [1, 2], [[3e4, 0.0]] * 2, [[0.0, 0.0]] * 2)
    found = fuse_tracks(tracks, RADARS[:1], update_interval=2.5)
    assert_array_equal(last(found).members, [[2]])
    assert found.time[-1] == times[-1]


def test_nothing():
    assert len(fuse_tracks(messages()[:0], RADARS)) == 0


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"method": "best"}, "method is 'best'"),
        ({"cross_correlation": (0.1, 1.0)}, "cross_correlation is"),
        ({"update_interval": 0.0}, "update_interval"),
    ],
)
def test_wrong_options(options, text):
    with pytest.raises(ValueError, match=text):
        FusionCentre(RADARS, **options)


def test_wrong_messages():
    with pytest.raises(ValueError, match=r"sensor\[0\] is -1"):
        SensorTracks([0.0], -1, 1, [[0.0, 0.0]], [[0.0, 0.0]])
    with pytest.raises(ValueError, match=r"time\[0\]"):
        SensorTracks([np.nan], 0, 1, [[0.0, 0.0]], [[0.0, 0.0]])
    skewed = COVARIANCE.copy()
    skewed[0, 1] += 1.0
    with pytest.raises(ValueError, match=r"covariance\[0, 0, 1\] is .* must be symmetric"):
        SensorTracks([0.0], 0, 1, [[1e3, 0.0]], [[0.0, 0.0]], covariance=skewed)
    centre = FusionCentre(RADARS[:1])
    with pytest.raises(ValueError, match=r"sensor\[0\] is 1; there are 1"):
        centre.update(SensorTracks([0.0], 1, 1, [[1e3, 0.0]], [[0.0, 0.0]]), time=1.0)
    centre.update(SensorTracks([0.0], 0, 1, [[1e3, 0.0]], [[0.0, 0.0]]), time=1.0)
    with pytest.raises(ValueError, match="later"):
        centre.update(SensorTracks([0.0], 0, 1, [[1e3, 0.0]], [[0.0, 0.0]]), time=1.0)
    with pytest.raises(TypeError, match="tracks"):
        centre.update(None, time=2.0)


def test_fused_tracks_are_as_good_as_a_tracker_of_all_plots_in_turns():
    radars = [replace(radar, azimuth_sigma=1.5e-3) for radar in RADARS]
    traffic = simulate.dense_traffic(60, area=(1e5, 1e5), turning_share=1.0, rng=3)
    plots = simulate.radar_plots(traffic, radars, rng=4).plots
    several = []
    for k, radar in enumerate(radars):
        own = plots[plots.sensor == k]
        own = Plots(own.time, own.range, own.azimuth, height=own.height, identity=own.identity)
        several.append(SensorTracks.of(track(own, [radar]), sensor=k))
    found = fuse_tracks(SensorTracks.concatenate(several), radars)
    found = found[found.time > 60.0]
    error = found.position - traffic.at(found.identity, found.time)[0]
    central = track(plots, radars)
    central = central[(central.time > 60.0) & (central.plot >= 0) & central.confirmed]
    other = central.position - traffic.at(plots.identity[central.plot], central.time)[0]
    rms = [np.sqrt(np.nanmedian(np.sum(e**2, axis=1))) for e in (error, other)]
    # pictures are some seconds older than the last plot of each target
    assert rms[0] < 1.25 * rms[1]
    square = metrics.nees(error, found.covariance[:, :2, :2]) / 2
    near = np.linalg.norm(error, axis=1) < 2000.0
    assert 0.7 < np.mean(square[near]) < 1.2


def test_a_row_between_two_plots_does_not_move_the_target():
    # a tracker that has taken a false plot 3 km away states how little it knows
    traffic = simulate.dense_traffic(1, area=(1e3, 1e3), turning_share=0.0, duration=100.0, rng=3)
    record = simulate.radar_plots(traffic, RADARS[1:], clutter=0, rng=4)
    several = []
    for k in range(2):
        own = record.plots[record.plots.sensor == k]
        table = track(Plots(own.time, own.range, own.azimuth, height=own.height), [RADARS[1 + k]])
        several.append(SensorTracks.of(table, sensor=k))
    tracks = SensorTracks.concatenate(several)
    sure = fuse_tracks(tracks, RADARS[1:])
    row = np.flatnonzero((tracks.sensor == 0) & (tracks.time > 70.0))[0]
    position, covariance = tracks.position.copy(), tracks.covariance.copy()
    position[row] += [3000.0, 1000.0]
    covariance[row] += np.diag([3000.0**2, 1000.0**2, 100.0**2, 100.0**2])
    doubtful = fuse_tracks(replace(tracks, position=position, covariance=covariance), RADARS[1:])
    assert len(sure) == len(doubtful) > 0
    off = np.linalg.norm(doubtful.position - sure.position, axis=1)
    sigma = np.sqrt(np.trace(sure.covariance[:, :2, :2], axis1=1, axis2=2))
    assert np.max(off[sure.time > 70.0] / sigma[sure.time > 70.0]) < 1.5


def test_a_target_moves_when_the_errors_of_its_sensor_are_found():
    """Without new rows it moves as far as the ranges of its sensor are found to be longer."""
    radars = [RADARS[0], replace(RADARS[1], bias=Bias(range_sigma=100.0))]
    traffic = simulate.dense_traffic(20, area=(1e5, 1e5), turning_share=0.0, duration=100.0, rng=1)
    bias = Bias(range=[0.0, 150.0])
    record = simulate.radar_plots(traffic, radars, bias=bias, rng=2)
    plots, lone, rows = record.plots, record.target == 2, []
    # the first sensor sees the others from 20 s on, the second one the lone target until 38 s
    seen = [(plots.time > 20.0) & ~lone, (plots.time < 38.0) | ~lone]
    for k, radar in enumerate(radars):
        own = np.flatnonzero((plots.sensor == k) & seen[k])
        table = track(plots[own]._replaced(sensor=np.zeros(len(own), int)), [radar])
        rows.append(SensorTracks.of(table, sensor=k))
    number = table.track[(table.plot >= 0) & lone[own[table.plot]]][-1]
    tracks, centre, found = SensorTracks.concatenate(rows), FusionCentre(radars), []
    for end in np.arange(5.0, 50.0, 5.0):
        now = (tracks.time > end - 5.0) & (tracks.time <= end)
        picture = centre.update(tracks[now], time=end)
        found.append((picture[picture.members[:, 1] == number], centre.bias.range[1]))
    (before, unknown), (after, offset) = found[-2:]
    assert unknown == 0.0
    assert offset > 100.0
    moved = (after.position - before.position - 5.0 * before.velocity)[0]
    away = before.position[0] - radars[1].position
    assert_allclose(moved, -offset * away / np.linalg.norm(away), atol=0.05 * offset)


def filtered(plots, radar: Radar, sensor: int, target, density=1.0, factor=1.0) -> SensorTracks:
    """Return tracks of filters of nearly constant velocity, one for each target.

    They assume that ranges are less accurate by `factor`.
    """
    away = plots.range[:, np.newaxis] * np.column_stack(
        [np.sin(plots.azimuth), np.cos(plots.azimuth)]
    )
    rows, states, covariances = [], [], []
    for number in np.unique(target):
        own, x, p = np.flatnonzero(target == number), None, None
        for last, i in pairwise(own):
            t, e = plots.time[i] - plots.time[last], away[i] / plots.range[i]
            f = np.array([e[1], -e[0]])
            across = plots.range[i] * radar.azimuth_sigma
            along = factor * radar.range_sigma
            r = along**2 * np.outer(e, e) + across**2 * np.outer(f, f)
            if x is None:
                x = np.concatenate([away[i], (away[i] - away[last]) / t])
                p = np.block([[r, r / t], [r / t, 2 * r / t**2]])
            else:
                ahead = np.kron([[1.0, t], [0.0, 1.0]], np.eye(2))
                q = np.kron([[t**3 / 3, t**2 / 2], [t**2 / 2, t]], np.eye(2))
                x, p = ahead @ x, ahead @ p @ ahead.T + density * q
                gain = np.linalg.solve(p[:2, :2] + r, p[:2]).T
                x, p = x + gain @ (away[i] - x[:2]), p - gain @ p[:2]
            rows.append(i)
            states.append(x)
            covariances.append(p)
    state = np.array(states)
    position = state[:, :2] + np.asarray(radar.position)[:2]
    return SensorTracks(
        plots.time[rows],
        sensor,
        target[rows],
        position,
        state[:, 2:],
        covariance=np.array(covariances),
        identity=target[rows],
    )


def tracked(seed, density=1.0, factor=1.0):
    """Flights, and their tracks by Kalman filters at two radars."""
    flights = simulate.dense_traffic(
        20, area=(8e4, 8e4), turning_share=0.5, duration=300.0, rng=seed
    )
    record = simulate.radar_plots(flights, RADARS[1:], clutter=0, rng=seed + 1)
    several = []
    for k, radar in enumerate(RADARS[1:]):
        own = record.plots.sensor == k
        flat = record.plots[own]
        ground = np.sqrt(flat.range**2 - np.nan_to_num(flat.height) ** 2)
        flat = Plots(flat.time, ground, flat.azimuth)
        several.append(filtered(flat, radar, k, record.target[own], density, factor))
    return flights, SensorTracks.concatenate(several)


@pytest.fixture(scope="module")
def foreign():
    return tracked(11)


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_plots_of_slow_filters_are_known_from_their_covariances(factor):
    """They lag by kilometres in turns. From corrections alone, a tenth was wrong by 150 m."""
    distances = []
    for seed in (11, 31):
        flights, tracks = tracked(seed, density=0.02, factor=factor)
        # of twice the noise
        found = fuse_tracks(replace(tracks, covariance=2.0 * tracks.covariance), RADARS[1:])
        found = found[found.time > 100.0]
        error = found.position - flights.at(found.identity, found.time)[0]
        distances.append(np.linalg.norm(error[np.isfinite(error[:, 0])], axis=1))
    assert np.quantile(np.concatenate(distances), 0.9) < 100.0


def test_covariances_that_are_almost_singular(foreign):
    _, tracks = foreign
    root = np.array([10.0, 10.0, 1.0, 1.0])
    stated = np.outer(root, root) + 1e-6 * np.eye(4)
    stated = np.broadcast_to(stated, tracks.covariance.shape)
    found = fuse_tracks(replace(tracks, covariance=stated), RADARS[1:])
    assert np.all(np.isfinite(found.position))
    assert np.all(np.isfinite(found.covariance))


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0, None])
def test_regions_hold_whatever_other_filters_state(foreign, factor):
    flights, tracks = foreign
    stated = np.full_like(tracks.covariance, np.nan)
    if factor is not None:
        stated = factor * tracks.covariance
    found = fuse_tracks(replace(tracks, covariance=stated), RADARS[1:])
    found = found[found.time > 60.0]
    error = found.position - flights.at(found.identity, found.time)[0]
    known = np.isfinite(error[:, 0])
    error, covariance = error[known], found.covariance[known][:, :2, :2]
    assert 0.9 < np.mean(in_region(error, covariance)) < 0.995
    distance = np.linalg.norm(error, axis=1)
    assert np.median(distance) < 35.0
    assert np.quantile(distance, 0.98) < 250.0


def test_rows_that_only_go_straight_on_say_nothing(foreign):
    """A sensor that also sends where its tracks are between plots tells no more than others."""
    _, tracks = foreign
    later = replace(tracks, time=tracks.time + 1.0, position=tracks.position + tracks.velocity)
    both = fuse_tracks(SensorTracks.concatenate([tracks, later]), RADARS[1:])
    alone = fuse_tracks(tracks, RADARS[1:])
    both, alone = (one[(one.time > 60.0) & (one.time < 280.0)] for one in (both, alone))
    ratio = np.median(both.covariance[:, 0, 0]) / np.median(alone.covariance[:, 0, 0])
    assert 0.9 < ratio < 1.2
