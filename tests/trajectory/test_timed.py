"""Paths from times of arrival: the emission of each instant is one more unknown."""

import numpy as np
import polars as pl
import pytest
from checks import in_region

from tertia import metrics, tables
from tertia.sensors import Bias, Station
from tertia.trajectory import reconstruct

PLACES = np.array([[0, 0], [9000, 500], [8500, 8000], [-500, 7500], [4000, -3000]], dtype=float)
LIGHT = 299_792_458.0
SIGMA = 30e-9
TIME = np.arange(80.0)
PATH = np.column_stack([1000 + 80 * TIME, 2000 + 1500 * np.sin(TIME / 25)])
BIASED = Bias(time_sigma=100e-9)
STATIONS = [Station(place, arrival_time_sigma=SIGMA) for place in PLACES]


def heard(seed, places=PLACES, path=PATH):
    rng = np.random.default_rng(seed)
    travel = np.linalg.norm(path[:, np.newaxis] - places, axis=-1) / LIGHT
    emitted = TIME + rng.uniform(0, 0.3, len(TIME))
    return emitted[:, np.newaxis] + travel + SIGMA * rng.standard_normal(travel.shape)


def test_arrivals_are_differences_to_any_receiver():
    arrival = heard(1)
    for order in (np.arange(5), np.array([3, 1, 0, 2, 4])):
        stations = [STATIONS[k] for k in order]
        options = {"spatial": "least-squares", "bias": Bias(), "jerk": 0.01}
        found = reconstruct(stations, TIME, arrival_time=arrival[:, order], **options)
        difference = LIGHT * (arrival[:, order[1:]] - arrival[:, order[:1]])
        other = reconstruct(
            stations,
            TIME,
            range_difference=difference,
            range_difference_sigma=np.sqrt(2) * LIGHT * SIGMA,
            **options,
        )
        # from differences of times the last digits of the times are missing
        np.testing.assert_allclose(found.position, other.position, atol=1e-4)
        np.testing.assert_allclose(found.covariance, other.covariance, rtol=1e-5, atol=1e-6)


def test_two_arrivals_are_a_hyperbola_and_one_is_nothing():
    arrival = heard(2)
    few = arrival.copy()
    few[20:40, 2:] = np.nan
    none, lone = few.copy(), few.copy()
    none[20:40] = np.nan
    lone[20:40, 1] = np.nan
    two, without, alone = (
        reconstruct(STATIONS, TIME, arrival_time=own, bias=Bias()) for own in (few, none, lone)
    )
    assert np.mean(two.sigma[25:35] ** 2) < 0.8 * np.mean(without.sigma[25:35] ** 2)
    np.testing.assert_allclose(alone.position, without.position, atol=1e-6)
    assert not alone.outlier.arrival_time[20:40].any()
    assert np.isnan(alone.residual.arrival_time[20:40]).all()


@pytest.mark.parametrize("share", [0.05, 0.1])
def test_late_arrivals_are_left_out_and_regions_hold(share):
    inside, rms, left = [], [], []
    for seed in range(12):
        arrival = heard(seed)
        rng = np.random.default_rng([9, seed])
        late = rng.random(arrival.shape) < share
        arrival[late] += rng.uniform(10, 100, late.sum()) * SIGMA
        arrival[rng.random(arrival.shape) < 0.2] = np.nan
        found = reconstruct(STATIONS, TIME, arrival_time=arrival)
        error = found.position - PATH
        inside.append(in_region(error, found.covariance[:, :2, :2]))
        rms.append(np.sqrt(np.mean(np.sum(error**2, axis=1))))
        known = late & ~np.isnan(arrival)
        left.append(np.mean(found.outlier.arrival_time[known]))
    assert 0.9 < np.mean(inside) < 0.99
    assert np.mean(left) > 0.85
    assert np.mean(rms) < 4.0
    assert np.max(rms) < 6.0


def test_clocks_that_are_wrong():
    clock = np.array([0, 200e-9, 0, 0, -150e-9])
    inside = []
    for seed in range(8):
        found = reconstruct(STATIONS, TIME, arrival_time=heard(seed) + clock)
        inside.append(np.mean(in_region(found.position - PATH, found.covariance[:, :2, :2])))
        time = found.bias.time - np.mean(found.bias.time)
        assert np.all(np.abs(time - (clock - np.mean(clock))) < 4 * found.bias.time_sigma)
        assert found.systematic == "estimated"
    assert np.mean(inside) > 0.85


def test_clocks_that_are_known_so_well():
    square, sigma = [], 100e-9
    for seed in range(60):
        clock = sigma * np.random.default_rng([7, seed]).standard_normal(5)
        found = reconstruct(STATIONS, TIME, arrival_time=heard(seed) + clock, bias=BIASED)
        square.append(np.mean(metrics.nees(found.position - PATH, found.covariance[:, :2, :2])))
        assert found.systematic == "given"
    assert 0.75 < np.mean(square) / 2 < 1.3


def test_arrivals_beside_other_kinds_and_dates():
    arrival = heard(3)
    offset = PATH[:, np.newaxis] - PLACES
    bearing = np.arctan2(offset[..., 0], offset[..., 1])
    bearing += 0.01 * np.random.default_rng(4).standard_normal(bearing.shape)
    arrival[:, 2:] = np.nan
    dates = np.datetime64("2026-01-01T00:00:00", "ps") + (1e12 * arrival).astype("timedelta64[ps]")
    options = {"azimuth": bearing, "azimuth_sigma": 0.01}
    found = reconstruct(STATIONS, TIME, arrival_time=arrival, **options)
    other = reconstruct(STATIONS, TIME, arrival_time=dates, **options)
    alone = reconstruct(STATIONS, TIME, **options)
    np.testing.assert_allclose(found.position, other.position, atol=0.1)
    assert np.mean(found.sigma) < np.mean(alone.sigma)
    assert set(found.statistics) == {"azimuth", "arrival_time"}


def test_tables():
    arrival = heard(5)
    names = [f"R{k}" for k in range(5)]
    stations = [
        Station(place, name=name, arrival_time_sigma=SIGMA, position_sigma=1.0)
        for place, name in zip(PLACES, names, strict=True)
    ]
    rows = [
        (TIME[t], names[k], arrival[t, k] - TIME[t]) for t in range(len(TIME)) for k in range(5)
    ]
    table = pl.DataFrame(rows, ["time_s", "sensor", "arrival_time_s"], orient="row")
    path = tables.reconstruct(table, sensors=stations, propagation_speed=LIGHT)
    found = reconstruct(stations, TIME, arrival_time=arrival - TIME[:, np.newaxis])
    np.testing.assert_allclose(path.select("east_m", "north_m"), found.position, atol=1e-6)
    np.testing.assert_allclose(path["east_sigma_m"], found.sigma[:, 0], rtol=1e-9)


def test_clocks_of_files():
    clock = np.array([0, 200e-9, 0, 0, -150e-9])
    names = [f"R{k}" for k in range(5)]
    arrival = heard(6) + clock
    rows = [(TIME[t], names[k], arrival[t, k]) for t in range(len(TIME)) for k in range(5)]
    table = pl.DataFrame(rows, ["time_s", "sensor", "arrival_time_s"], orient="row")
    paths = {}
    for way in ("stated", "nothing"):
        bias = [Bias(time=error) if way == "stated" else Bias() for error in clock]
        stations = [
            Station(place, name=name, arrival_time_sigma=SIGMA, bias=own)
            for place, name, own in zip(PLACES, names, bias, strict=True)
        ]
        paths[way] = tables.reconstruct(table, sensors=stations)
        found = reconstruct(stations, TIME, arrival_time=arrival)
        np.testing.assert_allclose(
            paths[way].select("east_m", "north_m"), found.position, atol=1e-6
        )
    error = {way: path.select("east_m", "north_m").to_numpy() - PATH for way, path in paths.items()}
    assert np.sqrt(np.mean(error["stated"] ** 2)) < 4.0 < np.sqrt(np.mean(error["nothing"] ** 2))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"arrival_time": np.zeros((80, 4))}, "arrival_time has shape"),
        ({"arrival_time": np.zeros((79, 5))}, "arrival_time has shape"),
        ({"arrival_time": heard(0), "order": "temporal-first"}, "arrival_time needs order"),
        (
            {
                "arrival_time": heard(0),
                "range_difference": np.zeros((80, 4)),
                "range_difference_sigma": 1.0,
            },
            "arrival_time and range_difference share",
        ),
        ({"arrival_time": heard(0), "propagation_speed": 0.0}, "propagation_speed"),
        ({"arrival_time": heard(0), "bias": Bias(time_sigma=np.inf)}, "bias.time_sigma is inf"),
        ({"arrival_time": heard(0), "arrival_time_sigma": np.ones(4)}, "arrival_time_sigma"),
    ],
)
def test_what_cannot_be(options, message):
    with pytest.raises(ValueError, match=message):
        reconstruct(STATIONS, TIME, **options)
