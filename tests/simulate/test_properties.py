"""Whatever comes in: a record or one clear error."""

import numpy as np
from checks import outcome
from hypothesis import given
from hypothesis import strategies as st
from strategies import COUNTS, NUMBERS

from tertia import simulate


@given(
    COUNTS,
    st.fixed_dictionaries(
        {},
        optional={
            "bearing": NUMBERS,
            "sigma": NUMBERS,
            "single_probability": NUMBERS,
            "bursts_per_100": st.one_of(st.floats(0, 50), st.sampled_from([-1, np.nan, "x"])),
            "burst_length": st.one_of(st.tuples(st.integers(-1, 9), st.integers(-1, 9)), NUMBERS),
            "amplitude": st.one_of(st.tuples(NUMBERS, NUMBERS), NUMBERS),
            "positive_probability": NUMBERS,
            "period": NUMBERS,
            "batch": st.sampled_from([(), 2, (2, 0), -1, 1.5]),
            "rng": st.sampled_from([None, 1, np.random.default_rng(1), "x", -1, 1.5]),
        },
    ),
)
def test_direction_finder(n, options):
    if isinstance(n, int) and n > 100:
        return  # would be granted
    record = outcome(simulate.direction_finder, n, **options)
    if record is not None:
        assert record.theta.shape == record.single.shape == record.burst.shape
