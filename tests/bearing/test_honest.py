"""Inputs whose bearing used to be wrong with a small sigma: right, or flagged."""

import numpy as np
import pytest

from tertia.bearing import estimate_bearing


@pytest.mark.parametrize(("share", "size"), [(0.2, 5.0), (0.4, 8.0)])
@pytest.mark.parametrize("burst", [False, True], ids=["isolated", "burst"])
def test_a_thousand_of_which_many_are_off_to_one_side(share, size, burst):
    """Nothing was flagged; 182.83 ± .21, where the median has 180.9 and the truth is 180."""
    random = np.random.default_rng(16)
    errors, sigmas, middles = [], [], []
    for _ in range(40):
        x = 180.0 + random.standard_normal(1000)
        hit = int(share * 1000)
        first = random.integers(1000 - hit)
        at = np.arange(first, first + hit) if burst else random.permutation(1000)[:hit]
        x[at] += size
        found = estimate_bearing(x)
        assert abs(found.outlier.sum() / hit - 1) < 0.05
        errors.append(found.value - 180.0)
        sigmas.append(found.sigma)
        middles.append(np.median(x) - 180.0)
    # the mean of the good ones alone has a sigma of .035 or .041
    assert np.sqrt(np.mean(np.square(errors))) < 0.055
    assert np.sqrt(np.mean(np.square(middles))) > 0.25
    assert np.mean(np.abs(errors) < 2 * np.array(sigmas)) >= 0.88


@pytest.mark.parametrize("count", [5, 1000])
def test_a_stuck_instrument(count):
    """It was 123 ± 0. What never changes does not tell how far it is off."""
    assert estimate_bearing(np.full(count, 123.0)).sigma == np.inf
