"""Heights, identities, runs of large errors and false tracks versus truth, by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from checks import NAN

from tertia.metrics import Truth, indicators

TIME = np.arange(0.0, 80.0, 4.0)
OPTIONS = {"max_distance": 3000.0, "update_interval": 4.0}


def tracks_of(error, **more):
    """One target that flies east, and its track with errors to the north."""
    place = np.column_stack([200.0 * TIME, np.broadcast_to(error, TIME.shape)])
    values = {"time": TIME, "track": np.ones(len(TIME), int), "position": place}
    return SimpleNamespace(**(values | more))


def truth_of(**more):
    place = np.column_stack([200.0 * TIME, 0.0 * TIME])
    return Truth(TIME, np.ones(len(TIME), int), place, **more)


class TestRuns:
    @pytest.mark.parametrize(
        ("errors", "count"),
        [
            ({3: 1000}, 0),
            ({3: 1000, 4: 1000}, 0),
            ({3: 1000, 4: 1200, 5: 950}, 3),
            ({3: 1000, 4: -1000, 5: 1000}, 0),
            ({3: 1000, 4: 900, 5: 1000, 6: 1000}, 0),
            ({3: 1000, 4: 1000, 5: 1000, 6: 1000, 10: 2000, 19: -1000}, 4),
            ({17: -1000, 18: -1000, 19: -1000}, 3),
        ],
    )
    def test_by_hand(self, errors, count):
        error = np.zeros(len(TIME))
        error[list(errors)] = list(errors.values())
        found = indicators(tracks_of(error), truth_of(), **OPTIONS).large_error_ratio
        assert found.value == pytest.approx(count / len(TIME))
        assert found.count == len(TIME)

    def test_how_large_is_a_limit(self):
        tracks, truth = tracks_of(700.0), truth_of()
        assert indicators(tracks, truth, **OPTIONS).large_error_ratio.value == 0
        limits = {"large_error": 555.6, "large_error_ratio": 0.0003}
        found = indicators(tracks, truth, limits=limits, **OPTIONS).large_error_ratio
        assert found.value == 1
        assert found.verdict == "not met"
        with pytest.raises(ValueError, match=r"limits\['large_error'\] is 0"):
            indicators(tracks, truth, limits={"large_error": 0.0}, **OPTIONS)

    def test_runs_are_of_one_target(self):
        time = np.array([0.0, 0, 4, 4])
        place = np.array([[0.0, 1000], [50e3, 1000], [800, 1000], [50.8e3, 1000]])
        tracks = SimpleNamespace(time=time, track=np.array([1, 2, 1, 2]), position=place)
        truth = Truth(time, np.array([1, 2, 1, 2]), place - [0.0, 1000])
        assert indicators(tracks, truth, **OPTIONS).large_error_ratio.value == 0


class TestHeightsAndIdentities:
    def test_by_hand(self):
        height = np.full(len(TIME), 5000.0)
        height[5], height[6], height[7] = 5091.0, 5092.0, NAN
        identity = np.full(len(TIME), 7)
        identity[8:10], identity[10] = 8, -1
        found = indicators(
            tracks_of(0.0, height=height, identity=identity),
            truth_of(height=np.full(len(TIME), 5000.0), identity=np.full(len(TIME), 7)),
            **OPTIONS,
        )
        assert found.probability_of_update.value == 1
        assert found.wrong_height_ratio.value == pytest.approx(1 / 19)
        assert found.probability_of_height_update.value == pytest.approx(18 / 20)
        assert found.wrong_identity_ratio.value == pytest.approx(2 / 19)
        assert found.probability_of_identity_update.value == pytest.approx(17 / 20)
        for one in (found.wrong_height_ratio, found.probability_of_identity_update):
            assert one.low < one.value < one.high

    def test_truth_in_between(self):
        truth = Truth(
            [0, 10, 20], [1, 1, 1], np.zeros((3, 2)), height=[0, 100, NAN], identity=[7, 8, -1]
        )
        np.testing.assert_array_equal(
            truth.height_at(0, [0, 5, 10, 15, 21]), [0, 50, 100, NAN, NAN]
        )
        np.testing.assert_array_equal(truth.identity_at(0, [0, 9, 10, 20, 21]), [7, 7, 8, -1, -1])
        bare = truth_of()
        assert np.isnan(bare.height_at([0, -1], 8.0)).all()
        np.testing.assert_array_equal(bare.identity_at([0, -1], 8.0), [-1, -1])

    @pytest.mark.parametrize("lacking", ["tracks", "truth", "both"])
    def test_nothing_is_said_of_what_is_not_there(self, lacking):
        tracks = {"height": 5e3 + 0 * TIME, "identity": np.full(len(TIME), 7)}
        found = indicators(
            tracks_of(0.0, **({} if lacking in ("tracks", "both") else tracks)),
            truth_of(**({} if lacking in ("truth", "both") else tracks)),
            limits={"wrong_height_ratio": 0.001},
            **OPTIONS,
        )
        for name in ("wrong_height_ratio", "wrong_identity_ratio", "probability_of_height_update"):
            assert np.isnan(getattr(found, name).value)
            assert getattr(found, name).verdict == ""

    def test_targets_without_a_known_height_do_not_count(self):
        time, target = np.tile(TIME, 2), np.repeat([1, 2], len(TIME))
        place = np.column_stack([200.0 * time, 50e3 * target])
        height = np.where(target == 1, 5e3, NAN)
        tracks = SimpleNamespace(time=time, track=target, position=place, height=height)
        found = indicators(tracks, Truth(time, target, place, height=height), **OPTIONS)
        assert found.probability_of_height_update.value == 1
        assert found.probability_of_height_update.count == len(TIME)

    def test_identities_are_compared_by_their_kinds(self):
        n = len(TIME)
        kinds = {"icao_address": np.full(n, 0x4B1805), "callsign": ["SWR12"] * n}
        truth = truth_of(**kinds, mode_3a=np.where(TIME < 40, 0o1000, 0o2000))
        assert truth.identity_at([0, 0, -1], [10, 50, 10], "mode_3a").tolist() == [512, 1024, -1]
        assert truth.identity_at([0, 0], [10, 500], "callsign").tolist() == ["SWR12", ""]
        assert truth.identity_at([0], [10]).tolist() == [-1]

        def share(**own):
            found = indicators(tracks_of(0.0, **own), truth, **OPTIONS)
            return found.probability_of_identity_update.value

        assert share(**kinds) == 1
        # one of the kinds is wrong
        assert share(**(kinds | {"callsign": np.array(["SWR13"] * n)})) == 0
        assert share(icao_address=kinds["icao_address"], mode_3a=np.full(n, 0o1000)) == 0.5
        # of a kind that is not known of the targets nothing is said
        assert np.isnan(share(identity=np.full(n, 7)))
        assert share(identity=np.full(n, 7), **kinds) == 1

    def test_errors(self):
        with pytest.raises(ValueError, match="kind is 'mode-s'; it must be one of icao_address"):
            truth_of().identity_at([0], [0.0], "mode-s")
        with pytest.raises(ValueError, match=r"callsign has shape \(3,\); it must be \(20,\)"):
            truth_of(callsign=["A", "B", "C"])
        with pytest.raises(
            ValueError, match=r"icao_address\[0\] is 33554432; it must be an address"
        ):
            truth_of(icao_address=np.full(20, 1 << 25))
        with pytest.raises(ValueError, match=r"height has shape \(3,\); it must be \(20,\)"):
            truth_of(height=np.ones(3))
        with pytest.raises(ValueError, match=r"identity has shape \(3,\)"):
            truth_of(identity=np.ones(3, int))
        with pytest.raises(TypeError, match="identity has dtype float64; it must hold integers"):
            truth_of(identity=np.ones(20))


def test_continuity_is_of_targets_with_a_track():
    tracks = tracks_of(0.0, track=np.where(TIME < 40, 1, 2))
    found = indicators(tracks, truth_of(), **OPTIONS)
    assert (found.switches, found.continuity.value, found.continuity.count) == (1, 0, 1)
    whole = indicators(tracks_of(0.0), truth_of(), limits={"continuity": 0.99}, **OPTIONS)
    assert whole.continuity.value == 1
    assert whole.continuity.verdict == "not shown"


@pytest.mark.parametrize(
    ("count", "low", "high"),
    # exact intervals of a Poisson number (Garwood 1936)
    [(0, 0.0, 3.689), (1, 0.0253, 5.572), (5, 1.623, 11.668), (20, 12.217, 30.888)],
)
def test_false_tracks_per_hour(count, low, high):
    time = np.concatenate([[0.0, 3600.0], np.repeat(10.0 * np.arange(1, count + 1), 2)])
    track = np.concatenate([[0, 0], np.repeat(np.arange(1, count + 1), 2)])
    place = np.where(track == 0, 0.0, 90e3)[:, np.newaxis] * [1.0, 1.0]
    tracks = SimpleNamespace(time=time, track=track, position=place + 0.0 * track[:, np.newaxis])
    truth = Truth([0, 3600], [1, 1], np.zeros((2, 2)))
    found = indicators(tracks, truth, max_distance=500, update_interval=3600)
    rate = found.false_tracks_per_hour
    assert (found.false_tracks, rate.value) == (count, count)
    assert (rate.low, rate.high) == pytest.approx((low, high), rel=0.01, abs=0.03)
