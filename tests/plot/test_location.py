"""Pictures of the accuracy over an area."""

import numpy as np
import numpy.typing as npt
import pytest
from matplotlib.contour import QuadContourSet

from tertia import location, plot

RADARS = [[0.0, 0.0], [3000.0, 0.0], [0.0, 4000.0]]


def grid_of(columns: int, rows: int) -> npt.NDArray[np.float64]:
    east, north = np.linspace(-1e3, 5e3, columns), np.linspace(500.0, 5e3, rows)
    return np.stack(np.meshgrid(east, north), axis=-1)


def test_levels_cover_the_errors_and_the_stations_are_shown() -> None:
    grid = grid_of(30, 20)
    accuracy = location.accuracy_map(RADARS, grid, azimuth_sigma=0.01)
    ax = plot.accuracy_map(RADARS, grid, accuracy)
    (filled,) = (one for one in ax.collections if isinstance(one, QuadContourSet))
    assert filled.levels[0] == pytest.approx(np.min(accuracy.drms))
    assert filled.levels[-1] == pytest.approx(np.quantile(accuracy.drms, 0.98))
    (stations,) = (one for one in ax.get_lines() if one.get_marker() == "^")
    np.testing.assert_array_equal(stations.get_xydata(), RADARS)
    assert ax.get_aspect() == 1.0


@pytest.mark.parametrize("shape", [(1, 1), (5, 1), (1, 5)])
def test_a_line_of_positions_is_no_area(shape: tuple[int, int]) -> None:
    grid = grid_of(*shape)
    accuracy = location.accuracy_map(RADARS, grid, range_sigma=10.0)
    said = f"grid has {shape[1]} x {shape[0]} positions; a map needs at least 2 x 2"
    with pytest.raises(ValueError, match=said):
        plot.accuracy_map(RADARS, grid, accuracy)
