"""Structures of ASTERIX records, from the definitions that libasterix has of the documents.

`python -m reference.asterix_definitions`, in `tests`, writes those that the decoder is built from.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FILE = Path(__file__).parents[2] / "rust" / "tertia" / "src" / "asterix" / "definitions.txt"
# items that become columns: a name, or the names of parts; a part with parts of its own is A/B
_POSITION = {"LAT", "LON"}
_COMMON = {"010": {"SAC", "SIC"}, "140": {""}}
_SURFACE = {
    "041": _POSITION,
    "042": {"X", "Y"},
    "090": {"V", "G", "FL"},
    "202": {"VX", "VY"},
    "220": {""},
    "245": {"CHR"},
}
FIELDS: dict[int, dict[str, set[str]]] = {
    1: {
        "010": {"SAC", "SIC"},
        "020": {"TYP", "SIM", "SSRPSR", "RAB", "TST"},
        "040": {"RHO", "THETA"},
        "070": {"V", "G", "MODE3A"},
        "090": {"V", "G", "HGT"},
        "141": {""},
        "161": {""},
        "200": {"GSP", "HDG"},
    },
    2: {"010": {"SAC", "SIC"}, "000": {""}, "030": {""}, "041": {""}, "090": {"RE", "AE"}},
    10: _COMMON
    | _SURFACE
    | {
        "000": {""},
        "020": {"TYP", "SIM", "TST", "RAB"},
        "040": {"RHO", "TH"},
        "060": {"V", "G", "MODE3A"},
        "091": {""},
        "161": {"TRK"},
        "200": {"GSP", "TRA"},
        "500": {"DEVX", "DEVY", "COVXY"},
    },
    19: _COMMON | {"550": {"NOGO", "OVL", "TSV"}, "600": _POSITION, "610": {""}},
    20: _COMMON
    | _SURFACE
    | {
        "070": {"V", "G", "MODE3A"},
        "105": {""},
        "110": {""},
        "161": {"TRN"},
        "500": {"SDP/X", "SDP/Y", "SDP/XY"},
    },
    21: {
        "010": {"SAC", "SIC"},
        **{item: {""} for item in ("030", "071", "073", "077", "080", "140", "145", "170")},
        "130": _POSITION,
        "131": _POSITION,
        "160": {"GS", "TA"},
    },
    34: {
        "010": {"SAC", "SIC"},
        "000": {""},
        "030": {""},
        "041": {""},
        "050": {"COM/NOGO", "COM/OVLRDP", "COM/OVLXMT", "COM/TSV"},
        "090": {"RNG", "AZM"},
        "120": {"HGT", *_POSITION},
    },
    48: _COMMON
    | {
        "020": {"TYP", "SIM", "TST", "RAB"},
        "040": {"RHO", "THETA"},
        "070": {"V", "G", "MODE3A"},
        "090": {"V", "G", "FL"},
        "161": {"TRN"},
        "200": {"GSP", "HDG"},
        "220": {""},
        "240": {""},
    },
    62: {
        "010": {"SAC", "SIC"},
        **{item: {""} for item in ("040", "070", "130", "136", "220")},
        "080": {"CNF", "CST"},
        "060": {"V", "G", "MODE3A"},
        "100": {"X", "Y"},
        "105": _POSITION,
        "185": {"VX", "VY"},
        "245": {"CHR"},
        "380": {"ADR", "ID"},
        "200": {"TRANS", "LONG", "VERT"},
        "500": {"APC/X", "APC/Y", "COV", "APW/LAT", "APW/LON", "ATV/X", "ATV/Y"},
    },
    63: {
        "010": {"SAC", "SIC"},
        "050": {"SAC", "SIC"},
        "060": {"CON", "PSR", "SSR", "MDS", "ADS", "MLT", "OPS", "ODP", "OXT", "TSV", "NPW"},
        "080": {"SRG", "SRB"},
        "090": {"PRG", "PRB"},
        **{item: {""} for item in ("015", "030", "070", "081", "091", "092")},
    },
    65: {
        "010": {"SAC", "SIC"},
        "040": {"NOGO", "OVL", "TSV"},
        **{item: {""} for item in ("000", "015", "030", "050")},
    },
}
_HEAD = """\
# Structures of ASTERIX records, of the editions that libasterix has; made by
# tests/reference/asterix_definitions.py. Editions of one structure share a paragraph.
# Records in which a field is not 0 have the items below "where" and its name.
# Fields: name, first bit, bits, s(igned) or u(nsigned), size of the last bit, its unit.
"""


def definitions() -> str:
    """Return the structures of all categories that are read."""
    from asterix import generated  # noqa: PLC0415

    parts = [_HEAD]
    for category, fields in FIELDS.items():
        known: dict[str, list[str]] = {}
        for edition in reversed(generated.manifest["CATS"][category]):
            text = "".join(f"{line}\n" for line in _records(edition.cv_uap, fields))
            known.setdefault(text, []).append(".".join(map(str, edition.cv_edition)))
        for text, names in known.items():
            parts.append(f"category {category} {' '.join(names)}\n{text}")
    return "\n".join(parts)


def _records(uap: Any, fields: dict[str, set[str]]) -> Iterator[str]:
    if hasattr(uap, "cv_record"):
        yield from _items(uap.cv_record, fields)
        return
    one, other = uap.cv_uaps.values()
    yield from _items(one, fields)
    yield f"where {'/'.join(uap.cv_selector[0])}"
    yield from _items(other, fields)


def _items(record: Any, fields: dict[str, set[str]]) -> Iterator[str]:
    yield f"fspec {record.cv_fspec_max_bytes}"
    for item in record.cv_items_list:
        kind = item.__base__.__name__
        if kind == "UapItem":
            name = item.cv_non_spare.cv_name
            yield f"{name} {_structure(item.cv_non_spare, fields.get(name, set()))}"
        elif kind == "UapItemRFS":
            yield "RFS (sequence)"
        else:
            assert kind == "UapItemSpare", kind
            yield "-"


def _structure(non_spare: Any, wanted: set[str]) -> str:
    rule = non_spare.cv_rule
    context_free = hasattr(rule, "cv_variation")
    return _variation(rule.cv_variation if context_free else rule.cv_default_variation, wanted)


def _variation(variation: Any, wanted: set[str]) -> str:
    kind = variation.__base__.__name__
    if kind in {"Element", "Group"}:
        fields = [field for _, field in _fields(variation, "", wanted, 0)]
        return _list("fixed", variation.cv_bit_size, *fields)
    if kind == "Extended":
        return _list("extended", *_parts(variation, wanted))
    if kind == "Repetitive":
        inner = _variation(variation.cv_variation, set())
        return _list("repeated", variation.cv_rep_bytes or "fx", inner)
    if kind == "Compound":
        parts = []
        for one in variation.cv_items_list:
            if one is None:
                parts.append("-")
                continue
            name = one.cv_name
            below = {rest for part, _, rest in (w.partition("/") for w in wanted) if part == name}
            parts.append(f"{name} {_structure(one, below)}")
        return _list("compound", variation.cv_fspec_max_bytes, *parts)
    assert kind == "Explicit", kind
    return "(explicit)"


def _parts(extended: Any, wanted: set[str]) -> Iterator[str]:
    """Yield the parts of an item that its bits FX extend."""
    for part in extended.cv_items_list:
        at, fields = 0, []
        for one in part:
            if one is None:
                at += 1
                continue
            item, size = one
            if item.__base__.__name__ == "Item":
                name = item.cv_non_spare.cv_name
                rule = item.cv_non_spare.cv_rule
                if name in wanted:
                    fields.append(_field(name, at, size, rule.cv_variation))
            at += size
        yield _list("fx" if part[-1] is None else "last", at, *fields)


def _fields(variation: Any, name: str, wanted: set[str], at: int) -> Iterator[tuple[int, str]]:
    """Yield the wanted fields of a group or an element."""
    if variation.__base__.__name__ == "Element":
        if name in wanted:
            yield at, _field(name, at, variation.cv_bit_size, variation)
        return
    for item, size in variation.cv_items_list:
        if item.__base__.__name__ == "Item":
            rule = item.cv_non_spare.cv_rule
            yield from _fields(rule.cv_variation, item.cv_non_spare.cv_name, wanted, at)
        at += size


def _field(name: str, at: int, size: int, element: Any) -> str:
    rule = element.cv_rule
    content = rule.cv_content if hasattr(rule, "cv_content") else rule.cv_default_content
    signed = getattr(content, "cv_signedness", None)
    sign = "s" if signed is not None and signed.__name__ == "Signed" else "u"
    scale = [repr(float(content.cv_lsb)), content.cv_unit] if hasattr(content, "cv_lsb") else []
    return _list(name or "=", at, size, sign, *filter(None, scale))


def _list(*parts: object) -> str:
    return f"({' '.join(map(str, parts))})"


if __name__ == "__main__":
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_text(definitions(), encoding="utf-8")
    sys.stdout.write(f"{FILE}\n")
