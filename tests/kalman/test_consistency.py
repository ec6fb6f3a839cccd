"""Whether errors are as large as stated, and another library."""

import numpy as np
import pytest
from checks import NAN, rng
from kalman.scenes import BOTH, GIVEN, PRINTED_OR_EXACT, R, assert_states, plots, simulated
from scipy import stats
from tolerances import CHANCE, SMOOTHED, STATE

from tertia import metrics
from tertia.kalman import SingerModel, filter_series, smooth_series


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

    @pytest.mark.parametrize(
        ("method", "steps"),
        [
            (filter_series, [1, 2, 4, 10, 22, 40, 59]),
            (smooth_series, [0, 1, 3, 10, 21, 40, 59]),
        ],
        ids=["filter", "smoother"],
    )
    def test_states(self, run, method, steps):
        model, truth, z = run
        result = method(z, R, model)
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
