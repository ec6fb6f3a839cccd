"""The first plots, where nothing is known, and priors of any width."""

import math
from functools import lru_cache

import mpmath
import numpy as np
import pytest
from checks import INF, NAN, close, rng
from kalman.scenes import EXACT, GIVEN, MODELS, PRINTED, PRINTED_OR_EXACT, R, assert_states, plots
from reference import kalman as reference
from tolerances import EXACT_STATE, SMOOTHED

from tertia.kalman import AngleFilter, SingerModel, filter_series, smooth_series

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
