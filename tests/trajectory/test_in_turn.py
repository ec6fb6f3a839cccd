"""Paths of stations that measure in turn: no instant has enough measurements for a position."""

import numpy as np
import pytest
from scipy import stats

from tertia.sensors import Bias, Station
from tertia.trajectory import reconstruct

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

TIMES = np.arange(60.0)
SIGMA = {"range": 5.0, "azimuth": 0.01, "elevation": 0.01}


def turning(rng, rate, size):
    """Return a path that turns at a constant rate, level if there are three coordinates."""
    heading = rng.uniform(0.0, 2 * np.pi) + rng.choice([-1, 1]) * rate * TIMES
    speed = rng.uniform(10.0, 40.0)
    level = speed * np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    level += rng.normal(size=2) * 1e3
    return np.column_stack([level, np.full((TIMES.size, size - 2), 500.0)])


def measured(seed, size, kinds, rate, share):
    """Return stations, measurements of one station at each instant, and the path."""
    rng = np.random.default_rng([71, seed])
    places = rng.normal(size=(5, size)) * 1e3
    places[:, 2:] = 0.3 * np.abs(places[:, 2:])
    truth = turning(rng, rate, size)
    offset = truth[:, np.newaxis] - places
    ideal = {
        "range": np.linalg.norm(offset, axis=-1),
        "azimuth": np.arctan2(offset[..., 0], offset[..., 1]),
        "elevation": np.arctan2(offset[..., -1], np.linalg.norm(offset[..., :2], axis=-1)),
    }
    silent = np.arange(5) != np.arange(TIMES.size)[:, np.newaxis] % 5
    values = {}
    for kind in kinds:
        own = ideal[kind] + rng.normal(size=silent.shape) * SIGMA[kind]
        own[rng.random(silent.shape) < share] += 100.0 * SIGMA[kind]
        if kind == "elevation":
            own = np.clip(own, -np.pi / 2, np.pi / 2)
        values[kind] = np.where(silent, np.nan, own)
    sigmas = {f"{kind}_sigma": SIGMA[kind] for kind in kinds}
    return [Station(place, **sigmas) for place in places], values, truth


def inside(found, truth):
    """Return the share of the positions in their 95 % regions."""
    size = truth.shape[1]
    error = (found.position - truth)[..., np.newaxis]
    solved = np.linalg.solve(found.covariance[:, :size, :size], error)
    return np.mean(np.sum(error * solved, axis=(1, 2)) < stats.chi2.isf(0.05, size))


@pytest.mark.parametrize(
    ("seed", "size", "rate", "share"),
    [
        (19, 2, 0.02, 0.0),
        (19, 2, 0.2, 0.0),
        (8, 3, 0.05, 0.0),
        (16, 2, 0.0, 0.1),
        (19, 2, 0.0, 0.1),
    ],
)
def test_a_path_far_from_the_target_is_not_bent_into_agreement(seed, size, rate, share):
    """The first path is wrong, and a motion that is estimated about it is too agile."""
    stations, values, truth = measured(seed, size, ["range"], rate, share)
    found = reconstruct(stations, TIMES, **values, bias=Bias())
    error = np.linalg.norm(found.position - truth, axis=1)
    assert np.median(error) < 30.0
    assert inside(found, truth) > 0.8


def test_a_path_on_the_wrong_side_that_has_only_a_few_instants():
    """Above the stations, there are only a few of the instants of a path below them."""
    stations, values, truth = measured(25, 3, ["range"], 0.02, 0.1)
    found = reconstruct(stations, TIMES, **values)
    assert np.median(np.linalg.norm(found.position - truth, axis=1)) < 60.0
    assert inside(found, truth) > 0.8


def test_a_path_that_left_out_nearly_all_measurements_is_refused():
    stations, values, _ = measured(3, 3, ["range"], 0.02, 0.3)
    with pytest.raises(ValueError, match="no path was found that agrees with the measurements"):
        reconstruct(stations, time=TIMES, **values)
