"""Radars with channels: what a plot was detected by says how exact it is, and how likely false."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from tracker.flights import line

from tertia import metrics, simulate
from tertia.geo import SystemPlane
from tertia.sensors import Channel
from tertia.tracker import COLUMNS, Mht, Plots, Radar, Tracker, track

CHANNELS = {
    "psr": Channel(0.85, range_sigma=80.0, azimuth_sigma=0.0028),
    "ssr": Channel(0.6, range_sigma=30.0, azimuth_sigma=0.001),
}
PLAIN = Radar(range_sigma=60.0, azimuth_sigma=0.002, scan_period=4.0, max_range=120e3)
RADAR = replace(PLAIN, detection_probability=None, channels=CHANNELS)
NAMES = [column.name for column in COLUMNS]


def seen(seed, clutter=100.0, end=240.0, radar=RADAR):
    plans = simulate.routes("middle", 25, rng=seed)
    traffic = simulate.flights(plans, wind=15.0, rng=seed + 1)
    found = simulate.radar_plots(
        traffic, [radar], clutter=clutter, identity_missing_probability=1.0, rng=seed + 2
    )
    return traffic, found[found.plots.time < end]


def assert_same(table, other, names=NAMES):
    assert len(table) == len(other) > 0
    for name in names:
        np.testing.assert_array_equal(getattr(table, name), getattr(other, name), err_msg=name)


def errors(table, traffic, target):
    """Errors of confirmed rows with plots of targets, and NEES per axis."""
    rows = table[table.confirmed & (table.plot >= 0)]
    rows = rows[target[rows.plot] >= 0]
    position, _ = traffic.at(target[rows.plot], rows.time)
    off = rows.position - position
    return off, metrics.nees(off, rows.covariance[:, :2, :2]) / 2


def test_detections_count_for_radars_with_channels_alone():
    _, scene = seen(1)
    plain = Plots(*(getattr(scene.plots, name) for name in ("time", "range", "azimuth")))
    with_names = replace(plain, detection=scene.plots.detection)
    assert_same(track(with_names, [PLAIN]), track(plain, [PLAIN]))


def test_what_is_not_known_has_the_sigmas_of_the_radar():
    plots = Plots(
        np.arange(5.0), [60e3] * 5, 0.5, detection=["psr", "ssr", "psr+ssr", "mode-s", ""]
    )
    _, covariance = plots.to_cartesian([RADAR])
    for k, channel in enumerate((CHANNELS["psr"], CHANNELS["ssr"], CHANNELS["ssr"], PLAIN, PLAIN)):
        alone = replace(PLAIN, range_sigma=channel.range_sigma, azimuth_sigma=channel.azimuth_sigma)
        _, own = Plots([0.0], [60e3], 0.5).to_cartesian([alone])
        np.testing.assert_allclose(covariance[k], own[0], rtol=1e-12)


def test_noise_by_detection_on_the_earth():
    pytest.importorskip("pyproj")
    site = SystemPlane(50.0, 14.0)
    options = {"scan_period": 4.0, "range_sigma": 60.0, "azimuth_sigma": 0.002}
    radar = site.radar(50.2, 14.5, 300.0, **options, channels=CHANNELS)
    plots = Plots(np.arange(3.0), [60e3] * 3, 0.5, height=9e3, detection=["psr", "psr+ssr", ""])
    _, covariance = plots.to_cartesian([radar])
    for k, sigmas in enumerate(((80.0, 0.0028), (30.0, 0.001), (60.0, 0.002))):
        own = options | dict(zip(("range_sigma", "azimuth_sigma"), sigmas, strict=True))
        alone = Plots([0.0], [60e3], 0.5, height=9e3)
        _, expected = alone.to_cartesian([site.radar(50.2, 14.5, 300.0, **own)])
        np.testing.assert_allclose(covariance[k], expected[0], rtol=1e-12)
    # the tracker takes the same
    first = Tracker([radar]).update(plots[1:2], time=1.0)
    assert len(first) == 0
    table = Tracker([radar], confirmation=(2, 2), clutter_density=1e-14)
    flown = Plots([0.0, 4.0], [60e3] * 2, 0.5, height=9e3, detection="ssr")
    rows = table.update(flown, time=4.0)
    _, expected = flown.to_cartesian([radar])
    assert len(rows)
    # the velocity is free: the position is that of the last plot
    np.testing.assert_allclose(rows.covariance[-1, :2, :2], expected[1], rtol=0.05)


def test_one_sigma_and_no_clutter_make_the_tracks_of_a_plain_radar():
    """Where all ways are alike, what a plot was detected by says nothing."""
    _, scene = seen(2, clutter=0.0)
    alike = {name: Channel(own.detection_probability) for name, own in CHANNELS.items()}
    radar = replace(PLAIN, detection_probability=None, channels=alike)
    plain = replace(PLAIN, detection_probability=radar.detection_probability)
    # a density that is known, the same share of which each way has
    one, other = (track(scene.plots, [own], clutter_density=1e-10) for own in (radar, plain))
    assert len(one) == len(other) > 0
    for name in ("time", "track", "plot", "confirmed"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_allclose(one.position, other.position, atol=1.0)


def test_tracks_are_nearer_and_their_covariance_holds():
    """Against a radar that has the mean noise of all plots; bounds hold for a dozen seeds."""
    ratios, scores = [], []
    for seed in (11, 21, 31):
        traffic, scene = seen(seed)
        known = scene.plots.detection[scene.target >= 0]
        share = np.mean(known == 0)
        range_sigma, azimuth_sigma = (
            np.sqrt(share * a**2 + (1 - share) * b**2) for a, b in ((80.0, 30.0), (0.0028, 0.001))
        )
        plain = replace(
            PLAIN,
            range_sigma=range_sigma,
            azimuth_sigma=azimuth_sigma,
            detection_probability=RADAR.detection_probability,
        )
        found = []
        for radar in (RADAR, plain):
            off, nees = errors(track(scene.plots, [radar]), traffic, scene.target)
            near = np.hypot(*off.T) < 2e3
            found.append((np.sqrt(np.mean(off[near] ** 2)), np.mean(nees[near])))
        ratios.append(found[0][0] / found[1][0])
        scores.append(found[0][1])
    assert np.mean(ratios) < 0.85
    assert 0.7 < np.mean(scores) < 1.2


def test_replies_are_stronger_evidence_than_echoes_in_clutter():
    """False plots are echoes: a chain of replies is confirmed sooner, and one of echoes later."""
    rng = np.random.default_rng(5)
    time = 4.0 * np.arange(12)
    false = [
        Plots(
            t + rng.uniform(0.0, 3.9, 120),
            120e3 * np.sqrt(rng.uniform(size=120)),
            rng.uniform(0.0, 2 * np.pi, 120),
            detection="psr",
        )
        for t in time
    ]
    own = line(12)
    doubt = {}
    for name in ("psr", "psr+ssr"):
        tracker = Tracker([RADAR])
        for k, clutter in enumerate(false):
            mine = Plots(own.time[k : k + 1], own.range[k], own.azimuth[k], detection=name)
            columns = {
                c: np.concatenate([getattr(clutter, c), getattr(mine, c)])
                for c in ("time", "range", "azimuth", "detection")
            }
            table = tracker.update(Plots(**columns), time=float(time[k]) + 3.95)
            row = table[table.confirmed & (table.plot == 121 * k + 120)]
            if len(row):
                doubt.setdefault(name, 1.0 - row.existence_probability[0])
    assert doubt["psr+ssr"] < 1e-2 * doubt["psr"]


def test_clutter_that_is_stated_is_taken_as_it_is():
    """A track of echoes needs more evidence where many false ones are stated."""
    few, many = (
        replace(
            PLAIN,
            detection_probability=None,
            channels={"psr": Channel(0.85, clutter_per_scan=count), "ssr": Channel(0.6)},
        )
        for count in (0.0, 5000.0)
    )
    plots = replace(line(10), detection=np.zeros(10, dtype=np.int64))
    rows = [track(plots, [radar], confirmation=(2, 3)) for radar in (few, many)]
    assert np.sum(rows[0].confirmed) > np.sum(rows[1].confirmed)
    answers = replace(plots, detection=np.ones(10, dtype=np.int64))
    rows = [track(answers, [radar], confirmation=(2, 3)) for radar in (few, many)]
    assert np.sum(rows[0].confirmed) == np.sum(rows[1].confirmed) > 0


def test_saved_states_threads_and_order_keep_it():
    _, scene = seen(4, end=120.0)
    plots = scene.plots
    whole = track(plots, [RADAR], n_threads=1)
    assert_same(track(plots, [RADAR], n_threads=2), whole)
    order = np.random.default_rng(1).permutation(len(plots))
    mixed = track(plots[order], [RADAR])
    assert_same(mixed, whole, [name for name in NAMES if name != "plot"])
    kept, saved = Tracker([RADAR]), Tracker([RADAR])
    for begin in np.arange(0.0, 120.0, 8.0):
        part = plots[(plots.time >= begin) & (plots.time < begin + 8.0)]
        saved = pickle.loads(pickle.dumps(saved))
        rows = [tracker.update(part, time=begin + 8.0) for tracker in (kept, saved)]
        assert len(rows[0]) == len(rows[1])
        for name in NAMES:
            np.testing.assert_array_equal(*(getattr(own, name) for own in rows))
    assert pickle.loads(pickle.dumps(plots)).detection.tolist() == plots.detection.tolist()


def test_late_plots_with_channels_end_as_those_in_order():
    _, scene = seen(6, end=100.0)
    plots = scene.plots
    late = plots.time + np.random.default_rng(2).uniform(0.0, 6.0, len(plots))
    found = []
    for came in (plots.time, late):
        tracker, tables, given = Tracker([RADAR], lag=10.0), [], 0
        order = np.argsort(came, kind="stable")
        for end in np.arange(4.0, 112.0, 4.0):
            until = int(np.searchsorted(came[order], end))
            tables.append(tracker.update(plots[order[given:until]], time=float(end)))
            given = until
        tables.append(tracker.finish())
        rows = [
            (*row.position[0].tolist(), *row.covariance[0].ravel().tolist())
            for table in tables
            for row in (table[k : k + 1] for k in np.flatnonzero(table.final))
        ]
        found.append(sorted(rows))
    assert found[0] == found[1]
    assert len(found[0]) > 100


def test_hypotheses_use_what_plots_were_detected_by():
    traffic, scene = seen(7)
    table = track(scene.plots, [RADAR], association=Mht())
    off, nees = errors(table, traffic, scene.target)
    near = np.hypot(*off.T) < 2e3
    assert np.sum(near) > 500
    assert 0.6 < np.mean(nees[near]) < 1.3


def test_more_noise_than_stated_is_found_and_used():
    """The same factor for all ways, from chains of plots of one way each."""
    loud = {
        name: Channel(0.9, range_sigma=2 * own.range_sigma, azimuth_sigma=2 * own.azimuth_sigma)
        for name, own in CHANNELS.items()
    }
    real = replace(RADAR, detection_probability=None, channels=loud)
    stated = {
        name: Channel(0.9, range_sigma=own.range_sigma, azimuth_sigma=own.azimuth_sigma)
        for name, own in CHANNELS.items()
    }
    radar = replace(RADAR, detection_probability=None, channels=stated)
    traffic, scene = seen(8, clutter=0.0, end=600.0, radar=real)
    off, nees = errors(track(scene.plots, [radar]), traffic, scene.target)
    near = np.hypot(*off.T) < 2e3
    assert np.mean(nees[near]) < 1.6
    quiet = seen(9, clutter=0.0, end=600.0, radar=radar)
    off, nees = errors(track(quiet[1].plots, [radar]), quiet[0], quiet[1].target)
    assert 0.7 < np.mean(nees) < 1.25
