import numpy as np
import pytest
from checks import (
    assert_batch_is_loop,
    assert_refused,
    assert_result,
    assert_threads,
    close,
    fields,
    rng,
)
from reference import screening as reference
from tolerances import DISTRIBUTION, PARITY, PARITY_WITH_OFFSET

from tertia import screening

SAMPLE = [12.4, 11.8, 40.0, 12.1, 12.9, 11.5, 20.0, 12.2, 12.0, 11.9]
OTHERS = [10.1, 9.8, 10.3, 10.0, 9.9]
REPLACEMENTS = ["neighbours", "mean", None]
RULES = [
    {"statistics": statistics, "direction": direction, "replace": replace, "passes": passes}
    for statistics in ("sequential", "frozen")
    for direction in ("forward", "backward")
    for replace in (True, False)
    for passes in (1, 3)
]


def with_outliers(n, seed=0):
    y = rng(seed).normal(size=n)
    if n >= 10:
        y[[n // 3, n // 2]] += [6, -8]
    if n >= 30:
        y[n // 4 : n // 4 + 5] += 5
    return y


KINDS = {
    "random": with_outliers(50),
    "constant": np.full(12, 4.0),
    "constant but one": np.r_[np.full(12, 4.0), 9.0],
    "three": np.array([1.0, 2.0, 4.5]),
    "five": np.array([1.0, 2.0, 4.5, 2.2, 1.1]),
    "offset": 1e9 + with_outliers(60, seed=1),
    "outlier": np.r_[with_outliers(40, seed=2), 1e9],
    "two outliers": np.r_[1e9, with_outliers(40, seed=3), -7e8],
    "strided": with_outliers(120, seed=4)[::2],
    "reversed": with_outliers(45, seed=5)[::-1],
    "whole numbers": np.round(10 * with_outliers(40, seed=6)),
}


@pytest.fixture(params=KINDS, ids=str)
def kind(request):
    return request.param


def tolerance(kind):
    return PARITY_WITH_OFFSET if kind == "offset" else PARITY


def assert_close(actual, expected, kind):
    scale = np.nanmax(np.abs(expected)) * 1e-13
    np.testing.assert_allclose(actual, expected, rtol=tolerance(kind), atol=scale)


def check_screening(y, result):
    """What holds for every screening, whatever the rule."""
    y = np.asarray(y, dtype=float)
    assert result.outlier.shape == result.cleaned.shape == y.shape
    assert result.outlier.dtype == bool
    np.testing.assert_array_equal(result.cleaned[~result.outlier], y[~result.outlier])
    batch = y.shape[:-1]
    for field in (result.mean, result.variance, result.threshold):
        assert np.shape(field) == batch
        assert np.all(np.isfinite(field))
    if batch == ():
        assert isinstance(result.mean, float)
    kept = result.cleaned
    np.testing.assert_allclose(result.mean, np.nanmean(kept, axis=-1), rtol=1e-12, atol=1e-12)
    # less an offset, which would cost NumPy its digits
    spread = np.nanvar(kept - np.nanmedian(kept, axis=-1, keepdims=True), axis=-1, ddof=1)
    np.testing.assert_allclose(result.variance, spread, rtol=PARITY, atol=1e-25)
    assert np.all(result.variance >= 0)
    assert np.all(result.threshold >= 0)


def check_extreme(test, significance):
    """What holds for every test of an extreme, batched."""
    assert np.all((test.pvalue >= 0) & (test.pvalue <= 1))
    np.testing.assert_array_equal(test.outlier, test.statistic > test.critical_value)
    np.testing.assert_array_equal(test.outlier, test.pvalue < significance)


class TestLeaveOneOutStatistics:
    def test_vector(self):
        mean, variance = screening.leave_one_out_statistics(SAMPLE)
        assert mean[[2, 6]] == close([12.9777777777778, 15.2])
        assert variance[[2, 6]] == close([7.08944444444444, 86.645])

    def test_agrees_with_leaving_out(self, kind):
        y = KINDS[kind]
        mean, variance = screening.leave_one_out_statistics(y)
        expected = reference.leave_one_out_statistics(y)
        np.testing.assert_allclose(mean, expected[0], rtol=tolerance(kind))
        np.testing.assert_allclose(variance, expected[1], rtol=tolerance(kind), atol=1e-25)


class TestLeaveOneOut:
    def test_forward_finds_more_than_backward_in_the_vector(self):
        forward = screening.leave_one_out(SAMPLE)
        assert forward.outlier.nonzero()[0].tolist() == [2, 6]
        assert forward.cleaned[6] == close(12.1975308641975)
        assert forward.mean == close(12.1975308641975)
        assert forward.variance == close(0.213875933546715)
        backward = screening.leave_one_out(SAMPLE, direction="backward")
        assert backward.outlier.nonzero()[0].tolist() == [2]

    def test_frozen_vector(self):
        frozen = screening.leave_one_out(SAMPLE, statistics="frozen")
        assert frozen.outlier.nonzero()[0].tolist() == [2]
        assert frozen.mean == close(12.9777777777778)

    @pytest.mark.parametrize("rule", RULES, ids=str)
    @pytest.mark.parametrize("k", [1.8, 2.5, 3.3])
    def test_agrees_with_leaving_out(self, kind, rule, k):
        y = KINDS[kind]
        if k == 1.8 and rule["passes"] > 1 and rule["replace"]:
            with pytest.raises(ValueError, match="it must be at least"):
                screening.leave_one_out(y, k, **rule)
            return
        result = screening.leave_one_out(y, k, **rule)
        outlier, cleaned = reference.leave_one_out(y, k, **rule)
        check_screening(y, result)
        np.testing.assert_array_equal(result.outlier, outlier)
        assert_close(result.cleaned, cleaned, kind)

    def test_the_direction_changes_what_is_found_in_clean_records(self):
        y = rng(1).normal(size=(4000, 100))
        forward = screening.leave_one_out(y).outlier
        backward = screening.leave_one_out(y, direction="backward").outlier
        differ = (forward != backward).any(axis=-1).mean()
        assert differ == pytest.approx(0.39, abs=4 * np.sqrt(0.39 * 0.61 / 4000))

    @pytest.mark.parametrize("m", [14, 15])
    def test_masking_limit(self, m):
        """Of 100 values, 14 equal one-sided errors are all caught at k = 2.5, 15 are not."""
        y = np.r_[np.full(100 - m, 0.0), np.full(m, 1.0)]
        all_caught = (100 - m) * 98 / ((m - 1) * 99) > 2.5**2
        assert screening.leave_one_out_mask(y, 2.5).sum() == (m if all_caught else 0)
        assert all_caught == (m == 14)

    def test_repeated_passes_that_eat_the_sample_are_refused(self):
        with pytest.raises(ValueError, match=r"k is 2\.4; it must be at least 2\.5"):
            screening.leave_one_out(SAMPLE, 2.4, passes=2)
        with pytest.raises(ValueError, match=r"k is 1\.7; it must be at least 1\.7321"):
            screening.leave_one_out(SAMPLE, 1.7, passes=2, replace=False)
        screening.leave_one_out(SAMPLE, 2.5, passes=2)
        screening.leave_one_out(SAMPLE, 1.74, passes=2, replace=False)

    def test_threshold_is_the_half_width_that_was_applied(self):
        y = with_outliers(50)
        result = screening.leave_one_out(y, statistics="frozen")
        outside = np.abs(y - y.mean()) > result.threshold
        np.testing.assert_array_equal(result.outlier, outside)


class TestMask:
    def test_is_that_of_the_frozen_rule(self, kind):
        y = KINDS[kind]
        for k in (1.5, 2.5, 3.0):
            frozen = screening.leave_one_out(y, k, statistics="frozen", replace=False)
            np.testing.assert_array_equal(screening.leave_one_out_mask(y, k), frozen.outlier)

    @pytest.mark.parametrize("n", [2048, 2049, 10_000, 100_001])
    @pytest.mark.parametrize("drift", [0.0, 4.0, -40.0])
    def test_long_samples_are_marked_with_the_final_band(self, n, drift):
        y = rng(n).normal(size=n) + drift * np.linspace(0, 1, n) ** 2
        y[n // 2] = 1e6
        mean, variance = screening.leave_one_out_statistics(y)
        expected = np.abs(mean - y) > 2.5 * np.sqrt(variance)
        np.testing.assert_array_equal(screening.leave_one_out_mask(y), expected)

    @pytest.mark.parametrize(
        ("k", "n", "c"),
        [
            (2.5, 10, 1.82867074599221),
            (2.5, 100, 2.41259815842282),
            (2.2, 20, 1.91640848227267),
            (3.0, 100, 2.85801748775974),
            (2.5, 5, 1.4142135623731),
        ],
    )
    def test_threshold_is_c_times_the_standard_deviation(self, k, n, c):
        y = rng(n).normal(size=n)
        result = screening.leave_one_out(y, k, statistics="frozen")
        assert result.threshold / y.std(ddof=1) == close(c)


class TestFrozenRule:
    """The leave-one-out rule with frozen statistics is a k-sigma rule with another threshold."""

    @pytest.mark.parametrize("n", [3, 4, 10, 30])
    def test_the_mask_is_that_of_really_leaving_out(self, n):
        """40 000 records in all, the others of each value summed anew."""
        y = rng(n).normal(size=(10_000, n))
        y[::3, 0] += 5
        rest = np.stack([np.delete(y, i, axis=1) for i in range(n)], axis=1)
        for k in (1.5, 2.5, 3.0):
            expected = np.abs(rest.mean(axis=2) - y) > k * rest.std(axis=2, ddof=1)
            np.testing.assert_array_equal(screening.leave_one_out_mask(y, k), expected)

    @pytest.mark.parametrize(("n", "k"), [(10, 1.8), (30, 2.5), (100, 2.2), (100, 3.0)])
    def test_equal_errors_mask_each_other_as_the_formula_says(self, n, k):
        """All caught if and only if (N - m)(N - 2) > k^2 (m - 1)(N - 1)."""
        for m in range(2, n // 2):
            y = np.r_[np.zeros(n - m), np.ones(m)]
            caught = (n - m) * (n - 2) / ((m - 1) * (n - 1)) > k**2
            assert screening.leave_one_out_mask(y, k).sum() == (m if caught else 0), m

    def test_mean_and_variance_of_the_vector(self):
        whole = screening.k_sigma(SAMPLE, 10.0)
        assert (whole.mean, whole.variance) == close((15.68, 79.3217777777778))
        frozen = screening.leave_one_out(SAMPLE, statistics="frozen")
        assert frozen.cleaned[2] == close(12.9777777777778)

    @pytest.mark.parametrize("significance", [0.05, 0.01, 0.001])
    @pytest.mark.parametrize("n", [4, 10, 100])
    def test_its_exact_level_is_that_of_the_t_test(self, n, significance):
        """k = t sqrt(N/(N-1)) is (R3) with n = N - 1: the two papers' tests are one."""
        k = screening.critical_value(n, significance)
        assert k == close(screening.critical_value(n - 1, significance, test="t-test"))


class TestTinyThresholds:
    @pytest.mark.parametrize("k", [1e-150, 1e-162, 5e-324])
    @pytest.mark.parametrize("replace", [True, False])
    def test_no_band_is_nan(self, k, replace):
        result = screening.leave_one_out(OTHERS, k, replace=replace)
        assert np.isfinite([result.mean, result.variance, result.threshold]).all()


class TestEnormousThresholds:
    @pytest.mark.parametrize("k", [1e10, 1e153, 1e154, 1e300, 1.7e308])
    def test_nothing_is_flagged(self, k):
        y = [1.0, 2.0, 3.0, 4.0]
        assert not screening.leave_one_out_mask(y, k).any()
        result = screening.leave_one_out(y, k)
        assert not result.outlier.any()
        # c(k, N) tends to (N - 1)/sqrt(N)
        assert result.threshold == close(3 / 2 * np.std(y, ddof=1))


class TestKSigma:
    @pytest.mark.parametrize("replace", REPLACEMENTS)
    @pytest.mark.parametrize("k", [1.2, 2.1, 3.0])
    def test_agrees_with_the_formula(self, kind, replace, k):
        y = KINDS[kind]
        outlier, cleaned = reference.k_sigma(y, k, replace)
        result = screening.k_sigma(y, k, replace=replace)
        check_screening(y, result)
        np.testing.assert_array_equal(result.outlier, outlier)
        assert_close(result.cleaned, cleaned, kind)
        assert result.threshold == pytest.approx(k * y.std(ddof=1), rel=tolerance(kind), abs=1e-25)


class TestSingleValues:
    def test_vectors(self):
        known = screening.z_test(12.6, OTHERS, 1.0)
        assert (known.statistic, known.pvalue) == close((2.35520699727221, 0.0185123900893096))
        unknown = screening.t_test(10.8, OTHERS)
        expected = (4.05502691029828, 0.0208041639652686)
        assert (unknown.statistic, unknown.pvalue) == close(expected)

    def test_z_test_agrees_and_broadcasts(self):
        x, y, sigma = rng().normal(size=(4, 1)), rng(1).normal(size=(3, 9)), 0.7
        test = screening.z_test(x, y, sigma)
        assert test.statistic.shape == test.pvalue.shape == (4, 3)
        for i, j in np.ndindex(4, 3):
            expected = reference.z_test(x[i, 0], y[j], sigma)
            assert (test.statistic[i, j], test.pvalue[i, j]) == close(expected, DISTRIBUTION)

    def test_t_test_agrees_and_broadcasts(self):
        x, y = rng().normal(size=3), rng(1).normal(size=(3, 9))
        test = screening.t_test(x, y)
        for j in range(3):
            expected = reference.t_test(x[j], y[j])
            assert (test.statistic[j], test.pvalue[j]) == close(expected, DISTRIBUTION)

    @pytest.mark.parametrize(
        "kind", [kind for kind in KINDS if "constant" not in kind and "outlier" not in kind]
    )
    def test_thompson_and_grubbs_agree(self, kind):
        y = KINDS[kind]
        exact = y - np.round(y.mean())  # where the reference has all its digits
        tau, p = reference.thompson_tau(exact)
        test = screening.thompson_tau(y)
        np.testing.assert_allclose(test.statistic, tau, rtol=tolerance(kind), atol=1e-12)
        np.testing.assert_allclose(test.pvalue, p, rtol=1e-8)
        index, statistic, pvalue = reference.grubbs(exact)
        most = screening.grubbs(y)
        assert most.index == index
        assert most.statistic == pytest.approx(statistic, rel=tolerance(kind))
        assert most.pvalue == pytest.approx(pvalue, rel=1e-8)
        assert most.outlier == (most.pvalue < 0.05)

    def test_an_enormous_outlier_has_a_p_value(self):
        y = KINDS["outlier"]
        assert screening.grubbs(y).index == 40
        assert 0 < screening.grubbs(y).pvalue < 1e-100

    def test_many_values_against_one_sample(self):
        """The others are averaged once, not once per value."""
        x, y = rng(8).normal(size=300_000), rng(9).normal(size=10_000)
        test = screening.t_test(x, y)
        assert test.pvalue[7] == screening.t_test(x[7], y).pvalue
        assert test.pvalue.shape == x.shape

    def test_enormous_variances(self):
        assert screening.cochran([1e308] * 5, 3).statistic == close(0.2)

    def test_cochran_vector_and_formula(self):
        rows = """
            10.3 9.6 10.5 9.8    10.4 10.1 9.5 10.2    13.9 14.3 14.1 13.6
            9.7 10.0 9.8 10.1    10.0 6.5 13.4 9.8    9.9 10.6 9.7 10.3
        """
        groups = np.array(rows.split(), dtype=float)
        variances = groups.reshape(6, 4).var(axis=1, ddof=1)
        test = screening.cochran(variances, 3)
        assert test.index == 4
        assert test.statistic == close(0.928494885533366)
        assert test.critical_value == close(0.532118917706477)
        assert test.pvalue == close(reference.cochran(variances, 3)[2], DISTRIBUTION)
        assert test.outlier is True


class TestLevels:
    @pytest.mark.parametrize(
        ("test", "n", "expected"),
        [
            ("t-test", 5, (3.04144322758327, 5.04353323586447, 9.43211280608767)),
            ("t-test", 10, (2.37257044829424, 3.40845627111966, 5.01426342245262)),
            ("thompson-tau", 10, (1.79841000495057, 2.17606839419422, 2.48208324971533)),
            ("grubbs", 10, (2.28995408447960, 2.48208324971533, 2.64499101841336)),
            ("grubbs", 100, (3.38408290115489, 3.75400437210403, 4.21592393869695)),
        ],
    )
    def test_printed_critical_values(self, test, n, expected):
        levels = (0.05, 0.01, 0.001)
        found = [screening.critical_value(n, significance, test=test) for significance in levels]
        assert found == close(expected)

    @pytest.mark.parametrize("significance", [0.5, 0.05, 1e-3, 1e-6])
    @pytest.mark.parametrize("n", [3, 4, 10, 100, 5000])
    @pytest.mark.parametrize(
        "test", ["z-test", "t-test", "leave-one-out", "thompson-tau", "grubbs"]
    )
    def test_critical_values_agree_and_invert(self, test, n, significance):
        k = screening.critical_value(n, significance, test=test)
        assert k == close(reference.critical_value(n, significance, test), DISTRIBUTION)
        # tau near its largest value (n - 1)/sqrt(n) holds few digits of the probability
        room = 1 - n * k**2 / (n - 1) ** 2 if test in {"thompson-tau", "grubbs"} else 1.0
        tolerance = max(DISTRIBUTION, 1e-15 / room)
        assert screening.false_alarm_probability(k, n, test=test) == close(significance, tolerance)

    @pytest.mark.parametrize("nu", [1, 3, 9.5, 200])
    def test_cochran_critical_values_agree_and_invert(self, nu):
        options = {"test": "cochran", "degrees_of_freedom": nu}
        c = screening.critical_value(6, 0.05, **options)
        assert c == close(reference.critical_value(6, 0.05, "cochran", nu), DISTRIBUTION)
        assert screening.false_alarm_probability(c, 6, **options) == close(0.05, DISTRIBUTION)

    @pytest.mark.parametrize(
        ("test", "n", "expected"),
        [
            # Cauchy: P(|t| > x) = 2/(pi x) there
            ("t-test", 2, 2 / np.pi * 1e200 * np.sqrt(1.5)),
            ("leave-one-out", 3, 2 / np.pi * 1e200 * np.sqrt(1.5)),
            # the largest value that tau can have
            ("thompson-tau", 3, 2 / np.sqrt(3)),
            ("grubbs", 3, 2 / np.sqrt(3)),
        ],
    )
    def test_far_tails(self, test, n, expected):
        k = screening.critical_value(n, 1e-200, test=test)
        assert k == close(expected)
        if test == "t-test":
            assert screening.false_alarm_probability(k, n, test=test) == close(1e-200)

    def test_printed_false_alarm_probabilities(self):
        assert screening.false_alarm_probability(2.5, 10) == close(0.0451259354468073)
        assert screening.false_alarm_probability(2.5, 100) == close(0.0145542424390225)

    @pytest.mark.parametrize(("k", "n"), [(2.5, 10), (2.5, 100), (3.0, 30)])
    def test_clean_samples_raise_as_many_false_alarms_as_promised(self, k, n):
        trials = 200_000 // n
        alarms = screening.leave_one_out_mask(rng(n).normal(size=(trials, n)), k)
        expected = screening.false_alarm_probability(k, n)
        error = np.sqrt(expected / (trials * n))
        assert alarms.mean() == pytest.approx(expected, abs=4 * error)

    def test_grubbs_and_cochran_keep_their_level(self):
        trials, significance = 20_000, 0.05
        error = np.sqrt(significance * (1 - significance) / trials)
        y = rng(2).normal(size=(trials, 12))
        assert screening.grubbs(y, significance).outlier.mean() == pytest.approx(
            significance, abs=4 * error
        )
        variances = rng(3).chisquare(9, size=(trials, 10))
        rejected = screening.cochran(variances, 9, significance).outlier.mean()
        assert rejected == pytest.approx(significance, abs=4 * error)

    def test_p_values_of_clean_values_are_uniform(self):
        x, y = rng(4).normal(size=20_000), rng(5).normal(size=(20_000, 6))
        for p in (screening.z_test(x, y, 1.0).pvalue, screening.t_test(x, y).pvalue):
            distance = np.abs(np.sort(p) - np.linspace(0, 1, p.size)).max()
            assert distance < 1.95 / np.sqrt(p.size)  # Kolmogorov, 0.1 %

    def test_p_values_of_single_values_of_a_clean_sample_are_uniform(self):
        """Of one value per sample, chosen beforehand."""
        p = screening.thompson_tau(rng(6).normal(size=(20_000, 7))).pvalue[:, 3]
        distance = np.abs(np.sort(p) - np.linspace(0, 1, p.size)).max()
        assert distance < 1.95 / np.sqrt(p.size)  # Kolmogorov, 0.1 %

    @pytest.mark.parametrize("significance", [0.01, 0.05, 0.1])
    def test_decisions_and_p_values_agree(self, significance):
        y = rng(10).normal(size=(2000, 9))
        for test in (screening.grubbs(y, significance), screening.cochran(y**2, 1, significance)):
            check_extreme(test, significance)


class TestBursts:
    @pytest.mark.parametrize(
        "options",
        [
            {},
            {"point_penalty": 2.0, "burst_penalty": 2.5},
            {"min_burst": 3, "max_burst": 7},
            {"correlation": 0.4},
            {"correlation": -0.3, "rounding": 0.5},
        ],
        ids=str,
    )
    def test_agrees_with_the_recursion(self, kind, options):
        y = KINDS[kind]
        names = {
            "point_penalty": "bp",
            "burst_penalty": "bc",
            "min_burst": "lmin",
            "max_burst": "lmax",
        }
        named = {names.get(name, name): value for name, value in options.items()}
        outlier, centre, scale = reference.bursts(y, **named)
        result = screening.bursts(y, **options)
        check_screening(y, result)
        np.testing.assert_array_equal(result.outlier, outlier)
        if not outlier.any() and "constant" in kind:
            return
        assert result.mean == pytest.approx(centre, rel=tolerance(kind))
        penalty = options.get("point_penalty", 2.5) * np.log(max(len(y), 30))
        expected = np.sqrt(penalty) * scale
        assert result.threshold == pytest.approx(expected, rel=tolerance(kind), abs=1e-12)

    @pytest.mark.parametrize("seed", range(20))
    def test_agrees_on_random_records(self, seed):
        y = with_outliers(rng(seed).integers(5, 150), seed)
        np.testing.assert_array_equal(screening.bursts(y).outlier, reference.bursts(y)[0])

    def test_false_alarms_of_clean_records(self):
        """At N = 100: the rate of the documentation."""
        flagged = screening.bursts(rng(7).normal(size=(5000, 100))).outlier.mean()
        assert flagged == pytest.approx(0.006, abs=0.0012)

    def test_correlated_noise_is_not_a_burst_if_its_correlation_is_given(self):
        y = rng(8).normal(size=(400, 200))
        for t in range(1, 200):
            y[:, t] += 0.6 * y[:, t - 1]
        blind = screening.bursts(y).outlier.mean()
        aware = screening.bursts(y, correlation=0.6).outlier.mean()
        assert blind > 0.1
        assert aware < 0.0015


class TestUnwrap:
    @pytest.mark.parametrize("period", [360.0, 2 * np.pi, 1.0])
    @pytest.mark.parametrize("centre", [0.0, 0.25, 0.499, 0.75])
    def test_agrees_with_the_formula(self, period, centre):
        turns = centre + 0.05 * rng(1).normal(size=101)
        turns[:30] += 0.25
        theta = (turns % 1.0) * period
        found = screening.unwrap_about_median(theta, period)
        np.testing.assert_allclose(
            found, reference.unwrap_about_median(theta, period), atol=1e-12 * period
        )
        assert np.ptp(found) < period

    def test_the_median_holds_with_49_percent_of_outliers(self):
        theta = np.r_[rng(2).normal(0, 1, 51), rng(3).normal(120, 1, 49)] % 360
        assert abs(np.median(screening.unwrap_about_median(theta))) < 5

    def test_measurements_near_enough_come_back_bit_for_bit(self):
        theta = 200 + 30 * rng(4).normal(size=50)
        np.testing.assert_array_equal(screening.unwrap_about_median(theta), theta)
        np.testing.assert_array_equal(screening.unwrap_about_median(theta - 720), theta - 720)


FUNCTIONS = {
    "leave_one_out_statistics": screening.leave_one_out_statistics,
    "leave_one_out_mask": screening.leave_one_out_mask,
    "leave_one_out": screening.leave_one_out,
    "leave_one_out excluding": lambda y, **kw: screening.leave_one_out(y, replace=False, **kw),
    "frozen": lambda y, **kw: screening.leave_one_out(y, statistics="frozen", **kw),
    "k_sigma": screening.k_sigma,
    "bursts": screening.bursts,
    "unwrap_about_median": screening.unwrap_about_median,
    "thompson_tau": screening.thompson_tau,
    "grubbs": screening.grubbs,
    "cochran": lambda y, **kw: screening.cochran(np.abs(y), 5.0, **kw),
    "z_test": lambda y, **kw: screening.z_test(1.5, y, 2.0, **kw),
    "t_test": lambda y, **kw: screening.t_test(1.5, y, **kw),
}
THREADED = list(FUNCTIONS)[:8]


@pytest.mark.parametrize("name", FUNCTIONS)
class TestEveryFunction:
    def test_a_batch_is_its_rows(self, name):
        y = rng(1).normal(size=(2, 3, 40)) * 3
        assert_batch_is_loop(FUNCTIONS[name], y)
        assert_batch_is_loop(FUNCTIONS[name], y[0])

    def test_no_rows(self, name):
        for field, array in fields(FUNCTIONS[name](np.empty((0, 10)))).items():
            assert field == "critical_value" or array.shape[0] == 0

    @pytest.mark.parametrize(
        ("y", "error", "message"),
        [
            ([], ValueError, "has 0 measurements; at least"),
            (1.0, ValueError, "is a single number"),
            ([1.0, 2.0, np.nan, 4.0], ValueError, r"\[2\] is nan"),
            ([1.0, np.inf, 3.0, 4.0], ValueError, r"\[1\] is inf"),
            ([[1.0, 2.0, 3.0], [1.0, 2.0, np.nan]], ValueError, r"\[1, 2\] is nan"),
            (["1", "2", "3"], TypeError, "it must hold real numbers"),
            ([1.0, "x", 3.0], TypeError, "it must hold real numbers"),
            ([1j, 2.0, 3.0], TypeError, "it must hold real numbers"),
            ([True, False, True], TypeError, "it must hold real numbers"),
            (np.array([1.0, {}, 3.0], dtype=object), TypeError, r"\[1\] is \{\}"),
            (np.array(["2026-01-01"], dtype="M8[D]"), TypeError, "it must hold real numbers"),
        ],
    )
    def test_bad_samples(self, name, y, error, message):
        with pytest.raises(error, match=message):
            CALLS.get(name, FUNCTIONS[name])(y)


CALLS = {"cochran": lambda y: screening.cochran(y, 5.0)}


@pytest.mark.parametrize("name", THREADED)
def test_threads_do_not_change_a_bit(name):
    y = rng(6).normal(size=(300, 200)) * 3
    assert_threads(lambda **options: FUNCTIONS[name](y, **options))


@pytest.mark.parametrize("name", THREADED)
def test_threads_report_the_first_bad_row(name):
    y = rng(7).normal(size=(300, 50))
    y[[120, 250], 3] = np.nan
    for n_threads in (1, 4):
        with pytest.raises(ValueError, match=r"\[120, 3\] is nan"):
            FUNCTIONS[name](y, n_threads=n_threads)


@pytest.mark.parametrize("name", ["leave_one_out", "frozen", "k_sigma", "bursts"])
def test_missing_measurements_are_left_out(name):
    function = FUNCTIONS[name]
    y = with_outliers(60)
    gaps = np.insert(y, [0, 20, 20, 60], np.nan)
    there = ~np.isnan(gaps)
    expected, found = function(y), function(gaps, nan_policy="omit")
    np.testing.assert_array_equal(found.outlier[there], expected.outlier)
    np.testing.assert_array_equal(found.cleaned[there], expected.cleaned)
    assert not found.outlier[~there].any()
    assert np.isnan(found.cleaned[~there]).all()
    assert (found.mean, found.variance, found.threshold) == (
        expected.mean,
        expected.variance,
        expected.threshold,
    )
    with pytest.raises(ValueError, match=r"y\[0\] is nan"):
        function(gaps)
    gaps[40] = np.inf
    with pytest.raises(ValueError, match=r"y\[40\] is inf"):
        function(gaps, nan_policy="omit")


def test_masked_measurements_are_missing():
    y = np.ma.masked_greater([1.0, 2.0, 99.0, 1.5], 50)
    with pytest.raises(ValueError, match=r"y\[2\] is nan"):
        screening.k_sigma(y)
    assert screening.k_sigma(y, nan_policy="omit").mean == 1.5


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: screening.leave_one_out([1, 2]), ValueError, "y has 2 measurements; at least 3"),
        *(
            (lambda rule=rule: rule([1.0, np.nan]), ValueError, "y[1] is nan; every")
            for rule in (
                screening.leave_one_out,
                screening.leave_one_out_mask,
                screening.leave_one_out_statistics,
                screening.thompson_tau,
                screening.grubbs,
                screening.bursts,
            )
        ),
        (lambda: screening.leave_one_out(SAMPLE, 0), ValueError, "k is 0; it must be a positive"),
        (lambda: screening.leave_one_out(SAMPLE, -1), ValueError, "k is -1"),
        (lambda: screening.leave_one_out(SAMPLE, np.nan), ValueError, "k is nan"),
        (lambda: screening.leave_one_out(SAMPLE, np.inf), ValueError, "k is inf"),
        (lambda: screening.leave_one_out(SAMPLE, "2"), TypeError, "k is '2'"),
        (lambda: screening.leave_one_out_mask(SAMPLE, "2"), TypeError, "k is '2'"),
        (lambda: screening.leave_one_out_mask(SAMPLE, -2), ValueError, "k is -2"),
        (lambda: screening.leave_one_out(SAMPLE, statistics="x"), ValueError, "statistics is 'x'"),
        (lambda: screening.leave_one_out(SAMPLE, direction=1), ValueError, "direction is '1'"),
        (lambda: screening.leave_one_out(SAMPLE, passes=0), ValueError, "passes is 0"),
        (lambda: screening.leave_one_out(SAMPLE, passes=1.5), TypeError, "passes is 1.5"),
        (lambda: screening.leave_one_out(SAMPLE, nan_policy="x"), ValueError, "nan_policy is 'x'"),
        (lambda: screening.leave_one_out(SAMPLE, n_threads=0), ValueError, "n_threads is 0"),
        (lambda: screening.k_sigma(SAMPLE, replace="x"), ValueError, "replace is 'x'"),
        (lambda: screening.k_sigma([0, 0, 1, 1], 0.5), ValueError, "only 0 of 4 measurements"),
        (lambda: screening.bursts(SAMPLE, min_burst=1), ValueError, "min_burst is 1"),
        (lambda: screening.bursts(SAMPLE, max_burst=10**6), ValueError, "max_burst is 1000000"),
        (
            lambda: screening.bursts(SAMPLE, min_burst=9, max_burst=8),
            ValueError,
            "max_burst is 8; it must be at least min_burst",
        ),
        (lambda: screening.bursts(SAMPLE, correlation=1), ValueError, "correlation is 1"),
        (lambda: screening.bursts(SAMPLE, rounding=-1), ValueError, "rounding is -1"),
        (lambda: screening.bursts(SAMPLE, point_penalty=0), ValueError, "point_penalty is 0"),
        (lambda: screening.z_test(1, SAMPLE, 0), ValueError, "sigma is 0"),
        (lambda: screening.z_test(np.nan, SAMPLE, 1), ValueError, "x is nan; it must be a"),
        (lambda: screening.z_test([1, np.nan], SAMPLE, 1), ValueError, "x[1] is nan"),
        (lambda: screening.leave_one_out({1: 2}), TypeError, "y is {1: 2}"),
        (lambda: screening.k_sigma(SAMPLE, nan_policy=["omit"]), ValueError, "nan_policy is"),
        (lambda: screening.unwrap_about_median([1, 2], 1e308), ValueError, "period is 1e308"),
        (lambda: screening.z_test([1, 2], [SAMPLE] * 3, 1), ValueError, "do not fit together"),
        (lambda: screening.grubbs(SAMPLE, 0), ValueError, "significance is 0"),
        (lambda: screening.grubbs(SAMPLE, 1e-300), ValueError, "significance is 1e-300"),
        (lambda: screening.grubbs(np.empty((0, 2))), ValueError, "y has 2 measurements"),
        (lambda: screening.cochran([1, -2], 3), ValueError, "variances[1] is -2"),
        (lambda: screening.cochran([0, 0], 3), ValueError, "largest of variances is 0; it must be"),
        (lambda: screening.cochran([1, 2], 0.5), ValueError, "degrees_of_freedom is 0.5"),
        (lambda: screening.critical_value(2, 0.05), ValueError, "n is 2; it must be at least 3"),
        (lambda: screening.critical_value(-5, 0.05), ValueError, "n is -5"),
        (lambda: screening.critical_value(5.5, 0.05), TypeError, "n is 5.5"),
        (lambda: screening.critical_value(10, 0.05, test="x"), ValueError, "test is 'x'"),
        (lambda: screening.critical_value(10, 0.05, test="cochran"), ValueError, "needs degrees"),
        (lambda: screening.false_alarm_probability(-1, 10), ValueError, "k is -1"),
        (
            lambda: screening.false_alarm_probability(1, 10, degrees_of_freedom=3),
            ValueError,
            "goes with test='cochran' only",
        ),
        (lambda: screening.unwrap_about_median([1, 2], 0), ValueError, "period is 0"),
        (
            lambda: screening.unwrap_about_median([1e300, 2]),
            ValueError,
            "theta[0] is 1e300; every angle",
        ),
        (lambda: screening.leave_one_out([[1, 2, 3], [1, 2]]), ValueError, "y is ragged"),
        (lambda: screening.k_sigma([1e200, -1e200, 0]), ValueError, "change the unit"),
    ],
)
def test_bad_parameters(call, error, message):
    assert_refused(call, error, message)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda y: screening.leave_one_out_mask(y, -1), "k is -1"),
        (lambda y: screening.leave_one_out(y, -1), "k is -1"),
        (lambda y: screening.k_sigma(y, -1), "k is -1"),
        (lambda y: screening.unwrap_about_median(y, -1), "period is -1"),
        (lambda y: screening.cochran(y, -1), "degrees_of_freedom is -1"),
        (lambda y: screening.z_test(1.0, y, -1), "sigma is -1"),
        (lambda y: screening.grubbs(y, 2), "significance is 2"),
    ],
)
def test_bad_parameters_of_no_rows(call, message):
    """A wrong parameter does not wait for the first row."""
    with pytest.raises(ValueError, match=message):
        call(np.empty((0, 30)))


@pytest.mark.parametrize("replace", [np.array([1, 2]), "no"], ids=["array", "word"])
def test_replace_is_true_or_false(replace):
    with pytest.raises((TypeError, ValueError), match="replace is"):
        screening.leave_one_out(SAMPLE, replace=replace)


def test_results_are_printed_usefully():
    assert repr(screening.leave_one_out(SAMPLE)).startswith("Screening(outliers 2 of 10, mean 12")
    assert repr(screening.leave_one_out([SAMPLE] * 3)) == (
        "Screening(outliers 6 of 30, batch (3,))"
    )


@pytest.mark.parametrize("y", [SAMPLE, [SAMPLE] * 3], ids=["one", "batch"])
def test_results_are_frozen(y):
    assert_result(screening.leave_one_out(y))
    assert_result(screening.thompson_tau(y))
    assert_result(screening.grubbs(y))
