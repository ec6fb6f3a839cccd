"""`tertia evaluate`: tracks against the truth."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import polars as pl
import typer

from tertia.cli import _tables
from tertia.cli._judged import read_pair
from tertia.cli._options import PlotFile, RequiredPeriod, TargetDistance, check_judging, pair
from tertia.cli._terminal import WRONG_USAGE, fail, note, print_table, shown, working
from tertia.metrics import Truth
from tertia.metrics._evaluation import (
    PARTS,
    Judged,
    Rows,
    figures,
    judge,
    rmse,
    usual_periods,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

EXAMPLES = (
    "tertia evaluate tracks.csv --truth truth.csv",
    "tertia evaluate tracks.parquet --truth truth.csv --period 4 --output figures.json",
    "tertia evaluate tracks.csv --truth truth.csv --targets targets.csv --plot errors.png",
)
_KEPT, _WRONG, _TRUE = "#0072B2", "#D55E00", "0.6"


def evaluate(
    tracks: Annotated[
        Path,
        typer.Argument(
            metavar="TRACKS", readable=False, help="Tracks, as tertia track writes them."
        ),
    ],
    *,
    truth: Annotated[
        Path,
        typer.Option(
            metavar="FILE",
            readable=False,
            help="The truth: time_s, target, east_m, north_m; ASTERIX.",
        ),
    ],
    origin: Annotated[
        str | None,
        typer.Option(
            metavar="LATITUDE,LONGITUDE",
            help="Where east and north of the tracks are zero, for a truth in degrees.",
        ),
    ] = None,
    period: RequiredPeriod = None,
    distance: TargetDistance = 1000.0,
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write the figures as .csv, .parquet, .arrow, .jsonl or .json."
        ),
    ] = None,
    targets: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write one row per target.")
    ] = None,
    plot_file: PlotFile = None,
) -> dict[str, Any]:
    """Judge tracks by the truth: how often, how well, and how many false ones.

    Confirmed tracks count, and of them the rows with a plot. Between its times a target flies
    straight; before its first and after its last it is not there.
    """
    check_judging(distance, period)
    _tables.check_suffixes(output, plot_file, targets)
    place = None if origin is None else pair(origin, "--origin", float)
    rows, real = read_pair(tracks, truth, place)
    usual = usual_periods(rows)
    if period is None and not usual:
        fail(f"no track of {tracks} has two updates by a radar: give --period", WRONG_USAGE)
    required = usual[0] if period is None else period
    periods = required, max([required, *usual])
    with working("Judging the tracks"):
        judged = _judge(rows, real, periods, distance)

    told = _table(judged, required)
    print_table(told, shown, text=["figure", "unit"], limited="figures are shown")
    if not np.any(judged.indicators.matching.matched):
        note(f"no track is within {distance:g} m of a target: are the origins the same?")
    if output is not None:
        _tables.write(told, output)
    if targets is not None:
        _tables.write(_by_target(judged), targets)
    if plot_file is not None:
        _draw(judged, plot_file)
    return {"figures": told.to_dicts()}


def _judge(rows: Rows, truth: Truth, periods: tuple[float, float], distance: float) -> Judged:
    try:
        return judge(rows, truth, periods, distance)
    except np.linalg.LinAlgError:
        fail("a covariance of the tracks is not positive definite")
    except ValueError as error:
        fail(str(error))


def _table(judged: Judged, period: float) -> pl.DataFrame:
    columns: dict[str, Any] = {"figure": pl.String, "value": pl.Float64, "unit": pl.String}
    return pl.DataFrame(figures(judged, period), columns, orient="row", strict=False)


def _by_target(judged: Judged) -> pl.DataFrame:
    told, matching = judged.indicators, judged.indicators.matching
    rows = []
    for k, name in enumerate(judged.truth.targets.tolist()):
        own = matching.target == k
        expected = int(told.expected_updates[k])
        missed = int(told.missed_updates[k])
        rows.append(
            {
                "target": name,
                "updates": int(np.sum(own)),
                "tracks": len(np.unique(judged.rows.track[judged.rows.updated][own])),
                "switches": int(matching.switches[k]),
                "probability_of_update": (expected - missed) / expected if expected else None,
                "latency_s": float(told.latency[k]),
                "rmse_m": rmse(np.hypot(*matching.error[own].T)),
                "rmse_along_m": rmse(judged.along[own]),
                "rmse_across_m": rmse(judged.across[own]),
            }
        )
    return pl.DataFrame(rows).with_columns(pl.col("latency_s").fill_nan(None))


def _draw(judged: Judged, path: Path) -> None:
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import

    figure = Figure(figsize=(13.0, 7.0), layout="constrained")
    panels = figure.subplot_mosaic([["plan", "gospa"], ["plan", "errors"]])
    _draw_plan(panels["plan"], judged)
    for name, values, line in zip(PARTS, judged.gospa.T, ("-", ":", "--", "-."), strict=True):
        panels["gospa"].plot(judged.instants, values, line, linewidth=1, label=name)
    panels["gospa"].set(ylabel="GOSPA and roots of its parts (m)", ylim=(0.0, None))
    for label, values, mark in (("along", judged.along, "."), ("across", judged.across, "x")):
        panels["errors"].plot(judged.time, values, mark, markersize=3, label=label)
    panels["errors"].set(xlabel="time (s)", ylabel="error (m)")
    panels["errors"].sharex(panels["gospa"])
    for ax in panels.values():
        ax.legend(fontsize="small")
    _tables.save(figure, path)


def _draw_plan(ax: "Axes", judged: Judged) -> None:
    rows, matched = judged.rows, judged.indicators.matching.matched
    for k, (_, _, position) in enumerate(judged.truth):
        ax.plot(*position.T / 1e3, color=_TRUE, linewidth=3, label="_truth" if k else "truth")
    places = rows.position[rows.updated] / 1e3
    for chosen, colour, mark, label in (
        (matched, _KEPT, ".", "update"),
        (~matched, _WRONG, "x", "shows no target"),
    ):
        if np.any(chosen):
            ax.plot(*places[chosen].T, mark, color=colour, markersize=3, label=label)
    ax.set(
        title=f"probability of update {judged.indicators.probability_of_update:.3f}, "
        f"RMSE {judged.indicators.rmse:.3g} m",
        xlabel="east (km)",
        ylabel="north (km)",
    )
    ax.set_aspect("equal", adjustable="datalim")
