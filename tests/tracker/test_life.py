"""Track life: duplicates, addresses, gaps, and whether the noise is what is stated."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from tracker.flights import RADAR, line, noisy, polar

from tertia import simulate
from tertia.sensors import PositionSensor
from tertia.tracker import Plots, PlotStatus, Radar, Tracker, TrackTable, track

ADDRESS_ERROR = 1e-9


def confirmed_tracks(table):
    return np.unique(table.track[table.confirmed])


def traffic_seen(seed, **options):
    radar = Radar(
        range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0, max_range=150e3
    )
    plans = simulate.routes("middle", 30, rng=seed)
    traffic = simulate.flights(plans, wind=15.0, rng=seed + 1)
    seen = simulate.radar_plots(
        traffic, [radar], clutter=20.0, identity_missing_probability=1.0, rng=seed + 2, **options
    )
    early = seen.plots.time < 600.0
    return radar, seen.plots[early], seen.target[early]


def test_duplicates_make_few_tracks_of_their_own():
    # without regard for them there were 62, with only their share 37
    radar, plots, target = traffic_seen(100, duplicate_probability=0.2)
    table = track(plots, [radar])
    aircraft = len(np.unique(target[target >= 0]))
    assert aircraft <= len(confirmed_tracks(table)) <= aircraft + 4
    assert np.sum(table.track_of_plot == PlotStatus.DUPLICATE) > 0.05 * np.sum(target >= 0)


def test_targets_close_together_are_no_duplicates():
    time = 4.0 * np.arange(60) + 1.0
    rng = np.random.default_rng(5)
    flown = np.array([20e3, 30e3]) + np.outer(time, [150.0, 60.0])
    both = [noisy(flown + np.array([0.0, apart]), RADAR, rng) for apart in (0.0, 150.0)]
    distance, azimuth = (np.concatenate(parts) for parts in zip(*both, strict=True))
    table = track(Plots(np.tile(time, 2), distance, azimuth), [RADAR])
    assert len(confirmed_tracks(table)) == 2
    assert not np.any(table.track_of_plot == PlotStatus.DUPLICATE)


def test_a_track_is_resumed_by_its_address_after_a_gap():
    early, late = line(15, seed=1), line(15, start=0.0, seed=2)
    time = np.concatenate([early.time, early.time + 180.0])
    position = np.array([10e3, 30e3]) + np.outer(time, [120.0, -80.0])
    distance, azimuth = noisy(position, RADAR, np.random.default_rng(3))
    plots = Plots(time, distance, azimuth, identity=0x3C6444)
    assert len(late) == 15
    options = {"identity_error_probability": ADDRESS_ERROR}
    assert len(confirmed_tracks(track(plots, [RADAR], **options))) == 1
    # without an address nobody knows
    nameless = Plots(time, distance, azimuth)
    assert len(confirmed_tracks(track(nameless, [RADAR]))) == 2
    # and nobody flies so far
    away = np.where(time > 100.0, azimuth + np.pi, azimuth)
    plots = Plots(time, distance + 60e3 * (time > 100.0), away, identity=0x3C6444)
    fast = track(plots, [RADAR], max_speed=150.0, **options)
    assert len(confirmed_tracks(fast)) == 2


def lost_and_found(missing, aside):
    """Plots of a flight with an address; after these scans without plots, it is found aside."""
    time = 4.0 * np.delete(np.arange(50 + missing), np.arange(25, 25 + missing))
    position = np.array([10e3, 30e3]) + np.outer(time, [120.0, -80.0])
    position[25:] += aside
    numbers = noisy(position, RADAR, np.random.default_rng(7))
    return Plots(time, *numbers, icao_address=np.full(50, 0x3C4DC1))


@pytest.mark.parametrize("lag", [0.0, 12.0])
@pytest.mark.parametrize(("missing", "aside"), [(4, 3e3), (2, 3e3), (0, 2e3)])
@pytest.mark.parametrize("registration", [False, True])
def test_a_resumed_track_has_all_of_its_plots(lag, missing, aside, registration):
    plots, radars = lost_and_found(missing, aside), [RADAR]
    if registration:
        other = replace(RADAR, position=[20e3, 0.0])
        radars = [RADAR, other]
    table = track(plots, radars, lag=lag)
    assert np.unique(table.track).tolist() == np.unique(table.track_of_plot).tolist() == [1]
    updates = table[table.plot >= 0]
    assert np.sort(updates.plot).tolist() == list(range(50))
    # from the first plot aside to the new confirmation, each scan has one row
    assert np.array_equal(np.sort(table.time), np.unique(table.time))
    assert np.all(np.isin(table.time[table.time >= plots.time[25]], plots.time))
    between = ~updates.confirmed & (updates.time > 50.0)
    assert np.sum(between) == 2
    assert np.all(updates.plot[between] >= 25)


def test_a_plot_with_another_address_is_never_of_this_track():
    time = 4.0 * np.arange(40)
    first = np.array([10e3, 30e3]) + np.outer(time, [50.0, 0.0])
    second = first + np.array([0.0, 30.0])
    rng = np.random.default_rng(4)
    both = [noisy(position, RADAR, rng) for position in (first, second)]
    # one is seen in even scans, the other in odd ones: each plot is in the gate of both
    even = np.arange(40) % 4 < 2
    distance, azimuth = (np.where(even, a, b) for a, b in zip(*both, strict=True))
    plots = Plots(time, distance, azimuth, identity=np.where(even, 0xABC001, 0xABC002))
    table = track(plots, [RADAR], identity_error_probability=ADDRESS_ERROR)
    own = table.track_of_plot
    for number in np.unique(own[own > 0]):
        assert len(np.unique(plots.identity[own == number])) == 1


@pytest.mark.parametrize(("radars", "most"), [(1, 16), (2, 18)])
def test_a_turn_with_three_g_is_flown_by_few_tracks(radars, most):
    # without resumption there were 26 and 41
    count = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        step = 0.05
        fine = np.arange(0.0, 180.0, step)
        rate = np.where((fine > 60.0) & (fine < 80.0), 29.4 / 200.0, 0.0)
        course = 0.3 + np.cumsum(rate) * step
        velocity = 200.0 * np.stack([np.sin(course), np.cos(course)], axis=-1)
        place = np.array([20e3, 40e3]) + np.cumsum(velocity, axis=0) * step
        sites = [
            RADAR,
            Radar((40e3, -10e3), range_sigma=70.0, azimuth_sigma=0.0017, scan_period=5.0),
        ]
        parts = []
        for k, radar in enumerate(sites[:radars]):
            time = np.arange(rng.uniform(0.0, radar.scan_period), 179.0, radar.scan_period)
            time = time[rng.random(len(time)) < 0.95]
            position = place[(time / step).astype(int)] - radar.position[:2]
            distance, azimuth = polar(position)
            distance += radar.range_sigma * rng.standard_normal(len(time))
            azimuth += radar.azimuth_sigma * rng.standard_normal(len(time))
            parts.append((time, distance, azimuth, np.full(len(time), k)))
        time, distance, azimuth, sensor = (np.concatenate(one) for one in zip(*parts, strict=True))
        table = track(Plots(time, distance, azimuth, sensor=sensor), sites[:radars])
        count += len(confirmed_tracks(table))
    assert count <= most


def straight_flights(rng, count=96, end=300.0):
    """Return plots of short flights close together, and whose they are."""
    parts = []
    for k in range(count):
        begin = rng.uniform(-120.0, end - 60.0)
        time = np.arange(max(begin, 0.0) + rng.uniform(0.0, 4.0), min(begin + 120.0, end), 4.0)
        time = time[rng.random(len(time)) < 0.7]
        course, speed = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(150.0, 260.0)
        flown = np.outer(time - begin, speed * np.array([np.sin(course), np.cos(course)]))
        distance, azimuth = noisy(rng.uniform(10e3, 50e3, 2) + flown, RADAR, rng)
        parts.append((time, distance, azimuth, np.full(len(time), k)))
    time, distance, azimuth, aircraft = (np.concatenate(one) for one in zip(*parts, strict=True))
    return Plots(time, distance, azimuth), aircraft


def test_a_number_stays_with_its_aircraft():
    # where a few scans without a plot did not matter there were twice as many
    changes = 0
    for seed in range(700, 740):
        plots, aircraft = straight_flights(np.random.default_rng(seed))
        table = track(plots, [RADAR])
        for number in confirmed_tracks(table):
            shown = (table.track == number) & table.confirmed & (table.plot >= 0)
            own = aircraft[np.sort(table.plot[shown])]
            # three plots of one aircraft in a row
            steady = own[2:][(own[2:] == own[1:-1]) & (own[2:] == own[:-2])]
            changes += np.count_nonzero(np.diff(steady))
    assert changes <= 48


def test_noise_that_is_not_what_is_stated_is_told():
    radar, plots, _ = traffic_seen(300)
    tracker = Tracker([radar])
    assert np.isnan(tracker.noise_factor).all()
    tracker.update(plots)
    assert tracker.noise_factor == pytest.approx(1.0, abs=0.12)
    for factor in (0.5, 2.0):
        stated = Radar(
            range_sigma=50.0 * factor,
            azimuth_sigma=np.radians(0.08) * factor,
            scan_period=4.0,
            max_range=150e3,
        )
        tracker = Tracker([stated], lag=5.0)
        tracker.update(plots)
        tracker.finish()
        found = tracker.noise_factor[0]
        assert 0.6 / factor < found < 1.35 / factor


def test_a_profile_follows_the_turns_of_its_kind():
    # a drone that turns by 25 degrees a second for four seconds, every twenty
    step = 0.05
    course = np.cumsum(np.where(np.arange(0.0, 200.0, step) % 20 < 4, np.radians(25.0), 0.0)) * step
    path = np.cumsum(12.0 * step * np.stack([np.sin(course), np.cos(course)], axis=1), axis=0)
    random, true = np.random.default_rng(31), path[::20] + np.array([300.0, 400.0])
    radar = Radar(range_sigma=3.0, azimuth_sigma=0.008, scan_period=1.0)
    rho, azimuth = polar(true)
    plots = Plots(
        np.arange(200.0),
        rho + 3.0 * random.standard_normal(200),
        azimuth + 0.008 * random.standard_normal(200),
    )

    def rms_error(profile):
        table = track(plots, [radar], profile=profile)
        return np.sqrt(np.mean(np.sum((table.position - true[table.plot]) ** 2, axis=1)))

    assert rms_error("drone") < 0.8 * rms_error("aircraft")
    assert rms_error("drone") < 4.0


def with_false_plots(seed, count, detection, clutter=50, scans=60):
    """Flights that leave after forty scans and false plots, and the target of each; -1: none."""
    rng = np.random.default_rng(seed)
    radar = Radar(
        range_sigma=50.0, azimuth_sigma=0.08, scan_period=4.0, max_range=100e3,
        detection_probability=detection, degrees=True,
    )  # fmt: skip
    angle = rng.uniform(0.0, 2 * np.pi, (2, count))
    start = 60e3 * np.stack([np.sin(angle[0]), np.cos(angle[0])], axis=-1)
    velocity = 180.0 * np.stack([np.sin(angle[1]), np.cos(angle[1])], axis=-1)
    rows = []
    for scan in range(scans):
        seen = np.flatnonzero(rng.uniform(size=count) < detection * (scan < 40))
        place = start[seen] + 4.0 * scan * velocity[seen]
        false = 100e3 * np.sqrt(rng.uniform(size=clutter)), rng.uniform(0, 2 * np.pi, clutter)
        noise = rng.standard_normal((2, len(seen)))
        distance = np.hypot(*place.T) + 50.0 * noise[0]
        azimuth = np.arctan2(*place.T) + np.radians(0.08) * noise[1]
        target = np.concatenate([seen, np.full(clutter, -1)])
        plots = [np.concatenate([distance, false[0]]), np.concatenate([azimuth, false[1]])]
        rows.append(np.column_stack([np.full(len(target), 4.0 * scan), *plots, target]))
    time, distance, azimuth, target = np.concatenate(rows).T
    return radar, Plots(time, distance, azimuth), target.astype(int)


def test_existence_is_certain_while_a_target_is_seen_and_falls_when_it_has_left():
    radar, plots, target = with_false_plots(1, 10, 0.9)
    table = track(plots, [radar])
    existence = table.existence_probability
    assert np.all((existence >= 0.0) & (existence <= 1.0))
    for number in range(10):
        own = (table.plot >= 0) & (target[table.plot] == number)
        rows = table[table.track == np.bincount(table.track[own]).argmax()]
        during = (rows.time > 40.0) & (rows.time < 150.0) & (rows.plot >= 0)
        assert np.min(rows.existence_probability[during]) > 0.9
        # five missed scans in the end
        assert rows.existence_probability[-1] < 0.02
        assert np.all(np.diff(rows.existence_probability[-4:]) < 0.0)


# .60 and .87 of the scans in the table of the page
@pytest.mark.parametrize(("detection", "share"), [(0.5, 0.75), (0.7, 0.95)])
def test_existence_confirms_targets_that_are_often_missed_sooner(detection, share):
    waits = []
    for rule in ((3, 4), 0.999):
        wait = []
        for seed in range(3):
            radar, plots, target = with_false_plots(seed, 20, detection, scans=40)
            table = track(plots, [radar], confirmation=rule)
            shown = table.confirmed & (table.plot >= 0)
            owner, time = target[table.plot[shown]], table.time[shown]
            assert len(np.unique(table.track[shown])) < 25
            wait += [
                np.min(time[owner == number], initial=160.0) - plots.time[target == number][0]
                for number in range(20)
            ]
        waits.append(np.mean(wait) / 4.0 + 1.0)
    assert waits[1] < share * waits[0]


def test_existence_survives_saving():
    radar, plots, _ = with_false_plots(2, 5, 0.9, scans=20)
    for rule in ((3, 4), 0.999):
        tracker = Tracker([radar], confirmation=rule)
        tracker.update(plots[plots.time < 40.0])
        loaded = pickle.loads(pickle.dumps(tracker))
        rest = plots[plots.time >= 40.0]
        one, other = tracker.update(rest), loaded.update(rest)
        np.testing.assert_array_equal(one.existence_probability, other.existence_probability)
        assert len(one) > 20


def anchored():
    """Return plots of a vessel at anchor that replies rarely, and of another one that appears."""
    random = np.random.default_rng(41)
    scans = 2.5 * np.arange(200.0)
    own = scans[(scans < 400.0) | (scans > 409.0)]
    other = scans[scans > 401.0] + 0.6
    reported = np.arange(30.0, 500.0, 180.0)
    way = np.array([4200.0, 3200.0]) + np.outer(other - other[0], [4.0, 2.0])
    place = np.vstack([np.tile([3000.0, 4000.0], (len(own), 1)), way])
    nothing = np.full(len(reported), np.nan)
    distance = np.hypot(*place.T) + 8.0 * random.standard_normal(len(place))
    azimuth = np.arctan2(*place.T) + 0.004 * random.standard_normal(len(place))
    return Plots(
        np.concatenate([own, other, reported]),
        np.append(distance, nothing),
        np.append(azimuth, nothing),
        sensor=np.repeat([0, 1], [len(place), len(reported)]),
        position=np.vstack([np.full((len(place), 2), np.nan), np.tile([3000.0, 4e3], (3, 1))]),
        identity=np.repeat([-1, 123], [len(place), len(reported)]),
    )


def test_a_vessel_that_reports_rarely_keeps_its_number():
    """Another vessel appears while the first one, which is long known, is not seen."""
    radar = Radar(range_sigma=8.0, azimuth_sigma=0.004, scan_period=2.5, max_range=12e3)
    ais = PositionSensor(position_sigma=10.0, update_interval=180.0)
    options = {"profile": "vessel", "identity_error_probability": 1e-9, "clutter_density": 1e-9}
    plots, tracker = anchored(), Tracker([radar, ais], **options)
    rows = []
    for begin in np.arange(0.0, 500.0, 2.5):
        part = plots[(plots.time >= begin) & (plots.time < begin + 2.5)]
        rows.append(tracker.update(part, time=begin + 2.5))
    table = TrackTable.join(rows)
    for number in np.unique(table.track):
        own = table[table.track == number]
        assert np.all(np.hypot(*np.ptp(own.position, axis=0)) < 600.0)
    near = np.hypot(*(table.position - [3000.0, 4e3]).T) < 100.0
    vessel = table[(table.time > 480.0) & near]
    assert set(vessel.track) == {table.track[0]}
    assert set(vessel.identity) == {123}
