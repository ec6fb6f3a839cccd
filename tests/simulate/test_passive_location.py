"""What two passive stations can tell: derivatives and covariances."""

import numpy as np
import pytest
from tolerances import INVERSES

from tertia.simulate import passive_location

SITES = np.array([[-15e3, 0.0], [15e3, 0.0]])
POSITIONS = np.array([[3e3, 40e3], [-30e3, 20e3], [50e3, 70e3], [10e3, -25e3]])


def measurements(position, sites):
    """Both azimuths, clockwise from north, and the difference of the ranges; may be complex."""
    offset = position - sites
    ranges = np.sqrt(offset[:, 0] ** 2 + offset[:, 1] ** 2)
    # on the right branch but for half turns, which derivatives do not see
    azimuths = np.arctan(offset[:, 0] / offset[:, 1])
    return np.array([*azimuths, ranges[0] - ranges[1]])


class TestPassiveLocation:
    @pytest.mark.parametrize("sites", [SITES, np.array([[1e3, -2e3], [-4e3, 9e3]])])
    def test_jacobian_by_complex_steps(self, sites):
        target = passive_location(POSITIONS, stations=sites)
        assert target.jacobian.shape == (4, 3, 2)
        for place, found in zip(POSITIONS, target.jacobian, strict=True):
            for i in range(2):
                step = np.zeros(2, dtype=complex)
                step[i] = 1e-100j
                expected = measurements(place + step, sites).imag / 1e-100
                np.testing.assert_allclose(found[:, i], expected, rtol=1e-11, atol=1e-16)

    def test_azimuths_turn_clockwise_from_north(self):
        north = passive_location([-15e3, 10e3])
        assert north.jacobian[0] == pytest.approx([1e-4, 0], abs=1e-20)
        east = passive_location([25e3, 1e-3])
        assert east.jacobian[1] == pytest.approx([1e-11, -1e-4], rel=1e-6)

    def test_covariances(self):
        """(J' Sigma^-1 J)^-1 of the two measurements that each is made of."""
        sigma = np.array([np.radians(0.3), np.radians(0.3), 100.0])
        target = passive_location(POSITIONS)
        np.testing.assert_allclose(target.sigma, sigma, rtol=1e-15)
        np.testing.assert_array_equal(target.position, POSITIONS)
        for jacobian, found in zip(target.jacobian, target.covariances, strict=True):
            for rows, covariance in zip(([0, 1], [0, 2]), found, strict=True):
                scaled = jacobian[rows] / sigma[rows, None]
                expected = np.linalg.inv(scaled.T @ scaled)
                np.testing.assert_allclose(covariance, expected, rtol=1e-9)

    def test_options(self):
        plain = passive_location(POSITIONS)
        finer = passive_location(
            POSITIONS, azimuth_sigma=np.radians(0.3) / 2, range_difference_sigma=50.0
        )
        np.testing.assert_allclose(finer.covariances, plain.covariances / 4, rtol=INVERSES)
        shift = np.array([1e3, -5e3])
        moved = passive_location(POSITIONS + shift, stations=SITES + shift)
        np.testing.assert_allclose(moved.covariances, plain.covariances, rtol=1e-9)

    @pytest.mark.parametrize("shape", [(), (4,), (2, 2), (0,)])
    def test_a_batch_is_its_positions(self, shape):
        places = POSITIONS[: int(np.prod(shape))].reshape(*shape, 2)
        target = passive_location(places)
        assert target.jacobian.shape == (*shape, 3, 2)
        assert target.covariances.shape == (*shape, 2, 2, 2)
        assert target.estimates(rng=1).shape == (*shape, 2, 2)
        for place in np.ndindex(shape):
            one = passive_location(places[place])
            np.testing.assert_array_equal(target.jacobian[place], one.jacobian)
            np.testing.assert_array_equal(target.covariances[place], one.covariances)

    def test_estimates_have_the_covariances_and_share_an_azimuth(self):
        trials = 40_000
        target = passive_location(POSITIONS)
        many = passive_location(np.broadcast_to(POSITIONS, (trials, 4, 2)))
        error = many.estimates(rng=2) - POSITIONS[:, None]
        for p in range(4):
            for e in range(2):
                found = np.cov(error[:, p, e], rowvar=False)
                expected = target.covariances[p, e]
                sigma = np.sqrt(np.diag(expected))
                scaled = (found - expected) / np.outer(sigma, sigma)
                assert np.abs(scaled).max() < 4 * np.sqrt(2 / trials)
            # the first azimuth of both is the same, the other measurement is not
            azimuths = error[:, p] @ target.jacobian[p, 0]
            np.testing.assert_allclose(azimuths[:, 0], azimuths[:, 1], atol=1e-12)
            assert azimuths[:, 0].std() == pytest.approx(target.sigma[0], rel=0.02)
            others = np.array(
                [error[:, p, 0] @ target.jacobian[p, 1], error[:, p, 1] @ target.jacobian[p, 2]]
            )
            assert others.std(axis=1) == pytest.approx(target.sigma[1:], rel=0.02)
            correlation = np.corrcoef([azimuths[:, 0], *others])
            np.testing.assert_allclose(correlation, np.eye(3), atol=4 / np.sqrt(trials))

    def test_seeds(self):
        target = passive_location(POSITIONS)
        np.testing.assert_array_equal(target.estimates(3), target.estimates(3))
        generator = np.random.default_rng(3)
        np.testing.assert_array_equal(target.estimates(generator), target.estimates(3))
        assert not np.array_equal(target.estimates(generator), target.estimates(3))
        with pytest.raises(TypeError, match="rng is 'x'"):
            target.estimates("x")

    @pytest.mark.parametrize(
        ("options", "error", "message"),
        [
            ({"position": [1.0, 2.0, 3.0]}, ValueError, r"position is \(3,\); .*\(..., 2\)"),
            ({"position": 1.0}, ValueError, r"position is \(\)"),
            ({"position": [np.nan, 1.0]}, ValueError, r"position\[0\] is nan"),
            ({"position": ["1", "2"]}, TypeError, "position has dtype"),
            ({"position": [40e3, 0.0]}, ValueError, r"position \[40000\. +0\.\] lies on the line"),
            ({"position": [[0, 4e4], [-15e3, 0]]}, ValueError, r"position \[-15000\. +0\.\] lies"),
            ({"stations": [1.0, 2.0]}, ValueError, r"stations is \(2,\); .*\(2, 2\)"),
            ({"stations": [[0, 0], [0, np.inf]]}, ValueError, r"stations\[1, 1\] is inf"),
            (
                {"stations": [[5.0, 5.0], [5.0, 5.0]]},
                ValueError,
                "lies on the line through the stations",
            ),
            ({"azimuth_sigma": 0.0}, ValueError, "azimuth_sigma is 0.0; it must be between"),
            ({"azimuth_sigma": "1"}, TypeError, "azimuth_sigma is '1'"),
            ({"range_difference_sigma": -1}, ValueError, "range_difference_sigma is -1"),
            ({"range_difference_sigma": np.nan}, ValueError, "range_difference_sigma is nan"),
        ],
    )
    def test_bad_parameters(self, options, error, message):
        with pytest.raises(error, match=message) as caught:
            passive_location(**{"position": [0.0, 40e3], **options})
        assert caught.type is error

    def test_a_position_too_far_to_be_squared(self):
        with pytest.raises(ValueError, match="position"):
            passive_location([1e200, 1e200])
