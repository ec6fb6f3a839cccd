"""Error bars of bearings: shares of many records that hold the truth."""

import numpy as np
import pytest
from bearing.scenes import CLEAN, METHODS, record
from checks import correlated
from scipy import stats

from tertia import estimate_bearing
from tertia.screening import critical_value


def quantised(n, seed, sigma, true, trials=1000):
    """Clean records, rounded to whole numbers."""
    return np.round(np.random.default_rng(seed).normal(true, sigma, (trials, n)))


@pytest.mark.parametrize("rounding", [0.0, 1.0])
@pytest.mark.parametrize("true", [10.2, 10.5])
@pytest.mark.parametrize("sigma", [0.3, 0.4, 0.5, 0.7, 1.0])
def test_the_error_bar_of_rounded_measurements_holds(sigma, true, rounding):
    """Good measurements whose rounding is coarse relative to the noise."""
    theta = quantised(100, 1, sigma, true)
    estimate = estimate_bearing(theta, period=None, rounding=rounding)
    assert np.mean(np.abs(estimate.value - true) < 2 * estimate.sigma) > 0.935
    assert np.all(estimate.sigma > 0)
    # what the rounding itself does to the mean of infinitely many readings
    readings = np.arange(30)
    edges = stats.norm.cdf(np.append(readings - 0.5, 29.5), true, sigma)
    expected = readings @ np.diff(edges)
    plain = estimate_bearing(theta, period=None, method="mean")
    rmse = [np.sqrt(np.mean((e.value - expected) ** 2)) for e in (estimate, plain)]
    assert rmse[0] < 1.12 * rmse[1]
    assert np.median(estimate.sigma) < 1.7 * np.hypot(rmse[0], expected - true)


@pytest.mark.parametrize("n", [100, 300])
@pytest.mark.parametrize("shape", [1.0, 2.0, 4.0, 10.0])
def test_the_error_bar_holds_with_skewed_noise(shape, n):
    """Whether the mean of gamma noise is meant or its mode, the data do not show."""
    noise = np.random.default_rng([5, n, int(shape)]).gamma(shape, 1.0, (200, n))
    estimate = estimate_bearing(noise - shape, period=None)
    # it was .21 to .94
    assert np.mean(np.abs(estimate.value) < 2 * estimate.sigma) > 0.87


class TestContamination:
    """Records of unit noise about 0, of which a share is off by a constant."""

    @staticmethod
    def records(n, share, sides, size, count, *, burst=False, seed=1):
        rng = np.random.default_rng([seed, n, int(100 * share), sides, int(size)])
        y, bad = rng.normal(size=(count, n)), round(share * n)
        for row in y:
            at = np.arange(bad) + rng.integers(n - bad + 1) if burst else rng.permutation(n)[:bad]
            row[at] += size * (1.0 if sides == 1 else rng.choice([-1.0, 1.0], bad))
        return y

    @staticmethod
    def others(y):
        """Mean, median, and the mean within three sigmas of the shorter half."""
        z = np.sort(y, axis=1)
        half = y.shape[1] // 2 + 1
        length = z[:, half - 1 :] - z[:, : y.shape[1] - half + 1]
        first = length.argmin(axis=1)
        centre = np.array([v[k : k + half].mean() for v, k in zip(z, first, strict=True)])
        near = np.abs(y - centre[:, None]) < 3 * length.min(axis=1)[:, None] / 1.349
        clipped = (y * near).sum(axis=1) / near.sum(axis=1)
        return y.mean(axis=1), np.median(y, axis=1), clipped

    @pytest.mark.parametrize("burst", [False, True], ids=["isolated", "burst"])
    @pytest.mark.parametrize("sides", [1, 2])
    @pytest.mark.parametrize("size", [3.0, 5.0, 8.0, 20.0])
    @pytest.mark.parametrize("share", [0.1, 0.4])
    @pytest.mark.parametrize(("n", "count"), [(10, 600), (100, 150)])
    def test_as_accurate_as_the_best_estimator(self, n, count, share, size, sides, burst):
        if burst and (share > 0.3 or sides == 2):
            pytest.skip("one burst on one side")
        y = self.records(n, share, sides, size, count, burst=burst)
        found = np.asarray(estimate_bearing(y, period=None).value)
        best = min(np.sqrt(np.mean(v**2)) for v in self.others(y))
        assert np.sqrt(np.mean(found**2)) < 1.25 * best * (1 + 3 / np.sqrt(2 * count))

    @pytest.mark.parametrize("share", [0.1, 0.2, 0.3])
    @pytest.mark.parametrize(("n", "count"), [(10, 800), (100, 300), (1000, 60)])
    def test_the_error_bar_holds(self, n, count, share):
        y = self.records(n, share, 1, 5.0, count)
        estimate = estimate_bearing(y, period=None)
        covered = np.mean(np.abs(estimate.value) < 2 * estimate.sigma)
        assert covered > 0.90 - 2 * np.sqrt(0.09 / count)

    def test_a_fifth_of_a_thousand_on_one_side(self):
        y = self.records(1000, 0.2, 1, 5.0, 20)
        estimate = estimate_bearing(180 + y)
        assert np.all(np.abs(estimate.value - 180) < 0.2)
        assert np.all(np.abs(estimate.polarity - 0.2) < 0.02)


def autoregressive(count, n, phi, seed):
    return correlated(np.random.default_rng(seed).normal(size=(count, n)), phi)


class TestCorrelation:
    @pytest.mark.parametrize(("n", "phi"), [(50, 0.3), (50, 0.8), (200, 0.5), (200, 0.9)])
    @pytest.mark.parametrize("outliers", [False, True])
    def test_it_is_found(self, n, phi, outliers):
        noise = autoregressive(500, n, phi, 1)
        if outliers:
            noise[:, 5 : n : n // 8] += 9.0
        estimate = estimate_bearing(noise, period=None)
        covered = np.mean(np.abs(estimate.value) < 2 * estimate.sigma)
        assert 0.90 < covered < 0.99
        assert np.mean(estimate.correlation) == pytest.approx(phi, abs=0.12)

    @pytest.mark.parametrize("method", METHODS)
    def test_a_number_is_counted_once(self, method):
        """Claimed over actual standard deviation, within 15 percent on either side."""
        if method == "paper":
            return
        noise = autoregressive(1000, 300, 0.5, 2)
        estimate = estimate_bearing(noise, period=None, method=method, correlation=0.5, k=5.0)
        ratio = np.sqrt(np.mean(np.square(estimate.sigma))) / np.std(estimate.value)
        assert 0.87 < ratio < 1.15
        assert np.all(np.asarray(estimate.correlation) == 0.5)

    def test_none_widens_nothing(self):
        noise = autoregressive(500, 100, 0.0, 3)
        white, found = (
            np.asarray(estimate_bearing(noise, period=None, correlation=c).sigma)
            for c in (0.0, None)
        )
        assert 0.97 < np.median(found / white) < 1.05

    def test_effective_number(self):
        white = estimate_bearing(autoregressive(100, 100, 0.0, 4), period=None)
        lasting = estimate_bearing(autoregressive(100, 100, 0.8, 4), period=None)
        # sigma allows for outliers too
        assert 60 < np.median(white.effective_number) < 100
        # N (1 − φ)/(1 + φ) = 11
        assert 4 < np.median(lasting.effective_number) < 16


class TestErrorBars:
    """Share of 20 000 records whose error is below 2 sigma; its own standard error is .0016."""

    trials = 20_000
    error = 0.0016

    def coverage(self, n=100, seed=0, outliers=None, **options):
        theta = record(n, seed, batch=self.trials, **(outliers or {}))
        estimate = estimate_bearing(theta, period=None, **options)
        return np.mean(np.abs(estimate.value - 50) < 2 * estimate.sigma)

    @pytest.mark.parametrize("n", [50, 100, 400])
    @pytest.mark.parametrize("outliers", [CLEAN, {}], ids=["clean", "PS1"])
    def test_robust(self, n, outliers):
        """Doubtful outliers and correlations widen sigma."""
        theta = record(n, 0, batch=2000, **outliers)
        estimate = estimate_bearing(theta, period=None)
        covered = np.mean(np.abs(estimate.value - 50) < 2 * estimate.sigma)
        assert 0.935 < covered < 0.99

    @pytest.mark.parametrize("n", [5, 10, 20, 30])
    def test_robust_short(self, n):
        theta = record(n, 0, batch=3000, **CLEAN)
        estimate = estimate_bearing(theta, period=None)
        assert 0.95 < np.mean(np.abs(estimate.value - 50) < 2 * estimate.sigma) < 0.999

    @pytest.mark.parametrize(
        ("outliers", "least", "most"), [(CLEAN, 0.908, 0.930), ({}, 0.905, 0.946)]
    )
    @pytest.mark.parametrize("block_size", [5, 10])
    def test_corrected(self, outliers, least, most, block_size):
        found = self.coverage(
            200, outliers=outliers, method="corrected", block_size=block_size, k=2.4
        )
        assert least - 4 * self.error < found < most + 4 * self.error

    @pytest.mark.parametrize("n", [10, 100])
    def test_mean_of_clean_records_follows_student(self, n):
        expected = {10: 0.92345, 100: 0.95177}[n]  # P(|t| < 2) with n - 1 degrees of freedom
        found = self.coverage(n, outliers=CLEAN, method="mean")
        assert found == pytest.approx(expected, abs=4 * 0.0019)

    @pytest.mark.parametrize(
        ("block_size", "outliers", "expected"),
        [(5, CLEAN, 0.873), (5, {}, 0.770), (10, CLEAN, 0.998), (10, {}, 0.993)],
    )
    def test_the_printed_sigma_does_not_hold(self, block_size, outliers, expected):
        """(7), k2 = L F: too small with blocks of 5, too large with blocks of 10."""
        blocks = 100 // block_size
        c = critical_value(blocks, 0.05, test="cochran", degrees_of_freedom=block_size - 1)
        found = self.coverage(
            outliers=outliers,
            method="paper",
            block_size=block_size,
            k=2.4,
            variance_test=blocks * c * (blocks - 1) / (1 - c),
        )
        error = np.sqrt(2 * expected * (1 - expected) / self.trials)
        assert found == pytest.approx(expected, abs=4 * error)

    @pytest.mark.parametrize(("outliers", "expected"), [(CLEAN, 0.933), ({}, 0.818)])
    def test_k_sigma_does_not_hold_with_bursts(self, outliers, expected):
        """What the documentation says of it: screening by deviation leaves bursts in."""
        found = self.coverage(outliers=outliers, method="k-sigma")
        assert found == pytest.approx(expected, abs=4 * 0.0027)
