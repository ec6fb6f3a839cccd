"""The filter and the smoother against plain matrices, exact answers and theory."""

import copy
import itertools
import math
import pickle
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from reference import kalman as reference
from scipy import linalg, stats
from tolerances import CHANCE, EXACT_STATE, SMOOTHED, STATE, VECTOR

from tertia import metrics
from tertia.kalman import (
    AngleFilter,
    SingerModel,
    filter_series,
    fit_noise,
    smooth_series,
    steady_state,
)

NAN, INF = float("nan"), float("inf")
R = 0.01
PRINTED = SingerModel(5.0, 0.05, 0.003)
EXACT = SingerModel(5.0, 0.05, 0.003, exact=True)
BOTH = {"printed": PRINTED, "exact": EXACT}
MODELS = BOTH | {
    "constant acceleration": SingerModel(5.0, 0.0, 0.003, exact=True),
    "constant acceleration, printed": SingerModel(5.0, 0.0, 0.003),
    "constant rate": SingerModel(5.0, 0.05, 0.0),
    "constant rate, exact": SingerModel(5.0, 0.05, 0.0, exact=True),
    "restless": SingerModel(5.0, 0.15, 0.05),
    "short memory": SingerModel(5.0, 1.0, 0.01, exact=True),
}
GIVEN = (
    np.array([-20.0, 0.4, 0.001]),
    np.array([[0.5, 0.02, 0.001], [0.02, 0.04, -0.0002], [0.001, -0.0002, 0.0001]]),
)
MODEL = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
PRINTED_OR_EXACT = pytest.mark.parametrize("model", BOTH.values(), ids=BOTH)


def close(expected, relative=VECTOR):
    return pytest.approx(expected, rel=relative, abs=0)


def rng(seed=0):
    return np.random.default_rng(seed)


def plots(*shape, seed=0):
    """Plots of something that moves."""
    random = rng(seed)
    start, rate, turn = random.normal(size=(3, *shape[:-1], 1))
    step = np.arange(shape[-1])
    noise = 0.1 * random.normal(size=shape)
    return 100 * start + 2 * rate * step + turn * np.sin(step / 5) + noise


def simulated(model, count, dt, r=R, *, start=None, seed=0):
    """States of targets that move as the model says, from anywhere or from a prior, and plots."""
    random = rng(seed)
    mean, covariance = (np.zeros(3), np.diag([50.0, 1, model.acceleration_sigma]) ** 2)
    x = random.multivariate_normal(*(start or (mean, covariance)), count, method="eigh")
    states = [x]
    for f, q in zip(*map(reference.as_floats, reference.transitions(model, dt)), strict=True):
        scale = np.sqrt(np.where(np.diagonal(q) > 0, np.diagonal(q), 1))
        values, axes = np.linalg.eigh(q / np.outer(scale, scale))
        root = scale[:, np.newaxis] * axes * np.sqrt(np.maximum(values, 0))
        x = x @ f.T + random.normal(size=x.shape) @ root.T
        states.append(x)
    truth = np.stack(states, axis=1)
    return truth, truth[..., 0] + np.sqrt(r) * random.normal(size=truth.shape[:2])


def parts(states):
    return (states.mean, states.covariance) if hasattr(states, "covariance") else states


def assert_covariance(found, expected, tolerance):
    mean = np.zeros(found.shape[:-1])
    assert_states((mean, found), (mean, expected), tolerance)


def assert_states(found, expected, tolerance, period=None):
    """Means and covariances, in units of the standard deviations; inf where it must be."""
    (mean, covariance), (right_mean, right_covariance) = parts(found), parts(expected)
    assert mean.shape == right_mean.shape
    assert covariance.shape == right_covariance.shape
    np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
    variance, right = (
        np.diagonal(p, axis1=-2, axis2=-1).astype(float) for p in (covariance, right_covariance)
    )
    known = np.isfinite(right)
    assert np.all(variance[~known] == np.inf)
    sigma = np.sqrt(np.where(known, right, 0))
    difference = np.where(known, mean, 0) - np.where(known, right_mean, 0)
    size = np.where(known, np.abs(right_mean), 0) + sigma + 1e-300
    if period is not None:
        turns = np.round((difference[..., 0] / period).astype(float))
        difference[..., 0] -= period * turns
        size[..., 0] += period
        angle = mean[..., 0][known[..., 0]]
        assert np.all((angle >= 0) & (angle < period))
    assert np.max(np.abs(difference) / size, initial=0) <= tolerance
    both = known[..., np.newaxis] & known[..., np.newaxis, :]
    difference = np.where(both, covariance, 0) - np.where(both, right_covariance, 0)
    size = sigma[..., np.newaxis] * sigma[..., np.newaxis, :] + 1e-300
    assert np.max(np.abs(difference) / size, initial=0) <= tolerance


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


class TestVectors:
    """V1 and V2 of exact rational arithmetic: T = 4, alpha = 1/20, D = 4e-6."""

    MODEL = SingerModel(4.0, 0.05, np.sqrt(4e-6 / 0.36).item())
    MEAN = (10.0, 0.5, 0.01)
    COVARIANCE = ((0.01, 0.002, 0.0001), (0.002, 0.0025, 0.0002), (0.0001, 0.0002, 0.0001))
    UPDATED = (12.0979338842975, 0.544214876033058, 0.00828099173553719)
    UPDATED_UPPER = (
        0.00896694214876033,
        0.00210743801652893,
        0.000140495867768595,
        0.00140082644628099,
        0.000193388429752066,
        4.88925619834711e-05,
    )
    Z1 = (NAN, 10.41, 10.77, 11.25, 11.60, 12.05)
    Z2 = (NAN, 10.30, 10.95, 11.10, NAN, 12.30)
    X1 = (12.0446279972368, 0.105582735705442, 0.000216216126618942)
    X2 = (12.2592271936905, 0.13674248490462, 0.00168603541404649)

    def test_one_step_of_a_series(self):
        z, start = [NAN, 12.1], (self.MEAN, self.COVARIANCE)
        result = filter_series(z, R, self.MODEL, initial=start)
        assert result.mean[1] == close(self.UPDATED)
        assert result.upper[1] == close(self.UPDATED_UPPER)
        assert result.innovation[1] == close(0.02, 1e-12 * 12 / 0.02)
        assert result.innovation_variance[1] == close(0.0968)
        assert result.gain[1] == close([0.896694214876033, 0.210743801652893, 0.0140495867768595])
        np.testing.assert_array_equal(result.mean[0], self.MEAN)
        np.testing.assert_array_equal(result.covariance[0], self.COVARIANCE)

    def test_one_step_of_a_filter(self):
        track = AngleFilter(self.MODEL, R)
        track.set_state(self.MEAN, self.COVARIANCE)
        track.predict()
        assert track.mean == close([12.08, 0.54, 0.008])
        upper = [0.0868, 0.0204, 0.00136, 0.0057, 0.00048, 6.8e-5]
        assert track.covariance[np.triu_indices(3)] == close(upper)
        assert track.update(12.1) == close(self.UPDATED[0])
        assert track.mean == close(self.UPDATED)
        assert track.covariance[np.triu_indices(3)] == close(self.UPDATED_UPPER)

    def test_one_step_of_the_reference(self):
        f, q = (reference.as_floats(m)[0] for m in reference.transitions(self.MODEL, [4.0]))
        x, p = reference.predict(np.array(self.MEAN), np.array(self.COVARIANCE), f, q)
        x, p, *_ = reference.update(x, p, 12.1, R)
        assert x == close(self.UPDATED)
        assert p[np.triu_indices(3)] == close(self.UPDATED_UPPER)

    @pytest.mark.parametrize(
        ("z", "first", "r", "expected"), [(Z1, 10.0, 0.01, X1), (Z2, 10.1, 0.04, X2)]
    )
    def test_a_radar(self, z, first, r, expected):
        start = [first, 0.0, 0.0], np.diag([r, 0.04, 0.0001])
        assert filter_series(z, r, self.MODEL, initial=start).mean[-1] == close(expected)
        assert smooth_series(z, r, self.MODEL, initial=start).mean[-1] == close(expected)
        last = filter_series(z, r, self.MODEL, initial=start, store="final")
        assert last.mean == close(expected)
        track = AngleFilter(self.MODEL, r)
        track.set_state(*start)
        for plot in z[1:]:
            track.step(plot)
        assert track.mean == close(expected)

    def test_both_radars_in_one_filter(self):
        """Two plots at a time: a step that takes none."""
        z = np.column_stack([self.Z1, self.Z2]).ravel()[2:]
        r = 1 / (1 / 0.01 + 1 / 0.04)
        start = [(10.0 * 4 + 10.1) / 5, 0.0, 0.0], np.diag([r, 0.04, 0.0001])
        result = filter_series(
            [NAN, *z],
            [1.0, *np.tile([0.01, 0.04], 5)],
            self.MODEL,
            initial=start,
            time=[0.0, *np.repeat(4.0 * np.arange(1, 6), 2)],
        )
        expected = [12.0848675793787, 0.11301839263859, 0.000656027754028872]
        assert result.mean[-1] == close(expected)
        assert result.covariance[-1, 0, 0] == close(0.00644947056534109)


class TestMisprints:
    """Of (18): some show in the steady state, one in the transient alone."""

    PRIOR = np.diag([R, 0.04, 0.0001])
    STEPS = 400

    def gains(self, misprint=None):
        f, q = (reference.as_floats(m)[0] for m in reference.transitions(PRINTED, [PRINTED.dt]))
        return reference.misprinted_gains(f, q, R, self.PRIOR, self.STEPS, misprint)

    def found(self):
        z = np.r_[NAN, plots(self.STEPS)]
        result = filter_series(z, R, PRINTED, initial=(np.zeros(3), self.PRIOR))
        return result.gain[1:], result.covariance[-1]

    def test_the_right_gains_from_the_first_to_the_last(self):
        gains, covariance = self.gains()
        found, last = self.found()
        np.testing.assert_allclose(found, gains, rtol=1e-11)
        np.testing.assert_allclose(last, covariance, rtol=1e-11)
        assert found[-1] == pytest.approx([0.754, 0.102, 0.0048], abs=5e-4)
        assert steady_state(PRINTED, R)[0] == close(gains[-1], 1e-11)

    def test_a_transposed_matrix_shows_in_the_transient_alone(self):
        gains, covariance = self.gains("1 - alpha T in the first corner")
        found, _ = self.found()
        np.testing.assert_allclose(found[-1], gains[-1], rtol=1e-11)
        assert np.max(np.abs(gains / found - 1)) > 0.1
        assert np.max(np.abs(covariance - covariance.T)) > 1e-5

    def test_a_wrong_index_shows_in_the_steady_gain(self):
        gains, _ = self.gains("index 022 for 012")
        assert gains[-1] == pytest.approx([0.741, 0.116, 0.0053], abs=5e-4)
        assert np.max(np.abs(gains[-1] / self.found()[0][-1] - 1)) > 0.1


class TestModel:
    STEPS = (0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.01, 0.1, 0.5, 0.9, 0.999, 1.0, 1.001, 1.5)
    STEPS += (2.0, 3.0, 5.0, 10.0, 50.0)

    @pytest.mark.parametrize("t", [1e-6, 0.7, 5.0, 1e9])
    @pytest.mark.parametrize("x", STEPS)
    def test_exact_against_van_loan(self, x, t):
        """Every element to the last digits, at any alpha T."""
        model = SingerModel(t, x / t, 0.003, exact=True)
        f, q = reference.singer(t, model.alpha, model.acceleration_sigma)
        np.testing.assert_allclose(model.transition(), f.astype(float), rtol=3e-14)
        np.testing.assert_allclose(model.process_noise(), q.astype(float), rtol=3e-14)

    @pytest.mark.parametrize("x", STEPS[:10])
    def test_as_printed(self, x):
        model = SingerModel(5.0, x / 5.0, 0.003)
        f, q = reference.printed(5.0, model.alpha, model.acceleration_sigma)
        np.testing.assert_allclose(model.transition(), f.astype(float), rtol=1e-15, atol=2e-16)
        np.testing.assert_allclose(model.process_noise(), q.astype(float), rtol=1e-15)

    def test_as_in_the_specification(self):
        model = SingerModel(4.0, 0.05, 2.0)
        np.testing.assert_array_equal(model.transition(), [[1, 4, 8], [0, 1, 4], [0, 0, 0.8]])
        np.testing.assert_allclose(model.process_noise(), np.diag([0, 0, 4 * 0.36]), rtol=1e-15)
        assert model.transition(2.0)[2, 2] == close(0.9)
        assert model.transition(0.0) == close(np.eye(3))
        assert not model.process_noise(0.0).any()

    @pytest.mark.parametrize("x", STEPS[1:])
    def test_noise_is_positive_definite(self, x):
        q = SingerModel(5.0, x / 5.0, 0.003, exact=True).process_noise()
        sigma = np.sqrt(np.diagonal(q))
        # white jerk at one end, white acceleration at the other
        assert np.linalg.eigvalsh(q / np.outer(sigma, sigma)).min() > 1e-3

    @pytest.mark.parametrize("exact", [False, True])
    def test_limits(self, exact):
        kinematic = [[1, 5, 12.5], [0, 1, 5], [0, 0, 1]]
        model = SingerModel(5.0, 0.0, 0.003, exact=exact)
        np.testing.assert_array_equal(model.transition(), kinematic)
        assert not model.process_noise().any()
        still = SingerModel(5.0, 0.05, 0.0, exact=exact)
        moving = SingerModel(5.0, 0.05, 0.003, exact=exact)
        assert not still.process_noise().any()
        np.testing.assert_array_equal(still.transition(), moving.transition())

    @pytest.mark.parametrize("alpha", [0.0, 1e-9, 0.01, 0.19, 0.21, 1.0, 5.0])
    def test_exact_steps_compose(self, alpha):
        model = SingerModel(5.0, alpha, 0.003, exact=True)
        for first, second in [(5.0, 5.0), (0.1, 9.9), (1e-6, 3.0), (2.0, 0.0)]:
            (f1, q1), (f2, q2), (f, q) = (
                (model.transition(t), model.process_noise(t))
                for t in (first, second, first + second)
            )
            np.testing.assert_allclose(f2 @ f1, f, rtol=1e-13)
            np.testing.assert_allclose(f2 @ q1 @ f2.T + q2, q, rtol=1e-13)

    def test_the_printed_model_keeps_the_variance_of_the_acceleration(self):
        for model in BOTH.values():
            f, q = model.transition(), model.process_noise()
            assert f[2, 2] ** 2 * 9e-6 + q[2, 2] == close(9e-6)

    def test_is_a_value(self):
        assert SingerModel(5, 0.05, 0.003) == PRINTED
        assert hash(SingerModel(5, 0.05, 0.003)) == hash(PRINTED)
        assert pickle.loads(pickle.dumps(EXACT)) == EXACT
        assert repr(EXACT) == (
            "SingerModel(dt=5.0, alpha=0.05, acceleration_sigma=0.003, exact=True)"
        )
        with pytest.raises(AttributeError):
            PRINTED.dt = 4.0


GAPS = {
    "none": [],
    "one": [6],
    "the first": [0],
    "leading": [0, 1, 2],
    "the second": [1],
    "trailing": [11, 12, 13],
    "long": range(3, 11),
    "every other": range(1, 14, 2),
    "all but the first": range(1, 14),
    "all but one": [k for k in range(14) if k != 5],
    "all but the last": range(13),
    "all but two": [k for k in range(14) if k not in {4, 9}],
    "all": range(14),
}
STEPS = 14


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


class TestStore:
    @pytest.mark.parametrize("shape", [(), (1,), (9,), (2, 20)])
    @pytest.mark.parametrize("start", [None, GIVEN], ids=["unknown", "given"])
    def test_what_is_kept_is_the_same(self, shape, start):
        z = plots(*shape, 60, seed=1)
        z[..., 30:33] = NAN
        everything, means, last = (
            filter_series(z, R, PRINTED, initial=start, period=360.0, store=store)
            for store in ("all", "mean", "final")
        )
        np.testing.assert_array_equal(means.mean, everything.mean)
        np.testing.assert_array_equal(last.mean, everything.mean[..., -1, :])
        np.testing.assert_array_equal(last.covariance, everything.covariance[..., -1, :, :])
        np.testing.assert_array_equal(last.sigma, everything.sigma[..., -1, :])
        for other in (means, last):
            np.testing.assert_array_equal(other.log_likelihood, everything.log_likelihood)
            np.testing.assert_array_equal(other.count, everything.count)
            assert other.innovation.size == other.innovation_variance.size == 0
        assert means.covariance.size == 0
        assert last.mean.shape == (*shape, 3)
        assert last.covariance.shape == (*shape, 3, 3)
        if shape == ():
            assert isinstance(last.log_likelihood, float)
            assert isinstance(last.count, int)

    @pytest.mark.parametrize("store", ["mean", "final"])
    def test_a_gain_that_is_not_kept(self, store):
        """Empty like the innovations, or an error that says what to do."""
        result = filter_series(plots(20), R, PRINTED, store=store)
        try:
            assert result.gain.size == 0
        except (ValueError, AttributeError) as error:
            assert "store" in str(error)  # noqa: PT017 - either is right

    def test_variances_are_kept_as_given(self):
        z = plots(2, 3, 8)
        for shape in [(), (8,), (3, 1), (2, 3, 8)]:
            r = rng(1).uniform(0.01, 0.02, shape)
            kept = filter_series(z, r, PRINTED).measurement_variance
            np.testing.assert_array_equal(kept, np.broadcast_to(np.atleast_1d(r), z.shape))
            assert not kept.flags.writeable

    def test_a_single_row_is_one_series_or_refused(self):
        """Whatever is allowed for the plots of one series gives one result."""
        z = plots(5)
        expected = filter_series(z, R, PRINTED)
        try:
            found = filter_series(z, np.full((1, 5), R), PRINTED)
        except ValueError as error:
            assert "measurement_variance" in str(error)  # noqa: PT017 - either is right
        else:
            np.testing.assert_array_equal(found.mean, expected.mean)

    def test_results_are_printed_usefully(self):
        z = plots(10)
        result = filter_series(z, R, PRINTED)
        told = f"8 innovations, log-likelihood {result.log_likelihood:.6g})"
        assert repr(result) == f"FilteredSeries(mean of shape (10, 3), {told}"
        assert repr(filter_series([z, z], R, PRINTED)) == "FilteredSeries(mean of shape (2, 10, 3))"
        assert repr(smooth_series(z, R, PRINTED)) == "SmoothedSeries(mean of shape (10, 3))"


class TestArrays:
    """What arrays may look like."""

    Z = plots(6, 12, seed=3)

    def same(self, z, expected_z=None, **options):
        for function in (filter_series, smooth_series):
            found = function(z, R, EXACT, **options)
            expected = function(self.Z if expected_z is None else expected_z, R, EXACT, **options)
            np.testing.assert_array_equal(found.mean, expected.mean)
            np.testing.assert_array_equal(found.upper, expected.upper)

    def test_lists(self):
        self.same(self.Z.tolist(), time=(5.0 * np.arange(12)).tolist())
        start = GIVEN[0].tolist(), GIVEN[1].tolist()
        found = filter_series(self.Z, [[R]] * 6, EXACT, initial=start)
        expected = filter_series(self.Z, R, EXACT, initial=GIVEN)
        np.testing.assert_array_equal(found.mean, expected.mean)

    def test_column_major(self):
        self.same(np.asfortranarray(self.Z))
        r = np.asfortranarray(rng(1).uniform(0.01, 0.02, self.Z.shape))
        found = filter_series(self.Z, r, EXACT, time=np.asfortranarray(np.cumsum(r, axis=-1)))
        r = np.ascontiguousarray(r)
        expected = filter_series(self.Z, r, EXACT, time=np.cumsum(r, axis=-1))
        np.testing.assert_array_equal(found.mean, expected.mean)

    def test_strided_reversed_and_read_only(self):
        wide = np.repeat(self.Z, 2, axis=-1)
        self.same(wide[:, ::2])
        self.same(self.Z[::-1, ::-1], self.Z[::-1, ::-1].copy())
        fixed = self.Z.copy()
        fixed.flags.writeable = False
        self.same(fixed)
        self.same(np.broadcast_to(self.Z[0], (6, 12)), np.tile(self.Z[0], (6, 1)))

    @pytest.mark.parametrize("dtype", [np.float32, np.int16, np.longdouble, object])
    def test_other_numbers_are_taken_as_float64(self, dtype):
        z = np.round(self.Z).astype(dtype)
        self.same(z, z.astype(np.float64))

    def test_missing_plots_in_other_words(self):
        gap = self.Z.copy()
        gap[2, 5] = NAN
        objects = self.Z.astype(object)
        objects[2, 5] = None
        self.same(objects, gap)
        self.same(np.ma.array(self.Z, mask=np.isnan(gap)), gap)

    @pytest.mark.parametrize("shape", [(0,), (2, 0), (0, 3)])
    def test_no_series(self, shape):
        z = np.empty((*shape, 10))
        result = filter_series(z, R, PRINTED)
        assert result.mean.shape == (*shape, 10, 3)
        assert result.covariance.shape == (*shape, 10, 3, 3)
        assert result.log_likelihood.shape == result.count.shape == shape
        assert smooth_series(z, R, PRINTED).covariance.shape == (*shape, 10, 3, 3)
        assert filter_series(z, R, PRINTED, store="final").mean.shape == (*shape, 3)

    def test_arguments_are_left_alone(self):
        z, r, times = self.Z.copy(), np.full(12, R), 5.0 * np.arange(12)
        start = tuple(part.copy() for part in GIVEN)
        arguments = [z, r, times, *start]
        before = [part.copy() for part in arguments]
        result = filter_series(z, r, PRINTED, time=times, initial=start, period=360.0)
        smooth = smooth_series(z, r, PRINTED, time=times, initial=start, period=360.0)
        for part, copied in zip(arguments, before, strict=True):
            np.testing.assert_array_equal(part, copied)
            for out in (result.mean, result.upper, result.innovation, smooth.mean, smooth.upper):
                assert not np.shares_memory(part, out)

    @pytest.mark.parametrize("store", ["all", "mean", "final"])
    @pytest.mark.parametrize("rows", [1, 7, 64, 301])
    def test_threads_do_not_change_a_bit(self, rows, store):
        z = plots(rows, 90, seed=4)
        z[:, 40:43] = NAN
        z[::5, ::7] = NAN
        times = np.cumsum(rng(5).uniform(1, 9, 90))
        for options in ({}, {"time": times}, {"initial": GIVEN, "period": 360.0}):
            alone = filter_series(z, R, PRINTED, n_threads=1, store=store, **options)
            back = smooth_series(z, R, PRINTED, n_threads=1, **options)
            for n_threads in (2, 5, None):
                many = filter_series(z, R, PRINTED, n_threads=n_threads, store=store, **options)
                for name in ("mean", "upper", "innovation", "innovation_variance"):
                    np.testing.assert_array_equal(getattr(many, name), getattr(alone, name))
                np.testing.assert_array_equal(many.log_likelihood, alone.log_likelihood)
                np.testing.assert_array_equal(many.count, alone.count)
                if store == "all":
                    smooth = smooth_series(z, R, PRINTED, n_threads=n_threads, **options)
                    np.testing.assert_array_equal(smooth.mean, back.mean)
                    np.testing.assert_array_equal(smooth.upper, back.upper)

    @pytest.mark.parametrize("rows", [2, 3, 8, 33, 130])
    @pytest.mark.parametrize("start", [None, GIVEN], ids=["unknown", "given"])
    def test_a_series_does_not_depend_on_its_neighbours(self, rows, start):
        """Some with gaps, some late, some empty, some with noise of their own."""
        z = plots(rows, 70, seed=6)
        z[::3, 20:24] = NAN
        z[1::7, :5] = NAN
        z[5::11] = NAN
        z[4::9, 60:] = NAN
        own = R * rng(7).uniform(0.5, 2, (rows, 1))
        for r in (np.full((rows, 1), R), own, np.broadcast_to(R, z.shape)):
            options = {"initial": start, "period": 360.0}
            together = filter_series(z, r, PRINTED, **options)
            smooth = smooth_series(z, r, PRINTED, **options)
            for row in range(rows):
                alone = filter_series(z[row], r[row], PRINTED, **options)
                expected = alone.mean, alone.covariance
                found = together.mean[row], together.covariance[row]
                assert_states(found, expected, EXACT_STATE, 360.0)
                assert together.count[row] == alone.count
                likelihood = pytest.approx(alone.log_likelihood, rel=1e-12)
                assert together.log_likelihood[row] == likelihood
                back = smooth_series(z[row], r[row], PRINTED, **options)
                expected = back.mean, back.covariance
                assert_states((smooth.mean[row], smooth.covariance[row]), expected, 1e-12, 360.0)

    WIDE = (np.zeros(3), np.diag([1e9, 1e9, 1e-5]))

    @pytest.mark.parametrize("rows", [3, 4, 15, 16, 17, 40])
    @pytest.mark.parametrize("start", [None, GIVEN, WIDE], ids=["unknown", "given", "wide"])
    @pytest.mark.parametrize("period", [None, 360.0])
    def test_complete_series_share_their_gains(self, rows, start, period):
        """And all that comes of it, whatever one of them misses."""
        z = plots(rows, 60, seed=6)
        times = np.cumsum(rng(8).uniform(1, 9, 60))
        noises = R, R * rng(7).uniform(0.5, 2, 60)
        for r, steps in itertools.product(noises, (None, times)):
            options = {"initial": start, "period": period, "time": steps}
            together = filter_series(z, r, EXACT, **options)
            missing = np.concatenate([z, z[:1]])
            missing[-1, 30] = NAN
            others = filter_series(missing, r, EXACT, **options)
            for row in range(rows):
                alone = filter_series(z[row], r, EXACT, **options)
                for result in (together, others):
                    found = result.mean[row], result.covariance[row]
                    assert_states(found, (alone.mean, alone.covariance), EXACT_STATE, period)
                    for name in ("innovation", "innovation_variance"):
                        np.testing.assert_allclose(
                            getattr(result, name)[row], getattr(alone, name), rtol=1e-12, atol=1e-10
                        )
                    assert result.count[row] == alone.count
                    likelihood = pytest.approx(alone.log_likelihood, rel=1e-11)
                    assert result.log_likelihood[row] == likelihood
            means = filter_series(z, r, EXACT, store="mean", **options)
            np.testing.assert_array_equal(means.mean, together.mean)
            last = filter_series(z, r, EXACT, store="final", **options)
            np.testing.assert_array_equal(last.mean, together.mean[:, -1])
            np.testing.assert_array_equal(last.upper, together.upper[:, -1])
            np.testing.assert_array_equal(last.log_likelihood, together.log_likelihood)

    @pytest.mark.parametrize("store", ["all", "mean"])
    @pytest.mark.parametrize("shape", [(40,), (3, 40), (2, 20, 40)])
    def test_arrays_of_an_earlier_result(self, shape, store):
        z, other = plots(*shape, seed=1), plots(*shape, seed=2)
        z[..., 7] = NAN
        expected = filter_series(z, R, PRINTED, store=store)
        out = filter_series(other, 3 * R, EXACT, store=store)
        found = filter_series(z, R, PRINTED, store=store, out=out)
        for name in ("mean", "upper", "innovation", "innovation_variance"):
            assert getattr(found, name) is getattr(out, name)
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        np.testing.assert_array_equal(found.log_likelihood, expected.log_likelihood)
        np.testing.assert_array_equal(found.covariance, expected.covariance)

    def test_arrays_that_do_not_fit(self):
        z = plots(3, 40)
        out = filter_series(z, R, PRINTED)
        with pytest.raises(
            ValueError, match=r"out has an array of shape \(3, 40, 3\).*shape \(2, 40\)"
        ):
            filter_series(z[:2], R, PRINTED, out=out)
        with pytest.raises(ValueError, match=r'out has an array of shape .*store="mean"'):
            filter_series(z, R, PRINTED, store="mean", out=out)
        with pytest.raises(ValueError, match='out is of no use with store="final"'):
            filter_series(z, R, PRINTED, store="final", out=out)
        with pytest.raises(TypeError, match="out is of type ndarray; it must be a FilteredSeries"):
            filter_series(z, R, PRINTED, out=np.empty((3, 40, 3)))
        out.mean.flags.writeable = False
        with pytest.raises(ValueError, match="out has an array"):
            filter_series(z, R, PRINTED, out=out)

    def test_threads_report_the_first_bad_row(self):
        z = plots(300, 40)
        z[[120, 250], 3] = INF
        for function in (filter_series, smooth_series):
            for n_threads in (1, 4):
                with pytest.raises(ValueError, match=r"z\[120, 3\] is inf"):
                    function(z, R, PRINTED, n_threads=n_threads)


PATTERNS = {
    "all plots": [],
    "gaps": [2, 3, 6],
    "late": [0, 1],
    "late, then a gap": [0, 2, 3, 4],
    "two plots": [0, 2, 3, 5, 6],
}


STARTS = ["printed", "exact", "constant acceleration, printed", "constant rate, exact"]


class TestStart:
    """Without an initial state: the exact answer for unknown angle and rate."""

    @staticmethod
    def exact(z, r, model, dt):
        with mpmath.workdps(60):
            f, q = reference.transitions(model, dt)
            a = mpmath.mpf(model.acceleration_sigma) ** 2
            return reference.LeastSquares(reference.exactly(z), reference.exactly(r), f, q, a)

    @pytest.mark.parametrize("gaps", PATTERNS.values(), ids=PATTERNS)
    @pytest.mark.parametrize("name", STARTS)
    def test_least_squares(self, name, gaps):
        """Filter at two steps, smoother at every step, and the likelihood."""
        model = MODELS[name]
        random = rng(1)
        r, dt = random.uniform(0.005, 0.02, 7), random.uniform(1.0, 6.0, 6)
        z = plots(7, seed=2)
        z[gaps] = NAN
        times = np.cumsum([3.0, *dt])
        result = filter_series(z, r, model, time=times)
        smooth = smooth_series(z, r, model, time=times)
        first, second = np.flatnonzero(~np.isnan(z))[:2]
        with mpmath.workdps(60):
            whole = self.exact(z, r, model, dt)
            means, covariances = whole.estimates()
            found = smooth.mean[first:], smooth.covariance[first:]
            assert_states(found, (means[first:], covariances[first:]), EXACT_STATE)
            for last in (second, 6):
                part = self.exact(z[: last + 1], r, model, dt[:last])
                x, p = (estimate[-1] for estimate in part.estimates())
                assert_states((result.mean[last], result.covariance[last]), (x, p), EXACT_STATE)
            two = self.exact(z[: second + 1], r, model, dt[:second])
            expected = whole.log_likelihood() - two.log_likelihood()
        assert result.count == np.count_nonzero(~np.isnan(z)) - 2
        assert result.log_likelihood == pytest.approx(float(expected), rel=1e-11, abs=1e-11)

    @pytest.mark.parametrize("times", [[0, 0, 0, 4, 4, 9], [0, 2, 2, 2, 4, 9]], ids=str)
    @PRINTED_OR_EXACT
    def test_plots_at_the_same_time(self, model, times):
        r = np.array([0.01, 0.02, 0.005, 0.01, 0.03, 0.01])
        z = plots(6, seed=3)
        smooth = smooth_series(z, r, model, time=times)
        last = filter_series(z, r, model, time=times, store="final")
        with mpmath.workdps(60):
            means, covariances = self.exact(z, r, model, np.diff(times)).estimates()
        assert_states(smooth, (means, covariances), EXACT_STATE)
        expected = means[-1], covariances[-1]
        assert_states(last, expected, EXACT_STATE)

    def test_a_second_plot_at_the_same_time_is_predicted_by_the_first(self):
        """Its innovation is known, with the variance of both."""
        result = filter_series([10.0, 10.3, 11.0], [0.01, 0.02, 0.01], EXACT, time=[0, 0, 5])
        assert result.mean[1, 0] == close(10.1)
        assert result.covariance[1, 0, 0] == close(0.01 * 0.02 / 0.03)
        assert result.innovation[1] == close(0.3, 1e-11)
        assert result.innovation_variance[1] == close(0.03)
        assert result.count == 1

    def test_nothing_before_the_first_plot(self):
        result = filter_series([NAN, NAN, 7.0, NAN, 8.0], R, PRINTED)
        smooth = smooth_series([NAN, NAN, 7.0, NAN, 8.0], R, PRINTED)
        for found in (result, smooth):
            assert np.isnan(found.mean[:2]).all()
            assert np.all(found.sigma[:2] == INF)
            assert np.isfinite(found.mean[2:]).all()
        assert result.mean[2, 0] == 7.0
        assert result.sigma[2] == pytest.approx([0.1, INF, 0.003])
        assert result.sigma[3] == pytest.approx([INF, INF, 0.003])
        assert np.isfinite(result.sigma[4]).all()
        assert np.isfinite(smooth.sigma[2:]).all()
        assert np.isnan(result.innovation).all()
        assert np.isnan(result.gain).all()
        assert result.count == 0
        assert result.log_likelihood == 0

    def test_no_plots_and_one_plot(self):
        nothing = filter_series(np.full(5, NAN), R, PRINTED, store="final")
        assert np.isnan(nothing.mean).all()
        assert np.all(nothing.sigma == INF)
        assert (nothing.count, nothing.log_likelihood) == (0, 0)
        one = filter_series([-3.0], R, PRINTED, period=360.0)
        assert one.mean[0, 0] == 357
        assert one.sigma[0] == pytest.approx([0.1, INF, 0.003])
        smooth = smooth_series([-3.0], R, PRINTED, period=360.0)
        np.testing.assert_array_equal(smooth.mean, one.mean)
        np.testing.assert_array_equal(smooth.upper, one.upper)

    def test_no_plots_with_a_state(self):
        """It goes on as the model says."""
        result = filter_series(np.full(4, NAN), R, EXACT, initial=GIVEN)
        smooth = smooth_series(np.full(4, NAN), R, EXACT, initial=GIVEN)
        f, q = EXACT.transition(15.0), EXACT.process_noise(15.0)
        expected = f @ GIVEN[0], f @ GIVEN[1] @ f.T + q
        assert_states((result.mean[-1], result.covariance[-1]), expected, 1e-12)
        assert_states(smooth, result, SMOOTHED)

    @pytest.mark.parametrize("exact", [False, True])
    def test_constant_rate_is_a_straight_line(self, exact):
        """Weighted regression."""
        model = SingerModel(1.0, 0.05, 0.0, exact=exact)
        random = rng(4)
        times = np.cumsum(random.uniform(0.5, 5, 30))
        r = random.uniform(0.01, 0.05, 30)
        z = 3 + 0.2 * times + np.sqrt(r) * random.normal(size=30)
        design = np.column_stack([np.ones(30), times - times[-1]]) / np.sqrt(r)[:, np.newaxis]
        line = np.linalg.lstsq(design, z / np.sqrt(r), rcond=None)[0]
        covariance = np.linalg.inv(design.T @ design)
        last = filter_series(z, r, model, time=times, store="final")
        smooth = smooth_series(z, r, model, time=times)
        assert last.mean == pytest.approx([*line, 0], rel=1e-12)
        np.testing.assert_allclose(last.covariance[:2, :2], covariance, rtol=1e-11)
        np.testing.assert_allclose(smooth.mean[:, 1], line[1], rtol=1e-11)
        expected = line[0] + line[1] * (times - times[-1])
        np.testing.assert_allclose(smooth.mean[:, 0], expected, rtol=1e-12)
        np.testing.assert_allclose(smooth.sigma[:, 1], np.sqrt(covariance[1, 1]), rtol=1e-11)
        assert not smooth.sigma[:, 2].any()

    @pytest.mark.parametrize("angle", [1e-6, 1.0, 1e6])
    @pytest.mark.parametrize("time", [1e-9, 1e-3, 1.0, 1e3, 1e6, 1e9])
    @pytest.mark.parametrize("function", [filter_series, smooth_series])
    def test_units_do_not_matter(self, function, time, angle):
        """Nanoseconds for seconds, microradians for radians."""
        z = plots(15, seed=5)
        z[[1, 2, 8]] = NAN
        model = SingerModel(5.0 * time, 0.05 / time, 0.003 * angle / time**2, exact=True)
        unit = angle / np.array([1, time, time**2])
        found = function(z * angle, R * angle**2, model)
        expected = function(z, R, EXACT)
        # so that it stays symmetric to the last bit
        scale = (np.outer(unit, unit) + np.outer(unit, unit).T) / 2
        assert_states((found.mean / unit, found.covariance / scale), expected, EXACT_STATE)


UNIT = np.array([0.1, 0.1 / 5, 0.1 / 25])
MIXED = np.array([[2.0, 0, 0], [0.7, 1.0, 0], [-0.4, 0.6, 0.8]])
PRIORS = {
    "all": np.eye(3),
    "angle": np.diag([1.0, 0, 0]),
    "rate": np.diag([0, 1.0, 0]),
    "acceleration": np.diag([0, 0, 1.0]),
    "correlated": MIXED @ MIXED.T,
    "angle and rate": np.diag([1.0, 1.0, 0]),
}
WIDTHS = (1e-16, 1e-8, 1e-4, 1.0, 1e6, 1e8, 1e12, 1e16)


class TestPriors:
    """Initial covariances that are very much wider or narrower than the noise, against 100
    digits."""

    @staticmethod
    def prior(shape, width):
        p = width * PRIORS[shape]
        p[np.diag_indices(3)] += np.where(np.diagonal(p) == 0, 1.0, 0)
        p = p * np.outer(UNIT, UNIT)
        return np.array([-20.0, 0.4, 0.001]), (p + p.T) / 2

    @staticmethod
    @lru_cache
    def exact(model, shape, width):
        """Plots, the prior, and both answers."""
        z, prior = plots(11, seed=1), TestPriors.prior(shape, width)
        z[5] = NAN
        with mpmath.workdps(100):
            f, q = reference.transitions(model, [model.dt] * (len(z) - 1))
            r = [mpmath.mpf(R)] * len(z)
            start = [reference.exactly(part) for part in prior]
            filtered = reference.filter_series(reference.exactly(z), r, f, q, *start)[:2]
            return z, prior, filtered, reference.smooth_series(*filtered, f, q)

    @pytest.mark.parametrize("width", WIDTHS)
    @pytest.mark.parametrize("shape", PRIORS)
    @PRINTED_OR_EXACT
    def test_filter(self, model, shape, width):
        z, prior, filtered, _ = self.exact(model, shape, width)
        found = filter_series(z, R, model, initial=prior)
        with mpmath.workdps(100):
            assert_states(found, filtered, 1e-10)
        track = AngleFilter(model, R)
        track.set_state(*prior)
        track.update(z[0])
        for plot in z[1:]:
            track.step(plot)
        with mpmath.workdps(100):
            last = filtered[0][-1], filtered[1][-1]
            assert_states(track, last, 1e-10)

    @pytest.mark.parametrize("width", WIDTHS)
    @pytest.mark.parametrize("shape", PRIORS)
    @PRINTED_OR_EXACT
    def test_smoother(self, model, shape, width):
        """Wide priors cost digits, narrow ones with the printed model, as is documented."""
        z, prior, _, smoothed = self.exact(model, shape, width)
        found = smooth_series(z, R, model, initial=prior)
        assert np.isfinite(found.mean).all()
        assert np.all(found.sigma > 0)
        allowed = max(1e-12, 1e-15 * width, 0.0 if model.exact else 1e-15 / math.sqrt(width))
        if allowed < 1e-2:
            with mpmath.workdps(100):
                assert_states(found, smoothed, allowed)

    @pytest.mark.parametrize("r", [1e-16, 1e-12, 1e-8, 1e-4, 1e-2, 1.0, 1e4, 1e8, 1e12, 1e16])
    @PRINTED_OR_EXACT
    def test_noise_of_any_size(self, model, r):
        """Against the same motion: from plots that tell all to plots that tell nothing."""
        z = plots(20, seed=2)
        with mpmath.workdps(150):
            f, q = reference.transitions(model, [5.0] * 19)
            p = np.diag([reference.WIDE, reference.WIDE, mpmath.mpf(0.003) ** 2])
            variances = [mpmath.mpf(r)] * 20
            x = reference.exactly(np.zeros(3))
            filtered = reference.filter_series(reference.exactly(z), variances, f, q, x, p)[:2]
            smoothed = reference.smooth_series(*filtered, f, q)
            found = filter_series(z, r, model)
            expected = filtered[0][1:], filtered[1][1:]
            # up to 1e6 times the noise a covariance is kept as it is: that loses six digits
            assert_states((found.mean[1:], found.covariance[1:]), expected, 1e-9)
            assert_states(smooth_series(z, r, model), smoothed, 1e-9)


class TestConvergence:
    """A gain that no longer changes is not computed again."""

    @pytest.mark.parametrize("period", [None, 360.0])
    @pytest.mark.parametrize("start", [None, GIVEN], ids=["unknown", "given"])
    @MODEL
    def test_step_by_step(self, model, start, period):
        z = 30 + np.cumsum(rng(1).normal(size=3000))
        z[[1500, 1501, 2222]] = NAN
        track = AngleFilter(model, R, period=period)
        if start is not None:
            track.set_state(*start)
        means, covariances, innovations = [], [], []
        for k, plot in enumerate(z):
            if k:
                track.predict()
            track.update(plot)
            means.append(track.mean)
            covariances.append(track.covariance)
            innovations.append((track.innovation, track.innovation_variance))
        result = filter_series(z, R, model, initial=start, period=period)
        expected = np.array(means), np.array(covariances)
        assert_states(result, expected, 1e-13, period)
        found = np.column_stack([result.innovation, result.innovation_variance])
        np.testing.assert_allclose(found, innovations, rtol=1e-9, atol=1e-9)
        likelihood = reference.log_likelihood(*np.array(innovations).T)
        assert result.log_likelihood == pytest.approx(likelihood, rel=1e-10)

    @pytest.mark.parametrize("gaps", [False, True], ids=["every plot", "gaps"])
    @PRINTED_OR_EXACT
    def test_ten_million_steps(self, model, gaps):
        z = rng(2).normal(size=10_000_000)
        if gaps:
            z[:-1000:997] = NAN
        last = filter_series(z, R, model, store="final")
        assert last.count == np.count_nonzero(~np.isnan(z)) - 2
        assert_covariance(last.covariance, steady_state(model, R)[1], 1e-12)
        np.linalg.cholesky(last.covariance)
        # from the last thousand alone: older plots are forgotten
        recent = filter_series(z[-1000:], R, model, store="final")
        assert_states(last, recent, 1e-12)

    def test_millions_of_steps_that_never_settle(self):
        """Variances that alternate over ten decades: the covariance is computed at every step."""
        r = np.tile([1e-7, 1e3, 1e-2, 1.0, 1e-5], 600_000)
        last = filter_series(np.zeros(r.size), r, EXACT, store="final")
        short = filter_series(np.zeros(2000), r[:2000], EXACT, store="final")
        assert_states(last, short, 1e-11)
        np.linalg.cholesky(last.covariance)

    @pytest.mark.parametrize("decades", [0, 3, 10, 16])
    def test_every_covariance_is_positive(self, decades):
        """Irregular times, gaps, variances from 10^-decades to 10^decades."""
        random = rng(3)
        steps = 20_000
        r = R * 10 ** random.uniform(-decades, decades, steps)
        z = np.cumsum(random.normal(size=steps))
        z[random.random(steps) < 0.1] = NAN
        times = np.cumsum(random.choice([0.0, 0.01, 5.0, 40.0], steps))
        found = filter_series(z, r, EXACT, time=times)
        smooth = smooth_series(z, r, EXACT, time=times)
        known = np.isfinite(found.covariance).all(axis=(-2, -1))
        assert np.count_nonzero(~known) < 20
        for result in (found, smooth):
            p = result.covariance[known]
            sigma = result.sigma[known]
            assert np.all(sigma > 0)
            correlation = p / (sigma[:, :, np.newaxis] * sigma[:, np.newaxis, :])
            assert np.linalg.eigvalsh(correlation).min() > -1e-9
        # rounding, where a plot is 1e32 times as precise as another
        room = 1e-9 if decades <= 10 else 1e-4
        assert np.all(smooth.sigma[known] <= found.sigma[known] * (1 + room))

    def test_a_filter_that_runs_for_long(self):
        track = AngleFilter(PRINTED, R, period=360.0)
        z = (0.7 * np.arange(200_000)) % 360
        for k, plot in enumerate(z.tolist()):
            track.step(plot)
            if k > 2 and k % 1000 == 0:
                np.linalg.cholesky(track.covariance)
                np.testing.assert_array_equal(track.covariance, track.covariance.T)
        np.testing.assert_allclose(track.covariance, steady_state(PRINTED, R)[1], rtol=1e-11)


class TestSteadyState:
    NOISES = (1e-12, 1e-8, 1e-2, 1e3, 1e8)

    @pytest.mark.parametrize("r", NOISES)
    @pytest.mark.parametrize("name", ["printed", "exact", "restless", "short memory"])
    def test_against_the_riccati_equation(self, name, r):
        """By doubling, with 60 digits."""
        model = MODELS[name]
        with mpmath.workdps(60):
            (f,), (q,) = reference.transitions(model, [model.dt])
            noise = mpmath.mpf(r)
            prior = reference.riccati(f, q, noise)
            s = prior[0, 0] + noise
            gain, covariance = prior[0] / s, prior - np.outer(prior[0], prior[0]) / s
        found_gain, found = steady_state(model, r)
        np.testing.assert_allclose(found_gain, gain.astype(float), rtol=1e-13)
        assert_covariance(found, covariance.astype(float), 1e-13)

    def test_plots_that_are_too_precise_are_refused(self):
        """Noise in the acceleration alone: the digits of 1e-16 are not there."""
        with pytest.raises(ValueError, match="measurement_variance is 1e-16; it must be nearer"):
            steady_state(PRINTED, 1e-16)
        gain, _ = steady_state(EXACT, 1e-60)
        assert gain[0] == pytest.approx(1, rel=1e-15)

    @pytest.mark.parametrize("r", [1e-4, 1e-2, 1.0])
    @PRINTED_OR_EXACT
    def test_against_scipy(self, model, r):
        h = np.array([[1.0], [0.0], [0.0]])
        f, q = model.transition(), model.process_noise()
        prior = linalg.solve_discrete_are(f.T, h, q, np.array([[r]]))
        gain, covariance = steady_state(model, r)
        np.testing.assert_allclose(gain, prior[0] / (prior[0, 0] + r), rtol=1e-8)
        kept = prior - np.outer(prior[0], prior[0]) / (prior[0, 0] + r)
        np.testing.assert_allclose(covariance, kept, rtol=1e-8)

    @pytest.mark.parametrize("name", ["printed", "exact", "restless", "short memory"])
    def test_is_where_the_filter_goes(self, name):
        model = MODELS[name]
        result = filter_series(plots(3000), R, model)
        gain, covariance = steady_state(model, R)
        np.testing.assert_allclose(result.gain[-1], gain, rtol=1e-12)
        assert_covariance(result.covariance[-1], covariance, 1e-12)
        assert np.linalg.eigvalsh(covariance).min() > 0


class TestSmoother:
    """What the plots that come after are worth."""

    @staticmethod
    def steady(model):
        """Filtered and smoothed covariance far from both ends."""
        f, q = model.transition(), model.process_noise()
        filtered = steady_state(model, R)[1]
        prior = f @ filtered @ f.T + q
        gain = np.linalg.solve(prior, f @ filtered).T
        rest = filtered - gain @ prior @ gain.T
        return filtered, linalg.solve_discrete_lyapunov(gain, rest)

    @PRINTED_OR_EXACT
    def test_steady_covariance(self, model):
        filtered, expected = self.steady(model)
        found = smooth_series(plots(1001), R, model)
        assert_covariance(found.covariance[500], expected, SMOOTHED)
        # the factor that the specification asks for
        ratio = np.sqrt(np.diagonal(expected) / np.diagonal(filtered))
        np.testing.assert_allclose(
            found.sigma[500] / filter_series(plots(1001), R, model).sigma[500], ratio, rtol=1e-9
        )
        assert np.all(ratio < [0.75, 0.65, 0.8])

    @PRINTED_OR_EXACT
    def test_errors_shrink_as_theory_says(self, model):
        """RMSE of 300 targets over 100 steps in the middle."""
        truth, z = simulated(model, 300, [5.0] * 199, seed=1)
        middle = slice(50, 150)
        covariances = self.steady(model)
        for function, expected in zip((filter_series, smooth_series), covariances, strict=True):
            error = (function(z, R, model).mean - truth)[:, middle]
            each = np.mean(error**2, axis=1) / np.diagonal(expected)
            spread = each.std(axis=0, ddof=1) / np.sqrt(len(each))
            assert np.all(np.abs(each.mean(axis=0) - 1) < stats.norm.isf(CHANCE / 6) * spread)
            assert np.all(spread < 0.05)

    def test_the_last_step_is_that_of_the_filter(self):
        for start in (None, GIVEN):
            z = plots(4, 30)
            smooth = smooth_series(z, R, EXACT, initial=start)
            last = filter_series(z, R, EXACT, initial=start, store="final")
            # the one keeps covariances as factors, the other as they are
            np.testing.assert_allclose(smooth.mean[:, -1], last.mean, rtol=1e-11)
            np.testing.assert_allclose(smooth.upper[:, -1], last.upper, rtol=1e-11)

    def test_backwards_is_the_same(self):
        """A target that moves backwards in time is one: the exact model is reversible."""
        random = rng(2)
        z, r = plots(20, seed=3), random.uniform(0.01, 0.02, 20)
        z[[4, 5, 11]] = NAN
        times = np.cumsum(random.uniform(1, 9, 20))
        forwards = smooth_series(z, r, EXACT, time=times)
        back = smooth_series(z[::-1], r[::-1], EXACT, time=-times[::-1])
        flip = np.array([1, -1, 1])
        mean, covariance = back.mean[::-1] * flip, back.covariance[::-1] * np.outer(flip, flip)
        assert_states(forwards, (mean, covariance), 1e-11)


class TestConsistency:
    """Monte Carlo: errors are as large as they are said to be."""

    COUNT, STEPS = 2000, 60

    @pytest.fixture(params=BOTH, ids=str)
    def run(self, request):
        model = BOTH[request.param]
        truth, z = simulated(model, self.COUNT, [5.0] * (self.STEPS - 1), seed=3)
        z[:, [3, 20, 21, 22]] = NAN
        return model, truth, z

    def bounds(self, tests, dimension=3, count=COUNT):
        """That all of so many tests hold."""
        return metrics.consistency_bounds(count, dimension, 1 - CHANCE / tests)

    def test_filter(self, run):
        model, truth, z = run
        result = filter_series(z, R, model)
        steps = [1, 2, 4, 10, 22, 40, 59]
        error = (result.mean - truth)[:, steps]
        low, high = self.bounds(len(steps))
        squares = np.mean(metrics.nees(error, result.covariance[:, steps]), axis=0)
        assert np.all((squares > low) & (squares < high))
        # and it would show if they were not
        assert not low < np.mean(metrics.nees(error, 0.9 * result.covariance[:, steps])) < high
        # each component by itself
        low, high = self.bounds(3 * len(steps), 1)
        parts = np.mean((error / result.sigma[:, steps]) ** 2, axis=0)
        assert np.all((parts > low) & (parts < high))

    def test_smoother(self, run):
        model, truth, z = run
        result = smooth_series(z, R, model)
        steps = [0, 1, 3, 10, 21, 40, 59]
        error = (result.mean - truth)[:, steps]
        low, high = self.bounds(len(steps))
        squares = np.mean(metrics.nees(error, result.covariance[:, steps]), axis=0)
        assert np.all((squares > low) & (squares < high))
        low, high = self.bounds(3 * len(steps), 1)
        parts = np.mean((error / result.sigma[:, steps]) ** 2, axis=0)
        assert np.all((parts > low) & (parts < high))

    def test_innovations(self, run):
        """Independent, of the variance that is claimed."""
        model, _, z = run
        result = filter_series(z, R, model)
        squares = metrics.nis(result.innovation, result.innovation_variance)
        count = np.count_nonzero(~np.isnan(squares))
        assert count == np.sum(result.count) == self.COUNT * (self.STEPS - 4 - 2)
        low, high = self.bounds(1, 1, count)
        assert low < np.nanmean(squares) < high
        white = result.innovation / np.sqrt(result.innovation_variance)
        found = metrics.autocorrelation(white.ravel(), nlags=8)[1:]
        bound = stats.norm.isf(CHANCE / 2 / 8) / np.sqrt(count * 0.8)
        assert np.all(np.abs(found) < bound)
        # a target that is less restless than assumed
        other = filter_series(z, R, SingerModel(5.0, 0.05, 0.03, exact=model.exact))
        white = other.innovation / np.sqrt(other.innovation_variance)
        assert abs(metrics.autocorrelation(white.ravel(), nlags=1)[1]) > 10 * bound

    @PRINTED_OR_EXACT
    def test_a_given_state_with_its_covariance(self, model):
        """Drawn from the prior, with irregular times and noise that changes."""
        random = rng(5)
        steps = 15
        dt, r = random.uniform(1, 9, steps - 1), random.uniform(0.002, 0.05, steps)
        truth, z = simulated(model, self.COUNT, dt, r, start=GIVEN, seed=6)
        times = np.cumsum([0.0, *dt])
        low, high = self.bounds(2 * steps)
        for function in (filter_series, smooth_series):
            result = function(z, r, model, initial=GIVEN, time=times)
            squares = np.mean(metrics.nees(result.mean - truth, result.covariance), axis=0)
            assert np.all((squares > low) & (squares < high))


def random_recording(seed):
    """Any manoeuvre, seen by one radar or two, with jitter, gaps or missed plots."""
    random = np.random.default_rng([77, seed])
    steps = int(random.integers(60, 501))
    alpha, ratio = np.exp(random.uniform(np.log([0.02, 0.02]), np.log([3, 30])))
    model = SingerModel(5.0, alpha / 5, 0.1 * ratio / 25, exact=True)
    dt = np.full(steps - 1, 5.0)
    if seed % 4 == 1:
        dt = random.uniform(1, 9, steps - 1)
    elif seed % 4 == 2:
        gap = random.uniform(0.001, 0.05)
        dt = np.where(np.arange(steps - 1) % 2, 5 - gap, gap)
    elif seed % 4 == 3:
        dt = random.exponential(5.0, steps - 1)
        dt[random.integers(0, steps - 1, 3)] *= 20
        dt[random.integers(0, steps - 1, 3)] = [0, 1e-6, 1e-3]
    x, angle = random.normal(size=3) * [50, 1, model.acceleration_sigma], []
    for interval in [0.0, *dt]:
        q = model.process_noise(interval)
        scale = np.sqrt(np.where(np.diagonal(q) > 0, np.diagonal(q), 1))
        values, axes = np.linalg.eigh(q / np.outer(scale, scale))
        root = scale[:, np.newaxis] * axes * np.sqrt(np.maximum(values, 0))
        x = model.transition(interval) @ x + root @ random.normal(size=3)
        angle.append(x[0])
    z = np.array(angle) + np.sqrt(R) * random.normal(size=steps)
    if random.random() < 0.3:
        z[random.random(steps) < 0.2] = NAN
    return model, np.cumsum([0.0, *dt]), z


@pytest.fixture(scope="module")
def recordings():
    return simulated(EXACT, TestFit.COUNT, [5.0] * 299, seed=7)[1]


@pytest.fixture(scope="module")
def fits(recordings):
    return [fit_noise(z, dt=5.0) for z in recordings]


def relative(fit):
    """Standard uncertainties over the estimates, that of the density last."""
    estimates = [fit.alpha, fit.acceleration_sigma, fit.measurement_sigma, fit.density]
    sigma = np.array([*fit.sigma, fit.density_sigma])
    return np.divide(sigma, estimates, out=np.full(4, INF), where=np.isfinite(sigma))


class TestFit:
    """The noise of plots and motion from a recording."""

    TRUTH = (0.05, 0.003, 0.1)
    NAMES = ("alpha", "acceleration_sigma", "measurement_sigma")
    COUNT = 100

    def values(self, fits):
        return np.array([[getattr(fit, name) for name in self.NAMES] for fit in fits])

    def test_errors_cover_the_truth(self, fits):
        """Of 100 recordings; alpha is told least and its law is not normal."""
        errors = np.array([relative(fit)[:3] for fit in fits])
        assert np.isfinite(errors).all()
        off = np.log(self.values(fits) / self.TRUTH) / errors
        assert np.all(np.mean(np.abs(off) < 3, axis=0) >= 0.97)
        for k in (1, 2):
            # binomial bounds of the numbers within one and two standard errors
            for width in (1, 2):
                share = stats.chi2.cdf(width**2, 1)
                few, many = stats.binom.interval(1 - CHANCE / 4, self.COUNT, share)
                within = np.count_nonzero(np.abs(off[:, k]) < width)
                assert few <= within <= many
        # no bias beyond a third of the error
        assert np.all(np.abs(np.mean(off[:, 1:], axis=0)) < 0.33)
        assert np.all(np.median(errors, axis=0) < [0.4, 0.15, 0.06])

    def test_likelihood_is_that_of_the_filter_and_largest(self, recordings, fits):
        for z, fit in zip(recordings[:5], fits, strict=False):
            best = filter_series(z, fit.measurement_sigma**2, fit.model(5.0))
            assert fit.log_likelihood == pytest.approx(best.log_likelihood, rel=1e-10)
            assert fit.count == best.count == 298
            for k in range(3):
                for factor in (0.97, 1.03):
                    alpha, acceleration, sigma = self.values([fit])[0] * np.where(
                        np.arange(3) == k, factor, 1
                    )
                    model = SingerModel(5.0, alpha, acceleration, exact=True)
                    other = filter_series(z, sigma**2, model)
                    assert other.log_likelihood < fit.log_likelihood

    def test_errors_are_the_curvature(self, recordings, fits):
        """Along the noise alone: of the logarithm of its sigma, others as they are."""
        z, fit = recordings[0], fits[0]
        logs = np.log(self.values([fit])[0])

        def likelihood(step):
            alpha, acceleration, sigma = np.exp(logs + step)
            model = SingerModel(5.0, alpha, acceleration, exact=True)
            return filter_series(z, sigma**2, model, store="final").log_likelihood

        h = 0.01 * np.eye(3)
        information = -np.array(
            [
                [
                    likelihood(a + b) - likelihood(a - b) - likelihood(b - a) + likelihood(-a - b)
                    for b in h
                ]
                for a in h
            ]
        ) / (4 * 0.01**2)
        covariance = np.linalg.inv(information)
        expected = np.sqrt(np.diagonal(covariance))
        np.testing.assert_allclose(relative(fit)[:3], expected, rtol=0.02)
        combined = np.array([-1, 2, 0])
        expected = np.sqrt(combined @ covariance @ combined)
        assert relative(fit)[3] == pytest.approx(expected, rel=0.02)

    @pytest.mark.parametrize("factor", [1e-3, 1000.0, 1e8])
    def test_the_unit_of_angle_does_not_matter(self, recordings, fits, factor):
        found = fit_noise(recordings[0] * factor, dt=5.0)
        expected = self.values(fits[:1])[0] * [1, factor, factor]
        assert self.values([found])[0] == pytest.approx(expected, rel=1e-5)
        assert relative(found) == pytest.approx(relative(fits[0]), rel=1e-3)

    @pytest.mark.parametrize("factor", [1e-9, 1000.0])
    def test_the_unit_of_time_does_not_matter(self, recordings, fits, factor):
        found = fit_noise(recordings[0], dt=5.0 * factor)
        expected = self.values(fits[:1])[0] / [factor, factor**2, 1]
        assert self.values([found])[0] == pytest.approx(expected, rel=1e-5)

    def test_several_series_have_smaller_errors(self, recordings):
        fit = fit_noise(recordings[:16].reshape(4, 4, 300), dt=5.0)
        off = np.log(self.values([fit])[0] / self.TRUTH) / relative(fit)[:3]
        assert np.all(np.abs(off) < 3)
        assert fit.count == 16 * 298
        single = np.median([relative(fit_noise(z, dt=5.0)) for z in recordings[:8]], axis=0)
        assert relative(fit) == pytest.approx(single / 4, rel=0.25)

    def test_gaps_irregular_times_and_wrap(self):
        random = rng(9)
        dt = random.uniform(1.0, 9.0, 199)
        z = simulated(EXACT, 6, dt, seed=9)[1] % 360
        z[random.random(z.shape) < 0.2] = NAN
        times = np.cumsum([0.0, *dt])
        fits = [fit_noise(one, time=times, period=360.0) for one in z]
        off = np.log(self.values(fits) / self.TRUTH) / [relative(fit)[:3] for fit in fits]
        assert np.all(np.abs(off) < 4)
        assert np.all(np.mean(np.abs(off) < 2, axis=0) >= 0.75)
        # unwrapped by hand
        straight = z[0].copy()
        there = ~np.isnan(straight)
        straight[there] = np.unwrap(straight[there], period=360)
        expected = self.values([fit_noise(straight, time=times)])
        np.testing.assert_allclose(self.values(fits[:1]), expected, rtol=1e-5)
        together = fit_noise(z[:4], time=np.tile(times, (4, 1)), period=360.0, n_threads=2)
        off = np.log(self.values([together])[0] / self.TRUTH) / relative(together)[:3]
        assert np.all(np.abs(off) < 3)
        assert np.all(relative(together) < relative(fits[0]))

    def test_threads_do_not_change_a_bit(self, recordings):
        one, many = (fit_noise(recordings[:8], dt=5.0, n_threads=n) for n in (1, 3))
        assert self.values([one]).tolist() == self.values([many]).tolist()
        assert one.log_likelihood == many.log_likelihood

    def test_plots_almost_at_the_same_time_change_little(self, recordings):
        """As of two radars; short intervals are no measure of the others."""
        times, z = 5.0 * np.arange(300), recordings[0]
        expected = fit_noise(z, time=times)
        for gap in (1e-3, 1e-13):
            twice = np.insert(times, 150, times[150] - gap), np.insert(z, 150, z[150] + 0.05)
            fit = fit_noise(twice[1], time=twice[0])
            off = np.log(self.values([fit])[0] / self.values([expected])[0])
            assert np.all(np.abs(off) < 0.2 * relative(expected)[:3])
        # the first of all, which tells a filter nothing of the rate but rounding
        start = np.insert(z, 1, z[0] + 0.05)
        one, two = (fit_noise(start, time=np.insert(times, 1, gap)) for gap in (0, 1e-13))
        assert self.values([two])[0] == pytest.approx(self.values([one])[0], rel=1e-8)
        # half of the intervals
        both = np.sort(np.r_[times, times + 1e-3]), np.repeat(z, 2) + 0.02 * rng(1).normal(size=600)
        fit = fit_noise(both[1], time=both[0])
        model = SingerModel(1.0, expected.alpha, expected.acceleration_sigma, exact=True)
        for r in (1e-4, 1e-3, 1e-2):
            other = filter_series(both[1], r, model, time=both[0])
            assert fit.log_likelihood > other.log_likelihood

    def test_nothing_is_more_likely_than_the_fit(self):
        """Than the truth, for many kinds of motion and recordings; and what errors cover it."""
        off, errors, fast = [], [], []
        for seed in range(self.COUNT):
            model, times, z = random_recording(seed)
            fit = fit_noise(z, time=times)
            truth = filter_series(z, R, model, time=times, store="final").log_likelihood
            best = filter_series(z, fit.measurement_sigma**2, fit.model(1.0), time=times)
            assert fit.log_likelihood >= truth - 1e-6, seed
            assert fit.log_likelihood == pytest.approx(best.log_likelihood, rel=1e-9, abs=1e-6)
            values = np.array([fit.alpha, fit.acceleration_sigma, fit.measurement_sigma])
            true = np.array([model.alpha, model.acceleration_sigma, np.sqrt(R)])
            density = 2 * model.acceleration_sigma**2 / model.alpha
            with np.errstate(divide="ignore"):
                off.append(np.log([*(values / true), fit.density / density]))
            errors.append(relative(fit))
            fast.append(model.alpha > 1 / 5)
        off, errors, fast = np.abs(off), np.array(errors), np.array(fast)
        # alpha and the acceleration: of manoeuvres slower than an interval, and if they are told
        told = np.isfinite(errors) & ~(fast[:, np.newaxis] & np.array([True, True, False, False]))
        assert np.all(np.sum(told, axis=0) > [60, 60, 90, 90])
        # of 5000 such recordings, 0.69 and 0.94 are within one and two errors
        for width, share in ((1, 0.69), (2, 0.94)):
            for k in range(4):
                few, many = stats.binom.interval(1 - CHANCE / 8, np.sum(told[:, k]), share)
                assert few <= np.sum(off[told[:, k], k] < width * errors[told[:, k], k]) <= many

    def test_a_recording_of_white_acceleration(self):
        """Alpha is infinite; its combination with the acceleration is told."""
        random = np.random.default_rng(2)
        rate = np.cumsum(0.01 * random.standard_normal(200))
        z = 4 * np.cumsum(rate) + 0.02 * random.standard_normal(200)
        fit = fit_noise(z, dt=4.0)
        assert fit.limits == ("white acceleration",)
        assert np.isinf(fit.sigma).tolist() == [True, True, False]
        assert np.log(fit.density / (0.01**2 / 4)) < 2 * relative(fit)[3] < 0.5
        assert fit.density == pytest.approx(2 * fit.acceleration_sigma**2 / fit.alpha, rel=1e-14)
        for alpha in np.geomspace(0.01, 100, 17):
            for density in fit.density * np.array([0.7, 0.85, 1, 1.2, 1.5]):
                model = SingerModel(4.0, alpha, np.sqrt(0.5 * density * alpha), exact=True)
                for r in fit.measurement_sigma**2 * np.array([0.8, 1, 1.2]):
                    assert filter_series(z, r, model).log_likelihood < fit.log_likelihood
        assert repr(fit).startswith("NoiseFit(white acceleration: density 2.15e-05 ± 19%, meas")

    def test_a_recording_of_constant_acceleration(self):
        steps = np.arange(200.0)
        z = 3 + 0.2 * steps + 0.02 * steps**2 + 0.1 * rng(1).normal(size=200)
        fit = fit_noise(z, dt=4.0)
        assert fit.limits == ("constant acceleration",)
        assert fit.alpha == 0
        assert fit.acceleration_sigma == pytest.approx(0.04 / 16, rel=0.02)
        assert np.isinf([*fit.sigma, fit.density_sigma]).tolist() == [1, 1, 0, 1]
        assert fit.density == INF
        assert repr(fit).startswith("NoiseFit(constant acceleration: measurement_sigma 0.")

    def test_a_recording_of_constant_rate(self):
        """The noise is told all the same: its standard deviation, of 298 values."""
        z = 3 + 0.2 * np.arange(300) + 0.1 * rng(1).normal(size=300)
        fit = fit_noise(z, dt=5.0)
        assert fit.limits == ("constant rate",)
        line = np.polynomial.Polynomial.fit(np.arange(300), z, 1)(np.arange(300))
        sigma = np.sqrt(np.sum((z - line) ** 2) / 298)
        assert fit.measurement_sigma == pytest.approx(sigma, rel=1e-9)
        assert relative(fit)[:3] == pytest.approx([INF, INF, np.sqrt(0.5 / 298)])
        assert (fit.alpha, fit.acceleration_sigma, fit.density, fit.density_sigma) == (0, 0, 0, INF)
        assert repr(fit) == "NoiseFit(constant rate: measurement_sigma 0.0924 ± 4%)"

    def test_a_recording_without_noise(self):
        z = simulated(SingerModel(1.0, 0.2, 1.0, exact=True), 1, [1.0] * 299, r=0, seed=2)[1][0]
        fit = fit_noise(z, dt=1.0)
        assert fit.measurement_sigma < 0.02
        off = np.log([fit.alpha / 0.2, fit.acceleration_sigma]) / relative(fit)[:2]
        assert np.all(np.abs(off) < 3)
        smooth = fit_noise(np.sin(np.arange(200) / 30), dt=1.0)
        assert smooth.limits == ("no noise",)
        assert np.isinf(smooth.sigma).tolist() == [False, False, True]
        assert "measurement_sigma" not in repr(smooth)

    def test_is_printed_usefully(self, fits):
        fit = fits[0]
        assert repr(fit).startswith(f"NoiseFit(alpha {fit.alpha:.3g} ± ")
        assert f"measurement_sigma {fit.measurement_sigma:.3g} ± " in repr(fit)
        assert fit.model(2.0) == SingerModel(2.0, fit.alpha, fit.acceleration_sigma, exact=True)

    @pytest.mark.parametrize(
        "angle",
        [
            np.arange(20.0),
            0.1 * np.arange(200) + 0.7,
            np.zeros(50),
            0.2 * np.arange(200.0) ** 2,
        ],
    )
    def test_lines_and_parabolas_are_refused(self, angle):
        with pytest.raises(ValueError, match="z lies on"):
            fit_noise(angle, dt=0.3)

    @pytest.mark.parametrize(
        ("call", "error", "message"),
        [
            (fit_noise, ValueError, "either dt or time"),
            (lambda z: fit_noise(z, dt=5.0, time=np.arange(30)), ValueError, "either dt or time"),
            (lambda z: fit_noise(z[:9], dt=5.0), ValueError, "z has 9 measurements; at least 10"),
            (
                lambda z: fit_noise(z[:15].reshape(3, 5) * NAN, dt=5.0),
                ValueError,
                "z has 0 measurements",
            ),
            (lambda z: fit_noise(z.reshape(15, 2), dt=5.0), ValueError, r"\bz\b"),
            (lambda z: fit_noise(z, dt=-5.0), ValueError, "dt is -5"),
            (lambda z: fit_noise(z, dt=0.0), ValueError, r"\bdt\b"),
            (lambda z: fit_noise(z, dt="5"), TypeError, "dt is '5'"),
            (lambda z: fit_noise(z, time=np.zeros(30)), ValueError, "time"),
            (lambda z: fit_noise(z, time=np.zeros(29)), ValueError, "time has shape"),
            (lambda z: fit_noise(z, time=-np.arange(30)), ValueError, r"time\[1\]"),
            (lambda z: fit_noise(z, dt=5.0, period=0), ValueError, "period is 0"),
            (lambda z: fit_noise(np.r_[z, INF], dt=5.0), ValueError, r"z\[30\] is inf"),
            (lambda z: fit_noise(1.0, dt=5.0), ValueError, "z is a single number"),
            (lambda z: fit_noise(["x"] * 20, dt=5.0), TypeError, "z has dtype"),
            (lambda z: fit_noise(z, dt=5.0, n_threads=0), ValueError, "n_threads is 0"),
        ],
    )
    def test_errors(self, call, error, message):
        with pytest.raises(error, match=message):
            call(rng(1).normal(size=30))


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


def test_agrees_with_filterpy():
    module = pytest.importorskip("filterpy.kalman")
    z = plots(60, seed=1)
    z[[7, 8, 30]] = NAN
    for model in BOTH.values():
        peer = module.KalmanFilter(dim_x=3, dim_z=1)
        peer.F, peer.Q = model.transition(), model.process_noise()
        peer.H, peer.R = np.array([[1.0, 0, 0]]), np.array([[R]])
        peer.x, peer.P = GIVEN[0].reshape(3, 1).copy(), GIVEN[1].copy()
        means, covariances, likelihood = [], [], 0.0
        for k, plot in enumerate(z):
            if k:
                peer.predict()
            peer.update(None if np.isnan(plot) else plot)
            if not np.isnan(plot):
                likelihood += peer.log_likelihood
            means.append(peer.x.copy())
            covariances.append(peer.P.copy())
        means, covariances = np.array(means), np.array(covariances)
        found = filter_series(z, R, model, initial=GIVEN)
        assert_states(found, (means[..., 0], covariances), STATE)
        assert found.log_likelihood == pytest.approx(likelihood, rel=1e-9)
        x, p, *_ = peer.rts_smoother(means, covariances)
        smooth = smooth_series(z, R, model, initial=GIVEN)
        assert_states(smooth, (x[..., 0], p), SMOOTHED)


Z = plots(3, 6)
INDEFINITE = np.array([[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]])
VARIANCES = np.full((3, 6), R)


def with_one(array, row, step, value):
    changed = array.copy()
    changed[row, step] = value
    return changed


BAD_SERIES = [
    ({"z": [1.0, 2.0, INF]}, ValueError, r"z\[2\] is inf"),
    ({"z": with_one(Z, 1, 4, -INF)}, ValueError, r"z\[1, 4\] is -inf"),
    ({"z": [1.0, 1e200]}, ValueError, r"z\[1\] is 1e\+?200"),
    ({"z": 5.0}, ValueError, "z is a single number"),
    ({"z": []}, ValueError, "z has 0 measurements; at least 1"),
    ({"z": [[1.0, 2.0], [1.0]]}, ValueError, "z is ragged"),
    ({"z": "x"}, TypeError, "z has dtype"),
    ({"z": [1.0, "x"]}, TypeError, "z has dtype"),
    ({"z": [1j, 2.0]}, TypeError, "z has dtype"),
    ({"z": [True, False]}, TypeError, "z has dtype"),
    ({"z": np.array([1.0, {}], dtype=object)}, TypeError, r"z\[1\] is \{\}"),
    ({"r": -1.0}, ValueError, "measurement_variance is -1"),
    ({"r": 0.0}, ValueError, "measurement_variance is 0"),
    ({"r": NAN}, ValueError, "measurement_variance is nan"),
    ({"r": INF}, ValueError, "measurement_variance is inf"),
    ({"r": [[R], [-R], [R]]}, ValueError, r"measurement_variance.* is -0.01.*\[1\]"),
    ({"r": [R, R, -1.0, R, R, R]}, ValueError, r"measurement_variance\[(0, )?2\] is -1"),
    ({"r": with_one(VARIANCES, 2, 1, NAN)}, ValueError, r"measurement_variance\[2, 1\] is nan"),
    ({"r": with_one(VARIANCES, 2, 1, 0.0)}, ValueError, r"measurement_variance\[2, 1\] is 0; it"),
    ({"r": [R, R]}, ValueError, r"measurement_variance has shape \(2,\).* \(\.\.\., 6\)"),
    ({"r": [[R]] * 2}, ValueError, r"measurement_variance has shape \(2, 1\)"),
    ({"r": "x"}, TypeError, "measurement_variance has dtype"),
    ({"r": None}, (TypeError, ValueError), "measurement_variance"),
    ({"model": "x"}, TypeError, "model is 'x'; it must be a SingerModel"),
    ({"model": (5.0, 0.05, 0.003)}, TypeError, "model is .* it must be a SingerModel"),
    ({"time": [0, 5, 10, 9, 20, 25]}, ValueError, r"time\[3\] is before"),
    ({"time": [[0, 5, 10, 15, 20, 25]] * 2}, ValueError, r"time has shape \(2, 6\)"),
    (
        {"time": [[0, 5, 10, 15, 20, 25]] * 2 + [[0, 5, 4, 15, 20, 25]]},
        ValueError,
        r"time\[2, 2\] is before",
    ),
    ({"time": [0, 5, 10, 15, 20]}, ValueError, r"time has shape \(5,\)"),
    ({"time": [0, 5, NAN, 15, 20, 25]}, ValueError, r"time\[2\] is nan"),
    ({"time": [0, 5, 10, 15, 20, INF]}, ValueError, r"time\[5\] is inf"),
    ({"time": 5.0}, ValueError, "time is a single number"),
    ({"time": "x"}, TypeError, "time has dtype"),
    ({"time": [0, 5, 10, 35, 40, 45]}, ValueError, "25; it must be less than 1/alpha"),
    ({"period": 0}, ValueError, "period is 0"),
    ({"period": -360.0}, ValueError, "period is -360"),
    ({"period": NAN}, ValueError, "period is nan"),
    ({"period": INF}, ValueError, "period is inf"),
    ({"period": "360"}, TypeError, "period is '360'"),
    ({"initial": 3}, TypeError, "initial must be a pair"),
    ({"initial": (1, 2, 3)}, TypeError, "initial must be a pair"),
    ({"initial": "xy"}, TypeError, "initial mean has dtype"),
    ({"initial": ([1, 2, 3], np.eye(2))}, ValueError, r"initial has shapes \(3,\) and \(2, 2\)"),
    ({"initial": ([1, 2], np.eye(3))}, ValueError, r"initial has shapes \(2,\) and \(3, 3\)"),
    ({"initial": ([1, 2, NAN], np.eye(3))}, ValueError, r"initial mean\[2\] is nan"),
    (
        {"initial": ([1, 2, 3], np.full((3, 3), INF))},
        ValueError,
        r"initial covariance\[0, 0\] is inf",
    ),
    ({"initial": (np.ones((2, 3)), np.eye(3))}, ValueError, r"initial has shapes? \(2, 3\)"),
    (
        {"initial": (np.ones((3, 3)), np.ones((2, 3, 3)))},
        ValueError,
        r"initial has shapes \(3, 3\) and \(2, 3, 3\)",
    ),
    ({"initial": ([1, 2, 3], -np.eye(3))}, ValueError, r"covariance\[.*0, 0\] is -1"),
    ({"initial": ([1, 2, 3], np.triu(np.ones((3, 3))))}, ValueError, "must be symmetric"),
    ({"initial": ([1, 2, 3], INDEFINITE)}, np.linalg.LinAlgError, "covariance is indefinite"),
    (
        {"initial": ([1, 2, 3], [np.eye(3), INDEFINITE, np.eye(3)])},
        np.linalg.LinAlgError,
        r"covariance.* is indefinite.*\[1\]",
    ),
    (
        {"initial": ([1, 2, 3], [np.eye(3), np.eye(3), np.triu(np.ones((3, 3)))])},
        ValueError,
        r"covariance\[2, 0, 1\] is 1 and its mirror image",
    ),
    ({"n_threads": 0}, ValueError, "n_threads is 0"),
    ({"n_threads": 1.5}, TypeError, "n_threads is 1.5"),
]


class TestErrors:
    @pytest.mark.parametrize(("wrong", "error", "message"), BAD_SERIES)
    @pytest.mark.parametrize("function", [filter_series, smooth_series])
    def test_of_series(self, function, wrong, error, message):
        options = {"z": Z, "r": R, "model": PRINTED} | wrong
        arguments = [options.pop(name) for name in ("z", "r", "model")]
        with pytest.raises(error, match=message):
            function(*arguments, **options)

    @pytest.mark.parametrize("store", ["everything", "", None, 3, ["all"]])
    def test_of_store(self, store):
        with pytest.raises((TypeError, ValueError), match="store"):
            filter_series(Z, R, PRINTED, store=store)

    def test_a_wrong_number_does_not_wait_for_the_first_row(self):
        with pytest.raises(ValueError, match="period is -1"):
            filter_series(np.empty((0, 5)), R, PRINTED, period=-1)

    @pytest.mark.parametrize(
        ("call", "error", "message"),
        [
            (lambda: SingerModel(-1, 0.05, 1), ValueError, "dt is -1"),
            (lambda: SingerModel(NAN, 0.05, 1), ValueError, "dt is nan"),
            (lambda: SingerModel(INF, 0.05, 1), ValueError, "dt is inf"),
            (lambda: SingerModel(5, -0.05, 1), ValueError, "alpha is -0.05"),
            (lambda: SingerModel(5, NAN, 1), ValueError, "alpha is nan"),
            (lambda: SingerModel(5, 0.05, -1), ValueError, "acceleration_sigma is -1"),
            (lambda: SingerModel(5, 0.05, INF), ValueError, "acceleration_sigma is inf"),
            (lambda: SingerModel(5, 0.2, 1), ValueError, "dt is 5; it must be less than 1/alpha"),
            (lambda: SingerModel("5", 0.05, 1), TypeError, "dt is '5'"),
            (lambda: SingerModel(5, None, 1), TypeError, "alpha is None"),
            (lambda: SingerModel(5, 0.05, 1, exact=1), TypeError, "exact is 1"),
            (lambda: PRINTED.transition(-1), ValueError, "dt is -1"),
            (lambda: PRINTED.transition("1"), TypeError, "dt is '1'"),
            (lambda: PRINTED.process_noise(20), ValueError, "dt is 20; it must be less than"),
            (lambda: steady_state(PRINTED, 0), ValueError, "measurement_variance is 0"),
            (lambda: steady_state(PRINTED, -1), ValueError, "measurement_variance is -1"),
            (lambda: steady_state(PRINTED, NAN), ValueError, "measurement_variance is nan"),
            (lambda: steady_state(PRINTED, "1"), TypeError, "measurement_variance is '1'"),
            (lambda: steady_state("x", 1), TypeError, "model is 'x'"),
            (
                lambda: steady_state(SingerModel(5, 0.05, 0), 1),
                ValueError,
                "acceleration_sigma is 0; .* no steady state",
            ),
            (lambda: steady_state(SingerModel(5, 0, 1), 1), ValueError, "no steady state"),
            (lambda: steady_state(SingerModel(0, 0.05, 1), 1), ValueError, "no steady state"),
            # as given, not another number
            (
                lambda: steady_state(SingerModel(5, 0.05, 1e-14), 1e100),
                ValueError,
                r"measurement_variance is 1e\+?100; .* does not settle",
            ),
        ],
    )
    def test_of_models(self, call, error, message):
        with pytest.raises(error, match=message):
            call()


def decades(low, high):
    return st.integers(low, high).map(lambda exponent: float(f"1e{exponent}"))


PLOTS = st.lists(st.one_of(st.floats(-1e9, 1e9), st.just(NAN)), min_size=1, max_size=12)


@given(
    z=PLOTS,
    sigma=decades(-6, 6),
    dt=decades(-6, 6),
    x=st.sampled_from([0.0, 1e-6, 1e-3, 0.1, 0.5, 0.99, 2.0, 50.0]),
    restlessness=decades(-8, 8),
    exact=st.booleans(),
    width=st.one_of(st.none(), decades(-16, 16)),
    period=st.sampled_from([None, 360.0]),
)
@example([-1.9, NAN, 0.7, NAN, 2.0], 1e-5, 1.0, 1.0, 1e8, True, 1e10, None)
@example([1.1, NAN, NAN, NAN, NAN, 0.8, -0.2, 0.9], 1e8, 10.0, 0.1, 1.0, False, 1e16, None)
@example([5.0, 3.0, NAN, 2.0, 1.0], 1.0, 1e6, 0.1, 1.0, True, None, None)
@settings(max_examples=100, deadline=None, derandomize=True)
def test_a_state_and_its_covariance_whatever_the_numbers(
    z, sigma, dt, x, restlessness, exact, width, period
):
    """Known from the first plot on; no variance is nan or negative."""
    z = sigma * np.array(z)
    model = SingerModel(dt, x / dt, restlessness * sigma / dt**2, exact=exact or x >= 1)
    started = np.cumsum(~np.isnan(z)) > 0
    initial = None
    if width is not None:
        started[:] = True
        unit = np.sqrt(width) * sigma / np.array([1, dt, dt**2])
        initial = np.zeros(3), np.diag(unit**2)
    result = filter_series(z, sigma**2, model, initial=initial, period=period)
    smooth = smooth_series(z, sigma**2, model, initial=initial, period=period)
    assert np.isfinite(result.log_likelihood)
    for found in (result, smooth):
        np.testing.assert_array_equal(np.isfinite(found.mean).all(axis=-1), started)
        assert not np.isnan(found.upper).any()
        assert np.all(found.upper[..., [0, 3, 5]] >= 0)


@pytest.mark.parametrize("dt", [5e-324, 1e-200])
def test_a_time_that_is_almost_none(dt):
    """A result, or an error that names it."""
    try:
        found = filter_series([1.0, 1.1, 1.2, 1.3], R, SingerModel(dt, 1.0, 1.0, exact=True))
    except ValueError as error:
        assert "dt is" in str(error)  # noqa: PT017 - either is right
    else:
        assert np.isfinite(found.mean).all()
        assert not np.isnan(found.upper).any()
