"""ASTERIX decoded by columns: what libasterix finds, in every edition and whatever the bytes."""

import os
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from reference import asterix_definitions as reference

from tertia import _core

base = pytest.importorskip("asterix.base")
generated = pytest.importorskip("asterix.generated")
DEFINITIONS = _core.asterix_definitions()
MISSING = np.iinfo(np.int64).min
# of each edition; more with RECORDS
RECORDS = int(os.environ.get("RECORDS", "40"))


def test_the_definitions_are_those_of_libasterix() -> None:
    assert reference.FILE.read_text(encoding="utf-8") == reference.definitions()


def editions() -> Iterator[Any]:
    for number, (category, names, fields) in enumerate(DEFINITIONS):
        for name in names:
            yield pytest.param(number, category, name, fields, id=f"{category}-{name}")


def value(record: Any, name: str) -> int:
    """Return a field of a record as a whole number."""
    first, *parts = name.split("/")
    # one that is repeated in a sequence counts as it is there last
    repeated = record.get_rfs_item(first) if record.items_rfs else []
    found = [record.get_item(first), *repeated]
    item = next((one for one in reversed(found) if one is not None), None)
    for part in parts:
        item = item and item.variation.get_item(part)
    if item is None:
        return MISSING
    content = item.variation.content
    signed = getattr(content, "cv_signedness", None)
    bits = item.variation.bs
    raw = bits.to_uinteger()
    return int(raw if signed is None else signed.convert(len(bits), raw))


def parsed(uap: Any, contents: bytes) -> Any:
    """Return a record and the rest, or an error, by the list of items that the record says."""
    strict, bits = base.ParsingMode.StrictParsing, base.Bits.from_bytes(contents)
    if hasattr(uap, "cv_record"):
        return uap.cv_record.parse(strict, bits)
    # both lists begin with the item that says which
    descriptor = contents[next(k for k, octet in enumerate(contents) if not octet & 1) + 1 :]
    there = contents[0] & 0x40 and descriptor[2 * (contents[0] >> 7)] & 0x80
    try:
        return uap.cv_uaps["track" if there else "plot"].parse(strict, bits)
    except TypeError as error:
        # what it does with a bit beyond the last item
        return ValueError(str(error))


def octets(rng: np.random.Generator, count: int) -> bytes:
    """Return a record that is likely to be one: some items, the lengths in it small."""
    spec = rng.integers(0, 256, count) & rng.integers(0, 256, count)
    spec[:-1] |= 1
    spec[-1] &= 0xFE
    body = rng.integers(0, 256, 160)
    small = rng.random(160) < 0.5
    body[small] &= 0x06
    return bytes([*spec, *body])


@pytest.mark.parametrize(("number", "category", "edition", "fields"), list(editions()))
def test_records_are_those_of_libasterix(
    number: int, category: int, edition: str, fields: list[tuple[str, float, str]]
) -> None:
    [one] = (
        found
        for found in generated.manifest["CATS"][category]
        if ".".join(map(str, found.cv_edition)) == edition
    )
    rng = np.random.default_rng([category, number])
    decoded = 0
    lists = getattr(one.cv_uap, "cv_uaps", {"": getattr(one.cv_uap, "cv_record", None)})
    longest = max(each.cv_fspec_max_bytes for each in lists.values())
    for _ in range(RECORDS):
        # some of which are longer than any
        contents = octets(rng, int(rng.integers(1, longest + 2)))
        begin, end = np.array([0]), np.array([len(contents)])
        expected = parsed(one.cv_uap, contents)
        if isinstance(expected, ValueError):
            block, _, damage = _core.asterix_records(number, contents, begin, end)
            assert len(block) == 0
            assert damage[0][1] == 0
            continue
        record, rest = expected
        decoded += 1
        end -= len(rest) // 8
        block, columns, damage = _core.asterix_records(number, contents, begin, end)
        assert (list(block), damage) == ([0], [])
        assert {
            name: int(column[0]) for (name, *_), column in zip(fields, columns, strict=True)
        } == {name: value(record, name) for name, *_ in fields}
    assert decoded > RECORDS / 8
