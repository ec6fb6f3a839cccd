"""Errors of radars against plain formulas."""

from dataclasses import replace

import numpy as np
from reference import registration as reference
from registration.scenes import LIMITS, PLACES, STATED, columns, constant, radars, recording

from tertia.sensors import Bias
from tertia.tracker import track
from tertia.tracker._errors import errors


def test_the_same_by_plain_formulas():
    bias = Bias(range=[0.0, 150.0, -90.0], azimuth=[0.0, 0.002, 0.0], time=[0.0, 0.0, 0.1])
    plots = recording(1, bias=bias, height_missing_probability=0.1)
    tracks = track(plots, [replace(one, bias=bias[k]) for k, one in enumerate(radars())])
    found = errors(plots, tracks, constant())
    assert found.changes == ()
    rows = np.flatnonzero((tracks.plot >= 0) & tracks.confirmed)
    # a plot without a height has that of its track
    own = replace(plots, height=tracks._columns.heights(plots.height, 0, 0))[tracks.plot[rows]]
    seen = {name: getattr(own, name) for name in ("time", "range", "azimuth", "height", "sensor")}
    seen |= {"target": tracks.track[rows], "turn_probability": tracks.turn_probability[rows]}
    places = np.column_stack([PLACES, np.zeros(3)])
    value, covariance, factor = reference.errors(
        seen, places, np.tile(STATED, (3, 1)), 2.2 * 6.0, np.tile(LIMITS, (3, 1))
    )
    np.testing.assert_allclose(columns(found.bias), value, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-8, atol=1e-20)
    np.testing.assert_allclose(found.factor, factor, rtol=1e-9)
