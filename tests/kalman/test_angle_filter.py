"""The filter that is fed plot by plot."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from checks import INF, NAN, close, rng
from kalman.scenes import GAPS, GIVEN, PRINTED, PRINTED_OR_EXACT, STEPS, R, assert_states, plots

from tertia.kalman import AngleFilter, filter_series


def wide_track():
    track = AngleFilter(PRINTED, R, period=360.0)
    track.set_state([10.0, 0.0, 0.0], np.diag([1e9, 1e5, 1.0]))
    track.update(12.0)
    return track


def track_after(*z, predict=0):
    track = AngleFilter(PRINTED, R, period=360.0)
    for plot in z:
        track.step(plot)
    for _ in range(predict):
        track.predict()
    return track


STAGES = {
    "no plot": track_after,
    "no plot, later": lambda: track_after(NAN, predict=2),
    "one plot": lambda: track_after(359.0),
    "one plot, later": lambda: track_after(359.0, NAN, predict=1),
    "two plots": lambda: track_after(359.0, 1.0),
    "many plots": lambda: track_after(*np.linspace(350, 370, 30)),
    "predicted": lambda: track_after(*np.linspace(350, 370, 30), predict=1),
    "a huge prior": wide_track,
}


def seen(track):
    """All that a track tells, as bits."""
    arrays = [track.mean, track.covariance, [track.angle, track.innovation]]
    return b"".join(np.asarray(a).tobytes() for a in [*arrays, track.innovation_variance])


@pytest.fixture(params=STAGES, ids=str)
def stage(request):
    return STAGES[request.param]


class TestAngleFilter:
    def test_the_stages_are_all_there_are(self):
        """Nothing, one plot, a covariance, its factors."""
        assert {stage().__getstate__()[0][1] for stage in STAGES.values()} == {0, 1, 2, 3}

    @pytest.mark.parametrize("period", [None, 360.0])
    @pytest.mark.parametrize("gaps", GAPS.values(), ids=GAPS)
    @PRINTED_OR_EXACT
    def test_is_the_filter_of_a_series(self, model, gaps, period):
        z = plots(STEPS, seed=1)
        z[list(gaps)] = NAN
        r, dt = rng(2).uniform(0.005, 0.02, STEPS), rng(3).uniform(0, 9, STEPS - 1)
        expected = filter_series(z, r, model, time=np.cumsum([1.0, *dt]), period=period)
        track = AngleFilter(model, 1.0, period=period)
        for k, plot in enumerate(z):
            if k % 2:
                angle = track.step(plot, r[k], dt[k - 1])
            elif k:
                track.predict(dt[k - 1])
                angle = track.update(plot, r[k])
            else:
                angle = track.update(plot, measurement_variance=r[k])
            # tobytes, because nan is not equal to itself
            assert np.float64(angle).tobytes() == track.mean[:1].tobytes()
            assert np.float64(track.angle).tobytes() == track.mean[:1].tobytes()
            known = expected.mean[k], expected.covariance[k]
            assert_states(track, known, 1e-13, period)
            found = [track.innovation, track.innovation_variance]
            right = [expected.innovation[k], expected.innovation_variance[k]]
            np.testing.assert_allclose(found, right, rtol=1e-9)

    def test_defaults_are_those_of_the_model(self):
        by_default, spelled_out = AngleFilter(PRINTED, R), AngleFilter(PRINTED, R)
        for plot in plots(20):
            by_default.step(plot)
            spelled_out.step(plot, measurement_variance=R, dt=5.0)
            assert seen(by_default) == seen(spelled_out)
        by_default.predict()
        spelled_out.predict(dt=5.0)
        assert seen(by_default) == seen(spelled_out)

    def test_a_plot_that_is_missing_is_a_prediction(self):
        one, other = (track_after(1.0, 2.0, 3.1) for _ in range(2))
        angle = one.step(NAN)
        other.predict()
        assert seen(one) == seen(other)
        assert angle == other.angle
        assert np.isnan(one.innovation)

    def test_two_plots_at_a_time(self):
        track = track_after(1.0, 2.0, 3.1, predict=1)
        track.update(4.0)
        before = track.covariance
        assert track.update(4.1, 0.02) == track.angle
        assert track.innovation_variance == close(before[0, 0] + 0.02)
        assert track.covariance[0, 0] == close(before[0, 0] * 0.02 / (before[0, 0] + 0.02))

    def test_state_can_be_read_and_set(self, stage):
        track = stage()
        track.set_state(*GIVEN)
        assert track.mean == close(GIVEN[0] + [360, 0, 0])
        np.testing.assert_array_equal(track.covariance, GIVEN[1])
        assert np.isnan(track.innovation)
        other = AngleFilter(PRINTED, R, period=360.0)
        other.set_state(track.mean.tolist(), track.covariance.tolist())
        for plot in (341.0, 342.5, NAN, 345.0):
            track.step(plot)
            other.step(plot)
        assert_states(track, other, 1e-13, 360.0)

    def test_what_was_read_does_not_change(self):
        track = track_after(1.0, 2.0, 3.1)
        mean, covariance = track.mean, track.covariance
        kept = mean.copy(), covariance.copy()
        track.step(4.0)
        np.testing.assert_array_equal(mean, kept[0])
        np.testing.assert_array_equal(covariance, kept[1])
        mean[:] = 0
        assert track.mean[0] > 3

    @pytest.mark.parametrize(
        "duplicate",
        [
            *(
                lambda track, protocol=protocol: pickle.loads(pickle.dumps(track, protocol))
                for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1)
            ),
            copy.copy,
            copy.deepcopy,
        ],
    )
    def test_copies_go_on_alike(self, stage, duplicate):
        track = stage()
        other = duplicate(track)
        assert type(other) is AngleFilter
        assert seen(other) == seen(track)
        before = seen(track)
        other.step(2.0)
        assert seen(track) == before
        track.step(2.0)
        assert seen(other) == seen(track)
        for k, plot in enumerate([NAN, 359.9, 3.0, NAN, 5.0, *np.linspace(6, 40, 30)]):
            assert track.step(plot, dt=1.0 + k % 3) == other.step(plot, dt=1.0 + k % 3)
            assert seen(other) == seen(track)

    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (lambda t: t.step(INF), "z is inf"),
            (lambda t: t.step(-INF), "z is -inf"),
            (lambda t: t.step(1.0, -1.0), "measurement_variance is -1"),
            (lambda t: t.step(1.0, 0.0), "measurement_variance is 0"),
            (lambda t: t.step(1.0, NAN), "measurement_variance is nan"),
            (lambda t: t.step(1.0, dt=-1.0), "dt is -1"),
            (lambda t: t.step(1.0, dt=NAN), "dt is nan"),
            (lambda t: t.step(1.0, dt=20.0), "dt is 20; it must be less than 1/alpha"),
            (lambda t: t.update(INF), "z is inf"),
            (lambda t: t.update(1.0, -1.0), "measurement_variance is -1"),
            (lambda t: t.predict(-1.0), "dt is -1"),
            (lambda t: t.predict(25.0), "dt is 25; it must be less than 1/alpha"),
            (lambda t: t.set_state([1, NAN, 0], np.eye(3)), r"mean\[1\] is nan"),
            (lambda t: t.set_state([1, 0, 0], -np.eye(3)), r"covariance\[0, 0\] is -1"),
            (lambda t: t.set_state([1, 0, 0], np.full((3, 3), INF)), r"covariance\[0, 0\] is inf"),
            (lambda t: t.set_state([1, 0, 0], np.triu(np.ones((3, 3)))), "must be symmetric"),
            (lambda t: t.set_state([1, 0], np.eye(3)), r"\bmean\b"),
            (lambda t: t.set_state([1, 0, 0], np.eye(2)), r"\bcovariance\b"),
        ],
    )
    def test_a_step_that_fails_leaves_the_state(self, stage, call, message):
        track = stage()
        before = seen(track), track.__getstate__()
        with pytest.raises(ValueError, match=message):
            call(track)
        assert seen(track) == before[0]
        np.testing.assert_equal(track.__getstate__(), before[1])

    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (lambda t: t.step("1"), r"\bz\b"),
            (lambda t: t.update(None), r"\bz\b"),
            (lambda t: t.step(1.0, "1"), "measurement_variance"),
            (lambda t: t.step(1.0, dt="1"), "dt"),
            (lambda t: t.predict("1"), "dt"),
            (lambda t: t.set_state("abc", np.eye(3)), "mean"),
            (lambda t: t.set_state([1, 0, 0], 5), "covariance"),
            (lambda t: AngleFilter("x", R), "model is 'x'; it must be a SingerModel"),
            (lambda t: AngleFilter(PRINTED, "x"), "measurement_variance"),
            (lambda t: AngleFilter(PRINTED, R, period="x"), "period"),
        ],
    )
    def test_wrong_types(self, call, message):
        track = track_after(1.0, 2.0)
        before = seen(track)
        with pytest.raises(TypeError, match=message):
            call(track)
        assert seen(track) == before

    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (lambda: AngleFilter(PRINTED, -1.0), "measurement_variance is -1"),
            (lambda: AngleFilter(PRINTED, NAN), "measurement_variance is nan"),
            (lambda: AngleFilter(PRINTED, R, period=0.0), "period is 0"),
            (lambda: AngleFilter(PRINTED, R, period=-360.0), "period is -360"),
            (lambda: AngleFilter(PRINTED, R, period=NAN), "period is nan"),
        ],
    )
    def test_wrong_numbers(self, call, message):
        with pytest.raises(ValueError, match=message):
            call()

    def test_an_indefinite_covariance(self):
        """The same error as of a series."""
        with pytest.raises(np.linalg.LinAlgError, match="covariance is indefinite"):
            track_after().set_state([1, 0, 0], np.ones((3, 3)) - 0.1 * np.eye(3))

    @pytest.mark.parametrize("saved", [([], 1.0, 1.0), ([9.0], 1.0, 1.0), ([2.0, 1.0], 1.0, 1.0)])
    def test_a_damaged_pickle(self, saved):
        with pytest.raises(ValueError, match="not the state of an AngleFilter"):
            track_after().__setstate__(saved)

    def test_a_thousand_in_eight_threads(self):
        z = plots(1000, 60, seed=4) % 360
        z[::3, 20:25] = NAN

        def run(row):
            track = AngleFilter(PRINTED, R, period=360.0)
            for plot in z[row]:
                track.step(plot)
            return seen(track)

        alone = [run(row) for row in range(1000)]
        with ThreadPoolExecutor(8) as pool:
            together = list(pool.map(run, range(1000)))
            assert together == alone
            # and step by step, so that all are under way at once
            tracks = [AngleFilter(PRINTED, R, period=360.0) for _ in range(1000)]

            def some(first):
                for k in range(60):
                    for row in range(first, 1000, 8):
                        tracks[row].step(z[row, k])

            list(pool.map(some, range(8)))
        assert [seen(track) for track in tracks] == alone
