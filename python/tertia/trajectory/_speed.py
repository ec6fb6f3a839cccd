"""The speed of the signals of a path, and the wind, as its instants tell them."""

from __future__ import annotations

from typing import Any

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray
from tertia.location._arrivals import Arrivals
from tertia.location._speed import Speed
from tertia.location._wind import Wind
from tertia.sensors._kinds import KINDS


def in_found_medium(
    record: dict[str, Any],
    medium: tuple[Speed, Wind],
    arrivals: Arrivals | None,
    bias_sigma: list[float],
    n_threads: int | None,
) -> tuple[dict[str, Any], tuple[Speed, Wind], Arrivals | None]:
    """Return the record of a path at the speed, and in still air, that its instants tell.

    Speed and wind as estimated, and arrivals of this speed, are returned as well.

    `bias_sigma` has nan for each number of an instant whose systematic error is estimated.
    """
    speed, wind = medium
    if speed.relative == wind.relative == 0.0:
        return record, medium, arrivals
    own = record["own_sigmas"]
    *_, (share, blown) = _core.locate(
        *instants(record),
        record["values"],
        record["sigmas"][np.newaxis] if own is None else own,
        None if record["surveys"] is None else np.array(record["surveys"]),
        height_rows(record),
        None,
        ("robust", 3),
        (True, record["correlation"]),
        np.isnan(bias_sigma).tolist(),
        False,
        (speed.relative, wind.relative, (speed.as_stated, wind.as_stated)),
        n_threads,
    )
    speed, wind = speed.found(*share), wind.found(blown, record["values"].shape)
    scaled = {
        name: None if record[name] is None else speed.scaled(record[name], KINDS)
        for name in ("values", "sigmas", "own_sigmas")
    }
    of_medium: dict[str, Any] = {"speed_sigma": speed.relative}
    if wind.values is not None and wind.covariance is not None:
        scaled["values"] = wind.values
        of_medium["wind"] = (wind.covariance / wind.speed**2).tolist()
    found_arrivals = None if arrivals is None else arrivals.at(speed.scale)
    return record | scaled | of_medium, (speed, wind), found_arrivals


def height_rows(record: dict[str, Any]) -> FloatArray | None:
    """Return heights and their sigmas, (N, 2), as `locate` has them."""
    if record["height"] is None:
        return None
    value, sigma, _ = record["height"]
    return np.column_stack([value, sigma])


def instants(record: dict[str, Any]) -> tuple[Any, Any]:
    """Return positions and axes of the stations, one row for each instant or one for all."""
    places, axes = record["stations"], record["axes"]
    return (
        places if places.ndim > 2 else places[np.newaxis],
        axes if axes is None or axes.ndim > 3 else axes[np.newaxis],
    )
