"""Stations whose clocks differ are found by their contradictions; other errors are not mistaken."""

import re
import warnings

import numpy as np
import polars as pl
import pytest

from tertia import tables

COUNT, STEP, NAMES = 80, 2.0, "abcd"
SIGMAS = {"range": 5.0, "azimuth": 0.003, "elevation": 0.003}
TIMES = STEP * np.arange(COUNT)
KINDS = [("azimuth",), ("range",), ("azimuth", "range"), ("azimuth", "elevation")]


def measured(kind, position, places):
    """Return what stations measure of positions, (N, K, D)."""
    away = position - places
    flat = np.hypot(away[..., 0], away[..., 1])
    if kind == "range":
        return np.linalg.norm(away, axis=-1)
    if kind == "azimuth":
        return np.arctan2(away[..., 0], away[..., 1])
    return np.arctan2(away[..., 2], flat)


def recording(seed, kinds, clocks=0.0, bias=0.0, survey=0.0):
    """Return a table, the stations, and how early each clock is."""
    random = np.random.default_rng([83, seed])
    d = 3 if "elevation" in kinds else 2
    places = np.zeros((4, d))
    places[:, :2] = 2500.0 * np.array([[-1, -0.8], [1.1, -0.9], [0.9, 1], [-1, 1.1]])
    places[:, :2] += random.uniform(-500.0, 500.0, (4, 2))
    course = random.uniform(0.0, 6.0) + np.cumsum(random.normal(0.0, 0.07, COUNT))
    way = np.cumsum(20.0 * STEP * np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    way = np.column_stack([way - way.mean(axis=0), 500.0 + 2.0 * TIMES])[:, :d]
    early = clocks * random.permutation([-1.1, -0.4, 0.5, 1.2])
    now = TIMES[:, np.newaxis] + early
    seen = np.stack([np.interp(now, TIMES, one) for one in way.T], axis=-1)
    true = places.copy()
    true[:, :2] += survey * random.normal(size=(4, 2))
    columns = {"time_s": np.repeat(TIMES, 4), "sensor": list(NAMES) * COUNT}
    for kind in kinds:
        noise = random.normal(size=(COUNT, 4)) + bias * random.normal(size=4)
        values = measured(kind, seen, true) + SIGMAS[kind] * noise
        values[random.random(values.shape) < 0.1] = np.nan
        unit, factor = ("m", 1.0) if kind == "range" else ("deg", 180.0 / np.pi)
        columns[f"{kind}_{unit}"] = factor * values.ravel()
    names = ("east_m", "north_m", "up_m")[:d]
    stations = {"name": list(NAMES), **dict(zip(names, places.T, strict=True))}
    stations |= {"range_sigma_m": [5.0] * 4, "azimuth_sigma_deg": [np.degrees(0.003)] * 4}
    stations["elevation_sigma_deg"] = [np.degrees(0.003)] * 4
    return pl.DataFrame(columns).fill_nan(None), pl.DataFrame(stations), early


def notes(estimate, table, stations):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        estimate(table, sensors=stations)
    return [text for text in map(str, (one.message for one in caught)) if "clocks" in text]


@pytest.mark.parametrize("kinds", KINDS)
@pytest.mark.parametrize("seed", [1, 3, 5])
def test_clocks_that_differ(kinds, seed):
    table, stations, early = recording(seed, kinds, clocks=3.0)
    found = notes(tables.reconstruct, table, stations)
    assert len(found) == 1
    said = re.findall(r"(-?[\d.]+) ± [\d.]+ s to those of (\w)", found[0])
    assert said
    for value, name in said:
        expected = early[NAMES.index(name)] - early[0]
        assert abs(float(value) - expected) < 0.15 * abs(expected) + 0.3, (value, expected)
    assert notes(tables.locate, table, stations) == found


@pytest.mark.parametrize("kinds", KINDS)
@pytest.mark.parametrize("error", [{}, {"bias": 5.0}, {"survey": 60.0}])
def test_other_errors_are_not_clocks(kinds, error):
    for seed in range(4):
        table, stations, _ = recording(seed, kinds, **error)
        assert not notes(tables.locate, table, stations)


def test_corrected_times_agree():
    table, stations, early = recording(1, ("azimuth", "range"), clocks=3.0)
    late = dict(zip(NAMES, early, strict=True))
    shift = table["sensor"].replace_strict(late, return_dtype=pl.Float64)
    path = tables.reconstruct(table.with_columns(pl.col("time_s") + shift), sensors=stations)
    with pytest.warns(UserWarning, match="clocks"):
        before = tables.reconstruct(table, sensors=stations)
    size = ["east_sigma_m", "north_sigma_m"]
    assert path.select(size).median().row(0) < before.select(size).median().row(0)
