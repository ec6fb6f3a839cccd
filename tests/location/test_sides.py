"""Batches of targets on one side of stations near a plane, where mirror images look alike."""

import numpy as np
import pytest
from checks import in_region
from numpy.testing import assert_allclose, assert_array_equal

from tertia.location import Location, LocationStatus, locate
from tertia.sensors import Bias

LIGHT = 299_792_458.0


def anchors(step: float = 0.15) -> np.ndarray:
    """Six anchors of a room, a little below its ceiling."""
    plane = [[0, 0], [10, 1], [9, 8], [0, 7], [4, 8], [6, 0]]
    return np.column_stack([plane, 1.8 + step * np.array([0, 4, 1, 5, 2, 3])])


def ranges(places, targets, rng, *, noise=0.1):
    """Measured ranges with random errors."""
    distance = np.linalg.norm(targets[:, np.newaxis] - places, axis=-1)
    return np.abs(distance + noise * rng.standard_normal(distance.shape))


def tags(rng: np.random.Generator, count: int = 150) -> np.ndarray:
    """Positions of a tag about a metre below the anchors."""
    return rng.uniform([1, 1, 0.6], [9, 7, 1.3], (count, 3))


def located(fix: Location) -> float:
    return float(np.mean(np.asarray(fix.success)))


def below(fix: Location, places: np.ndarray) -> float:
    """The share of the located instants that is below the anchors."""
    return float(np.mean(fix.position[np.asarray(fix.success), 2] < places[:, 2].mean()))


@pytest.mark.filterwarnings("ignore:.*above and below the stations")
class TestOneSide:
    @pytest.mark.parametrize("seed", range(3))
    def test_a_batch_is_located_where_single_instants_are_ambiguous(self, seed):
        rng = np.random.default_rng([34, seed])
        places, targets = anchors(), tags(rng)
        measured = ranges(places, targets, rng)
        alone = locate(places, range=measured, range_sigma=0.1, bias=Bias())
        batch = locate(places, range=measured, range_sigma=0.1)
        assert np.mean(np.asarray(alone.status) == LocationStatus.AMBIGUOUS) > 0.3
        assert located(batch) > 0.9
        assert below(batch, places) > 0.97
        inside = np.asarray(batch.success)
        error = (batch.position - targets)[inside]
        assert np.mean(in_region(error, batch.covariance[inside])) > 0.9

    @pytest.mark.parametrize("sign", [1, -1])
    def test_lightning_and_earthquakes(self, sign):
        rng = np.random.default_rng([35, sign + 1])
        places = rng.uniform([-30e3, -30e3, 0], [30e3, 30e3, 300], (10, 3))
        targets = rng.uniform([-60e3, -60e3, 3e3], [60e3, 60e3, 12e3], (150, 3)) * [1, 1, sign]
        distance = np.linalg.norm(targets[:, np.newaxis] - places, axis=-1)
        times = distance / LIGHT + 50e-9 * rng.standard_normal(distance.shape)
        fix = locate(places, arrival_time=times, arrival_time_sigma=50e-9)
        assert located(fix) > 0.97
        assert np.all(sign * fix.position[np.asarray(fix.success), 2] > 0)

    def test_stations_along_a_line_of_the_plane(self):
        rng = np.random.default_rng(36)
        places = np.column_stack([np.linspace(-2000, 2000, 5), [0, 20, -15, 5, -10]])
        targets = rng.uniform([-3000, -3000], [3000, -300], (100, 2))
        measured = ranges(places, targets, rng, noise=10.0)
        alone = locate(places, range=measured, range_sigma=10.0, bias=Bias())
        batch = locate(places, range=measured, range_sigma=10.0)
        assert located(alone) < 0.8
        assert located(batch) > 0.97
        assert np.all(batch.position[np.asarray(batch.success), 1] < 0)


@pytest.mark.filterwarnings("ignore:.*above and below the stations")
class TestNoSide:
    def test_targets_on_both_sides(self):
        rng = np.random.default_rng(37)
        places = anchors()
        targets = tags(rng)
        over = rng.random(len(targets)) < 0.5
        targets[over, 2] = 4.4 - targets[over, 2]
        measured = ranges(places, targets, rng)
        alone = locate(places, range=measured, range_sigma=0.1, bias=Bias())
        batch = locate(places, range=measured, range_sigma=0.1)
        assert abs(located(batch) - located(alone)) < 0.1


@pytest.mark.filterwarnings("ignore:.*above and below the stations")
class TestInvariance:
    @pytest.fixture
    def scene(self):
        rng = np.random.default_rng(39)
        places = anchors()
        return places, ranges(places, tags(rng), rng)

    def test_order_of_instants_and_number_of_threads(self, scene):
        places, measured = scene
        order = np.random.default_rng(1).permutation(len(measured))
        first = locate(places, range=measured, range_sigma=0.1, n_threads=1)
        second = locate(places, range=measured[order], range_sigma=0.1, n_threads=1)
        third = locate(places, range=measured, range_sigma=0.1, n_threads=2)
        assert_array_equal(first.status, third.status)
        assert_array_equal(first.position, third.position)
        assert_array_equal(np.asarray(first.status)[order], second.status)
        assert_allclose(first.position[order], second.position, rtol=1e-6)

    def test_the_frame_does_not_matter(self, scene):
        places, measured = scene
        turn = np.array([[0.6, -0.8, 0.0], [0.48, 0.36, 0.8], [-0.64, -0.48, 0.6]])
        first = locate(places, range=measured, range_sigma=0.1)
        second = locate(places @ turn.T + 5e3, range=measured, range_sigma=0.1)
        assert_array_equal(first.status, second.status)
        assert_allclose(first.position @ turn.T + 5e3, second.position, rtol=0, atol=1e-5)

    def test_instants_are_independent_if_biases_are_stated(self, scene):
        places, measured = scene
        batch = locate(places, range=measured, range_sigma=0.1, bias=Bias())
        for start in range(0, len(measured), 50):
            part = measured[start : start + 50]
            some = locate(places, range=part, range_sigma=0.1, bias=Bias())
            assert_array_equal(some.status, np.asarray(batch.status)[start : start + 50])


class TestMirrorImages:
    def test_elevations_are_the_same_on_both_sides_of_two_stations(self):
        places = np.array([[-3587.1, 381.5, 347.4], [-2028.4, 4320.3, 23.2]])
        target = np.array([4992.5, -1592.3, 2321.6])
        offset = target - places
        distance = np.linalg.norm(offset, axis=1)
        with pytest.raises(ValueError, match="two positions"):
            locate(
                places,
                elevation=np.arcsin(offset[:, 2] / distance),
                elevation_sigma=0.003,
                arrival_time=distance / LIGHT,
                arrival_time_sigma=2e-8,
            )

    def test_a_batch_below_the_stations_is_warned_of(self):
        rng = np.random.default_rng(0)
        places = np.column_stack([rng.uniform(-40e3, 40e3, (10, 2)), rng.uniform(0, 200, 10)])
        sources = np.column_stack([rng.uniform(-15e3, 15e3, (20, 2)), -rng.uniform(4e3, 18e3, 20)])
        distance = np.linalg.norm(sources[:, np.newaxis] - places, axis=-1)
        times = distance / 6e3 + 0.05 * rng.standard_normal(distance.shape)
        given = {"arrival_time_sigma": 0.05, "propagation_speed": 6e3}
        with pytest.warns(UserWarning, match="above and below the stations"):
            locate(places, arrival_time=times, **given)
        locate(places, arrival_time=times, initial=[0, 0, -8e3], **given)
