"""The common output of `tertia locate` and `tertia reconstruct`."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer

from tertia._result import counted
from tertia.cli.files import maps, write
from tertia.cli.terminal.say import WRONG_USAGE, fail, print_table
from tertia.location import LocationStatus
from tertia.tables._positions import Located, Positions, reason

# size of the picture of a target, in inches
FIGURE_SIZE = (11.0, 8.0)
# p-value below which measurements contradict each other
_DOUBTFUL = 1e-3
# share of such instants above which a note is printed: ten times the share expected by chance
_MANY = 0.01


def start(text: str | None, dimension: int) -> list[float] | None:
    """Return the position of the option --initial."""
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


def print_all(found: Positions[Any], by: Sequence[str]) -> None:
    """Print the results of each sensor, and the origin."""
    print_table(found.sensors, text=[*by, "sensor", "kind"])
    origin = found.stations.origin()
    if origin is not None:
        typer.echo(origin)


def say_located(one: Located[Any]) -> None:
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


def write_all(
    found: Positions[Any],
    output: Path | None,
    measurements: Path | None,
    features: Callable[[], Sequence[maps.Feature | None]],
    noun: str,
    *,
    shapes: Callable[[], Sequence[maps.Shape]] = tuple,
) -> None:
    """Write positions as a table or for a map, and the measurements."""
    if output is not None and maps.is_map(output):
        maps.write(features(), output, noun, shapes())
    elif output is not None:
        write.write(found.rows, output)
    if measurements is not None:
        write.write(found.measurements, measurements)


def name_panels(panels: dict[str, Any], one: Located[Any]) -> None:
    """Name the target and the times of a picture."""
    plan, *others = panels.values()
    plan.set_title(": ".join(filter(None, [one.target.name, plan.get_title()])))
    others[-1].set_xlabel("time_s")
