"""Measurements of stations: against formulas, and their errors."""

import numpy as np
import pytest
from reference import location as reference

from tertia.location import locate
from tertia.sensors import Station
from tertia.simulate import stations

PLACES = np.array([[0, 0, 10], [3000, 0, 5], [0, 3000, 0], [3000, 3000, 20.0]])
TARGET = np.array([1000.0, 2000.0, 800.0])
TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("turned", [False, True])
def test_hardly_wrong_measurements_are_those_of_the_formulas(d, turned):
    kinds = ("range", "azimuth", "arrival_time", "elevation")[: d + 1]
    axes = None if not turned else (TURN if d == 3 else np.array([[0.6, 0.8], [-0.8, 0.6]]))
    tiny = {f"{kind}_sigma": 1e-15 for kind in kinds}
    places = [Station(p[:d], axes=axes, **tiny) for p in PLACES]
    record = stations(places, TARGET[:d], propagation_speed=340.0, batch=5, rng=1)
    each = None if axes is None else np.broadcast_to(axes, (4, d, d))
    truth = reference.predict(TARGET[:d], PLACES[:, :d], each)
    truth["arrival_time"] = truth["range"] / 340.0
    assert set(record.measurements) == set(kinds)
    for kind in kinds:
        assert record.measurements[kind].shape == (5, 4)
        np.testing.assert_allclose(record.measurements[kind], [truth[kind]] * 5, rtol=1e-12)


def test_times_of_arrival_lead_back_to_the_target():
    hearing = [Station(p[:2], arrival_time_sigma=0.01) for p in PLACES]
    hearing.append(Station([4000, 1500], arrival_time_sigma=0.01))
    record = stations(
        hearing, TARGET[:2], propagation_speed=340.0, batch=500, outlier_probability=0.05, rng=2
    )
    wrong = record.outlier["arrival_time"]
    error = record.measurements["arrival_time"] * 340 - np.linalg.norm(
        TARGET[:2] - [s.position for s in hearing], axis=-1
    )
    assert np.all(error[wrong] > 0)  # by detours
    fix = locate(hearing, **record.measurements, propagation_speed=340.0)
    clean = ~wrong.any(axis=1) & fix.success
    assert np.median(np.linalg.norm(fix.position - TARGET[:2], axis=1)[clean]) < 6.0
    assert np.median(np.abs(fix.emission_time[clean])) < 0.02
