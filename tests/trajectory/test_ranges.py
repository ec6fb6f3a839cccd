"""Ranges whose errors grow with the range, as those from signal strengths."""

import numpy as np
import pytest
from checks import in_region
from trajectory.scenes import walk

from tertia.sensors import Station
from tertia.trajectory import reconstruct

ROOM = np.array([40.0, 30.0])
STATED = 3.0


def scene(seed, beacons=7):
    """Return places of beacons in the room, a path, and true ranges."""
    rng = np.random.default_rng([91, seed])
    way, places = walk(rng, 200, 1.0, ROOM), rng.uniform(0, 1, (beacons, 2)) * ROOM
    return rng, places, way, np.linalg.norm(way[:, np.newaxis] - places, axis=-1)


def path(places, ranges, unit=1.0, **options):
    stations = [Station(unit * place, range_sigma=unit * STATED) for place in places]
    return reconstruct(stations, np.arange(float(len(ranges))), range=unit * ranges, **options)


def judged(track, way):
    """Return the RMSE and the share of positions inside the 95 % ellipse."""
    error = track.position - way
    inside = in_region(error, track.covariance[:, :2, :2])
    return np.sqrt(np.mean(np.sum(error**2, axis=1))), np.mean(inside)


@pytest.mark.parametrize("relative", [0.15, 0.28])
def test_paths_are_as_close_as_they_say(relative):
    found = []
    for seed in range(4):
        rng, places, way, ranges = scene(seed)
        wrong = ranges * np.exp(relative * rng.standard_normal(ranges.shape))
        track = path(places, wrong)
        assert track.relative_range_sigma == pytest.approx(relative, rel=0.2)
        rmse, inside = judged(track, way)
        # with one sigma for all ranges, 0.8 to 1.6 m and 1.8 to 4.4 m; .45 to .85 are inside
        known, _ = judged(path(places, wrong, range_sigma=relative * ranges), way)
        assert rmse < 1.3 * known
        found.append(inside)
    assert 0.88 < np.mean(found) < 0.99


def test_errors_with_a_constant_and_a_growing_part():
    rng, places, way, ranges = scene(5)
    sigma = np.hypot(0.5, 0.2 * ranges)
    track = path(places, ranges + sigma * rng.standard_normal(ranges.shape))
    assert track.relative_range_sigma == pytest.approx(0.2, rel=0.3)
    assert judged(track, way)[1] > 0.85


@pytest.mark.parametrize("kind", ["white", "lasting", "differ", "late"])
def test_other_errors_do_not_grow(kind):
    for seed in range(4):
        rng, places, _, ranges = scene(seed)
        errors = rng.standard_normal(ranges.shape)
        if kind == "lasting":
            for t in range(1, len(errors)):
                errors[t] = 0.9 * errors[t - 1] + np.sqrt(0.19) * errors[t]
        if kind == "differ":
            errors *= np.exp(rng.uniform(-1, 1, len(places)))
        if kind == "late":
            errors += rng.exponential(3, errors.shape) * (rng.random(errors.shape) < 0.15)
        assert path(places, np.abs(ranges + errors)).relative_range_sigma is None


def test_sigmas_that_are_stated_to_grow_are_taken_as_they_are():
    rng, places, way, ranges = scene(7)
    sigma = 0.2 * ranges
    track = path(places, ranges + sigma * rng.standard_normal(ranges.shape), range_sigma=sigma)
    assert track.relative_range_sigma is None
    assert judged(track, way)[1] > 0.85


def test_any_unit_and_order_of_stations():
    rng, places, _, ranges = scene(3)
    wrong = ranges * np.exp(0.25 * rng.standard_normal(ranges.shape))
    track, feet = path(places, wrong), path(places, wrong, unit=1 / 0.3048)
    np.testing.assert_allclose(feet.position * 0.3048, track.position, rtol=1e-6)
    assert feet.relative_range_sigma == pytest.approx(track.relative_range_sigma, rel=1e-6)
    other = path(places[::-1], wrong[:, ::-1])
    np.testing.assert_allclose(other.position, track.position, rtol=1e-6, atol=1e-6)


def test_least_squares_takes_the_sigmas_as_stated():
    rng, places, _, ranges = scene(3)
    wrong = ranges * np.exp(0.25 * rng.standard_normal(ranges.shape))
    assert path(places, wrong, spatial="least-squares").relative_range_sigma is None


def test_gaps_and_heights():
    rng, places, way, _ = scene(6)
    places = np.column_stack([places, rng.uniform(0, 4, len(places))])
    way = np.column_stack([way, np.full(len(way), 1.2)])
    ranges = np.linalg.norm(way[:, np.newaxis] - places, axis=-1)
    wrong = ranges * np.exp(0.2 * rng.standard_normal(ranges.shape))
    wrong[rng.random(wrong.shape) < 0.2] = np.nan
    track = path(places, wrong, height=np.full(len(way), 1.2), height_sigma=0.1)
    assert track.relative_range_sigma == pytest.approx(0.2, rel=0.25)
    assert np.sqrt(np.mean(np.sum((track.position - way)[:, :2] ** 2, axis=1))) < 1.5
    assert np.isnan(track.residual.range[np.isnan(wrong)]).all()
