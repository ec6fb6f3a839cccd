"""Flight plans: vectors, formulas, identification, passing times, bad input."""

import json
import pickle

import numpy as np
import pytest
from pyproj import Geod
from reference import flightplan as reference
from scipy import stats
from tolerances import CHANCE, PARITY

from tertia.flightplan import (
    CorrelationStatus,
    FlightPlan,
    conformance,
    correlate,
    estimate_times_over,
)
from tertia.io import read_plans

NAN, INF = float("nan"), float("inf")
# 60° to the right at (0, 50 km), coming north
OUTBOUND = np.array([np.sin(np.pi / 3), np.cos(np.pi / 3)])
CORNERED = [[0, 0], [0, 50_000], [0, 50_000] + 60_000 * OUTBOUND]
START = 43889.2922909226
WAY = np.array([[0, 0], [0, 6e4], [5e4, 9e4], [1.6e5, 6e4], [1.6e5, 0], [9e4, -2e4]])


def plan(speed=220.0, **options):
    return FlightPlan(CORNERED, speed, **options)


class TestTurns:
    def test_vector(self):
        turns = plan().turns
        assert turns.radius[0] == pytest.approx(10584.0562223249, abs=1e-9)
        assert np.degrees(220 / turns.radius[0]) == pytest.approx(1.1909490301, abs=1e-10)
        assert turns.angle[0] == pytest.approx(np.pi / 3, abs=1e-15)
        assert turns.lead[0] == pytest.approx(6110.7077090774, abs=1e-9)
        assert turns.arc[0] == pytest.approx(11083.5977577458, abs=1e-9)
        assert turns.arc[0] / 220 == pytest.approx(50.3799898079, abs=1e-10)
        np.testing.assert_allclose(turns.start, [[0, START]], rtol=0, atol=1e-9)
        expected = [[5292.0281111625, 53055.3538545387]]
        np.testing.assert_allclose(turns.end, expected, rtol=0, atol=1e-9)
        assert plan(80.0).turns.radius[0] == pytest.approx(1527.8874536822, abs=1e-9)

    @pytest.mark.parametrize(
        ("s", "position", "course"),
        [
            (3000, (422.3288812817, 46849.2827577366), 16.2402140473),
            (8000, (2882.1854055266, 51149.0052355702), 43.3072374595),
            (13000, (6951.6811368241, 54013.5549756658), 60.0),
        ],
    )
    def test_vector_of_the_path(self, s, position, course):
        found, bearing = plan().path(START + s)
        np.testing.assert_allclose(found, position, rtol=0, atol=1e-9)
        assert np.degrees(bearing) == pytest.approx(course, abs=1e-10)

    @pytest.mark.parametrize(
        ("position", "s", "offset"),
        [
            ((500, 46000), 2183.8354898468, 281.4702882903),
            ((2500, 49500), 6421.5466595637, 743.7307194561),
        ],
    )
    def test_vector_of_the_projection(self, position, s, offset):
        found = plan().project(position)
        assert found.along_track - START == pytest.approx(s, abs=1e-9)
        # inside of a turn to the right
        assert found.cross_track == pytest.approx(offset, abs=1e-9)

    @pytest.mark.parametrize("degrees", [-140, -60, -5, 3, 30, 90, 120])
    @pytest.mark.parametrize("speed", [60.0, 150.0, 250.0])
    def test_parity(self, degrees, speed):
        angle = np.radians(degrees)
        corner = np.array([2e4, 5e4])
        u1 = reference.unit(corner)
        u2 = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ u1
        points = [np.zeros(2), corner, corner + 8e4 * u2]
        expected = reference.turn(*points, speed)
        one = FlightPlan(points, speed)
        turns = one.turns
        assert turns.angle[0] == pytest.approx(-expected["th"], abs=1e-12)
        for key in ("radius", "lead", "arc"):
            assert getattr(turns, key)[0] == pytest.approx(expected[key], rel=PARITY)
        for key in ("start", "end", "centre"):
            np.testing.assert_allclose(getattr(turns, key)[0], expected[key], rtol=0, atol=1e-6)
        begin = np.hypot(*expected["start"])
        for s in np.linspace(-9e3, expected["arc"] + 9e3, 41):
            position, bearing = one.path(begin + s)
            place, course = reference.at(expected, s)
            np.testing.assert_allclose(position, place, rtol=0, atol=1e-6)
            assert np.abs(np.angle(np.exp(1j * (bearing - np.pi / 2 + course)))) < 1e-9
        near = np.random.default_rng(1).normal(size=(200, 2)) * 3000 + expected["start"]
        found = one.project(near)
        for p, distance, offset in zip(near, found.along_track, found.cross_track, strict=True):
            s, e = reference.project(expected, p)
            # the nearest point of all is not farther than that of the rule by the bisector
            assert abs(offset) <= e + 1e-6
            if abs(abs(offset) - e) < 1e-6:
                assert distance - begin == pytest.approx(s, abs=1e-5)

    def test_passing_times(self):
        times = FlightPlan(WAY, 210.0, start_time=50.0).times
        expected = 50 + reference.passing_times(WAY, 210.0)
        np.testing.assert_allclose(times, expected, rtol=PARITY)

    def test_waypoints_are_passed_in_the_middle_of_their_arcs(self):
        one = FlightPlan(WAY, [200, 210, 190, 230, 180.0], start_time=1e4)
        position, _ = one.at(one.times)
        turns = one.turns
        to_waypoint = WAY[1:-1] - turns.centre
        to_waypoint /= np.linalg.norm(to_waypoint, axis=1, keepdims=True)
        middle = turns.centre + turns.radius[:, np.newaxis] * to_waypoint
        np.testing.assert_allclose(position[1:-1], middle, rtol=0, atol=1e-6)
        np.testing.assert_allclose(position[[0, -1]], WAY[[0, -1]], rtol=0, atol=1e-6)
        assert one.length == pytest.approx(one.distances[-1], rel=1e-15)
        np.testing.assert_allclose(np.diff(one.distances) / np.diff(one.times), one.speeds)

    def test_velocities_are_derivatives(self):
        one = FlightPlan(WAY, 210.0)
        times = np.linspace(-50, one.times[-1] + 50, 400)
        difference = (one.at(times + 0.01)[0] - one.at(times - 0.01)[0]) / 0.02
        np.testing.assert_allclose(one.at(times)[1], difference, rtol=0, atol=0.02)

    def test_given_times_are_kept(self):
        times = [100.0, 420.0, 650.0, 1200.0, 1500.0, 1900.0]
        one = FlightPlan(WAY, times=times)
        np.testing.assert_allclose(one.times, times, rtol=0, atol=1e-6)
        assert one.start_time == 100.0

    def test_turn_radius(self):
        one = FlightPlan(WAY, [200, 180, 190, 150, 180.0], turn_radius=5000.0)
        assert one.turns.radius.max() == pytest.approx(5000.0, rel=1e-12)
        assert one.turns.radius[0] == pytest.approx(5000.0, rel=1e-12)
        small = FlightPlan(WAY, 200.0, turn_radius=900.0)
        np.testing.assert_allclose(small.turns.radius, 900.0, rtol=1e-12)
        timed = FlightPlan(WAY, times=[0, 300, 600, 1100, 1400, 1800], turn_radius=5000.0)
        assert timed.turns.radius.max() == pytest.approx(5000.0, rel=1e-6)
        np.testing.assert_allclose(timed.times, [0, 300, 600, 1100, 1400, 1800], atol=1e-6)

    def test_heights(self):
        one = FlightPlan(WAY, 200.0, heights=np.arange(6) * 1000.0)
        np.testing.assert_allclose(one.height(one.times), one.heights, atol=1e-9)
        assert one.height(one.times[:2].mean()) == pytest.approx(500.0)
        assert one.height(-100.0) == 0.0
        assert np.isnan(plan().height(3.0))

    def test_shapes(self):
        one = plan()
        position, velocity = one.at(5.0)
        assert position.shape == velocity.shape == (2,)
        position, velocity = one.at(np.zeros((3, 4)))
        assert position.shape == velocity.shape == (3, 4, 2)
        assert isinstance(one.path(3.0)[1], float)
        found = one.project(np.zeros((3, 4, 2)))
        assert found.along_track.shape == found.cross_track.shape == found.course.shape == (3, 4)
        assert isinstance(one.project([0, 1]).leg, int)
        assert one.at(np.zeros(0))[0].shape == (0, 2)

    def test_it_can_be_sent_to_another_process(self):
        again = pickle.loads(pickle.dumps(plan(identity=7)))
        assert again.length == plan().length
        assert again.identity == 7


class TestHardRoutes:
    @pytest.mark.parametrize("degrees", [150.0, 165.0, 179.9, 180.0, -180.0, -179.0])
    def test_hairpins(self, degrees):
        angle = np.radians(degrees)
        after = np.array([0, 5e4]) + 4e4 * np.array([np.sin(angle), np.cos(angle)])
        one = FlightPlan([[0, 0], [0, 5e4], after], 220.0)
        turns = one.turns
        lead = 10584.0562223249 * np.tan(np.radians(75))
        assert turns.lead[0] == pytest.approx(min(lead, 4e4), rel=1e-9)
        times = np.linspace(-100, one.times[-1] + 100, 3000)
        position, velocity = one.at(times)
        assert np.isfinite(position).all()
        assert np.isfinite(velocity).all()
        step = np.linalg.norm(np.diff(position, axis=0), axis=1)
        assert step.max() <= 220 * (times[1] - times[0]) * (1 + 1e-9)
        np.testing.assert_allclose(one.project(position).cross_track, 0, atol=1e-6)

    def test_neighbouring_turns_share_a_short_leg(self):
        one = FlightPlan([[0, 0], [0, 4e4], [1e4, 4e4], [1e4, 8e4]], 250.0)
        np.testing.assert_allclose(one.turns.lead, 5000.0, rtol=1e-12)
        np.testing.assert_allclose(one.turns.radius, 5000.0, rtol=1e-12)

    def test_random_routes_are_continuous(self):
        rng = np.random.default_rng(3)
        for _ in range(50):
            scale = 10 ** rng.uniform(0, 6)
            count = rng.integers(2, 12)
            one = FlightPlan(rng.normal(size=(count, 2)) * scale, rng.uniform(50, 300, count - 1))
            distances = np.linspace(-0.1 * scale, one.length + 0.1 * scale, 500)
            position, _ = one.path(distances)
            step = np.linalg.norm(np.diff(position, axis=0), axis=1)
            assert np.all(step <= np.diff(distances) * (1 + 1e-9) + 1e-9)
            np.testing.assert_allclose(one.project(position).cross_track, 0, atol=1e-8 * scale)
            assert np.all(np.diff(one.times) >= 0)


def tracked(one, times, rng, *, aside=0.0, position_sigma=0.0, velocity_sigma=0.0):
    """A track of a flight that follows a plan, and its covariance."""
    position, velocity = one.at(times)
    speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
    right = np.stack([velocity[..., 1], -velocity[..., 0]], axis=-1) / speed
    noise = rng.normal(size=(2, *position.shape))
    covariance = np.diag([position_sigma**2] * 2 + [velocity_sigma**2] * 2)
    return (
        position + aside * right + position_sigma * noise[0],
        velocity + velocity_sigma * noise[1],
        np.broadcast_to(covariance, (*position.shape[:-1], 4, 4)),
    )


class TestCorrelation:
    def test_the_score_by_its_formula(self):
        rng = np.random.default_rng(4)
        one = FlightPlan([[0, 0], [3e5, 0]], 220.0, heights=9000.0)
        times = np.array([400.0])
        position = np.array([[9e4, -800.0]])
        velocity = 215 * np.array([[np.cos(0.05), np.sin(0.05)]])
        root = rng.normal(size=(4, 4)) * [[100], [100], [3], [3]]
        covariance = (root @ root.T)[np.newaxis]
        found = correlate([one], times, position, velocity, covariance=covariance, height=[9100.0])
        u, n = velocity[0] / 215, np.array([-velocity[0, 1], velocity[0, 0]]) / 215
        expected = reference.score(
            800.0, 0.05, 5.0, 400 - 9e4 / 220, 100.0,
            p=n @ covariance[0, :2, :2] @ n,
            psi_variance=n @ covariance[0, 2:, 2:] @ n / 215**2,
            v_variance=u @ covariance[0, 2:, 2:] @ u,
        )  # fmt: skip
        assert found.scores[0] == pytest.approx(expected, rel=1e-9)
        without = correlate([one], times, position, velocity).scores[0]
        expected = reference.score(800.0, 0.05, 5.0, 400 - 9e4 / 220)
        assert without == pytest.approx(expected, rel=1e-9)

    def test_the_mean_over_plots_without_gaps(self):
        one = plan()
        times = np.array([10.0, 20.0, NAN, 40.0, 50.0, 60.0])
        position, velocity = one.at(np.arange(10.0, 70.0, 10.0))
        position[0, 0] += 700.0
        found = correlate([one], times, position, velocity)
        assert found.scores[0] == pytest.approx(-0.5 / 5, rel=1e-9)
        assert (found.plan, found.status) == (0, CorrelationStatus.ACCEPTED)
        short = correlate([one], times[:4], position[:4], velocity[:4])
        assert (short.plan, short.status) == (-1, CorrelationStatus.AMBIGUOUS)
        nothing = correlate([one], times[2:3], position[2:3], velocity[2:3])
        assert np.isnan(nothing.scores[0])
        assert nothing.status == CorrelationStatus.NONE

    def test_identity(self):
        plans = [plan(identity=5), plan(identity=6), plan()]
        times = np.arange(10.0, 70.0, 10.0)
        position, velocity = plans[0].at(times)

        def decided(identity, moved=0.0):
            found = correlate(plans, times, position + moved, velocity, identity=identity)
            return found.plan, found.status

        assert decided(6) == (1, CorrelationStatus.LINKED)
        # an identity that no plan has is none
        assert decided(-1) == decided(8) == (-1, CorrelationStatus.AMBIGUOUS)
        assert decided(6, 3000.0) == (1, CorrelationStatus.LINKED)
        assert decided(6, 6000.0) == (-1, CorrelationStatus.NONE)

    @pytest.mark.parametrize("n_threads", [1, 3])
    def test_batches(self, n_threads):
        plans = [FlightPlan([[0, y], [9e4, y]], 200.0) for y in (0, 2e4, 4e4)]
        times = np.arange(100.0, 150.0, 10.0)
        order = np.array([[0, 2], [1, 1], [2, 0]])
        states = [np.stack([plans[k].at(times)[i] for k in order.flat]) for i in (0, 1)]
        states = [state.reshape(3, 2, 5, 2) for state in states]
        instants = np.broadcast_to(times, (3, 2, 5))
        found = correlate(plans, instants, *states, n_threads=n_threads)
        np.testing.assert_array_equal(found.plan, order)
        assert found.scores.shape == (3, 2, 3)
        assert repr(found) == "Correlation(0 none, 0 ambiguous, 6 accepted, 0 linked)"

    @pytest.mark.parametrize(
        ("live", "known", "least", "wrong"),
        [
            (20, True, 0.94, 0.004),
            (40, True, 0.88, 0.004),
            (80, True, 0.80, 0.004),
            (20, False, 0.70, 0.008),
            (40, False, 0.50, 0.008),
            (80, False, 0.25, 0.008),
        ],
    )
    def test_identification(self, live, known, least, wrong):
        """Ten shared routes, five scans; those that are not identified are ambiguous."""
        correct = mistaken = total = 0
        for trial in range(1600 // live):
            plans, states = shared_routes(live, np.random.default_rng([5, live, trial]))
            heights = states.pop("height")
            found = correlate(plans, **states, height=heights if known else None)
            correct += np.count_nonzero(found.plan == np.arange(live))
            mistaken += np.count_nonzero((found.plan >= 0) & (found.plan != np.arange(live)))
            total += live
        assert correct / total > least
        assert mistaken / total <= wrong


def shared_routes(live, rng, scan=10.0):
    """Plans on ten routes of 700 km, and five scans of every flight, somewhere on its way."""
    routes = []
    for _ in range(10):
        course, start = rng.uniform(0, 2 * np.pi), rng.uniform(-2e5, 2e5, 2)
        courses = course + np.cumsum(rng.uniform(-0.5, 0.5, 7))
        legs = 1e5 * np.stack([np.sin(courses), np.cos(courses)], axis=-1)
        routes.append(start + np.concatenate([[[0, 0]], np.cumsum(legs, axis=0)]))
    plans, tracks = [], []
    now = scan * np.arange(5)
    for k in range(live):
        route, speed = routes[rng.integers(10)], rng.normal(220.0, 12.0)
        height = 300.0 * rng.integers(29, 42)
        flown = rng.uniform(0.05, 0.95) * 7e5 / speed
        one = FlightPlan(route, speed, start_time=-flown, heights=height, name=f"{k}")
        plans.append(one)
        # late or early by half a minute, 5 m/s off the plan
        late = rng.normal(0, 30.0)
        true = speed + rng.normal(0, 5.0)
        actual = FlightPlan(route, true, start_time=-(flown - late) * speed / true)
        position, velocity, covariance = tracked(
            actual, now, rng, aside=rng.normal(0, 300.0), position_sigma=100.0, velocity_sigma=4.0
        )
        tracks.append((now, position, velocity, covariance, height + rng.normal(0, 15.0, 5)))
    keys = ("time", "position", "velocity", "covariance", "height")
    return plans, dict(zip(keys, map(np.stack, zip(*tracks, strict=True)), strict=True))


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


def flights(count, rng, wind=30.0, step=6.0):
    """Plans, and flights that follow them with other banks and speeds, in a wind.

    Airspeeds are off by a process of 10 m/s that forgets in five minutes. Times, distances along
    the path that is flown, and the route of that path.
    """
    kept = np.exp(-step / 300.0)
    for _ in range(count):
        courses = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.uniform(-1.2, 1.2, 6))
        legs = rng.uniform(4e4, 8e4, (6, 1)) * np.stack([np.sin(courses), np.cos(courses)], -1)
        waypoints = np.concatenate([[[0, 0]], np.cumsum(legs, axis=0)])
        planned = rng.uniform(200, 230)
        flown = FlightPlan(waypoints, planned, bank=np.radians(rng.normal(23, 2.2)))
        blowing = rng.uniform(0, wind) * reference.unit(rng.normal(size=2))
        off, distance, distances, speeds = rng.normal(0, 10.0), 0.0, [], []
        while distance < flown.length:
            _, bearing = flown.path(distance)
            u = np.array([np.sin(bearing), np.cos(bearing)])
            across = reference.cross(blowing, u)
            speed = np.sqrt((planned + off) ** 2 - across**2) + u @ blowing
            distances.append(distance)
            speeds.append(speed)
            distance += speed * step
            off = kept * off + np.sqrt(1 - kept**2) * rng.normal(0, 10.0)
        times = step * np.arange(len(speeds))
        yield FlightPlan(waypoints, planned), flown, times, np.array(distances), np.array(speeds)


def ahead(flight, rng, before):
    """Errors at each waypoint so long before it is passed: refined, their sigmas, the plan's."""
    one, flown, times, distances, speeds = flight
    position, bearing = flown.path(distances)
    u = np.stack([np.sin(bearing), np.cos(bearing)], axis=-1)
    right = np.stack([u[:, 1], -u[:, 0]], axis=-1)
    position = position + rng.normal(0, 200.0) * right + rng.normal(0, 75.0, position.shape)
    velocity = speeds[:, np.newaxis] * u + rng.normal(0, 4.0, u.shape)
    covariance = np.tile(np.diag([75.0**2, 75**2, 16, 16]), (len(times), 1, 1))
    found = estimate_times_over(one, times, position, velocity, covariance=covariance)
    follows = conformance(one, times, position, velocity, covariance=covariance)
    passed = np.interp(flown.distances, distances, times)
    for waypoint in range(1, len(one.waypoints) - 1):
        at = np.searchsorted(times, passed[waypoint] - before)
        # after a minute on the way, while the plan is followed
        if times[at] > 60 and follows.conforms[at]:
            here = np.interp(follows.along_track[at], one.distances, one.times)
            alone = times[at] + one.times[waypoint] - here
            true = passed[waypoint]
            yield found.time[at, waypoint] - true, found.sigma[at, waypoint], alone - true


class TestTimesOver:
    @pytest.mark.parametrize(("before", "rms"), [(120.0, 4.7), (300.0, 22.0)])
    def test_refined_times(self, before, rms):
        rng = np.random.default_rng(8)
        rows = np.array([row for flight in flights(100, rng) for row in ahead(flight, rng, before)])
        refined, sigma, alone = rows.T
        assert len(rows) > 250
        assert np.sqrt(np.mean(refined**2)) < rms
        assert np.sqrt(np.mean(alone**2)) > 1.5 * np.sqrt(np.mean(refined**2))
        # wind is the same for a whole flight, so errors of a flight are not independent
        assert 0.5 < np.sqrt(np.mean((refined / sigma) ** 2)) < 1.15

    def test_sigma_where_the_speed_wanders_as_assumed(self):
        """A random walk of the ground speed by 4 % a minute."""
        rng = np.random.default_rng(9)
        one = FlightPlan([[0, 0], [60e3, 0], [120e3, 0]], 200.0)
        step, scores = 2.0, []
        steps = 0.04 * np.sqrt(step / 60) * rng.normal(size=(400, 500))
        steps[:, :60] = 0  # constant for as long as the mean looks back
        for walk in steps:
            speed = 200 * (1 + np.cumsum(walk))
            distance = np.concatenate([[0], np.cumsum(step * speed)[:-1]])
            times = step * np.arange(500)
            n = 60
            position = np.column_stack([distance[:n], np.zeros(n)])
            velocity = np.column_stack([speed[:n], np.zeros(n)])
            found = estimate_times_over(one, times[:n], position, velocity)
            true = np.interp(60e3, distance, times)
            scores.append((found.time[-1, 1] - true) / found.sigma[-1, 1])
        low, high = stats.chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], 400) / 400
        assert low * 0.9 < np.mean(np.square(scores)) < high * 1.1

    def test_mean_speed_by_its_formula(self):
        one = FlightPlan([[0, 0], [3e5, 0]], 200.0)
        rng = np.random.default_rng(10)
        times = np.cumsum(rng.uniform(4, 12, 30))
        speeds = 190 + rng.normal(0, 5, 30)
        position = np.column_stack([200 * times, np.zeros(30)])
        velocity = np.column_stack([speeds, np.zeros(30)])
        found = estimate_times_over(one, times, position, velocity)
        for k in (0, 3, 29):
            expected = reference.mean_speed(times[: k + 1], speeds[: k + 1])
            assert found.speed[k] == pytest.approx(expected, rel=1e-12)
            rest = (3e5 - 200 * times[k]) / expected
            assert found.time[k, 1] == pytest.approx(times[k] + rest, rel=1e-12)
        covariance = np.tile(np.diag([2500.0, 1, 9, 1]), (30, 1, 1))
        wide = estimate_times_over(one, times, position, velocity, covariance=covariance)
        np.testing.assert_allclose(wide.speed_sigma, 3.0)
        tau = wide.time[-1, 1] - times[-1]
        relative = 9 / wide.speed[-1] ** 2 + 0.04**2 / 60 * tau / 3
        expected = 2500 / wide.speed[-1] ** 2 + tau**2 * relative
        assert wide.sigma[-1, 1] == pytest.approx(np.sqrt(expected), rel=1e-12)

    def test_what_does_not_conform_changes_nothing(self):
        one = FlightPlan(WAY, 210.0)
        times = np.arange(0, 600, 10.0)
        position, velocity = one.at(times)
        position[20:, 0] += 2e4
        found = estimate_times_over(one, times, position, velocity)
        blocked = np.flatnonzero(~conformance(one, times, position, velocity).conforms)[0]
        assert 20 <= blocked < 24
        np.testing.assert_array_equal(found.speed[blocked:], found.speed[blocked])


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
            ((CORNERED, 200), {"heights": [1, 2, NAN]}, r"heights\[2\] is nan"),
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
        with pytest.raises(TypeError, match="plans must be a sequence"):
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


class TestFiles:
    def test_csv(self, tmp_path):
        file = tmp_path / "plans.csv"
        file.write_text(
            "name,east_m,north_m,height_m,speed_m_s,identity,aircraft_type\n"
            "A,0,0,9000,220,17,A320\nA,0,50000,9000,210,,\nA,0,50000,9000,205,,\n"
            "A,40000,70000,9300,,,\n\nB,0,0,,180,,\nB,100,70000,,,,\n"
        )
        first, second = read_plans(file, banks={"A320": 0.35})
        np.testing.assert_array_equal(first.waypoints, [[0, 0], [0, 5e4], [4e4, 7e4]])
        np.testing.assert_array_equal(first.speeds, [220, 205])
        np.testing.assert_array_equal(first.heights, [9000, 9000, 9300])
        assert (first.name, first.identity, first.bank) == ("A", 17, pytest.approx(0.35))
        assert (second.name, second.identity, second.heights) == ("B", None, None)
        assert second.bank == pytest.approx(np.radians(25))

    def test_json(self, tmp_path):
        file = tmp_path / "plans.json"
        plans = [
            {"name": "A", "waypoints": WAY.tolist(), "speeds_m_s": 200, "start_time_s": 60},
            {"waypoints": WAY.tolist(), "times_s": [0, 300, 600, 1100, 1400, 1800.0]},
            {"waypoints": WAY.tolist(), "turn_radius_m": 6000.0, "identity": 3},
        ]
        file.write_text(json.dumps(plans))
        first, second, third = read_plans(file, speed=190.0)
        assert (first.start_time, first.name) == (60.0, "A")
        np.testing.assert_allclose(second.times, plans[1]["times_s"], atol=1e-6)
        np.testing.assert_allclose(third.turns.radius, 6000.0)
        assert set(third.speeds) == {190.0}

    def test_geojson(self, tmp_path):
        file = tmp_path / "plans.geojson"
        points = [[2.1, 41.3, 0], [2.6, 41.5, 3000], [3.4, 41.5, 9000]]
        feature = {
            "type": "Feature",
            "properties": {"name": "A", "speeds_m_s": [120, 200], "bank_deg": 20},
            "geometry": {"type": "LineString", "coordinates": points},
        }
        file.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
        (one,) = read_plans(file, origin=(41.3, 2.1))
        geod = Geod(ellps="WGS84")
        for place, (longitude, latitude, _) in zip(one.waypoints, points, strict=True):
            azimuth, _, distance = geod.inv(2.1, 41.3, longitude, latitude)
            # in the plane that touches the earth at the origin
            assert np.hypot(*place) == pytest.approx(6.37e6 * np.sin(distance / 6.37e6), abs=0.05)
            if distance:
                found = np.degrees(np.arctan2(*place))
                assert found == pytest.approx(azimuth, abs=1e-4)
        np.testing.assert_array_equal(one.heights, [0, 3000, 9000])
        assert one.bank == pytest.approx(np.radians(20))
        with pytest.raises(ValueError, match="plan A: its positions are geodetic"):
            read_plans(file)

    @pytest.mark.parametrize(
        ("name", "text", "message"),
        [
            ("a.txt", "", "its name must end in"),
            ("a.csv", "name,x\nA,3\n", "it must have name, and east_m and north_m"),
            ("a.csv", "name,east_m,north_m\nA,3,x\n", "cannot read"),
            ("a.csv", "", "cannot read"),
            ("a.csv", "name,east_m,north_m\nA,0,0\nA,0,9\n", "plan A: either speeds or times"),
            ("a.csv", "name,east_m,north_m\nA,0,0\nA,0,\n", r"plan A: waypoints\[1, 1\] is nan"),
            ("a.csv", "name,east_m,north_m,speed_m_s\nA,0,0,9\nA,0,0,9\n", "plan A: waypoints has"),
            ("a.json", "[", "cannot read"),
            ("a.json", "{}", "neither a list"),
            ("a.json", "[3]", "plan 0 has no waypoints"),
            ("a.json", "5", "neither a list"),
            ("a.geojson", '{"type": "FeatureCollection", "features": [5]}', "the feature 5"),
            ("a.json", '[{"waypoints": [[0, 0], [1, "x"]], "speeds_m_s": 1}]', "plan 0"),
            ("a.json", '[{"waypoints": [[0, 0], [1]], "speeds_m_s": 1}]', "plan 0"),
            (
                "a.geojson",
                '{"type": "FeatureCollection", "features": [{"geometry": {"type": "Point"}}]}',
                "has a Point",
            ),
        ],
    )
    def test_what_cannot_be_read(self, tmp_path, name, text, message):
        file = tmp_path / name
        file.write_text(text)
        with pytest.raises(ValueError, match=message):
            read_plans(file)
