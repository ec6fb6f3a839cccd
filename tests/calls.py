"""One good call of every public function: what a sweep of wrong arguments starts from."""

from typing import Any

import numpy as np

from tertia import (
    association,
    bearing,
    flightplan,
    fusion,
    geo,
    kalman,
    location,
    metrics,
    registration,
    screening,
    sensors,
    simulate,
    smoothing,
    tertiary,
    tracker,
    trajectory,
    weights,
)

RNG = np.random.default_rng(18)
N = 24
Y = RNG.normal(50.0, 2.0, N)
Z = RNG.normal(10.0, 0.1, (2, N))
TIME = 4.0 * np.arange(N)
MODEL = kalman.SingerModel(4.0, 0.05, 0.1)
COVARIANCES = np.array([[[4.0, 1.0], [1.0, 2.0]], [[3.0, 0.5], [0.5, 3.0]]])
PAIR = np.array([[1.0, 2.0], [1.5, 2.5]])
SAMPLES = RNG.normal(size=(2, N))
PLACES = np.array([[0.0, 0.0], [4e3, 0.0], [0.0, 3e3], [5e3, 5e3]])
PATH = np.array([2.5e3, 2.0e3]) + np.column_stack([10.0 * TIME, 5.0 * TIME])
VELOCITY = np.tile([10.0, 5.0], (N, 1))
STATIONS = [sensors.Station(p, range_sigma=5.0, azimuth_sigma=0.01) for p in PLACES]
CLOCKS = [sensors.Station(p, arrival_time_sigma=1e-4) for p in PLACES]
RADARS = [sensors.Radar(range_sigma=50.0, azimuth_sigma=0.002, scan_period=4.0)]
PLAN = flightplan.FlightPlan([[0.0, 0.0], [5e4, 0.0], [5e4, 6e4]], 150.0, start_time=0.0)
FLOWN = {
    "time": TIME,
    "position": np.column_stack([150.0 * TIME, np.zeros(N)]),
    "velocity": np.tile([150.0, 0.0], (N, 1)),
}
OFFSET = PATH[:, np.newaxis] - PLACES
RANGE, AZIMUTH = np.linalg.norm(OFFSET, axis=-1), np.arctan2(OFFSET[..., 0], OFFSET[..., 1])
PLOTS = tracker.Plots(TIME, RANGE[:, 0], AZIMUTH[:, 0])
TRACKS = tracker.track(PLOTS, RADARS)
TRUTH = metrics.Truth(TIME, np.zeros(N, dtype=int), PATH)
# emissions are further apart than a signal travels, so that they can be told apart
HEARD = {
    "time": (5.0 * TIME[:, np.newaxis] + RANGE / 1500.0).ravel(),
    "sensor": np.tile(np.arange(4), N),
    "identity": np.ones(4 * N, dtype=int),
}
SEEN = {"range": RANGE, "azimuth": AZIMUTH}
TRAFFIC = simulate.dense_traffic(3, duration=40.0, rng=1)
FRAME = geo.LocalFrame(52.0, 11.0)
STATES = {"time": TIME, "sensor": 0, "track": 1, "position": PATH, "velocity": VELOCITY}
SERIES = {"z": Z, "measurement_variance": 0.01, "model": MODEL}
WHOLE = SERIES | {"measurement_variance": RNG.uniform(0.01, 0.02, Z.shape),
                  "time": np.cumsum(RNG.uniform(3.0, 5.0, Z.shape), axis=-1)}  # fmt: skip

# every argument by its name
CALLS: list[tuple[Any, dict[str, Any]]] = [
    (screening.bursts, {"y": Y}),
    (screening.moving_polynomial, {"y": Y, "time": TIME, "period": 360.0}),
    (screening.cochran, {"variances": Y, "degrees_of_freedom": 9}),
    (screening.critical_value, {"n": 9, "significance": 0.05}),
    (screening.critical_value, {"n": 9, "significance": 0.05, "test": "cochran",
                                "degrees_of_freedom": 5}),
    (screening.false_alarm_probability, {"k": 2.5, "n": 9}),
    (screening.grubbs, {"y": Y}),
    (screening.k_sigma, {"y": Y}),
    (screening.leave_one_out, {"y": Y}),
    (screening.leave_one_out_mask, {"y": Y}),
    (screening.leave_one_out_statistics, {"y": Y}),
    (screening.t_test, {"x": 50.0, "y": Y}),
    (screening.thompson_tau, {"y": Y}),
    (screening.unwrap_about_median, {"theta": Y}),
    (screening.z_test, {"x": 50.0, "y": Y, "sigma": 2.0}),
    (bearing.estimate_bearing, {"theta": Y}),
    (bearing.estimate_bearing, {"theta": Y, "method": "paper"}),
    (bearing.estimate_bearing, {"theta": Y, "sigma": 2.0}),
    (bearing.estimate_bearing, {"theta": Y, "groups": np.arange(N) // 6}),
    (weights.covariance_factor, {"n": 9}),
    (weights.covariance_of_covariance, {"covariance": COVARIANCES[0], "factor": 0.1}),
    (weights.fused_covariance, {"covariances": COVARIANCES}),
    (weights.fusion_loss, {"covariances": COVARIANCES, "n": 50, "trials": 50}),
    (weights.jacobian, {"covariances": COVARIANCES}),
    (weights.jacobian_operator, {"covariances": COVARIANCES}),
    (weights.required_samples, {"covariances": COVARIANCES, "method": "first-order"}),
    (weights.sample_covariance, {"x": SAMPLES}),
    (weights.scalar_information, {"h": PAIR[0], "sigma": 1.0}),
    (weights.shrink_covariance, {"model": COVARIANCES[0], "sample": COVARIANCES[1], "n": 9}),
    (weights.weight_bias, {"covariances": COVARIANCES, "n": 50}),
    (weights.weight_covariance, {"covariances": COVARIANCES, "n": 50}),
    (weights.weight_matrices, {"covariances": COVARIANCES}),
    (sensors.Station, {"position": PLACES[0], "range_sigma": 5.0, "azimuth_sigma": 0.01}),
    (sensors.Radar, {"range_sigma": 50.0, "azimuth_sigma": 0.002, "scan_period": 4.0}),
    (sensors.Bias, {"range": 1.0, "azimuth": 0.01, "azimuth_sigma": 0.01}),
    (location.accuracy_map, {"stations": STATIONS, "grid": PATH[:3]}),
    (location.locate, {"stations": STATIONS, **{k: v[:2] for k, v in SEEN.items()}}),
    (location.locate, {"stations": STATIONS, "azimuth": AZIMUTH[0], "method": "posterior",
                       "max_range": 1e5}),
    (location.locate, {"stations": CLOCKS, "arrival_time": RANGE[0] / 1e3,
                       "propagation_speed": 1e3}),
    (kalman.SingerModel, {"dt": 4.0, "alpha": 0.05, "acceleration_sigma": 0.1}),
    (kalman.AngleFilter, {"model": MODEL, "measurement_variance": 0.01}),
    (kalman.filter_series, SERIES),
    (kalman.filter_series, SERIES | {"time": TIME, "period": 360.0}),
    (kalman.filter_series, WHOLE),
    (kalman.fit_noise, {"z": Z, "dt": 4.0}),
    (kalman.smooth_series, SERIES),
    (kalman.smooth_series, WHOLE),
    (kalman.steady_state, {"model": MODEL, "measurement_variance": 0.01}),
    (smoothing.local_polynomial, {"y": Y}),
    (smoothing.local_polynomial, {"y": Y, "time": TIME, "degree": 2}),
    (smoothing.smooth, {"y": PATH, "covariance": 25.0 * np.eye(2), "time": TIME}),
    (smoothing.smooth, {"y": PATH, "covariance": 25.0 * np.eye(2), "dt": 4.0, "jerk": 1e-4}),
    (trajectory.Arrivals, HEARD),
    (trajectory.group_arrivals, {"arrivals": trajectory.Arrivals(**HEARD)}),
    (trajectory.reconstruct, {"stations": STATIONS, "time": TIME, **SEEN}),
    (trajectory.reconstruct_arrivals, {"stations": CLOCKS,
                                       "arrivals": trajectory.Arrivals(**HEARD),
                                       "propagation_speed": 1500.0}),
    (fusion.AngleFusion, {"model": MODEL, "measurement_variance": [0.01, 0.01]}),
    (fusion.common_azimuth, {"range": 1e4, "azimuth": 0.5, "position": PLACES[1],
                             "range_sigma": 50.0, "azimuth_sigma": 0.01}),
    (fusion.fuse, {"estimates": PAIR, "covariances": COVARIANCES}),
    (fusion.fuse, {"estimates": PAIR, "covariances": COVARIANCES, "bias_sigma": None}),
    (fusion.fuse, {"estimates": PAIR, "covariances": COVARIANCES,
                   "cross_covariances": np.zeros((2, 2, 2, 2))}),
    (fusion.fuse, {"estimates": PAIR, "covariances": COVARIANCES,
                   "method": "covariance-intersection"}),
    (fusion.fuse_scalar, {"estimate": PAIR[0], "covariance": COVARIANCES[0], "h": [1.0, 0.0],
                          "measured": 1.0, "sigma": 1.0}),
    (fusion.fuse_series, SERIES),
    (fusion.fuse_series, SERIES | {"method": "matrix", "time": TIME}),
    (fusion.fuse_series, SERIES | {"method": "robust", "period": 360.0}),
    (association.associate, {"predicted": PATH[:2], "covariance": 100.0 * np.eye(2),
                             "plots": PATH[:3], "clutter_density": 1e-9}),
    (association.gate, {"predicted": PATH[:2], "covariance": 100.0 * np.eye(2),
                        "plots": PATH[:3]}),
    (association.gate_sectors, {"innovation": PAIR, "covariance": COVARIANCES,
                                "velocity": PAIR}),
    (association.gate_threshold, {"gate_probability": 0.99}),
    (association.likelihood_score, {"nis": 1.0, "covariance": COVARIANCES[0],
                                    "clutter_density": 1e-3}),
    (association.paper_score, {"nis": 1.0}),
    (flightplan.FlightPlan, {"waypoints": [[0.0, 0.0], [5e4, 0.0], [5e4, 6e4]],
                             "speeds": 150.0, "start_time": 0.0}),
    (flightplan.conformance, {"plan": PLAN, **FLOWN}),
    (flightplan.correlate, {"plans": [PLAN], **FLOWN}),
    (flightplan.estimate_times_over, {"plan": PLAN, **FLOWN}),
    (tracker.Plots, {"time": TIME, "range": RANGE[:, 0], "azimuth": AZIMUTH[:, 0]}),
    (tracker.Tracker, {"sensors": RADARS}),
    (tracker.CvModel, {"straight_sigma": 0.1}),
    (tracker.ImmModel, {}),
    (tracker.PlanModel, {}),
    (tracker.WindowModel, {}),
    (tracker.track, {"plots": PLOTS, "sensors": RADARS}),
    (tracker.smooth_tracks, {"plots": PLOTS, "sensors": RADARS, "tracks": TRACKS, "every": 3.0}),
    (registration.calibrate, {"station": STATIONS[0], "time": TIME, "position": PATH,
                              "azimuth": AZIMUTH[:, 0]}),
    (registration.register, {"plots": PLOTS, "sensors": RADARS}),
    (tertiary.SensorTracks, STATES),
    (tertiary.FusionCentre, {"sensors": RADARS}),
    (tertiary.fuse_tracks, {"tracks": tertiary.SensorTracks(**STATES), "sensors": RADARS}),
    (simulate.dense_traffic, {"n": 2, "duration": 20.0}),
    (simulate.direction_finder, {"n": 20}),
    (simulate.encounter, {"name": "crossing", "duration": 20.0}),
    (simulate.flights, {"plans": [PLAN], "step": 5.0}),
    (simulate.passive_location, {"position": [0.0, 1e4]}),
    (simulate.radar_plots, {"traffic": TRAFFIC, "radars": RADARS}),
    (simulate.radar_scenario, {"name": "healthy", "steps": 40}),
    (simulate.radars, {"model": MODEL, "steps": 20}),
    (simulate.routes, {"set_up": "middle", "n": 1}),
    (simulate.scene, {"name": "middle", "aircraft_count": 2, "duration": 30.0}),
    (simulate.set_up, {"name": "middle"}),
    (simulate.stations, {"stations": STATIONS, "position": PATH}),
    (simulate.wishart, {"covariance": COVARIANCES[0], "degrees_of_freedom": 9}),
    (metrics.Truth, {"time": TIME, "target": np.zeros(N, dtype=int), "position": PATH}),
    (metrics.audit, {"error": np.tile(PAIR, (N, 1)), "covariance": np.eye(2)}),
    (metrics.audit_split, {"first": np.tile(PAIR, (N, 1)), "first_covariance": np.eye(2),
                           "second": np.tile(PAIR, (N, 1)), "second_covariance": np.eye(2)}),
    (metrics.autocorrelation, {"innovation": Y}),
    (metrics.consistency_bounds, {"count": 20}),
    (metrics.gospa, {"estimates": PATH[:3], "truth": PATH[:4], "cutoff": 100.0}),
    (metrics.indicators, {"tracks": TRACKS, "truth": TRUTH, "max_distance": 1e3,
                          "update_interval": 4.0}),
    (metrics.match_tracks, {"tracks": TRACKS, "truth": TRUTH, "max_distance": 1e3}),
    (metrics.nees, {"error": PAIR, "covariance": COVARIANCES}),
    (metrics.nis, {"innovation": PAIR, "variance": 1.0}),
    (metrics.rmse, {"error": PAIR}),
    (metrics.track_errors, {"error": PAIR, "course": 0.5}),
    (geo.LocalFrame, {"latitude": 52.0, "longitude": 11.0}),
    (FRAME.to_local, {"latitude": 52.1, "longitude": 11.1}),
    (FRAME.to_geodetic, {"position": np.column_stack([PATH, TIME])}),
    (FRAME.to_ecef, {"position": np.column_stack([PATH, TIME])}),
    (FRAME.from_ecef, {"ecef": [4e6, 1e6, 5e6]}),
    (FRAME.axes, {"latitude": 52.1, "longitude": 11.1}),
    (FRAME.station, {"latitude": 52.1, "longitude": 11.1}),
]  # fmt: skip
