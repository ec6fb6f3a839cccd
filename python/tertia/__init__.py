"""Estimates with reliable error bars from redundant measurements, even if some are wrong.

The modules, in the order in which they build on each other:

- `tertia.screening` finds outliers;
- `tertia.bearing` estimates one bearing from a record of measured bearings;
- `tertia.weights` computes weights from covariances, and the loss of accuracy if the covariances
  are estimated;
- `tertia.sensors` describes stations and radars;
- `tertia.location` locates a target at one instant from the measurements of several stations;
- `tertia.kalman` filters and smooths an angle over time;
- `tertia.smoothing` smooths positions and other series over time;
- `tertia.trajectory` reconstructs a path from the measurements of several stations;
- `tertia.fusion` fuses estimates of several sensors, and plots of several radars;
- `tertia.association` assigns plots to tracks;
- `tertia.flightplan` compares tracks with flight plans;
- `tertia.tracker` tracks many targets;
- `tertia.registration` estimates the noise and the biases of radars;
- `tertia.tertiary` combines the tracks of several sensors into one picture.

`tertia.simulate` simulates records, `tertia.metrics` evaluates errors and tracks, and `tertia.io`
reads flight plans and ASTERIX recordings. Some modules need optional dependencies (extras) of the
package: `tertia.geo`, `tertia.plot`, `tertia.tables`, `tertia.interop` and `tertia.report`. The
command `tertia` needs the extra `cli`.
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
        tertiary,
        tracker,
        trajectory,
        weights,
    )
    from tertia.bearing import BearingEstimate, estimate_bearing
    from tertia.metrics import Audit, audit

__version__ = VERSION

__all__ = [
    "Audit",
    "BearingEstimate",
    "__version__",
    "association",
    "audit",
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
    "tertiary",
    "tracker",
    "trajectory",
    "weights",
]

# what is here as well as in its module
_HOMES = {
    "Audit": "metrics",
    "BearingEstimate": "bearing",
    "audit": "metrics",
    "estimate_bearing": "bearing",
}

if DEBUG_BUILD:
    warnings.warn(
        "tertia was built without optimisation and is many times slower than it should be; "
        "build it with `maturin develop --release` or install a wheel",
        RuntimeWarning,
        stacklevel=2,
    )


def __getattr__(name: str) -> Any:
    """Import a module on first use, because importing all takes as long as importing NumPy."""
    if name in _HOMES:
        found = getattr(importlib.import_module(f"tertia.{_HOMES[name]}"), name)
    elif name in __all__:
        found = importlib.import_module(f"tertia.{name}")
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals().setdefault(name, found)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
