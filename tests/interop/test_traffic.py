"""Flights of traffic: the path, its errors, outliers and gaps."""

import numpy as np
import pytest

from tertia.geo import LocalFrame

pd = pytest.importorskip("pandas")
# some versions of traffic do not know some of pandas
core = pytest.importorskip("traffic.core", exc_type=ImportError)

from tertia.interop.traffic import smooth  # noqa: E402

ORIGIN = LocalFrame(48.0, 11.0)
SIGMA, ALTITUDE_SIGMA = 15.0, 20.0
START = pd.Timestamp("2024-05-01T12:00", tz="UTC")


def ramp(time, start, duration, ease):
    """From 0 to 1, with a rate that itself takes `ease` seconds to rise and to fall."""
    knots = np.array([start, start + ease, start + duration, start + duration + ease])
    rate = np.interp(time, knots, [0.0, 1.0, 1.0, 0.0])
    total = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2)])
    return total / total[-1], rate / total[-1]


def truth(n=400):
    """Straight, a turn of 90 degrees, straight; a climb at 1200 ft/min that levels off."""
    time = np.arange(n, dtype=float)
    turned, _ = ramp(time, 150.0, 60.0, 8.0)
    course = np.radians(30.0) + turned * np.pi / 2
    velocity = 200.0 * np.column_stack([np.sin(course), np.cos(course)])
    place = np.vstack([[0.0, 0.0], np.cumsum((velocity[1:] + velocity[:-1]) / 2, axis=0)])
    climbed, rate = ramp(time, -100.0, 350.0, 20.0)
    return time, place, velocity, 15000.0 + 5000.0 * climbed, 5000.0 * 60.0 * rate


def flight(seed=1, missing=(), outliers=(), sigma=SIGMA):
    rng = np.random.default_rng(seed)
    time, place, _, altitude, _ = truth()
    noisy = place + sigma * rng.standard_normal(place.shape)
    for row in outliers:
        noisy[row] += [800.0, -400.0]
    east_north_up = np.column_stack([noisy, np.zeros(len(noisy))])
    # on the ellipsoid, as positions are reported
    latitude, longitude, _ = ORIGIN.to_geodetic(east_north_up)
    height = altitude + ALTITUDE_SIGMA * rng.standard_normal(len(time))
    latitude[list(missing)] = np.nan
    return core.Flight(
        pd.DataFrame(
            {
                "timestamp": START + pd.to_timedelta(time, unit="s"),
                "latitude": latitude,
                "longitude": longitude,
                "altitude": height,
                "callsign": "TEST1",
                "icao24": "abcdef",
            }
        )
    )


def normalised(found):
    """Errors over their sigmas: east and north, and of each other column."""
    _, place, velocity, altitude, rate = truth()
    data = found.data
    local = ORIGIN.to_local(data["latitude"].to_numpy(), data["longitude"].to_numpy())[:, :2]
    course = np.degrees(np.arctan2(*velocity.T))
    stretch = 1 + altitude * 0.3048 / 6_371_000.0
    off = (data["track"].to_numpy() - course + 180) % 360 - 180
    return {
        "position": (local - place) / data[["position_sigma_m"]].to_numpy(),
        "groundspeed": (data["groundspeed"] - np.hypot(*velocity.T) * stretch * 3600 / 1852)
        / data["groundspeed_sigma"],
        "track": off / data["track_sigma"],
        "altitude": (data["altitude"] - altitude) / data["altitude_sigma"],
        "vertical_rate": (data["vertical_rate"] - rate) / data["vertical_rate_sigma"],
    }


def test_errors_are_smaller_and_as_told():
    squares = {}
    for seed in range(4):
        found = smooth(flight(seed))
        for name, value in normalised(found).items():
            squares.setdefault(name, []).append(np.mean(np.square(np.asarray(value))))
    means = {name: float(np.mean(value)) for name, value in squares.items()}
    # jerk comes at the ends of a turn and is not white, as the page says
    limits = {"position": 1.2, "groundspeed": 1.0, "track": 3.0}
    limits |= {"altitude": 1.7, "vertical_rate": 1.7}
    assert all(0.3 < mean < limits[name] for name, mean in means.items()), means
    data = found.data
    assert data["position_sigma_m"].median() < 0.6 * SIGMA
    assert data["altitude_sigma"].median() < 0.6 * ALTITUDE_SIGMA
    assert type(found) is core.Flight
    assert found.callsign == "TEST1"


def test_outliers_are_found_and_do_not_matter():
    wrong = [40, 41, 120, 300]
    clean, found = smooth(flight(7)), smooth(flight(7, outliers=wrong))
    assert np.flatnonzero(found.data["position_outlier"]).tolist() == wrong
    assert not clean.data["position_outlier"].any()
    near = np.abs(found.data["groundspeed"] - clean.data["groundspeed"])
    assert near.max() < 3 * clean.data["groundspeed_sigma"].max()


def test_gaps_are_filled_and_less_certain():
    gap = range(60, 100)
    data = smooth(flight(3, missing=gap)).data
    assert data[["latitude", "longitude", "groundspeed"]].notna().all(axis=None)
    inside, outside = data["position_sigma_m"].iloc[80], data["position_sigma_m"].iloc[40]
    assert inside > 2 * outside
    assert not data["position_outlier"].any()


def test_sigmas_that_are_given():
    data = smooth(flight(), position_sigma=SIGMA, altitude_sigma=ALTITUDE_SIGMA).data
    fitted = smooth(flight()).data
    ratio = (data["position_sigma_m"] / fitted["position_sigma_m"]).median()
    assert 0.8 < ratio < 1.25


def test_without_altitudes_and_in_any_order():
    given = flight()
    mixed = given.data.drop(columns="altitude").sample(frac=1.0, random_state=1)
    data = smooth(core.Flight(mixed)).data
    assert "altitude" not in data.columns
    expected = smooth(core.Flight(given.data.drop(columns="altitude"))).data
    assert np.array_equal(data["latitude"], expected["latitude"])


def test_a_long_flight_goes_round_the_earth():
    """Positions every 30 s along a great circle, from the equator over the pole."""
    time = np.arange(0.0, 36_000.0, 30.0)
    angle = time * 250.0 / 6_371_000.0 + np.radians(60.0)
    latitude = np.degrees(np.arcsin(np.sin(angle)))
    longitude = np.where(np.cos(angle) > 0, 20.0, -160.0)
    table = pd.DataFrame(
        {
            "timestamp": START + pd.to_timedelta(time, unit="s"),
            "latitude": latitude,
            "longitude": longitude,
            "callsign": "POLE",
            "icao24": "abcdef",
        }
    )
    data = smooth(core.Flight(table), position_sigma=20.0).data
    assert np.abs(data["latitude"] - latitude).max() < 1e-3
    speed = data["groundspeed"].iloc[5:-5] * 1852 / 3600
    assert speed.between(245, 256).all()


def test_mistakes():
    with pytest.raises(ValueError, match="has 0 positions; it must have 10"):
        smooth(flight(missing=range(400)))
    with pytest.raises(ValueError, match="position_sigma is -1"):
        smooth(flight(), position_sigma=-1.0)
