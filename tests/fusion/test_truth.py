"""Series of plots, fused: against truth, by simulation."""

from functools import lru_cache
from typing import get_args

import numpy as np
import pytest
from checks import rng
from fusion.scenes import METHODS, MODEL, bounds_of_nees, nees
from scipy import stats
from tolerances import CHANCE

from tertia.fusion import fuse_series
from tertia.kalman import SingerModel
from tertia.simulate import ScenarioName, radar_scenario, radars

RUNS = 500


@lru_cache
def record_of(kind):
    """Matched model; from scan 60 on radar 2 is 5 times noisier, or has outliers up to 80."""
    sigma, wrong = np.full((2, 120), 0.1), np.zeros((2, 120))
    if kind == "noisier":
        sigma[1, 60:] = 0.5
    elif kind == "outliers":
        wrong[1, 60:80] = 0.3
    return radars(MODEL, 120, sigma=sigma, outlier_probability=wrong, batch=RUNS, rng=21)


@lru_cache
def fused(kind, method):
    return fuse_series(record_of(kind).z, 0.01, MODEL, method=method)


def mean_nees(kind, method, at):
    """Averaged over these steps of each run, which are not independent, then over the runs."""
    record, result = record_of(kind), fused(kind, method)
    each = np.mean([nees(result, record.truth, k) for k in at], axis=0)
    return each.mean(), each.std() / np.sqrt(RUNS)


def rmse(kind, method, at):
    error = fused(kind, method).mean[:, at, 0] - record_of(kind).truth[:, at, 0]
    return np.sqrt(np.mean(error**2))


class TestMonteCarlo:
    @pytest.mark.parametrize(
        "method",
        [name for name in METHODS if name not in {"ewma", "paper", "covariance-intersection"}],
    )
    @pytest.mark.parametrize("at", [59, 119])
    def test_honest(self, method, at):
        low, high = bounds_of_nees(RUNS)
        assert low < mean_nees("healthy", method, [at])[0] < high

    @pytest.mark.parametrize("method", ["ewma", "paper"])
    def test_honest_with_weights_that_depend_on_the_plots(self, method):
        """Not exactly, for they are no constants; little of it is left over many steps."""
        found, error = mean_nees("healthy", method, range(30, 120))
        assert found == pytest.approx(1, abs=0.03 + 3 * error)

    def test_intersection_is_a_bound(self):
        found, error = mean_nees("healthy", "covariance-intersection", range(30, 120))
        assert found + 2.6 * error <= 1

    @pytest.mark.parametrize(
        ("method", "expected"),
        [
            ("equal", 63.9),
            ("static", 63.9),
            ("posterior", 63.9),
            ("paper", 76.4),
            ("ewma", 65.6),
            ("matrix", 63.9),
            ("covariance-intersection", 63.9),
            ("adaptive", 64.4),
            ("adaptive-matrix", 64.6),
            ("central", 63.0),
            ("robust", 63.0),
        ],
    )
    def test_the_errors_of_healthy_radars(self, method, expected):
        """Of an independent simulation, in thousandths; 1000 runs there. "robust": as "central"."""
        found = 1000 * rmse("healthy", method, range(20, 120))
        assert found == pytest.approx(expected, rel=0.02)

    def test_a_noisier_radar_is_found(self):
        after = range(80, 120)
        for method in ("adaptive", "adaptive-matrix"):
            assert mean_nees("noisier", method, after)[0] <= 1.2
        for method in ("equal", "posterior", "central"):
            assert mean_nees("noisier", method, after)[0] > 3
        result = fused("noisier", "adaptive")
        # innovations of a filter with too large a gain speak of more noise than there is
        assert 0.25 < np.median(result.noise_variance[:, 1, 90:]) < 1
        assert (result.noise_variance[:, 0, 90:] == 0.01).mean() > 0.9
        assert np.median(result.weights[:, 1, 90:, 0]) < 0.25
        assert rmse("noisier", "adaptive", after) < rmse("noisier", "equal", after) / 1.8

    def test_outliers_are_found(self):
        within = range(60, 80)
        for method in ("adaptive", "adaptive-matrix"):
            assert rmse("outliers", method, within) < rmse("outliers", "equal", within) / 1.8
        result, record = fused("outliers", "adaptive"), record_of("outliers")
        # one of 15 sigma is below the gate of 4 S^(1/2) with the chance .4
        assert (result.outlier & record.outlier).sum() / record.outlier.sum() > 0.35
        assert result.outlier[:, :, :60].mean() < 0.001

    def test_robust_finds_the_noise(self):
        after = range(70, 120)
        assert mean_nees("noisier", "robust", after)[0] <= 1.1
        noise = fused("noisier", "robust").noise_variance
        # levels are powers of 4
        assert 0.12 < np.median(noise[:, 1, 90:]) < 0.5
        assert 0.007 < np.median(noise[:, 0, 90:]) < 0.014
        assert rmse("noisier", "robust", range(20, 120)) < 1.02 * rmse(
            "noisier", "adaptive", range(20, 120)
        )

    def test_robust_forgets_outliers(self):
        within, after = range(60, 80), range(80, 90)
        assert rmse("outliers", "robust", within) < 0.95 * rmse("outliers", "adaptive", within)
        assert rmse("outliers", "robust", after) < 1.08 * rmse("healthy", "robust", after)
        assert mean_nees("outliers", "robust", range(60, 90))[0] < 1.05
        result, record = fused("outliers", "robust"), record_of("outliers")
        assert (result.outlier & record.outlier).sum() / record.outlier.sum() > 0.25
        assert result.outlier[:, :, :60].mean() < 0.001

    @pytest.mark.parametrize("k", [1, 3])
    def test_robust_with_outliers_anywhere(self, k):
        # one radar: a median of 6.5 if outliers are of 16 sigma; three: an RMSE of .36
        record = radars(
            MODEL,
            120,
            sigma=np.full((k, 120), 0.1),
            outlier_probability=0.1,
            outlier_size=300.0,
            batch=200,
            rng=24,
        )
        result = fuse_series(record.z, 0.01, MODEL)
        late = np.s_[:, 20:]
        error = (result.mean - record.truth)[late][..., 0]
        # the state may have begun with an outlier if there is only one radar
        assert np.sqrt(np.median(np.mean(error**2, axis=1))) < 0.12
        squares = error**2 / result.covariance[late][..., 0, 0]
        assert np.mean(squares < 3.84) > 0.93
        if k > 1:
            assert np.sqrt(np.mean(error**2)) < 0.1

    def test_first_plots_that_contradict_each_other(self):
        z = np.full((3, 20), 10.0)
        z[2] = 190.0
        with pytest.warns(UserWarning, match="radar 2 contradict"):
            result = fuse_series(z, 0.25, MODEL, period=360.0)
        assert np.all(np.abs(result.mean[:, 0] - 10.0) < 0.1)
        np.testing.assert_array_equal(result.outlier[:, 0], [False, False, True])
        # any of two may be wrong
        with pytest.warns(UserWarning, match="the other radar may be the wrong one"):
            result = fuse_series(z[1:], 0.25, MODEL, period=360.0)
        assert not result.outlier[:, 0].any()
        away = np.abs((result.mean[0, 0] - np.array([10.0, 190.0]) + 180.0) % 360.0 - 180.0)
        assert np.all(away < 1.1 * result.sigma[0, 0])
        # as before, where they agree
        z[2] = 10.4
        result = fuse_series(z[1:], 0.25, MODEL, period=360.0)
        assert result.sigma[0, 0] == pytest.approx(np.sqrt(0.125))

    def test_robust_costs_nothing_where_all_is_well(self):
        at = range(20, 120)
        assert rmse("healthy", "robust", at) < 1.015 * rmse("healthy", "central", at)
        assert rmse("healthy", "robust", at) < rmse("healthy", "equal", at)

    def test_robust_finds_a_better_radar(self):
        record = radars(MODEL, 120, sigma=[0.05, 0.2], batch=200, rng=23)
        result = fuse_series(record.z, 0.01, MODEL)
        noise = np.median(result.noise_variance[..., 60:], axis=(0, 2))
        assert noise[0] < 0.006
        assert noise[1] > 0.03
        error = result.mean[:, 20:, 0] - record.truth[:, 20:, 0]
        other = fuse_series(record.z, 0.01, MODEL, method="adaptive")
        of_other = other.mean[:, 20:, 0] - record.truth[:, 20:, 0]
        assert np.mean(error**2) < np.mean(of_other**2)

    @pytest.mark.parametrize("k", [3, 5])
    def test_robust_with_two_bad_radars(self, k):
        """Of three they are the majority."""
        sigma = np.full((k, 120), 0.1)
        sigma[1:3, 60:] = 0.5
        record = radars(MODEL, 120, sigma=sigma, batch=200, rng=24)
        errors = {}
        for method in ("robust", "adaptive"):
            result = fuse_series(record.z, 0.01, MODEL, method=method)
            error = result.mean[:, 70:, 0] - record.truth[:, 70:, 0]
            errors[method] = np.sqrt(np.mean(error**2))
        assert errors["robust"] < errors["adaptive"] * (0.75 if k == 3 else 1.0)
        robust = fuse_series(record.z, 0.01, MODEL)
        assert np.mean([nees(robust, record.truth, at) for at in range(70, 120)]) < 1.15

    def test_robust_follows_a_manoeuvre(self):
        record = radars(MODEL, 120, turn=(60, 78, 2.0), batch=100, rng=22)
        turning = slice(62, 76)
        errors = {}
        for method in ("robust", "central"):
            result = fuse_series(record.z, 0.01, MODEL, method=method)
            error = result.mean[:, turning, 0] - record.truth[:, turning, 0]
            errors[method] = np.sqrt(np.mean(error**2))
            if method == "robust":
                assert (result.noise_variance[..., turning] > 0.02).mean() < 0.05
                assert np.abs(result.weights[..., turning, 0] - 0.5).mean() < 0.1
        assert errors["robust"] < errors["central"] / 2

    def test_a_manoeuvre_accuses_nobody(self):
        record = radars(MODEL, 120, turn=(60, 78, 2.0), batch=100, rng=22)
        assert np.ptp(record.truth[0, :, 0]) > 80
        result = fuse_series(record.z, 0.01, MODEL, method="adaptive")
        turning = slice(62, 76)
        nis = result.innovation[..., turning] ** 2 / result.innovation_variance[..., turning]
        assert nis.mean() > 3
        assert (result.noise_variance[..., turning] > 0.01).mean() < 0.2
        assert np.abs(result.weights[..., turning, 0] - 0.5).mean() < 0.1


MOTIONS = {
    "usual": MODEL,
    "restless": SingerModel(5.0, 1 / 10, 0.03, exact=True),
    "more restless": SingerModel(8.0, 1 / 15, 0.02, exact=True),
    "quiet": SingerModel(3.0, 1 / 40, 0.0005, exact=True),
}
FEW_RUNS = 150


@lru_cache
def scenario_of(motion, name):
    at = list(get_args(ScenarioName)).index(name)
    return radar_scenario(name, model=MOTIONS[motion], batch=FEW_RUNS, rng=rng([50, at]))


@lru_cache
def track_of(motion, name, method):
    s = scenario_of(motion, name)
    return fuse_series(s.z, s.measurement_variance, s.model, method=method)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", get_args(ScenarioName))
def test_robust_is_near_the_best_rule(motion, name):
    s = scenario_of(motion, name)
    errors = {
        method: np.sqrt(
            np.mean((track_of(motion, name, method).mean - s.truth)[:, s.counted, 0] ** 2)
        )
        for method in METHODS
    }
    assert errors["robust"] <= 1.08 * min(errors.values())


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", ["healthy", "noisy", "outliers"])
def test_robust_is_honest_for_every_motion(motion, name):
    s, result = scenario_of(motion, name), track_of(motion, name, "robust")
    each = np.mean([nees(result, s.truth, at) for at in range(70, 120)], axis=0)
    if name == "healthy":
        assert abs(each.mean() - 1) < stats.norm.isf(CHANCE / 2) * each.std() / np.sqrt(FEW_RUNS)
    else:
        assert each.mean() <= 1.2


@pytest.mark.parametrize("motion", ["restless", "more restless"])
def test_a_contradiction_is_resolved(motion):
    """Two radars contradict each other, and the prediction is worth little."""
    noisy = track_of(motion, "noisy", "robust")
    assert (noisy.weights[:, 1, 80:, 0] > 0.5).mean() < 0.01
    assert np.median(noisy.noise_variance[:, 0, 80:]) < 0.02
    assert np.median(noisy.noise_variance[:, 1, 80:]) > 0.1
