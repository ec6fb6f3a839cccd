"""Covariances of tracks are finite, symmetric and positive semidefinite, whatever the plots are."""

import numpy as np
import pytest

from tertia.tracker import Plots, Radar, track

# largest negative eigenvalue of a correlation matrix that is due to rounding
ROUNDING = 1e-12


def eigenvalues(covariance):
    """Smallest eigenvalues of the correlation matrices."""
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert np.all(sigma > 0)
    return np.linalg.eigvalsh(covariance / sigma[:, :, np.newaxis] / sigma[:, np.newaxis])[:, 0]


def assert_regular(table):
    innovation = table.innovation_covariance[table.plot >= 0]
    for covariance in (table.covariance, innovation):
        assert np.all(np.isfinite(covariance))
        np.testing.assert_array_equal(covariance, np.swapaxes(covariance, 1, 2))
        assert np.all(eigenvalues(covariance) > -ROUNDING)


def drawn_radars(rng):
    return [
        Radar(
            range_sigma=10 ** rng.uniform(-0.5, 3.2),
            azimuth_sigma=10 ** rng.uniform(-4.5, -1.0),
            scan_period=10 ** rng.uniform(-1.0, 2.0),
            position=rng.uniform(-5e3, 5e3, 2) * rng.integers(0, 2),
        )
        for _ in range(rng.integers(1, 4))
    ]


def drawn_flight(rng):
    """Position, velocity and height of a target: at a radar, near it, or anywhere."""
    kind = rng.integers(0, 5)
    place, speed = [(300.0, 30.0), (0.0, 0.0), (2e4, 100.0), (2e5, 10.0), (200.0, 50.0)][kind]
    position, velocity = place * rng.standard_normal(2), speed * rng.standard_normal(2)
    return position - (10.0 * velocity if kind == 4 else 0.0), velocity, 10 ** rng.uniform(1, 4)


def drawn_plots(rng, radars):
    """Plots of a few targets, some of them milliseconds apart, with and without heights."""
    columns, known = [], rng.choice([0.0, 0.5, 1.0])
    for _ in range(rng.integers(1, 4)):
        start, velocity, height = drawn_flight(rng)
        for k, radar in enumerate(radars):
            n = rng.integers(5, 60)
            step = radar.scan_period if rng.random() < 0.75 else 10 ** rng.uniform(-3.5, 0.0)
            time = np.sort(step * (np.arange(n) + rng.random() + 0.02 * rng.standard_normal(n)))
            offset = start + np.outer(time, velocity) - radar.position[:2]
            slant = np.hypot(np.hypot(*offset.T), height if known else 0.0)
            distance = np.abs(slant + radar.range_sigma * rng.standard_normal(n))
            azimuth = np.arctan2(*offset.T) + radar.azimuth_sigma * rng.standard_normal(n)
            reported = np.where(rng.random(n) < known, height, np.nan)
            columns.append((time, distance, azimuth, reported, np.full(n, k)))
    time, distance, azimuth, height, sensor = map(np.concatenate, zip(*columns, strict=True))
    return Plots(time, distance, azimuth, height=height, sensor=sensor)


# some targets are faster than those of their profile
@pytest.mark.filterwarnings("ignore:.*and max_speed is:UserWarning")
@pytest.mark.parametrize("seed", range(60))
def test_covariances_of_drawn_scenes(seed):
    rng = np.random.default_rng([71, seed])
    radars = drawn_radars(rng)
    plots = drawn_plots(rng, radars)
    options = {
        "motion": rng.choice(["imm", "imm", "cv", "window"]),
        "association": rng.choice(["gnn", "mht"]),
        "profile": rng.choice(["aircraft", "vessel", "road", "drone"]),
        "confirmation": (2, 3) if rng.random() < 0.5 else (3, 4),
        "lag": float(rng.choice([0.0, 5.0])),
    }
    assert_regular(track(plots, radars, **options))


@pytest.mark.parametrize("motion", ["imm", "cv", "window"])
@pytest.mark.parametrize("seed", range(20))
def test_covariances_of_a_target_above_the_radar(motion, seed):
    rng = np.random.default_rng([72, seed])
    sigma, height, n = 10 ** rng.uniform(2.3, 3.3), 10 ** rng.uniform(1.5, 4.0), 40
    radar = Radar(range_sigma=sigma, azimuth_sigma=10 ** rng.uniform(-3, -1), scan_period=4.0)
    distance = np.abs(height + sigma * rng.standard_normal(n))
    reported = np.where(rng.random(n) < 0.5, height, np.nan)
    plots = Plots(4.0 * np.arange(n), distance, rng.uniform(0.0, 6.28, n), height=reported)
    for association, lag in (("gnn", 0.0), ("mht", 5.0)):
        options = {"association": association, "lag": lag, "confirmation": (2, 3)}
        assert_regular(track(plots, [radar], motion=motion, **options))


@pytest.mark.parametrize("motion", ["imm", "cv", "window"])
def test_covariances_of_a_plot_at_the_radar(motion):
    """The track has come to the radar, and a coarse range of 1 m has no height."""
    rng = np.random.default_rng(75)
    n = 20
    precise = Radar(range_sigma=0.3, azimuth_sigma=1e-3, scan_period=1.0)
    coarse = Radar(range_sigma=600.0, azimuth_sigma=3e-5, scan_period=1.0)
    near = np.abs(0.3 * rng.standard_normal(n)) + 1e-3
    distance = np.stack([near, np.ones(n)], axis=1).ravel()
    time = np.arange(2 * n) / 2
    height = np.where(np.arange(2 * n) == 2, 33.0, np.nan)
    distance[2] = 33.1
    sensor = np.tile([0, 1], n)
    azimuth = rng.uniform(0.0, 6.28, 2 * n)
    plots = Plots(time, distance, azimuth, height=height, sensor=sensor)
    for association in ("gnn", "mht"):
        options = {"association": association, "confirmation": (2, 3), "registration": False}
        assert_regular(track(plots, [precise, coarse], motion=motion, **options))


def test_covariances_of_drones_in_slow_scans():
    """In 22 s, manoeuvres of drones begin and end."""
    rng = np.random.default_rng(73)
    radar = Radar(range_sigma=4.0, azimuth_sigma=1.5e-3, scan_period=22.0)
    time = 22.0 * np.arange(40)
    offset = np.array([4e4, 5e4]) + np.outer(time, [8.0, -10.0]) + rng.normal(0, 200, (40, 2))
    plots = Plots(time, np.hypot(*offset.T), np.arctan2(*offset.T))
    table = track(plots, [radar], profile="drone", confirmation=(2, 3))
    assert_regular(table)
    for name in ("turn_probability", "speed_change_probability"):
        assert np.all((getattr(table, name) >= 0) & (getattr(table, name) <= 1))


@pytest.mark.parametrize("seed", range(10))
def test_covariances_of_plots_milliseconds_apart(seed):
    rng = np.random.default_rng([74, seed])
    radar = Radar(range_sigma=20.0, azimuth_sigma=1e-3, scan_period=0.0018)
    n = 60
    distance = 5e3 + 20.0 * rng.standard_normal(n)
    plots = Plots(0.0018 * np.arange(n), distance, 0.7 + 1e-3 * rng.standard_normal(n))
    assert_regular(track(plots, [radar], motion="window", confirmation=(2, 3)))
