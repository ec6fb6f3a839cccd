"""Several hypotheses of which plot is whose: where they help, and where they change nothing."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from tracker.flights import noisy, scene

from tertia.tracker import COLUMNS, Mht, Plots, Radar, Tracker, track

RADAR = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
PERIOD = 4.0


def side_by_side(seed, apart=300.0, scans=30):
    """Two aircraft that come together, fly side by side, and part: plots and true positions."""
    change = 0.5 - 0.5 * np.cos(np.pi * (np.arange(25) + 0.5) / 25)
    steps = [np.zeros(12), change, np.ones(scans), change[::-1], np.zeros(12)]
    side = 0.5 * (5e3 + (apart - 5e3) * np.concatenate(steps))
    along = 200.0 * PERIOD * (np.arange(len(side)) - len(side) / 2)
    position = np.array([np.stack([along, 100e3 + sign * side], -1) for sign in (1, -1)])
    rng = np.random.default_rng(seed)
    seen = rng.uniform(size=position.shape[:2]) < 0.9
    time = np.broadcast_to(PERIOD * np.arange(len(side)), seen.shape)
    return Plots(time[seen], *noisy(position[seen], RADAR, rng)), position


def swapped(found, position):
    """Whether the tracks have changed their targets in the end."""
    before, after = (
        found.track[
            [
                rows[np.argmin(np.hypot(*(found.position[rows] - place).T))]
                for place in position[:, scan]
            ]
        ]
        for scan in (10, position.shape[1] - 3)
        for rows in [np.flatnonzero(found.confirmed & (found.time == PERIOD * scan))]
    )
    return bool(np.any(before != after))


def same(one, two):
    """All columns are equal to the last bit."""
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(one, column.name), getattr(two, column.name))
    np.testing.assert_array_equal(one.track_of_plot, two.track_of_plot)


def scans(plots):
    """Plots, scan by scan."""
    order = np.argsort(plots.time, kind="stable")
    for at in np.unique(plots.time):
        rows = order[plots.time[order] == at]
        yield Plots(plots.time[rows], plots.range[rows], plots.azimuth[rows])


def test_targets_far_apart_have_the_tracks_of_one_hypothesis():
    radar, _, seen = scene(3, n=30, clutter=0.0)
    one = track(seen.plots, [radar])
    certain = track(seen.plots, [radar], association=Mht(cut=0.0))
    same(one, certain)
    several = track(seen.plots, [radar], association="mht")
    alone = np.isin(several.track, np.unique(several.track[several.association_probability < 1]))
    assert np.mean(~alone) > 0.5
    plots = set(several.plot[~alone].tolist()) - {-1}
    both = [np.isin(table.plot, list(plots)) for table in (one, several)]
    for column in COLUMNS:
        if column.name != "track":
            values = [
                getattr(t, column.name)[rows] for t, rows in zip((one, several), both, strict=True)
            ]
            np.testing.assert_array_equal(*values)


def test_one_hypothesis_is_the_best_assignment():
    plots, _ = side_by_side(5)
    same(track(plots, [RADAR]), track(plots, [RADAR], association=Mht(max_hypotheses=1)))
    assert np.all(track(plots, [RADAR]).association_probability == 1.0)


def test_fewer_tracks_change_their_targets():
    swaps = {"gnn": 0, "mht": 0}
    for seed in range(75):
        plots, position = side_by_side(seed)
        for association in swaps:
            found = track(plots, [RADAR], association=association)
            assert len(np.unique(found.track)) == 2
            swaps[association] += swapped(found, position)
    assert swaps["gnn"] >= 12
    assert swaps["mht"] <= 0.5 * swaps["gnn"]


def test_a_choice_is_sure_again_after_the_encounter():
    plots, _ = side_by_side(2)
    found = track(plots, [RADAR], association="mht")
    assert np.all((found.association_probability > 0.0) & (found.association_probability <= 1.0))
    close = (found.time > 37 * PERIOD) & (found.time < 67 * PERIOD)
    assert found.association_probability[close].min() < 0.95
    assert np.all(found.association_probability[found.time > 100 * PERIOD] == 1.0)
    assert np.all(found.association_probability[found.time < 20 * PERIOD] == 1.0)


def test_scan_by_scan_saved_and_loaded():
    plots, _ = side_by_side(7)
    whole = Tracker([RADAR], association="mht")
    parts = Tracker([RADAR], association="mht")
    for scan in scans(plots):
        parts = pickle.loads(pickle.dumps(parts))
        same(whole.update(scan), parts.update(scan))


def test_any_number_of_threads():
    rng = np.random.default_rng(4)
    pairs = [side_by_side(seed, scans=8)[0] for seed in range(60)]
    turn = np.radians(6.0) * np.arange(len(pairs))
    count = [len(one) for one in pairs]
    plots = Plots(
        np.concatenate([one.time for one in pairs]),
        np.concatenate([one.range for one in pairs]),
        np.concatenate([one.azimuth for one in pairs]) + np.repeat(turn, count),
    )
    false = 1500 * len(np.unique(plots.time))
    plots = Plots(
        np.concatenate([plots.time, PERIOD * rng.integers(0, 82, false)]),
        np.concatenate([plots.range, 150e3 * np.sqrt(rng.uniform(size=false))]),
        np.concatenate([plots.azimuth, rng.uniform(0, 2 * np.pi, false)]),
    )
    one = track(plots, [RADAR], association="mht", n_threads=1)
    assert one.association_probability.min() < 0.9
    for n_threads in (2, 3):
        same(one, track(plots, [RADAR], association="mht", n_threads=n_threads))


@pytest.mark.parametrize(
    ("association", "error", "message"),
    [
        ("jpda", ValueError, "association is 'jpda'; it must be one of gnn, mht, paper"),
        (3, TypeError, "association is 3; it must be an Mht, a PaperScore, or one of"),
    ],
)
def test_wrong_associations(association, error, message):
    with pytest.raises(error, match=message):
        Tracker([RADAR], association=association)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"max_hypotheses": 0}, "max_hypotheses is 0"),
        ({"scans": 0}, "scans is 0"),
        ({"cut": -1.0}, "cut is -1"),
        ({"cut": np.nan}, "cut"),
    ],
)
def test_wrong_limits(options, message):
    with pytest.raises(ValueError, match=message):
        Mht(**options)


CELL = {"range_resolution": 150.0, "azimuth_resolution": np.radians(1.4)}


def merging(seed, apart=150.0):
    """Two aircraft side by side whose plots merge while they are close."""
    plots, position = side_by_side(seed, apart=apart)
    middle = position.mean(axis=0)
    gap = np.linalg.norm(position[0] - position[1], axis=-1)
    merged = np.flatnonzero(gap < 300.0)
    scan = np.round(plots.time / PERIOD).astype(int)
    own = ~np.isin(scan, merged)
    rng = np.random.default_rng([seed, 1])
    distance, azimuth = noisy(middle[merged], RADAR, rng)
    return (
        Plots(
            np.concatenate([plots.time[own], PERIOD * merged]),
            np.concatenate([plots.range[own], distance]),
            np.concatenate([plots.azimuth[own], azimuth]),
        ),
        merged,
    )


@pytest.mark.parametrize("association", ["gnn", "mht"])
def test_a_merged_plot_is_that_of_both_tracks(association):
    plots, merged = merging(3)
    knows = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0, **CELL)
    found = track(plots, [knows], association=association)
    assert len(np.unique(found.track)) == 2
    numbers, counts = np.unique(found.plot[found.merged], return_counts=True)
    assert np.all(counts == 2)
    assert len(numbers) > 0.7 * len(merged)
    np.testing.assert_array_equal(found.track_of_plot[numbers], found.track.min())
    assert not np.any(found.merged & (found.plot < 0))
    without = track(plots, [RADAR], association=association)
    assert not np.any(without.merged)
    missed = [np.sum((t.plot < 0) & np.isin(t.time, PERIOD * merged)) for t in (found, without)]
    assert missed[0] < 0.5 * missed[1]


def test_a_radar_that_resolves_all_far_targets_changes_nothing():
    radar, _, seen = scene(3, n=10, clutter=0.0)
    fine = replace(radar, range_resolution=1.0, azimuth_resolution=1e-5)
    one, two = (track(seen.plots, [own]) for own in (radar, fine))
    same(one, two)


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ({"range_resolution": 150.0}, "azimuth_resolution is None; both"),
        ({"range_resolution": 0.0, "azimuth_resolution": 0.02}, "range_resolution"),
        ({"range_resolution": 150.0, "azimuth_resolution": -1.0}, "azimuth_resolution"),
    ],
)
def test_wrong_resolutions(cell, message):
    with pytest.raises(ValueError, match=message):
        Radar(range_sigma=50.0, azimuth_sigma=0.001, scan_period=4.0, **cell)
