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
    "**robust, RTS**": ({}, (1.60, 1.59, 1.60, 1.61, 1.60, 1.60, 1.61)),
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
    heading = 0.5 - 0.01 * INSTANTS
    radius = -2000.0
    return np.column_stack(
        [
            radius * np.sin(heading),
            500 + radius * (1 - np.cos(heading)),
            np.full(len(INSTANTS), 300.0),
        ]
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
def fault_errors() -> dict[str, dict[str, FloatArray]]:
    """Return mean squared errors of every run, near the faults."""
    truth = track()
    errors: dict[str, dict[str, FloatArray]] = {}
    for name, sizes in FAULTS.items():
        near = slice(FIRST - MARGIN, FIRST + max(len(sizes), 1) + MARGIN)
        squares: dict[str, list[float]] = {method: [] for method in (SINGLE, *METHODS)}
        for run in range(RUNS):
            measured = measure(truth, generator(90, run))
            measured["range"][FIRST : FIRST + len(sizes), 0] += SIGMA_R * np.array(sizes)
            for method, (options, _) in METHODS.items():
                found = reconstructed(measured, **options)
                squares[method].append(_mean_square(found.position, truth, near))
                if method == "least squares, RTS":
                    squares[SINGLE].append(_mean_square(found.fixes.position, truth, near))
        errors[name] = {method: np.array(values) for method, values in squares.items()}
    return errors


def _mean_square(position: FloatArray, truth: FloatArray, near: slice) -> float:
    return float(np.mean(np.sum((position - truth)[near] ** 2, axis=-1)))


def faults() -> str:
    """Tabulate errors near faults, with those of the independent simulation in brackets."""
    errors = fault_errors()
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
    """Tabulate normalised errors of positions without faults."""
    truth = track()
    rows = []
    for method, (options, _) in METHODS.items():
        found = [
            reconstructed(measure(truth, generator(92, run)), **options) for run in range(RUNS)
        ]
        normalised = [_normalised(one, truth) for one in found]
        spread = np.std(normalised) / np.sqrt(RUNS)
        rows.append([method, f"{np.mean(normalised):.2f} ± {spread:.2f}"])
    return markdown(["without faults", "NEES per axis"], rows)


def _normalised(found: Trajectory, truth: FloatArray) -> float:
    """Return the mean normalised square of the errors of positions, per axis."""
    known = ~np.isnan(found.position).any(axis=-1)
    error = (found.position - truth)[known]
    solved = np.linalg.solve(found.covariance[known, :3, :3], error[..., np.newaxis])[..., 0]
    return float(np.mean(np.sum(error * solved, axis=-1)) / 3)


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
            normalised.append(_normalised(found, truth))
        spread = np.std(normalised) / np.sqrt(RUNS)
        rows.append(
            [name, f"{np.sqrt(np.mean(squares)):.2f}", f"{np.mean(normalised):.2f} ± {spread:.2f}"]
        )
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
