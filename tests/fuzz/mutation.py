"""Valid inputs made hostile: texts, bytes and plain data, changed at random but along their structure."""

import math
import re
from collections.abc import Sequence
from datetime import date
from random import Random
from typing import Any

NUMBERS = (
    "0", "-1", "1e12", "1e400", "-1e308", "5e-324", "nan", "inf", "-inf", "9**9**9", "1e", "0x1f", "1_0", "2**63",
    "18446744073709551616", "-0.0", "1e-400", "٣", "½", "1" * 30, "1" * 5000,
)  # fmt: skip
HOSTILE = (
    "", " ", "\t", "\r\n", "\x00", "\x7f", "\x1b[2J\x1b]0;title\x07", "\u202e", "\ud800", "\ufeff", '"""', "'", "\\",
    "=", "[", "]", "{", "}", "[1,2]", "µ", "😀", "%s%n", "$(id)", "{level}", "~root", "/etc/passwd",
    "../../../etc/passwd", "__import__('os').system('id')", "'; DROP TABLE run; --", "a" * 3000, "(" * 2000,
    "[" * 2000, " " * 3000, "a.b" + ".c" * 60, '{"a":' * 60 + "1" + "}" * 60,
)  # fmt: skip
PIECE = re.compile(r"\s+|[\w.+-]+|.", re.DOTALL)
VALUES: tuple[Any, ...] = (
    *(None, True, 0, -1, 1, 2**63, -(2**63), 2**70, 10**400, 1e12, 1e308, -1e308, 5e-324, math.nan, math.inf, 0.0),
    *("", "1e12", "1 um", "1 kg", "9**9**9 m", "nan", "\x1b[2J", "../../x", date(2020, 1, 1)),
    *([], [[]], [{}], [1, "a", None], ["x"] * 1000, [1.0] * 1000, [[[[[[1]]]]]]),
    *({}, {"name": "x"}, {"name": ["a"]}, {"fit": "plant"}, {"fit": []}, {"a": {"b": {}}}),
)


def text(rng: Random, seed: str, others: Sequence[str], words: Sequence[str]) -> str:
    """Return a text with a few pieces deleted, doubled, swapped, replaced, or taken from another one."""
    pieces = PIECE.findall(seed)
    for _ in range(1 + int(rng.expovariate(0.7))):
        place = rng.randrange(len(pieces) + 1)
        match rng.randrange(8):
            case 0:
                del pieces[place : place + rng.randrange(1, 6)]
            case 1:
                pieces[place:place] = pieces[place : place + rng.randrange(1, 20)] * rng.choice((1, 2, 30))
            case 2:
                pieces[place : place + 1] = [rng.choice(NUMBERS)]
            case 3:
                pieces[place : place + rng.randrange(2)] = [rng.choice(HOSTILE)]
            case 4 | 5 if words:
                pieces[place : place + rng.randrange(2)] = [rng.choice(words)]
            case 6:
                other = PIECE.findall(rng.choice(others))
                start = rng.randrange(len(other) + 1)
                pieces[place:place] = other[start : start + rng.randrange(1, 40)]
            case _:
                pieces[place : place + 1] = [chr(rng.choice((rng.randrange(128), rng.randrange(0xD7FF))))]
        del pieces[20_000:]
    return "".join(pieces)


def octets(rng: Random, seed: bytes, others: Sequence[bytes]) -> bytes:
    """Return bytes with a few of them changed, cut, doubled, or numbers among them made large."""
    data = bytearray(seed)
    for _ in range(1 + int(rng.expovariate(0.5))):
        place = rng.randrange(len(data) + 1)
        match rng.randrange(7):
            case 0:
                data[place : place + 1] = bytes([rng.randrange(256)])
            case 1:
                data[place : place + 4] = rng.choice(
                    (0, 1, 2**31 - 1, 2**32 - 1, 2**30, rng.randrange(2**32))
                ).to_bytes(4)
            case 2:
                data[place : place + 8] = rng.choice((2**63 - 1, 2**40, 10**9, 0)).to_bytes(8, "little")
            case 3:
                del data[place : place + rng.randrange(1, 64)]
            case 4:
                data[place:place] = data[place : place + rng.randrange(1, 256)]
            case 5:
                other = rng.choice(others)
                start = rng.randrange(len(other) + 1)
                data[place : place + 16] = other[start : start + rng.randrange(1, 128)]
            case _ if place < len(data):
                data[place] ^= 1 << rng.randrange(8)
    return bytes(data[: rng.randrange(len(data) + 1)]) if rng.random() < 0.05 else bytes(data)


def plain(rng: Random, data: Any, names: Sequence[str], depth: int = 0) -> Any:
    """Return plain data with one or a few of its values, keys or branches changed."""
    for _ in range(1 + (depth == 0) * int(rng.expovariate(0.8))):
        data = _changed(rng, data, names)
    return data


def _changed(rng: Random, data: Any, names: Sequence[str]) -> Any:
    if isinstance(data, dict) and data and rng.random() < 0.9:
        return _changed_table(rng, data, names)
    if isinstance(data, list) and data and rng.random() < 0.8:
        place = rng.randrange(len(data))
        ways = [data[:place] + data[place + 1 :], data + data[: rng.randrange(1, 4)]]
        deeper = [*data[:place], _changed(rng, data[place], names), *data[place + 1 :]]
        return rng.choice([*ways, deeper, deeper, deeper])
    if isinstance(data, float | int) and not isinstance(data, bool) and abs(data) < 1e5 and rng.random() < 0.6:
        changed = data * rng.choice((0.0, -1.0, 1e-3, 1e3, 1e-9, 1e9, 0.999, 2.0) + (1e300,) * isinstance(data, float))
        return type(data)(changed)
    if isinstance(data, str) and rng.random() < 0.6:
        return text(rng, data, names, names)
    return rng.choice(VALUES) if rng.random() < 0.7 else rng.choice(names)


def _changed_table(rng: Random, data: dict[str, Any], names: Sequence[str]) -> dict[str, Any]:
    key = rng.choice(list(data))
    match rng.randrange(9):
        case 0:
            return {other: value for other, value in data.items() if other != key}
        case 1:
            return {**data, rng.choice(names) if rng.random() < 0.8 else rng.choice(HOSTILE): rng.choice(VALUES)}
        case 2:
            return {**data, rng.choice(names): data[key]}
        case 3:
            return {**data, key: data[rng.choice(list(data))]}
    return {**data, key: _changed(rng, data[key], names)}
