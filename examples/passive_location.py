"""How well two passive sites can weigh their two estimates of a position, over an area.

Nothing here was measured. Two sites 30 km apart, west and east, measure two azimuths (0.3 degrees)
and the difference of the ranges (100 m). Two azimuths make one estimate of the position, an
azimuth and the range difference another; the covariance of each is estimated from 30 measurements.
That is the system that Kulyavets et al. 2005 write about; the numbers are not theirs.

Prints a table and writes passive_location.png: how well the elements of the weight matrix W are
known, and what not knowing them costs.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from tertia import weights
from tertia.simulate import PassiveLocation, passive_location

FloatArray = npt.NDArray[np.float64]

PICTURE = "passive_location.png"
SITES_KM = ((-15.0, 0.0), (15.0, 0.0))
WIDTH_KM, HEIGHT_KM = 120.0, 88.0
AZIMUTH_SIGMA_DEG = 0.3
RANGE_DIFFERENCE_SIGMA_M = 100.0
MEASUREMENTS = 30
BOUND = 0.05
TRIALS = 10_000


@dataclass(frozen=True)
class Area:
    """What the sites can tell, in cells of an area.

    Attributes
    ----------
    east, north : ndarray
        Centres of the cells in km.
    location : PassiveLocation
        Both estimates of a target in every cell, (north, east).
    largest_sigma : ndarray of shape (north, east)
        Largest standard deviation of an element of the estimated weight matrix, to first order.
    first_order, loss : ndarray of shape (north, east)
        How much worse the fused estimate is for it, to first order and simulated.
    """

    east: FloatArray
    north: FloatArray
    location: PassiveLocation
    largest_sigma: FloatArray
    first_order: FloatArray
    loss: FloatArray


def area(cell_km: float = 2.0, south_km: float = -HEIGHT_KM / 2, trials: int = TRIALS) -> Area:
    """Compute an area that is centred from west to east; no centre may lie between the sites."""
    east = np.arange(-WIDTH_KM / 2 + cell_km / 2, WIDTH_KM / 2, cell_km)
    north = np.arange(south_km + cell_km / 2, south_km + HEIGHT_KM, cell_km)
    location = passive_location(
        1e3 * np.stack(np.meshgrid(east, north), axis=-1),
        stations=1e3 * np.array(SITES_KM),
        azimuth_sigma=float(np.radians(AZIMUTH_SIGMA_DEG)),
        range_difference_sigma=RANGE_DIFFERENCE_SIGMA_M,
    )
    s = location.covariances
    variances = np.diagonal(weights.weight_covariance(s, MEASUREMENTS), axis1=-2, axis2=-1)
    first_order = weights.fusion_loss(s, MEASUREMENTS, method="first-order").loss
    simulated = weights.fusion_loss(s, MEASUREMENTS, method="monte-carlo", trials=trials).loss
    return Area(
        east,
        north,
        location,
        np.sqrt(variances.max(axis=-1)),
        np.asarray(first_order),
        np.asarray(simulated),
    )


def figure(found: Area) -> Figure:
    """Draw both maps."""
    picture = Figure(figsize=(10, 3.9), layout="constrained")
    left, right = picture.subplots(1, 2, sharex=True, sharey=True)
    sigma, percent = found.largest_sigma, 100 * found.loss
    _map(left, found, sigma, LogNorm(), (0.1, 0.3, 1, 3, 10))
    _map(right, found, percent, Normalize(), (2.5, 3, 3.5, 4, 4.5))
    left.set_title("largest standard deviation of an element of W", fontsize=10)
    right.set_title(f"loss of the fused estimate, %; n = {MEASUREMENTS}", fontsize=10)
    left.set_ylabel("north, km")
    left.legend(loc="lower left", fontsize=8)
    return picture


def _map(
    ax: Axes, found: Area, values: FloatArray, norm: Normalize, levels: tuple[float, ...]
) -> None:
    mesh = ax.pcolormesh(found.east, found.north, values, norm=norm, cmap="viridis")
    lines = ax.contour(
        found.east, found.north, values, levels=levels, colors="white", linewidths=0.8
    )
    for east, north in SITES_KM:
        label = "site" if east < 0 else None
        ax.plot(east, north, "^", color="white", markeredgecolor="black", markersize=8, label=label)
    ax.set(aspect="equal", xlabel="east, km")
    bar = ax.figure.colorbar(mesh, ax=ax, shrink=0.85)
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.add_lines(lines)


def main() -> None:
    """Print the table and write the picture."""
    found = area()
    counts = weights.required_samples(found.location.covariances, BOUND, trials=2000)
    rows = [
        ("largest standard deviation of W", found.largest_sigma, ".2f"),
        ("loss, first order, %", 100 * found.first_order, ".1f"),
        ("loss, simulated, %", 100 * found.loss, ".1f"),
        (f"measurements for a loss of {BOUND:.0%}", np.asarray(counts), ".0f"),
    ]
    print(f"{'':36}{'smallest':>10}{'median':>10}{'largest':>10}")
    for name, values, form in rows:
        numbers = "".join(f"{q:10{form}}" for q in np.quantile(values, [0, 0.5, 1]))
        print(f"{name:36}{numbers}")
    figure(found).savefig(PICTURE, dpi=110)
    print(f"The picture is in {PICTURE}")


if __name__ == "__main__":
    main()
