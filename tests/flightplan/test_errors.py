"""Bad input."""

import numpy as np
import pytest
from checks import INF, NAN
from flightplan.cases import CORNERED, plan

from tertia.flightplan import (
    FlightPlan,
    conformance,
    correlate,
    estimate_times_over,
)


class TestBadInput:
    @pytest.mark.parametrize(
        ("arguments", "options", "message"),
        [
            (([[0, 0]], 200), {}, r"waypoints has shape \(1, 2\)"),
            (([0, 1, 2], 200), {}, r"waypoints has shape \(3,\)"),
            (([[0, 0, 0], [1, 1, 1]], 200), {}, r"waypoints has shape \(2, 3\)"),
            (([[0, 0], [1, NAN]], 200), {}, r"waypoints\[1, 1\] is nan"),
            (([[0, 0], [1, INF]], 200), {}, r"waypoints\[1, 1\] is inf"),
            (([[0, 0], [0, 2e9]], 200), {}, r"waypoints\[1, 1\] is 2000000000"),
            (([[0, 0], [5, 0], [5, 0]], 200), {}, r"waypoints\[2, 0\] is 5; a waypoint must not"),
            ((CORNERED, [200, 200, 200]), {}, r"speeds has shape \(3,\); it must be \(2,\)"),
            ((CORNERED, [200, 0]), {}, r"speeds\[1\] is 0.0"),
            ((CORNERED, [200, NAN]), {}, r"speeds\[1\] is nan"),
            ((CORNERED,), {}, "either speeds or times"),
            ((CORNERED, 200), {"times": [0, 1, 2]}, "either speeds or times"),
            ((CORNERED,), {"times": [0, 200]}, r"times has shape \(2,\)"),
            ((CORNERED,), {"times": [0, 200, 200]}, r"times\[2\] is 200"),
            ((CORNERED,), {"times": [0, NAN, 200]}, r"times\[1\] is nan"),
            ((CORNERED,), {"times": [0, 1e3, 2e3], "start_time": 0}, "start_time and times"),
            ((CORNERED, 200), {"start_time": NAN}, "start_time is nan"),
            ((CORNERED, 200), {"heights": [1, 2]}, r"heights has shape \(2,\)"),
            ((CORNERED, 200), {"heights": [1, 2, INF]}, r"heights\[2\] is inf"),
            ((CORNERED, 200), {"bank": 0}, "bank is 0.0; it must be between 0 and pi/2"),
            ((CORNERED, 200), {"bank": 25}, "bank is 25.0; it must be between 0 and pi/2"),
            ((CORNERED, 200), {"bank": 0.4, "turn_radius": 1e4}, "bank and turn_radius"),
            ((CORNERED, 200), {"turn_radius": -1}, "turn_radius is -1"),
            ((CORNERED, 200), {"turn_rate": 0}, "turn_rate is 0"),
            ((CORNERED, 200), {"identity": -4}, "identity is -4"),
        ],
    )
    def test_plans(self, arguments, options, message):
        with pytest.raises(ValueError, match=message):
            FlightPlan(*arguments, **options)

    def test_queries(self):
        with pytest.raises(ValueError, match="time is nan"):
            plan().at(NAN)
        with pytest.raises(ValueError, match=r"along_track\[1\] is inf"):
            plan().path([0, INF])
        with pytest.raises(ValueError, match=r"position has shape \(3,\)"):
            plan().project([0, 1, 2])
        with pytest.raises(ValueError, match=r"position\[0\] is nan"):
            plan().project([NAN, 1])

    def test_tracks(self):
        times, state = np.arange(5.0), np.ones((5, 2))
        with pytest.raises(ValueError, match="plans is empty"):
            correlate([], times, state, state)
        with pytest.raises(TypeError, match=r"plans is FlightPlan.*must be a sequence"):
            correlate(plan(), times, state, state)
        with pytest.raises(ValueError, match=r"velocity has shape \(4, 2\)"):
            correlate([plan()], times, state, state[:4])
        with pytest.raises(ValueError, match=r"position\[0, 1\] is inf"):
            correlate([plan()], times, [[0, INF], *[[0, 0]] * 4], state)
        with pytest.raises(ValueError, match=r"covariance has shape \(4, 4\)"):
            correlate([plan()], times, state, state, covariance=np.eye(4))
        with pytest.raises(ValueError, match=r"identity has shape \(3,\)"):
            correlate([plan()], times, state, state, identity=[1, 2, 3])
        with pytest.raises(TypeError, match="identity has dtype float64"):
            correlate([plan()], times, state, state, identity=1.5)
        with pytest.raises(ValueError, match=r"time must increase; 4.0 is followed by 3.0"):
            conformance(plan(), [0, 1, 4, 3, 5], state, state)
        with pytest.raises(ValueError, match=r"time has shape \(2, 5\)"):
            estimate_times_over(plan(), np.ones((2, 5)), np.ones((2, 5, 2)), np.ones((2, 5, 2)))
        with pytest.raises(ValueError, match="speed_change_sigma is -1"):
            estimate_times_over(plan(), times, state, state, speed_change_sigma=-1)
        with pytest.raises(ValueError, match="update_interval is 0"):
            conformance(plan(), times, state, state, update_interval=0)
