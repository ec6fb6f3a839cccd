"""Location: positions from measurements of several stations at one instant, excluding outliers.

Measurements are ranges, azimuths, elevations, range differences and times of arrival, in any
mixture, in the plane or in space. The position minimises the sum of a loss of the whitened
residuals `(measured - predicted) / sigma`. The loss is half the square, or Tukey's biweight
(Beaton, Tukey 1974), which gives no weight to residuals above 4.685. Azimuths and elevations are
in radians; azimuths are clockwise from north; positions are local east, north and up in metres.

The covariance is that of the linearised problem. If the error is not small compared with the
distances, the true covariance is larger and the position is biased: see docs/location.md.
"""

from tertia.location._accuracy import Accuracy, accuracy_map
from tertia.location._arrivals import LIGHT
from tertia.location._locate import locate
from tertia.location._region import Region
from tertia.location._result import Location, LocationMethod, LocationStatus
from tertia.sensors import ByKind, Kind, Station

__all__ = [
    "LIGHT",
    "Accuracy",
    "ByKind",
    "Kind",
    "Location",
    "LocationMethod",
    "LocationStatus",
    "Region",
    "Station",
    "accuracy_map",
    "locate",
]
