"""Local polynomials against plain least squares and their own claims."""

import mpmath
import numpy as np
import pytest
from checks import INF, NAN, rng
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import smoothing as reference
from scipy import stats
from scipy.signal import savgol_filter
from smoothing.scenes import assert_close, gaps, series
from tolerances import CHANCE, POLYNOMIAL, VECTOR

from tertia.smoothing import local_polynomial


class TestPolynomial:
    def check(self, y, window, degree, **options):
        """Value, sigma and degree of everything against least squares of powers."""
        derivative = options.get("derivative", 0)
        given_degree = degree if isinstance(degree, int) else "adaptive"
        if given_degree == "adaptive":
            options["max_degree"] = degree[1]
        found = local_polynomial(y, window, given_degree, **options)
        options.pop("max_degree", None)
        value, sigma, used, variance = reference.polynomial(y, window, degree, **options)
        np.testing.assert_array_equal(found.degree, used)
        known = np.isfinite(sigma)
        np.testing.assert_array_equal(np.isfinite(found.sigma), known)
        np.testing.assert_allclose(found.sigma[known], sigma[known], rtol=POLYNOMIAL)
        assert_close(found.value[known], value[known], POLYNOMIAL * 10**derivative, sigma[known])
        if "variance" in options:
            assert found.residual_variance is None
            assert found.degrees_of_freedom is None
        else:
            assert found.residual_variance == pytest.approx(variance, rel=POLYNOMIAL)
        return found

    @pytest.mark.parametrize("degree", [0, 1, 2, 3])
    @pytest.mark.parametrize("window", [1, 3, 5, 13, 51])
    def test_equal_steps_are_those_of_savitzky_and_golay(self, window, degree):
        if degree >= window:
            pytest.skip("no such polynomial")
        y = series(200)
        for derivative in range(degree + 1):
            expected = savgol_filter(y, window, degree, deriv=derivative, mode="interp")
            found = local_polynomial(y, window, degree, derivative=derivative)
            np.testing.assert_allclose(
                found.value, expected, rtol=VECTOR, atol=VECTOR * np.max(np.abs(expected))
            )
            assert np.all(found.degree == degree)
            times = 1e6 + 0.25 * np.arange(200)
            scaled = local_polynomial(y, window, degree, derivative=derivative, time=times)
            np.testing.assert_allclose(scaled.value, found.value * 4.0**derivative, rtol=1e-14)
            np.testing.assert_allclose(scaled.sigma, found.sigma * 4.0**derivative, rtol=1e-14)

    @pytest.mark.parametrize(("window", "degree"), [(13, 3), (51, 5), (101, 9)])
    @pytest.mark.parametrize("regular", [True, False])
    def test_against_fifty_digits(self, regular, window, degree):
        """Where powers have no digits left."""
        x = np.arange(window) - window // 2
        y, times = series(window + 4), np.arange(window + 4.0)
        if not regular:
            times[-1] += 1e-9
        with mpmath.workdps(50):
            powers = mpmath.matrix(
                [[mpmath.mpf(int(t)) ** p for p in range(degree + 1)] for t in x]
            )
            own = mpmath.matrix(y[2 : window + 2].tolist())
            c = mpmath.lu_solve(powers.T * powers, powers.T * own)
            expected = [float(mpmath.factorial(p) * c[p]) for p in range(degree + 1)]
        for derivative in range(degree + 1):
            found = local_polynomial(y, window, degree, time=times, derivative=derivative)
            i = window // 2 + 2
            assert abs(found.value[i] - expected[derivative]) <= 1e-13 * found.sigma[i]

    @pytest.mark.parametrize("degree", [0, 1, 2, 3, (0, 1), (0, 2), (0, 3)])
    @pytest.mark.parametrize("kind", ["regular", "gaps", "irregular", "weights", "all"])
    def test_against_least_squares_of_powers(self, kind, degree):
        n, options = 60, {}
        y = series(n, seed=7)
        if kind in {"irregular", "all"}:
            times = np.sort(rng(4).uniform(0, 100, n))
            times[[5, 21, 22]] = times[[4, 20, 20]]
            options["time"] = times
        if kind in {"weights", "all"}:
            options["variance"] = 10 ** rng(5).uniform(-1, 1, n)
        if kind in {"gaps", "all"}:
            y = gaps(y, 0.4)
        top = degree if isinstance(degree, int) else degree[1]
        for window in (5, 13, 71):
            for derivative in range(min(top, 2) + 1):
                self.check(y, window, degree, derivative=derivative, **options)

    def test_what_too_few_measurements_determine(self):
        y = [NAN, NAN, NAN, 1.0, NAN, 3.0, NAN, NAN, NAN, NAN]
        fixed = local_polynomial(y, 5, 1)
        assert_close(fixed.value, [NAN, NAN, NAN, 1, 2, 3, NAN, NAN, NAN, NAN], 1e-14, 1.0)
        # two points on a line tell no noise
        assert np.all(fixed.sigma == INF)
        assert np.isnan(fixed.residual_variance)
        known = local_polynomial(y, 5, 1, variance=0.25)
        np.testing.assert_allclose(known.sigma[3:6], [0.5, 0.5**1.5, 0.5])
        np.testing.assert_array_equal(known.degree >= 0, np.isfinite(known.sigma))
        assert np.all(local_polynomial([NAN] * 5).sigma == INF)
        assert local_polynomial([]).value.shape == (0,)
        # equal times are one instant
        assert np.all(local_polynomial([1.0, 2.0, 3.0], 3, 1, time=[2, 2, 2]).degree == -1)
        np.testing.assert_allclose(local_polynomial([1.0, 2.0, 3.0], 3, 0, time=[2, 2, 2]).value, 2)

    @pytest.mark.parametrize("variances", [None, 1.0])
    def test_a_degree_that_cannot_be_tested_is_not_chosen(self, variances):
        y = gaps(series(40), 0.0)
        y[15:27] = NAN
        found = local_polynomial(y, 13, variance=variances)
        counts = np.array(
            [np.count_nonzero(~np.isnan(y[max(0, min(i - 6, 27)) :][:13])) for i in range(40)]
        )
        np.testing.assert_array_equal(found.degree >= 0, counts >= (5 if variances is None else 4))
        np.testing.assert_array_equal(np.isfinite(found.sigma), found.degree >= 0)

    @pytest.mark.parametrize("degree", [1, 3, (0, 3)])
    @pytest.mark.parametrize("irregular", [False, True])
    def test_offsets_cost_nothing(self, irregular, degree):
        times = 0.5 * np.arange(80.0)
        if irregular:
            times[1:-1] += rng(3).integers(-20, 20, 78) / 128
        y = np.round(series(80) * 2**20) / 2**20
        options = {"degree": degree if isinstance(degree, int) else "adaptive", "derivative": 1}
        plain = local_polynomial(y, time=times, **options)
        moved = local_polynomial(y + 2.0**30, time=times + 2.0**20, **options)
        np.testing.assert_array_equal(plain.degree, moved.degree)
        assert_close(moved.value, plain.value, 1e-12, plain.sigma)
        np.testing.assert_allclose(moved.sigma, plain.sigma, rtol=1e-12)

    @settings(max_examples=60, deadline=None)
    @given(
        st.integers(0, 3),
        st.sampled_from([5, 7, 13]),
        st.lists(st.floats(-10, 10), min_size=4, max_size=4),
        st.integers(0, 10**6),
    )
    def test_polynomials_are_reproduced(self, degree, window, coefficients, seed):
        random = rng(seed)
        t = np.sort(random.uniform(-5, 5, 40)) if seed % 2 else np.linspace(-5, 5, 40)
        c = np.array(coefficients[: degree + 1])
        y = np.where(random.random(40) < 0.2, NAN, np.polynomial.polynomial.polyval(t, c))
        size = np.sum(np.abs(c)) * 5.0**degree + 1e-300
        for chosen in (degree, "adaptive"):
            found = local_polynomial(y, window, chosen, time=t, max_degree=3)
            there = found.degree >= 0
            if chosen == "adaptive":
                # windows with few measurements cannot test the degree
                there &= found.degree >= degree
            expected = np.polynomial.polynomial.polyval(t, c)
            np.testing.assert_allclose(found.value[there], expected[there], atol=1e-11 * size)

    @settings(max_examples=40, deadline=None)
    @given(st.floats(-1e3, 1e3), st.floats(1e-6, 1e6), st.floats(1e-6, 1e6), st.integers(0, 10**6))
    def test_shift_and_scale(self, shift, scale, pace, seed):
        y, t = gaps(series(50, seed), 0.1, seed), np.sort(rng(seed).uniform(0, 50, 50))
        for times in (None, t):
            plain = local_polynomial(y, 9, time=times, derivative=1)
            when = (np.arange(50) if times is None else times) * pace
            found = local_polynomial((y + shift) * scale, 9, time=when, derivative=1)
            np.testing.assert_array_equal(found.degree, plain.degree)
            unit = scale / pace
            assert_close(found.value, plain.value * unit, 1e-9, plain.sigma * unit)
            np.testing.assert_allclose(found.sigma, plain.sigma * unit, rtol=1e-9)

    @pytest.mark.parametrize("known", [False, True])
    def test_a_degree_too_high_is_chosen_as_often_as_said(self, known):
        """One test of a coefficient that is 0; windows that have nothing in common."""
        window, level, trials = 13, 0.05, 20_000
        t = np.arange(window) - 6.0
        y = 5 + 3 * t - t**2 + rng(11).normal(size=(trials, window))
        options = {"max_degree": 3, "significance": level}
        found = local_polynomial(y, window, variance=1.0 if known else None, **options)
        too_high = np.count_nonzero(found.degree[:, 6] == 3)
        low, high = stats.binom.interval(1 - CHANCE, trials, level)
        assert low <= too_high <= high
        assert np.all(found.degree[:, 6] >= 2)
        # nothing but noise: three tests
        noise = local_polynomial(y - (5 + 3 * t - t**2), window, max_degree=3)
        zero = np.count_nonzero(noise.degree[:, 6] == 0) / trials
        assert 1 - zero == pytest.approx(1 - (1 - level) ** 3, abs=0.01)

    @pytest.mark.parametrize("degree", [0, 1, 2, 3])
    @pytest.mark.parametrize("n", [13, 20, 60])
    def test_sigma_covers(self, n, degree):
        """With Student's quantile, at the ends, beside them and in the middle."""
        trials = 20_000
        t = np.linspace(-1, 1, n)
        truth = np.polynomial.polynomial.polyval(t, [1.0, 2.0, -3.0, 4.0][: degree + 1])
        y = truth + rng(degree).normal(size=(trials, n))
        found = local_polynomial(y, 13, degree)
        variance = np.asarray(found.residual_variance)
        assert np.mean(variance) == pytest.approx(1, abs=4 * np.std(variance) / trials**0.5)
        freedom = np.asarray(found.degrees_of_freedom)[0]
        assert 2 / np.var(variance) == pytest.approx(freedom, rel=0.08)
        factor = stats.t.ppf(0.975, freedom)
        for i in (0, 3, 6, n // 2, n - 1):
            within = np.abs(found.value[:, i] - truth[i]) < factor * found.sigma[:, i]
            # values and variance have measurements in common: not Student's law exactly
            assert np.mean(within) == pytest.approx(0.95, abs=0.01)

    @pytest.mark.parametrize("window", [13, 15, 100_001])
    def test_a_window_may_be_longer_than_the_record(self, window):
        """One polynomial: its degrees of freedom are exact. Nothing is as long as the window."""
        found = local_polynomial(series(13), window, 2)
        assert found.degrees_of_freedom == 13 - 3
        whole = local_polynomial(series(13), 13, 2)
        np.testing.assert_allclose(found.value, whole.value, rtol=VECTOR, atol=VECTOR)

    @pytest.mark.parametrize("derivative", [0, 1, 2])
    def test_known_variances_cover(self, derivative):
        trials, n = 5_000, 30
        t = np.sort(rng(1).uniform(-1, 1, n))
        variances = 10 ** rng(2).uniform(-2, 2, n)
        c = np.array([1.0, -2.0, 3.0])
        truth = np.polynomial.polynomial.polyval(t, np.polynomial.polynomial.polyder(c, derivative))
        y = np.polynomial.polynomial.polyval(t, c)
        y = y + np.sqrt(variances) * rng(3).normal(size=(trials, n))
        found = local_polynomial(y, 11, 2, time=t, variance=variances, derivative=derivative)
        ratio = np.mean((found.value - truth) ** 2, axis=0) / found.sigma[0] ** 2
        low, high = stats.chi2.interval(1 - CHANCE / n, trials) / np.array(trials)
        assert np.all((low < ratio) & (ratio < high))

    def test_batches_and_threads_return_the_same_bits(self):
        y = gaps(series(12 * 500).reshape(3, 4, 500), 0.01)
        times = np.sort(rng(1).uniform(0, 500, (3, 4, 500)))
        for when in (None, times, times[0, 0]):
            one = local_polynomial(y, time=when, n_threads=1)
            many = local_polynomial(y, time=when, n_threads=3)
            for name in ("value", "sigma", "degree", "residual_variance", "degrees_of_freedom"):
                np.testing.assert_array_equal(getattr(one, name), getattr(many, name))
            for place in np.ndindex(3, 4):
                own = None if when is None else np.broadcast_to(when, y.shape)[place]
                alone = local_polynomial(y[place], time=own)
                np.testing.assert_array_equal(alone.value, one.value[place])
                np.testing.assert_array_equal(alone.sigma, one.sigma[place])
                assert isinstance(alone.residual_variance, float)

    @pytest.mark.parametrize(
        ("arguments", "error", "message"),
        [
            ({"y": 1.0}, ValueError, r"y has shape \(\); it must be \(..., N\)"),
            ({"y": [[1.0, INF]]}, ValueError, r"y\[0, 1\] is inf; a measurement must be"),
            ({"window": 4}, ValueError, "window is 4; it must be an odd number"),
            ({"window": 2.5}, TypeError, "window is 2.5"),
            ({"degree": 13}, ValueError, "degree is 13; it must be less than window"),
            ({"degree": 10, "window": 51}, ValueError, "degree is 10; it must be .* not above 9"),
            ({"degree": "best"}, ValueError, "degree is 'best'; it must be 'adaptive'"),
            ({"max_degree": 12}, ValueError, "max_degree is 12; it must be less than window - 1"),
            ({"degree": 1, "derivative": 2}, ValueError, "derivative is 2; it must be not above"),
            ({"significance": 1.0}, ValueError, "significance is 1; it must be between 0 and 1"),
            ({"time": [0, 1, 3, 2]}, ValueError, r"time\[3\] is 2; time must not decrease"),
            ({"time": [0, 1, NAN, 2]}, ValueError, r"time\[2\] is nan"),
            ({"time": [0, 1]}, ValueError, r"time has shape \(2,\); for a batch \(\) it must be"),
            ({"variance": [1, 0, 1, 1]}, ValueError, r"variance\[1\] is 0; it must be positive"),
            ({"variance": [1, 1]}, ValueError, r"variance has shape \(2,\)"),
            ({"variance": NAN}, ValueError, r"variance\[0\] is nan"),
        ],
    )
    def test_errors(self, arguments, error, message):
        with pytest.raises(error, match=message):
            local_polynomial(**({"y": [1.0, 2.0, 3.0, 4.0]} | arguments))

    def test_it_tells_what_it_did(self):
        assert repr(local_polynomial(np.arange(20.0) + series(20) * 1e-3, 5, 1)) == (
            "LocalPolynomial(value of shape (20,), 100% of degree 1, systematic error not included)"
        )
        assert "no polynomial" in repr(local_polynomial([NAN]))
