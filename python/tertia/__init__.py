"""One estimate with an error bar that can be believed.

For measurements that are redundant and sometimes wrong. `tertia.screening` finds the anomalous
ones, `tertia.bearing` makes one bearing with its sigma of what is left, `tertia.weights` combines
estimates and tells what not knowing their covariances costs, `tertia.sensors` describes stations
and radars, `tertia.location` makes a position of what several stations measured, `tertia.kalman`
makes tracks of plots, `tertia.smoothing` smooths positions along time, `tertia.trajectory` does
both for what stations measured along time,
`tertia.fusion` makes one track of several radars', `tertia.association` tells which plot belongs
to which track, `tertia.flightplan` what tracks have to do with flight plans, `tertia.io` reads
these, `tertia.tracker` makes tracks of scans of plots, `tertia.metrics` tells whether errors are
as claimed and how good tracks are, `tertia.simulate` makes records to try them on. `tertia.plot`
needs the extra `plot`, `tertia.geo` the extra `geo`, `tertia.report`, which tells what is in a
recording on one page, the extra `report`, the command `tertia` the extra `cli`.
"""

import importlib
import warnings
from typing import TYPE_CHECKING, Any

from tertia._core import DEBUG_BUILD, VERSION

if TYPE_CHECKING:
    from tertia import (
        association,
        bearing,
        flightplan,
        fusion,
        io,
        kalman,
        location,
        metrics,
        screening,
        sensors,
        simulate,
        smoothing,
        tracker,
        trajectory,
        weights,
    )
    from tertia.bearing import BearingEstimate, estimate_bearing

__version__ = VERSION

__all__ = [
    "BearingEstimate",
    "__version__",
    "association",
    "bearing",
    "estimate_bearing",
    "flightplan",
    "fusion",
    "io",
    "kalman",
    "location",
    "metrics",
    "screening",
    "sensors",
    "simulate",
    "smoothing",
    "tracker",
    "trajectory",
    "weights",
]

if DEBUG_BUILD:
    warnings.warn(
        "tertia was built without optimisation and is many times slower than it should be; "
        "build it with `maturin develop --release` or install a wheel",
        RuntimeWarning,
        stacklevel=2,
    )


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is: all modules together take as long as NumPy."""
    if name in {"BearingEstimate", "estimate_bearing"}:
        found = getattr(importlib.import_module("tertia.bearing"), name)
    elif name in __all__:
        found = importlib.import_module(f"tertia.{name}")
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals().setdefault(name, found)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
