"""What sensors are made of, and what they refuse."""

import numpy as np
import pytest

from tertia.sensors import Bias, ByKind, Radar, Station

RADAR = {"range_sigma": 50.0, "azimuth_sigma": 0.001, "scan_period": 4.0}


def test_degrees_are_stored_as_radians():
    station = Station([0, 0, 0], azimuth_sigma=0.5, elevation_sigma=2, range_sigma=9, degrees=True)
    assert station.azimuth_sigma == np.radians(0.5)
    assert station.elevation_sigma == np.radians(2)
    assert station.range_sigma == 9
    radar = Radar(**RADAR | {"azimuth_sigma": 0.1}, degrees=True)
    assert (radar.azimuth_sigma, radar.range_sigma) == (np.radians(0.1), 50.0)
    bias = Bias(azimuth=[1.0, 2.0], azimuth_sigma=0.1, range=3.0, degrees=True)
    np.testing.assert_array_equal(bias.azimuth, np.radians([1.0, 2.0]))
    np.testing.assert_array_equal(bias.range, [3.0, 3.0])
    np.testing.assert_array_equal(bias.azimuth_sigma, np.radians([0.1, 0.1]))


def test_stations_measure_times_from_places_that_are_surveyed():
    station = Station([0, 0], arrival_time_sigma=1e-8, position_sigma=2)
    assert (station.arrival_time_sigma, station.position_sigma) == (1e-8, 2.0)
    assert (Station([0, 0]).arrival_time_sigma, Station([0, 0]).position_sigma) == (None, 0.0)
    for wrong in (-1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="position_sigma is"):
            Station([0, 0], position_sigma=wrong)
    with pytest.raises(ValueError, match="arrival_time_sigma is 0"):
        Station([0, 0], arrival_time_sigma=0.0)


def test_the_bias_of_one_of_several_sensors():
    bias = Bias(range=[1.0, 2.0], azimuth_sigma=None, elevation_sigma=[0.0, np.inf])
    assert len(bias) == 2
    one = bias[1]
    assert (one.range, one.azimuth_sigma, one.elevation_sigma) == (2.0, None, np.inf)
    assert repr(one) == "Bias(range=2, azimuth_sigma=None, elevation_sigma=inf)"
    assert repr(Bias()) == "Bias()"
    assert all([Bias(), bias, one])  # `if bias:` asks whether there is one
    with pytest.raises(TypeError, match="one sensor"):
        len(one)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"azimuth": 45.0}, r"azimuth is 45.*degrees\?"),
        ({"elevation_sigma": 4.0}, r"elevation_sigma is 4.*degrees\?"),
        ({"range": np.inf}, "range is inf; it must be a finite number"),
        ({"range_sigma": [1.0, -1.0]}, r"range_sigma\[1\] is -1.0; it must be 0, positive or inf"),
        (
            {"range": [1.0, 2.0], "azimuth": [0.1, 0.2, 0.3]},
            r"shapes range \(2,\), .*azimuth \(3,\)",
        ),
        ({"range": [[1.0]]}, r"each must be \(\) or \(K,\)"),
    ],
)
def test_a_bias_outside_its_domain(options, message):
    with pytest.raises(ValueError, match=message):
        Bias(**options)


def test_outliers_of_all_kinds_are_counted():
    marks = ByKind(range=np.array([[True, False], [True, True]]), azimuth=np.eye(2, dtype=bool))
    np.testing.assert_array_equal(marks.count, [2, 3])
    assert ByKind(range=np.array([True])).count == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"azimuth_sigma": 60.0}, r"azimuth_sigma is 60.*are these degrees\?"),
        # a degree
        ({"azimuth_sigma": 1.0}, r"azimuth_sigma is 1; .* at most 0.5 rad; are these degrees\?"),
        ({"azimuth_sigma": 1e-200}, "azimuth_sigma is 1e-200; it must be between 1e-150 and 1e"),
        ({"range_sigma": 1e200}, r"range_sigma is 1e\+200; it must be between 1e-150 and 1e\+150"),
        ({"scan_period": 1e-7}, "scan_period is 1e-07; it must be at least 0.001 s"),
    ],
)
def test_a_radar_outside_its_domain(options, message):
    with pytest.raises(ValueError, match=message):
        Radar(**{"range_sigma": 50.0, "azimuth_sigma": 0.001, "scan_period": 4.0} | options)
    Radar(range_sigma=50.0, azimuth_sigma=0.5, scan_period=0.001)
