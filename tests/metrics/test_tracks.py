"""Tracks versus truth: errors, matching and indicators, by hand and by counting."""

from types import SimpleNamespace

import numpy as np
import pytest
from checks import INF, NAN, rng

from tertia import metrics
from tertia.metrics import Truth, indicators, match_tracks, track_errors
from tertia.metrics._evaluation import Rows, judge


class TestTrackErrors:
    @pytest.mark.parametrize(
        ("error", "course", "along", "across"),
        [
            ([0, 5], 0.0, 5, 0),
            ([5, 0], 0.0, 0, 5),
            ([5, 0], 90.0, 5, 0),
            ([0, 5], 90.0, 0, -5),
            ([3, 4], 180.0, -4, -3),
            ([1, 1], 45.0, np.sqrt(2), 0),
            ([1, -1], 45.0, 0, np.sqrt(2)),
        ],
    )
    def test_by_hand(self, error, course, along, across):
        found = track_errors(error, np.radians(course))
        assert found == pytest.approx((along, across), abs=1e-15)
        assert isinstance(found[0], float)

    def test_turning_keeps_the_length(self):
        error, course = rng(1).normal(size=(4, 1, 2)), rng(2).uniform(0, 7, (1, 5))
        along, across = track_errors(error, course)
        assert along.shape == (4, 5)
        np.testing.assert_allclose(
            np.hypot(along, across), np.linalg.norm(error, axis=-1) + 0 * along
        )
        assert metrics.rmse(along) ** 2 + metrics.rmse(across) ** 2 == pytest.approx(
            metrics.rmse(np.linalg.norm(error, axis=-1)) ** 2
        )

    def test_what_is_not_known_is_nan(self):
        along, across = track_errors([[NAN, 1], [1, 0]], [0, 0])
        np.testing.assert_array_equal(np.isnan(along), [True, False])
        assert across[1] == 1

    def test_errors(self):
        with pytest.raises(ValueError, match=r"error has shape \(3,\)"):
            track_errors([1, 2, 3], 0)
        with pytest.raises(ValueError, match="do not fit together"):
            track_errors(np.ones((3, 2)), [0, 1])
        with pytest.raises(TypeError, match="course has dtype"):
            track_errors([1, 2], "north")


def flights(*rows):
    """Columns of the truth of targets, one argument each: identifier, then times and positions."""
    columns = [(t, name, (x, y)) for name, points in rows for t, x, y in points]
    time, target, position = zip(*columns, strict=True)
    return {"time": time, "target": target, "position": position}


def updates(*rows):
    """Updates, one row each: time, track, east, north."""
    time, track, east, north = np.array(rows, dtype=float).T
    return tracks(time, track.astype(int), np.column_stack([east, north]))


def tracks(time, track, position):
    return SimpleNamespace(time=time, track=track, position=position)


TWO = Truth(**flights((5, [(0, 0, 0), (10, 1000, 0)]), (2, [(0, 0, 100), (10, 1000, 100)])))


class TestMatchTracks:
    def test_the_nearest_target_between_its_times(self):
        found = match_tracks(updates((4, 1, 400, 10), (4, 2, 390, 95)), TWO, max_distance=50)
        np.testing.assert_array_equal(found.targets, [2, 5])
        np.testing.assert_array_equal(found.target, [1, 0])
        np.testing.assert_allclose(found.error, [[0, 10], [-10, -5]])
        np.testing.assert_array_equal(found.switches, [0, 0])
        assert repr(found) == "Matching(2 of 2 updates, 2 targets)"

    def test_outside_its_time_a_target_is_not_there(self):
        rows = [(t, 1, 100 * t, 0) for t in (-1e-6, 0, 10, 10 + 1e-6)]
        found = match_tracks(updates(*rows), TWO, max_distance=50)
        np.testing.assert_array_equal(found.matched, [False, True, True, False])

    def test_a_track_keeps_its_target(self):
        """At 5 s it is nearer to the other one, but still within the distance."""
        rows = [(4, 1, 400, 0), (5, 1, 500, 70), (6, 1, 600, 95)]
        found = match_tracks(updates(*rows), TWO, max_distance=80)
        np.testing.assert_array_equal(found.targets[found.target], [5, 5, 2])
        np.testing.assert_array_equal(found.switches, [0, 0])

    def test_a_switch_is_a_target_under_another_track(self):
        rows = [(1, 1, 100, 0), (2, 9, 200, 0), (3, 9, 300, 0), (4, 1, 400, 0)]
        found = match_tracks(updates(*rows), TWO, max_distance=50)
        np.testing.assert_array_equal(found.switches, [0, 2])

    def test_two_tracks_that_change_places(self):
        before = [(1, 1, 100, 0), (1, 2, 100, 100)]
        after = [(2, 1, 200, 100), (2, 2, 200, 0)]
        found = match_tracks(updates(*before, *after), TWO, max_distance=50)
        np.testing.assert_array_equal(found.targets[found.target], [5, 2, 2, 5])
        np.testing.assert_array_equal(found.switches, [1, 1])

    def test_a_second_track_shows_none(self):
        rows = [(1, 1, 100, 10), (1, 2, 100, -2), (2, 1, 200, 10), (2, 2, 200, -2)]
        found = match_tracks(updates(*rows), TWO, max_distance=50)
        np.testing.assert_array_equal(found.target, [-1, 1, -1, 1])

    def test_as_many_as_possible(self):
        """The first track is nearest to the target that is the only one for the second."""
        rows = [(1, 1, 100, 45), (1, 2, 100, -70)]
        found = match_tracks(updates(*rows), TWO, max_distance=80)
        np.testing.assert_array_equal(found.targets[found.target], [2, 5])

    def test_updates_of_one_scan_at_different_times(self):
        rows = [(1, 1, 100, 0), (2, 2, 200, 1), (5, 1, 500, 0), (6, 2, 600, 1)]
        apart = match_tracks(updates(*rows), TWO, max_distance=50)
        assert apart.matched.all()
        found = match_tracks(updates(*rows), TWO, max_distance=50, update_interval=4)
        np.testing.assert_array_equal(found.matched, [True, False, True, False])

    def test_a_track_twice_in_a_scan(self):
        rows = [(1, 1, 100, 0), (2, 1, 200, 20), (2, 2, 200, 15)]
        found = match_tracks(updates(*rows), TWO, max_distance=50, update_interval=4)
        np.testing.assert_array_equal(found.target, [1, 1, -1])

    def test_the_order_does_not_matter(self):
        generator = rng(7)
        n = 300
        rows = (
            generator.uniform(0, 10, n).round(),
            generator.integers(0, 9, n),
            generator.uniform(0, 1000, (n, 2)),
        )
        _, kept = np.unique(np.stack(rows[:2]), axis=1, return_index=True)
        rows = [column[kept] for column in rows]
        order = generator.permutation(len(kept))
        truth = flights(
            *[
                (name, [(0, *generator.uniform(0, 1000, 2)), (10, *generator.uniform(0, 1000, 2))])
                for name in range(12)
            ]
        )
        other_order = generator.permutation(24)
        shuffled = {key: np.asarray(column)[other_order] for key, column in truth.items()}
        one = match_tracks(tracks(*rows), Truth(**truth), max_distance=150)
        other = match_tracks(
            tracks(*(column[order] for column in rows)), Truth(**shuffled), max_distance=150
        )
        np.testing.assert_array_equal(one.target[order], other.target)
        np.testing.assert_array_equal(one.switches, other.switches)
        assert 20 < one.matched.sum() < len(kept)

    def test_truth_against_numpy(self):
        """Interpolated truth, by the errors of updates that are near, in space."""
        generator = rng(8)
        truth, time, track, place, expected = [], [], [], [], []
        for name in range(20):
            t = np.sort(generator.uniform(0, 100, 15))
            path = np.column_stack([1000.0 * name + 0 * t, np.cumsum(t), np.sin(t)])
            truth += [(a, name, tuple(b)) for a, b in zip(t, path, strict=True)]
            when = generator.uniform(t[0], t[-1], 30)
            at = np.column_stack([np.interp(when, t, column) for column in path.T])
            error = generator.normal(0, 10, at.shape)
            time.append(when)
            track.append(np.full(30, name))
            place.append(at + error)
            expected.append(error)
        generator.shuffle(truth)
        instants, names, points = zip(*truth, strict=True)
        rows = (np.concatenate(column) for column in (time, track, place))
        found = match_tracks(
            tracks(*rows), Truth(instants, names, points), max_distance=100, update_interval=10
        )
        assert found.matched.all()
        np.testing.assert_allclose(found.error, np.concatenate(expected), atol=1e-9)

    def test_no_updates(self):
        found = match_tracks(tracks([], np.empty(0, int), np.empty((0, 2))), TWO, max_distance=50)
        assert found.target.shape == (0,)
        np.testing.assert_array_equal(found.switches, [0, 0])

    @pytest.mark.parametrize(
        ("change", "kind", "message"),
        [
            ({"time": [[1.0]]}, ValueError, r"tracks\.time has shape \(1, 1\)"),
            ({"time": [NAN]}, ValueError, r"tracks\.time\[0\] is nan"),
            ({"track": [1, 2]}, ValueError, r"tracks\.track has shape \(2,\)"),
            ({"track": [1.0]}, TypeError, r"tracks\.track has dtype float64"),
            ({"position": [1, 2]}, ValueError, r"tracks\.position has shape \(2,\)"),
            ({"position": [[1, 2, 3]]}, ValueError, r"and truth\.position \(4, 2\)"),
            ({"max_distance": 0}, ValueError, "max_distance is 0"),
            ({"update_interval": -1}, ValueError, "update_interval is -1"),
            ({"truth": None}, TypeError, "truth is None"),
        ],
    )
    def test_errors(self, change, kind, message):
        right = {"time": [1], "track": [1], "position": [[0, 0]], "truth": TWO, "max_distance": 50}
        changed = {**right, **change}
        shown = tracks(*(changed.pop(name) for name in ("time", "track", "position")))
        with pytest.raises(kind, match=message):
            match_tracks(shown, **changed)


class TestTruth:
    def test_sorts_and_names(self):
        rows = [(4, "b", (1, 1)), (0, "b", (0, 0)), (2, "a", (5, 5))]
        truth = Truth(*zip(*rows, strict=True))
        np.testing.assert_array_equal(truth.targets, ["a", "b"])
        np.testing.assert_array_equal(truth.target, [0, 1, 1])
        np.testing.assert_array_equal(truth.time, [2, 0, 4])
        np.testing.assert_array_equal(truth.first, [2, 0])
        np.testing.assert_array_equal(truth.last, [2, 4])
        assert [(name, len(time)) for name, time, _ in truth] == [("a", 1), ("b", 2)]
        assert len(truth) == 2

    def test_position_and_course_by_hand(self):
        path = [(0, (0, 0, 9)), (10, (0, 100, 9)), (20, (100, 100, 9))]
        truth = Truth([t for t, _ in path], [7] * 3, [x for _, x in path])
        np.testing.assert_allclose(truth.at(0, [5, 15, 21])[:2], [[0, 50, 9], [50, 100, 9]])
        assert np.isnan(truth.at(0, [-1e-9, 20 + 1e-9])).all()
        np.testing.assert_array_equal(truth.present(0, [0, 20, 21]), [True, True, False])
        np.testing.assert_allclose(truth.course([0, 0, 0], [0, 10, 20]), np.radians([0, 45, 90]))
        assert np.isnan(truth.course([-1], [0])).all()
        assert np.isnan(truth.at([-1], [0])).all()

    def test_its_own_errors_are_part_of_the_nees(self):
        path = [(0, (0, 0)), (10, (0, 100)), (20, (100, 100))]
        spread = np.array([[[400.0, 0.0], [0.0, 100.0]], np.diag([100.0, 400.0]), np.eye(2)])
        truth = Truth(
            [20, 0, 10], [7] * 3, [path[k][1] for k in (2, 0, 1)], covariance=spread[[2, 0, 1]]
        )
        np.testing.assert_allclose(truth.covariance, spread)
        found = truth.covariance_at(0, [0, 5, 10, 21])
        np.testing.assert_allclose(found[1], np.diag([250.0, 250.0]))
        assert np.isnan(found[3]).all()
        assert not Truth([0], [7], [[0, 0]]).covariance_at(0, [0]).any()
        rows = Rows(
            np.array([0.0, 5.0]), np.array([1, 1]), np.array([0, 0]),
            np.array([[20.0, 10.0], [0.0, 65.0]]),
            np.zeros((2, 2)), np.broadcast_to(np.diag([16.0, 16.0]), (2, 2, 2)),
            np.ones(2, bool),
        )  # fmt: skip
        expected = [400 / 416 + 100 / 116, 15.0**2 / 266]
        np.testing.assert_allclose(judge(rows, truth, (5.0, 5.0), 500.0).nees, expected)

    @pytest.mark.parametrize(
        ("change", "kind", "message"),
        [
            ({"covariance": np.eye(3)}, ValueError, r"covariance has shape \(3, 3\)"),
            ({"covariance": [[1, 2], [0, 1]]}, ValueError, "covariance is not symmetric"),
            ({"covariance": -np.eye(2)}, ValueError, "covariance is not positive"),
            ({"target": [1, 2]}, ValueError, r"target has shape \(2,\)"),
            ({"target": [5.0] * 4}, TypeError, "target has dtype float64"),
            ({"target": [5, 5, 5, 5]}, ValueError, r"target 5 has two positions at 0\.0"),
            ({"position": [[0, INF]] * 4}, ValueError, r"position\[0, 1\] is inf"),
            (
                {"time": [], "target": np.empty(0, int), "position": np.empty((0, 2))},
                ValueError,
                "time is empty",
            ),
        ],
    )
    def test_errors(self, change, kind, message):
        right = {"time": TWO.time, "target": TWO.target, "position": TWO.position}
        with pytest.raises(kind, match=message):
            Truth(**{**right, "time": [0, 10, 0, 10], **change})


ONE = Truth(**flights((3, [(0, 0, 0), (100, 10_000, 0)])))


def seen(*times, track=1, north=0.0):
    return [(t, track, 100 * t, north) for t in times]


def judged(*rows, truth=ONE, update_interval=4.0, max_distance=500.0):
    return indicators(
        updates(*rows), truth, update_interval=update_interval, max_distance=max_distance
    )


class TestIndicators:
    def test_everything_is_there(self):
        found = judged(*seen(*range(0, 101, 4)))
        assert found.probability_of_update.value == 1
        assert found.long_gap_ratio.value == 0
        np.testing.assert_array_equal(found.expected_updates, [26])
        np.testing.assert_array_equal(found.missed_updates, [0])
        np.testing.assert_array_equal(found.latency, [0])
        assert (found.false_tracks, found.false_updates, found.missed_targets) == (0, 0, 0)
        assert found.switches == 0
        assert found.rmse.value == pytest.approx(0, abs=1e-9)

    def test_single_misses_by_hand(self):
        """One and two updates are missed in two gaps of 8 s and 12 s: 23 of 26 are there."""
        times = [t for t in range(0, 101, 4) if t not in (20, 48, 52)]
        found = judged(*seen(*times))
        np.testing.assert_array_equal(found.missed_updates, [3])
        assert found.probability_of_update.value == pytest.approx(23 / 26)
        assert found.long_gap_ratio.value == 0

    def test_a_long_gap_by_hand(self):
        """Three are missed in 16 s, which is more than 3.3 periods; one in 8 s."""
        times = [t for t in range(0, 101, 4) if t not in (20, 48, 52, 56)]
        found = judged(*seen(*times))
        assert found.probability_of_update.value == pytest.approx(22 / 26)
        assert found.long_gap_ratio.value == pytest.approx(3 / 26)

    @pytest.mark.parametrize(("last", "missed"), [(96.0, 1), (96.3, 1), (96.5, 0)])
    def test_an_update_is_due_a_tenth_of_an_interval_before_the_end(self, last, missed):
        found = judged(*seen(*range(0, 96, 4), last))
        np.testing.assert_array_equal(found.missed_updates, [missed])

    def test_late_by_a_little_is_not_missed(self):
        times = np.arange(0, 101, 4) + np.resize([0, 0.9, -0.9], 26)
        found = judged(*seen(*np.clip(times, 0, 100)))
        assert found.probability_of_update.value == 1
        np.testing.assert_array_equal(found.expected_updates, [26])

    def test_the_end_counts_and_the_beginning_is_latency(self):
        found = judged(*seen(*range(20, 61, 4)))
        np.testing.assert_array_equal(found.latency, [20])
        np.testing.assert_array_equal(found.expected_updates, [21])
        np.testing.assert_array_equal(found.missed_updates, [10])
        assert found.long_gap_ratio.value == pytest.approx(10 / 21)

    def test_more_updates_than_needed_are_no_merit(self):
        every = judged(*seen(*range(0, 101, 1)))
        assert every.probability_of_update.value == 1
        times = [*np.arange(0, 21, 0.5), *range(40, 101, 4)]
        found = judged(*seen(*times))
        assert found.missed_updates[0] == 4
        assert found.expected_updates[0] < 26

    def test_a_target_that_nobody_sees(self):
        truth = flights(
            (3, [(0, 0, 0), (100, 10_000, 0)]), (1, [(0, 0, 9e4), (8, 0, 9e4), (20, 0, 9e4)])
        )
        found = judged(*seen(*range(0, 101, 4)), truth=Truth(**truth))
        np.testing.assert_array_equal(found.expected_updates, [6, 26])
        np.testing.assert_array_equal(found.missed_updates, [6, 0])
        assert found.probability_of_update.value == pytest.approx(26 / 32)
        assert found.long_gap_ratio.value == pytest.approx(6 / 32)
        assert found.missed_targets == 1
        np.testing.assert_array_equal(found.latency, [NAN, 0])
        assert "1 of 2 targets missed" in repr(found)

    def test_false_tracks_and_updates(self):
        """Track 2 is far off, track 3 most of the time, track 4 half of the time."""
        rows = seen(*range(0, 101, 4))
        rows += seen(0, 4, 8, track=2, north=5e3)
        truth = flights((3, [(0, 0, 0), (100, 10_000, 0)]), (4, [(0, 0, 2e4), (100, 0, 2e4)]))
        rows += [(0, 3, 0, 2e4), (4, 3, 0, 3e4), (8, 3, 0, 3e4)]
        rows += [(40, 4, 0, 2e4), (44, 4, 0, 3e4)]
        found = judged(*rows, truth=Truth(**truth))
        assert found.false_updates == 6
        assert found.false_tracks == 2
        assert found.switches == 1

    def test_switches_and_errors(self):
        rows = [*seen(*range(0, 49, 4), north=30.0), *seen(*range(52, 101, 4), track=8, north=-40)]
        found = judged(*rows)
        assert found.switches == 1
        count = 13
        assert found.rmse.value == pytest.approx(
            np.sqrt((count * 900 + count * 1600) / (2 * count))
        )
        _, across = track_errors(found.matching.error, np.pi / 2)
        np.testing.assert_allclose(np.sort(np.unique(across.round(6))), [-30, 40])

    def test_by_monte_carlo_it_is_the_probability_of_detection(self):
        """With independent misses it is that of detection; long gaps are counted exactly."""
        generator = rng(9)
        time = np.arange(0, 4000, 4.0)
        truth = flights(*[(k, [(0, 0, 5e3 * k), (3996, 4e5, 5e3 * k)]) for k in range(20)])
        rows, missed = [], 0
        for k in range(20):
            there = generator.uniform(size=len(time)) < 0.9
            t = time[there]
            rows += [(a, k, a * 4e5 / 3996, 5e3 * k) for a in t]
            gaps = np.diff(np.append(np.flatnonzero(there), len(time))) - 1
            missed += gaps[gaps >= 3].sum()
        found = judged(*rows, truth=Truth(**truth))
        total = found.expected_updates.sum()
        sigma = np.sqrt(0.9 * 0.1 / total)
        assert abs(found.probability_of_update.value - 0.9) < 3 * sigma
        assert found.long_gap_ratio.value == missed / total > 0

    def test_no_updates_at_all(self):
        none = tracks([], np.empty(0, int), np.empty((0, 2)))
        found = indicators(none, ONE, update_interval=4.0, max_distance=500.0)
        assert found.probability_of_update.value == 0
        assert found.long_gap_ratio.value == 1
        assert found.missed_targets == 1
        assert np.isnan(found.rmse.value)

    def test_errors(self):
        for key in ("update_interval", "max_distance"):
            with pytest.raises(ValueError, match=f"{key} is 0"):
                judged(*seen(0, 4), **{key: 0})
            with pytest.raises(TypeError, match=f"{key} is None"):
                judged(*seen(0, 4), **{key: None})
