"""Records of a few bearings that leave it open how far away the target is."""

import numpy as np

from tertia.sensors import Station
from tertia.trajectory import reconstruct


def test_a_path_near_the_line_of_two_finders_is_refused_or_near() -> None:
    """Five bearings each with a sigma of 2°, from two finders 120 m apart: a path was at 1e20 m."""
    places = np.array([[60.0, 0.0], [-60.0, 0.0]])
    stations = [Station(place, azimuth_sigma=2.0, degrees=True) for place in places]
    time, refused = np.arange(5.0), 0
    for seed in range(30):
        rng = np.random.default_rng([9, seed])
        course = np.cumsum(rng.normal(0, 0.15, 5))
        way = 1.2 * np.cumsum(np.column_stack([np.sin(course), np.cos(course)]), axis=0)
        away = (way - way.mean(axis=0))[:, np.newaxis] - places
        azimuth = np.arctan2(away[..., 0], away[..., 1])
        azimuth += np.radians(2.0) * rng.standard_normal(azimuth.shape)
        try:
            found = reconstruct(stations, time, azimuth=azimuth)
        except ValueError as error:
            refused += "do not determine a path" in str(error)
        else:
            assert np.nanmax(np.abs(found.position)) < 1e7
    assert refused > 5
