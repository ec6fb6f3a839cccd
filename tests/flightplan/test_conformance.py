"""Whether a track follows its plan."""

import numpy as np
import pytest
from checks import NAN
from flightplan.cases import WAY, tracked
from reference import flightplan as reference

from tertia.flightplan import (
    FlightPlan,
    conformance,
)


class TestConformance:
    def test_a_flight_by_the_plan(self):
        one = FlightPlan(WAY, 210.0)
        times = np.arange(0, one.times[-1], 6.0)
        rng = np.random.default_rng(6)
        position, velocity, covariance = tracked(
            one, times, rng, aside=250.0, position_sigma=60.0, velocity_sigma=3.0
        )
        found = conformance(one, times, position, velocity, covariance=covariance)
        assert found.conforms.all()
        assert found.cusum.max() < 4
        np.testing.assert_allclose(found.cross_track, 250.0, atol=400)
        expected = np.searchsorted(one.times[1:-1], times)
        assert np.abs(found.leg - expected).max() <= 1
        assert np.mean(found.leg == expected) > 0.9
        np.testing.assert_allclose(found.along_track, 210 * times, atol=400)
        assert 0.05 < np.mean(found.in_zone) < 0.7

    def test_levels_by_their_formula(self):
        one = FlightPlan([[0, 0], [3e5, 0]], 200.0)
        times = np.arange(12) * 10.0
        rng = np.random.default_rng(7)
        e, dc = rng.normal(0, 700, 12), rng.normal(0, 0.15, 12)
        position = np.column_stack([200 * times, e])
        velocity = 200 * np.column_stack([np.cos(dc), np.sin(dc)])
        found = conformance(one, times, position, velocity)
        level = 0.0
        for i in range(12):
            level = reference.level(level, e[i], dc[i])
            assert found.cusum[i] == pytest.approx(level, rel=1e-12)
            if level > 14:
                assert not found.conforms[i]
                break
        else:
            pytest.fail("it was never blocked")

    def test_a_shortcut_blocks_and_the_plan_is_found_again(self):
        one = FlightPlan(WAY, 210.0)
        # straight from the middle of the first leg to the middle of the third one
        times = np.arange(0, 1800, 10.0)
        direct = FlightPlan([[0, 0], [0, 3e4], [1.05e5, 7.5e4], *WAY[3:]], 210.0)
        position, velocity = direct.at(times)
        found = conformance(one, times, position, velocity)
        away = ~found.conforms & (times < direct.times[-2])
        assert found.conforms[:12].all()
        assert 119 < times[away][0] < 260
        again = times[away][-1]
        assert direct.times[2] < again < direct.times[2] + 120
        assert found.conforms[(times > again) & (times < direct.times[-1])].all()

    def test_gaps(self):
        one = FlightPlan(WAY, 210.0)
        times = np.arange(0, 600, 10.0)
        position, velocity = one.at(times)
        missing = np.arange(60) % 3 == 1
        times[missing] = NAN
        found = conformance(one, times, position, velocity)
        assert not found.conforms[missing].any()
        assert found.conforms[~missing].all()
        assert np.isnan(found.cross_track[missing]).all()
        assert (found.leg[missing] == -1).all()
