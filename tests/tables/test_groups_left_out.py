"""Groups without an estimate do not stop the others."""

import time

import numpy as np
import polars as pl
import pytest

from tertia import tables
from tertia.sensors import Station

PLACES = np.array([[0.0, 0.0], [4e3, 0.0], [0.0, 3e3]])
STATIONS = [
    Station(place, name=name, range_sigma=5.0) for place, name in zip(PLACES, "abc", strict=True)
]


def ranges(target: str, names: str = "abc") -> pl.DataFrame:
    time = np.arange(20.0)
    way = np.column_stack([1e3 + 10 * time, 2e3 - 5 * time])
    distance = np.linalg.norm(way[:, np.newaxis] - PLACES, axis=-1)
    rows = {"time_s": np.repeat(time, 3), "sensor": list("abc") * 20, "target": target}
    table = pl.DataFrame(rows | {"range_m": distance.ravel()})
    return table.filter(pl.col("sensor").is_in(list(names)))


def test_a_path_of_one_station() -> None:
    good = ranges("one")
    table = pl.concat([good, ranges("two", "a").head(1), ranges("three")])
    with pytest.warns(tables.RecordWarning, match="target two: no instant .* it is left out"):
        found = tables.reconstruct(table, sensors=STATIONS, by="target")
    assert found["target"].unique(maintain_order=True).to_list() == ["one", "three"]
    alone = tables.reconstruct(good, sensors=STATIONS, by="target")
    assert found.filter(pl.col("target") == "one").equals(alone)


def test_a_group_without_measurements() -> None:
    empty = ranges("two").with_columns(range_m=pl.lit(None, pl.Float64))
    table = pl.concat([ranges("one"), empty])
    with pytest.warns(tables.RecordWarning, match="two: there are no measurements; it is left"):
        found = tables.locate(table, sensors=STATIONS, by="target")
    assert found["target"].unique().to_list() == ["one"]


def test_many_groups_are_counted() -> None:
    bad = [ranges(f"t{k}", "a").head(1) for k in range(8)]
    table = pl.concat([ranges("one"), *bad])
    with pytest.warns(tables.RecordWarning) as said:
        tables.reconstruct(table, sensors=STATIONS, by="target")
    texts = [str(one.message) for one in said]
    assert sum("it is left out" in text for text in texts) == 5
    assert "3 more groups are left out" in texts


def test_no_group_has_an_estimate() -> None:
    table = pl.concat([ranges("one", "a").head(1), ranges("two", "a").head(1)])
    with pytest.raises(tables.RecordError, match="target one: no instant can be located"):
        tables.reconstruct(table, sensors=STATIONS, by="target")


def test_many_groups_of_bearings_without_an_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*nothing: object, **_: object) -> None:
        # a call without measurements judges the options alone
        if not nothing:
            raise ValueError("there is one measurement")

    monkeypatch.setattr("tertia.tables._bearing.estimate_bearing", refuse)

    def seconds(count: int) -> float:
        table = pl.DataFrame({"azimuth_deg": 90.0, "g": np.arange(count)})
        begin = time.process_time()
        assert tables.bearing(table, by="g")["note"].null_count() == 0
        return time.process_time() - begin

    # 4 times if the time is proportional to the number of groups, 16 if to its square
    assert seconds(60_000) < 7 * min(seconds(15_000) for _ in range(2))
