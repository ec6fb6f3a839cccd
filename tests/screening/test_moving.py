import numpy as np
import pytest
from checks import assert_batch_is_loop, assert_same, assert_threads, rng
from reference import screening as reference
from tolerances import PARITY

from tertia.screening import moving_polynomial


def turning(n, seed, share=0.04, gaps=False):
    random = rng(seed)
    t = np.arange(n, dtype=float)
    y = 10 * np.sin(t / 10) + random.normal(size=n)
    bad = random.uniform(size=n) < share
    y += np.where(bad, random.uniform(6, 12, n) * random.choice([-1, 1], n), 0)
    if gaps:
        y[random.uniform(size=n) < 0.15] = np.nan
    return y, bad


OPTIONS = [
    {},
    {"window": 7, "degree": 1, "k": 3.0},
    {"window": 21, "degree": 4},
    {"window": 5, "degree": 0},
]


class TestAgreesWithTheFormulas:
    @pytest.mark.parametrize("options", OPTIONS, ids=str)
    @pytest.mark.parametrize("n", [5, 12, 13, 14, 120])
    @pytest.mark.parametrize("gaps", [False, True])
    def test_steps(self, n, options, gaps):
        self.check(turning(n, n, gaps=gaps)[0], options)

    @pytest.mark.parametrize("gaps", [False, True])
    def test_times(self, gaps):
        y = turning(80, 1, gaps=gaps)[0]
        time = np.sort(np.round(rng(2).uniform(1e6, 1e6 + 300, 80), 0))
        self.check(y, {"time": time})

    @pytest.mark.parametrize("period", [360.0, 2 * np.pi])
    def test_angles(self, period):
        t = np.arange(200)
        angle = period * (t / 50 + 0.01 * rng(3).normal(size=200))
        angle[[20, 90, 91]] += period * np.array([0.2, -0.3, 0.45])
        self.check(np.mod(angle, period), {"period": period})
        assert set(
            moving_polynomial(np.mod(angle, period), period=period).outlier.nonzero()[0]
        ) >= {
            20,
            90,
            91,
        }

    def check(self, y, options):
        outlier, cleaned, s = reference.moving_polynomial(y, **options)
        found = moving_polynomial(y, **options)
        np.testing.assert_array_equal(found.outlier, outlier)
        np.testing.assert_allclose(found.cleaned, cleaned, rtol=PARITY, atol=1e-9)
        np.testing.assert_allclose(found.variance, s**2, rtol=1e-8)
        np.testing.assert_allclose(found.threshold, options.get("k", 4.0) * s, rtol=1e-8)
        np.testing.assert_allclose(found.mean, np.nanmean(cleaned), rtol=1e-8, atol=1e-9)


def test_most_outliers_of_a_turn_are_found():
    y, bad = zip(*(turning(500, seed) for seed in range(40)), strict=True)
    found = moving_polynomial(np.array(y)).outlier
    bad = np.array(bad)
    assert found[bad].mean() > 0.96
    assert found[~bad].mean() < 0.002


def test_an_exact_polynomial_has_no_outliers_but_the_one_that_is():
    t = np.linspace(0, 1, 50)
    y = 1e5 + 30 * t - 4 * t**2
    assert not moving_polynomial(y, time=t).outlier.any()
    y[30] += 1e3
    found = moving_polynomial(y, time=t)
    assert found.outlier.nonzero()[0].tolist() == [30]
    assert found.cleaned[30] == pytest.approx(y[30] - 1e3, abs=1e-8)


def test_time_and_unit_do_not_matter():
    y, _ = turning(100, 7)
    plain = moving_polynomial(y)
    other = moving_polynomial(1000 * y, time=1e5 + 0.25 * np.arange(100))
    np.testing.assert_array_equal(other.outlier, plain.outlier)
    np.testing.assert_allclose(other.cleaned, 1000 * plain.cleaned, rtol=1e-9, atol=1e-6)


def test_too_few_neighbours_are_not_judged():
    y = np.array([0.0, 0.0, 50.0, 0.0, 0.0])
    found = moving_polynomial(y)
    assert not found.outlier.any()
    assert np.isnan([found.variance, found.threshold]).all()
    none = moving_polynomial(np.full(20, np.nan))
    assert np.isnan([none.mean, none.variance]).all()
    assert not none.outlier.any()
    assert moving_polynomial([]).cleaned.size == 0
    # all at one instant
    assert not moving_polynomial(turning(20, 1)[0], time=np.zeros(20)).outlier.any()


def test_batches_and_threads():
    y = np.array([turning(60, seed, gaps=True)[0] for seed in range(300)])
    assert_batch_is_loop(moving_polynomial, y[:6].reshape(2, 3, 60))
    assert_threads(lambda **options: moving_polynomial(y, **options))
    times = np.sort(rng(1).uniform(0, 60, y.shape))
    each = moving_polynomial(y, time=times)
    assert_same(moving_polynomial(y[3], time=times[3]).cleaned, each.cleaned[3])


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda y: moving_polynomial(y, 12), ValueError, "window is 12; it must be an odd number"),
        (lambda y: moving_polynomial(y, 5, 2), ValueError, "degree is 2; it must be less than"),
        (lambda y: moving_polynomial(y, 31, 10), ValueError, "degree is 10"),
        (lambda y: moving_polynomial(y, k=0), ValueError, "k is 0; it must be a positive"),
        (lambda y: moving_polynomial(y, k="4"), TypeError, "k is '4'"),
        (lambda y: moving_polynomial(y, period=0), ValueError, "period is 0"),
        (lambda y: moving_polynomial(y, time=[1, 2]), ValueError, r"time has shape \(2,\)"),
        (lambda y: moving_polynomial(y, time=-np.arange(20)), ValueError, r"time\[1\] is -1"),
        (lambda y: moving_polynomial(np.r_[y, np.inf]), ValueError, r"y\[20\] is inf"),
        (lambda y: moving_polynomial(np.r_[y, 1e13], period=360), ValueError, r"y\[20\] is 1000"),
        (lambda y: moving_polynomial(1.0), ValueError, "y is a single number"),
    ],
)
def test_mistakes(call, error, message):
    y = turning(20, 5)[0]
    with pytest.raises(error, match=message):
        call(y)
