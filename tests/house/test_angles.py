import numpy as np
import pytest
from checks import assert_refused

from tertia import _units
from tertia._arrays import radians
from tertia.fusion import common_azimuth
from tertia.geo import LocalFrame
from tertia.location import locate
from tertia.registration import calibrate
from tertia.sensors import Bias, Station
from tertia.tracker import Plots
from tertia.trajectory import reconstruct

PLACES = [[0.0, 0.0], [1000.0, 0.0]]
STATIONS = [Station(place, azimuth_sigma=0.01) for place in PLACES]


def test_radians_stay_and_degrees_are_converted():
    given = [0.0, -4 * np.pi, np.nan, 7.0]
    np.testing.assert_array_equal(radians(given, "azimuth"), given)
    np.testing.assert_array_equal(
        radians([[90.0, -720.0]], "azimuth", degrees=True), np.radians([[90.0, -720.0]])
    )
    assert radians(90.0, "azimuth_sigma", degrees=True, is_sigma=True) == np.pi / 2
    assert radians(np.inf, "azimuth_sigma", is_sigma=True) == np.inf


@pytest.mark.parametrize(
    ("given", "options", "text"),
    [
        ([1.0, 90.0], {}, "azimuth[1] is 90.0; it must be at most 4 pi; are these degrees? pass"),
        (-12.6, {}, "azimuth is -12.6; it must be at most 4 pi"),
        (2.0, {"is_sigma": True}, "azimuth is 2.0; it must be at most 1.814; are these degrees?"),
        ([[721]], {"degrees": True}, "azimuth[0, 0] is 721.0; it must be at most 720 degrees"),
        (
            104,
            {"degrees": True, "is_sigma": True},
            "azimuth is 104.0; it must be at most 103.9",
        ),
    ],
)
def test_what_cannot_be_is_refused(given, options, text):
    assert_refused(lambda: radians(given, "azimuth", **options), ValueError, text)


def test_units():
    assert pytest.approx(0.514444, abs=1e-6) == _units.KNOT
    assert _units.FLIGHT_LEVEL == 30.48


@pytest.mark.parametrize(
    "call",
    [
        lambda a: locate(PLACES, azimuth=[a, 0.1], azimuth_sigma=0.01),
        lambda a: locate(PLACES, azimuth=[a, 0.1], method="posterior", max_range=1e4),
        lambda a: reconstruct(STATIONS, [0.0, 1.0], azimuth=[[a, 0.1], [0.2, 0.1]]),
        lambda a: calibrate(STATIONS[0], [0.0, 1.0], np.ones((2, 2)), azimuth=[0.1, a]),
        lambda a: Plots([0.0], [1e4], [a]),
        lambda a: Bias(azimuth=a),
        lambda a: common_azimuth(
            50e3, a, [-30e3, 20e3], range_sigma=50.0, azimuth_sigma=0.002
        ),
        lambda a: LocalFrame(50.1, 14.26, 380.0).polar_to_geodetic(100e3, a, 10e3),
    ],
)  # fmt: skip
@pytest.mark.parametrize("azimuth", [45.0, 359.0, -90.0])
def test_degrees_are_refused_wherever_radians_are_expected(call, azimuth):
    with pytest.raises(ValueError, match=r"azimuth.* at most 4 pi; are these degrees\?"):
        call(azimuth)
