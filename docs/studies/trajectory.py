"""The tables and the picture of the pages on trajectories, systematic errors and the paper."""

import functools
from collections.abc import Callable
from typing import Any

import make_stations
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from studies import honesty
from studies.honest_series import LABELS, MOTIONS
from studies.honesty import BoolArray
from studies.montecarlo import WITHIN_95, FloatArray, generator, in_region, normalised_squares
from studies.pages import markdown, repetitions
from tertia import plot
from tertia.location import locate
from tertia.sensors import Bias, Kind, Station
from tertia.smoothing import local_polynomial
from tertia.trajectory import Trajectory, reconstruct

PLACES = np.array([[1.0, 1000.0, 2.0], [2000.0, 300.0, 5.0], [400.0, 2600.0, 0.0]])
SIGMA_R, SIGMA_A = 10.0, np.deg2rad(0.3)
INSTANTS = np.arange(60.0)
RUNS = repetitions(50)
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
FINDER_SIGMA, FINDER_RUNS = np.deg2rad(5.0), repetitions(12)
FINDER_BIASES = np.deg2rad([-1.0, -7.0, -4.0, -6.0])
FINDER_FIXES = "least squares, no smoothing"
FINDER_METHODS: dict[str, dict[str, Any]] = {
    FINDER_FIXES: {"spatial": "least-squares", "bias": Bias()},
    "stations trusted, `bias=Bias()`": {"bias": Bias()},
    "**default**": {},
    "constant, `Bias(azimuth_sigma=inf)`": {"bias": Bias(azimuth_sigma=np.inf)},
}
# four drifting finders whose errors depend on direction and time: standard deviations in degrees of
# noise, constant, coefficients of the first order, and drift, with its correlation time in seconds
LASTING_RUNS, LASTING_TIME = repetitions(60), 200.0
LASTING_SIGMAS = np.deg2rad([2.0, 4.0, 6.0, 3.0])
LASTING_METHODS: dict[str, dict[str, Any]] = {
    "stations trusted, `bias=Bias()`": {"bias": Bias()},
    "constant, `Bias(azimuth_sigma=None, drift_share=0)`": {
        "bias": Bias(azimuth_sigma=None, drift_share=0.0)
    },
    "given: 8°, half of it drifts, 600 s": {
        "bias": Bias(azimuth_sigma=np.deg2rad(8.0), drift_share=0.5, drift_time=600.0)
    },
    "**default**": {},
}
# networks about the origin for the table of coverages: standard deviations, and size of the way
HONEST_RUNS = repetitions(20, 1)
HONEST: dict[str, tuple[FloatArray, dict[Kind, float], float]] = {
    "4 bearings": (
        np.array([[-1000.0, 1000.0], [1000.0, 900.0], [-900.0, -1000.0], [1000.0, -900.0]]),
        {"azimuth": np.deg2rad(3.0)},
        900.0,
    ),
    "3 bearings": (
        np.array([[-1500.0, 1000.0], [1500.0, 900.0], [0.0, -1800.0]]),
        {"azimuth": np.deg2rad(2.0)},
        900.0,
    ),
    "5 ranges": (
        np.array([[-1000.0, 1000], [1200, 700], [-900, -1000], [300, 1300], [900, -700]]),
        {"range": 10.0},
        900.0,
    ),
    "2 radars": (
        np.array([[-3000.0, 0.0], [3000.0, 500.0]]),
        {"range": 20.0, "azimuth": np.deg2rad(0.3)},
        2000.0,
    ),
    "3 radars in space": (
        np.array([[-1000.0, -300, 2], [1000, -1000, 5], [-600, 1300, 0]]),
        {"range": 10.0, "azimuth": np.deg2rad(0.3), "elevation": np.deg2rad(0.3)},
        700.0,
    ),
}
SINGLE = "least squares, no smoothing"
EXPECTED_SINGLE = (7.88, 8.43, 8.77, 8.68, 9.12, 9.06, 9.39)
BIASES: dict[Kind, FloatArray] = {
    "range": np.array([20.0, -15.0, 5.0]),
    "azimuth": np.deg2rad([0.3, -0.5, 0.1]),
    "elevation": np.deg2rad([-0.2, 0.4, 0.3]),
}
FLAT = Bias(range_sigma=np.inf, azimuth_sigma=np.inf, elevation_sigma=np.inf)
# the paper's claims: fixed degree, radii of circles round the first station
CLAIM_RUNS, ONE_DEGREE, RADII = repetitions(40), 3, (500.0, 1000.0)
# turns in radians a second and noise in units of what the stations have
WINDOWS, WINDOW_RUNS, GROUPS = np.arange(5, 42, 2), repetitions(20), (1, 2, 3, 4)
WINDOW_CASES = ((0.0, 1.0), (0.01, 1.0), (0.05, 1.0), (0.05, 0.1), (0.1, 0.1), (0.2, 0.1))
RUN_LENGTHS, RUN_RUNS = (1, 2, 4, 7, 13), repetitions(8)
# the paper's figure 2: what it prints of ten instants; the words for a fault displace Smooth_R
PAPER_INSTANTS, PAPER_SIGMA, PAPER_RUNS = np.arange(47, 57), 50.0, repetitions(40)
PAPER_ADDED = np.array([[2000.0, 300.0, 5.0], [400.0, 2600.0, 0.0], [-500.0, 200.0, 20.0]])
IDEAL_R = np.array(
    [
        1174.0134,
        1149.3656,
        1131.257,
        1121.334,
        1120.7431,
        1131.1618,
        1155.9935,
        1201.6753,
        1278.9189,
        1403.3963,
    ]
)
REAL_R = np.array(
    [
        1188.856,
        1141.1088,
        1114.3564,
        1335.2803,
        778.8312,
        1379.6484,
        1160.9711,
        1162.57,
        1236.0229,
        1444.4121,
    ]
)
SMOOTH_R = np.array(
    [
        1190.3362,
        1163.4746,
        1163.4746,
        np.nan,
        np.nan,
        np.nan,
        1146.3116,
        1291.7393,
        1437.167,
        1582.5947,
    ]
)
FINAL = np.array(
    [
        [999.86, 598.2, 469.98],
        [978.62, 782.71, 469.78],
        [979.51, 877.03, 479.93],
        [980.34, 976.81, 490.1],
        [980.15, 1082.79, 499.81],
        [979.03, 1197.59, 509.09],
        [999.7, 1244.38, 529.94],
        [999.11, 1395.97, 539.55],
        [999.57, 1580.62, 549.72],
        [1000.41, 1812.52, 560.24],
    ]
)


def network(
    places: FloatArray = PLACES, range_sigma: float = SIGMA_R, angle_sigma: float = SIGMA_A
) -> list[Station]:
    """Return stations that measure everything."""
    return [
        Station(
            place,
            range_sigma=range_sigma,
            azimuth_sigma=angle_sigma,
            elevation_sigma=angle_sigma,
        )
        for place in places
    ]


def track() -> FloatArray:
    """Return the smooth turn amid the stations: 25 m/s, 0.005 rad/s, level."""
    return motion()[0]


def motion() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return its positions, velocities and accelerations."""
    speed, rate, middle = 25.0, 0.005, 0.5
    heading = middle + rate * (INSTANTS - np.mean(INSTANTS))
    radius = speed / rate
    sine, cosine, zero = np.sin(heading), np.cos(heading), np.zeros(len(INSTANTS))
    east, north = 1200 - radius * np.sin(middle), 1250 + radius * np.cos(middle)
    return (
        np.column_stack([east + radius * sine, north - radius * cosine, zero + 300.0]),
        np.column_stack([speed * cosine, speed * sine, zero]),
        np.column_stack([-speed * rate * sine, speed * rate * cosine, zero]),
    )


def measure(
    position: FloatArray,
    rng: np.random.Generator,
    places: FloatArray = PLACES,
    range_sigma: float = SIGMA_R,
    angle_sigma: float = SIGMA_A,
) -> dict[Kind, FloatArray]:
    """Return what the stations measure."""
    east, north, up = np.moveaxis(position[:, np.newaxis] - places, -1, 0)
    ideal: dict[Kind, tuple[FloatArray, float]] = {
        "range": (np.sqrt(east**2 + north**2 + up**2), range_sigma),
        "azimuth": (np.arctan2(east, north), angle_sigma),
        "elevation": (np.arctan2(up, np.hypot(east, north)), angle_sigma),
    }
    return {
        kind: values + sigma * rng.standard_normal(values.shape)
        for kind, (values, sigma) in ideal.items()
    }


def reconstructed(measured: dict[Kind, FloatArray], **options: Any) -> Trajectory:
    """Reconstruct the track."""
    return reconstruct(network(), INSTANTS, **_named(measured), **options)


def _named(measured: dict[Kind, FloatArray]) -> dict[str, Any]:
    return {str(kind): values for kind, values in measured.items()}


@functools.cache
def fault_errors() -> tuple[dict[str, dict[str, FloatArray]], dict[str, dict[str, FloatArray]]]:
    """Return mean squared errors of every run near the faults, and its normalised errors."""
    truth = track()
    errors: dict[str, dict[str, FloatArray]] = {}
    normalised: dict[str, dict[str, FloatArray]] = {}
    for name, sizes in FAULTS.items():
        near = slice(FIRST - MARGIN, FIRST + max(len(sizes), 1) + MARGIN)
        squares: dict[str, list[float]] = {method: [] for method in (SINGLE, *METHODS)}
        per_axis: dict[str, list[list[float]]] = {method: [] for method in METHODS}
        for run in range(RUNS):
            measured = measure(truth, generator(90, run))
            measured["range"][FIRST : FIRST + len(sizes), 0] += SIGMA_R * np.array(sizes)
            for method, (options, _) in METHODS.items():
                found = reconstructed(measured, **options)
                squares[method].append(_mean_square(found.position, truth, near))
                per_axis[method].append([_normalised(found, *one) for one in enumerate(motion())])
                if method == "least squares, RTS":
                    squares[SINGLE].append(_mean_square(found.fixes.position, truth, near))
        errors[name] = {method: np.array(values) for method, values in squares.items()}
        normalised[name] = {method: np.array(values) for method, values in per_axis.items()}
    return errors, normalised


def _mean_square(position: FloatArray, truth: FloatArray, near: slice) -> float:
    return float(np.mean(np.sum((position - truth)[near] ** 2, axis=-1)))


def faults() -> str:
    """Tabulate errors near faults, with those of the independent simulation in brackets."""
    errors, _ = fault_errors()
    expected = {SINGLE: EXPECTED_SINGLE} | {name: numbers for name, (_, numbers) in METHODS.items()}
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
    return float(np.mean(normalised_squares(error[known], covariance[known])) / d)


def drifting(times: FloatArray, truth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the places of four drifting direction finders, and the azimuths of a boat."""
    places = np.array([[-1000.0, 1000.0], [1000.0, 900.0], [-900.0, -1000.0], [1000.0, -900.0]])
    drift = places + times[:, np.newaxis, np.newaxis] * np.array([0.2, -0.15])
    offset = truth[:, np.newaxis] - drift
    return drift, np.arctan2(offset[..., 0], offset[..., 1])


def bearings(rng: np.random.Generator, gross: float) -> tuple[FloatArray, ...]:
    """Return times, a boat's positions, four drifting direction finders and their azimuths."""
    times: FloatArray = 2.5 * np.arange(200.0)
    truth: FloatArray = np.column_stack(
        [900 * np.sin(times / 200) + 0.5 * times - 100, 800 * np.cos(times / 150)]
    )
    drift, azimuth = drifting(times, truth)
    azimuth += FINDER_BIASES
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
        squares: dict[str, list[FloatArray]] = {}
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
                # 95 % of a chi-square variable with two degrees of freedom
                covered = in_region(error, covariance)
                errors.setdefault(name, []).append(np.linalg.norm(error, axis=-1))
                inside.setdefault(name, []).append(float(np.mean(covered)))
                if found.bias is not None and np.all(np.asarray(found.bias.azimuth_sigma) > 0):
                    off = np.asarray(found.bias.azimuth) - FINDER_BIASES
                    normalised = (off / np.asarray(found.bias.azimuth_sigma)) ** 2
                    squares.setdefault(name, []).append(normalised)
        for name, sizes in errors.items():
            levels = np.percentile(np.concatenate(sizes), [50, 90, 99])
            bias = f"{np.mean(squares[name]):.2f}" if name in squares else ""
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
            "inside 95 % ellipse",
            "biases, (error/σ)²",
        ],
        rows,
    )


def biases() -> str:
    """Tabulate errors where stations have biases or none, and are trusted or not."""
    truth = track()
    rows = []
    assumed = {
        "stations trusted, `bias=Bias()`": {"bias": Bias()},
        "**default**": {},
        "all kinds unknown, sigmas of `inf`": {"bias": FLAT},
    }
    for name, options in assumed.items():
        cells = [name]
        for scale in (0.0, 1.0):
            squares, normalised = [], []
            for run in range(RUNS):
                measured = {
                    kind: values + scale * BIASES[kind]
                    for kind, values in measure(truth, generator(91, run)).items()
                }
                found = reconstructed(measured, **options)
                squares.append(_mean_square(found.position, truth, slice(None)))
                normalised.append(_normalised(found, 0, truth))
            cells += [f"{np.sqrt(np.mean(squares)):.2f}", _told(np.array(normalised))]
        rows.append(cells)
    return markdown(
        ["", "no biases: RMSE, m", "NEES per axis", "biases: RMSE, m", "NEES per axis"], rows
    )


def lasting_bearings(rng: np.random.Generator) -> tuple[FloatArray, ...]:
    """Return times, a boat, four drifting finders, and azimuths whose errors last."""
    times: FloatArray = 15.0 * np.arange(60.0)
    phase = rng.uniform(0.0, 2 * np.pi, 2)
    truth: FloatArray = np.column_stack(
        [
            700 * np.sin(times / 180 + phase[0]) + 0.3 * times - 130,
            700 * np.cos(times / 210 + phase[1]),
        ]
    )
    drift, azimuth = drifting(times, truth)
    noise, constant, coefficient, slow = LASTING_SIGMAS
    error = noise * rng.standard_normal(azimuth.shape) + constant * rng.standard_normal(4)
    for order in (1, 2):
        sine, cosine = coefficient / order * rng.standard_normal((2, 4))
        error += sine * np.sin(order * azimuth) + cosine * np.cos(order * azimuth)
    rest = np.exp(-15.0 / LASTING_TIME)
    walk = slow * rng.standard_normal(4)
    for step in range(len(times)):
        error[step] += walk
        walk = rest * walk + np.sqrt(1 - rest**2) * slow * rng.standard_normal(4)
    return times, truth, drift, azimuth + error


def lasting() -> str:
    """Tabulate errors of tracks from bearings whose errors last."""
    rows = []
    for name, options in LASTING_METHODS.items():
        squares, normalised, inside = [], [], []
        for run in range(LASTING_RUNS):
            times, truth, drift, azimuth = lasting_bearings(generator(99, run))
            stations = [Station(drift[:, k], azimuth_sigma=LASTING_SIGMAS[0]) for k in range(4)]
            found = reconstruct(stations, times, azimuth=azimuth, **options)
            error, covariance = found.position - truth, found.covariance[:, :2, :2]
            distance = normalised_squares(error, covariance)
            squares.append(np.mean(error**2))
            normalised.append(np.mean(distance) / 2)
            # 95 % of a chi-square variable with two degrees of freedom
            inside.append(np.mean(distance < WITHIN_95[2]))
        rows.append(
            [
                name,
                f"{np.sqrt(np.mean(squares)):.0f}",
                _told(np.array(normalised)),
                f"{np.mean(inside):.0%}",
            ]
        )
    return markdown(["", "RMS per axis, m", "NEES per axis", "inside 95 % ellipse"], rows)


def coverage() -> str:
    """Tabulate how often the regions of tracks hold the truth, with errors as they are."""
    rows = {}
    for name, (places, sigmas, size) in HONEST.items():
        for count in (60, 300):
            rows[f"{name}, {count} instants"] = _tracks(places, sigmas, size, count)
    return honesty.coverage_table(rows, study=98)


def _tracks(
    places: FloatArray, sigmas: dict[Kind, float], size: float, count: int
) -> Callable[[honesty.Draw], BoolArray]:
    """Return what reconstructs tracks among these stations."""

    def run(draw: honesty.Draw) -> BoolArray:
        found = []
        stations = [
            Station(
                place,
                range_sigma=sigmas.get("range"),
                azimuth_sigma=sigmas.get("azimuth"),
                elevation_sigma=sigmas.get("elevation"),
            )
            for place in places
        ]
        for _ in range(HONEST_RUNS):
            truth = _wandering(draw.rng, count, size, places.shape[1])
            offset = np.moveaxis(truth[:, np.newaxis] - places, -1, 0)
            level = np.hypot(offset[0], offset[1])
            ideal = {
                "range": np.sqrt(np.sum(offset**2, axis=0)),
                "azimuth": np.arctan2(offset[0], offset[1]),
                "elevation": np.arctan2(offset[-1], level),
            }
            measured: dict[str, Any] = {}
            for kind, sigma in sigmas.items():
                error = draw((len(places), count), ideal["azimuth"].T).T
                measured[str(kind)] = ideal[kind] + sigma * error
            if "range" in measured:
                measured["range"] = np.where(measured["range"] > 0, measured["range"], np.nan)
            track = reconstruct(stations, 5.0 * np.arange(count), **measured)
            d = places.shape[1]
            error, covariance = track.position - truth, track.covariance[:, :d, :d]
            found.append(in_region(error, covariance))
        return np.concatenate(found)

    return run


def motions() -> str:
    """Return errors and coverage of the default by how the target moves."""
    rows = []
    for name, draw in MOTIONS.items():
        cells = []
        for kind, count, step in (("azimuth", 60, 5.0), ("range", 60, 5.0), ("range", 300, 2.0)):
            found = []
            for run in range(HONEST_RUNS):
                rng = generator(103, sum(name.encode()), count, len(kind), run)
                way = 10 * step * np.cumsum(draw((1, count, 2), step, rng)[0], axis=0)
                way -= way.mean(axis=0)
                way *= min(1.0, 1500.0 / np.abs(way).max())
                truth = way + rng.uniform(-300.0, 300.0, 2)
                found.append(_errors(str(kind), truth, step, rng))
            error, squares = map(np.array, zip(*found, strict=True))
            inside = np.mean(squares < WITHIN_95[2])
            rmse = np.sqrt(np.mean(error**2))
            cells.append(f"{rmse:.1f}; {np.mean(squares) / 2:.2f}; {inside:.0%}")
        rows.append([LABELS.get(name, name), *cells])
    head = ["RMSE in m; NEES; inside 95 %", "bearings, 60 instants", "ranges, 60 instants"]
    return markdown([*head, "ranges, 300 instants"], rows)


def _errors(
    kind: str, truth: FloatArray, step: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return the errors of a path among four stations, and their normalised squares."""
    places = np.array([[-2000.0, -1500.0], [2200.0, -1300.0], [1800.0, 1900.0], [-2100.0, 1700.0]])
    east, north = np.moveaxis(truth[:, np.newaxis] - places, -1, 0)
    ideal, sigma = (
        (np.arctan2(east, north), 0.01) if kind == "azimuth" else (np.hypot(east, north), 20.0)
    )
    sigmas: dict[str, Any] = {f"{kind}_sigma": sigma}
    stations = [Station(place, **sigmas) for place in places]
    measured: dict[str, Any] = {kind: ideal + sigma * rng.standard_normal(ideal.shape)}
    track = reconstruct(stations, step * np.arange(len(truth)), **measured)
    error = track.position - truth
    return error, normalised_squares(error, track.covariance[:, :2, :2])


def _wandering(rng: np.random.Generator, count: int, size: float, d: int) -> FloatArray:
    """Return a smooth way about the origin."""
    part = np.arange(count) / count
    way = np.zeros((count, d))
    for axis in range(d):
        for k in (1, 2, 3):
            height = 0.35 * size / k * rng.standard_normal()
            way[:, axis] += height * np.sin(2 * np.pi * (0.7 * k * part + rng.random()))
    if d == 3:
        way[:, 2] = 0.2 * way[:, 2] + 400.0
    return way


def turning(rate: float) -> FloatArray:
    """Return 60 instants of a level turn from the same place with the same first heading."""
    chord = 20.0 * INSTANTS * np.sinc(rate * INSTANTS / (2 * np.pi))
    heading = 0.5 - rate * INSTANTS / 2
    moved = [chord * np.cos(heading), chord * np.sin(heading), np.zeros(len(INSTANTS))]
    turned: FloatArray = track()[0] + np.column_stack(moved)
    return turned


def circling(radius: float) -> FloatArray:
    """Return 60 instants of a circle round the first station at 20 m/s."""
    phase = 20.0 / radius * INSTANTS
    moved = [radius * np.sin(phase), radius * np.cos(phase), np.full(len(INSTANTS), 300.0)]
    circle: FloatArray = PLACES[0] + np.column_stack(moved)
    return circle


def paper_track(instants: npt.NDArray[np.int64]) -> FloatArray:
    """Return the track of the paper's figure 2."""
    j = instants - 49.0
    north = 0.1 * j**4 + 1.6 * j**2 + 100.4 * j + 791.2
    return np.column_stack([np.full(len(j), 1000.0), north, 10.0 * instants])


def claims() -> str:
    """Tabulate errors of both orders, with those of an independent simulation."""
    cases: list[tuple[str, FloatArray, int, str]] = [
        (
            f"the paper's, instants {first} to {last}",
            paper_track(np.arange(first, last + 1)),
            window,
            "4.5 to 5.2",
        )
        for first, last, window in ((47, 56, 9), (40, 59, 13), (40, 60, 13), (40, 61, 13))
    ]
    cases += [
        (f"turn, {rate} rad/s", turning(rate), 13, "1.02 to 1.13")
        for rate in (0.005, 0.01, 0.02, 0.05)
    ]
    cases += [
        (f"circle round a station, {radius:.0f} m", circling(radius), 13, "0.83")
        for radius in RADII
    ]
    rows = []
    for name, truth, window, independent in cases:
        fixes, space, time = _orders(truth, window, "adaptive")
        errors = [f"{np.sqrt(np.mean(squares)):.2f}" for squares in (fixes, space, time)]
        _, *fixed = _orders(truth, window, ONE_DEGREE)
        ratios = [_ratio(time, space), _ratio(fixed[1], fixed[0])]
        rows.append([name, str(window), *errors, ratios[0], independent, ratios[1]])
    return markdown(
        [
            "track",
            "window",
            "not smoothed, m",
            "A, m",
            "B, m",
            "B over A",
            "independent",
            f"B over A, degree {ONE_DEGREE}",
        ],
        rows,
    )


def _orders(truth: FloatArray, window: int, degree: int | str) -> tuple[FloatArray, ...]:
    """Return mean squared errors of every run: not smoothed, space first, time first."""
    squares = []
    for run in range(CLAIM_RUNS):
        measured = _named(measure(truth, generator(94, run)))
        options: dict[str, Any] = {
            "spatial": "least-squares",
            "smoother": "local-polynomial",
            "window": window,
            "degree": degree,
        }
        times = np.arange(len(truth))
        space = reconstruct(network(), times, **measured, **options)
        time = reconstruct(network(), times, **measured, **options, order="temporal-first")
        found = (space.fixes.position, space.position, time.position)
        squares.append([_mean_square(position, truth, slice(None)) for position in found])
    return tuple(np.array(squares).T)


def _ratio(above: FloatArray, below: FloatArray) -> str:
    """Return the ratio of root mean squares, with its standard error from paired runs."""
    ratio = float(np.sqrt(np.mean(above) / np.mean(below)))
    relative = above / np.mean(above) - below / np.mean(below)
    error = ratio / 2 * float(np.std(relative)) / np.sqrt(len(relative))
    return f"{ratio:.3f} ± {error:.3f}"


def windows() -> str:
    """Tabulate the window with the least error near faults, by turn, noise and number of faults."""
    rows = []
    for rate, noise in WINDOW_CASES:
        truth = turning(rate)
        cells = []
        for number in GROUPS:
            errors = _window_errors(truth, noise, number)
            at = int(np.argmin(errors))
            window = int(WINDOWS[at])
            more = "≥ " if window == WINDOWS[-1] else ""
            loss = errors[WINDOWS == 13][0] / errors[at]
            cells.append(f"{more}{window}; {more}{window / number:.1f}; {loss:.2f}")
        rows.append([f"{rate:g} rad/s", f"{noise * SIGMA_R:g} m", *cells])
    head = ["turn", "σ of ranges", *(f"{number} same" for number in GROUPS)]
    return markdown(head, rows)


def _window_errors(truth: FloatArray, noise: float, number: int) -> FloatArray:
    """Return root mean square errors near faults for every window."""
    sigmas = noise * SIGMA_R, noise * SIGMA_A
    near = slice(FIRST - MARGIN, FIRST + number + MARGIN)
    squares = []
    for run in range(WINDOW_RUNS):
        measured = measure(truth, generator(95, run), PLACES, *sigmas)
        measured["range"][FIRST : FIRST + number, 0] += 5 * sigmas[0]
        fixes = locate(network(PLACES, *sigmas), method="least-squares", **_named(measured))
        variances = fixes.sigma.T**2
        squares.append(
            [
                _mean_square(
                    local_polynomial(fixes.position.T, int(window), variance=variances).value.T,
                    truth,
                    near,
                )
                for window in WINDOWS
            ]
        )
    errors: FloatArray = np.sqrt(np.mean(squares, axis=0))
    return errors


def groups() -> str:
    """Tabulate what is left of a run of faults in the middle of it."""
    methods = {name: options for name, (options, _) in METHODS.items()}
    truth = track()
    clean = [measure(truth, generator(97, run)) for run in range(RUN_RUNS)]
    before = {name: _reconstructed_all(clean, options) for name, options in methods.items()}
    rows: dict[str, list[str]] = {name: [name] for name in methods}
    plain = "least squares, RTS"
    for length in RUN_LENGTHS:
        middle = FIRST + length // 2
        wrong = [_with_run(measured, length) for measured in clean]
        after = {name: _reconstructed_all(wrong, options) for name, options in methods.items()}
        pairs = zip(after[plain], before[plain], strict=True)
        moved = np.array([(new.fixes.position - old.fixes.position)[middle] for new, old in pairs])
        for name in methods:
            pairs = zip(after[name], before[name], strict=True)
            left = np.array([(new.position - old.position)[middle] for new, old in pairs])
            rows[name].append(f"{np.sum(left * moved) / np.sum(moved**2):.0%}")
    return markdown(["", *map(str, RUN_LENGTHS)], rows.values())


def _reconstructed_all(
    measured: list[dict[Kind, FloatArray]], options: dict[str, Any]
) -> list[Trajectory]:
    return [reconstructed(one, **options) for one in measured]


def _with_run(measured: dict[Kind, FloatArray], length: int) -> dict[Kind, FloatArray]:
    """Return the measurements with a run of faults of the first station's range."""
    wrong = measured["range"].copy()
    wrong[FIRST : FIRST + length, 0] += 5 * SIGMA_R
    return {**measured, "range": wrong}


def decoded() -> str:
    """Tabulate the paper's figure 2 beside what follows from its track, and the default."""
    truth = paper_track(PAPER_INSTANTS)
    ideal = np.linalg.norm(truth - PLACES[0], axis=-1)
    places = np.vstack([PLACES[:1], PAPER_ADDED])
    left, squares, claimed, normalised = [], [], [], []
    for run in range(PAPER_RUNS):
        measured = measure(truth, generator(96, run), places, PAPER_SIGMA)
        measured["range"][:, 0] = REAL_R
        found = reconstruct(network(places, PAPER_SIGMA), PAPER_INSTANTS, **_named(measured))
        covariance, error = found.covariance[:, :3, :3], found.position - truth
        left.append(np.asarray(found.outlier.range)[:, 0])
        squares.append(np.sum(error**2, axis=-1))
        claimed.append(np.sum(found.sigma**2, axis=-1))
        normalised.append(normalised_squares(error, covariance) / 3)
    rms, sigma = (np.sqrt(np.mean(values, axis=0)) for values in (squares, claimed))
    rows = [
        [
            str(instant),
            f"{truth[i, 1]:.1f}",
            f"{IDEAL_R[i]:.4f}",
            f"{ideal[i]:.4f}",
            f"{REAL_R[i]:.4f}",
            f"{(REAL_R[i] - ideal[i]) / PAPER_SIGMA:+.2f}",
            "–" if np.isnan(SMOOTH_R[i]) else f"{SMOOTH_R[i] - ideal[i]:+.1f}",
            f"{np.linalg.norm(FINAL[i] - truth[i]):.1f}",
            f"{np.mean(left, axis=0)[i]:.0%}",
            f"{rms[i]:.1f} ({sigma[i]:.1f})",
            f"{np.mean(normalised, axis=0)[i]:.2f}",
        ]
        for i, instant in enumerate(PAPER_INSTANTS)
    ]
    return markdown(
        [
            "i",
            "y",
            "Ideal_R",
            "computed",
            "Real_R",
            "error / σ",
            "error of Smooth_R",
            "error of Final",
            "left out",
            "default: RMSE, m (claimed σ, m)",
            "NEES per axis",
        ],
        rows,
    )


def track_figure() -> Figure:
    """Draw the trajectory of the example, with an echo and a misaligned station."""
    stations, found = make_stations.sites(), make_stations.measurements()
    track = reconstruct(
        stations,
        make_stations.times(),
        range=found["range_m"],
        azimuth=np.radians(found["azimuth_deg"]),
        elevation=np.radians(found["elevation_deg"]),
        bias=Bias(azimuth_sigma=None),
    )
    figure = Figure(figsize=(10, 7.5), layout="constrained")
    plot.trajectory(stations, track, figure=figure)
    return figure
