"""Decoding of text files."""

import codecs
import sys
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_BEGIN = 1 << 16
_BOMS = {codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}


def toml_of(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file in UTF-8 or UTF-16; other text is a ValueError, too."""
    contents = path.read_bytes()
    text = contents.decode(encoding_of(contents[:_BEGIN])).lstrip("\ufeff")
    return tomllib.loads(text)


def encoding_of(begin: bytes) -> str:
    """Return the encoding of a text that begins with these bytes."""
    if begin[:2] in _BOMS:
        return _BOMS[begin[:2]]
    for encoding, zeros in (("utf-16-le", begin[1::2]), ("utf-16-be", begin[::2])):
        if zeros and zeros.count(0) > len(zeros) // 2:
            return encoding
    return "utf-8"
