"""The speed of sound: stated with a sigma, or found to be wrong."""

import numpy as np
import pytest
from checks import in_region
from scipy import stats

from tertia.location import locate
from tertia.sensors import Bias, Station

SOUND, SIGMA, INSTANTS = 340.0, 1.0, 60


def shots(seed, *, error=0.0, bias=0.0, stations=6):
    """Return stations, positions and times of arrival; `error` is that of the speed.

    `bias` is the standard deviation of the constant errors of the stations, in sigmas.
    """
    rng = np.random.default_rng([3401, seed])
    turn = np.sort(rng.uniform(0.0, 2 * np.pi, stations))
    places = rng.uniform(400.0, 1000.0, (stations, 1)) * np.column_stack(
        [np.sin(turn), np.cos(turn)]
    )
    truth = rng.uniform(-500.0, 500.0, (INSTANTS, 2))
    far = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1) / (1.0 + error)
    far += SIGMA * (rng.standard_normal(far.shape) + bias * rng.standard_normal(stations))
    return places, truth, 10.0 * np.arange(INSTANTS)[:, np.newaxis] + far / SOUND


def located(places, arrival, **options):
    stations = [Station(place, arrival_time_sigma=SIGMA / SOUND) for place in places]
    return locate(stations, arrival_time=arrival, propagation_speed=SOUND, **options)


def inside(fix, truth):
    error = fix.position - truth
    return np.mean(in_region(error, fix.covariance))


def test_a_wrong_speed_is_found_without_a_sigma():
    held = []
    for seed, error in enumerate((0.015, -0.01, 0.02, -0.03)):
        places, truth, arrival = shots(seed, error=error)
        fix = located(places, arrival)
        share = (fix.propagation_speed / SOUND - 1.0 - error) * SOUND / fix.propagation_speed_sigma
        assert abs(share) < 4
        exact = located(places, arrival, propagation_speed_sigma=0)
        assert exact.propagation_speed is None
        assert np.sum((fix.position - truth) ** 2) < 0.3 * np.nansum((exact.position - truth) ** 2)
        held.append(inside(fix, truth))
    assert 0.9 < np.mean(held) < 0.99


@pytest.mark.parametrize("stations", [64, 65, 90])
def test_a_wrong_speed_is_found_by_many_stations(stations):
    places, truth, arrival = shots(9, error=0.01, stations=stations)
    fix = located(places, arrival)
    off = (fix.propagation_speed - 1.01 * SOUND) / fix.propagation_speed_sigma
    assert abs(off) < 4
    assert 0.85 < inside(fix, truth) <= 1.0


@pytest.mark.parametrize("bias", [0.0, 2.0])
def test_a_right_speed_stays_as_stated(bias):
    for seed in range(6):
        places, _, arrival = shots(seed, bias=bias)
        fix = located(places, arrival)
        assert fix.propagation_speed is None
        exact = located(places, arrival, propagation_speed_sigma=0)
        np.testing.assert_array_equal(fix.position, exact.position)
        np.testing.assert_array_equal(fix.covariance, exact.covariance)


def test_one_instant_and_light_say_nothing_about_the_speed():
    places, _, arrival = shots(0, error=0.03)
    assert located(places, arrival[0]).propagation_speed is None
    stations = [Station(place, arrival_time_sigma=SIGMA / 3e8) for place in places]
    fix = locate(stations, arrival_time=arrival * SOUND / 3e8)
    assert fix.propagation_speed is None
    assert located(places, arrival, method="least-squares").propagation_speed is None


def test_constant_errors_of_stations_are_not_taken_for_a_speed():
    squares, held = [], []
    for seed in range(12):
        places, truth, arrival = shots(seed, error=0.003, bias=2.0)
        fix = located(places, arrival, propagation_speed_sigma=0.01 * SOUND)
        off = fix.propagation_speed - 1.003 * SOUND
        squares.append((off / fix.propagation_speed_sigma) ** 2)
        held.append(inside(fix, truth))
    # without them in the model the mean square is 13
    assert stats.chi2.cdf(np.sum(squares), len(squares)) < 0.999
    assert np.mean(held) > 0.85


def test_independent_range_differences_have_the_effect_of_the_speed():
    """The covariance grows by the square of the change of the position with the speed."""
    places, truth, _ = shots(1)
    far = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1)
    differences = far[:, 1:] - far[:, :1]
    sigma, share = 4.0, 0.01

    def fix(values, relative):
        return locate(
            places,
            range_difference=values,
            range_difference_sigma=sigma,
            range_difference_correlation=0.0,
            propagation_speed=SOUND,
            propagation_speed_sigma=relative * SOUND,
            bias=Bias(),
        )

    known, unknown = fix(differences[:1], 0.0), fix(differences[:1], share)
    left = unknown.propagation_speed_sigma / SOUND
    step = 1e-4
    moved = [fix((1 + sign * step) * differences[:1], 0.0).position for sign in (-1, 1)]
    slope = (moved[1] - moved[0]) / (2 * step)
    effect = left**2 * slope[:, :, np.newaxis] * slope[:, np.newaxis, :]
    np.testing.assert_allclose(unknown.covariance - known.covariance, effect, rtol=1e-4)
