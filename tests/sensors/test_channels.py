"""Channels of radars, and what plots are detected by."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from checks import assert_refused

from tertia.sensors import Bias, Channel, Radar
from tertia.sensors._channels import ways
from tertia.tracker import Plots

RADAR = {"range_sigma": 50.0, "azimuth_sigma": 0.001, "scan_period": 4.0}
BOTH = {"psr": Channel(0.85), "ssr": Channel(0.95)}


def test_channels_detect_independently():
    """The figures are products of .85, .95, .15 and .05."""
    found = ways(BOTH)
    expected = {"psr+ssr": 0.8075, "ssr": 0.1425, "psr": 0.0425, "": 0.0075}
    assert found == pytest.approx(expected, abs=1e-15)
    assert Radar(**RADAR, channels=BOTH).detection_probability == pytest.approx(0.9925, abs=1e-15)


def test_a_target_answers_one_kind_of_interrogation():
    found = ways({"psr": Channel(0.8), "ssr": Channel(0.9), "mode-s": Channel(0.98)})
    assert found["psr+mode-s"] == pytest.approx(0.8 * 0.98 / 2)
    assert found["ssr"] == pytest.approx(0.2 * 0.9 / 2)
    assert sum(found.values()) == pytest.approx(1.0, abs=1e-15)
    assert "ssr+mode-s" not in found


def test_a_radar_without_channels_is_as_before():
    radar = Radar(**RADAR)
    assert (radar.channels, radar.detection_probability) == (None, 0.9)
    assert Radar(**RADAR, detection_probability=0.7).detection_probability == 0.7


def test_a_copy_of_a_radar_has_its_channels():
    radar = Radar(**RADAR, channels={"ssr": BOTH["ssr"], "psr": BOTH["psr"]})
    for copy in (replace(radar, bias=Bias()), pickle.loads(pickle.dumps(radar))):
        assert list(copy.channels) == ["psr", "ssr"]
        assert copy.detection_probability == radar.detection_probability


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: Channel(1.0), ValueError, "detection_probability is 1.0"),
        (lambda: Channel(0.9, range_sigma=0.0), ValueError, "range_sigma is 0"),
        (lambda: Channel(0.9, azimuth_sigma=0.8), ValueError, "are these degrees?"),
        (lambda: Channel(0.9, clutter_per_scan=-1.0), ValueError, "clutter_per_scan is -1"),
        (lambda: Channel(0.9, clutter_per_scan=np.nan), ValueError, "clutter_per_scan is nan"),
        (lambda: Channel("much"), TypeError, "detection_probability is 'much'"),
        (lambda: Radar(**RADAR, channels={}), ValueError, "channels is empty"),
        (lambda: Radar(**RADAR, channels=0.9), TypeError, "channels is 0.9"),
        (lambda: Radar(**RADAR, channels={"psr": 0.9}), TypeError, "channels['psr'] is 0.9"),
        (lambda: Radar(**RADAR, channels={"PSR": BOTH["psr"]}), ValueError, "channels has 'PSR'"),
        (
            lambda: Radar(**RADAR, channels=BOTH, detection_probability=0.9),
            ValueError,
            "detection_probability is 0.9; with channels it must be theirs, 0.9925",
        ),
        (lambda: Plots([0.0], detection=["prs"]), ValueError, "detection[0] is 'prs'"),
        (lambda: Plots([0.0, 1.0], detection=[0, 5]), ValueError, "detection[1] is 5"),
        (lambda: Plots([0.0], detection=[0.5]), ValueError, "detection[0] is 0.5"),
        (lambda: Plots([0.0, 1.0], detection=["psr"] * 3), ValueError, "detection has shape (3,)"),
    ],
)
def test_what_is_refused(call, error, text):
    assert_refused(call, error, text)


def test_azimuths_of_a_channel_may_be_in_degrees():
    assert Channel(0.9, azimuth_sigma=0.2, degrees=True).azimuth_sigma == np.radians(0.2)
    with pytest.raises(ValueError, match=r"azimuth_sigma is 2\.0; .*pass degrees=True"):
        Channel(0.9, azimuth_sigma=2.0)
    assert Channel(0.9, azimuth_sigma=2.0, degrees=True).azimuth_sigma == np.radians(2.0)


def test_detections_are_names_or_indices():
    names = ["psr", "ssr", "psr+ssr", "mode-s", "psr+mode-s", "", None]
    plots = Plots(np.arange(7.0), detection=np.array(names, dtype=object))
    np.testing.assert_array_equal(plots.detection, [0, 1, 2, 3, 4, -1, -1])
    np.testing.assert_array_equal(Plots(np.arange(2.0), detection="ssr").detection, [1, 1])
    np.testing.assert_array_equal(Plots(np.arange(2.0)).detection, [-1, -1])
    again = Plots(np.arange(7.0), detection=plots.detection)
    np.testing.assert_array_equal(again[2:4].detection, [2, 3])


def test_detections_of_a_frame_may_be_missing():
    plots = {"range": [1e4, 1e4], "azimuth": [0.0, 0.0]}
    found = Plots([0.0, 1.0], **plots, detection=[np.nan, 1.0]).detection
    assert found.tolist() == [-1, 1]
    with pytest.raises(ValueError, match=r"detection\[1\] is 1.5; it must be an index of psr, ssr"):
        Plots([0.0, 1.0], **plots, detection=[np.nan, 1.5])
    with pytest.raises(ValueError, match=r"detection\[0\] is 9; it must be an index"):
        Plots([0.0, 1.0], **plots, detection=[9, 1])
