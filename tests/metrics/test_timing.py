"""Ages of data, offsets between close targets, and the density of false updates."""

from types import SimpleNamespace

import numpy as np
import pytest

from tertia._units import NAUTICAL_MILE
from tertia.metrics import Truth, indicators
from tertia.metrics._by_flight import root_by_pair

OPTIONS = {"max_distance": 500.0, "update_interval": 4.0}


def flights(times, north):
    """Return tracks without errors and the truth of targets that fly east, `north` apart."""
    time = np.concatenate(times)
    target = np.repeat(np.arange(len(times)), [len(one) for one in times])
    ends = np.tile([0.0, 200.0], len(times))
    whose = np.repeat(np.arange(len(times)), 2)
    truth = Truth(ends, whose, np.column_stack([100.0 * ends, np.asarray(north)[whose]]))
    place = np.column_stack([100.0 * time, np.asarray(north)[target]])
    return SimpleNamespace(time=time, track=target, position=place), truth


class TestAge:
    def test_is_half_the_interval_if_regular(self):
        tracks, truth = flights([np.arange(0.0, 201.0, 4.0)] * 3, [0.0, 9e4, 18e4])
        age = indicators(tracks, truth, **OPTIONS, limits={"data_age": 2.5}).data_age
        assert (age.value, age.low, age.high) == pytest.approx((2.0, 2.0, 2.0))
        assert (age.count, age.verdict) == (150, "met")

    def test_by_hand(self):
        """Gaps of 4, 8 and 4 s; that of 40 s is a long one, and after the last is nothing."""
        tracks, truth = flights([[0.0, 4, 12, 52, 56]], [0.0])
        found = indicators(tracks, truth, **OPTIONS)
        assert found.data_age.value == pytest.approx((8 + 32 + 8) / 16)
        assert (found.data_age.low, found.data_age.high) == (0.0, np.inf)
        assert found.long_gap_ratio.value > 0

    def test_is_unknown_without_two_updates(self):
        tracks, truth = flights([[4.0], [8.0]], [0.0, 9e4])
        assert np.isnan(indicators(tracks, truth, **OPTIONS).data_age.value)


class TestOffset:
    @pytest.mark.parametrize("late", [0.0, 0.25, 1.0, 1.9])
    def test_of_two_pairs(self, late):
        """The third is near nobody; the others are one pair 5 km, and one 18.5 km apart."""
        base = np.arange(2.0, 198.0, 4.0)
        north = [0.0, 5e3, 9e4, 2e5, 2e5 + 18.5e3]
        times = [base, base + late, base + 1, base, base - late]
        tracks, truth = flights(times, north)
        limits = {"pair_time_offset": 0.3}
        found = indicators(tracks, truth, **OPTIONS, limits=limits).pair_time_offset
        assert found.value == pytest.approx(late)
        # from either side, and once for each update
        assert found.count == 4 * len(base)
        assert found.effective_number == 2
        assert (found.low, found.high) == pytest.approx((late, late))
        assert found.verdict == ("met" if late <= 0.3 else "not met")

    def test_nearest_of_several_updates(self):
        """A target that is updated every second has one update near each of the other."""
        slow, fast = np.arange(1.3, 190.0, 4.0), np.arange(0.0, 200.0)
        tracks, truth = flights([slow, fast], [0.0, 1e3])
        found = indicators(tracks, truth, **OPTIONS).pair_time_offset
        near = np.array([np.abs(slow - one).min() for one in fast])
        squares = np.concatenate([np.full(len(slow), 0.3**2), near[near <= 2.0] ** 2])
        assert found.value == pytest.approx(np.sqrt(squares.mean()))
        assert (found.low, found.high) == (0.0, np.inf)

    @pytest.mark.parametrize("north", [[0.0, 18.53e3], [0.0]])
    def test_nobody_is_close(self, north):
        tracks, truth = flights([np.arange(0.0, 200.0, 4.0)] * len(north), north)
        found = indicators(tracks, truth, **OPTIONS).pair_time_offset
        assert np.isnan(found.value)
        assert (found.count, found.verdict) == (0, "")

    @pytest.mark.parametrize("count", [12, 30])
    def test_interval_where_pairs_share_flights(self, count):
        """Each flight has an offset of its own, so that all its pairs are alike."""
        random = np.random.default_rng(4)
        first, second = np.triu_indices(count, 1)
        cover, independent = [], []
        for _ in range(400):
            phase = random.standard_normal(count)
            near = random.random(len(first)) < 0.2
            pairs = first[near].repeat(20), second[near].repeat(20)
            off = phase[pairs[0]] - phase[pairs[1]] + 0.1 * random.standard_normal(len(pairs[0]))
            found = root_by_pair(pairs, off**2, 0.95, None)
            cover.append(found.low <= np.sqrt(2.01) <= found.high)
            half = 1.96 * np.std(off**2) / np.sqrt(len(off)) / (2 * found.value)
            independent.append(abs(found.value - np.sqrt(2.01)) <= half)
        assert 0.90 < np.mean(cover) < 0.985
        assert np.mean(independent) < 0.5


@pytest.mark.parametrize(("far", "count"), [(18.5e3, 2), (18.6e3, 1), (40e3, 0)])
def test_false_tracks_near_targets(far, count):
    """A target flies east; of two tracks beside it the second comes 100 m nearer, for a moment."""
    time = np.arange(0.0, 3601.0, 4.0)
    place = np.column_stack([50.0 * time, 0.0 * time])
    second = place + np.array([0.0, far])
    second[50, 1] -= 100.0
    position = np.concatenate([place, place + np.array([0.0, far]), second])
    track = np.arange(3).repeat(len(time))
    tracks = SimpleNamespace(time=np.tile(time, 3), track=track, position=position)
    truth = Truth([0, 3600], [1, 1], [[0, 0], [180e3, 0]])
    found = indicators(tracks, truth, **OPTIONS, limits={"near_false_tracks_per_hour": 8.0})
    assert found.false_tracks == found.false_tracks_per_hour.value == 2
    assert found.near_false_tracks_per_hour.value == count
    assert found.near_false_tracks_per_hour.verdict == "met"


class TestDensity:
    def test_by_hand(self):
        """Three false tracks with 2, 3 and 5 updates in an hour; two squares, 40 NM apart."""
        time = np.concatenate([np.arange(0.0, 3601.0, 8.0), 80.0 * np.arange(1, 11)])
        track = np.concatenate([np.zeros(451, int), np.repeat([1, 2, 3], [2, 3, 5])])
        place = np.where(track == 0, 0.0, 40 * NAUTICAL_MILE)[:, np.newaxis] * [1.0, 0.0]
        truth = Truth([0, 3600], [1, 1], np.zeros((2, 2)))
        tracks = SimpleNamespace(time=time, track=track, position=place)
        limits = {"false_update_density": 10.0}
        options = {"max_distance": 500, "update_interval": 8, "limits": limits}
        found = indicators(tracks, truth, **options).false_update_density
        assert (found.value, found.count) == (pytest.approx(5.0), 10)
        assert found.effective_number == pytest.approx(10 / (38 / 10))
        assert found.low < 5.0
        assert found.high > 10.0
        assert found.verdict == "not shown"
        none = SimpleNamespace(time=time[:451], track=track[:451], position=place[:451])
        found = indicators(none, truth, **options).false_update_density
        assert (found.value, found.low, found.verdict) == (0.0, 0.0, "not shown")
        # one square, and 3.69 tracks of four updates at most
        assert found.high == pytest.approx(4 * 3.69, rel=0.01)

    def test_interval_holds_where_false_updates_are_tracks(self):
        random = np.random.default_rng(5)
        truth = Truth([0, 3600], [1, 1], np.zeros((2, 2)))
        cover, independent = [], []
        for _ in range(120):
            lengths = random.integers(2, 9, random.poisson(15))
            count = int(lengths.sum())
            tracks = SimpleNamespace(
                time=random.uniform(0, 3600, count),
                track=np.arange(len(lengths)).repeat(lengths),
                position=np.full((count, 2), 1e3),
            )
            found = indicators(
                tracks, truth, max_distance=500, update_interval=8
            ).false_update_density
            cover.append(found.low <= 75.0 <= found.high)
            independent.append(abs(count - 75.0) < 1.96 * np.sqrt(count))
        assert 0.90 < np.mean(cover) < 0.99
        assert np.mean(independent) < 0.75
