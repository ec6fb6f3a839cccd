"""Covariances and arguments that hypothesis makes up, fit and unfit."""

import numpy as np
from checks import transposed
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from tolerances import IDENTITIES

PROPERTY = settings(
    deadline=None, derandomize=True, max_examples=60, suppress_health_check=[HealthCheck.too_slow]
)
MANY = settings(PROPERTY, max_examples=300)


def covariance_matrices(sensors=(2, 5), orders=(1, 8)):
    """Covariances (K, m, m), none almost singular, of sizes a thousand times apart."""

    def build(size):
        sensors, m = size
        roots = hnp.arrays(np.float64, (sensors, m, m), elements=st.floats(-1, 1, width=32))
        noise = hnp.arrays(np.float64, (sensors, 1, 1), elements=st.floats(0.03, 1))
        sizes = hnp.arrays(np.float64, (sensors, 1, 1), elements=st.floats(0.03, 30))
        return st.builds(assemble, roots, noise, sizes)

    def assemble(root, noise, size):
        s = root @ transposed(root) + noise * np.eye(root.shape[-1])
        return size * (s + transposed(s)) / 2

    return st.tuples(st.integers(*sensors), st.integers(*orders)).flatmap(build)


def units_for(s, seed):
    """Powers of two, from 2^-30 to 2^30."""
    return 2.0 ** np.random.default_rng(seed).integers(-30, 31, s.shape[-1])


def estimates_for(s, seed):
    return np.random.default_rng(seed).normal(size=s.shape[:2])


def assert_near(found, expected, scale=None):
    scale = np.abs(expected).max() if scale is None else scale
    np.testing.assert_allclose(found, expected, rtol=0, atol=IDENTITIES * scale)


def assert_no_negative_variance(matrix, scale):
    """In any direction, in units of the standard deviations of `scale`."""
    sigma = np.sqrt(np.diagonal(scale, axis1=-2, axis2=-1))
    matrix = matrix / (sigma[..., :, None] * sigma[..., None, :])
    assert np.linalg.eigvalsh((matrix + transposed(matrix)) / 2).min() > -1e-12


SEEDS = st.integers(0, 2**31)
COVARIANCES = covariance_matrices()
NASTY = [0.0, -0.0, 1.0, -1.0, 2.0, 1e-140, 1e140, 1e150, -1e300, 5e-324, np.inf, np.nan]
NUMBERS = st.one_of(
    st.floats(0.1, 30), st.sampled_from([*NASTY, 2**70, 10**400, "2", None, [1.0, 2.0], 1j])
)
COUNTS = st.one_of(
    st.integers(-2, 40),
    st.lists(st.one_of(st.integers(1, 40), st.just(np.inf)), max_size=4),
    st.sampled_from([np.inf, np.nan, 2.5, 2**53, 2**70, "9", None, [None, 9], np.ones((2, 2))]),
)
ANY = st.one_of(
    hnp.arrays(
        np.float64,
        hnp.array_shapes(min_dims=0, max_dims=5, min_side=0, max_side=3),
        elements=st.one_of(st.sampled_from(NASTY), st.floats(-9, 9)),
    ),
    st.sampled_from(["x", None, [["1"]], [[1, 2], [3]], {}, True]),
)
MATRICES = st.one_of(
    ANY,
    covariance_matrices(sensors=(1, 4), orders=(1, 4)),
    # of any definiteness
    st.integers(1, 3)
    .flatmap(lambda m: hnp.arrays(np.float64, (2, m, m), elements=st.sampled_from(NASTY[:5])))
    .map(lambda s: s + transposed(s)),
)
SENSORS = st.one_of(st.integers(-5, 5), st.sampled_from([2**70, 1.0, "1", None]))
WORDS = st.sampled_from(["sample-mean", "paper", "differences", "x", None, ["paper"], 3])


def assert_no_nan(*arrays):
    for array in arrays:
        assert not np.isnan(array).any()


SIDES = st.sampled_from([0, 1, 2, 3, 5])


def is_numeric(value):
    return isinstance(value, np.ndarray) and value.dtype.kind == "f"
