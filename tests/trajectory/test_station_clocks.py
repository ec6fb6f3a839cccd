"""Clocks of stations are taken out, estimated with the path, or refused."""

import warnings

import numpy as np
import pytest
from checks import in_region

from tertia.sensors import Bias, Station
from tertia.trajectory import reconstruct

TIME = 0.5 * np.arange(120)
PLACES = np.array([[-900.0, -800.0], [1000.0, -900.0], [900.0, 1100.0], [-1000.0, 900.0]])
SIGMAS = {"range": 3.0, "azimuth": 3e-3}


def way(time):
    """Return a path that turns, at 30 to 50 m/s."""
    turn = 0.15 * time
    return np.stack([25 * time - 750 + 150 * np.sin(turn), 150 * np.cos(turn)], axis=-1)


def measured(clocks, rng, noise=1.0):
    """Return ranges and azimuths of stations whose clocks are fast by this."""
    offset = np.stack(
        [way(TIME - clock) - place for clock, place in zip(clocks, PLACES, strict=True)], axis=1
    )
    values = {
        "range": np.linalg.norm(offset, axis=-1),
        "azimuth": np.arctan2(offset[..., 0], offset[..., 1]),
    }
    random = np.random.default_rng(rng)
    return {
        kind: value + noise * SIGMAS[kind] * random.standard_normal(value.shape)
        for kind, value in values.items()
    }


def stations(biases):
    sigmas = {f"{kind}_sigma": sigma for kind, sigma in SIGMAS.items()}
    return [Station(p, **sigmas, bias=b) for p, b in zip(PLACES, biases, strict=True)]


def inside(track):
    return np.mean(in_region(track.position - way(TIME), track.covariance[:, :2, :2]))


@pytest.mark.parametrize("clock", [0.2, 0.75, 3.0])
def test_known_clocks_are_taken_out(clock):
    clocks = clock * np.array([1.0, -0.6, 0.3, 0.0])
    seen = measured(clocks, 11)
    track = reconstruct(stations([Bias(time=one) for one in clocks]), TIME, **seen)
    right = reconstruct(stations([Bias()] * 4), TIME, **measured(np.zeros(4), 11))
    size = np.median(right.sigma)
    # the clocks leave the ends of the record to fewer stations
    assert np.sqrt(np.mean((track.position - way(TIME))[10:-10] ** 2)) < 1.5 * size
    assert inside(track) > 0.85
    np.testing.assert_array_equal(track.bias.time, clocks)
    np.testing.assert_array_equal(track.bias.time_sigma, 0.0)


@pytest.mark.parametrize("clock", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("kinds", [("range",), ("azimuth",), ("range", "azimuth")])
@pytest.mark.parametrize("unknown", [False, True])
def test_unknown_clocks_are_estimated(clock, kinds, unknown):
    squares, shares = [], []
    other = {f"{kind}_sigma": None for kind in kinds} if unknown else {}
    for seed in range(3):
        clocks = clock * np.append(0.0, np.random.default_rng([5, seed]).standard_normal(3))
        seen = {kind: measured(clocks, seed)[kind] for kind in kinds}
        biases = [Bias(time_sigma=clock if at else 0.0, **other) for at in range(4)]
        track = reconstruct(stations(biases), TIME, **seen)
        squares.append((track.bias.time[1:] - clocks[1:]) / track.bias.time_sigma[1:])
        shares.append(inside(track))
        assert track.bias.time[0] == track.bias.time_sigma[0] == 0.0
        assert np.all(track.bias.time_sigma < 0.5 * clock)
    assert np.mean(np.square(squares)) < 3.0
    assert np.mean(shares) > 0.85


def test_a_common_error_of_all_clocks_is_in_the_covariance():
    seen = measured(np.zeros(4), 3)
    track = reconstruct(stations([Bias(time_sigma=1.0)] * 4), TIME, **seen)
    np.testing.assert_allclose(track.bias.time_sigma, 0.5, rtol=0.02)
    speed = np.linalg.norm(track.velocity, axis=1)
    along = np.einsum("ni,nij,nj->n", track.velocity, track.covariance[:, :2, :2], track.velocity)
    fast = speed > 20.0
    assert np.count_nonzero(fast) > 60
    np.testing.assert_allclose((np.sqrt(along) / speed**2)[fast], 0.5, rtol=0.1)


def test_outliers_and_residuals_stay_with_their_measurements():
    clocks = np.array([0.0, 1.3, -0.9, 0.4])
    seen = measured(clocks, 4)
    seen["range"][40, 1] += 300.0
    seen["range"][70, 2] = np.nan
    track = reconstruct(stations([Bias(time=one) for one in clocks]), TIME, **seen)
    assert np.argwhere(track.outlier.range).tolist() == [[40, 1]]
    assert np.argwhere(np.isnan(track.residual.range)).tolist() == [[70, 2]]
    assert abs(track.residual.range[40, 1] - 100.0) < 5.0


def test_clocks_that_are_right_change_nothing():
    seen = measured(np.zeros(4), 5)
    plain = reconstruct(stations([Bias()] * 4), TIME, **seen)
    stated = reconstruct(stations([Bias(time=0.0, time_sigma=0.0)] * 4), TIME, **seen)
    np.testing.assert_array_equal(plain.position, stated.position)
    np.testing.assert_array_equal(plain.covariance, stated.covariance)


@pytest.mark.parametrize("bias", [Bias(time=0.5), Bias(time_sigma=0.5)])
def test_clocks_are_not_ignored(bias):
    seen = measured(np.zeros(4), 6)
    name = r"bias.time_sigma" if np.any(bias.time_sigma) else r"bias.time is"
    own = stations([bias] * 4)
    differences = seen["range"][:, 1:] - seen["range"][:, :1]
    with pytest.raises(ValueError, match=f"{name}.*range differences"):
        reconstruct(own, TIME, range_difference=differences, range_difference_sigma=[3.0] * 3)
    for option in ({"order": "temporal-first"}, {"smoother": "local-polynomial"}):
        with pytest.raises(ValueError, match="bias"):
            reconstruct(own, TIME, **seen, **option)
    card = Bias(time=bias.time, time_sigma=bias.time_sigma, deviation_order=1, deviation_sigma=0.01)
    with pytest.raises(ValueError, match="deviates"):
        reconstruct(stations([card] * 4), TIME, **seen)


@pytest.mark.parametrize("share", [0.05, 0.25])
def test_clocks_that_are_not_found_are_told(share):
    seen = measured(np.zeros(4), 7)
    wrong = np.random.default_rng(8).random(seen["range"].shape) < share
    seen["range"] = seen["range"] + np.where(wrong, 500.0, 0.0)
    biases = [Bias(time_sigma=0.5 if at else 0.0) for at in range(4)]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        reconstruct(stations(biases), TIME, **seen)
    said = [str(one.message) for one in caught if "errors of the clocks" in str(one.message)]
    assert len(said) == int(share > 0.2)
