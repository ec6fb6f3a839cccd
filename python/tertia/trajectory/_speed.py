"""The speed of the signals of a path, estimated with the positions of its instants."""

from __future__ import annotations

from typing import Any

import numpy as np

from tertia import _core
from tertia.location._arrivals import Arrivals
from tertia.location._speed import Speed
from tertia.sensors._kinds import KINDS


def at_found_speed(
    record: dict[str, Any],
    speed: Speed,
    arrivals: Arrivals | None,
    bias_sigma: list[float],
    n_threads: int | None,
) -> tuple[dict[str, Any], Speed, Arrivals | None]:
    """Return the record of a path at the speed that its instants tell, that speed, and arrivals.

    `bias_sigma` has nan for each number of an instant whose systematic error is estimated.
    """
    if speed.relative == 0.0:
        return record, speed, arrivals
    own = record["own_sigmas"]
    *_, found = _core.locate(
        *instants(record),
        record["values"],
        record["sigmas"][np.newaxis] if own is None else own,
        None if record["surveys"] is None else np.array(record["surveys"]),
        None,
        None,
        ("robust", 3),
        (True, record["correlation"]),
        np.isnan(bias_sigma).tolist(),
        False,
        speed.relative,
        n_threads,
    )
    speed = speed.found(*found)
    scaled = {
        name: None if record[name] is None else speed.scaled(record[name], KINDS)
        for name in ("values", "sigmas", "own_sigmas")
    }
    found_arrivals = None if arrivals is None else arrivals.at(speed.scale)
    return record | scaled | {"speed_sigma": speed.relative}, speed, found_arrivals


def instants(record: dict[str, Any]) -> tuple[Any, Any]:
    """Return positions and axes of the stations, one row for each instant or one for all."""
    places, axes = record["stations"], record["axes"]
    return (
        places if places.ndim > 2 else places[np.newaxis],
        axes if axes is None or axes.ndim > 3 else axes[np.newaxis],
    )
