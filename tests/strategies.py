"""What hypothesis makes up for properties: samples and options, fit and unfit."""

import dataclasses

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

NASTY = [0.0, -0.0, 1.0, 1e9, -1e9, 1e150, -1e300, 1.7e308, 5e-324, 1e-160, np.inf, np.nan, 360.0]
MAGNITUDES = st.integers(-320, 307).map(lambda exponent: float(f"1e{exponent}"))
VALUES = st.one_of(
    st.sampled_from(NASTY), st.floats(-400, 400), st.floats(allow_nan=True, allow_infinity=True)
)
SHAPES = hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=14)
SAMPLES = st.one_of(
    hnp.arrays(np.float64, SHAPES, elements=VALUES),
    hnp.arrays(np.float64, st.tuples(st.integers(5, 80)), elements=st.floats(-400, 400)),
    hnp.arrays(
        np.float64, st.tuples(st.integers(5, 60)), elements=st.sampled_from([0.0, 1.0, 9.0])
    ),
    hnp.arrays(np.int32, SHAPES),
    # of any magnitude, mostly fit to be squared
    st.builds(
        lambda y, scale: y * scale,
        hnp.arrays(np.float64, st.tuples(st.integers(3, 40)), elements=st.floats(-4, 4)),
        MAGNITUDES,
    ),
)
NUMBERS = st.one_of(
    st.floats(0.1, 5),
    MAGNITUDES,
    st.sampled_from([0, -1, 5e-324, 1.7e308, np.nan, np.inf, 2**70, "2", None, [1.0, 2.0], 1j]),
)
COUNTS = st.one_of(
    st.integers(-2, 30), st.sampled_from([2**31 - 1, 2**31, 2**70, -(2**70), 2.5, "3", None])
)
POLICY = st.sampled_from(["raise", "omit", "drop", None, ["omit"], np.array([1, 2])])
WORDS = st.sampled_from([None, 3, "x", ["x"], np.array([1, 2])])
THREADS = st.sampled_from([None, 1, 2, 1000, 0, "2"])
BURST_OPTIONS = {
    "point_penalty": NUMBERS,
    "burst_penalty": NUMBERS,
    "min_burst": COUNTS,
    "max_burst": COUNTS,
    "correlation": st.one_of(st.floats(-1.1, 1.1), NUMBERS),
    "rounding": NUMBERS,
    "nan_policy": POLICY,
    "n_threads": THREADS,
}
# blocks of equal values, ties, steps, and outliers that dwarf them
TIED = st.lists(
    st.tuples(st.sampled_from([0.0, 1.0, 1.0, 2.0, 10.5, -7.0, 1e9]), st.integers(1, 30)),
    min_size=1,
    max_size=8,
).map(lambda runs: np.repeat(*zip(*runs, strict=True)))


def assert_no_silent_nan(result, missing, allowed=()):
    """Nan only in the cleaned sample, where something is excluded or missing, or where allowed."""
    for field in dataclasses.fields(result):
        values = np.asarray(getattr(result, field.name))
        if field.name == "cleaned":
            bad = np.isnan(values) & ~result.outlier & ~missing
        elif values.dtype == float and field.name not in allowed:
            bad = np.isnan(values)
        else:
            continue
        assert not bad.any(), field.name
