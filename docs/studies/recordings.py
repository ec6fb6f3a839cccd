"""Coverage of the error bars on recordings, which do not belong to the project."""

import csv
import gzip
import json
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from studies.montecarlo import WITHIN_95, FloatArray, normalised_squares
from studies.pages import DATA, markdown, table_of
from tertia.location import Location, locate
from tertia.sensors import Station
from tertia.trajectory import Trajectory, reconstruct

# of the sonobuoys in degrees, of the anchors of the radio tags in metres
BEARING_SIGMAS, RANGE_SIGMA = (3.0, 5.0, 8.0), 0.15
# metres a degree at 32.8 degrees north
DEGREE, ORIGIN = np.array([93_570.0, 110_920.0]), np.array([-117.588, 32.818])
BUOYS = ("NW", "NE", "SW", "SE")
# of a ship's lidar, radar and two cameras: metres and degrees
SHIP_SIGMAS = ((2.0, 2.0), (5.0, 3.0), (None, 2.0), (None, 2.0))
# a detection is that of a boat within so many metres, or degrees where there is no range
GATES = 25.0, 10.0
RUNS = ("LOS_A1", "LOS_A2")
# ranges come in rounds of a tenth of a second
ROUND = 0.1


def table() -> str:
    """Tabulate errors against the truth; without the recordings, the table is that of the page."""
    if not all((DATA / name).is_dir() for name in ("difar", "uwb_ranges", "autoferry", "lenth")):
        return table_of("honesty.md", "recordings")
    rows = [*_sonobuoys()]
    for run in RUNS:
        rows += _radio_tag(run)
    rows += [*_boats(), _animal()]
    head = ["recording", "positions", "p50, m", "p90, m", "p99, m"]
    head += ["inside 95 %", "NEES per axis"]
    return markdown(head, rows)


def _sonobuoys() -> Iterable[list[str]]:
    """Yield tracks of a boat among four drifting direction finders, where three heard it."""
    with (DATA / "difar" / "bearings.csv").open() as file:
        rows = list(csv.DictReader(file))
    calls = {key: i for i, key in enumerate(dict.fromkeys(row["call_id"] for row in rows))}
    places = np.full((len(calls), len(BUOYS), 2), np.nan)
    azimuth = np.full(places.shape[:2], np.nan)
    time, truth = np.full(len(calls), np.inf), np.full((len(calls), 2), np.nan)
    for row in rows:
        at, buoy = calls[row["call_id"]], BUOYS.index(row["buoy"])
        places[at, buoy] = DEGREE * (_pair(row, "buoy_lon", "buoy_lat") - ORIGIN)
        truth[at] = DEGREE * (_pair(row, "boat_lon", "boat_lat") - ORIGIN)
        azimuth[at, buoy] = np.radians(float(row["bearing_deg"] or "nan"))
        time[at] = min(time[at], float(row["t_s"] or "inf"))
    for column in np.moveaxis(places, 0, -1).reshape(-1, len(calls)):
        known = ~np.isnan(column)
        column[:] = np.interp(time, time[known], column[known])
    enough = np.sum(~np.isnan(azimuth), axis=-1) >= 3
    for sigma in BEARING_SIGMAS:
        stations = [
            Station(places[:, k], azimuth_sigma=np.radians(sigma)) for k in range(len(BUOYS))
        ]
        track = reconstruct(stations, time, azimuth=azimuth)
        yield [f"sonobuoys, track, σ = {sigma:g}°", *_against(track, truth, enough)]


def _radio_tag(run: str) -> Iterable[list[str]]:
    """Yield the track and the single positions of a tag among four anchors."""
    with gzip.open(DATA / "uwb_ranges" / "ranges.csv.gz", "rt") as file:
        rows = [row for row in csv.DictReader(file) if row["run"] == run and row["true_x_m"]]
    rows.sort(key=lambda row: float(row["t_s"]))
    anchors = {row["anchor"]: _pair(row, "ax_m", "ay_m") for row in rows}
    names = sorted(anchors)
    time = np.array([float(row["t_s"]) for row in rows])
    number, instant = np.unique(np.round((time - time[0]) / ROUND), return_inverse=True)
    ranges = np.full((len(number), len(names)), np.nan)
    ranges[instant, [names.index(row["anchor"]) for row in rows]] = [
        float(row["range_m"]) for row in rows
    ]
    count = np.bincount(instant)

    def mean(values: npt.ArrayLike) -> FloatArray:
        """Return the mean of each round."""
        return np.asarray(np.bincount(instant, values) / count)

    truth = np.column_stack(
        [mean([float(row[axis]) for row in rows]) for axis in ("true_x_m", "true_y_m")]
    )
    stations = [Station(anchors[name], range_sigma=RANGE_SIGMA) for name in names]
    track = reconstruct(stations, mean(time), range=ranges)
    yield [f"radio tag {run}, track", *_against(track, truth)]
    yield [f"radio tag {run}, instants", *_against(locate(stations, range=ranges), truth)]


def _boats() -> Iterable[list[str]]:
    """Yield positions of two boats from lidar, radar and cameras of a ship, twice a second."""
    plots, truths = (
        json.loads((DATA / "autoferry" / f"scenario2_{name}.json").read_text("utf-8"))
        for name in ("detections", "groundTruth")
    )
    for boat in (1, 2):
        known = {row["time"]: row["position"] for at in truths for row in at
                 if row["targetID"] == boat}  # fmt: skip
        times = np.array(sorted(known))
        path = np.array([known[time] for time in times])
        shape = (int(2 * (times[-1] - times[0])) + 1, len(SHIP_SIGMAS))
        # time, place of the ship and of the boat (north, east), range, azimuth
        rows = np.full((*shape, 7), np.nan)
        for plot in plots:
            at, sensor = int(2 * (plot["time"] - times[0])), plot["sensorID"] - 1
            if not 0 <= at < len(rows) or not np.isnan(rows[at, sensor, 0]):
                continue
            place = np.array(plot["ownshipPosition"])
            truth = np.array([np.interp(plot["time"], times, path[:, axis]) for axis in (0, 1)])
            polar = _nearest(plot["measurement"], truth - place, sensor < 2)
            if polar is not None:
                rows[at, sensor] = plot["time"], *place, *truth, *polar
        rows = rows[np.isfinite(rows[..., 5]).any(axis=1)]
        middle = np.nanmean(rows[..., 1:5], axis=1)
        places = np.where(np.isnan(rows[..., 1:3]), middle[:, np.newaxis, :2], rows[..., 1:3])
        stations = [
            Station(places[:, k, ::-1], range_sigma=far, azimuth_sigma=np.radians(angle))
            for k, (far, angle) in enumerate(SHIP_SIGMAS)
        ]
        found = locate(stations, range=rows[..., 5], azimuth=rows[..., 6])
        yield [f"boat {boat} from a ship, instants", *_against(found, middle[:, :1:-1])]


def _nearest(measured: npt.ArrayLike, truth: FloatArray, is_position: bool) -> FloatArray | None:
    """Return range and azimuth of what was detected of a boat, if anything was."""
    values = np.asarray(measured, dtype=float)
    if values.size == 0:
        return None
    azimuth = np.arctan2(truth[1], truth[0])
    if is_position:
        values = values.reshape(2, -1)
        off = np.hypot(*(values - truth[:, np.newaxis]))
        north, east = values[:, np.argmin(off)]
        polar, gate = np.array([np.hypot(north, east), np.arctan2(east, north)]), GATES[0]
    else:
        off = np.abs(np.degrees(np.angle(np.exp(1j * (values.reshape(-1) - azimuth)))))
        polar, gate = np.array([np.nan, values.reshape(-1)[np.argmin(off)]]), GATES[1]
    return polar if np.min(off) < gate else None


def _animal() -> list[str]:
    """Return fixes of an animal by three of eight towers against those published with them."""
    towers = np.loadtxt(DATA / "lenth" / "towers.dat", delimiter=",")
    lines = (DATA / "lenth" / "fixes.dat").read_bytes().decode().replace("\r", " ").split("\n")
    azimuth, published = [], []
    for line in lines:
        fields = line.split()
        # what does not fit into its column is printed as stars, no fix as 0
        if "*" in line or len(fields) != 18 or float(fields[10]) == 0.0:
            continue
        row = np.full(len(towers), np.nan)
        row[[int(tower) - 1 for tower in fields[4:10:2]]] = [float(v) for v in fields[5:10:2]]
        azimuth.append(row)
        published.append([float(value) for value in fields[10:12]])
    found = locate(towers, azimuth=azimuth, degrees=True, pooled=True)
    return ["animal, instants, `pooled`", *_against(found, np.array(published))]


def _pair(row: dict[str, str], first: str, second: str) -> FloatArray:
    return np.array([float(row[first]), float(row[second])])


def _against(
    found: Trajectory | Location, truth: FloatArray, which: npt.NDArray[np.bool_] | bool = True
) -> list[str]:
    """Return the number of positions, percentiles of their errors, coverage and NEES."""
    known = np.isfinite(found.position).all(axis=-1) & which
    error = (found.position - truth)[known]
    covariance = found.covariance[known][:, :2, :2]
    squares = normalised_squares(error, covariance)
    sizes = np.quantile(np.linalg.norm(error, axis=1), [0.5, 0.9, 0.99])
    cells = [f"{len(error)}", *(f"{size:.3g}" for size in sizes)]
    return [*cells, f"{np.mean(squares < WITHIN_95[2]):.0%}", f"{np.mean(squares) / 2:.2f}"]


def fireball() -> str:
    """Tabulate how far the published line of a fireball is from the sights it was made of."""
    files = sorted((DATA / "dfn_fireball").glob("*.ecsv"))
    if not files:
        return table_of("honesty.md", "fireball")
    rows = []
    for file in files:
        lines = [line for line in file.read_text("utf-8").splitlines() if not line.startswith("#")]
        points = list(csv.DictReader(lines))
        columns = ("cross_track_error", "range", "err_plus_altitude")
        off, distance, sigma = (np.array([float(row[name]) for row in points]) for name in columns)
        known = np.isfinite(off)
        off, distance = np.abs(off[known]), distance[known]
        stated = np.radians(sigma[known]) * distance
        rows.append([
            file.name[:2], f"{len(off)}", f"{np.median(distance) / 1000:.0f}",
            *(f"{size:.0f}" for size in (np.median(stated), np.median(off), np.max(off))),
            f"{np.sqrt(np.mean(np.square(off / stated))):.2f}",
        ])  # fmt: skip
    head = ["camera", "points", "distance, km", "stated σ, m"]
    head += ["distance from the line, m: median", "largest, m", "RMS in σ"]
    return markdown(head, rows)
