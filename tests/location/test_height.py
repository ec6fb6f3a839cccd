"""The height of a target: given, or not determined."""

import numpy as np
import pytest
from scipy import optimize
from scipy.spatial.transform import Rotation

from tertia import metrics
from tertia.location import LocationStatus, Station, accuracy_map, locate
from tertia.sensors import Bias

PLACES = np.array([[0, 0, 30.0], [3000, 0, 80.0], [3000, 2800, 5.0], [200, 2900, 120.0]])
TARGET = np.array([1700.0, 1200.0, 900.0])
OFFSET = TARGET - PLACES
AZIMUTH = np.arctan2(OFFSET[:, 0], OFFSET[:, 1])
RANGE = np.linalg.norm(OFFSET, axis=-1)


class TestAzimuthsAlone:
    """They do not determine the height; it was 6,000 km below the ground."""

    def test_positions_are_those_in_the_plane(self):
        rng = np.random.default_rng(1)
        azimuth = AZIMUTH + 0.01 * rng.normal(size=(50, 4))
        options = {"azimuth": azimuth, "azimuth_sigma": 0.01, "bias": Bias()}
        space, plane = locate(PLACES, **options), locate(PLACES[:, :2], **options)
        np.testing.assert_allclose(space.position[:, :2], plane.position, rtol=0, atol=1e-5)
        np.testing.assert_allclose(space.covariance[:, :2, :2], plane.covariance, rtol=1e-6)
        np.testing.assert_array_equal(space.degrees_of_freedom, plane.degrees_of_freedom)
        assert np.all(np.isnan(space.position[:, 2]))
        assert np.all(np.isinf(space.sigma[:, 2]))
        assert space.success.all()

    def test_verticals_of_the_stations_do_not_invent_one(self):
        tilt = 0.01
        axes = np.array(
            [[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]
        )
        stations = [Station(PLACES[0], azimuth_sigma=0.01, axes=axes)]
        stations += [Station(place, azimuth_sigma=0.01) for place in PLACES[1:]]
        fix = locate(stations, azimuth=AZIMUTH)
        assert np.isnan(fix.position[2])
        assert metrics.nees(fix.position[:2] - TARGET[:2], fix.covariance[:2, :2]) < 9

    def test_two_of_them_are_enough(self):
        fix = locate(PLACES[:2], azimuth=AZIMUTH[:2], azimuth_sigma=0.01)
        np.testing.assert_allclose(fix.position[:2], TARGET[:2], atol=1e-6)
        assert fix.degrees_of_freedom == 0

    def test_a_height_is_taken_as_given(self):
        fix = locate(PLACES, azimuth=AZIMUTH, azimuth_sigma=0.01, height=900.0, height_sigma=50.0)
        assert fix.position[2] == pytest.approx(900.0)
        assert fix.sigma[2] == pytest.approx(50.0)


class TestGiven:
    def test_it_is_a_measurement(self):
        """Against SciPy: three ranges, and a height."""
        rng = np.random.default_rng(2)
        measured = RANGE[:3] + 5 * rng.normal(size=3)
        options = {"range_sigma": 5.0, "height": 880.0, "height_sigma": 20.0, "bias": Bias()}
        fix = locate(PLACES[:3], range=measured, **options)

        def fun(p):
            away = np.linalg.norm(p - PLACES[:3], axis=-1)
            return np.append((measured - away) / 5, (880 - p[2]) / 20)

        best = optimize.least_squares(fun, TARGET, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        np.testing.assert_allclose(fix.position, best.x, rtol=0, atol=1e-4)
        np.testing.assert_allclose(fix.covariance, np.linalg.inv(best.jac.T @ best.jac), rtol=1e-4)
        assert fix.degrees_of_freedom == 1
        assert fix.statistic == pytest.approx(2 * best.cost, rel=1e-6)

    def test_it_tells_above_from_below(self):
        level = PLACES * [1, 1, 0]
        ranges = np.linalg.norm(TARGET - level, axis=-1)[:3]
        mirrored = locate(level[:3], range=[ranges] * 2, range_sigma=5.0)
        assert np.all(mirrored.status == LocationStatus.AMBIGUOUS)
        for height in (TARGET[2], -TARGET[2]):
            fix = locate(level[:3], range=ranges, range_sigma=5.0, height=height, height_sigma=90.0)
            np.testing.assert_allclose(fix.position, [*TARGET[:2], height], atol=1e-4)

    def test_one_for_each_instant(self):
        heights = np.array([850.0, 900.0, 950.0])
        fixes = locate(
            PLACES, azimuth=AZIMUTH, azimuth_sigma=0.01, height=heights, height_sigma=10.0
        )
        np.testing.assert_allclose(fixes.position[:, 2], heights)

    def test_with_times_of_arrival(self):
        times = RANGE / 340.0
        level = {"height": 900.0, "height_sigma": 10.0}
        fix = locate(
            PLACES, arrival_time=times, arrival_time_sigma=1e-3, propagation_speed=340.0, **level
        )
        np.testing.assert_allclose(fix.position, TARGET, atol=0.1)
        assert fix.degrees_of_freedom == 1

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"height": 1.0}, "height_sigma is missing"),
            ({"height_sigma": 1.0}, "height is missing"),
            ({"height": np.nan, "height_sigma": 1.0}, "height is nan"),
            ({"height": 1.0, "height_sigma": 0.0}, "height_sigma is 0"),
            ({"height": [1.0, 2.0], "height_sigma": np.ones(3)}, "do not fit"),
        ],
    )
    def test_errors(self, options, message):
        with pytest.raises(ValueError, match=message):
            locate(PLACES, azimuth=AZIMUTH, azimuth_sigma=0.01, **options)

    def test_not_in_the_plane_nor_without_sigmas(self):
        level = {"height": 1.0, "height_sigma": 1.0}
        with pytest.raises(ValueError, match="three coordinates"):
            locate(PLACES[:, :2], azimuth=AZIMUTH, azimuth_sigma=0.01, **level)
        with pytest.raises(ValueError, match="standard deviations must be"):
            locate(PLACES, azimuth=AZIMUTH, **level)


# verticals as on the earth, where stations are kilometres apart
TURNS = np.array([[0.0, 0.0], [5e-4, 1e-4], [3e-4, -6e-4], [-4e-4, -2e-4]])


def tilted(**sigmas):
    """Return stations whose verticals differ, as far from each other on the earth."""
    stations = []
    for place, (x, y) in zip(PLACES, TURNS, strict=True):
        axes = Rotation.from_rotvec([x, y, 0.0]).as_matrix()
        stations.append(Station(place, axes=axes, **sigmas))
    return stations


class TestInstantsWithAzimuthsAlone:
    """Other instants of the batch have more."""

    def test_each_is_located_as_if_it_were_alone(self):
        rng = np.random.default_rng(4)
        azimuth = AZIMUTH + 0.01 * rng.normal(size=(20, 4))
        elevation = np.full((20, 4), np.nan)
        elevation[::4] = np.arctan2(OFFSET[:, 2], np.hypot(OFFSET[:, 0], OFFSET[:, 1]))
        stations = tilted(azimuth_sigma=0.01, elevation_sigma=0.01)
        batch = locate(stations, azimuth=azimuth, elevation=elevation, bias=Bias())
        assert batch.success.all()
        assert np.isfinite(batch.position[::4]).all()
        others = np.arange(20) % 4 > 0
        assert np.isnan(batch.position[others, 2]).all()
        assert np.isinf(batch.sigma[others, 2]).all()
        alone = locate(stations, azimuth=azimuth[others], bias=Bias())
        np.testing.assert_allclose(batch.position[others, :2], alone.position[:, :2], rtol=1e-9)
        np.testing.assert_allclose(batch.covariance[others], alone.covariance, rtol=1e-9)
        area = batch.region().area
        np.testing.assert_allclose(area[others], alone.region().area, rtol=1e-9)

    def test_values_that_are_all_missing_are_none(self):
        options = {"azimuth_sigma": 0.01, "elevation_sigma": 0.01, "bias": Bias()}
        fix = locate(PLACES, azimuth=AZIMUTH, elevation=np.full(4, np.nan), **options)
        np.testing.assert_allclose(fix.position[:2], TARGET[:2], atol=1e-6)
        assert np.isnan(fix.position[2])


class TestAccuracy:
    @pytest.mark.parametrize("stations", [PLACES, tilted()])
    def test_of_azimuths_is_that_in_the_plane(self, stations):
        grid = np.array([TARGET, [100.0, 2000.0, 50.0]])
        space = accuracy_map(stations, grid, azimuth_sigma=0.01)
        plane = accuracy_map(PLACES[:, :2], grid[:, :2], azimuth_sigma=0.01)
        np.testing.assert_allclose(space.covariance[:, :2, :2], plane.covariance, rtol=1e-6)
        np.testing.assert_allclose(space.drms, plane.drms, rtol=1e-6)
        assert np.isinf(space.sigma[:, 2]).all()

    def test_where_there_is_no_position_it_is_infinite(self):
        found = accuracy_map(PLACES, PLACES[0], azimuth_sigma=0.01)
        assert np.isinf(found.sigma).all()
        assert np.isinf(found.drms)
