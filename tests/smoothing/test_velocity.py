"""The smoother of positions with measured velocities."""

import numpy as np
import pytest
from checks import INF, NAN, in_region, rng
from reference import smoothing as reference
from smoothing.scenes import assert_parity, covariances, gaps

from tertia import metrics
from tertia.smoothing import smooth


def check(y, velocity, times, q, initial=None):
    """Everything against one dense normal distribution in 300 digits."""
    n, d = np.shape(y)
    covariance, own = covariances(n, d, 1), 0.2 * covariances(n, d, 2)
    found = smooth(
        y,
        covariance,
        time=times,
        velocity=velocity,
        velocity_covariance=own,
        jerk=q,
        initial=initial,
        correlation_time=0.0,
        robust=False,
    )
    joint = np.zeros((n, 2 * d, 2 * d))
    joint[:, :d, :d], joint[:, d:, d:] = covariance, own
    mean, matrix, innovation, _ = reference.smooth(
        np.hstack([y, velocity]), joint, times, q, initial, axes=d
    )
    assert_parity(found, mean, matrix, innovation, initial)
    assert found.position.shape == found.velocity.shape == (n, d)
    return found


@pytest.mark.parametrize("d", [1, 2, 3, 4])
@pytest.mark.parametrize("q", [0.0, 1e-3, 1e4])
def test_parity(d, q):
    y, velocity = rng(d).normal(size=(2, 9, d))
    times = np.sort(rng(d).uniform(0, 20, 9))
    found = check(y, velocity, times, q)
    assert found.count == 18 * d - 3 * d
    assert found.innovation.shape == (9, 2 * d)


@pytest.mark.parametrize("seed", range(6))
def test_missing_components_and_equal_times(seed):
    y, velocity = gaps(rng(seed).normal(size=(2, 8, 2)), 0.5, seed)
    check(y, velocity, np.sort(rng(seed).integers(0, 5, 8)).astype(float), 0.1)


@pytest.mark.parametrize(
    ("positions", "velocities", "known"),
    [
        ([0], [], "p:0"),
        ([], [2], "v:2"),
        ([0], [0], "p:0 v:0"),
        # halfway to 4 the velocity tells where the target is
        ([0], [2], "p:04 v:2"),
        ([], [1, 3], "v:01234 a:01234"),
        ([], [1, 3, 4], "v:01234 a:01234"),
        # the slope of the chord is that halfway: no third fact
        ([0, 4], [2], "p:04 v:2"),
        ([0, 4], [3], "p:01234 v:01234 a:01234"),
        ([0], [1, 2], "p:01234 v:01234 a:01234"),
    ],
)
def test_what_few_numbers_determine(positions, velocities, known):
    y, velocity = np.full((2, 5, 1), NAN)
    y[positions, 0], velocity[velocities, 0] = 1.0 + np.arange(len(positions)), 2.0
    found = check(y, velocity, np.arange(5.0), 0.1)
    expected = np.zeros((5, 3), dtype=bool)
    for part in known.split():
        expected[[int(k) for k in part[2:]], "pva".index(part[0])] = True
    np.testing.assert_array_equal(np.isfinite(found.sigma), expected)
    numbers = len(positions) + len(velocities)
    assert found.count == numbers - min(numbers, 2 if "a:0" not in known or not positions else 3)


def test_an_initial_state():
    a = rng(3).normal(size=(6, 6))
    y, velocity = gaps(rng(2).normal(size=(2, 8, 2)), 0.3)
    check(y, velocity, np.arange(8.0), 0.1, (rng(4).normal(size=6), a @ a.T))


def test_velocities_that_are_never_there_change_nothing():
    t = np.arange(40.0)
    y = np.column_stack([100 * t, 20 * np.sin(t / 9)]) + rng(1).normal(size=(40, 2))
    plain = smooth(y, 1.0, time=t)
    found = smooth(y, 1.0, time=t, velocity=np.full((40, 2), NAN), velocity_covariance=9.0)
    assert found.jerk == pytest.approx(plain.jerk, rel=1e-3)
    np.testing.assert_allclose(found.position, plain.position, atol=1e-4)
    assert np.isnan(found.innovation[:, 2:]).all()


def flight(runs, n=120, step=4.0, seed=0):
    """Straight flight, a turn, and straight on at another speed: positions and velocities."""
    t = step * np.arange(n)
    rate = np.where((t > 160) & (t < 240), np.radians(1.5), 0.0)
    speed = 150.0 + 0.5 * np.clip(t - 300.0, 0, 60)
    course = rng(seed).uniform(0, 2 * np.pi, (runs, 1)) + np.cumsum(rate) * step
    velocity = speed[:, np.newaxis] * np.stack([np.sin(course), np.cos(course)], axis=-1)
    position = np.cumsum(velocity, axis=1) * step
    # of which the velocity is that in the middle of a step
    velocity = 0.5 * (velocity + np.concatenate([velocity[:, 1:], velocity[:, -1:]], axis=1))
    return t, position, velocity


def test_velocities_tell_more_and_errors_are_as_claimed():
    """Velocities of 1 m/s beside positions of 50 m."""
    t, position, velocity = flight(60)
    random = rng(5)
    y = position + 50.0 * random.normal(size=position.shape)
    v = velocity + random.normal(size=velocity.shape)
    plain = smooth(y, 50.0**2, time=t)
    found = smooth(y, 50.0**2, time=t, velocity=v, velocity_covariance=1.0)
    for name, truth, gain in (("position", position, 0.75), ("velocity", velocity, 0.35)):
        error = getattr(found, name) - truth
        before = np.std(getattr(plain, name) - truth)
        assert np.std(error) < gain * before
        nees = metrics.nees(error, getattr(found, f"{name}_covariance")) / 2
        assert 0.7 < np.mean(nees) < 1.3


@pytest.mark.parametrize("fault", ["position", "velocity"])
def test_outliers_of_both(fault):
    t, position, velocity = flight(20, seed=3)
    random = rng(6)
    y = position + 20.0 * random.normal(size=position.shape)
    v = velocity + 2.0 * random.normal(size=velocity.shape)
    wrong = random.random(y.shape[:2]) < 0.05
    if fault == "position":
        y[wrong] += 2_000.0
    else:
        v[wrong] = 0.0
    found = smooth(y, 20.0**2, time=t, velocity=v, velocity_covariance=4.0)
    marked, other = found.outlier, found.velocity_outlier
    if fault == "velocity":
        marked, other = other, marked
    assert np.mean(marked[wrong]) > 0.95
    assert np.mean(marked[~wrong]) < 0.02
    assert np.mean(other) < 0.01
    assert np.sqrt(np.mean((found.position - position) ** 2)) < 20.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"velocity_covariance": None}, "velocity and velocity_covariance must be given together"),
        ({"velocity": None}, "velocity and velocity_covariance must be given together"),
        ({"velocity": np.zeros((2, 2))}, r"velocity has shape \(2, 2\); it must be that of y"),
        ({"velocity": [[0, 0], [0, INF], [0, 0]]}, r"velocity\[1, 1\] is inf"),
        ({"velocity_covariance": -1.0}, r"velocity_covariance\[0, 0\] is -1; variances must"),
        ({"velocity_covariance": np.ones(3)}, r"velocity_covariance has shape \(3,\); for y of"),
    ],
)
def test_errors(arguments, message):
    y = np.arange(6.0).reshape(3, 2)
    given = {"velocity": np.ones((3, 2)), "velocity_covariance": 1.0} | arguments
    with pytest.raises(ValueError, match=message):
        smooth(y, 1.0, **given)


def walker(seed, step, count=150):
    """A walker at 1.3 m/s who turns every ten seconds on average, seen every `step` seconds."""
    random = rng([61, seed])
    fine = 0.5
    turns = random.random(int(count * step / fine)) < fine / 10.0
    course = np.cumsum(np.where(turns, random.uniform(-2.0, 2.0, turns.size), 0.0))
    velocity = 1.3 * np.stack([np.sin(course), np.cos(course)], axis=1)
    position = np.cumsum(fine * velocity, axis=0) - fine * velocity
    every = int(step / fine)
    return position[::every], velocity[::every]


def test_velocity_of_a_walk_that_plots_do_not_show():
    """The position is a random walk: its drift is far more certain than the velocity."""
    held = []
    for seed in range(8):
        position, velocity = walker(seed, 30.0)
        plots = position + 3.0 * rng([62, seed]).standard_normal(position.shape)
        found = smooth(plots, 9.0, dt=30.0)
        assert found.diffusion > 0
        least = 2.0 * found.diffusion / 30.0
        assert np.all(np.diagonal(found.velocity_covariance, axis1=1, axis2=2) > 0.9 * least)
        error = found.velocity - velocity
        held.append(np.mean(in_region(error, found.velocity_covariance)))
    assert np.mean(held) > 0.9
