"""Measurements that follow another convention than that of the library."""

from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from tertia._arrays import FloatArray
from tertia.location import Station, locate
from tertia.trajectory import reconstruct

SIGMAS = {"range_sigma": 10.0, "azimuth_sigma": np.radians(1.0)}
TIMES = 5.0 * np.arange(40)


def scene(seed: int, count: int) -> tuple[list[Station], dict[str, FloatArray]]:
    """Return stations and what they measure of a vessel."""
    rng = np.random.default_rng([619, seed])
    places = rng.uniform(0.0, 8e3, (count, 2))
    way = 4e3 + np.outer(TIMES - 100.0, rng.uniform(-9.0, 9.0, 2))
    away = way[:, np.newaxis] - places
    noise = rng.standard_normal((2, len(TIMES), count))
    azimuth = np.arctan2(away[..., 0], away[..., 1]) + SIGMAS["azimuth_sigma"] * noise[0]
    distance = np.linalg.norm(away, axis=-1) + SIGMAS["range_sigma"] * noise[1]
    stations = [Station(place, **SIGMAS) for place in places]
    return stations, {"azimuth": azimuth, "range": distance}


CASES: dict[str, Any] = {
    "anticlockwise from east": lambda seen: {"azimuth": np.pi / 2 - seen["azimuth"]},
    "anticlockwise from north": lambda seen: {"azimuth": -seen["azimuth"]},
    "clockwise from south": lambda seen: {"azimuth": seen["azimuth"] + np.pi},
    "in kilometres": lambda seen: {"range": seen["range"] / 1e3},
    "azimuths .* anticlockwise": lambda seen: {**seen, "azimuth": np.pi / 2 - seen["azimuth"]},
    "ranges .* in kilometres": lambda seen: {**seen, "range": seen["range"] / 1e3},
}


@pytest.mark.parametrize("case", CASES)
def test_another_convention_is_said(case: str) -> None:
    for seed in range(3):
        stations, seen = scene(seed, 4)
        with pytest.warns(UserWarning, match=case):
            locate(stations, **CASES[case](seen))


def test_also_of_a_path() -> None:
    stations, seen = scene(5, 4)
    # there may be no path, which is an error
    with pytest.warns(UserWarning, match="anticlockwise from north"), suppress(ValueError):
        reconstruct(stations, TIMES, azimuth=-seen["azimuth"])


@pytest.mark.parametrize("kinds", [["azimuth"], ["range"], ["azimuth", "range"]])
@pytest.mark.parametrize("count", [3, 4, 8])
def test_nothing_is_said_of_large_errors(kinds: list[str], count: int) -> None:
    for seed in range(20):
        stations, seen = scene(seed, count)
        rng = np.random.default_rng([620, seed])
        wrong = rng.random(seen["range"].shape) < 0.2
        seen["range"] = seen["range"] + rng.normal(0, 100, count) + wrong * 500
        seen["azimuth"] = seen["azimuth"] + rng.normal(0, 0.1, count) + wrong * 0.5
        # warnings are errors
        locate(stations, **{kind: seen[kind] for kind in kinds})
