import re
from fractions import Fraction

import numpy as np
import pytest
from bearing.scenes import CLEAN, METHODS, record
from checks import assert_batch_is_loop, assert_refused, assert_threads, close, rng
from reference import bearing as reference
from tolerances import PARITY, PARITY_WITH_OFFSET, VECTOR

from tertia import estimate_bearing
from tertia.screening import critical_value
from tertia.simulate import direction_finder

BURST = np.ravel(
    [
        [10.3, 9.1, 10.8, 9.7, 10.5, 19.0, 9.4, 10.1, 11.2, 9.9, 8.8, 10.6, 14.2, 13.1, 14.9],
        [13.8, 14.4, 13.5, 10.2, 9.3, 10.9, 9.8, 11.0, 9.6, 10.4, 9.2, 10.7, 10.0, 9.5, 10.1],
    ]
)
BLOCKS = np.ravel(
    [
        [10.3, 9.6, 10.5, 9.8],
        [10.4, 10.1, 9.5, 10.2],
        [13.9, 14.3, 14.1, 13.6],
        [9.7, 10.0, 9.8, 10.1],
        [10.0, 6.5, 13.4, 9.8],
        [9.9, 10.6, 9.7, 10.3],
    ]
)
RECORDS = [(n, seed) for n in (12, 30, 47, 100, 203) for seed in range(8)]


# the last one may reject all blocks
VARIANCE_TESTS = ["cochran", 12.0, None, "student"]


def limit(test, size, significance=0.05):
    """The k2 of the reference for a `variance_test`."""
    words = {
        "cochran": {"significance": significance},
        "student": reference.student_factor(size, significance),
    }
    return words.get(test, test)


def turned(angle, period=360.0):
    """Within half a period of zero."""
    return (angle + period / 2) % period - period / 2


def check_estimate(theta, estimate, period=360.0):
    """What holds for every estimate, whatever the method."""
    theta = np.asarray(theta)
    batch = theta.shape[:-1]
    assert estimate.outlier.shape == theta.shape
    for field in (estimate.value, estimate.sigma, estimate.polarity):
        assert np.shape(field) == batch
        assert np.all(np.isfinite(field))
    assert np.all(estimate.sigma > 0)
    value = np.asarray(estimate.value)[..., None]
    if period is not None:
        assert np.all((value >= 0) & (value < period))
    side = np.sign(turned(theta - value, period) if period else theta - value)
    polarity = (side * estimate.outlier).mean(axis=-1)
    np.testing.assert_allclose(estimate.polarity, polarity, atol=1e-15)
    if estimate.block_weights is not None:
        np.testing.assert_allclose(estimate.block_weights.sum(axis=-1), 1.0, rtol=1e-14)
        assert np.all(estimate.block_weights >= 0)
        used = np.where(estimate.block_weights > 0, estimate.block_means, 0.0)
        mean = (estimate.block_weights * used).sum(axis=-1)
        error = turned(mean - value[..., 0], period) if period else mean - value[..., 0]
        np.testing.assert_allclose(error, 0.0, atol=1e-12 * (period or np.abs(mean).max()))


class TestVectors:
    def test_the_default_leaves_out_a_point_and_a_burst(self):
        estimate = estimate_bearing(BURST, period=None, block_size=5, correlation=0.0)
        assert estimate.outlier.nonzero()[0].tolist() == [5, 12, 13, 14, 15, 16, 17]
        # the mean of the others is 10.0478 ± 0.1477; sigma also allows for other hypotheses
        assert estimate.value == pytest.approx(10.0478, abs=0.01)
        assert 0.9 * 0.1477 < estimate.sigma < 1.25 * 0.1477

    @pytest.mark.parametrize("variance_test", ["cochran", 34.1188565541952])
    def test_the_paper_replaces_two_blocks(self, variance_test):
        """No single value is an outlier at k = 4, one mean and one variance are."""
        estimate = estimate_bearing(
            BLOCKS, period=None, method="paper", k=4.0, block_size=4, variance_test=variance_test
        )
        assert estimate.value == close(9.94980517130307)
        assert estimate.sigma == close(0.105587824271096)
        assert estimate.outlier.nonzero()[0].tolist() == [8, 9, 10, 11, 16, 17, 18, 19]
        assert 1 / (1 / estimate.block_variances).sum() == close(0.0111487886343038)
        assert estimate.block_weights[4] == estimate.block_weights[3]

    def test_intermediate_numbers_of_the_vectors(self):
        """V3: D before and after correction, F of the noisy block; V7: the start."""
        d = BLOCKS.reshape(6, 4).var(axis=1, ddof=1)
        assert 1 / (1 / d).sum() == close(0.0167163285407597)
        assert d[4] / np.delete(d, 4).mean() == close(64.925068119891)
        c = critical_value(6, 0.05, test="cochran", degrees_of_freedom=3)
        f = 5 * c / (1 - c)
        assert f == close(5.68647609236586)
        assert 6 * f == close(34.1188565541952)
        untested = estimate_bearing(
            BLOCKS, period=None, method="paper", k=4.0, block_size=4, variance_test=None
        )
        assert untested.sigma**2 == close(0.0167163285407597)
        assert untested.block_means[2] == close(10.01)
        deviation = np.abs(BURST - np.median(BURST))
        assert np.median(BURST) == close(10.35)
        assert 1.4826 * 30 / 29.2 * np.median(deviation) == close(1.066253424658)

    def test_students_quantile_rejects_a_clean_block_nearly_always(self):
        theta = record(100, 1, batch=300, **CLEAN)
        counts = {}
        for test in ("student", "cochran"):
            estimate = estimate_bearing(
                theta, period=None, method="paper", k=9.0, variance_test=test
            )
            counts[test] = estimate.outlier.any(axis=-1).mean()
        assert counts["student"] == 1.0
        assert counts["cochran"] < 0.12


@pytest.mark.parametrize(("n", "seed"), RECORDS)
class TestAgreesWithTheFormulas:
    def check(self, theta, expected, **options):
        estimate = estimate_bearing(theta, period=None, **options)
        check_estimate(theta, estimate, None)
        value, sigma, outlier = expected[:3]
        np.testing.assert_array_equal(estimate.outlier, outlier)
        assert (estimate.value, estimate.sigma) == close((value, sigma), PARITY)
        return estimate

    def test_mean(self, n, seed):
        theta = record(n, seed)
        expected = (*reference.mean(theta), np.zeros(n, dtype=bool))
        self.check(theta, expected, method="mean")

    def test_k_sigma(self, n, seed):
        theta = record(n, seed)
        self.check(theta, reference.k_sigma(theta, 2.1), method="k-sigma", k=2.1)

    @pytest.mark.parametrize("test", VARIANCE_TESTS, ids=str)
    @pytest.mark.parametrize("size", [4, 10])
    def test_paper(self, n, seed, size, test):
        theta = record(n, seed)
        expected = reference.paper(theta, 2.4, size, limit(test, size))
        options = {"method": "paper", "k": 2.4, "block_size": size, "variance_test": test}
        estimate = self.check(theta, expected, **options)
        mean, variance, weight = expected[3]
        np.testing.assert_allclose(estimate.block_means, mean, rtol=PARITY)
        np.testing.assert_allclose(estimate.block_variances, variance, rtol=PARITY)
        np.testing.assert_allclose(estimate.block_weights, weight, rtol=PARITY)

    @pytest.mark.parametrize("test", VARIANCE_TESTS[:3], ids=str)
    @pytest.mark.parametrize("size", [4, 10])
    def test_corrected(self, n, seed, size, test):
        theta = record(n, seed)
        options = {"method": "corrected", "k": 2.4, "block_size": size, "variance_test": test}
        expected = reference.corrected(theta, 2.4, size, 0.05, limit(test, size))
        estimate = self.check(theta, expected, **options)
        np.testing.assert_allclose(estimate.block_weights, expected[3], rtol=PARITY)

    @pytest.mark.parametrize("options", [{}, {"rounding": 1.0}, {"correlation": 0.2}], ids=str)
    def test_robust(self, n, seed, options):
        theta = record(n, seed)
        if "rounding" in options:
            theta = np.round(theta)
        found = reference.mixed(theta, **options)
        for size in (5, 10):
            expected = reference.in_blocks(found, size)
            estimate = self.check(theta, expected, block_size=size, **options)
            np.testing.assert_allclose(estimate.block_weights, expected[3], rtol=PARITY, atol=1e-12)

    def test_on_the_circle(self, n, seed):
        """Unwrapped, estimated, wrapped back, and the polarity of what was flagged."""
        theta = direction_finder(n, bearing=359.5, rng=seed).theta
        estimators = {
            "robust": lambda y: reference.robust(y, 5),
            "corrected": lambda y: reference.corrected(y, 2.5, 5, 0.05),
            "paper": lambda y: reference.paper(y, 2.5, 5, {"significance": 0.05}),
            "k-sigma": lambda y: reference.k_sigma(y, 2.5),
            "mean": lambda y: (*reference.mean(y), np.zeros(n, dtype=bool)),
        }
        for method, estimator in estimators.items():
            estimate = estimate_bearing(theta, method=method, block_size=5)
            # a choice that hangs on the last bit of the angles may fall either way (N = 100, the
            # second record): the result is exactly that of the angles rounded one way or the other
            rounded = [theta, *(theta + rng(k).uniform(-1e-13, 1e-13, n) for k in range(4))]
            choices = (reference.on_the_circle(estimator, one, 360.0) for one in rounded)
            same = (one for one in choices if estimate.sigma == close(one[1], PARITY))
            expected = next(same, None)
            assert expected, (method, estimate.sigma)
            assert turned(estimate.value - expected[0]) == pytest.approx(0, abs=1e-10)
            np.testing.assert_array_equal(estimate.outlier, expected[2])
            assert estimate.polarity == pytest.approx(expected[3], abs=1e-15)


HARD = {
    "fewest": np.array([1.0, 2.0, 4.5, 2.2, 1.1]),
    "offset": 1e9 + np.round(record(60, 1), 2),
    "outlier": np.r_[record(60, 2), 1e9],
    "two outliers": np.r_[1e9, record(60, 3), -7e8],
    "strided": record(120, 4)[::2],
    "reversed": record(45, 5)[::-1],
}


@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("method", METHODS)
def test_hard_samples_agree_with_the_formulas(method, name):
    y = HARD[name]
    none = np.zeros(len(y), dtype=bool)
    value, sigma, outlier = {
        "robust": lambda: reference.robust(y, 10),
        "corrected": lambda: reference.corrected(y, 2.5, 10, 0.05),
        "paper": lambda: reference.paper(y, 2.5, 10, {"significance": 0.05}),
        "k-sigma": lambda: reference.k_sigma(y, 2.5),
        "mean": lambda: (*reference.mean(y), none),
    }[method]()[:3]
    estimate = estimate_bearing(y, period=None, method=method)
    np.testing.assert_array_equal(estimate.outlier, outlier)
    tolerance = PARITY_WITH_OFFSET if name == "offset" else PARITY
    assert estimate.value == close(value, PARITY)
    assert estimate.sigma == close(sigma, tolerance)


def with_a_block_of_one():
    """Six blocks of four: of the first one value is left, the last one is noisy."""
    y = np.random.default_rng(3).normal(size=24)
    y[20:23] = [-6.0, 6.0, -5.0]
    y[:3] = [300.0, 305.0, 295.0]
    return y


@pytest.mark.parametrize("test", VARIANCE_TESTS, ids=str)
def test_a_block_of_one_value_does_not_stop_the_test_of_the_others(test):
    y = with_a_block_of_one()
    expected = reference.corrected(y, 3.0, 4, 0.05, limit(test, 4))
    estimate = estimate_bearing(
        y, period=None, method="corrected", k=3.0, block_size=4, variance_test=test
    )
    np.testing.assert_array_equal(estimate.outlier, expected[2])
    assert (estimate.value, estimate.sigma) == close(expected[:2], PARITY)


@pytest.mark.parametrize("method", METHODS)
class TestEveryMethod:
    def test_north_is_a_direction_like_any_other(self, method):
        """The same records about 180 degrees, 0 degrees and 90 degrees: the same errors."""
        errors = {}
        for true in (180.0, 0.0, 90.0):
            records = direction_finder(100, bearing=true, batch=500, rng=3)
            estimate = estimate_bearing(records.theta, method=method)
            check_estimate(records.theta, estimate)
            errors[true] = turned(estimate.value - true)
        np.testing.assert_allclose(errors[0.0], errors[180.0], atol=1e-9)
        np.testing.assert_allclose(errors[90.0], errors[180.0], atol=1e-9)
        # of 500 records; RMSE of the page on bearings
        rmse = {
            "robust": 0.386,
            "corrected": 0.478,
            "paper": 0.476,
            "k-sigma": 0.734,
            "mean": 0.956,
        }
        found = np.sqrt(np.mean(errors[0.0] ** 2))
        assert found == pytest.approx(rmse[method], rel=4 / np.sqrt(2 * 500))

    @pytest.mark.parametrize("turn", [1.0, 33.3, 201.7, 359.0])
    def test_turning_the_measurements_turns_the_bearing(self, method, turn):
        theta = direction_finder(100, bearing=20.0, batch=50, rng=12).theta
        plain = estimate_bearing(theta, method=method)
        found = estimate_bearing((theta + turn) % 360, method=method)
        np.testing.assert_allclose(turned(found.value - plain.value - turn), 0, atol=1e-9)
        np.testing.assert_allclose(found.sigma, plain.sigma, rtol=1e-9)
        np.testing.assert_array_equal(found.outlier, plain.outlier)

    def test_mirroring_the_measurements_mirrors_the_bearing(self, method):
        theta = record(100, 13, batch=50)
        plain, mirrored = (estimate_bearing(t, period=None, method=method) for t in (theta, -theta))
        np.testing.assert_allclose(mirrored.value, -plain.value, rtol=1e-12)
        np.testing.assert_allclose(mirrored.sigma, plain.sigma, rtol=1e-10)
        np.testing.assert_array_equal(mirrored.outlier, plain.outlier)
        np.testing.assert_allclose(mirrored.polarity, -plain.polarity, atol=1e-15)

    def test_the_unit_does_not_matter(self, method):
        theta = direction_finder(100, bearing=359.0, rng=4).theta
        degrees = estimate_bearing(theta, method=method)
        radians = estimate_bearing(np.radians(theta), period=2 * np.pi, method=method)
        assert np.degrees(radians.value) == close(degrees.value, 1e-10)
        assert np.degrees(radians.sigma) == close(degrees.sigma, 1e-10)
        np.testing.assert_array_equal(radians.outlier, degrees.outlier)

    def test_whole_turns_do_not_matter(self, method):
        theta = direction_finder(60, bearing=1.0, rng=5).theta
        turns = np.random.default_rng(6).integers(-3, 4, 60)
        plain, wound = (estimate_bearing(t, method=method) for t in (theta, theta + 360 * turns))
        assert turned(wound.value - plain.value) == pytest.approx(0, abs=1e-10)
        assert wound.sigma == close(plain.sigma, 1e-9)

    def test_without_a_period_an_offset_does_not_matter(self, method):
        theta = np.round(record(100, 7), 3)
        plain = estimate_bearing(theta, period=None, method=method)
        far = estimate_bearing(theta + 2.0**30, period=None, method=method)
        assert far.value - 2.0**30 == pytest.approx(plain.value, abs=3e-7)
        assert far.sigma == close(plain.sigma, 1e-6)
        np.testing.assert_array_equal(far.outlier, plain.outlier)

    def test_a_batch_is_its_rows_on_any_number_of_threads(self, method):
        theta = direction_finder(47, batch=(5, 40), rng=8).theta
        assert_threads(lambda **options: estimate_bearing(theta, method=method, **options))
        assert_batch_is_loop(lambda rows: estimate_bearing(rows, method=method), theta)
        assert_batch_is_loop(lambda row: estimate_bearing(row, method=method), theta[0])

    def test_missing_measurements_are_left_out(self, method):
        theta = direction_finder(47, bearing=10.0, rng=10).theta
        gaps = np.insert(theta, [0, 9, 30, 47], np.nan)
        there = ~np.isnan(gaps)
        expected = estimate_bearing(theta, method=method)
        found = estimate_bearing(gaps, method=method, nan_policy="omit")
        assert (found.value, found.sigma) == (expected.value, expected.sigma)
        np.testing.assert_array_equal(found.outlier[there], expected.outlier)
        assert not found.outlier[~there].any()
        assert found.polarity == expected.polarity
        with pytest.raises(ValueError, match=r"theta\[0\] is nan"):
            estimate_bearing(gaps, method=method)

    def test_no_rows(self, method):
        estimate = estimate_bearing(np.empty((0, 30)), method=method)
        assert estimate.value.shape == estimate.sigma.shape == (0,)

    def test_constant_records(self, method):
        estimate = estimate_bearing(np.full(30, 12.5), method=method)
        assert (estimate.value, estimate.sigma) == (12.5, np.inf if method == "robust" else 0.0)

    def test_one_enormous_value(self, method):
        theta = np.r_[record(60, 11, **CLEAN), 1e9]
        estimate = estimate_bearing(theta, period=None, method=method)
        if method != "mean":
            assert estimate.value == pytest.approx(50, abs=2)
            assert estimate.outlier[-1]

    def test_fewest_measurements(self, method):
        fewest = {"robust": 5, "mean": 2}.get(method, 3)
        estimate_bearing([10.0, 11.0, 12.0, 11.5, 10.5][:fewest], method=method)
        message = rf"theta has {fewest - 1} measurements?; at least {fewest} are needed"
        with pytest.raises(ValueError, match=message):
            estimate_bearing([10.0] * (fewest - 1), method=method)

    def test_a_nan_is_said_before_the_number_of_measurements(self, method):
        with pytest.raises(ValueError, match=r"theta\[0\] is nan; every measurement must"):
            estimate_bearing([np.nan], method=method)
        with pytest.raises(ValueError, match=r"theta\[1, 0\] is inf; every measurement must"):
            estimate_bearing([[1.0], [np.inf]], method=method)
        with pytest.raises(ValueError, match=r"theta\[1\] is inf; every measurement must"):
            estimate_bearing([np.nan, np.inf], method=method, nan_policy="omit")


class TestRoundedMeasurements:
    """Good measurements whose rounding is coarse relative to the noise."""

    @pytest.mark.parametrize("n", [30, 100])
    @pytest.mark.parametrize("seed", range(6))
    @pytest.mark.parametrize("rounding", [0.0, 1.0])
    def test_agrees_with_the_formulas(self, n, seed, rounding):
        theta = np.round(record(n, seed, sigma=0.4, amplitude=(10, 20)))
        expected = reference.robust(theta, 10, rounding=rounding)
        estimate = estimate_bearing(theta, period=None, rounding=rounding)
        np.testing.assert_array_equal(estimate.outlier, expected[2])
        assert (estimate.value, estimate.sigma) == close(expected[:2], PARITY)

    def test_constant_blocks_that_differ(self):
        """Half of the record one step higher: noise that lasts, and sigma says so."""
        estimate = estimate_bearing([10.0] * 50 + [11.0] * 50)
        assert estimate.value == pytest.approx(10.5, abs=0.2)
        assert 0.25 < estimate.sigma < 2.0
        assert estimate.correlation > 0.8

    def test_one_different_measurement_reveals_the_step(self):
        estimate = estimate_bearing([10.0] * 40 + [11.0] + [10.0] * 59)
        assert estimate.value == pytest.approx(10.0, abs=0.05)
        assert 1 / np.sqrt(12) < estimate.sigma < 0.4

    def test_a_stuck_instrument_has_no_sigma_unless_the_step_is_known(self):
        assert estimate_bearing([123.0] * 20).sigma == np.inf
        known = estimate_bearing([123.0] * 20, rounding=1.0)
        assert (known.value, known.sigma) == close((123.0, 1 / np.sqrt(12)))
        assert (known.effective_number, known.block_weights.sum()) == (1.0, 1.0)


class TestSystematicErrors:
    GROUPS = np.repeat(np.arange(8), 12)

    def records(self, size, count=300, seed=1):
        rng = np.random.default_rng(seed)
        return rng.normal(size=(count, 96)) + size * rng.normal(size=(count, 8))[:, self.GROUPS]

    def test_without_groups_it_is_not_included_and_that_is_printed(self):
        estimate = estimate_bearing(BURST)
        assert estimate.systematic == "not included"
        assert np.isnan(estimate.bias_sigma)
        assert repr(estimate).endswith("systematic error not included)")

    def test_a_number_is_added(self):
        plain, given, none, unknown = (
            estimate_bearing(BURST, bias_sigma=b) for b in (None, 0.3, 0.0, np.inf)
        )
        assert given.sigma == close(np.hypot(plain.sigma, 0.3))
        assert (none.sigma, unknown.sigma) == (plain.sigma, np.inf)
        assert given.systematic == none.systematic == "given"
        assert (given.bias_sigma, none.bias_sigma) == (0.3, 0.0)

    @pytest.mark.parametrize("size", [1.0, 3.0])
    def test_groups_that_differ(self, size):
        y = self.records(size)
        estimate = estimate_bearing(y, period=None, groups=self.GROUPS)
        assert estimate.systematic == "estimated"
        assert np.median(estimate.bias_sigma) == pytest.approx(size, rel=0.25)
        assert np.mean(np.abs(estimate.value) < 2 * estimate.sigma) > 0.95
        blind = estimate_bearing(y, period=None, correlation=0.0)
        assert np.mean(np.abs(blind.value) < 2 * blind.sigma) < 0.8

    def test_errors_that_last_from_group_to_group(self):
        rng = np.random.default_rng(15)
        walk = 0.3 * rng.normal(size=(200, 8)).cumsum(axis=1) + 2.0 * rng.normal(size=(200, 1))
        alike, mixed = np.sort(walk, axis=1), rng.permuted(walk, axis=1)
        noise = 0.05 * rng.normal(size=(200, 96))
        lasting, independent = (
            estimate_bearing(errors[:, self.GROUPS] + noise, period=None, groups=self.GROUPS)
            for errors in (alike, mixed)
        )
        assert np.median(lasting.sigma) > 1.5 * np.median(independent.sigma)

    def test_a_record_of_two_halves_does_not_tell_which_one_is_good(self):
        y = np.random.default_rng(16).normal(size=(100, 60))
        y[:, 30:] += 8.0
        estimate = estimate_bearing(y, period=None)
        assert np.median(estimate.sigma) > 1.0

    def test_a_size_that_is_given_averages_over_groups(self):
        y = self.records(2.0)
        estimate = estimate_bearing(y, period=None, groups=self.GROUPS, bias_sigma=2.0)
        expected = np.sqrt((2.0**2 + 1 / 12) / 8)
        assert np.median(estimate.sigma) == pytest.approx(expected, rel=0.05)
        assert 0.92 < np.mean(np.abs(estimate.value) < 2 * estimate.sigma) < 0.98
        small = estimate_bearing(y, period=None, groups=self.GROUPS, bias_sigma=0.1)
        assert np.median(small.pvalue) < 0.01
        assert np.median(small.sigma) > 2 * np.sqrt((0.1**2 + 1 / 12) / 8)

    def test_the_mean_of_the_groups_and_their_random_effects(self):
        """With so little noise the groups' means are known; SciPy computes the rest."""
        centre = np.array([10.0, 14.0, 9.0, 20.0])
        noise = np.random.default_rng(5).normal(size=(4, 50))
        noise -= noise.mean(axis=1, keepdims=True)
        y = (centre[:, None] + 1e-3 * noise).ravel()
        estimate = estimate_bearing(
            y, period=None, groups=np.repeat(list("abcd"), 50), correlation=0.0
        )
        mean, sigma, tau = reference.effects(centre, np.full(4, 1e-3 / np.sqrt(50)), 1e-3)
        _, inflation, _ = reference.correlated(centre, np.arange(4))
        assert estimate.value == pytest.approx(mean, rel=1e-3)
        assert estimate.sigma == pytest.approx(sigma * np.sqrt(inflation), rel=0.05)
        assert estimate.bias_sigma == pytest.approx(tau, rel=0.05)

    def test_outliers_within_groups(self):
        y = self.records(2.0, count=50)
        y[:, ::11] += 15.0
        estimate = estimate_bearing(y, period=None, groups=self.GROUPS)
        assert estimate.outlier[:, ::11].mean() > 0.95
        assert estimate.outlier.mean() < 0.12
        assert np.mean(np.abs(estimate.value) < 2 * estimate.sigma) > 0.9

    def test_labels_of_any_kind_and_gaps(self):
        y = self.records(2.0, count=3)
        names = np.array(list("hgfedcba"))[self.GROUPS]
        plain = estimate_bearing(y, period=None, groups=self.GROUPS)
        named = estimate_bearing(y, period=None, groups=np.broadcast_to(names, y.shape))
        np.testing.assert_allclose(named.value, plain.value, rtol=1e-9)
        np.testing.assert_allclose(named.sigma, plain.sigma, rtol=1e-9)
        gaps = np.insert(y, [0, 40], np.nan, axis=1)
        labels = np.insert(self.GROUPS, [0, 40], 99)
        found = estimate_bearing(gaps, period=None, groups=labels, nan_policy="omit")
        np.testing.assert_allclose(found.value, plain.value, rtol=1e-9)

    def test_one_group_and_as_many_as_measurements(self):
        one = estimate_bearing(BURST, groups=np.zeros(30))
        assert (one.systematic, one.sigma) == ("not included", estimate_bearing(BURST).sigma)
        each = estimate_bearing(BURST, groups=np.arange(30))
        assert each.systematic == "estimated"
        assert each.sigma == estimate_bearing(BURST, correlation=0.0).sigma


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"method": "x"}, ValueError, "method is 'x'; it must be 'robust'"),
        ({"method": None}, ValueError, "method is 'None'"),
        ({"period": 0}, ValueError, "period is 0; it must be a positive number"),
        ({"period": np.inf}, ValueError, "period is inf"),
        ({"period": "360"}, TypeError, "period is '360'"),
        ({"block_size": 1}, ValueError, "block_size is 1"),
        ({"block_size": 2.5}, TypeError, "block_size is 2.5"),
        ({"k": 0, "method": "paper"}, ValueError, "k is 0; it must be a positive number"),
        ({"k": np.nan, "method": "k-sigma"}, ValueError, "k is nan"),
        ({"variance_test": "x"}, ValueError, "variance_test is 'x'"),
        ({"variance_test": [1]}, TypeError, "variance_test is [1]"),
        ({"variance_test": 0.5, "method": "paper"}, ValueError, "variance_test is 0.5"),
        ({"significance": 0, "method": "corrected"}, ValueError, "significance is 0"),
        ({"significance": 1, "method": "paper"}, ValueError, "significance is 1"),
        ({"correlation": -1}, ValueError, "correlation is -1"),
        ({"rounding": np.nan}, ValueError, "rounding is nan"),
        ({"rounding": 1e-201}, ValueError, "rounding is"),
        ({"bias_sigma": -1}, ValueError, "bias_sigma is -1.0; it must be 0, a positive number or"),
        ({"bias_sigma": np.nan}, ValueError, "bias_sigma is nan"),
        ({"bias_sigma": "1"}, TypeError, "bias_sigma is '1'"),
        ({"groups": [1, 2]}, ValueError, "groups has shape (2,); it must be that of theta, (24,)"),
        ({"groups": [1] * 24, "method": "mean"}, ValueError, "groups need method='robust'"),
        ({"nan_policy": "drop"}, ValueError, "nan_policy is 'drop'"),
        ({"n_threads": -1}, ValueError, "n_threads is -1"),
    ],
)
def test_bad_parameters(options, error, message):
    assert_refused(lambda: estimate_bearing(BLOCKS, **options), error, message)


@pytest.mark.parametrize("rounding", [1e100, 1e150, 1e160, 1e300])
def test_an_enormous_resolution_is_an_error_or_an_estimate(rounding):
    try:
        estimate = estimate_bearing(BLOCKS, rounding=rounding)
    except ValueError as error:
        assert "rounding is" in str(error)  # noqa: PT017 - either is right
    else:
        assert np.isfinite([estimate.value, estimate.sigma]).all()
        assert np.isfinite(estimate.block_weights).all()


def test_where_no_block_has_two_values_left_the_error_says_so():
    """Three of five values are excluded: 9.9 and 9.8 are left, one to a block."""
    theta = [8.7, 9.9, 10.7, 9.8, 9.6]
    with pytest.raises(ValueError, match="block"):
        estimate_bearing(theta, period=None, method="corrected", block_size=2)


def test_a_bad_measurement_is_named_with_its_row():
    theta = np.ones((2, 3, 20))
    theta[1, 2, 7] = np.inf
    with pytest.raises(ValueError, match=r"theta\[1, 2, 7\] is inf"):
        estimate_bearing(theta)


def test_results_are_printed_usefully():
    estimate = estimate_bearing(BURST, period=None, bias_sigma=0.0)
    assert re.fullmatch(
        r"BearingEstimate\(10\.0\d* ± 0\.1\d*, outliers 7 of 30, polarity \+0\.233\)",
        repr(estimate),
    )
    batch = estimate_bearing(np.stack([BURST, BURST]))
    assert repr(batch).startswith("BearingEstimate(batch (2,), ")


@pytest.mark.parametrize("outlier", [1e9, 1e12, 1e16])
def test_a_block_of_hardly_any_weight_leaves_no_rounding(outlier):
    """Of five values nothing is flagged; the first block of two has a weight below 1e-17."""
    y = [outlier, 1.0, 2.0, -1.0, 0.5]
    estimate = estimate_bearing(y, period=None, block_size=2)
    pairs = zip(estimate.block_weights, estimate.block_means, strict=True)
    exact = sum(Fraction(float(w)) * Fraction(float(m)) for w, m in pairs)
    assert estimate.value == pytest.approx(float(exact), rel=VECTOR, abs=0)
