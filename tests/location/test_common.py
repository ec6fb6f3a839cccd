"""Errors that one sensor has at several places: a direction finder that moves."""

from typing import Any

import numpy as np
import pytest
from checks import WITHIN_95, in_region

from tertia._arrays import FloatArray
from tertia.location import locate
from tertia.sensors import Bias, Station

SIGMA = np.radians(2.0)


def drive(rng: np.random.Generator, count: int, *, curved: bool) -> tuple[FloatArray, FloatArray]:
    """Return places of a finder on a line or an arc, and an emitter."""
    u = np.linspace(-1, 1, count)
    if curved:
        path = 300 * np.column_stack([np.cos(2.5 * u), np.sin(2.5 * u)])
        return path, rng.uniform(-100, 100, 2)
    path = np.column_stack([400 * u, 20 * np.sin(3 * u)])
    return path, np.array([rng.uniform(-100, 100), 300.0])


def bearings(
    rng: np.random.Generator, path: FloatArray, emitter: FloatArray, offset: float
) -> FloatArray:
    away = emitter - path
    return np.arctan2(away[:, 0], away[:, 1]) + SIGMA * rng.standard_normal(len(path)) + offset


def stations(path: FloatArray, name: str | None, **options: Any) -> list[Station]:
    return [Station(place, azimuth_sigma=SIGMA, name=name, **options) for place in path]


def scored(offset: float, *, curved: bool, runs: int = 60, **options: Any) -> tuple[float, float]:
    """Return RMSE and the share of emitters inside their 95 % ellipse."""
    square, inside = [], []
    for seed in range(runs):
        rng = np.random.default_rng([615, seed])
        path, emitter = drive(rng, 60, curved=curved)
        azimuth = bearings(rng, path, emitter, offset * rng.standard_normal())
        found = locate(stations(path, "car", **options), azimuth=azimuth)
        error = found.position - emitter
        square.append(error @ error)
        inside.append(in_region(error, found.covariance))
    return float(np.sqrt(np.mean(square))), float(np.mean(inside))


@pytest.mark.parametrize("curved", [False, True])
def test_a_misaligned_antenna_is_found(curved: bool) -> None:
    rmse, inside = scored(SIGMA, curved=curved)
    assert inside >= 0.85
    assert rmse < (4.0 if curved else 12.0)


def test_a_stated_misalignment_does_not_average_out() -> None:
    rmse, inside = scored(SIGMA, curved=False, bias=Bias(azimuth_sigma=SIGMA))
    assert inside >= 0.88
    assert rmse < 9.0


def test_an_aligned_antenna_costs_little() -> None:
    rmse, inside = scored(0.0, curved=False)
    assert inside >= 0.9
    assert rmse < 6.0


def test_the_bias_is_that_of_the_sensor() -> None:
    rng = np.random.default_rng(4)
    path, emitter = drive(rng, 200, curved=True)
    azimuth = bearings(rng, path, emitter, np.radians(5.0))
    found = locate(stations(path, "car"), azimuth=azimuth)
    assert found.systematic == "estimated"
    assert found.bias is not None
    assert np.ptp(found.bias.azimuth) == 0
    error = np.asarray(found.bias.azimuth)[0] - np.radians(5.0)
    sigma = np.asarray(found.bias.azimuth_sigma)[0]
    assert abs(error) < 3 * sigma < np.radians(2.0)
    # a batch of one is the same
    one = locate(stations(path, "car"), azimuth=azimuth[np.newaxis])
    np.testing.assert_array_equal(one.position[0], found.position)
    np.testing.assert_array_equal(one.covariance[0], found.covariance)
    # regions are as large as the covariance
    region = found.region(0.95)
    area = np.pi * WITHIN_95[2] * np.sqrt(np.linalg.det(found.covariance))
    assert region.area == pytest.approx(area, rel=0.3)


def test_two_sensors_have_an_error_each() -> None:
    rng = np.random.default_rng(5)
    first, emitter = drive(rng, 60, curved=True)
    second = first @ np.array([[0.0, 1.0], [-1.0, 0.0]]) * 1.5
    offsets = np.radians([4.0, -3.0])
    azimuth = np.concatenate(
        [
            bearings(rng, path, emitter, own)
            for path, own in zip((first, second), offsets, strict=True)
        ]
    )
    found = locate([*stations(first, "a"), *stations(second, "b")], azimuth=azimuth)
    error = found.position - emitter
    assert error @ np.linalg.solve(found.covariance, error) < 9.2
    assert found.bias is not None
    value = np.asarray(found.bias.azimuth)
    np.testing.assert_allclose(value[[0, -1]], offsets, atol=np.radians(1.5))


def test_what_is_left_as_it_was() -> None:
    rng = np.random.default_rng(6)
    path, emitter = drive(rng, 30, curved=True)
    azimuth = bearings(rng, path, emitter, 0.0)
    with pytest.warns(UserWarning, match="lie along a path"):
        nameless = locate(stations(path, None), azimuth=azimuth)
    each = [Station(place, azimuth_sigma=SIGMA, name=str(k)) for k, place in enumerate(path)]
    np.testing.assert_array_equal(locate(each, azimuth=azimuth).covariance, nameless.covariance)
    exact = locate(stations(path, "car"), azimuth=azimuth, bias=Bias())
    np.testing.assert_array_equal(
        exact.covariance, locate(stations(path, None), azimuth=azimuth, bias=Bias()).covariance
    )


def test_places_without_names_along_a_path_are_doubted() -> None:
    rng = np.random.default_rng(6)
    path, emitter = drive(rng, 12, curved=False)
    azimuth = bearings(rng, path, emitter, SIGMA)
    with pytest.warns(UserWarning, match="one sensor that moves"):
        locate(path, azimuth=azimuth, azimuth_sigma=SIGMA)
    for some in (rng.permutation(12), np.arange(5)):
        locate(path[some], azimuth=azimuth[some], azimuth_sigma=SIGMA)


def test_an_error_is_no_full_circle() -> None:
    """With a sigma of 20°, errors that are tried would otherwise reach the same bearing again."""
    rng = np.random.default_rng(7)
    path, emitter = drive(rng, 60, curved=True)
    sigma = np.radians(20.0)
    away = emitter - path
    azimuth = np.arctan2(away[:, 0], away[:, 1]) + sigma * rng.standard_normal(60)
    found = locate([Station(at, azimuth_sigma=sigma, name="car") for at in path], azimuth=azimuth)
    assert found.bias is not None
    assert np.asarray(found.bias.azimuth_sigma)[0] < np.radians(6.0)
    error = found.position - emitter
    assert in_region(error, found.covariance)


def flights(
    rng: np.random.Generator, offset: float
) -> tuple[list[Station], FloatArray, FloatArray]:
    """Return four finders on straight paths, their bearings and the emitter."""
    emitter = rng.uniform(200, 800, 2)
    each: list[Station] = []
    azimuth = []
    for name in "abcd":
        start, way = rng.uniform(0, 1000, 2), rng.uniform(-300, 300, 2)
        path = start + way * np.arange(8)[:, np.newaxis] / 8
        each += stations(path, name)
        azimuth.append(bearings(rng, path, emitter, offset * rng.standard_normal()))
    return each, np.concatenate(azimuth), emitter


@pytest.mark.parametrize("stated", [None, 1.5 * SIGMA])
def test_several_sensors_are_each_misaligned(stated: float | None) -> None:
    inside, within = [], []
    for seed in range(100):
        rng = np.random.default_rng([616, seed])
        each, azimuth, emitter = flights(rng, 1.5 * SIGMA)
        bias = None if stated is None else Bias(azimuth_sigma=stated)
        found = locate(each, azimuth=azimuth, bias=bias)
        inside.append(in_region(found.position - emitter, found.covariance))
        within.append(np.max(found.bias.azimuth_sigma) if found.bias is not None else 0.0)
    # estimated one after another, the errors are not seen to be uncertain together
    assert np.mean(inside) >= (0.85 if stated is None else 0.9)
    assert np.median(within) > 0.2 * SIGMA


def test_several_sensors_without_errors() -> None:
    inside = []
    for seed in range(60):
        each, azimuth, emitter = flights(np.random.default_rng([617, seed]), 0.0)
        found = locate(each, azimuth=azimuth)
        inside.append(in_region(found.position - emitter, found.covariance))
    assert np.mean(inside) >= 0.92


def test_common_errors_are_not_taken_for_degrees() -> None:
    # turned into degrees, the few bearings of each path would nearly agree anywhere far away
    for seed in range(30):
        each, azimuth, _ = flights(np.random.default_rng([618, seed]), 1.5 * SIGMA)
        locate([Station(one.position, azimuth_sigma=SIGMA) for one in each], azimuth=azimuth)
