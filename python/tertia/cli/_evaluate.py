"""`tertia evaluate`: tracks against the truth."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import polars as pl
import typer

from tertia import metrics
from tertia._arrays import FloatArray
from tertia.cli import _tables
from tertia.cli._judged import Rows, Truth, gospa, read_pair, usual_periods
from tertia.cli._options import PlotFile, pair
from tertia.cli._terminal import WRONG_USAGE, fail, note, print_table, shown, working

if TYPE_CHECKING:
    from matplotlib.axes import Axes

EXAMPLES = (
    "tertia evaluate tracks.csv --truth truth.csv",
    "tertia evaluate tracks.parquet --truth truth.csv --period 4 --output figures.json",
    "tertia evaluate tracks.csv --truth truth.csv --targets targets.csv --plot errors.png",
)
# 95 % of chi-squared with two degrees of freedom
_MOST_NEES = 5.991464547107979
_KEPT, _WRONG, _TRUE = "#0072B2", "#D55E00", "0.6"
_PARTS = ("GOSPA", "localisation", "missed", "false")


@dataclass(frozen=True, slots=True)
class _Judged:
    """Tracks, the truth, and what was found."""

    rows: Rows
    truth: Truth
    told: metrics.Surveillance
    along: FloatArray
    across: FloatArray
    nees: FloatArray | None
    instants: FloatArray
    gospa: FloatArray

    @property
    def time(self) -> FloatArray:
        """Times of the updates."""
        return self.rows.time[self.rows.updated]


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
    period: Annotated[
        float | None,
        typer.Option(
            help="Seconds between updates that are required; by default those of the fastest radar."
        ),
    ] = None,
    distance: Annotated[
        float, typer.Option(help="A track farther from a target does not show it, in metres.")
    ] = 1000.0,
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
) -> None:
    """Judge tracks by the truth: how often, how well, and how many false ones.

    Confirmed tracks count, and of them the rows with a plot. Between its times a target flies
    straight; before its first and after its last it is not there.
    """
    if not 0 < distance < np.inf:
        fail(f"--distance is {distance:g}; it must be a positive number", WRONG_USAGE)
    if period is not None and not 0 < period < np.inf:
        fail(f"--period is {period:g}; it must be a positive number", WRONG_USAGE)
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

    told = _figures(judged, required)
    print_table(told, shown, text=["figure", "unit"], limited="figures are shown")
    if not np.any(judged.told.matching.matched):
        note(f"no track is within {distance:g} m of a target: are the origins the same?")
    if output is not None:
        _tables.write(told, output)
    if targets is not None:
        _tables.write(_by_target(judged), targets)
    if plot_file is not None:
        _draw(judged, plot_file)


def _judge(rows: Rows, truth: Truth, periods: tuple[float, float], distance: float) -> _Judged:
    updated = rows.updated
    try:
        told = metrics.surveillance(
            rows.time[updated],
            rows.track[updated],
            rows.position[updated],
            truth_time=truth.time,
            target=truth.target,
            truth_position=truth.position,
            period=periods[0],
            distance=distance,
        )
    except ValueError as error:
        fail(str(error))
    matching = told.matching
    course = truth.course(matching.target, rows.time[updated])
    along, across = metrics.track_errors(matching.error, course)
    nees = None
    if rows.covariance is not None:
        try:
            nees = np.asarray(metrics.nees(matching.error, rows.covariance[updated]))
        except np.linalg.LinAlgError:
            fail("a covariance of the tracks is not positive definite")
    instants, parts = gospa(rows, truth, periods, distance)
    return _Judged(rows, truth, told, np.asarray(along), np.asarray(across), nees, instants, parts)


def _figures(judged: _Judged, period: float) -> pl.DataFrame:
    told, truth = judged.told, judged.truth
    latency = told.latency[~np.isnan(told.latency)]
    confirmed = len(np.unique(judged.rows.track))
    mean = judged.gospa[:, 0].mean()
    roots = np.sqrt(np.mean(judged.gospa[:, 1:] ** 2, axis=0))
    figures: list[tuple[str, float | None, str]] = [
        ("targets", len(truth.names), ""),
        ("missed targets", told.missed_targets, ""),
        ("tracks", confirmed, ""),
        ("false tracks", told.false_tracks, ""),
        ("false updates", told.false_updates, ""),
        ("identity switches", told.switches, ""),
        ("update period", period, "s"),
        ("probability of update", told.probability_of_update, ""),
        ("share missed in long gaps", told.long_gap_ratio, ""),
        ("latency, median", _or_none(np.median, latency), "s"),
        ("latency, largest", _or_none(np.max, latency), "s"),
        ("RMSE", told.rmse, "m"),
        ("RMSE along track", _rmse(judged.along), "m"),
        ("RMSE across track", _rmse(judged.across), "m"),
        ("GOSPA, mean", mean, "m"),
        *((f"GOSPA, {name}", value, "m") for name, value in zip(_PARTS[1:], roots, strict=True)),
    ]
    if judged.nees is not None:
        known = judged.nees[~np.isnan(judged.nees)]
        figures += [
            ("NEES per axis", _or_none(np.mean, known / 2), ""),
            ("share within the 95 % ellipse", _or_none(np.mean, known <= _MOST_NEES), ""),
        ]
    columns: dict[str, Any] = {"figure": pl.String, "value": pl.Float64, "unit": pl.String}
    table = pl.DataFrame(figures, columns, orient="row", strict=False)
    return table.with_columns(pl.col("value").fill_nan(None))


def _or_none(of: Any, values: Any) -> float | None:
    return float(of(values)) if len(values) else None


def _rmse(errors: FloatArray) -> float | None:
    known = errors[~np.isnan(errors)]
    return float(metrics.rmse(known)) if known.size else None


def _by_target(judged: _Judged) -> pl.DataFrame:
    told, matching = judged.told, judged.told.matching
    rows = []
    for k, name in enumerate(judged.truth.names):
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
                "rmse_m": _rmse(np.hypot(*matching.error[own].T)),
                "rmse_along_m": _rmse(judged.along[own]),
                "rmse_across_m": _rmse(judged.across[own]),
            }
        )
    return pl.DataFrame(rows).with_columns(pl.col("latency_s").fill_nan(None))


def _draw(judged: _Judged, path: Path) -> None:
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import

    figure = Figure(figsize=(13.0, 7.0), layout="constrained")
    panels = figure.subplot_mosaic([["plan", "gospa"], ["plan", "errors"]])
    _draw_plan(panels["plan"], judged)
    for name, values, line in zip(_PARTS, judged.gospa.T, ("-", ":", "--", "-."), strict=True):
        panels["gospa"].plot(judged.instants, values, line, linewidth=1, label=name)
    panels["gospa"].set(ylabel="GOSPA and roots of its parts (m)", ylim=(0.0, None))
    for label, values, mark in (("along", judged.along, "."), ("across", judged.across, "x")):
        panels["errors"].plot(judged.time, values, mark, markersize=3, label=label)
    panels["errors"].set(xlabel="time (s)", ylabel="error (m)")
    panels["errors"].sharex(panels["gospa"])
    for ax in panels.values():
        ax.legend(fontsize="small")
    _tables.save(figure, path)


def _draw_plan(ax: "Axes", judged: _Judged) -> None:
    rows, matched = judged.rows, judged.told.matching.matched
    for k, _, position in judged.truth.along():
        ax.plot(*position.T / 1e3, color=_TRUE, linewidth=3, label="_truth" if k else "truth")
    places = rows.position[rows.updated] / 1e3
    for chosen, colour, mark, label in (
        (matched, _KEPT, ".", "update"),
        (~matched, _WRONG, "x", "shows no target"),
    ):
        if np.any(chosen):
            ax.plot(*places[chosen].T, mark, color=colour, markersize=3, label=label)
    ax.set(
        title=f"probability of update {judged.told.probability_of_update:.3f}, "
        f"RMSE {judged.told.rmse:.3g} m",
        xlabel="east (km)",
        ylabel="north (km)",
    )
    ax.set_aspect("equal", adjustable="datalim")
