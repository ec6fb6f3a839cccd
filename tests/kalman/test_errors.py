"""What is refused, and numbers of any size."""

import numpy as np
import pytest
from checks import INF, NAN
from hypothesis import example, given, settings
from hypothesis import strategies as st
from kalman.scenes import PRINTED, R, Z, decades

from tertia.kalman import SingerModel, filter_series, smooth_series, steady_state

INDEFINITE = np.array([[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]])
VARIANCES = np.full((3, 6), R)


def with_one(array, row, step, value):
    changed = array.copy()
    changed[row, step] = value
    return changed


BAD_SERIES = [
    ({"z": [1.0, 2.0, INF]}, ValueError, r"z\[2\] is inf"),
    ({"z": with_one(Z, 1, 4, -INF)}, ValueError, r"z\[1, 4\] is -inf"),
    ({"z": [1.0, 1e200]}, ValueError, r"z\[1\] is 1e\+?200"),
    ({"z": 5.0}, ValueError, "z is a single number"),
    ({"z": []}, ValueError, "z has 0 measurements; at least 1"),
    ({"z": [[1.0, 2.0], [1.0]]}, ValueError, "z is ragged"),
    ({"z": "x"}, TypeError, "z has dtype"),
    ({"z": [1.0, "x"]}, TypeError, "z has dtype"),
    ({"z": [1j, 2.0]}, TypeError, "z has dtype"),
    ({"z": [True, False]}, TypeError, "z has dtype"),
    ({"z": np.array([1.0, {}], dtype=object)}, TypeError, r"z\[1\] is \{\}"),
    ({"r": -1.0}, ValueError, "measurement_variance is -1"),
    ({"r": 0.0}, ValueError, "measurement_variance is 0"),
    ({"r": NAN}, ValueError, "measurement_variance is nan"),
    ({"r": INF}, ValueError, "measurement_variance is inf"),
    ({"r": [[R], [-R], [R]]}, ValueError, r"measurement_variance.* is -0.01.*\[1\]"),
    ({"r": [R, R, -1.0, R, R, R]}, ValueError, r"measurement_variance\[(0, )?2\] is -1"),
    ({"r": with_one(VARIANCES, 2, 1, NAN)}, ValueError, r"measurement_variance\[2, 1\] is nan"),
    ({"r": with_one(VARIANCES, 2, 1, 0.0)}, ValueError, r"measurement_variance\[2, 1\] is 0; it"),
    ({"r": [R, R]}, ValueError, r"measurement_variance has shape \(2,\).* \(\.\.\., 6\)"),
    ({"r": [[R]] * 2}, ValueError, r"measurement_variance has shape \(2, 1\)"),
    ({"r": "x"}, TypeError, "measurement_variance has dtype"),
    ({"r": None}, (TypeError, ValueError), "measurement_variance"),
    ({"model": "x"}, TypeError, "model is 'x'; it must be a SingerModel"),
    ({"model": (5.0, 0.05, 0.003)}, TypeError, "model is .* it must be a SingerModel"),
    ({"time": [0, 5, 10, 9, 20, 25]}, ValueError, r"time\[3\] is before"),
    ({"time": [[0, 5, 10, 15, 20, 25]] * 2}, ValueError, r"time has shape \(2, 6\)"),
    (
        {"time": [[0, 5, 10, 15, 20, 25]] * 2 + [[0, 5, 4, 15, 20, 25]]},
        ValueError,
        r"time\[2, 2\] is before",
    ),
    ({"time": [0, 5, 10, 15, 20]}, ValueError, r"time has shape \(5,\)"),
    ({"time": [0, 5, NAN, 15, 20, 25]}, ValueError, r"time\[2\] is nan"),
    ({"time": [0, 5, 10, 15, 20, INF]}, ValueError, r"time\[5\] is inf"),
    ({"time": 5.0}, ValueError, "time is a single number"),
    ({"time": "x"}, ValueError, r"time\[0\] is .x.; it must be a number of seconds"),
    ({"time": [0, 5, 10, 35, 40, 45]}, ValueError, "25; it must be less than 1/alpha"),
    ({"period": 0}, ValueError, "period is 0"),
    ({"period": -360.0}, ValueError, "period is -360"),
    ({"period": NAN}, ValueError, "period is nan"),
    ({"period": INF}, ValueError, "period is inf"),
    ({"period": "360"}, TypeError, "period is '360'"),
    ({"initial": 3}, TypeError, "initial must be a pair"),
    ({"initial": (1, 2, 3)}, TypeError, "initial must be a pair"),
    ({"initial": "xy"}, TypeError, "initial mean has dtype"),
    ({"initial": ([1, 2, 3], np.eye(2))}, ValueError, r"initial has shapes \(3,\) and \(2, 2\)"),
    ({"initial": ([1, 2], np.eye(3))}, ValueError, r"initial has shapes \(2,\) and \(3, 3\)"),
    ({"initial": ([1, 2, NAN], np.eye(3))}, ValueError, r"initial mean\[2\] is nan"),
    (
        {"initial": ([1, 2, 3], np.full((3, 3), INF))},
        ValueError,
        r"initial covariance\[0, 0\] is inf",
    ),
    ({"initial": (np.ones((2, 3)), np.eye(3))}, ValueError, r"initial has shapes? \(2, 3\)"),
    (
        {"initial": (np.ones((3, 3)), np.ones((2, 3, 3)))},
        ValueError,
        r"initial has shapes \(3, 3\) and \(2, 3, 3\)",
    ),
    ({"initial": ([1, 2, 3], -np.eye(3))}, ValueError, r"covariance\[.*0, 0\] is -1"),
    ({"initial": ([1, 2, 3], np.triu(np.ones((3, 3))))}, ValueError, "must be symmetric"),
    ({"initial": ([1, 2, 3], INDEFINITE)}, np.linalg.LinAlgError, "covariance is indefinite"),
    (
        {"initial": ([1, 2, 3], [np.eye(3), INDEFINITE, np.eye(3)])},
        np.linalg.LinAlgError,
        r"covariance.* is indefinite.*\[1\]",
    ),
    (
        {"initial": ([1, 2, 3], [np.eye(3), np.eye(3), np.triu(np.ones((3, 3)))])},
        ValueError,
        r"covariance\[2, 0, 1\] is 1 and its mirror image",
    ),
    ({"n_threads": 0}, ValueError, "n_threads is 0"),
    ({"n_threads": 1.5}, TypeError, "n_threads is 1.5"),
]


class TestErrors:
    @pytest.mark.parametrize(("wrong", "error", "message"), BAD_SERIES)
    @pytest.mark.parametrize("function", [filter_series, smooth_series])
    def test_of_series(self, function, wrong, error, message):
        options = {"z": Z, "r": R, "model": PRINTED} | wrong
        arguments = [options.pop(name) for name in ("z", "r", "model")]
        with pytest.raises(error, match=message):
            function(*arguments, **options)

    @pytest.mark.parametrize("store", ["everything", "", None, 3, ["all"]])
    def test_of_store(self, store):
        with pytest.raises((TypeError, ValueError), match="store"):
            filter_series(Z, R, PRINTED, store=store)

    def test_a_wrong_number_does_not_wait_for_the_first_row(self):
        with pytest.raises(ValueError, match="period is -1"):
            filter_series(np.empty((0, 5)), R, PRINTED, period=-1)

    @pytest.mark.parametrize(
        ("call", "error", "message"),
        [
            (lambda: SingerModel(-1, 0.05, 1), ValueError, "dt is -1"),
            (lambda: SingerModel(NAN, 0.05, 1), ValueError, "dt is nan"),
            (lambda: SingerModel(INF, 0.05, 1), ValueError, "dt is inf"),
            (lambda: SingerModel(5, -0.05, 1), ValueError, "alpha is -0.05"),
            (lambda: SingerModel(5, NAN, 1), ValueError, "alpha is nan"),
            (lambda: SingerModel(5, 0.05, -1), ValueError, "acceleration_sigma is -1"),
            (lambda: SingerModel(5, 0.05, INF), ValueError, "acceleration_sigma is inf"),
            (lambda: SingerModel(5, 0.2, 1), ValueError, "dt is 5; it must be less than 1/alpha"),
            (lambda: SingerModel("5", 0.05, 1), TypeError, "dt is '5'"),
            (lambda: SingerModel(5, None, 1), TypeError, "alpha is None"),
            (lambda: SingerModel(5, 0.05, 1, exact=1), TypeError, "exact is 1"),
            (lambda: PRINTED.transition(-1), ValueError, "dt is -1"),
            (lambda: PRINTED.transition("1"), TypeError, "dt is '1'"),
            (lambda: PRINTED.process_noise(20), ValueError, "dt is 20; it must be less than"),
            (lambda: steady_state(PRINTED, 0), ValueError, "measurement_variance is 0"),
            (lambda: steady_state(PRINTED, -1), ValueError, "measurement_variance is -1"),
            (lambda: steady_state(PRINTED, NAN), ValueError, "measurement_variance is nan"),
            (lambda: steady_state(PRINTED, "1"), TypeError, "measurement_variance is '1'"),
            (lambda: steady_state("x", 1), TypeError, "model is 'x'"),
            (
                lambda: steady_state(SingerModel(5, 0.05, 0), 1),
                ValueError,
                "acceleration_sigma is 0; .* no steady state",
            ),
            (lambda: steady_state(SingerModel(5, 0, 1), 1), ValueError, "no steady state"),
            (lambda: steady_state(SingerModel(0, 0.05, 1), 1), ValueError, "no steady state"),
            # as given, not another number
            (
                lambda: steady_state(SingerModel(5, 0.05, 1e-14), 1e100),
                ValueError,
                r"measurement_variance is 1e\+?100; .* does not settle",
            ),
        ],
    )
    def test_of_models(self, call, error, message):
        with pytest.raises(error, match=message):
            call()


PLOTS = st.lists(st.one_of(st.floats(-1e9, 1e9), st.just(NAN)), min_size=1, max_size=12)


@given(
    z=PLOTS,
    sigma=decades(-6, 6),
    dt=decades(-6, 6),
    x=st.sampled_from([0.0, 1e-6, 1e-3, 0.1, 0.5, 0.99, 2.0, 50.0]),
    restlessness=decades(-8, 8),
    exact=st.booleans(),
    width=st.one_of(st.none(), decades(-16, 16)),
    period=st.sampled_from([None, 360.0]),
)
@example([-1.9, NAN, 0.7, NAN, 2.0], 1e-5, 1.0, 1.0, 1e8, True, 1e10, None)
@example([1.1, NAN, NAN, NAN, NAN, 0.8, -0.2, 0.9], 1e8, 10.0, 0.1, 1.0, False, 1e16, None)
@example([5.0, 3.0, NAN, 2.0, 1.0], 1.0, 1e6, 0.1, 1.0, True, None, None)
@settings(max_examples=100, deadline=None, derandomize=True)
def test_a_state_and_its_covariance_whatever_the_numbers(
    z, sigma, dt, x, restlessness, exact, width, period
):
    """Known from the first plot on; no variance is nan or negative."""
    z = sigma * np.array(z)
    model = SingerModel(dt, x / dt, restlessness * sigma / dt**2, exact=exact or x >= 1)
    started = np.cumsum(~np.isnan(z)) > 0
    initial = None
    if width is not None:
        started[:] = True
        unit = np.sqrt(width) * sigma / np.array([1, dt, dt**2])
        initial = np.zeros(3), np.diag(unit**2)
    result = filter_series(z, sigma**2, model, initial=initial, period=period)
    smooth = smooth_series(z, sigma**2, model, initial=initial, period=period)
    assert np.isfinite(result.log_likelihood)
    for found in (result, smooth):
        np.testing.assert_array_equal(np.isfinite(found.mean).all(axis=-1), started)
        assert not np.isnan(found.upper).any()
        assert np.all(found.upper[..., [0, 3, 5]] >= 0)


@pytest.mark.parametrize("dt", [5e-324, 1e-200])
def test_a_time_that_is_almost_none(dt):
    """A result, or an error that names it."""
    try:
        found = filter_series([1.0, 1.1, 1.2, 1.3], R, SingerModel(dt, 1.0, 1.0, exact=True))
    except ValueError as error:
        assert "dt is" in str(error)  # noqa: PT017 - either is right
    else:
        assert np.isfinite(found.mean).all()
        assert not np.isnan(found.upper).any()
