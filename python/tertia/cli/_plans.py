"""Flight plans in files."""

from pathlib import Path

from tertia import io
from tertia.cli._radars import RadarSites
from tertia.cli._terminal import WRONG_USAGE, fail
from tertia.flightplan import FlightPlan


def filed_plans(
    path: Path | None, origin: tuple[float, float] | None, sites: RadarSites
) -> list[FlightPlan]:
    """Return the plans, whose east and north are those of the radars if nothing else is said."""
    frame = sites.places.frame
    if origin is None and frame is not None:
        origin = frame.latitude, frame.longitude
    return [] if path is None else _read_plans(path, origin)


def _read_plans(path: Path, origin: tuple[float, float] | None) -> list[FlightPlan]:
    """Return the plans of a file, one at least, or fail."""
    try:
        plans = io.read_plans(path, origin=origin)
    except FileNotFoundError:
        fail(f"there is no file {path}", WRONG_USAGE)
    except OSError as error:
        fail(f"cannot read {path}: {error.strerror}")
    except (ImportError, ValueError) as error:
        fail(str(error).replace("origin must be given", "give --origin"))
    if not plans:
        fail(f"{path} has no plans")
    return plans
