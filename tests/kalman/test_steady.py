"""Where the filter goes in the long run."""

import mpmath
import numpy as np
import pytest
from checks import NAN, rng
from kalman.scenes import (
    EXACT,
    GIVEN,
    MODEL,
    MODELS,
    PRINTED,
    PRINTED_OR_EXACT,
    R,
    assert_covariance,
    assert_states,
    plots,
)
from reference import kalman as reference
from scipy import linalg

from tertia.kalman import AngleFilter, filter_series, smooth_series, steady_state


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
