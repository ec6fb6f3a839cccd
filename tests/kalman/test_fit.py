"""The noise of plots and motion from a recording."""

from functools import cache

import numpy as np
import pytest
from checks import INF, NAN, rng
from kalman.scenes import EXACT, R, relative, root_of, simulated
from scipy import stats
from tolerances import CHANCE

from tertia.kalman import SingerModel, filter_series, fit_noise


def random_recording(seed):
    """Any manoeuvre, seen by one radar or two, with jitter, gaps or missed plots."""
    random = np.random.default_rng([77, seed])
    steps = int(random.integers(60, 501))
    alpha, ratio = np.exp(random.uniform(np.log([0.02, 0.02]), np.log([3, 30])))
    model = SingerModel(5.0, alpha / 5, 0.1 * ratio / 25, exact=True)
    dt = np.full(steps - 1, 5.0)
    if seed % 4 == 1:
        dt = random.uniform(1, 9, steps - 1)
    elif seed % 4 == 2:
        gap = random.uniform(0.001, 0.05)
        dt = np.where(np.arange(steps - 1) % 2, 5 - gap, gap)
    elif seed % 4 == 3:
        dt = random.exponential(5.0, steps - 1)
        dt[random.integers(0, steps - 1, 3)] *= 20
        dt[random.integers(0, steps - 1, 3)] = [0, 1e-6, 1e-3]
    x, angle = random.normal(size=3) * [50, 1, model.acceleration_sigma], []

    @cache
    def step(interval):
        return model.transition(interval), root_of(model.process_noise(interval))

    for interval in [0.0, *dt]:
        transition, root = step(interval)
        x = transition @ x + root @ random.normal(size=3)
        angle.append(x[0])
    z = np.array(angle) + np.sqrt(R) * random.normal(size=steps)
    if random.random() < 0.3:
        z[random.random(steps) < 0.2] = NAN
    return model, np.cumsum([0.0, *dt]), z


@pytest.fixture(scope="module")
def recordings():
    return simulated(EXACT, TestFit.COUNT, [5.0] * 299, seed=7)[1]


@pytest.fixture(scope="module")
def fits(recordings):
    return [fit_noise(z, dt=5.0) for z in recordings]


class TestFit:
    """The noise of plots and motion from a recording."""

    TRUTH = (0.05, 0.003, 0.1)
    NAMES = ("alpha", "acceleration_sigma", "measurement_sigma")
    COUNT = 100

    def values(self, fits):
        return np.array([[getattr(fit, name) for name in self.NAMES] for fit in fits])

    def test_errors_cover_the_truth(self, fits):
        """Of 100 recordings; alpha is told least and its law is not normal."""
        errors = np.array([relative(fit)[:3] for fit in fits])
        assert np.isfinite(errors).all()
        off = np.log(self.values(fits) / self.TRUTH) / errors
        assert np.all(np.mean(np.abs(off) < 3, axis=0) >= 0.97)
        for k in (1, 2):
            # binomial bounds of the numbers within one and two standard errors
            for width in (1, 2):
                share = stats.chi2.cdf(width**2, 1)
                few, many = stats.binom.interval(1 - CHANCE / 4, self.COUNT, share)
                within = np.count_nonzero(np.abs(off[:, k]) < width)
                assert few <= within <= many
        # the bias is a fraction of the error
        assert np.all(np.abs(np.mean(off[:, 1:], axis=0)) < 0.25)
        assert np.all(np.median(errors, axis=0) < [0.4, 0.15, 0.06])

    def test_likelihood_is_that_of_the_filter_and_largest(self, recordings, fits):
        for z, fit in zip(recordings[:5], fits, strict=False):
            best = filter_series(z, fit.measurement_sigma**2, fit.model(5.0))
            assert fit.log_likelihood == pytest.approx(best.log_likelihood, rel=1e-10)
            assert fit.count == best.count == 298
            for k in range(3):
                for factor in (0.97, 1.03):
                    alpha, acceleration, sigma = self.values([fit])[0] * np.where(
                        np.arange(3) == k, factor, 1
                    )
                    model = SingerModel(5.0, alpha, acceleration, exact=True)
                    other = filter_series(z, sigma**2, model)
                    assert other.log_likelihood < fit.log_likelihood

    def test_errors_are_the_curvature(self, recordings, fits):
        """Along the noise alone: of the logarithm of its sigma, others as they are."""
        z, fit = recordings[0], fits[0]
        logs = np.log(self.values([fit])[0])

        def likelihood(step):
            alpha, acceleration, sigma = np.exp(logs + step)
            model = SingerModel(5.0, alpha, acceleration, exact=True)
            return filter_series(z, sigma**2, model, store="final").log_likelihood

        h = 0.01 * np.eye(3)
        information = -np.array(
            [
                [
                    likelihood(a + b) - likelihood(a - b) - likelihood(b - a) + likelihood(-a - b)
                    for b in h
                ]
                for a in h
            ]
        ) / (4 * 0.01**2)
        covariance = np.linalg.inv(information)
        expected = np.sqrt(np.diagonal(covariance))
        np.testing.assert_allclose(relative(fit)[:3], expected, rtol=0.02)
        combined = np.array([-1, 2, 0])
        expected = np.sqrt(combined @ covariance @ combined)
        assert relative(fit)[3] == pytest.approx(expected, rel=0.02)

    @pytest.mark.parametrize("factor", [1e-3, 1000.0, 1e8])
    def test_the_unit_of_angle_does_not_matter(self, recordings, fits, factor):
        found = fit_noise(recordings[0] * factor, dt=5.0)
        expected = self.values(fits[:1])[0] * [1, factor, factor]
        assert self.values([found])[0] == pytest.approx(expected, rel=1e-5)
        assert relative(found) == pytest.approx(relative(fits[0]), rel=1e-3)

    @pytest.mark.parametrize("factor", [1e-9, 1000.0])
    def test_the_unit_of_time_does_not_matter(self, recordings, fits, factor):
        found = fit_noise(recordings[0], dt=5.0 * factor)
        expected = self.values(fits[:1])[0] / [factor, factor**2, 1]
        assert self.values([found])[0] == pytest.approx(expected, rel=1e-5)

    def test_several_series_have_smaller_errors(self, recordings):
        fit = fit_noise(recordings[:16].reshape(4, 4, 300), dt=5.0)
        off = np.log(self.values([fit])[0] / self.TRUTH) / relative(fit)[:3]
        assert np.all(np.abs(off) < 3)
        assert fit.count == 16 * 298
        single = np.median([relative(fit_noise(z, dt=5.0)) for z in recordings[:8]], axis=0)
        assert relative(fit) == pytest.approx(single / 4, rel=0.06)

    def test_gaps_irregular_times_and_wrap(self):
        random = rng(9)
        dt = random.uniform(1.0, 9.0, 199)
        z = simulated(EXACT, 6, dt, seed=9)[1] % 360
        z[random.random(z.shape) < 0.2] = NAN
        times = np.cumsum([0.0, *dt])
        fits = [fit_noise(one, time=times, period=360.0) for one in z]
        off = np.log(self.values(fits) / self.TRUTH) / [relative(fit)[:3] for fit in fits]
        assert np.all(np.abs(off) < 4)
        assert np.all(np.mean(np.abs(off) < 2, axis=0) >= 0.75)
        # unwrapped by hand
        straight = z[0].copy()
        there = ~np.isnan(straight)
        straight[there] = np.unwrap(straight[there], period=360)
        expected = self.values([fit_noise(straight, time=times)])
        np.testing.assert_allclose(self.values(fits[:1]), expected, rtol=1e-5)
        together = fit_noise(z[:4], time=np.tile(times, (4, 1)), period=360.0, n_threads=2)
        off = np.log(self.values([together])[0] / self.TRUTH) / relative(together)[:3]
        assert np.all(np.abs(off) < 3)
        assert np.all(relative(together) < relative(fits[0]))

    def test_threads_do_not_change_a_bit(self, recordings):
        one, many = (fit_noise(recordings[:8], dt=5.0, n_threads=n) for n in (1, 3))
        assert self.values([one]).tolist() == self.values([many]).tolist()
        assert one.log_likelihood == many.log_likelihood

    def test_plots_almost_at_the_same_time_change_little(self, recordings):
        """As of two radars; short intervals are no measure of the others."""
        times, z = 5.0 * np.arange(300), recordings[0]
        expected = fit_noise(z, time=times)
        for gap in (1e-3, 1e-13):
            twice = np.insert(times, 150, times[150] - gap), np.insert(z, 150, z[150] + 0.05)
            fit = fit_noise(twice[1], time=twice[0])
            off = np.log(self.values([fit])[0] / self.values([expected])[0])
            assert np.all(np.abs(off) < 0.2 * relative(expected)[:3])
        # the first of all, which tells a filter nothing of the rate but rounding
        start = np.insert(z, 1, z[0] + 0.05)
        one, two = (fit_noise(start, time=np.insert(times, 1, gap)) for gap in (0, 1e-13))
        assert self.values([two])[0] == pytest.approx(self.values([one])[0], rel=1e-8)
        # half of the intervals
        both = np.sort(np.r_[times, times + 1e-3]), np.repeat(z, 2) + 0.02 * rng(1).normal(size=600)
        fit = fit_noise(both[1], time=both[0])
        model = SingerModel(1.0, expected.alpha, expected.acceleration_sigma, exact=True)
        for r in (1e-4, 1e-3, 1e-2):
            other = filter_series(both[1], r, model, time=both[0])
            assert fit.log_likelihood > other.log_likelihood

    def test_nothing_is_more_likely_than_the_fit(self):
        """Than the truth, for many kinds of motion and recordings; and what errors cover it."""
        off, errors, fast = [], [], []
        for seed in range(self.COUNT):
            model, times, z = random_recording(seed)
            fit = fit_noise(z, time=times)
            truth = filter_series(z, R, model, time=times, store="final").log_likelihood
            best = filter_series(z, fit.measurement_sigma**2, fit.model(1.0), time=times)
            assert fit.log_likelihood >= truth - 1e-6, seed
            assert fit.log_likelihood == pytest.approx(best.log_likelihood, rel=1e-9, abs=1e-6)
            values = np.array([fit.alpha, fit.acceleration_sigma, fit.measurement_sigma])
            true = np.array([model.alpha, model.acceleration_sigma, np.sqrt(R)])
            density = 2 * model.acceleration_sigma**2 / model.alpha
            with np.errstate(divide="ignore"):
                off.append(np.log([*(values / true), fit.density / density]))
            errors.append(relative(fit))
            fast.append(model.alpha > 1 / 5)
        off, errors, fast = np.abs(off), np.array(errors), np.array(fast)
        # alpha and the acceleration: of manoeuvres slower than an interval, and if they are told
        told = np.isfinite(errors) & ~(fast[:, np.newaxis] & np.array([True, True, False, False]))
        assert np.all(np.sum(told, axis=0) > [60, 60, 90, 90])
        # of 5000 such recordings, 0.69 and 0.94 are within one and two errors
        for width, share in ((1, 0.69), (2, 0.94)):
            for k in range(4):
                few, many = stats.binom.interval(1 - CHANCE / 8, np.sum(told[:, k]), share)
                assert few <= np.sum(off[told[:, k], k] < width * errors[told[:, k], k]) <= many

    def test_a_recording_of_white_acceleration(self):
        """Alpha is infinite; its combination with the acceleration is told."""
        random = np.random.default_rng(2)
        rate = np.cumsum(0.01 * random.standard_normal(200))
        z = 4 * np.cumsum(rate) + 0.02 * random.standard_normal(200)
        fit = fit_noise(z, dt=4.0)
        assert fit.limits == ("white acceleration",)
        assert np.isinf(fit.sigma).tolist() == [True, True, False]
        assert np.log(fit.density / (0.01**2 / 4)) < 2 * relative(fit)[3] < 0.5
        assert fit.density == pytest.approx(2 * fit.acceleration_sigma**2 / fit.alpha, rel=1e-14)
        for alpha in np.geomspace(0.01, 100, 17):
            for density in fit.density * np.array([0.7, 0.85, 1, 1.2, 1.5]):
                model = SingerModel(4.0, alpha, np.sqrt(0.5 * density * alpha), exact=True)
                for r in fit.measurement_sigma**2 * np.array([0.8, 1, 1.2]):
                    assert filter_series(z, r, model).log_likelihood < fit.log_likelihood
        assert repr(fit).startswith("NoiseFit(white acceleration: density 2.15e-05 ± 19%, meas")

    def test_a_recording_of_constant_acceleration(self):
        steps = np.arange(200.0)
        z = 3 + 0.2 * steps + 0.02 * steps**2 + 0.1 * rng(1).normal(size=200)
        fit = fit_noise(z, dt=4.0)
        assert fit.limits == ("constant acceleration",)
        assert fit.alpha == 0
        assert fit.acceleration_sigma == pytest.approx(0.04 / 16, rel=0.02)
        assert np.isinf([*fit.sigma, fit.density_sigma]).tolist() == [1, 1, 0, 1]
        assert fit.density == INF
        assert repr(fit).startswith("NoiseFit(constant acceleration: measurement_sigma 0.")

    def test_a_recording_of_constant_rate(self):
        """The noise is told all the same: its standard deviation, of 298 values."""
        z = 3 + 0.2 * np.arange(300) + 0.1 * rng(1).normal(size=300)
        fit = fit_noise(z, dt=5.0)
        assert fit.limits == ("constant rate",)
        line = np.polynomial.Polynomial.fit(np.arange(300), z, 1)(np.arange(300))
        sigma = np.sqrt(np.sum((z - line) ** 2) / 298)
        assert fit.measurement_sigma == pytest.approx(sigma, rel=1e-9)
        assert relative(fit)[:3] == pytest.approx([INF, INF, np.sqrt(0.5 / 298)])
        assert (fit.alpha, fit.acceleration_sigma, fit.density, fit.density_sigma) == (0, 0, 0, INF)
        assert repr(fit) == "NoiseFit(constant rate: measurement_sigma 0.0924 ± 4%)"

    def test_a_recording_without_noise(self):
        z = simulated(SingerModel(1.0, 0.2, 1.0, exact=True), 1, [1.0] * 299, r=0, seed=2)[1][0]
        fit = fit_noise(z, dt=1.0)
        assert fit.measurement_sigma < 0.02
        off = np.log([fit.alpha / 0.2, fit.acceleration_sigma]) / relative(fit)[:2]
        assert np.all(np.abs(off) < 3)
        smooth = fit_noise(np.sin(np.arange(200) / 30), dt=1.0)
        assert smooth.limits == ("no noise",)
        assert np.isinf(smooth.sigma).tolist() == [False, False, True]
        assert "measurement_sigma" not in repr(smooth)

    def test_is_printed_usefully(self, fits):
        fit = fits[0]
        assert repr(fit).startswith(f"NoiseFit(alpha {fit.alpha:.3g} ± ")
        assert f"measurement_sigma {fit.measurement_sigma:.3g} ± " in repr(fit)
        assert fit.model(2.0) == SingerModel(2.0, fit.alpha, fit.acceleration_sigma, exact=True)

    @pytest.mark.parametrize(
        "angle",
        [np.arange(20.0), 0.1 * np.arange(200) + 0.7, np.zeros(50), 0.2 * np.arange(200.0) ** 2],
    )
    def test_lines_and_parabolas_are_refused(self, angle):
        with pytest.raises(ValueError, match="z lies on"):
            fit_noise(angle, dt=0.3)

    @pytest.mark.parametrize(
        ("call", "error", "message"),
        [
            (fit_noise, ValueError, "either dt or time"),
            (lambda z: fit_noise(z, dt=5.0, time=np.arange(30)), ValueError, "either dt or time"),
            (lambda z: fit_noise(z[:9], dt=5.0), ValueError, "z has 9 measurements; at least 10"),
            (
                lambda z: fit_noise(z[:15].reshape(3, 5) * NAN, dt=5.0),
                ValueError,
                "z has 0 measurements",
            ),
            (lambda z: fit_noise(z.reshape(15, 2), dt=5.0), ValueError, r"\bz\b"),
            (lambda z: fit_noise(z, dt=-5.0), ValueError, "dt is -5"),
            (lambda z: fit_noise(z, dt=0.0), ValueError, r"\bdt\b"),
            (lambda z: fit_noise(z, dt="5"), TypeError, "dt is '5'"),
            (lambda z: fit_noise(z, time=np.zeros(30)), ValueError, "time"),
            (lambda z: fit_noise(z, time=np.zeros(29)), ValueError, "time has shape"),
            (lambda z: fit_noise(z, time=-np.arange(30)), ValueError, r"time\[1\]"),
            (lambda z: fit_noise(z, dt=5.0, period=0), ValueError, "period is 0"),
            (lambda z: fit_noise(np.r_[z, INF], dt=5.0), ValueError, r"z\[30\] is inf"),
            (lambda z: fit_noise(1.0, dt=5.0), ValueError, "z is a single number"),
            (lambda z: fit_noise(["x"] * 20, dt=5.0), TypeError, "z has dtype"),
            (lambda z: fit_noise(z, dt=5.0, n_threads=0), ValueError, "n_threads is 0"),
        ],
    )
    def test_errors(self, call, error, message):
        with pytest.raises(error, match=message):
            call(rng(1).normal(size=30))
