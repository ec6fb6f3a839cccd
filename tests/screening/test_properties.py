"""Whatever comes in: a result that makes sense or one clear error, no panic, no silent nan."""

import numpy as np
from checks import outcome
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import (
    BURST_OPTIONS,
    COUNTS,
    NUMBERS,
    POLICY,
    SAMPLES,
    THREADS,
    TIED,
    WORDS,
    assert_no_silent_nan,
)

from tertia import screening


@given(SAMPLES, THREADS)
def test_leave_one_out_statistics(y, n_threads):
    result = outcome(screening.leave_one_out_statistics, y, n_threads=n_threads)
    if result is not None:
        assert all(part.shape == y.shape for part in result)
        assert all(np.isfinite(part).all() for part in result)
        assert (result[1] >= 0).all()


@given(SAMPLES, NUMBERS, THREADS)
def test_leave_one_out_mask(y, k, n_threads):
    result = outcome(screening.leave_one_out_mask, y, k, n_threads=n_threads)
    assert result is None or result.shape == y.shape


@given(
    SAMPLES,
    NUMBERS,
    st.fixed_dictionaries(
        {
            "statistics": st.one_of(st.sampled_from(["sequential", "frozen"]), WORDS),
            "direction": st.one_of(st.sampled_from(["forward", "backward"]), WORDS),
            "replace": st.one_of(st.booleans(), WORDS),
            "passes": COUNTS,
            "nan_policy": POLICY,
            "n_threads": THREADS,
        }
    ),
)
def test_leave_one_out(y, k, options):
    result = outcome(screening.leave_one_out, y, k, **options)
    if result is not None:
        assert_no_silent_nan(result, np.isnan(y))


@given(SAMPLES, NUMBERS, st.one_of(st.sampled_from(["neighbours", "mean", None]), WORDS), POLICY)
def test_k_sigma(y, k, replace, nan_policy):
    result = outcome(screening.k_sigma, y, k, replace=replace, nan_policy=nan_policy)
    if result is not None:
        assert_no_silent_nan(result, np.isnan(y))


@given(SAMPLES, st.fixed_dictionaries({}, optional=BURST_OPTIONS))
def test_bursts(y, options):
    result = outcome(screening.bursts, y, **options)
    if result is not None:
        assert_no_silent_nan(result, np.isnan(y))


@given(SAMPLES, NUMBERS, THREADS)
def test_unwrap(theta, period, n_threads):
    result = outcome(screening.unwrap_about_median, theta, period, n_threads=n_threads)
    if result is not None:
        assert np.isfinite(result).all()
        spread = np.ptp(result, axis=-1) if theta.size else np.zeros(0)
        assert (spread <= 1.0000001 * period + 1e-6).all()


@given(SAMPLES, SAMPLES, SAMPLES)
def test_z_test(x, y, sigma):
    result = outcome(screening.z_test, x, y, np.abs(sigma))
    if result is not None:
        assert_no_silent_nan(result, None)
        assert (np.asarray(result.pvalue) <= 1).all()


@given(SAMPLES, SAMPLES)
def test_t_test(x, y):
    result = outcome(screening.t_test, x, y)
    if result is not None:
        assert_no_silent_nan(result, None)
        assert (np.asarray(result.pvalue) <= 1).all()


@given(SAMPLES)
def test_thompson_tau(y):
    result = outcome(screening.thompson_tau, y)
    if result is not None:
        assert_no_silent_nan(result, None)
        assert result.pvalue.shape == y.shape


@given(SAMPLES, NUMBERS)
def test_grubbs(y, significance):
    result = outcome(screening.grubbs, y, significance)
    if result is not None:
        assert_no_silent_nan(result, None)


@given(SAMPLES, NUMBERS, NUMBERS)
def test_cochran(variances, degrees_of_freedom, significance):
    result = outcome(screening.cochran, np.abs(variances), degrees_of_freedom, significance)
    if result is not None:
        assert_no_silent_nan(result, None)


TESTS = st.sampled_from(
    ["leave-one-out", "z-test", "t-test", "thompson-tau", "grubbs", "cochran", "x"]
)


@given(COUNTS, st.one_of(st.floats(0, 1), NUMBERS), TESTS, NUMBERS)
def test_critical_value(n, significance, test, degrees):
    options = {"test": test, "degrees_of_freedom": degrees if test == "cochran" else None}
    k = outcome(screening.critical_value, n, significance, **options)
    if k is not None:
        assert 0 < k < np.inf


@given(NUMBERS, COUNTS, TESTS, NUMBERS)
def test_false_alarm_probability(k, n, test, degrees):
    options = {"test": test, "degrees_of_freedom": degrees if test == "cochran" else None}
    p = outcome(screening.false_alarm_probability, k, n, **options)
    assert p is None or 0 <= p <= 1


@given(TIED, st.floats(0.5, 1e300))
@settings(max_examples=400)
def test_the_mask_is_that_of_the_frozen_rule(y, k):
    frozen = outcome(screening.leave_one_out, y, k, statistics="frozen", replace=True)
    mask = outcome(screening.leave_one_out_mask, y, k)
    if frozen is not None:
        np.testing.assert_array_equal(mask, frozen.outlier)
        assert np.isfinite(frozen.threshold)
        assert frozen.threshold > 0 or np.ptp(y) == 0 or np.ptp(frozen.cleaned) == 0
