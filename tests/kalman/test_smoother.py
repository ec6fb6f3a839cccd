"""The smoother against theory."""

import numpy as np
from checks import NAN, rng
from kalman.scenes import (
    EXACT,
    GIVEN,
    PRINTED_OR_EXACT,
    R,
    assert_covariance,
    assert_states,
    plots,
    simulated,
)
from scipy import linalg, stats
from tolerances import CHANCE, SMOOTHED

from tertia.kalman import filter_series, smooth_series, steady_state


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
