"""Whatever comes in: an estimate that makes sense or one clear error, no panic, no silent nan."""

import numpy as np
from checks import outcome
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import COUNTS, NUMBERS, SAMPLES, TIED, assert_no_silent_nan

from tertia import estimate_bearing


@given(
    SAMPLES,
    st.sampled_from(["robust", "corrected", "paper", "k-sigma", "mean", "x", None]),
    st.fixed_dictionaries(
        {},
        optional={
            "correlation": st.one_of(st.none(), NUMBERS),
            "sigma": st.one_of(st.none(), NUMBERS),
            "rounding": NUMBERS,
            "bias_sigma": st.one_of(st.none(), NUMBERS),
            "period": st.one_of(st.sampled_from([None, 360.0, 2 * np.pi]), NUMBERS),
            "block_size": COUNTS,
            "k": NUMBERS,
            "variance_test": st.one_of(st.sampled_from(["cochran", "student", None, "x"]), NUMBERS),
            "significance": NUMBERS,
        },
    ),
)
@settings(max_examples=600)
def test_estimate_bearing(theta, method, options):
    estimate = outcome(estimate_bearing, theta, method=method, **options)
    if estimate is None:
        return
    # documented: empty blocks have no mean, blocks of one no variance; nothing to compare with
    blocks = ("block_means", "block_variances", "block_weights")
    allowed = (*blocks, "pvalue", "correlation", "effective_number", "bias_sigma", "noise_factor")
    assert_no_silent_nan(estimate, None, allowed)
    assert (np.asarray(estimate.sigma) >= 0).all()
    assert np.isfinite(estimate.value).all()
    if estimate.block_weights is not None:
        np.testing.assert_allclose(estimate.block_weights.sum(axis=-1), 1.0, rtol=1e-12)


VALID = st.fixed_dictionaries(
    {
        "method": st.sampled_from(["robust", "corrected", "paper", "k-sigma", "mean"]),
        "period": st.sampled_from([None, 360.0]),
        "block_size": st.integers(2, 25),
        "k": st.floats(0.5, 1e300),
        "variance_test": st.sampled_from(["cochran", "student", None, 1.0, 30.0]),
        "significance": st.floats(1e-6, 0.5),
        "correlation": st.one_of(st.none(), st.floats(-0.9, 0.9)),
        "rounding": st.sampled_from([0.0, 0.5, 1.0, 100.0]),
    }
)


@given(TIED, VALID)
@settings(max_examples=600)
def test_valid_options_give_a_finite_estimate_whatever_the_ties(theta, options):
    estimate = outcome(estimate_bearing, theta, **options)
    if estimate is None:
        return
    assert np.isfinite([estimate.value, estimate.polarity]).all()
    if options["method"] == "robust":
        # equal measurements of unknown rounding have no finite sigma
        assert estimate.sigma > 0
        assert np.isfinite(estimate.sigma) or np.ptp(theta) < 1e-9 or np.ptp(theta) > 359
    else:
        assert np.isfinite(estimate.sigma)
