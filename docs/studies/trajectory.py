"""The tables and the picture of the page on trajectories."""

import functools
from typing import Any

import make_stations
import numpy as np
from matplotlib.figure import Figure

from studies.montecarlo import FloatArray, generator
from studies.pages import markdown
from tertia import plot
from tertia.location import Kind, Station
from tertia.trajectory import Trajectory, reconstruct

PLACES = np.array([[1.0, 1000.0, 2.0], [2000.0, 300.0, 5.0], [400.0, 2600.0, 0.0]])
SIGMA_R, SIGMA_A = 10.0, np.deg2rad(0.3)
STATIONS = [
    Station(place, range_sigma=SIGMA_R, azimuth_sigma=SIGMA_A, elevation_sigma=SIGMA_A)
    for place in PLACES
]
INSTANTS = np.arange(60.0)
RUNS = 50
FIRST, MARGIN = 28, 7
# of station 1's ranges, in standard deviations, with the errors of an independent simulation
FAULTS: dict[str, tuple[float, ...]] = {
    "none": (),
    "5σ": (5,),
    "2 same": (5, 5),
    "2 opposite": (5, -5),
    "3 same": (5, 5, 5),
    "+4, −6, +5": (4, -6, 5),
    "4 same": (5, 5, 5, 5),
}
DEFAULT = "**robust, RTS**"
METHODS: dict[str, tuple[dict[str, Any], tuple[float, ...]]] = {
    "A: space, then time": (
        {"spatial": "least-squares", "smoother": "local-polynomial"},
        (2.58, 2.69, 3.09, 2.58, 3.65, 2.54, 4.35),
    ),
    "B: time, then space": (
        {"spatial": "least-squares", "smoother": "local-polynomial", "order": "temporal-first"},
        (2.78, 2.89, 3.19, 2.77, 3.74, 2.80, 4.60),
    ),
    "A, robust in space": (
        {"smoother": "local-polynomial"},
        (2.62, 2.64, 2.65, 2.67, 2.67, 2.69, 2.68),
    ),
    "least squares, RTS": (
        {"spatial": "least-squares"},
        (1.57, 1.57, 1.69, 1.56, 1.91, 1.55, 2.18),
    ),
    DEFAULT: ({}, (1.60, 1.59, 1.60, 1.61, 1.60, 1.60, 1.61)),
}
# four direction finders and a boat
FINDER_SIGMA, FINDER_RUNS = np.deg2rad(5.0), 12
FINDER_BIASES = np.deg2rad([-1.0, -7.0, -4.0, -6.0])
FINDER_FIXES = "least squares, no smoothing"
FINDER_METHODS: dict[str, dict[str, Any]] = {
    FINDER_FIXES: {"spatial": "least-squares"},
    "robust, RTS": {},
    "robust, RTS, biases estimated": {"biases": ("azimuth",)},
}
SINGLE = "least squares, no smoothing"
EXPECTED_SINGLE = (7.88, 8.43, 8.77, 8.68, 9.12, 9.06, 9.39)
BIASES: dict[Kind, FloatArray] = {
    "range": np.array([20.0, -15.0, 5.0]),
    "azimuth": np.deg2rad([0.3, -0.5, 0.1]),
    "elevation": np.deg2rad([-0.2, 0.4, 0.3]),
}


def track() -> FloatArray:
    """Return the smooth turn: 20 m/s, 0.01 rad/s, level."""
    return motion()[0]


def motion() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return its positions, velocities and accelerations."""
    heading = 0.5 - 0.01 * INSTANTS
    radius = -2000.0
    sine, cosine, zero = np.sin(heading), np.cos(heading), np.zeros(len(INSTANTS))
    return (
        np.column_stack([radius * sine, 500 + radius * (1 - cosine), zero + 300.0]),
        np.column_stack([20.0 * cosine, 20.0 * sine, zero]),
        np.column_stack([0.2 * sine, -0.2 * cosine, zero]),
    )


def measure(position: FloatArray, rng: np.random.Generator) -> dict[Kind, FloatArray]:
    """Return what the stations measure."""
    east, north, up = np.moveaxis(position[:, np.newaxis] - PLACES, -1, 0)
    ideal: dict[Kind, tuple[FloatArray, float]] = {
        "range": (np.sqrt(east**2 + north**2 + up**2), SIGMA_R),
        "azimuth": (np.arctan2(east, north), SIGMA_A),
        "elevation": (np.arctan2(up, np.hypot(east, north)), SIGMA_A),
    }
    return {
        kind: values + sigma * rng.standard_normal(values.shape)
        for kind, (values, sigma) in ideal.items()
    }


def reconstructed(measured: dict[Kind, FloatArray], **options: Any) -> Trajectory:
    """Reconstruct the track."""
    given: dict[str, Any] = {str(kind): values for kind, values in measured.items()}
    return reconstruct(STATIONS, INSTANTS, **given, **options)


@functools.cache
def fault_errors() -> tuple[dict[str, dict[str, FloatArray]], dict[str, dict[str, FloatArray]]]:
    """Return mean squared errors of every run near the faults, and its normalised errors."""
    truth = track()
    errors: dict[str, dict[str, FloatArray]] = {}
    normalised: dict[str, dict[str, FloatArray]] = {}
    for name, sizes in FAULTS.items():
        near = slice(FIRST - MARGIN, FIRST + max(len(sizes), 1) + MARGIN)
        squares: dict[str, list[float]] = {method: [] for method in (SINGLE, *METHODS)}
        told: dict[str, list[list[float]]] = {method: [] for method in METHODS}
        for run in range(RUNS):
            measured = measure(truth, generator(90, run))
            measured["range"][FIRST : FIRST + len(sizes), 0] += SIGMA_R * np.array(sizes)
            for method, (options, _) in METHODS.items():
                found = reconstructed(measured, **options)
                squares[method].append(_mean_square(found.position, truth, near))
                told[method].append([_normalised(found, *one) for one in enumerate(motion())])
                if method == "least squares, RTS":
                    squares[SINGLE].append(_mean_square(found.fixes.position, truth, near))
        errors[name] = {method: np.array(values) for method, values in squares.items()}
        normalised[name] = {method: np.array(values) for method, values in told.items()}
    return errors, normalised


def _mean_square(position: FloatArray, truth: FloatArray, near: slice) -> float:
    return float(np.mean(np.sum((position - truth)[near] ** 2, axis=-1)))


def faults() -> str:
    """Tabulate errors near faults, with those of the independent simulation in brackets."""
    errors, _ = fault_errors()
    expected = {SINGLE: EXPECTED_SINGLE} | {name: told for name, (_, told) in METHODS.items()}
    rows = (
        [
            method,
            *(
                f"{np.sqrt(np.mean(errors[name][method])):.2f} ({figure:.2f})"
                for name, figure in zip(FAULTS, figures, strict=True)
            ),
        ]
        for method, figures in expected.items()
    )
    return markdown(["", *FAULTS], rows)


def consistency() -> str:
    """Tabulate normalised errors with and without faults."""
    _, normalised = fault_errors()
    rows = [
        [method, *(_told(normalised[name][method][:, 0]) for name in FAULTS)] for method in METHODS
    ]
    for at, derivative in enumerate(("velocity", "acceleration"), 1):
        own = (_told(normalised[name][DEFAULT][:, at]) for name in FAULTS)
        rows.append([f"robust, RTS: {derivative}", *own])
    return markdown(["NEES per axis", *FAULTS], rows)


def _told(normalised: FloatArray) -> str:
    spread = np.std(normalised) / np.sqrt(len(normalised))
    return f"{np.mean(normalised):.2f} ± {spread:.2f}"


def _normalised(found: Trajectory, derivative: int, truth: FloatArray) -> float:
    """Return the mean normalised square of the errors of positions or derivatives, per axis."""
    d = truth.shape[-1]
    own = slice(derivative * d, (derivative + 1) * d)
    covariance = found.covariance[:, own, own]
    error = (found.position, found.velocity, found.acceleration)[derivative] - truth
    known = np.isfinite(covariance).all(axis=(-2, -1)) & ~np.isnan(error).any(axis=-1)
    solved = np.linalg.solve(covariance[known], error[known][..., np.newaxis])[..., 0]
    return float(np.mean(np.sum(error[known] * solved, axis=-1)) / d)


def bearings(rng: np.random.Generator, gross: float) -> tuple[FloatArray, ...]:
    """Return times, a boat's positions, four drifting direction finders and their azimuths."""
    times: FloatArray = 2.5 * np.arange(200.0)
    truth: FloatArray = np.column_stack(
        [900 * np.sin(times / 200) + 0.5 * times - 100, 800 * np.cos(times / 150)]
    )
    places = np.array([[-1000.0, 1000.0], [1000.0, 900.0], [-900.0, -1000.0], [1000.0, -900.0]])
    drift = places + times[:, np.newaxis, np.newaxis] * np.array([0.2, -0.15])
    offset = truth[:, np.newaxis] - drift
    azimuth: FloatArray = np.arctan2(offset[..., 0], offset[..., 1]) + FINDER_BIASES
    azimuth += FINDER_SIGMA * rng.standard_normal(azimuth.shape)
    wrong = rng.random(azimuth.shape) < gross
    turn = rng.choice([-1.0, 1.0], azimuth.shape) * rng.uniform(np.pi / 6, np.pi, azimuth.shape)
    return times, truth, drift, azimuth + np.where(wrong, turn, 0.0)


def finders() -> str:
    """Tabulate errors of a boat's track from biased bearings, some of them gross errors."""
    rows = []
    for gross in (0.0, 0.05):
        errors: dict[str, list[FloatArray]] = {}
        inside: dict[str, list[float]] = {}
        squares = []
        for run in range(FINDER_RUNS):
            times, truth, drift, azimuth = bearings(generator(93, run), gross)
            stations = [Station(drift[:, k], azimuth_sigma=FINDER_SIGMA) for k in range(4)]
            for name, options in FINDER_METHODS.items():
                found = reconstruct(stations, times, azimuth=azimuth, **options)
                fix = name == FINDER_FIXES
                position = found.fixes.position if fix else found.position
                covariance = found.fixes.covariance if fix else found.covariance[:, :2, :2]
                error = position - truth
                known = np.isfinite(covariance).all(axis=(-2, -1))
                error, covariance = error[known], covariance[known]
                solved = np.linalg.solve(covariance, error[..., np.newaxis])[..., 0]
                # 95 % of a chi-square variable with two degrees of freedom
                covered = np.sum(error * solved, axis=-1) < -2 * np.log(0.05)
                errors.setdefault(name, []).append(np.linalg.norm(error, axis=-1))
                inside.setdefault(name, []).append(float(np.mean(covered)))
                if found.bias is not None and found.bias_sigma is not None:
                    off = np.asarray(found.bias.azimuth) - FINDER_BIASES
                    squares.append((off / np.asarray(found.bias_sigma.azimuth)) ** 2)
        for name, sizes in errors.items():
            levels = np.percentile(np.concatenate(sizes), [50, 90, 99])
            bias = f"{np.mean(squares):.2f}" if name.endswith("estimated") else ""
            rows.append(
                [
                    f"{gross:.0%}",
                    name,
                    *(f"{level:.0f}" for level in levels),
                    f"{np.mean(inside[name]):.0%}",
                    bias,
                ]
            )
    return markdown(
        [
            "gross errors",
            "",
            "50 %, m",
            "90 %, m",
            "99 %, m",
            "in 95 % ellipse",
            "biases, (error/σ)²",
        ],
        rows,
    )


def biases() -> str:
    """Tabulate errors with and without estimated biases."""
    truth = track()
    rows = []
    for name, options in {
        "no biases": {},
        "biases, not estimated": {},
        "biases, estimated": {"biases": tuple(BIASES)},
        "no biases, but estimated": {"biases": tuple(BIASES)},
    }.items():
        squares, normalised = [], []
        for run in range(RUNS):
            measured = measure(truth, generator(91, run))
            if name.startswith("biases"):
                measured = {kind: values + BIASES[kind] for kind, values in measured.items()}
            found = reconstructed(measured, **options)
            squares.append(_mean_square(found.position, truth, slice(None)))
            normalised.append(_normalised(found, 0, truth))
        rows.append([name, f"{np.sqrt(np.mean(squares)):.2f}", _told(np.array(normalised))])
    return markdown(["", "RMSE, m", "NEES per axis"], rows)


def track_figure() -> Figure:
    """Draw the trajectory of the example, with an echo and a misaligned station."""
    stations, found = make_stations.sites(), make_stations.measurements()
    track = reconstruct(
        stations,
        make_stations.times(),
        range=found["range_m"],
        azimuth=np.radians(found["azimuth_deg"]),
        elevation=np.radians(found["elevation_deg"]),
        biases=("azimuth",),
    )
    figure = Figure(figsize=(10, 7.5), layout="constrained")
    plot.trajectory(stations, track, figure=figure)
    return figure
