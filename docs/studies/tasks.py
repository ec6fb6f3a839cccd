"""Whether the answers of ten users hold: the commands of the how-to pages on other scenes."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl
import scenes
from typer.testing import CliRunner

from studies.montecarlo import WITHIN_95, generator, in_region
from studies.pages import markdown, repetitions
from tertia import cli
from tertia.kalman import SingerModel, fit_noise, smooth_series

FloatArray = npt.NDArray[np.float64]
# of one truth, and of many
ALONE, SCENES = repetitions(200, least=1), repetitions(40, least=1)
PLACES = ("longitude_deg", "latitude_deg")
ORIGINS = {"misaligned": "50.0,14.0", "periods": "50.1,14.26"}


def run(folder: Path, *words: object) -> pl.DataFrame:
    """Return what a command writes; where names of files stand, they are in the folder."""
    output = folder / "out.csv"
    named = [folder / str(word) if (folder / str(word)).is_file() else word for word in words]
    done = CliRunner().invoke(cli.app, [*map(str, named), "--output", str(output)])
    if done.exit_code:
        raise RuntimeError(done.output)
    return pl.read_csv(output, infer_schema_length=None, try_parse_dates=True)


def inside(found: pl.DataFrame, true: Iterable[Any], suffix: str = "") -> FloatArray:
    """Return which true places are in the ellipses of 95 % of positions that were found."""
    named = [name.replace("_deg", f"{suffix}_deg") for name in PLACES]
    azimuth, _, far = scenes.EARTH.inv(*true, *(found[name].to_numpy() for name in named))
    turn = np.radians(azimuth)
    error = np.asarray(far)[:, np.newaxis] * np.column_stack([np.sin(turn), np.cos(turn)])
    east, north = (found[f"{axis}{suffix}_sigma_m"].to_numpy() for axis in ("east", "north"))
    both = np.zeros(len(found))
    if "covariance_east_north_m2" in found.columns:
        both = found["covariance_east_north_m2"].to_numpy()
    covariance = np.array([[east**2, both], [both, north**2]]).transpose(2, 0, 1)
    return in_region(error, covariance).astype(np.float64)


def located(found: pl.DataFrame) -> pl.DataFrame:
    """Return the rows with a position."""
    return found.filter(pl.all_horizontal(pl.col(*PLACES, "east_sigma_m").is_not_null()))


def interpolated(found: pl.DataFrame, truth: pl.DataFrame) -> list[FloatArray]:
    """Return where a target was at the times of its positions."""
    times = [
        frame["time_s"].dt.epoch("ms") if frame["time_s"].dtype.is_temporal() else frame["time_s"]
        for frame in (found, truth)
    ]
    at, known = (one.to_numpy().astype(np.float64) for one in times)
    return [np.interp(at, known, truth[name].to_numpy()) for name in PLACES]


def emitter(folder: Path, truth: pl.DataFrame) -> FloatArray:
    """Locate an emitter by all bearings."""
    options = ("bearings.csv", "--sensors", "sensors.toml", "--tolerance", "inf")
    found = located(run(folder, "locate", *options))
    return inside(found, [truth[name].to_numpy() for name in PLACES])


def few(folder: Path, truth: pl.DataFrame) -> FloatArray:
    """Locate by twelve of the bearings of each finder."""
    table = pl.read_csv(folder / "bearings.csv").group_by("sensor", maintain_order=True).head(12)
    table.write_csv(folder / "bearings.csv")
    return emitter(folder, truth)


def animal(folder: Path, truth: pl.DataFrame) -> FloatArray:
    """Reconstruct the way of an animal."""
    found = located(run(folder, "reconstruct", "bearings.csv", "--sensors", "sensors.toml"))
    return inside(found, interpolated(found, truth))


def receivers(folder: Path, truth: pl.DataFrame) -> FloatArray:
    """Locate by times of arrival."""
    height = ("--height", 6000, "--height-sigma", 100)
    found = run(folder, "locate", "arrivals.csv", "--sensors", "sensors.toml", *height)
    found = located(found.with_columns(true_x=truth[PLACES[0]], true_y=truth[PLACES[1]]))
    return inside(found, [found["true_x"].to_numpy(), found["true_y"].to_numpy()])


def tracks(name: str, *options: str) -> Callable[[Path, pl.DataFrame], FloatArray]:
    """Return what tracks a scene."""

    def judged(folder: Path, _: pl.DataFrame) -> FloatArray:
        run(folder, "track", "plots.csv", "--sensors", "sensors.toml", *options)
        (folder / "out.csv").rename(folder / "tracks.csv")
        return share_of_updates(folder, name)

    return judged


def share_of_updates(folder: Path, name: str) -> FloatArray:
    """Return the share of the updates of the tracks of a scene that are as accurate as stated."""
    truth = ("--truth", "truth.csv", "--origin", ORIGINS[name])
    found = run(folder, "evaluate", "tracks.csv", *truth)
    figures = dict(found.select("figure", "value").iter_rows())
    return np.array([figures["share within the 95 % ellipse"]])


def live(folder: Path, _: pl.DataFrame) -> FloatArray:
    """Track lines as they come."""
    words = ("track", folder / "plots.csv", "--stream", "--sensors", folder / "sensors.toml")
    done = CliRunner().invoke(cli.app, [*map(str, words)])
    (folder / "tracks.csv").write_text(done.stdout, encoding="utf-8")
    return share_of_updates(folder, "periods")


def flight(folder: Path, truth: pl.DataFrame) -> FloatArray:
    """Smooth a flight."""
    found = run(folder, "smooth", "positions.csv", "--sigma", 20, "--by", "icao_address")
    return inside(found, interpolated(found, truth), "_smoothed")


def groups(folder: Path, truth: pl.DataFrame) -> FloatArray:
    """Estimate a bearing for each finder and quarter of an hour."""
    table = pl.read_csv(folder / "bearings.csv", try_parse_dates=True)
    quarter = pl.col("time_s").dt.minute() // 15
    table.with_columns(quarter=quarter).write_csv(folder / "quarters.csv")
    found = run(folder, "bearing", "quarters.csv", "--by", "sensor", "--by", "quarter")
    sites = pl.read_csv(folder / "sites.csv")
    found = found.join(sites, on="sensor", how="left", maintain_order="left")
    true = [
        scenes.azimuths(latitude, longitude, truth.select(*PLACES[::-1]).to_numpy())[0]
        for latitude, longitude in found.select("latitude_deg", "longitude_deg").iter_rows()
    ]
    error = (found["azimuth_deg"].to_numpy() - np.array(true) + 180.0) % 360.0 - 180.0
    squares = (error / found["azimuth_sigma_deg"].to_numpy()) ** 2
    return np.asarray(squares < WITHIN_95[1], dtype=np.float64)


def ship(folder: Path, truth: pl.DataFrame) -> FloatArray:
    """Smooth a series with gaps."""
    seen = pl.read_csv(folder / "azimuths.csv")
    z = np.full(len(truth), np.nan)
    z[np.searchsorted(truth["time_s"], seen["time_s"])] = seen["azimuth_deg"]
    noise = fit_noise(z, dt=10.0, period=360.0)
    model = SingerModel(10.0, float(noise.alpha), float(noise.acceleration_sigma), exact=True)
    found = smooth_series(z, np.asarray(noise.measurement_sigma) ** 2, model, period=360.0)
    error = (found.mean[:, 0] - truth["azimuth_deg"].to_numpy() + 180.0) % 360.0 - 180.0
    known = np.isfinite(error)
    return np.asarray((error[known] / found.sigma[known, 0]) ** 2 < WITHIN_95[1], dtype=np.float64)


# in words, the scene, and what is done with it
TASKS: dict[str, tuple[str, Callable[[Path, pl.DataFrame], FloatArray]]] = {
    "an emitter, 300 bearings of each finder": ("bearings", emitter),
    "an emitter, 12 bearings of each finder": ("bearings", few),
    "an animal over an afternoon": ("telemetry", animal),
    "times of arrival, a faulty receiver": ("arrivals", receivers),
    "two misaligned radars": ("misaligned", tracks("misaligned")),
    "radars with different periods": ("periods", tracks("periods")),
    "the same, live": ("periods", live),
    "a flight from ADS-B with jumps": ("adsb", flight),
    "bearings for each group": ("bearings", groups),
    "a series with gaps, of unknown noise": ("gaps", ship),
}


def table() -> str:
    """Tabulate how many truths are within the errors that are claimed for 95 %."""
    rows = []
    for number, (title, (scene, task)) in enumerate(TASKS.items()):
        shares: list[float] = []
        count = ALONE if task in {emitter, few} else SCENES
        for one in range(count):
            with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                folder = Path(name)
                scenes.SCENES[scene](folder, generator(292, number, one))
                if scene == "bearings":
                    sites(folder)
                truth = pl.read_csv(folder / "truth.csv", try_parse_dates=True)
                shares.append(float(np.mean(task(folder, truth))))
        worst = "" if task in {emitter, few} else f"{np.min(shares):.0%}"
        rows.append([title, str(count), f"{np.mean(shares):.1%}", worst])
    return markdown(["task", "scenes", "true values within 95 %", "in the worst scene"], rows)


def sites(folder: Path) -> None:
    """Write where the finders are as a table."""
    text = (folder / "sensors.toml").read_text(encoding="utf-8")
    cells: list[dict[str, str]] = []
    for line in text.splitlines():
        key, _, value = line.partition(" = ")
        if line.startswith("[["):
            cells.append({})
        elif value:
            cells[-1]["sensor" if key == "name" else key] = value.strip('"')
    frame = pl.DataFrame(cells).with_columns(pl.exclude("sensor").cast(pl.Float64))
    frame.write_csv(folder / "sites.csv")
