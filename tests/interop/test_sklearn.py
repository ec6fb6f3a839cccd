"""Estimators of scikit-learn: its own checks, and what they say of recordings."""

import numpy as np
import pytest

pytest.importorskip("sklearn")

from sklearn.base import clone
from sklearn.impute import SimpleImputer
from sklearn.pipeline import make_pipeline
from sklearn.utils.estimator_checks import parametrize_with_checks

from tertia import screening, smoothing
from tertia.interop.sklearn import BandDetector, BurstDetector, Cleaner, Smoother


# one of the checks wants outliers in three wide clusters: only a sensitive detector sees any
@parametrize_with_checks(
    [
        BandDetector(significance=0.3),
        BurstDetector(point_penalty=0.5, burst_penalty=0.5),
        Cleaner(),
        Smoother(),
    ]
)
def test_checks_of_scikit_learn(estimator, check):
    check(estimator)


class TestBands:
    @pytest.mark.parametrize("n", [20, 200])
    def test_the_level_is_that_of_new_rows(self, n):
        rng = np.random.default_rng(n)
        significance, trials, new = 0.02, 250, 100
        found = [
            np.mean(
                BandDetector(significance)
                .fit(rng.normal(5, 3, (n, 3)))
                .predict(rng.normal(5, 3, (new, 3)))
                == -1
            )
            for _ in range(trials)
        ]
        error = np.std(found) / np.sqrt(trials)
        assert np.mean(found) == pytest.approx(significance, abs=3 * error + 0.1 * significance)

    def test_outliers_do_not_widen_the_band(self):
        rng = np.random.default_rng(3)
        X = rng.normal(size=(300, 2))
        clean = BandDetector().fit(X).half_width_
        X[::15] += [40.0, -300.0]
        found = BandDetector().fit(X)
        assert found.half_width_ == pytest.approx(clean, rel=0.1)
        assert np.array_equal(found.predict(X)[::15], np.full(20, -1))

    def test_missing_values_are_not_judged(self):
        X = np.random.default_rng(4).normal(size=(50, 2))
        plain = BandDetector().fit(X[1:])
        X[0] = np.nan
        found = BandDetector().fit(X)
        assert found.center_ == pytest.approx(plain.center_, rel=1e-12)
        assert found.predict([[np.nan, np.nan], [np.nan, 90.0]]).tolist() == [1, -1]

    def test_equal_values(self):
        found = BandDetector().fit(np.ones((9, 1)))
        assert found.predict([[1.0], [1.1]]).tolist() == [1, -1]

    @pytest.mark.parametrize("significance", [0.0, 1.0, np.nan])
    def test_a_level_is_between_0_and_1(self, significance):
        with pytest.raises(ValueError, match="it must be between 0 and 1"):
            Cleaner(significance).fit(np.ones((9, 1)))

    def test_a_column_without_measurements(self):
        with pytest.raises(ValueError, match="has 2 measurements; at least 3 are needed"):
            Cleaner().fit([[1.0, np.nan], [2.0, 1.0], [3.0, 2.0]])


class TestCleaner:
    def test_values_outside_become_nan_and_others_remain(self):
        X = np.random.default_rng(5).uniform(-1.0, 1.0, size=(100, 2))
        X[3, 0], X[8, 1] = 30.0, -30.0
        found = Cleaner().fit_transform(X)
        kept = np.abs(X) < 5
        assert np.array_equal(np.isnan(found), ~kept)
        assert np.array_equal(found[kept], X[kept])

    def test_in_a_pipeline(self):
        X = np.random.default_rng(6).normal(10.0, 1.0, size=(100, 1))
        X[3] = 1e6
        pipeline = make_pipeline(Cleaner(), SimpleImputer())
        found = clone(pipeline).fit_transform(X)
        assert found[3] == pytest.approx(np.mean(np.delete(X, 3)))
        assert pipeline.fit(X).transform([[1e9]]) == pytest.approx(found[3:4])


class TestPeriod:
    """Angles that cross north are as those that do not."""

    def angles(self, seed, n=200):
        return np.random.default_rng(seed).normal(0.0, 3.0, size=(n, 2))

    @pytest.mark.parametrize("turn", [0.0, 90.0, 359.0])
    def test_bands(self, turn):
        X = self.angles(1)
        X[7, 0], X[9, 1] = 60.0, -170.0
        plain = Cleaner().fit_transform(X)
        turned = Cleaner(period=360.0).fit_transform((X + turn) % 360.0)
        assert np.array_equal(np.isnan(turned), np.isnan(plain))
        assert np.isnan(plain).sum() >= 2
        rows = BandDetector().fit(X)
        others = BandDetector(period=360.0).fit((X + turn) % 360.0)
        assert np.array_equal(rows.predict(X), others.predict((X + turn) % 360.0))
        # other rows, too, however many turns they have
        new = self.angles(2)
        assert np.array_equal(rows.predict(new), others.predict(new + turn + 720.0))

    def test_smoothed(self):
        X = self.angles(3, 80) + np.linspace(0.0, 500.0, 80)[:, np.newaxis]
        X[4, 1] = np.nan
        plain = Smoother().fit(X)
        turned = Smoother(period=360.0).fit(X % 360.0)
        assert turned.embedding_ == pytest.approx(plain.embedding_ % 360.0, abs=1e-9, nan_ok=True)
        assert turned.sigma_ == pytest.approx(plain.sigma_, rel=1e-9, nan_ok=True)
        rates = Smoother(derivative=1, period=360.0).fit_transform(X % 360.0)
        assert rates == pytest.approx(
            Smoother(derivative=1).fit_transform(X), abs=1e-9, nan_ok=True
        )

    @pytest.mark.parametrize("period", [0.0, -1.0, np.inf])
    def test_a_period_is_positive(self, period):
        with pytest.raises(ValueError, match=r"period is .*; it must be positive and finite"):
            Cleaner(period=period).fit(np.ones((9, 1)))


def test_bursts_are_those_of_the_library():
    X = np.random.default_rng(7).normal(size=(120, 3))
    X[30:36, 1] += 5
    X[80, 2] -= 9
    X[5, 0] = np.nan
    detector = BurstDetector()
    found = detector.fit_predict(X)
    expected = screening.bursts(X.T, nan_policy="omit").outlier.T
    assert np.array_equal(detector.outlier_, expected)
    assert np.flatnonzero(found == -1).tolist() == np.flatnonzero(expected.any(axis=1)).tolist()
    assert set(range(30, 36)) | {80} <= set(np.flatnonzero(found == -1))
    assert not hasattr(detector, "predict")


def test_columns_are_smoothed_as_by_the_library():
    X = np.random.default_rng(8).normal(size=(60, 2)).cumsum(axis=0)
    smoother = Smoother(window=9, degree=2, derivative=1)
    found = smoother.fit_transform(X)
    for k in range(2):
        expected = smoothing.local_polynomial(X[:, k], 9, 2, derivative=1)
        assert np.array_equal(found[:, k], expected.value)
        assert np.array_equal(smoother.sigma_[:, k], expected.sigma)
    assert not hasattr(smoother, "transform")
