"""The common output of `tertia locate` and `tertia reconstruct`."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl
import typer

from tertia import plot
from tertia._result import counted
from tertia.cli.files import maps, write
from tertia.cli.terminal.say import WRONG_USAGE, fail, line, note, print_table
from tertia.location import LIGHT, LocationStatus
from tertia.tables._positions import Located, Positions, reason

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

# groups above which sensors are listed once for all of them, and only the first are described
_MANY_GROUPS = 20
# size of the picture of a target, in inches
FIGURE_SIZE = (11.0, 8.0)
# p-value below which measurements contradict each other
_DOUBTFUL = 1e-3
# share of such instants above which a note is printed: ten times the share expected by chance
_MANY = 0.01


def start(text: str | None, dimension: int) -> list[float] | None:
    """Return the position given by --initial."""
    if text is None:
        return None
    try:
        place = [float(part) for part in text.split(",")]
    except ValueError:
        place = []
    if len(place) != dimension or not np.all(np.isfinite(place)):
        fail(
            f"--initial is {text!r}; it must be {dimension} numbers, one for each coordinate of "
            "the sensors",
            WRONG_USAGE,
        )
    return place


def print_all(
    found: Positions[Any],
    by: Sequence[str],
    said: Sequence[Callable[[Located[Any]], None]],
    speed: float,
) -> None:
    """Print the results of each sensor, and the origin; of many groups those of all together.

    Then print what is `said` of each target, and a note on the speed of the signals.
    """
    many = len(found.targets) > _MANY_GROUPS
    print_table(
        _of_all_groups(found.sensors) if many else found.sensors,
        text=["sensor", "kind"] if many else [*by, "sensor", "kind"],
    )
    if many:
        note(f"sensors of all {len(found.targets)} groups together")
    line(found.stations.origin())
    _say_groups(found.targets, _say_located, *said)
    if speed != LIGHT and all(one.result.propagation_speed is None for one in found.targets):
        note(
            f"the speed of the signals is taken as exactly {speed:g} m/s; if it may be wrong, give "
            "--propagation-speed-sigma, so that the sigmas include its error"
        )


def _of_all_groups(sensors: pl.DataFrame) -> pl.DataFrame:
    """Return one row per sensor and kind, computed from the rows of all groups."""
    kept = pl.col("measurement_count") - pl.col("outlier_count")
    known = kept.filter(pl.col("residual_mean").is_not_null()).sum()
    return sensors.group_by("sensor", "kind", maintain_order=True).agg(
        pl.col("measurement_count", "outlier_count").sum(),
        residual_mean=(pl.col("residual_mean") * kept).sum() / known,
        residual_rms=((pl.col("residual_rms") ** 2 * kept).sum() / known).sqrt(),
    )


def _say_groups(targets: Sequence[Located[Any]], *said: Callable[[Located[Any]], None]) -> None:
    """Print what `said` says of each target, and a summary of those after the first ones."""
    for one in targets[:_MANY_GROUPS]:
        for say in said:
            say(one)
    rest = targets[_MANY_GROUPS:]
    if rest:
        there = [np.isfinite(one.result.position[:, :2]).all(axis=1) for one in rest]
        count = sum(len(one) for one in there)
        known = sum(int(np.sum(one)) for one in there)
        typer.echo(
            f"{counted(len(rest), 'more group')}: {known} of {counted(count, 'instant')} with a "
            "position"
        )


def _say_located(one: Located[Any]) -> None:
    """Print how many instants were located, their median sigma, and why others failed."""
    fixes, sigma = one.fixes, one.result.sigma
    located = np.asarray(fixes.success)
    # azimuths alone do not determine a height
    sigma = np.where(np.isfinite(sigma), sigma, 0.0)[np.isfinite(sigma[:, :2]).all(axis=1)]
    total = np.sqrt(np.sum(sigma**2, axis=1))
    error = f", median sigma {np.median(total):.3g} m" if total.size else ""
    there = np.isfinite(one.result.position[:, :2]).all(axis=1)
    known = np.count_nonzero(there)
    said = f"{np.count_nonzero(located)} of {counted(located.size, 'instant')} located"
    alone = known > np.count_nonzero(located)
    if alone:
        said = f"{known} of {counted(located.size, 'instant')} with a position"
    typer.echo(": ".join(filter(None, [one.target.name, said + error])))
    for number in np.unique(np.asarray(fixes.status)[~located]):
        own = np.asarray(fixes.status) == number
        typer.echo(f"  {_reason(int(number), int(np.sum(own)), int(np.sum(there & own)))}")
    doubtful = (np.asarray(fixes.pvalue) < _DOUBTFUL) & (np.asarray(fixes.outlier.count) == 0)
    if np.sum(doubtful) > _MANY * np.sum(located):
        typer.echo(
            f"  {counted(int(np.sum(doubtful)), 'instant')} with a p-value below {_DOUBTFUL:g} and "
            "no outlier found: a measurement or a sigma is wrong"
        )


def say_speed(one: Located[Any]) -> None:
    """Print the speed of the signals, and the wind, if they were estimated."""
    speed, sigma = one.result.propagation_speed, one.result.propagation_speed_sigma
    if speed is not None:
        typer.echo(f"  speed of signals: {speed:.6g} ± {sigma:.2g} m/s")
    wind, spread = one.result.wind, one.result.wind_covariance
    if wind is not None:
        each = zip(("east", "north"), wind, np.sqrt(np.diagonal(spread)), strict=True)
        parts = [f"{name} {value:.2g} ± {error:.2g} m/s" for name, value, error in each]
        typer.echo(f"  wind: {', '.join(parts)}")


def _reason(status: int, count: int, there: int) -> str:
    """Return why instants were not located; so many of them are still part of a path."""
    instants = counted(count, "instant")
    if not there:
        return f"{instants} not located: {reason(status)}"
    has, their, them = ("has", "its", "it") if count == 1 else ("have", "their", "them")
    included = them if there == count else f"{there} of them"
    if status == LocationStatus.TOO_FEW:
        why = f"{has} too few measurements for a position of {their} own"
    else:
        why = f"without a position of {their} own ({reason(status)})"
    return f"{instants} {why}; the path includes {included}"


def write_tables(found: Positions[Any], output: Path | None, measurements: Path | None) -> None:
    """Write positions, unless the output is a map, and the measurements."""
    if not maps.is_map(output):
        write.write(found.rows, output)
    write.write(found.measurements, measurements)


def draw(one: Located[Any], figure: "FigureBase") -> None:
    """Draw the path of a target, or its positions, over time."""
    target = one.target
    panels = plot.trajectory(
        target.sensors.items, one.result, time=target.moments.to_numpy(), figure=figure
    )
    plan, *others = panels.values()
    plan.set_title(": ".join(filter(None, [one.target.name, plan.get_title()])))
    others[-1].set_xlabel("time_s")
