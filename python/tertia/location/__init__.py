"""Location: positions from measurements of several stations at one instant, outliers excluded.

Measurements are ranges, azimuths, elevations, range differences and times of arrival, in any
combination, in the plane or in space. The position minimises the sum of a loss function of the
whitened residuals `(measured - predicted) / sigma`. The loss is either half the square of the
residual or Tukey's biweight (Beaton, Tukey 1974), which gives no weight to residuals above 4.685.
Azimuths and elevations are in radians; azimuths are clockwise from north; positions are local east,
north and up in metres.

The covariance is that of the linearised problem. If the error of the position is not small compared
with the distances to the stations, the true covariance is larger and the position is biased: see
docs/location-regions.md.
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
