"""Late plots: final rows do not depend on the order in which plots came."""

import pickle

import numpy as np
import pytest
from tracker.flights import line, scene
from tracker.test_hypotheses import RADAR, side_by_side

from tertia.tracker import COLUMNS, Plots, PlotStatus, Radar, Tracker, TrackTable, track

LAG = 10.0
END = 440.0
# what does not depend on the index of plots
NAMES = [column.name for column in COLUMNS if column.name != "plot"]


def arrivals(time, share, latest, rng):
    """When plots arrive: some of them late."""
    late = rng.random(len(time)) < share
    return time + np.where(late, rng.uniform(0.0, latest, len(time)), 0.0)


def calls(plots, arrival, every):
    """Plots of each call, by arrival, and its time."""
    order = np.argsort(arrival, kind="stable")
    ends = np.arange(every, arrival.max() + every, every)
    for part, end in zip(
        np.split(order, np.searchsorted(arrival[order], ends)), ends, strict=False
    ):
        yield plots[part], float(end)


def fed(tracker, plots, arrival, every, *, rng=None, saved=False):
    """Tables of all calls and of `finish`, and the indices of plots as they came."""
    tables, came = [], []
    parts = list(calls(plots_with_index(plots), arrival, every))
    for k, ((part, index), end) in enumerate(parts):
        mixed = np.arange(len(index)) if rng is None else rng.permutation(len(index))
        came.append(index[mixed])
        tables.append(tracker.update(part[mixed], time=end))
        if saved and k == len(parts) // 2:
            tracker = pickle.loads(pickle.dumps(tracker))
    # misses are counted until the same time
    tables += [tracker.update(plots[:0], time=END), tracker.finish()]
    return tables, np.concatenate(came)


class plots_with_index:  # noqa: N801
    """Plots and their indices, both of which are taken by an index."""

    def __init__(self, plots):
        self.plots = plots

    def __getitem__(self, index):
        return self.plots[index], index


def record(tables, came):
    """The bytes of the final rows, plots by their true index."""
    final = TrackTable.join([table[table.final] for table in tables])
    plot = np.where(final.plot < 0, -1, came[final.plot])
    return [plot.tobytes(), *(getattr(final, name).tobytes() for name in NAMES)]


@pytest.fixture(scope="module")
def mixed():
    radar, _, seen = scene(11, n=12, clutter=10.0)
    early = seen.plots.time < 400.0
    plots = seen.plots[early]
    other = Radar(
        (30e3, -20e3), range_sigma=60.0, azimuth_sigma=0.0015, scan_period=5.0, max_range=120e3
    )
    return [radar, other], plots


@pytest.mark.parametrize(("seed", "every", "n_threads"), [(1, 4.0, 1), (2, 1.3, 2), (3, 11.0, 4)])
def test_final_rows_are_those_of_plots_in_order(mixed, seed, every, n_threads):
    radars, plots = mixed
    expected = record(*fed(Tracker(radars, lag=LAG), plots, plots.time, 4.0))
    rng = np.random.default_rng(seed)
    arrival = arrivals(plots.time, 0.3, LAG - every if every < LAG else 0.0, rng)
    tracker = Tracker(radars, lag=LAG if every < LAG else 25.0, n_threads=n_threads)
    tables, came = fed(tracker, plots, arrival, every, rng=rng, saved=True)
    statuses = np.concatenate([table.track_of_plot for table in tables])
    assert not np.any(statuses == PlotStatus.LATE)
    for name, found, wanted in zip(["plot", *NAMES], record(tables, came), expected, strict=True):
        assert found == wanted, name


@pytest.mark.parametrize(("seed", "every"), [(1, 4.0), (2, 1.3)])
def test_with_several_hypotheses_final_rows_are_those_of_plots_in_order(seed, every):
    plots, _ = side_by_side(7)
    expected = fed(Tracker([RADAR], association="mht", lag=LAG), plots, plots.time + 0.5, 4.0)
    rng = np.random.default_rng(seed)
    arrival = arrivals(plots.time, 0.3, LAG - every, rng) + 0.5
    found = fed(
        Tracker([RADAR], association="mht", lag=LAG), plots, arrival, every, rng=rng, saved=True
    )
    assert record(*found) == record(*expected)
    final = TrackTable.join([table[table.final] for table in found[0]])
    assert np.min(final.association_probability) < 0.95


def test_a_recording_with_a_lag_is_the_record_of_a_tracker_with_one(mixed):
    radars, plots = mixed
    tables, came = fed(Tracker(radars, lag=LAG), plots, plots.time, 4.0)
    final = TrackTable.join([table[table.final] for table in tables])
    whole = track(plots, radars, lag=LAG)
    assert np.all(whole.final)
    confirmed = whole[whole.confirmed & (whole.time <= plots.time.max())]
    final = final[final.time <= plots.time.max()]
    assert np.array_equal(np.sort(final.time), np.sort(confirmed.time))
    assert np.array_equal(np.sort(came[final.plot]), np.sort(came[confirmed.plot]))


def test_what_holds_in_the_end_is_the_record(mixed):
    radars, plots = mixed
    rng = np.random.default_rng(4)
    arrival = arrivals(plots.time, 0.3, 6.0, rng)
    tables, _ = fed(Tracker(radars, lag=LAG), plots, arrival, 4.0)
    shown = TrackTable.join(tables)
    assert 0.05 < np.mean(~shown.final) < 0.95
    assert len(shown.latest()) == np.sum(shown.final)
    # until then no plot is in two rows, and rows before the last final one are final
    now = TrackTable.join(tables[: len(tables) // 2]).latest()
    used = now.plot[now.plot >= 0]
    assert len(np.unique(used)) == len(used)
    assert np.all(now.final[now.time <= now.time[now.final].max()])
    # what is shown at once is not much worse than the record
    pairs = {(t, s): p for t, s, p in zip(shown.time, shown.plot, shown.position, strict=True)}
    assert len(pairs) > 500


def test_plots_in_order_are_shown_once_and_made_final_once():
    radar = Radar(range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0, max_range=120e3)
    plots = line(30)
    tables, _ = fed(Tracker([radar], lag=25.0), plots, plots.time, 4.0)
    shown = TrackTable.join(tables)
    for final in (False, True):
        own = shown[shown.final == final]
        pairs = np.stack([own.track, own.plot], axis=-1)[own.plot >= 0]
        assert len(np.unique(pairs, axis=0)) == len(pairs)
    # a track has its number when its first plot is final
    first = shown.track[0]
    assert first >= 2**40
    assert set(shown.track[shown.final]) == {1}
    assert set(shown.track[~shown.final]) == {1, first}


def test_older_plots_are_late_and_what_follows_a_gap_is_not():
    radar = Radar(range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0, max_range=120e3)
    plots = line(10)
    tracker = Tracker([radar], lag=LAG)
    tracker.update(plots[:8])
    early = line(1, start=10.0)
    assert tracker.update(early).track_of_plot[0] == PlotStatus.LATE
    # alone and an hour later: perhaps a wrong clock, until they go on and no others come
    far = [line(1, start=3600.0 + 4.0 * k) for k in range(4)]
    assert tracker.update(far[0]).track_of_plot[0] == PlotStatus.CLOCK_ERROR
    assert tracker.update(plots[8:]).track_of_plot[0] > 0
    for one in far[1:3]:
        assert tracker.update(one).track_of_plot[0] == PlotStatus.CLOCK_ERROR
    assert tracker.update(far[3]).track_of_plot[0] > 0
    assert len(tracker.finish()) >= 0
    assert tracker.update(plots[9:]).track_of_plot[0] == PlotStatus.LATE
    again = tracker.update(line(10, start=3610.0))
    assert len(TrackTable.join([again, tracker.finish()]).latest()) >= 7
    assert len(tracker.finish()) == 0


@pytest.mark.parametrize("lag", [-1.0, np.nan, np.inf])
def test_an_impossible_lag_is_refused(lag):
    radar = Radar(range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0)
    with pytest.raises(ValueError, match="lag is"):
        Tracker([radar], lag=lag)
    with pytest.raises(TypeError, match="lag is 'long'"):
        Tracker([radar], lag="long")
    with pytest.raises(ValueError, match="registration needs plots in time order"):
        Tracker([radar], lag=1.0, registration=True)
    assert len(Tracker([radar]).finish()) == 0
    assert len(Tracker([radar], lag=1.0).update(Plots([], [], []))) == 0
