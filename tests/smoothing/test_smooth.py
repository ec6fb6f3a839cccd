"""The smoother of positions against 300-digit arithmetic and its own claims."""

import datetime as dt
from functools import partial

import numpy as np
import polars as pl
import pytest
from checks import INF, NAN, in_region, rng
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import smoothing as reference
from scipy import optimize
from smoothing.scenes import assert_close, assert_parity, covariances, gaps, series
from tolerances import CHANCE, TRACK

from tertia import metrics
from tertia.smoothing import smooth as smooth_by_default

# the noise as stated
smooth = partial(smooth_by_default, correlation_time=0.0, robust=False)


def simulated(trials, times, d, q, covariance, seed=0):
    """States with white jerk from anywhere, (trials, N, 3D), and plots."""
    random = rng(seed)
    x = random.normal(size=(trials, 3, d)) * np.array([100.0, 10.0, 1.0])[:, np.newaxis]
    states = [x]
    for t in np.diff(times):
        f = reference.transition(t).astype(float)
        root = np.linalg.cholesky(reference.noise(t, q).astype(float) + 1e-300 * np.eye(3))
        x = f @ x + root @ random.normal(size=x.shape)
        states.append(x)
    truth = np.stack(states, axis=1).reshape(trials, len(times), 3 * d)
    noise = random.multivariate_normal(np.zeros(d), covariance, size=truth.shape[:2])
    return truth, truth[..., :d] + noise


class TestTrack:
    def check(self, y, covariance, times, q, initial=None):
        """Everything against one dense normal distribution in 300 digits."""
        y = np.asarray(y, dtype=float)
        found = smooth(y, covariance, time=times, jerk=q, initial=initial)
        mean, matrix, innovation, likelihood = reference.smooth(y, covariance, times, q, initial)
        self.assert_valid(found)
        assert_parity(found, mean, matrix, innovation, initial)
        other = 3 * q + 0.1
        apart = smooth(y, covariance, time=times, jerk=other, initial=initial).log_likelihood
        expected = reference.smooth(y, covariance, times, other, initial)[3] - likelihood
        size = max(1, abs(apart), abs(found.log_likelihood))
        assert apart - found.log_likelihood == pytest.approx(expected, abs=TRACK * size)
        return found

    @staticmethod
    def assert_valid(found):
        """What holds for every result."""
        matrix = found.covariance
        np.testing.assert_array_equal(matrix, np.swapaxes(matrix, -1, -2))
        variance = np.diagonal(matrix, axis1=-2, axis2=-1)
        assert np.all(variance > 0)
        unknown = np.isinf(variance)
        unit = np.sqrt(np.where(unknown, 1.0, variance))
        finite = np.where(np.isinf(matrix), 1.0, matrix)
        correlation = finite / unit[..., :, np.newaxis] / unit[..., np.newaxis, :]
        assert np.linalg.eigvalsh(correlation).min() > -1e-12

    @pytest.mark.parametrize("d", [1, 2, 3, 4])
    def test_coupled_axes_at_irregular_times(self, d):
        y, times = rng(d).normal(size=(9, d)), np.sort(rng(d).uniform(0, 20, 9))
        found = self.check(y, covariances(9, d), times, 0.01)
        assert found.position.shape == found.velocity.shape == found.acceleration.shape == (9, d)
        assert found.count == 9 * d - 3 * d
        for i, name in enumerate(("position", "velocity", "acceleration")):
            own = slice(i * d, (i + 1) * d)
            np.testing.assert_array_equal(getattr(found, name), found.mean[..., own])
            block = getattr(found, f"{name}_covariance")
            np.testing.assert_array_equal(block, found.covariance[..., own, own])

    @pytest.mark.parametrize("q", [0.0, 1e-12, 1e-6, 1.0, 1e6, 1e12])
    def test_any_jerk(self, q):
        times = np.sort(rng(1).uniform(0, 20, 10))
        self.check(3 * rng(2).normal(size=(10, 2)), covariances(10, 2), times, q)

    @pytest.mark.parametrize("q", [0.0, 1e-9, 1.0])
    @pytest.mark.parametrize("at", [3, 6])
    def test_a_gap_of_hours(self, at, q):
        times = np.sort(rng(1).uniform(0, 20, 10))
        times[at:] += 1e4
        self.check(3 * rng(2).normal(size=(10, 2)), covariances(10, 2), times, q)

    @pytest.mark.parametrize("q", [0.0, 1e-6, 1.0, 1e6])
    def test_steps_of_very_different_length(self, q):
        times = [0, 1e-3, 2e-3, 4e-3, 5, 6, 7.001, 8, 1e4, 1e4 + 1]
        self.check(rng(2).normal(size=(10, 2)), covariances(10, 2), times, q)

    @pytest.mark.parametrize("q", [1e-3, 0.1])
    def test_plots_of_very_different_precision(self, q):
        size = 10.0 ** rng(5).uniform(-8, 8, 10)
        matrix = covariances(10, 2) * size[:, np.newaxis, np.newaxis]
        y = rng(2).normal(size=(10, 2)) * np.sqrt(size)[:, np.newaxis]
        self.check(y, matrix, np.sort(rng(1).uniform(0, 20, 10)), q)

    @pytest.mark.parametrize("seed", range(4))
    def test_missing_components_and_equal_times(self, seed):
        y = gaps(rng(seed).normal(size=(12, 3)), 0.5, seed)
        times = np.sort(rng(seed).integers(0, 7, 12)).astype(float)
        self.check(y, covariances(12, 3), times, 0.1)

    @pytest.mark.parametrize("count", range(5))
    def test_what_few_plots_determine(self, count):
        y = np.full((6, 2), NAN)
        y[1 : 1 + count] = rng(1).normal(size=(count, 2))
        found = self.check(y, covariances(6, 2), np.arange(6.0), 0.1)
        assert np.all(np.isfinite(found.sigma)) == (count >= 3)
        assert found.count == max(0, 2 * count - 6)
        fitted = smooth(y, covariances(6, 2))
        if count <= 3:
            assert (fitted.jerk, fitted.jerk_sigma) == (0.0, INF)

    def test_axes_that_are_not_measured_alike(self):
        y = rng(1).normal(size=(7, 3))
        y[:, 0], y[[0, 1, 2, 4, 5], 1] = NAN, NAN
        found = self.check(y, covariances(7, 3), np.arange(7.0), 0.1)
        known = np.isfinite(found.sigma)
        assert not known[:, [0, 3, 6]].any()
        assert known[:, [2, 5, 8]].all()
        np.testing.assert_array_equal(np.flatnonzero(known[:, 1]), [3, 6])
        # a parabola through two points is as steep halfway as their chord: here at no instant
        assert not known[:, [4, 7]].any()
        y[5, 1], y[6, 1] = 1.0, NAN
        assert np.isfinite(self.check(y, covariances(7, 3), np.arange(7.0), 0.1).sigma[4, 4])

    @pytest.mark.parametrize("size", [1.0, 1e10, 1e-8])
    def test_an_initial_state(self, size):
        a = rng(3).normal(size=(6, 6))
        initial = rng(4).normal(size=6), a @ a.T * size
        y = gaps(rng(2).normal(size=(8, 2)), 0.3)
        self.check(y, covariances(8, 2), np.sort(rng(1).uniform(0, 20, 8)), 0.1, initial)
        alone = smooth([[NAN, NAN]], 1.0, jerk=1.0, initial=initial)
        np.testing.assert_allclose(alone.mean[0], initial[0], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(alone.covariance[0], initial[1], rtol=1e-9, atol=1e-12 * size)

    def test_no_jerk_is_a_parabola(self):
        """A hundred thousand instants, against least squares of orthogonal polynomials."""
        n = 100_000
        t = np.arange(n) / n
        y = 1e6 * t + rng(1).normal(size=n)
        found = smooth(y[:, np.newaxis], 1.0, time=t, jerk=0.0)
        basis = np.linalg.qr(np.polynomial.legendre.legvander(2 * t - 1, 2))[0]
        # without the slope, which would cost the reference its digits
        expected = 1e6 * t + basis @ (basis.T @ (y - 1e6 * t))
        sigma = np.sqrt(np.sum(basis**2, axis=1))
        assert_close(found.position[:, 0], expected, 1e-7, sigma)
        np.testing.assert_allclose(found.sigma[:, 0], sigma, rtol=1e-9)

    def test_a_long_track_is_as_good_as_a_short_one(self):
        """What is far away does not matter, so neither does rounding on the way."""
        n, q = 100_000, 1e-2
        y = np.cumsum(rng(1).normal(size=(n, 2)), axis=0)
        whole = smooth(y, 1.0, jerk=q)
        self.assert_valid(smooth(y[:2000], 1.0, jerk=q))
        middle = slice(n // 2 - 500, n // 2 + 500)
        part = smooth(y[middle], 1.0, jerk=q)
        for name in ("mean", "covariance"):
            found = getattr(whole, name)[middle][450:550]
            np.testing.assert_allclose(found, getattr(part, name)[450:550], rtol=1e-9, atol=1e-9)

    @pytest.mark.parametrize("d", [1, 3])
    @pytest.mark.parametrize("q", [1e-4, 1.0])
    def test_the_covariance_is_that_of_the_errors(self, d, q):
        """NEES at the ends, beside them and in the middle; of each derivative and of the state."""
        trials = 4_000
        times = np.r_[0.0, 1.0, 2.5, 2.5, np.arange(4.0, 20.0), 40.0, 41.0]
        covariance = covariances(1, d, seed=8)[0]
        truth, y = simulated(trials, times, d, q, covariance)
        missing = rng(4).random(y.shape) < 0.1
        missing[:, 5] = True
        y[missing] = NAN
        found = smooth(y, covariance, time=times, jerk=q)
        error = found.mean - truth
        places = [0, 1, 3, 5, len(times) // 2, len(times) - 2, len(times) - 1]
        low, high = metrics.consistency_bounds(trials, d, 1 - CHANCE / 28)
        for i in places:
            for derivative in range(3):
                own = slice(derivative * d, (derivative + 1) * d)
                nees = metrics.nees(error[:, i, own], found.covariance[:, i, own, own])
                assert low <= np.mean(nees) <= high
            whole = metrics.nees(error[:, i], found.covariance[:, i])
            bounds = metrics.consistency_bounds(trials, 3 * d, 1 - CHANCE / 28)
            assert bounds[0] <= np.mean(whole) <= bounds[1]
        innovation = found.innovation[~np.isnan(found.innovation)]
        low, high = metrics.consistency_bounds(innovation.size, 1, 1 - CHANCE)
        assert low <= np.mean(innovation**2) <= high
        assert np.nansum(found.nis) == pytest.approx(np.sum(innovation**2), rel=1e-12)
        assert np.all(np.isnan(found.nis[:, 5]))

    def test_the_fitted_jerk(self):
        """As near as it says, and at the maximum."""
        q, trials = 0.3, 300
        _, y = simulated(trials, np.arange(100.0), 2, q, np.eye(2))
        found = smooth(y, 1.0)
        error = np.log(found.jerk / q) / (found.jerk_sigma / found.jerk)
        assert np.abs(np.mean(error)) < 0.25
        low, high = metrics.consistency_bounds(trials, 1, 1 - CHANCE / 4)
        assert low * 0.9 <= np.mean(error**2) <= high * 1.1
        for i in range(5):
            best = smooth(y[i], 1.0).log_likelihood
            assert best == pytest.approx(found.log_likelihood[i], rel=1e-12)
            for factor in (0.97, 1.03):
                assert smooth(y[i], 1.0, jerk=found.jerk[i] * factor).log_likelihood < best
            step = 0.05 * found.jerk_sigma[i] / found.jerk[i]
            beside = [
                smooth(y[i], 1.0, jerk=found.jerk[i] * np.exp(s)).log_likelihood
                for s in (-step, step)
            ]
            curvature = (2 * best - sum(beside)) / step**2
            assert found.jerk_sigma[i] / found.jerk[i] == pytest.approx(curvature**-0.5, rel=0.03)

    def test_a_jerk_that_is_not_told(self):
        t = np.arange(30.0)
        steady = (t + 0.1 * t**2)[:, np.newaxis] + 1e-3 * rng(1).normal(size=(30, 1))
        found = smooth(steady, 1.0)
        assert (found.jerk, found.jerk_sigma) == (0.0, INF)
        assert "jerk 0 ± inf%" in repr(found)

    def test_a_jerk_that_hides_the_noise(self):
        y = rng(1).normal(size=(60, 1)).cumsum(axis=0) * 1e8
        found = smooth(y, 1e-6)
        assert np.isfinite(found.jerk_sigma)
        assert found.nis[10:].mean() == pytest.approx(1, abs=0.1)

    @settings(max_examples=25, deadline=None)
    @given(st.floats(1e-6, 1e6), st.floats(1e-3, 1e3), st.floats(-1e6, 1e6), st.integers(0, 10**6))
    def test_units(self, scale, pace, shift, seed):
        d = 2
        y, times = gaps(series(40 * d, seed).reshape(40, d), 0.1, seed), np.arange(40.0)
        matrix = covariances(40, d, seed)
        fitted = smooth(y, matrix, time=times)
        found = smooth(y * scale + shift, matrix * scale**2, time=times * pace + shift)
        if fitted.acceleration_noise > 0:
            expected = fitted.acceleration_noise * scale**2 / pace**3
            assert found.acceleration_noise == pytest.approx(expected, rel=1e-3)
        elif fitted.jerk > 0:
            assert found.jerk == pytest.approx(fitted.jerk * scale**2 / pace**5, rel=1e-3)
        plain = smooth(y, matrix, time=times, jerk=fitted.jerk)
        jerk = plain.jerk * scale**2 / pace**5
        found = smooth(y * scale + shift, matrix * scale**2, time=times * pace, jerk=jerk)
        unit = scale / pace ** np.repeat([0, 1, 2], d)
        offset = np.repeat([shift, 0, 0], d)
        rounding = 1e-9 + 1e-14 * np.abs(shift) / scale
        assert_close(found.mean - offset, plain.mean * unit, rounding, plain.sigma * unit)
        np.testing.assert_allclose(found.sigma, plain.sigma * unit, rtol=1e-9)

    def test_axes_may_be_exchanged(self):
        y, matrix = gaps(rng(1).normal(size=(30, 3)), 0.2), covariances(30, 3)
        order = [2, 0, 1]
        plain = smooth(y, matrix, jerk=0.1)
        found = smooth(y[:, order], matrix[:, order][:, :, order], jerk=0.1)
        np.testing.assert_allclose(found.position, plain.position[:, order], rtol=1e-9, atol=1e-9)
        expected = plain.velocity_covariance[:, order][:, :, order]
        np.testing.assert_allclose(found.velocity_covariance, expected, rtol=1e-9, atol=1e-9)
        assert found.log_likelihood == pytest.approx(plain.log_likelihood, rel=1e-12)

    def test_every_form_of_the_covariance(self):
        y, variances = rng(1).normal(size=(3, 20, 2)), np.array([0.5, 2.0])
        plain = smooth(y, np.diag(variances), jerk=0.1)
        each = np.broadcast_to(np.diag(variances), (3, 20, 2, 2))
        for same in (variances, each, each[0], np.broadcast_to(variances, (20, 2)), each[0, :1]):
            if same.shape == (1, 2, 2):
                continue
            found = smooth(y, same, jerk=[0.1, 0.1, 0.1])
            np.testing.assert_array_equal(found.mean, plain.mean)
        number = smooth(y, 0.5, jerk=0.1, dt=1.0)
        same = smooth(y, 0.5 * np.eye(2), jerk=0.1, time=np.arange(20.0))
        np.testing.assert_array_equal(number.covariance, same.covariance)
        # what belongs to a missing component is not looked at
        y[0, 3, 1] = NAN
        hole = np.array(each)
        hole[0, 3, 1] = hole[0, 3, :, 1] = NAN
        np.testing.assert_array_equal(
            smooth(y, hole, jerk=0.1).mean, smooth(y, np.diag(variances), jerk=0.1).mean
        )
        variances_each = np.array(np.broadcast_to(variances, (3, 20, 2)))
        variances_each[0, 3, 1] = NAN
        np.testing.assert_array_equal(
            smooth(y, variances_each, jerk=0.1).mean, smooth(y, hole, jerk=0.1).mean
        )

    def test_batches_and_threads_return_the_same_bits(self):
        y = gaps(rng(1).normal(size=(2, 3, 60, 2)), 0.1)
        matrix = np.broadcast_to(covariances(60, 2), (2, 3, 60, 2, 2))
        one, many = (smooth(y, matrix, n_threads=n) for n in (1, 4))
        names = (
            "mean",
            "covariance",
            "innovation",
            "log_likelihood",
            "count",
            "jerk",
            "jerk_sigma",
        )
        for name in names:
            np.testing.assert_array_equal(getattr(one, name), getattr(many, name))
            for place in np.ndindex(2, 3):
                alone = getattr(smooth(y[place], matrix[place]), name)
                np.testing.assert_array_equal(alone, getattr(one, name)[place])
        assert isinstance(smooth(y[0, 0], 1.0).jerk, float)

    @pytest.mark.parametrize(
        ("arguments", "error", "message"),
        [
            ({"y": [1.0, 2.0]}, ValueError, r"y has shape \(2,\); it must be \(..., N, D\)"),
            ({"y": np.empty((3, 0))}, ValueError, "it must have at least one axis"),
            ({"y": [[1, 2], [3, INF]]}, ValueError, r"y\[1, 1\] is inf; a plot must be"),
            ({"y": [[[1, 2], [3, INF]]]}, ValueError, r"y\[0, 1, 1\] is inf"),
            ({"covariance": -1.0}, ValueError, r"covariance\[0, 0\] is -1; variances must"),
            ({"covariance": [[1, 2], [2, 1]]}, np.linalg.LinAlgError, "covariance is indefinite"),
            ({"covariance": [[1, 1], [1, 1]]}, np.linalg.LinAlgError, "covariance is singular"),
            ({"covariance": [[1, 0], [0.5, 1]]}, ValueError, r"covariance\[0, 1\] is 0 and its"),
            (
                {"covariance": [np.eye(2), -np.eye(2), np.eye(2)]},
                ValueError,
                r"covariance\[1, 0, 0\] is -1",
            ),
            ({"covariance": np.ones(3)}, ValueError, r"covariance has shape \(3,\); for y of"),
            ({"covariance": NAN}, ValueError, r"covariance\[0, 0\] is nan"),
            ({"time": [0, 2, 1]}, ValueError, r"time\[2\] is 1; time must not decrease"),
            ({"time": [0, 1]}, ValueError, r"time has shape \(2,\)"),
            ({"time": [0, 1, NAN]}, ValueError, r"time\[2\] is nan"),
            ({"time": [0, 1, 2], "dt": 1.0}, ValueError, "give either time or dt"),
            ({"dt": 0.0}, ValueError, "dt is 0.0; it must be a positive number"),
            ({"jerk": -1.0}, ValueError, "jerk is -1.0; it must not be negative"),
            ({"jerk": [1.0, -1.0]}, ValueError, r"jerk\[1\] is -1.0"),
            ({"jerk": [1.0, 1.0]}, ValueError, r"jerk has shape \(2,\)"),
            ({"jerk": NAN}, ValueError, "jerk is nan"),
            ({"initial": 1}, TypeError, "initial must be a pair"),
            ({"initial": ([0, 0], np.eye(2))}, ValueError, r"initial has shapes \(2,\)"),
            ({"initial": (np.zeros(6), -np.eye(6))}, ValueError, r"initial\[0, 0\] is -1"),
            ({"n_threads": 0}, ValueError, "n_threads is 0"),
        ],
    )
    def test_errors(self, arguments, error, message):
        given_ = {"y": [[1.0, 2.0], [2.0, 3.0], [4.0, 4.0]], "covariance": 1.0}
        with pytest.raises(error, match=message):
            smooth(**(given_ | arguments))

    def test_nothing_to_smooth(self):
        found = smooth(np.empty((0, 2)), 1.0)
        assert found.mean.shape == (0, 6)
        assert smooth(np.empty((0, 4, 2)), 1.0).covariance.shape == (0, 4, 6, 6)


def wandering(runs, n, step, seed, calmed=20.0):
    """Positions in units of the noise, whose velocity wanders, and is forgotten after a time."""
    random, kept = rng(seed), np.exp(-step / calmed)
    velocity = np.zeros((runs, n, 2))
    for k in range(1, n):
        shock = 0.3 * np.sqrt(1 - kept**2) * random.standard_normal((runs, 2))
        velocity[:, k] = kept * velocity[:, k - 1] + shock
    truth = step * np.cumsum(velocity, axis=1)
    return truth, truth + random.standard_normal(truth.shape)


@pytest.mark.parametrize("size", [1.0, 3.0, 30.0])
def test_steps_from_plot_to_plot_are_no_noise(size):
    """Fixes of an animal every hour: the steps were taken for noise 55 times as large as stated."""
    random = rng(31)
    truth = np.cumsum(size * random.standard_normal((10, 300, 2)), axis=1)
    found = smooth_by_default(truth + random.standard_normal(truth.shape), 1.0)
    error = found.position - truth
    assert np.sqrt(np.mean(error**2)) < 1.05
    assert 0.93 < np.mean(in_region(error, found.position_covariance)) < 0.97
    np.testing.assert_array_equal(found.noise_factor, 1.0)
    np.testing.assert_allclose(found.diffusion, size**2, rtol=0.4)


class TestWandering:
    """A velocity that wanders is no white jerk, and no noise of the plots either."""

    def test_parity(self):
        """Where white jerk is likely, too, the covariance is that of a mixture of both."""
        _, y = wandering(1, 30, 5.0, 3)
        times = 5.0 * np.arange(30) + rng(4).uniform(-2.0, 2.0, 30)
        plots = y[0], np.tile(np.eye(2), (30, 1, 1)), times
        found = smooth(y[0], np.eye(2), time=times)
        assert found.acceleration_noise > 0
        mean, matrix, innovation, top = reference.smooth(
            *plots, found.jerk, acceleration=found.acceleration_noise
        )
        sigma = np.sqrt(np.diagonal(matrix, axis1=1, axis2=2))
        assert np.max(np.abs(found.mean - mean) / sigma) <= TRACK
        assert_close(found.innovation, innovation, TRACK, np.maximum(1, np.abs(innovation)))

        def cost(log):
            return -smooth(y[0], np.eye(2), time=times, jerk=np.exp(log)).log_likelihood

        best = optimize.minimize_scalar(
            cost, bounds=(-20, 5), method="bounded", options={"xatol": 1e-7}
        )
        other, spread, _, value = reference.smooth(*plots, np.exp(best.x))
        weight = 1.0 / (1.0 + np.exp(top - value))
        assert weight > 0.02
        away = other - mean
        second = spread + away[:, :, np.newaxis] * away[:, np.newaxis, :]
        expected = matrix + weight * (second - matrix)
        scale = sigma[:, :, np.newaxis] * sigma[:, np.newaxis, :]
        # the likeliest intensities are found to 1e-5
        assert np.max(np.abs(found.covariance - expected) / scale) <= 1e-4

    @pytest.mark.parametrize(("n", "step"), [(60, 5.0), (300, 1.0), (300, 5.0)])
    def test_error_bars(self, n, step):
        """With white jerk alone, what it does not explain was taken for noise that lasts."""
        truth, y = wandering(30, n, step, n)
        found = smooth_by_default(y, 1.0, dt=step)
        error = found.position - truth
        assert np.mean(found.acceleration_noise > 0) > 0.7
        assert np.sqrt(np.mean(error**2)) < 0.75
        assert np.mean(in_region(error, found.position_covariance)) > 0.88

    def test_white_jerk_is_told_from_it(self):
        truth, y = simulated(40, np.arange(100.0), 2, 0.01, np.eye(2), seed=9)
        found = smooth_by_default(y, 1.0)
        assert np.mean(found.acceleration_noise > 0) < 0.05
        given = smooth_by_default(y, 1.0, jerk=0.01)
        np.testing.assert_array_equal(given.acceleration_noise, 0.0)
        errors = [np.sqrt(np.mean((one.mean - truth)[..., :2] ** 2)) for one in (found, given)]
        assert errors[0] < 1.02 * errors[1]


STEPS = np.arange(12)
DATES = np.datetime64("2026-11-22T23:59:50", "ms") + 1000 * STEPS
CLOCK = [dt.time(1, 2, step, 500_000) for step in STEPS]


@pytest.mark.parametrize(
    "time",
    [
        STEPS.astype("timedelta64[s]"),
        (1000 * STEPS).astype("timedelta64[ms]"),
        [dt.timedelta(seconds=float(step)) for step in STEPS],
        pl.Series([dt.timedelta(seconds=float(step)) for step in STEPS]),
        CLOCK,
        pl.Series(CLOCK),
        DATES,
        np.ma.array(DATES, mask=np.zeros(12)),
        pl.Series(DATES).dt.replace_time_zone("Europe/Prague"),
    ],
)
def test_times_of_every_type(time):
    y = rng(8).normal(size=(12, 1)) + STEPS[:, np.newaxis]
    expected = smooth(y, 1.0, time=STEPS.astype(float), jerk=0.1)
    found = smooth(y, 1.0, time=time, jerk=0.1)
    np.testing.assert_allclose(found.position, expected.position, atol=1e-6)


def test_masked_dates_are_not_numbers():
    masked = np.ma.array(DATES, mask=STEPS == 3)
    with pytest.raises(ValueError, match=r"time\[3\] is nan"):
        smooth(np.zeros((12, 1)), 1.0, time=masked)
    with pytest.raises(TypeError, match="y has dtype"):
        smooth(np.ma.array(np.ones((12, 1), dtype=bool)), 1.0)
