"""Tracks of a recording in parts versus those of one process: a table of docs/embedding.md."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import cache

import numpy as np
import polars as pl

from studies.montecarlo import generator
from studies.pages import markdown, repetitions
from tertia import tables
from tertia.sensors import Bias, Radar
from tertia.simulate import dense_traffic, radar_plots

OVERLAPS = (0.0, 30.0, 60.0, 300.0, 1200.0)
PART, RECORDINGS = float(repetitions(1800, 320)), repetitions(2, least=1)
PARTS = repetitions(4)
# aircraft that come together, how often some come, and how long they stay, in seconds
FLIGHTS, EVERY, STAY = repetitions(15, 6), 300.0, 1500.0
AREA, REACH, CLUTTER = 120e3, 120e3, float(repetitions(10, 2))
ERRORS = Bias(range=(120.0, -80.0, 60.0), azimuth=np.radians((0.15, -0.1, 0.05)))
# what four in five plots have, and whether radars have errors: with identities, with errors
SCENES = {
    "both identities and heights": (True, False),
    "both, radars off by 120 m, 0.15°": (True, True),
    "heights, radars off by 120 m, 0.15°": (False, True),
}
# seconds after a seam in which positions are compared
AFTER = 60.0
PLACES = ((-40e3, -30e3), (40e3, -30e3), (0.0, 40e3))
RADARS = [
    Radar(place, range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0,
          max_range=REACH, detection_probability=0.9, name=str(k))
    for k, place in enumerate(PLACES)
]  # fmt: skip


@dataclass(frozen=True)
class Difference:
    """Numbers of rows and of tracks over seams, and differences of positions, of one recording."""

    rows: int
    same: int
    over: int
    kept: int
    squares: float
    normalised: float
    compared: int


@cache
def recording(number: int, identities: bool, errors: bool) -> pl.DataFrame:
    """Simulate aircraft that come and go; four in five plots have heights."""
    rng = generator(290, number)
    frames = []
    blocks = round(PARTS * PART / EVERY) + 1
    for block in range(blocks):
        traffic = dense_traffic(FLIGHTS, area=(AREA, AREA), duration=STAY, rng=rng)
        seen = radar_plots(
            traffic,
            RADARS,
            phase=0.0,
            clutter=CLUTTER * EVERY / STAY,
            bias=ERRORS if errors else None,
            height_missing_probability=0.2,
            identity_missing_probability=0.2 if identities else 1.0,
            rng=rng,
        ).plots
        columns = {
            "time_s": seen.time + block * EVERY,
            "range_m": seen.range,
            "azimuth_deg": np.degrees(seen.azimuth),
            "height_m": seen.height,
            "sensor": seen.sensor.astype(str),
            "identity": np.where(seen.identity < 0, -1, seen.identity + block * FLIGHTS),
        }
        frames.append(pl.DataFrame(columns))
    plots = pl.concat(frames).sort("time_s", maintain_order=True).fill_nan(None)
    identity = pl.when(pl.col("identity") >= 0).then("identity")
    plots = plots.with_columns(identity).filter(pl.col("time_s") < PARTS * PART)
    return plots.with_row_index("plot")


def in_parts(plots: pl.DataFrame, overlap: float) -> pl.DataFrame:
    """Return the rows with plots of the tracks of parts, stitched."""
    seams = PART * np.arange(PARTS + 1)
    spans = zip(seams[:-1] - overlap, seams[1:], strict=True)
    parts = (plots.filter(pl.col("time_s").is_between(*span, closed="left")) for span in spans)
    found = pl.concat(tables.stitch(tables.track(part, sensors=RADARS) for part in parts))
    return found.filter(pl.col("plot").is_not_null())


def differences(number: int, identities: bool, errors: bool, overlap: float) -> Difference:
    """Compare the tracks of parts with those of one process, plot by plot."""
    plots = recording(number, identities, errors)
    whole, found = one_process(number, identities, errors), in_parts(plots, overlap)
    both = whole.join(found, on="plot", suffix="_found")
    counts = both.group_by("track", "track_found").len().sort("len", descending=True)
    # the number under which a track of one process has most of its plots
    called = counts.group_by("track", maintain_order=True).agg(pl.col("track_found").first())
    same = both.join(called, on=["track", "track_found"])
    over = kept = 0
    for seam in PART * np.arange(1, PARTS):
        sides = [
            frame.filter(pl.col("time_s").is_between(seam - AFTER, seam + AFTER))
            .group_by(*names)
            .agg(late=(pl.col("time_s") >= seam).mean())
            .filter(pl.col("late").is_between(0.0, 1.0, closed="none"))
            for frame, names in ((whole, ["track"]), (both, ["track", "track_found"]))
        ]
        over += sides[0].height
        kept += sides[1]["track"].n_unique()
    since = (pl.col("time_s") % PART < AFTER) & (pl.col("time_s") >= PART)
    close = both.filter(since)
    squares, spread = np.zeros(close.height), np.zeros(close.height)
    for axis in ("east", "north"):
        squares += ((close[f"{axis}_m"] - close[f"{axis}_m_found"]) ** 2).to_numpy()
        spread += (close[f"{axis}_sigma_m"] ** 2).to_numpy()
    return Difference(
        whole.height, same.height, over, kept,
        float(np.sum(squares)), float(np.sum(squares / spread)), close.height,
    )  # fmt: skip


@cache
def one_process(number: int, identities: bool, errors: bool) -> pl.DataFrame:
    """Return the rows with plots of the tracks of one process."""
    found = tables.track(recording(number, identities, errors), sensors=RADARS)
    return found.filter(pl.col("plot").is_not_null())


def seams() -> str:
    """Tabulate by the overlap what differs from one process."""
    rows = []
    for scene, (identities, errors) in SCENES.items():
        for overlap in OVERLAPS:
            of = [differences(k, identities, errors, overlap) for k in range(RECORDINGS)]
            total = Difference(*np.sum([astuple(one) for one in of], axis=0).tolist())
            rows.append(
                [
                    scene,
                    f"{overlap:.0f} s",
                    f"{100 * total.kept / total.over:.1f} % of {total.over:.0f}",
                    f"{100 * (1 - total.same / total.rows):.2f} %",
                    f"{np.sqrt(total.squares / total.compared):.1f} m",
                    f"{np.sqrt(total.normalised / total.compared):.3f}",
                ]
            )
    head = ["plots", "overlap", "tracks across a boundary that keep their number"]
    head += ["rows in another track or none"]
    head += ["RMS difference of positions in the minute after a boundary", "the same in sigma"]
    return markdown(head, rows)
