"""Azimuths of several sites, as seen from one."""

import numpy as np
import pytest
from checks import INF, NAN, close, rng
from reference import fusion as reference
from tolerances import VECTOR

from tertia.fusion import common_azimuth


def polar(distance, azimuth, site, origin):
    east = distance * np.sin(azimuth) + site[0] - origin[0]
    north = distance * np.cos(azimuth) + site[1] - origin[1]
    return np.array([np.arctan2(east, north) % (2 * np.pi), np.hypot(east, north)])


SITES = [((-30e3, 20e3), (0.0, 0.0)), ((10e3, 5e3), (-7e3, 40e3)), ((1e3, -1e3), (1e3, 2e3))]
TARGETS = np.array([[50e3, 1.5], [20e3, 4.0], [8e3, 0.1], [120e3, 6.2]])


class TestCommonAzimuth:
    @pytest.mark.parametrize(("site", "origin"), SITES)
    @pytest.mark.parametrize(("distance", "azimuth"), TARGETS)
    def test_against_differences(self, distance, azimuth, site, origin):
        spread = np.array([50.0, 0.002])
        found, covariance = common_azimuth(
            distance, azimuth, site, range_sigma=50.0, azimuth_sigma=0.002, origin=origin
        )
        assert found == close(polar(distance, azimuth, site, origin))
        columns = []
        for step in (np.array([1.0, 0]), np.array([0, 1e-5])):
            up, down = (
                polar(*(np.array([distance, azimuth]) + sign * step), site, origin)
                for sign in (1, -1)
            )
            away = up - down
            away[0] = reference.wrap(away[0], 2 * np.pi)
            columns.append(away / (2 * step.sum()))
        jacobian = np.stack(columns, axis=-1)
        scale = np.sqrt(np.diag(covariance))
        expected = jacobian @ np.diag(spread**2) @ jacobian.T
        np.testing.assert_allclose((covariance - expected) / np.outer(scale, scale), 0, atol=1e-6)

    def test_against_simulation(self):
        random = rng(31)
        draws = 200_000
        distance = 50e3 + 50 * random.standard_normal(draws)
        azimuth = 1.5 + 0.002 * random.standard_normal(draws)
        site = (-30e3, 20e3)
        found, covariance = common_azimuth(50e3, 1.5, site, range_sigma=50, azimuth_sigma=0.002)
        sample = np.cov(polar(distance, azimuth, site, (0.0, 0.0)))
        scale = np.sqrt(np.diag(covariance))
        # the error of a correlation is at most 1/sqrt(n), of a variance sqrt(2/n)
        np.testing.assert_allclose(
            (sample - covariance) / np.outer(scale, scale), 0, atol=4 * np.sqrt(2 / draws)
        )
        assert found.shape == (2,)

    def test_a_site_at_the_origin_sees_what_it_sees(self):
        distance, azimuth = TARGETS.T
        place = (3e3, -4e3)
        found, covariance = common_azimuth(
            distance, azimuth, place, range_sigma=50.0, azimuth_sigma=0.002, origin=place
        )
        np.testing.assert_allclose(found, np.stack([azimuth, distance], axis=-1), rtol=VECTOR)
        expected = np.broadcast_to(np.diag([0.002**2, 50.0**2]), covariance.shape)
        np.testing.assert_allclose(covariance, expected, rtol=VECTOR, atol=1e-12)

    def test_shapes(self):
        options = {"range_sigma": 50.0, "azimuth_sigma": np.full((3, 1), 0.002)}
        found, covariance = common_azimuth(*TARGETS.T, (1e3, 2e3), **options)
        assert found.shape == (3, 4, 2)
        assert covariance.shape == (3, 4, 2, 2)
        np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
        one, _ = common_azimuth(*TARGETS[2], (1e3, 2e3), range_sigma=50.0, azimuth_sigma=0.002)
        np.testing.assert_array_equal(found[1, 2], one)

    def test_the_azimuth_is_below_a_whole_turn(self):
        found, _ = common_azimuth(1e3, -1e-18, (0, 0), range_sigma=1.0, azimuth_sigma=0.002)
        assert 0 <= found[0] < 2 * np.pi

    @pytest.mark.parametrize(
        ("changes", "error", "message"),
        [
            ({"range": -1.0}, ValueError, "range is -1.0; it must be a positive number"),
            ({"range": [1.0, 0.0]}, ValueError, r"range\[1\] is 0.0"),
            ({"range": NAN}, ValueError, "range is nan"),
            ({"azimuth": INF}, ValueError, "azimuth is inf"),
            ({"azimuth": "north"}, TypeError, "azimuth has dtype"),
            ({"range_sigma": 0.0}, ValueError, "range_sigma is 0.0"),
            ({"azimuth_sigma": [[1.0, -1.0]]}, ValueError, r"azimuth_sigma\[0, 1\] is -1.0"),
            ({"position": (1.0, 2.0, 3.0)}, ValueError, r"position has shape \(3,\)"),
            ({"position": (1.0, NAN)}, ValueError, r"position\[1\] is nan"),
            ({"origin": 1.0}, ValueError, r"origin has shape \(\)"),
            ({"range": [1.0] * 2, "azimuth": [1.0] * 3}, ValueError, "do not fit together"),
            ({"range": 2.0, "azimuth": 0.0, "position": (0, -2)}, ValueError, "to the origin"),
        ],
    )
    def test_errors(self, changes, error, message):
        arguments = {"range": 1e3, "azimuth": 0.5, "position": (1.0, 2.0)}
        arguments |= {"range_sigma": 50.0, "azimuth_sigma": 0.002} | changes
        with pytest.raises(error, match=message):
            common_azimuth(**arguments)
