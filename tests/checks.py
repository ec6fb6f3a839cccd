"""What holds for every result, whatever computes it; and what nearly every test needs.

A test gives the input, a checker here says what must be true of the output:

=============================  =====================================================================
`assert_same`                  two results, field by field, to the last bit
`assert_near`                  two arrays, relative to the largest element or to a scale
`assert_result`                frozen, with slots; arrays are contiguous, and float64, int64 or bool
`assert_covariance`            symmetric to the last bit, and not indefinite by more than rounding
`assert_batch_is_loop`         a batch gives what its parts give one by one
`assert_threads`               the same bits with one thread, several, and the default
`assert_refused`               an error of the right type whose text names what is wrong
=============================  =====================================================================
"""

import dataclasses
import inspect
import re

import numpy as np
import pytest
from tolerances import VECTOR

from tertia import metrics

NAN, INF = np.nan, np.inf
# 95 % quantiles of chi-square with so many degrees of freedom
WITHIN_95 = {1: 3.841459, 2: 5.991465, 3: 7.814728}
# the same numbers in other forms, for functions of arrays
LAYOUTS = {
    "columns": np.asfortranarray,
    "strided": lambda y: np.repeat(y, 2, axis=-1)[..., ::2],
    "reversed": lambda y: y[::-1].copy()[::-1],
    "transposed": lambda y: np.ascontiguousarray(y.T).T,
    "list": lambda y: y.tolist(),
    "object": lambda y: y.astype(object),
    "masked": np.ma.asarray,
}


def rng(*seed):
    return np.random.default_rng(seed or 0)


def close(expected, relative=VECTOR):
    """For scalars and arrays: relative to each element, and nan where nan is expected."""
    return pytest.approx(expected, rel=relative, abs=0, nan_ok=True)


def transposed(matrix):
    return np.swapaxes(matrix, -1, -2)


def diagonal(matrix):
    return np.diagonal(matrix, axis1=-2, axis2=-1)


def covariances(m, *batch, seed=0, size=1.0):
    """Random covariances (*batch, m, m), of condition numbers up to about 100."""
    root = rng(seed).normal(size=(*batch, m, 3 * m + 3)) * size
    return root @ transposed(root) / (3 * m + 3)


def correlated(noise, correlation):
    """Make white noise correlated along its second axis, in place, with the same variance."""
    fresh = np.sqrt(1 - correlation**2)
    for i in range(1, noise.shape[1]):
        noise[:, i] = correlation * noise[:, i - 1] + fresh * noise[:, i]
    return noise


def spoilt(array, value, *place):
    """A copy with another value at a place."""
    array = array.copy()
    array[place] = value
    return array


def fields(result):
    """The fields of a result by name; those of tuples by number, and of anything else ''."""
    if isinstance(result, dict):
        return result
    if dataclasses.is_dataclass(result):
        return {f.name: getattr(result, f.name) for f in dataclasses.fields(result)}
    if isinstance(result, tuple):
        return {str(i): value for i, value in enumerate(result)}
    return {"": result}


def in_region(error, covariance):
    """Whether errors (..., m) lie in the 95 % regions of their covariances (..., m, m)."""
    return metrics.nees(error, covariance) < WITHIN_95[np.shape(error)[-1]]


def assert_same(found, expected, names=None):
    """To the last bit, in all fields or those named; where a result holds others, in theirs."""
    a, b = fields(found), fields(expected)
    assert a.keys() == b.keys()
    for name in a if names is None else names:
        if dataclasses.is_dataclass(a[name]) or isinstance(a[name], (tuple, dict)):
            assert_same(a[name], b[name])
        else:
            np.testing.assert_array_equal(a[name], b[name], err_msg=name, strict=True)


def assert_near(found, expected, tolerance=VECTOR, scale=None):
    """Relative to the largest element, or to `scale`, which broadcasts; nan at the same places."""
    found, expected = np.asarray(found), np.asarray(expected)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    if scale is None:
        scale = np.nanmax(np.abs(expected), initial=0) or 1.0
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=tolerance)


def assert_result(result):
    """What holds for every result class."""
    kind = type(result)
    assert dataclasses.is_dataclass(kind)
    assert not hasattr(result, "__dict__"), f"{kind.__name__} has no slots"
    for name, value in fields(result).items():
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(result, name, value)
        if isinstance(value, np.ndarray):
            assert value.flags.c_contiguous, name
            assert value.dtype in (np.float64, np.int64, np.bool_) or value.dtype.kind == "U", name
        elif dataclasses.is_dataclass(value):
            assert_result(value)
    assert repr(result).startswith(kind.__name__)


def assert_covariance(matrix, rounding=1e-13):
    """In units of the standard deviations; nothing is asked of rows that are not finite."""
    matrix = np.asarray(matrix)
    np.testing.assert_array_equal(matrix, transposed(matrix))
    known = matrix[np.isfinite(matrix).all((-2, -1))]
    assert len(known) or not matrix.size or matrix.ndim == 2
    sigma = np.sqrt(diagonal(known))
    sigma = np.where(sigma > 0, sigma, 1.0)
    scaled = known / (sigma[..., :, np.newaxis] * sigma[..., np.newaxis, :])
    assert np.linalg.eigvalsh(scaled).min(initial=INF) > -rounding * matrix.shape[-1]


def assert_batch_is_loop(function, *batched):
    """`function(*batched)`, where each argument has one more leading axis than it needs."""
    together = fields(function(*batched))
    for i, parts in enumerate(zip(*batched, strict=True)):
        alone = fields(function(*parts))
        assert together.keys() == alone.keys()
        for name in together:
            # what is one for all: a word, None, a number that depends on sizes alone
            found = together[name] if np.ndim(together[name]) == 0 else together[name][i]
            np.testing.assert_array_equal(found, alone[name], err_msg=f"{name}[{i}]")


def assert_threads(function):
    """`function(n_threads=...)`."""
    alone = function(n_threads=1)
    for n_threads in (2, 3, 8, None):
        assert_same(function(n_threads=n_threads), alone)


def assert_refused(call, error, text):
    """`call()` fails with `error`, whose message has `text` in it."""
    with pytest.raises(error, match=re.escape(text)):
        call()


def outcome(function, *arguments, **options):
    """The result, or None after an error that names an argument or counts; a panic is neither."""
    try:
        return function(*arguments, **options)
    except (ValueError, TypeError) as error:
        message = "\n".join([str(error), *getattr(error, "__notes__", [])])
    names = [*inspect.signature(function).parameters, "measurements"]
    assert any(re.search(rf"\b{name}\b", message) for name in names), message
    return None
