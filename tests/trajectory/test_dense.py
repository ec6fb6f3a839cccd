"""Trajectories from arrivals against one dense problem."""

import numpy as np
import pytest
from reference import arrivals as reference
from trajectory.nets import SPEED, net, solved

from tertia.trajectory import Arrivals


def test_the_solution_is_that_of_the_dense_problem() -> None:
    scene = net(2, k=6, emissions=25, heard=1.0)
    options = {"path_sigma": 3e-4, "clock_drift": 1e-8, "jerk": 1e-7}
    known = Arrivals(
        scene.arrivals.time, scene.arrivals.sensor, scene.arrivals.identity, scene.emission
    )
    scene.arrivals = known
    track = solved(scene, **options)
    order = np.argsort(scene.time)
    rank = np.argsort(order)
    problem = reference.Problem(
        reference.Scene(
            sites=np.array([station.position for station in scene.stations]),
            site_sigma=np.array([station.position_sigma for station in scene.stations]),
            time=known.time,
            sensor=known.sensor,
            emission=rank[scene.emission],
            beacon=np.array([scene.beacons.get(int(i), -1) for i in scene.identity])[order],
            node=track.bias.node,
            speed=SPEED,
            speed_sigma=3.0,
            receivers=6,
            path_sigma=options["path_sigma"],
            clock_drift=options["clock_drift"],
            jerk=options["jerk"],
        ),
        scene.time[order],
        scene.source[order],
        scene.clock.mean(axis=0),
    )
    x, covariance, sigma = problem.solve()
    motion = slice(problem.at[1], problem.at[2])
    mean = x[motion].reshape(-1, 3, 2)
    found = np.stack([track.position, track.velocity, track.acceleration], axis=1)
    spread = np.sqrt(np.diag(covariance)[motion]).reshape(mean.shape)
    assert np.max(np.abs(found - mean) / spread) < 0.02
    for i in range(len(mean)):
        own = slice(motion.start + 6 * i, motion.start + 6 * i + 6)
        assert track.covariance[i] == pytest.approx(
            covariance[own, own], rel=0.01, abs=0.01 * np.min(np.diag(covariance[own, own]))
        )
    assert track.arrival_time_sigma * SPEED == pytest.approx(sigma, rel=2e-3)
    slowness = problem.at[3]
    assert track.propagation_speed == pytest.approx(SPEED / x[slowness], rel=1e-6)
    assert track.propagation_speed_sigma == pytest.approx(
        SPEED * np.sqrt(covariance[slowness, slowness]), rel=0.02
    )
