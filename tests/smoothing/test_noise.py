"""Noise that is not as stated: lasting, larger, with outliers and jumps."""

import mpmath
import numpy as np
import pytest
from checks import NAN, assert_same, in_region, rng
from reference import smoothing as reference

from tertia.smoothing import smooth

SHARE = 0.95  # of noise with a given correlation time
STATED = {"correlation_time": 0.0, "robust": False}
STEPS = np.arange(80)


def path(runs, axes=2, q=0.01, seed=0):
    """Positions with white jerk, in units of the noise."""
    random, f = rng(seed), reference.transition(1.0).astype(float)
    root = np.linalg.cholesky(reference.noise(1.0, q).astype(float))
    x = np.zeros((runs, 3, axes))
    positions = []
    for _ in STEPS:
        positions.append(x[:, 0])
        x = f @ x + root @ random.standard_normal(x.shape)
    return np.stack(positions, axis=1)


def lasting(shape, correlation, seed):
    errors = rng(seed).standard_normal(shape)
    for k in range(1, shape[1]):
        errors[:, k] *= np.sqrt(1 - correlation**2)
        errors[:, k] += correlation * errors[:, k - 1]
    return errors


def judged(found, truth):
    """RMSE of the positions, and the share of 95 % ellipses that hold the truth."""
    error = found.position - truth
    inside = in_region(error, found.position_covariance)
    return np.sqrt(np.mean(error**2)), np.mean(inside)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("time", [0.3, 20.0])
def test_parity(d, time):
    times = np.sort(rng(d).uniform(0, 20, 12))
    times[5] = times[4]
    y = rng(d + 1).normal(size=(12, d))
    y[3] = NAN
    a = rng(d + 2).normal(size=(12, d, d))
    covariance = a @ np.swapaxes(a, 1, 2) + 0.3 * np.eye(d)
    initial = np.linspace(1, 2, 3 * d), np.diag(np.linspace(20, 40, 3 * d))
    found = smooth(
        y, covariance, time=times, jerk=0.02, initial=initial, correlation_time=time, robust=False
    )
    mean, matrix, innovation, _ = reference.smooth(
        y, covariance, times, 0.02, initial, (SHARE, time)
    )
    sigma = np.sqrt(np.diagonal(matrix, axis1=1, axis2=2))
    np.testing.assert_allclose((found.mean - mean) / sigma, 0, atol=1e-9)
    unit = sigma[:, :, np.newaxis] * sigma[:, np.newaxis, :]
    np.testing.assert_allclose(found.covariance / unit, matrix / unit, atol=1e-7)
    np.testing.assert_allclose(found.innovation, innovation, atol=1e-9)
    assert found.correlation_time == time


@pytest.mark.parametrize("seed", range(4))
def test_nothing_known_of_the_first_state(seed):
    """In 50 digits: a quadratic with flat priors, white jerk, lasting noise."""
    n, q, time = 14, 0.02, 6.0
    random = rng(seed)
    t = np.sort(random.uniform(0, 20, n))
    y = random.normal(size=n) + 0.1 * t**2
    found = smooth(
        y[:, np.newaxis], 1.0, time=t, jerk=q, initial=None, correlation_time=time, robust=False
    )
    with mpmath.workdps(50):
        times = [mpmath.mpf(value - t[0]) for value in t]
        walk = mpmath.matrix(n)
        noise = mpmath.matrix(n)
        for i, a in enumerate(times):
            for j, b in enumerate(times):
                s, late = min(a, b), max(a, b) - min(a, b)
                # integral of (s - u)² (s + late - u)² / 4 over u from 0 to s
                walk[i, j] = q * (s**5 / 5 + late * s**4 / 2 + late**2 * s**3 / 3) / 4
                noise[i, j] = SHARE * mpmath.exp(-abs(a - b) / time) + (1 - SHARE) * (i == j)
        line = mpmath.matrix([[1, a, a * a / 2] for a in times])
        inverse = (walk + noise) ** -1
        known = (line.T * inverse * line) ** -1
        fit = known * line.T * inverse * mpmath.matrix(list(y))
        gain = walk * inverse
        mean = line * fit + gain * (mpmath.matrix(list(y)) - line * fit)
        rest = line - gain * line
        covariance = walk - gain * walk + rest * known * rest.T
        exact = np.array([float(value) for value in mean])
        sigma = np.array([float(mpmath.sqrt(covariance[i, i])) for i in range(n)])
    np.testing.assert_allclose((found.position[:, 0] - exact) / sigma, 0, atol=1e-9)
    # of the first variances, far smaller than those before the last plots, rounding leaves less
    np.testing.assert_allclose(found.position_covariance[:, 0, 0] / sigma**2, 1, rtol=0, atol=3e-5)


def test_healthy_tracks_do_not_pay():
    truth = path(40)
    y = truth + rng(1).standard_normal(truth.shape)
    plain, found = smooth(y, 1.0, **STATED), smooth(y, 1.0)
    assert judged(found, truth)[0] < 1.02 * judged(plain, truth)[0]
    assert judged(found, truth)[1] == pytest.approx(judged(plain, truth)[1], abs=0.02)
    assert np.mean(found.outlier) < 2e-3
    unchanged = np.all(found.mean == plain.mean, axis=(1, 2))
    assert np.mean(unchanged) > 0.5


@pytest.mark.parametrize("correlation", [0.5, 0.9])
def test_noise_that_lasts(correlation):
    truth = path(30, seed=2)
    y = truth + lasting(truth.shape, correlation, 3)
    (plain, before), (rmse, inside) = (
        judged(smooth(y, 1.0, **options), truth) for options in (STATED, {})
    )
    assert rmse < 1.02 * plain
    assert before < 0.8
    assert 0.9 < inside < 0.99


def test_sigmas_that_are_wrong():
    truth = path(30, seed=4)
    noise = rng(5).standard_normal(truth.shape)
    small = smooth(truth + 2 * noise, 1.0)
    assert np.median(small.noise_factor) == pytest.approx(2, rel=0.1)
    rmse, inside = judged(small, truth)
    assert 0.9 < inside < 0.99
    assert rmse < judged(smooth(truth + 2 * noise, 1.0, **STATED), truth)[0]
    # a sigma that is stated too large is believed
    large = smooth(truth + noise / 2, 1.0)
    assert (large.noise_factor == 1).all()
    assert judged(large, truth)[1] > 0.97


# of 30 series with 30 % outliers, 4 to 6 take them for noise: they flag few and claim more
@pytest.mark.parametrize(("share", "found_at_least"), [(0.1, 0.95), (0.2, 0.95), (0.3, 0.65)])
def test_outliers(share, found_at_least):
    truth, random = path(30, seed=6), rng(7)
    hit = random.uniform(size=truth.shape[:2]) < share
    wrong = random.uniform(8, 15, truth.shape) * random.choice([-1, 1], truth.shape)
    y = truth + random.standard_normal(truth.shape) + hit[..., np.newaxis] * wrong
    found = smooth(y, 1.0)
    rmse, inside = judged(found, truth)
    assert rmse < 0.4 * judged(smooth(y, 1.0, **STATED), truth)[0]
    assert inside > 0.86
    assert np.mean(found.outlier[hit]) > found_at_least
    assert np.mean(found.outlier[~hit]) < 0.03


@pytest.mark.parametrize("length", [1, 6])
def test_a_run_of_outliers(length):
    truth = path(20, seed=8)
    y = truth + rng(9).standard_normal(truth.shape)
    y[:, 40 : 40 + length] += 30.0
    found = smooth(y, 1.0)
    assert np.mean(found.outlier[:, 40 : 40 + length]) > 0.99
    assert judged(found, truth)[0] < 0.7
    assert judged(found, truth)[1] > 0.9


def test_a_jump():
    truth = path(20, seed=10)
    truth[:, 40:] += 50.0
    y = truth + rng(11).standard_normal(truth.shape)
    found = smooth(y, 1.0)
    rmse, inside = judged(found, truth)
    assert rmse < 0.6
    assert inside > 0.9
    assert np.mean(found.outlier) < 0.01


def test_threads_and_axes():
    y = path(6, seed=12) + lasting((6, 80, 2), 0.8, 13)
    found = smooth(y, 1.0, n_threads=1)
    assert_same(found, smooth(y, 1.0, n_threads=2))
    one = smooth(y[3], 1.0)
    np.testing.assert_array_equal(one.mean, found.mean[3])
    turned = smooth(y[3] @ np.array([[0.6, -0.8], [0.8, 0.6]]).T, 1.0)
    np.testing.assert_allclose(
        turned.position, one.position @ np.array([[0.6, -0.8], [0.8, 0.6]]).T, atol=1e-5
    )
    four = smooth(np.concatenate([y[3], y[4]], axis=-1), 1.0)
    assert four.correlation_time == 0


def test_what_is_too_short_stays_as_stated():
    y = np.array([[0.0], [3.0], [-4.0]])
    assert_same(smooth(y, 1.0), smooth(y, 1.0, **STATED))
    empty = smooth(np.full((5, 2), NAN), 1.0)
    assert np.isnan(empty.mean).all()


def test_representation():
    y = path(1, seed=14)[0] + 3 * rng(15).standard_normal((80, 2))
    y[50] += 100.0
    text = repr(smooth(y, 1.0))
    assert "noise factor" in text
    assert "1 outlier" in text
    assert text.endswith("systematic error not included)")


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"correlation_time": -1.0}, ValueError, "correlation_time is -1.0; it must be"),
        ({"correlation_time": NAN}, ValueError, "correlation_time is nan"),
        ({"correlation_time": "x"}, TypeError, "correlation_time is 'x'"),
        ({"robust": 1}, TypeError, "robust is 1; it must be True or False"),
    ],
)
def test_mistakes(options, error, message):
    with pytest.raises(error, match=message):
        smooth(np.zeros((5, 2)), 1.0, **options)
    with pytest.raises(ValueError, match="up to 3"):
        smooth(np.zeros((5, 4)), 1.0, correlation_time=1.0)


def test_the_first_plots_of_several_sensors():
    """Plots that are close in time say little of the first state; late times have few digits."""
    random = np.random.default_rng(8)
    for start in (0.0, 880e3):
        for _ in range(10):
            ends = [np.arange(random.uniform(0, period), 160.0, period) for period in (4, 6, 10)]
            time = start + np.sort(np.concatenate(ends))
            position = np.outer(time - start, [180.0, 90.0])
            covariance = np.array([[3e3, 5e3], [5e3, 2e4]])
            # less noise than stated, so that models of the noise are compared
            noise = 0.5 * random.multivariate_normal(np.zeros(2), covariance, len(time))
            options = {"time": time, "jerk": 0.1, "robust": False}
            found = smooth(position + noise, covariance, **options)
            exact = smooth(position + noise, covariance, correlation_time=0.0, **options)
            assert np.all(np.linalg.eigvalsh(found.covariance) > 0)
            ratio = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)) / np.sqrt(
                np.diagonal(exact.covariance, axis1=1, axis2=2)
            )
            # where noise lasts, positions are less certain; 1e-4 is the start that is assumed
            assert np.all(ratio[:, :2] > 1 - 3e-4)
            assert np.all((ratio > 0.5) & (ratio < 3.0))


@pytest.mark.parametrize("variance", [100.0, 300.0, 400.0, 800.0])
def test_jumps_of_kilometres_whatever_is_stated(variance):
    # where rounding leaves too little of the first state, smoothing begins anew near what it found
    random = rng(41)
    time = np.sort(random.uniform(0.0, 900.0, 700))
    time = np.sort(np.r_[time[(time < 500) | (time > 545)], time[::25]])
    truth = np.stack([210.0 * time, 40.0 * time], axis=1)
    y = truth + 20.0 * random.standard_normal(truth.shape)
    wrong = random.uniform(size=len(time)) < 0.03
    y[wrong] += random.uniform(-2e4, 2e4, (int(wrong.sum()), 2))
    found = smooth(y, variance, time=time)
    assert np.mean(found.outlier[wrong]) > 0.9
    assert np.sqrt(np.mean((found.position - truth) ** 2)) < 10.0


@pytest.mark.parametrize(("first", "seed"), [([0.61, 7.9], 1), ([3.0, 3.0], 4), ([0.1, 8.0], 0)])
def test_first_instants_after_outliers_of_kilometres(first, seed):
    """The fit with outliers is so restless that the first state seems to be unknown."""
    random = rng(seed)
    t = np.concatenate([np.cumsum([0.0, *first]), np.sum(first) + 3.0 * np.arange(1, 200)])
    y = np.column_stack([200.0 * t, 10.0 * t]) + 25.0 * random.normal(size=(len(t), 2))
    wrong = random.random(len(t)) < 0.05
    wrong[:5] = False
    y[wrong] += 3000.0 * random.normal(size=(wrong.sum(), 2))
    found = smooth(y, 25.0**2, time=t)
    y[found.outlier] = np.nan
    options = {"robust": False, "correlation_time": 0.0}
    expected = smooth(y, 25.0**2, time=t, jerk=found.jerk, **options)
    assert np.all(found.sigma < 2.0 * expected.sigma)


def test_outliers_at_any_place():
    """Flights with a turn, of which plots are off by kilometres, one of the first three, too."""
    rmse, widest = [], 0.0
    for seed in range(40):
        random = rng(1000 + seed)
        t = np.cumsum(random.exponential(2.0, 150) + 0.05)
        turn = np.cumsum(
            np.where((t > 100) & (t < 160), np.radians(1.0), 0.0) * np.diff(t, prepend=0)
        )
        velocity = 150.0 * np.column_stack([np.sin(turn), np.cos(turn)])
        truth = np.cumsum(velocity * np.diff(t, prepend=0)[:, np.newaxis], axis=0)
        y = truth + 20.0 * random.normal(size=truth.shape)
        wrong = random.random(150) < 0.04
        wrong[random.integers(3)] = True
        y[wrong] += 20_000.0 * random.normal(size=(wrong.sum(), 2))
        found = smooth(y, 20.0**2, time=t)
        rmse.append(np.sqrt(np.mean((found.position - truth) ** 2)))
        widest = max(widest, np.max(found.sigma[:, :2]))
    # some tracks lose their turn where it begins with outliers
    assert np.mean(np.array(rmse) < 20.0) >= 0.85
    assert widest < 1000.0


def test_a_model_whose_likelihood_is_lost_to_rounding_does_not_spoil_the_others():
    """Variances of very different size: everything was nan."""
    random = np.random.default_rng(15)
    y = np.round(random.standard_normal((13, 3)) * 50)
    variances = 10 ** random.uniform(-8, 8, (13, 3))
    found = smooth(y, variances, time=1e9 + 0.1 * np.arange(13), robust=False, jerk=1e-3)
    assert np.all(np.isfinite(found.mean))
    assert np.all(np.isfinite(found.covariance))


def test_no_plots_with_a_prior_and_correlated_noise():
    prior = np.zeros(6), np.eye(6)
    found = smooth(np.empty((0, 2)), 1.0, initial=prior, correlation_time=5.0)
    assert found.mean.shape == (0, 6)


@pytest.mark.parametrize("step", [3.0, 10.0])
def test_random_walks_with_outliers(step):
    """Steps were taken for outliers and for noise that lasts: 78 % inside, errors of 3.6 σ."""
    random = rng(31)
    truth = np.cumsum(step * random.standard_normal((20, 100, 2)), axis=1)
    y = truth + random.standard_normal(truth.shape)
    wrong = random.random((20, 100)) < 0.02
    y[wrong] += 10 * step * random.choice([-1.0, 1.0], (wrong.sum(), 2))
    found = smooth(y, 1.0)
    rmse, inside = judged(found, truth)
    assert rmse < 1.8
    assert inside > 0.9


def interleaved(bias, runs=40, seed=0):
    """Plots of two sensors in turn, each precise in the direction in which the other one is not."""
    truth = path(runs, q=1e-4, seed=seed)
    covariance = np.tile(np.diag([9.0, 1.0]), (len(STEPS), 1, 1))
    covariance[1::2] = np.diag([1.0, 9.0])
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    errors = rng(seed + 1).standard_normal(truth.shape)
    biases = bias * rng(seed + 2).standard_normal((runs, 2, 2))
    errors[:, ::2] += biases[:, :1]
    errors[:, 1::2] += biases[:, 1:]
    return truth, truth + sigma * errors, covariance


def test_two_sensors_in_turn_with_systematic_errors():
    truth, y, covariance = interleaved(1.0, runs=80)
    found = smooth(y, np.broadcast_to(covariance, (*y.shape, 2)), time=STEPS)
    rmse, held = judged(found, truth)
    rmse_stated, held_stated = judged(smooth(y, covariance, time=STEPS, **STATED), truth)
    assert np.all(found.correlation_time == 0)
    assert rmse < 1.05 * rmse_stated
    # where the two sensors happen to agree, nothing shows their errors
    assert held > 0.75
    assert held_stated < 0.4


def test_two_sensors_in_turn_without_systematic_errors():
    truth, y, covariance = interleaved(0.0)
    found = smooth(y, np.broadcast_to(covariance, (*y.shape, 2)), time=STEPS)
    rmse, held = judged(found, truth)
    assert rmse < 1.03 * judged(smooth(y, covariance, time=STEPS, **STATED), truth)[0]
    assert 0.92 < held < 0.98


@pytest.mark.parametrize("length", [5, 6, 12])
def test_a_stay_between_two_moves(length):
    """A, B, C: the plots at B were taken for outliers between two jumps, and left out."""
    truth = np.zeros((10, 80, 2))
    truth[:, 30:] = [60.0, 0.0]
    truth[:, 30 + length :] = [60.0, 80.0]
    y = truth + rng(32).standard_normal(truth.shape)
    found = smooth(y, 1.0)
    rmse, inside = judged(found, truth)
    assert rmse < 0.7
    assert inside > 0.9
    assert np.mean(found.outlier) < 0.01


@pytest.mark.parametrize("length", [5, 8])
def test_a_stay_and_a_return(length):
    """A, B, A: the plots at B may be a fault or a stay, and the region said it was a fault."""
    stay = np.zeros((20, 80, 2))
    stay[:, 30 : 30 + length] = [60.0, 30.0]
    found = smooth(stay + rng(35).standard_normal(stay.shape), 1.0)
    for truth in (stay, np.zeros_like(stay)):
        assert judged(found, truth)[1] > 0.9
        error = found.position - truth
        inverse = np.linalg.inv(found.position_covariance)
        squares = np.einsum("...i,...ij,...j", error, inverse, error)
        assert np.mean(squares[:, 30 : 30 + length] < 5.991) > 0.8


def about_a_place(size, steps=100):
    """Positions, and plots of them."""
    truth = size * lasting((20, steps, 2), 0.7, 33)
    return truth, truth + rng(34).standard_normal(truth.shape)


@pytest.mark.parametrize(("size", "steps"), [(1.8, 100), (2.8, 100), (6.0, 100), (2.8, 600)])
def test_positions_about_a_place(size, steps):
    """The motion was taken for larger noise that lasts: 46 % inside, errors of twice the size."""
    truth, y = about_a_place(size, steps)
    rmse, inside = judged(smooth(y, 1.0), truth)
    assert rmse < 1.4
    assert inside > 0.9


def test_larger_noise_that_lasts_or_a_motion_about_a_place():
    """The same plots as in the test before, of a target that rests: both are included."""
    wander, y = about_a_place(2.8)
    assert judged(smooth(y, 1.0), np.zeros_like(wander))[1] > 0.75


@pytest.mark.parametrize("q", [1e-12, 1e-9])
def test_times_from_a_second_to_a_day_apart(q):
    """After a gap, rounding left no digit of what was far more certain than the state before it."""
    for seed in range(3):
        gaps = 10 ** rng(50 + seed).uniform(0, np.log10(86_400), 13)
        times = np.concatenate([[0.0], np.cumsum(gaps)])
        y = rng(60 + seed).normal(size=(14, 1))
        options = {"jerk": q, "correlation_time": 3600.0, "robust": False}
        found = smooth(y, 1.0, time=times, **options)
        prior = None, (SHARE, 3600.0)
        mean, matrix, *_ = reference.smooth(y, np.ones((14, 1, 1)), times, q, *prior)
        sigma = np.sqrt(np.diagonal(matrix, axis1=1, axis2=2))
        np.testing.assert_allclose((found.mean - mean) / sigma, 0, atol=1e-4)
        np.testing.assert_allclose(found.sigma[:, 0] / sigma[:, 0], 1, rtol=1e-6)


def swell(time, period, random):
    """Waves of many periods and of unit standard deviation: heights, and their rates."""
    rate = 2 * np.pi / period * (1 + 0.15 * random.standard_normal(40))
    phase = np.outer(time, rate) + random.uniform(0, 2 * np.pi, 40)
    height = np.sin(phase).sum(axis=1) / np.sqrt(20)
    return height, (rate * np.cos(phase)).sum(axis=1) / np.sqrt(20)


def test_waves_of_many_periods():
    inside, velocities = [], []
    for seed in range(4):
        random = rng(seed)
        time = np.cumsum(random.uniform(0.5, 1.5, 300))
        height, rate = swell(time, 9, random)
        y = np.column_stack([0.5 * time, 1.4 * height]) + random.standard_normal((300, 2))
        with pytest.warns(UserWarning, match="oscillate"):
            found = smooth(y, 1.0, time=time)
        error = found.position - np.column_stack([0.5 * time, 1.4 * height])
        assert np.sqrt(np.mean(error[:, 1] ** 2)) < 0.7
        assert np.std(error[:, 0]) < 0.4
        inside.append(in_region(error, found.position_covariance))
        error = found.velocity - np.column_stack([np.full(300, 0.5), 1.4 * rate])
        velocities.append(in_region(error, found.velocity_covariance))
    assert 0.9 < np.mean(inside) < 0.99
    assert np.mean(velocities) > 0.9


def test_waves():
    """A buoy: the errors of its positions would not oscillate."""
    time = np.arange(300.0)
    phase = 2 * np.pi * time / 9
    waves = np.column_stack([0.5 * time + 1.5 * np.sin(phase), 2 * np.cos(phase)])
    for seed in range(3):
        y = waves + rng(seed).standard_normal(waves.shape)
        with pytest.warns(UserWarning, match=r"oscillate with a period of about (8\.9|9|9\.1),"):
            found = smooth(y, 1.0, time=time)
        error = found.position - waves
        assert np.sqrt(np.mean(error**2)) < 0.3
        assert np.mean(in_region(error, found.position_covariance)) > 0.9
        with pytest.warns(UserWarning, match="oscillate"):
            smooth(np.stack([waves, y]), 1.0, dt=1.0)
    # with a jerk, they are motion; no warning
    found = smooth(y, 1.0, time=time, jerk=1.0)
    assert np.sqrt(np.mean((found.position - waves) ** 2)) < 0.7
    # errors that last do not oscillate
    errors = 3.0 * lasting((20, 300, 2), 0.9, seed=5)
    smooth(errors, 1.0, dt=1.0)


def inside_at(found, truth, at):
    """Share of 95 % ellipses at some instants that hold the truth, and RMSE of all positions."""
    inside = in_region(found.position - truth, found.position_covariance)
    return np.mean(inside[:, at]), np.sqrt(np.mean((found.position - truth) ** 2))


def test_noise_that_is_larger_for_some_time():
    """With one level of noise, 77 % of the ellipses at these times hold, and the RMSE is 0.33."""
    t = np.arange(200)
    at = (t >= 60) & (t < 120)
    truth = np.broadcast_to(np.column_stack([3.0 * t, 2e-3 * t**2]), (10, 200, 2))
    sigma = np.where(at, 5.0, 1.0)[:, np.newaxis]
    y = truth + sigma * rng(16).standard_normal(truth.shape)
    inside, rmse = inside_at(smooth(y, 1.0), truth, at)
    assert inside > 0.9
    assert rmse < 0.25


def test_turns_after_a_straight_path():
    """With one intensity of the motion, 88 % of the ellipses in turns hold; the RMSE is 1.0."""
    rate = np.zeros(200)
    for first in (60, 90, 150):
        rate[first : first + 4] = np.deg2rad(25)
    course = np.cumsum(rate)
    steps = 10 * np.column_stack([np.cos(course), np.sin(course)])
    truth = np.broadcast_to(np.cumsum(steps, axis=0), (10, 200, 2))
    at = np.convolve(rate > 0, np.ones(7), "same") > 0
    y = truth + 2 * rng(16).standard_normal(truth.shape)
    inside, rmse = inside_at(smooth(y, 4.0), truth, at)
    assert inside > 0.9
    assert rmse < 0.85


def test_rounded_values_do_not_move_in_steps():
    """The steps of rounding are no motion between times of rest: the RMSE would be 0.54."""
    errors = []
    for seed in range(10):
        random = rng(seed, 974)
        truth = 20 + np.cumsum(np.cumsum(random.normal(0, 0.002, 300)))
        y = np.round(truth + 0.1 * random.standard_normal(300))
        errors.append(smooth(y[:, np.newaxis], 0.3**2).position[:, 0] - truth)
    assert np.sqrt(np.mean(np.square(errors))) < 0.2
