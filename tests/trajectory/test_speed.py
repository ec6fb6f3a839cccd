"""Paths from signals whose speed is known with a standard deviation."""

import warnings

import numpy as np
import polars as pl
import pytest
from checks import in_region
from scipy import stats
from trajectory.scenes import INSTANTS as TIME
from trajectory.scenes import ring

from tertia import tables
from tertia.location import Station
from tertia.trajectory import reconstruct

SOUND, ERROR, SIGMA = 340.0, 0.015, 0.005
KINDS = ("arrival_time", "range")


def scene(seed):
    """Return stations, a path, the travel times, and the speed of sound."""
    rng = np.random.default_rng([77, seed])
    places, path = ring(rng, 6, radius=400.0, speed=3.0, spread=150.0)
    speed = SOUND * (1 + ERROR * rng.standard_normal())
    travel = np.linalg.norm(path[:, np.newaxis] - places, axis=-1) / speed
    return places, path, travel + SIGMA * rng.standard_normal(travel.shape), speed


def path_of(places, travel, kind, **options):
    sigmas = {"range_sigma": SIGMA * SOUND, "arrival_time_sigma": SIGMA}
    stations = [Station(place, **{f"{kind}_sigma": sigmas[f"{kind}_sigma"]}) for place in places]
    measured = {"range": SOUND * travel} if kind == "range" else {"arrival_time": travel}
    return reconstruct(stations, TIME, **measured, propagation_speed=SOUND, **options)


@pytest.mark.parametrize("kind", KINDS)
def test_regions_hold_with_an_unknown_speed(kind):
    inside, pulls, errors, others = [], [], [], []
    for seed in range(12):
        places, path, travel, speed = scene(seed)
        track = path_of(places, travel, kind, propagation_speed_sigma=ERROR * SOUND)
        error = track.position - path
        inside.append(np.mean(in_region(error, track.covariance[:, :2, :2])))
        pulls.append((track.propagation_speed - speed) / track.propagation_speed_sigma)
        errors.append(np.mean(np.sum(error**2, axis=1)))
        with warnings.catch_warnings():
            # ranges at a wrong speed that is taken as exact look like a common delay, which is told
            warnings.simplefilter("ignore")
            exact = path_of(places, travel, kind, propagation_speed_sigma=0.0)
        other = exact.position - path
        others.append(np.mean(np.sum(other**2, axis=1)))
    # with the speed as stated: 30 %, and some ranges do not meet
    assert np.mean(inside) > 0.9
    assert np.median(errors) < {"arrival_time": 1.1, "range": 0.2}[kind] * np.nanmedian(others)
    assert stats.chi2.cdf(np.sum(np.square(pulls)), len(pulls)) < 0.999


def test_the_speed_is_as_stated_by_default_unless_it_is_contradicted():
    places, _, travel, speed = scene(0)
    track = path_of(places, travel, "range")
    assert abs(track.propagation_speed - speed) < 4 * track.propagation_speed_sigma
    right = travel * speed / SOUND
    track = path_of(places, right, "range")
    assert track.propagation_speed is None
    assert track.propagation_speed_sigma is None
    same = path_of(places, right, "range", propagation_speed_sigma=0.0)
    np.testing.assert_array_equal(track.covariance, same.covariance)


def test_speeds_that_cannot_be_estimated_are_refused():
    places, _, travel, _ = scene(0)
    with pytest.raises(ValueError, match="propagation_speed_sigma needs times of arrival"):
        reconstruct(
            [Station(place, azimuth_sigma=0.01) for place in places],
            TIME,
            azimuth=np.zeros(travel.shape),
            propagation_speed_sigma=5.0,
        )
    for options in ({"order": "temporal-first"}, {"smoother": "local-polynomial"}):
        with pytest.raises(ValueError, match="propagation_speed_sigma needs order"):
            path_of(places, travel, "range", propagation_speed_sigma=5.0, **options)


def test_tables_pass_the_speed_on():
    places, _, travel, _ = scene(1)
    stations = [
        Station(place, name=f"S{k}", arrival_time_sigma=SIGMA) for k, place in enumerate(places)
    ]
    table = pl.concat(
        pl.DataFrame({"time_s": TIME, "arrival_time_s": TIME + travel[:, k]}).with_columns(
            sensor=pl.lit(f"S{k}")
        )
        for k in range(len(places))
    )
    known = {"sensors": stations, "propagation_speed": SOUND}
    exact = tables.reconstruct(table, **known)
    found = tables.reconstruct(table, **known, propagation_speed_sigma=5.0)
    assert not np.allclose(exact["east_m"], found["east_m"], atol=1e-3)


def test_two_positions_do_not_decide_about_the_speed():
    """At some speeds, ranges fit above and below the sea floor, at others on one side only."""
    inside, pulls = [], []
    for seed in range(6):
        rng = np.random.default_rng([12, seed])
        floor = np.array([[0, 0, -300], [800, 0, -310], [800, 700, -305], [0, 700, -295.0]])
        time = np.arange(0.0, 600.0, 10.0)
        turn = 2 * np.pi * time / 600
        dive = -200 - 30 * np.sin(time / 100)
        path = np.column_stack([400 + 250 * np.cos(turn), 350 + 250 * np.sin(turn), dive])
        ranges = np.linalg.norm(path[:, np.newaxis] - floor, axis=-1)
        ranges *= 1500.0 / rng.normal(1500.0, 5.0)
        ranges += rng.normal(0.0, 0.3, ranges.shape)
        track = reconstruct(
            [Station(place, range_sigma=0.3) for place in floor],
            time,
            range=ranges,
            initial=[400.0, 350.0, -200.0],
            propagation_speed=1500.0,
            propagation_speed_sigma=5.0,
        )
        error = track.position - path
        inside.append(np.mean(in_region(error, track.covariance[:, :3, :3])))
        pulls.append((track.propagation_speed - 1500.0) / 5.0)
    # the ranges hardly tell the speed; before, it was wrong by up to three sigmas
    assert np.median(inside) > 0.9
    assert np.max(np.abs(pulls)) < 0.5
