"""What is refused, and how results are printed."""

import numpy as np
import pytest
from weights.cases import TWO

from tertia import fusion, weights

INDEFINITE = [[1.0, 2.0], [2.0, 1.0]]
SINGULAR = [[1.0, 1.0], [1.0, 1.0]]
OTHER_SINGULAR = [[1.0, -1.0], [-1.0, 1.0]]
ASYMMETRIC = [[4.0, 1.0], [0.9, 2.0]]
NO_VARIANCE = [[0.0, 0.0], [0.0, 1.0]]


def batch_with(matrix, place=(3, 1)):
    """Good covariances (4, 2, 2, 2), but for one."""
    s = np.tile(np.eye(2), (4, 2, 1, 1))
    s[place] = matrix
    return s


def of_every_group(covariances_, error, message):
    """The same error from every function that takes covariances of several sensors."""
    calls = {
        "weight_matrices": weights.weight_matrices,
        "fused_covariance": weights.fused_covariance,
        "combine": lambda s: fusion.fuse(np.zeros((2, 2)), s),
        "jacobian": weights.jacobian,
        "jacobian_operator": weights.jacobian_operator,
        "weight_covariance": lambda s: weights.weight_covariance(s, 10),
        "weight_bias": lambda s: weights.weight_bias(s, 10),
        "first-order": lambda s: weights.fusion_loss(s, 10, method="first-order"),
        "monte-carlo": lambda s: weights.fusion_loss(s, 10, method="monte-carlo"),
        "required_samples": lambda s: weights.required_samples(s, 0.1),
    }
    return [
        pytest.param(lambda f=f: f(covariances_), error, message, id=f"{name}: {message}")
        for name, f in calls.items()
    ]


BAD_GROUPS = [
    *of_every_group([TWO[0], INDEFINITE], np.linalg.LinAlgError, r"covariances\[1\] is indefinite"),
    *of_every_group(
        batch_with(INDEFINITE), np.linalg.LinAlgError, r"covariances\[3, 1\] is indefinite"
    ),
    *of_every_group(
        [SINGULAR, SINGULAR],
        np.linalg.LinAlgError,
        r"covariances\[1\] and the covariances fused with it are singular",
    ),
    *of_every_group(
        batch_with(SINGULAR, place=2),
        np.linalg.LinAlgError,
        r"covariances\[2, 1\] and the covariances fused with it are singular",
    ),
    *of_every_group(
        [ASYMMETRIC, TWO[0]],
        ValueError,
        r"covariances\[0, 0, 1\] is 1 and its mirror image is 0\.9; .* must be symmetric",
    ),
    *of_every_group(
        batch_with(ASYMMETRIC), ValueError, r"covariances\[3, 1, 0, 1\] is 1 and its mirror"
    ),
    *of_every_group(
        batch_with([[1, np.nan], [np.nan, 1]]), ValueError, r"covariances\[3, 1, 0, 1\] is nan"
    ),
    *of_every_group(
        [[[1, 0], [0, np.inf]], np.eye(2)], ValueError, r"covariances\[0, 1, 1\] is inf"
    ),
    *of_every_group(
        batch_with(NO_VARIANCE, place=(0, 0)),
        ValueError,
        r"covariances\[0, 0, 0, 0\] is 0; variances must be positive",
    ),
    *of_every_group(
        [-np.eye(2), np.eye(2)], ValueError, r"covariances\[0, 0, 0\] is -1; variances must be"
    ),
    *of_every_group(
        [1e141 * np.eye(2), np.eye(2)], ValueError, r"covariances\[0, 0, 0\] is 1e141; variances"
    ),
    *of_every_group(
        [[[1.0, 2.0], [3.0]], [[1.0, 2.0], [3.0, 4.0]]], ValueError, "covariances is ragged"
    ),
    *of_every_group([[["1", "2"], ["2", "3"]]] * 2, TypeError, "covariances has dtype <U1"),
    *of_every_group(np.ones((2, 2, 2), dtype=complex), TypeError, "covariances has dtype complex"),
    *of_every_group(1.0, ValueError, "covariances is a single number|covariances has shape"),
    *of_every_group(
        np.eye(2), ValueError, r"covariances has shape [\[(]2, 2[\])]; .*(K >= 2 sensors|2, 2, 2)"
    ),
    *of_every_group(np.ones((2, 2, 0)), ValueError, r"covariances has shape [\[(]2, 2, 0[\])]"),
]
# where no estimates are there to be compared with
SHAPES = {
    "one sensor": (1, 2, 2),
    "no sensor": (0, 2, 2),
    "not square": (2, 2, 3),
    "no dimension": (2, 0, 0),
}


def scalar(**changed):
    arguments = {"estimate": [1.0, 2.0], "covariance": TWO[0], "h": [1.0, 0.5], "measured": 0.3}
    return fusion.fuse_scalar(**{**arguments, "sigma": 2.0, **changed})


BAD_CALLS = [
    (lambda: fusion.fuse(np.zeros((3, 2)), TWO), ValueError, r"covariances has shape \(2, 2, 2\)"),
    (lambda: fusion.fuse(np.zeros(2), TWO), ValueError, r"estimates has shape \(2,\); it must"),
    (lambda: fusion.fuse(1.0, TWO), ValueError, r"estimates has shape \(\); it must"),
    (
        lambda: fusion.fuse(np.zeros((5, 2, 3)), np.eye(3)),
        ValueError,
        r"covariances has shape \(3, 3\); for estimates",
    ),
    (
        lambda: fusion.fuse(np.zeros((3, 2, 2)), np.stack([TWO] * 4)),
        ValueError,
        r"do not fit together: estimates \(3,\), covariances \(4,\)",
    ),
    (lambda: fusion.fuse([[0, np.nan], [0, 0]], TWO), ValueError, r"estimates\[0, 1\] is nan"),
    (
        lambda: fusion.fuse([[[0, 0], [0, 0]], [[0, 0], [np.inf, 0]]], TWO),
        ValueError,
        r"estimates\[1, 1, 0\] is inf; it must be a number of at most 1e150",
    ),
    (lambda: fusion.fuse([[0, 1e151], [0, 0]], TWO), ValueError, r"estimates\[0, 1\] is 1e151"),
    (lambda: fusion.fuse([["a", "b"]] * 2, TWO), TypeError, "estimates has dtype <U1"),
    (lambda: fusion.fuse([[1, 2], [3]], TWO), ValueError, "estimates is ragged"),
    (lambda: scalar(covariance=INDEFINITE), np.linalg.LinAlgError, "covariance is indefinite"),
    (
        lambda: scalar(covariance=batch_with(INDEFINITE)),
        np.linalg.LinAlgError,
        r"covariance is indefinite.*\(in covariance\[3, 1\]\)",
    ),
    (lambda: scalar(covariance=ASYMMETRIC), ValueError, r"covariance\[0, 1\] is 1 and its mirror"),
    (lambda: scalar(covariance=NO_VARIANCE), ValueError, r"covariance\[0, 0\] is 0; variances"),
    (lambda: scalar(covariance=np.ones((2, 3))), ValueError, "covariance has shape"),
    (lambda: scalar(covariance=np.ones((3, 2))), ValueError, "covariance has shape"),
    (lambda: scalar(covariance=1.0), ValueError, r"covariance has shape \(\)"),
    (
        lambda: scalar(covariance=np.ones((0, 0)), estimate=np.ones(0), h=np.ones(0)),
        ValueError,
        r"covariance has shape \(0, 0\)",
    ),
    (
        lambda: scalar(covariance=np.eye(3)),
        ValueError,
        r"estimate has shape \(2,\); for covariance of shape \(3, 3\)",
    ),
    (lambda: scalar(h=[1.0, 2.0, 3.0]), ValueError, r"h has shape \(3,\)"),
    (lambda: scalar(h=[1.0, np.nan]), ValueError, r"h\[1\] is nan"),
    (lambda: scalar(h=[1.0, 1e71]), ValueError, r"h has a number above 1e\+70"),
    (lambda: scalar(estimate=[np.inf, 0]), ValueError, r"estimate\[0\] is inf"),
    (lambda: scalar(estimate=[[0, 0], [0, -1e151]]), ValueError, r"estimate\[1, 1\] is -1e151"),
    (lambda: scalar(measured=np.nan), ValueError, "measured is nan"),
    (lambda: scalar(measured=-1e71), ValueError, r"measured has a number above 1e\+70"),
    (lambda: scalar(measured="3"), TypeError, "measured has dtype"),
    (lambda: scalar(sigma=0), ValueError, r"sigma is 0\.0; it must be a positive number"),
    (lambda: scalar(sigma=[1, -1]), ValueError, r"sigma\[1\] is -1\.0"),
    (lambda: scalar(sigma=1e71), ValueError, r"sigma must be between 1e-70"),
    (
        lambda: scalar(measured=[1, 2, 3], sigma=[1, 2]),
        ValueError,
        r"do not fit together: .*measured \(3,\), sigma \(2,\)",
    ),
    (lambda: weights.scalar_information(3.0, 1.0), ValueError, "h is a single number"),
    (lambda: weights.scalar_information([3.0], 0.0), ValueError, "sigma is 0"),
    (lambda: weights.scalar_information([np.inf], 1.0), ValueError, r"h\[0\] is inf"),
    (
        lambda: weights.scalar_information(np.ones((3, 2)), np.ones(4)),
        ValueError,
        r"h \(3,\), sigma \(4,\)|sigma has shape|h has shape",
    ),
    (lambda: weights.scalar_information([1.0], 1e-200), ValueError, "sigma"),
    (lambda: weights.jacobian(TWO, 2), ValueError, "sensor is 2; it must be between -2 and 1"),
    (lambda: weights.jacobian(TWO, -3), ValueError, "sensor is -3; it must be between -2 and 1"),
    (lambda: weights.jacobian(TWO, 2**40), ValueError, "sensor is 1099511627776"),
    (lambda: weights.jacobian(TWO, 1.0), TypeError, r"sensor is 1\.0; it must be an integer"),
    (lambda: weights.jacobian(TWO, "1"), TypeError, "sensor is '1'"),
    (lambda: weights.jacobian_operator(TWO, 5), ValueError, "sensor is 5"),
    (lambda: weights.weight_covariance(TWO, 10, 2), ValueError, "sensor is 2"),
    (lambda: weights.weight_bias(TWO, 10, -3), ValueError, "sensor is -3"),
    (lambda: weights.weight_bias(TWO, 10, None), TypeError, "sensor is None"),
    (lambda: weights.sample_covariance([1.0, 2.0]), ValueError, r"x has shape \(2,\)"),
    (lambda: weights.sample_covariance([[1.0, 2.0]]), ValueError, r"x has shape \(1, 2\)"),
    (lambda: weights.sample_covariance(np.ones((3, 0))), ValueError, r"x has shape \(3, 0\)"),
    (lambda: weights.sample_covariance([[1], [np.nan]]), ValueError, r"x\[1, 0\] is nan"),
    (
        lambda: weights.sample_covariance(np.ones((3, 2)), mean=[0, 0, 0]),
        ValueError,
        r"mean has shape \(3,\); it must be \(..., 2\)",
    ),
    (
        lambda: weights.sample_covariance(np.ones((3, 5, 2)), mean=np.ones((4, 2))),
        ValueError,
        "mean",
    ),
    (
        lambda: weights.sample_covariance(np.ones((3, 2)), mean=[0, np.inf]),
        ValueError,
        r"mean\[1\] is inf",
    ),
    (
        lambda: weights.sample_covariance(np.ones((3, 2)), mean=[0, 0], differences=True),
        ValueError,
        "mean is given; with differences it must be None",
    ),
    (
        lambda: weights.sample_covariance(np.ones((3, 2)), differences=1),
        TypeError,
        "differences is 1; it must be True or False",
    ),
    (lambda: weights.sample_covariance([[1e200], [-1e200]]), ValueError, "x"),
    (lambda: weights.sample_covariance(np.ones((3, 2)), ddof=3), ValueError, "ddof is 3"),
    (lambda: weights.sample_covariance(np.ones((3, 2)), ddof=-1), ValueError, "ddof is -1"),
    (lambda: weights.sample_covariance(np.ones((3, 2)), ddof=0.5), TypeError, "ddof is 0.5"),
    (lambda: weights.covariance_factor(1), ValueError, "n is 1; it must be a whole number"),
    (lambda: weights.covariance_factor(2.5), ValueError, r"n is 2\.5; it must be a whole number"),
    (lambda: weights.covariance_factor(np.nan), ValueError, "n is nan"),
    (lambda: weights.covariance_factor("5"), TypeError, "n is '5'"),
    (lambda: weights.covariance_factor([5, 6]), TypeError, r"n is \[5, 6\]"),
    (
        lambda: weights.covariance_factor(5, "x"),
        ValueError,
        "convention is 'x'; it must be 'sample",
    ),
    (lambda: weights.covariance_factor(5, None), (TypeError, ValueError), "convention"),
    (lambda: weights.covariance_of_covariance(TWO[0], -1), ValueError, r"factor is -1\.0"),
    (lambda: weights.covariance_of_covariance(TWO[0], np.inf), ValueError, "factor is inf"),
    (lambda: weights.covariance_of_covariance(TWO[0], "1"), TypeError, "factor is '1'"),
    (
        lambda: weights.covariance_of_covariance(np.ones((2, 3)), 1),
        ValueError,
        r"covariance has shape \[2, 3\]",
    ),
    (
        lambda: weights.covariance_of_covariance([TWO[0], INDEFINITE], 1),
        np.linalg.LinAlgError,
        r"covariance is indefinite.*\(in covariance\[1\]\)",
    ),
    (
        lambda: weights.covariance_of_covariance([[1e140]], 1e300),
        ValueError,
        "factor",
    ),
    (lambda: weights.weight_covariance(TWO, 1), ValueError, "n is 1; it must be a whole number"),
    (
        lambda: weights.weight_covariance(TWO, 2),
        ValueError,
        "n is 2; it must be larger",
    ),
    (lambda: weights.weight_bias(TWO, 10.5), ValueError, r"n is 10\.5; it must be a whole number"),
    (lambda: weights.weight_bias(TWO, [10, 1]), ValueError, "n is 1"),
    (
        lambda: weights.weight_bias(TWO, [3, 2, 2]),
        ValueError,
        "n has 3 numbers; .* each of 2 sensors",
    ),
    (lambda: weights.weight_bias(TWO, []), ValueError, "n has 0 numbers"),
    (lambda: weights.weight_bias(TWO, [[10, 10]]), ValueError, r"n has shape \(1, 2\)"),
    (lambda: weights.weight_bias(TWO, np.nan), ValueError, "n is nan"),
    (lambda: weights.weight_bias(TWO, -np.inf), ValueError, "n is -inf"),
    (lambda: weights.weight_bias(TWO, "10"), TypeError, "n has dtype"),
    (lambda: weights.weight_covariance(TWO, True), TypeError, "n has dtype bool"),
    (lambda: weights.weight_covariance(TWO, 10**400), TypeError, "^n is 1000"),
    (lambda: weights.weight_bias(TWO, 10**400), TypeError, "^n is 1000"),
    (lambda: weights.weight_covariance(TWO, 9, convention="x"), ValueError, "convention is 'x'"),
    (lambda: weights.weight_bias(TWO, 9, convention=3), (TypeError, ValueError), "convention"),
    (lambda: weights.fusion_loss(TWO, 2), ValueError, "n is 2; it must be larger"),
    (lambda: weights.fusion_loss(TWO, [2, 2]), ValueError, "n is 2; it must be larger"),
    (lambda: weights.fusion_loss(TWO, 9, convention="x"), ValueError, "convention is 'x'"),
    (
        lambda: weights.fusion_loss(TWO, 9, method="x"),
        ValueError,
        "method is 'x'; it must be 'auto'",
    ),
    (lambda: weights.fusion_loss(TWO, 9, method=None), ValueError, "method is None"),
    (lambda: weights.fusion_loss(TWO, 9, method=["auto"]), (TypeError, ValueError), "method is"),
    (
        lambda: weights.fusion_loss(TWO, 9, trials=1),
        ValueError,
        "trials is 1; it must be between 2",
    ),
    (lambda: weights.fusion_loss(TWO, 9, trials=9.0), TypeError, r"trials is 9\.0"),
    (lambda: weights.fusion_loss(TWO, 9, rng="x"), TypeError, "rng is 'x'"),
    (lambda: weights.fusion_loss(TWO, 9, rng=-1), ValueError, "rng is -1"),
    (
        lambda: weights.fusion_loss(np.stack([np.eye(3)] * 2), [3, 50], convention="differences"),
        ValueError,
        r"n is too small: differences have 1\.60 degrees of freedom",
    ),
    (lambda: weights.required_samples(TWO, 0), ValueError, r"loss is 0\.0; it must be between"),
    (lambda: weights.required_samples(TWO, np.nan), ValueError, "loss is nan"),
    (lambda: weights.required_samples(TWO, 1e7), ValueError, "loss is 10000000"),
    (lambda: weights.required_samples(TWO, "x"), TypeError, "loss is 'x'"),
    (lambda: weights.required_samples(TWO, method="auto"), ValueError, "method is 'auto'; it must"),
    (lambda: weights.required_samples(TWO, method=[1]), (TypeError, ValueError), "method is"),
    (lambda: weights.required_samples(TWO, trials=0), ValueError, "trials is 0"),
    (lambda: weights.required_samples(TWO, convention="x"), ValueError, "convention is 'x'"),
    (lambda: weights.required_samples(TWO, rng=1.5), TypeError, r"rng is 1\.5"),
    (lambda: weights.shrink_covariance(1.0, TWO[0], 5), ValueError, r"model has shape \(\)"),
    (
        lambda: weights.shrink_covariance(TWO[0], np.ones((2, 3)), 5),
        ValueError,
        r"sample has shape \(2, 3\)",
    ),
    (lambda: weights.shrink_covariance(np.eye(3), TWO[0], 5), ValueError, "their m must agree"),
    (
        lambda: weights.shrink_covariance(TWO[0], [[1, np.nan], [0, 1]], 5),
        ValueError,
        r"sample\[0, 1\] is nan",
    ),
    (lambda: weights.shrink_covariance(TWO[0], TWO[0], 0), ValueError, "n must be at least 1"),
    (
        lambda: weights.shrink_covariance(TWO[0], TWO[0], [3, np.nan]),
        ValueError,
        "n must be at least 1",
    ),
    (lambda: weights.shrink_covariance(TWO[0], TWO[0], 5, 0), ValueError, r"n_model is 0\.0"),
    (lambda: weights.shrink_covariance(TWO[0], TWO[0], 5, np.inf), ValueError, "n_model is inf"),
    (lambda: weights.shrink_covariance(TWO[0], TWO[0], 5, "x"), TypeError, "n_model is 'x'"),
    (lambda: weights.shrink_covariance(TWO, np.ones((3, 2, 2)), 5), ValueError, "model.*sample"),
    (lambda: weights.weight_matrices(TWO, n_threads=0), ValueError, "n_threads is 0"),
    (lambda: weights.weight_covariance(TWO, 9, n_threads=0.5), TypeError, r"n_threads is 0\.5"),
    (
        lambda: weights.fused_covariance([SINGULAR, OTHER_SINGULAR]),
        np.linalg.LinAlgError,
        "the fused covariance of covariances is lost to rounding",
    ),
    (
        lambda: fusion.fuse(np.zeros((2, 2)), [SINGULAR, OTHER_SINGULAR]),
        np.linalg.LinAlgError,
        "the fused covariance of covariances is lost to rounding",
    ),
    (
        lambda: weights.fused_covariance([TWO, [SINGULAR, OTHER_SINGULAR]]),
        np.linalg.LinAlgError,
        r"lost to rounding.*\(in covariances\[1\]\)",
    ),
    *(
        (
            lambda shape=shape: weights.weight_matrices(np.ones(shape)),
            ValueError,
            r"covariances has",
        )
        for shape in SHAPES.values()
    ),
    *(
        (lambda shape=shape: weights.fusion_loss(np.ones(shape), 9), ValueError, r"covariances has")
        for shape in SHAPES.values()
    ),
]


def check_error(call, error, message):
    """Of the very type: an error about a matrix is a LinAlgError, which is a ValueError, too."""
    with pytest.raises(error, match=message) as caught:
        call()
    assert caught.type in (error if isinstance(error, tuple) else (error,))


@pytest.mark.parametrize(("call", "error", "message"), BAD_GROUPS)
def test_bad_covariances(call, error, message):
    check_error(call, error, message)


@pytest.mark.parametrize(("call", "error", "message"), BAD_CALLS)
def test_bad_parameters(call, error, message):
    check_error(call, error, message)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: weights.jacobian(s, 5), "sensor is 5"),
        (lambda s: weights.weight_covariance(s, 2), "n is 2"),
        (lambda s: weights.weight_bias(s, 9, convention="x"), "convention is 'x'"),
        (lambda s: weights.fusion_loss(s, 2), "n is 2"),
        (lambda s: weights.fusion_loss(s, 9, trials=1), "trials is 1"),
        (lambda s: weights.required_samples(s, -1), "loss is -1"),
        (lambda s: fusion.fuse(np.zeros((3, 2)), s), "covariances has shape"),
    ],
)
def test_bad_parameters_of_an_empty_batch(call, message):
    """A wrong parameter does not wait for the first element."""
    with pytest.raises(ValueError, match=message):
        call(np.empty((0, 2, 2, 2)))


def test_results_are_printed_usefully():
    assert repr(weights.fusion_loss(TWO, 10**4)) == "FusionLoss(0.01%, first-order)"
    assert repr(weights.fusion_loss(TWO, 20)).startswith("FusionLoss(7.")
    assert repr(weights.fusion_loss([TWO] * 3, 20)) == "FusionLoss(batch (3,), monte-carlo)"
