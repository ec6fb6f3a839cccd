"""Filter and smoother against plain matrices, and angles that wrap."""

import numpy as np
import pytest
from checks import NAN, close, rng
from kalman.scenes import (
    BOTH,
    EXACT,
    GAPS,
    GIVEN,
    MODEL,
    PRINTED,
    PRINTED_OR_EXACT,
    STEPS,
    R,
    assert_states,
    plots,
)
from reference import kalman as reference
from tolerances import SMOOTHED, STATE

from tertia.kalman import AngleFilter, SingerModel, filter_series, smooth_series


def check(z, r, model, *, initial=None, time=None, period=None):
    """Filter and smoother of a batch against the reference, series by series."""
    z = np.asarray(z)
    batch, steps = z.shape[:-1], z.shape[-1]
    options = {"initial": initial, "time": time, "period": period}
    result = filter_series(z, r, model, **options)
    smooth = smooth_series(z, r, model, **options)
    assert result.mean.shape == smooth.mean.shape == (*z.shape, 3)
    assert result.innovation.shape == result.innovation_variance.shape == z.shape
    assert np.shape(result.log_likelihood) == np.shape(result.count) == batch
    each = np.broadcast_to(np.atleast_1d(r), z.shape)
    when = np.broadcast_to(model.dt * np.arange(steps) if time is None else time, z.shape)
    for place in np.ndindex(batch):
        f, q = reference.transitions(model, np.diff(when[place]))
        start = model.acceleration_sigma**2
        if initial is not None:
            mean, covariance = initial
            start = (
                np.broadcast_to(mean, (*batch, 3))[place],
                np.broadcast_to(covariance, (*batch, 3, 3))[place],
            )
        filtered, smoothed = reference.series(z[place], each[place], f, q, start, period)
        found = result.mean[place], result.covariance[place]
        assert_states(found, filtered[:2], STATE, period)
        innovation, variance, gain = filtered[2:]
        sigma = np.sqrt(variance)
        np.testing.assert_allclose(result.innovation_variance[place], variance, rtol=STATE)
        off = (result.innovation[place] - innovation) / sigma
        assert np.nanmax(np.abs(off), initial=0) <= STATE * (period or 1e3) / R
        np.testing.assert_array_equal(np.isnan(result.innovation[place]), np.isnan(variance))
        np.testing.assert_allclose(result.gain[place], gain, rtol=1e-9, atol=1e-12)
        assert np.asarray(result.count)[place] == np.count_nonzero(~np.isnan(innovation))
        likelihood = reference.log_likelihood(innovation, variance)
        assert np.asarray(result.log_likelihood)[place] == pytest.approx(likelihood, rel=1e-9)
        if smoothed is not None:
            found = smooth.mean[place], smooth.covariance[place]
            assert_states(found, smoothed, SMOOTHED, period)
    return result, smooth


class TestParity:
    """Every public path against plain matrices."""

    @pytest.mark.parametrize("start", [None, GIVEN], ids=["unknown", "given"])
    @pytest.mark.parametrize("gaps", GAPS.values(), ids=GAPS)
    @MODEL
    def test_gaps(self, model, gaps, start):
        z = plots(STEPS)
        z[list(gaps)] = NAN
        check(z, R, model, initial=start)

    @pytest.mark.parametrize("shape", [(), (1,), (3,), (2, 3), (2, 1, 2)])
    @PRINTED_OR_EXACT
    def test_batches(self, model, shape):
        z = plots(*shape, 8, seed=1)
        z[..., 4] = NAN
        check(z, R, model)

    @pytest.mark.parametrize("start", [None, GIVEN], ids=["unknown", "given"])
    @pytest.mark.parametrize(
        "shape", [(), (1,), (8,), (3, 1), (2, 3, 1), (3, 8), (2, 1, 8), (2, 3, 8)]
    )
    def test_variances(self, shape, start):
        """One for all, one per series, one per step, one each."""
        r = rng(2).uniform(0.002, 0.03, shape)
        check(plots(2, 3, 8, seed=3), r, EXACT, initial=start)

    def test_variances_of_steps_without_a_plot_do_not_matter(self):
        z, r = plots(3, 9), np.full((3, 9), R)
        z[:, [0, 4, 8]] = NAN
        expected = filter_series(z, r, PRINTED)
        r[:, [0, 4, 8]] = [NAN, -1, 0]
        found = filter_series(z, r, PRINTED)
        np.testing.assert_array_equal(found.mean, expected.mean)
        np.testing.assert_array_equal(found.upper, expected.upper)
        smooth = smooth_series(z, r, PRINTED)
        np.testing.assert_array_equal(smooth.mean, smooth_series(z, R, PRINTED).mean)

    @pytest.mark.parametrize("start", [None, GIVEN], ids=["unknown", "given"])
    @pytest.mark.parametrize("shape", [(9,), (1, 9), (3, 9), (2, 1, 9), (2, 3, 9)])
    def test_irregular_times(self, shape, start):
        times = np.cumsum(rng(4).uniform(0.1, 9.0, shape), axis=-1)
        z = plots(2, 3, 9, seed=5)
        z[0, 1, [0, 3]] = NAN
        for model in BOTH.values():
            check(z, R, model, initial=start, time=times)

    @pytest.mark.parametrize("start", [None, GIVEN], ids=["unknown", "given"])
    @pytest.mark.parametrize(
        "times",
        [
            [0, 4, 4, 9, 9, 9, 12, 20, 21],
            [-3, 0, 1, 2, 3, 4, 5, 5, 5],
            np.repeat([0.0, 4.0, 8.0, 12.0, 16.0], 2)[1:],
        ],
        ids=["inside", "at the end", "always two"],
    )
    @PRINTED_OR_EXACT
    def test_repeated_times(self, model, times, start):
        r = rng(6).uniform(0.005, 0.02, 9)
        check(plots(9, seed=7), r, model, initial=start, time=times)

    def test_times_from_the_model_and_given_are_the_same(self):
        z, times = plots(3, 20), 100 + 5.0 * np.arange(20)
        for model in BOTH.values():
            found = filter_series(z, R, model, time=times)
            expected = filter_series(z, R, model)
            np.testing.assert_array_equal(found.mean, expected.mean)
            np.testing.assert_array_equal(found.upper, expected.upper)

    @pytest.mark.parametrize("mean", [(3,), (1, 3), (3, 3), (2, 1, 3), (2, 3, 3)], ids=str)
    @pytest.mark.parametrize("own", [False, True], ids=["shared", "each"])
    def test_initial_states(self, mean, own):
        random = rng(8)
        root = random.normal(size=(2, 3, 3, 3)) * [[0.3], [0.1], [0.01]]
        covariance = root @ np.swapaxes(root, -1, -2)
        x = random.normal(size=mean) * [10, 0.3, 0.01]
        check(
            plots(2, 3, 9, seed=9), R, EXACT, initial=(x, covariance if own else covariance[0, 0])
        )

    def test_a_known_state(self):
        """A singular covariance is one: here the whole state is known."""
        z = plots(9, seed=10)
        start = np.array([z[0], 0.1, 0.0]), np.zeros((3, 3))
        filtered, _ = reference.series(
            z, np.full(9, R), *reference.transitions(EXACT, [5.0] * 8), start
        )
        found = filter_series(z, R, EXACT, initial=start)
        assert_states(found, filtered[:2], STATE)
        smooth = smooth_series(z, R, EXACT, initial=start)
        assert smooth.mean[0] == close(start[0])
        np.testing.assert_allclose(smooth.covariance[0], 0, atol=1e-18)

    @pytest.mark.parametrize("start", [None, GIVEN], ids=["unknown", "given"])
    @pytest.mark.parametrize("period", [360.0, 2 * np.pi, 1.0])
    def test_angles_that_wrap(self, period, start):
        """Of targets that circle, at rates up to half a turn per step."""
        rate = period * np.array([[0.003, -0.05], [0.2, -0.4]])[..., np.newaxis]
        z = (0.4 * period + rate * np.arange(40)) % period
        z += period * 1e-4 * rng(11).normal(size=z.shape)
        z[..., [5, 20, 21]] = NAN
        z %= period
        model = SingerModel(5.0, 0.05, 1e-4 * period, exact=True)
        if start is not None:
            start = start[0] * period / 360, start[1] * (period / 360) ** 2
            z = z[0]
        check(z, (period * 1e-4) ** 2, model, initial=start, period=period)


class TestWrap:
    """Nothing changes but the turns where angles wrap."""

    @pytest.mark.parametrize("start", [None, GIVEN], ids=["unknown", "given"])
    @pytest.mark.parametrize("period", [360.0, 2 * np.pi])
    @pytest.mark.parametrize("first", [0.2, 0.9951, 0.9999, 0.9973, 0.0], ids=str)
    @pytest.mark.parametrize("direction", [1, -1], ids=["clockwise", "back"])
    def test_where_north_is_crossed(self, direction, first, period, start):
        """Between any two plots, the first two among them, and in a gap."""
        unit = period / 360
        z = period * first + direction * unit * 0.9 * np.arange(20)
        z += 0.05 * unit * rng(1).normal(size=20)
        z[[2, 7, 8]] = NAN
        model = SingerModel(5.0, 0.05, 0.003 * unit, exact=True)
        if start is not None:
            offset = np.array([z[0] - start[0][0] * unit + 0.1 * unit, 0, 0])
            start = start[0] * unit + offset, start[1] * unit**2
        straight = {"initial": start}
        turned = {"initial": start, "period": period}
        r = R * unit**2
        results = [filter_series(z, r, model, **straight), smooth_series(z, r, model, **straight)]
        wrapped = [
            filter_series(z % period, r, model, **turned),
            smooth_series(z % period, r, model, **turned),
        ]
        for plain, found in zip(results, wrapped, strict=True):
            expected = plain.mean, plain.covariance
            assert_states(found, expected, 1e-11, period)

    def test_a_state_turns_away(self):
        """The mean of an initial state may be on any turn."""
        z = plots(10) % 360
        start = GIVEN[0] + [z[0] - GIVEN[0][0], 0, 0]
        results = [
            f(
                z,
                R,
                EXACT,
                initial=(start + np.array([turns * 360.0, 0, 0]), GIVEN[1]),
                period=360.0,
            )
            for turns in (0, 1, -3, 1000)
            for f in (filter_series, smooth_series)
        ]
        for i, result in enumerate(results):
            expected = results[i % 2].mean, results[i % 2].covariance
            assert_states(result, expected, 1e-9, 360.0)

    def test_a_hundred_thousand_turns(self):
        """The angle has lost no more than its turns have digits."""
        z = (1003 * np.arange(300_000) % 3600) / 10
        found = filter_series(z, R, PRINTED, period=360.0, store="mean").mean[-1]
        error = (found[0] - z[-1] + 180) % 360 - 180
        assert abs(error) < 1e-8
        assert found[1] == close(20.06, 1e-9)

    def test_filter_plot_by_plot(self):
        z = (355 + 0.9 * np.arange(30) + 0.05 * rng(2).normal(size=30)) % 360
        track = AngleFilter(PRINTED, R, period=360.0)
        found = np.array([track.step(plot) for plot in z])
        expected = filter_series(z, R, PRINTED, period=360.0).mean[:, 0]
        np.testing.assert_allclose(found, expected, rtol=1e-13)
        assert found.min() < 5
        assert found.max() > 355
