"""MCAP logs of robots, through the package mcap."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, RecordReader, RecordTable
from fraexp_plugins.readers._shared.record_arrays import check_size, format_errors, load_package, pick_columns

DECODERS = ("mcap_ros2.decoder", "mcap_ros1.decoder", "mcap_protobuf.decoder")
"""Modules with a decoder of another encoding than JSON, which are used if they are installed."""
MAX_DEPTH = 6
MAX_ITEMS = 64
"""Items of a list that become columns."""


class McapReader(RecordReader, name="mcap", version=2):
    """An MCAP log; a column is ``topic.field``, such as ``joints.position.1`` for the first joint of ``/joints``.

    Messages of ROS 2, in Protocol Buffers and in JSON are read, those of ROS 1 if the package ``mcap-ros1-support`` is
    installed. Each topic keeps the log times of its messages.
    """

    suffixes = (".mcap",)

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        found = pick_columns(path, columns, _columns(path)[0])
        times = {column: stamps for column, (stamps, _) in found.items()}
        return RecordTable({column: values for column, (_, values) in found.items()}, times=times)

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return the number of messages of every field of numbers, by topic and field."""
        found, skipped = _columns(path)
        if skipped and not found:
            raise RecordError(
                f"{path.name}: its messages are in {' and '.join(sorted(skipped))}, for which no decoder is installed; "
                "pip install 'fraexp[mcap]' brings those of ROS 2 and Protocol Buffers, mcap-ros1-support that of ROS 1"
            )
        return {name: (values.shape, "") for name, (_, values) in found.items()}


Stamped = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Time stamps [s] and values."""


def _columns(path: Path) -> tuple[dict[str, Stamped], set[str]]:
    """Return every field of numbers with its time stamps, and the encodings that could not be read."""
    check_size(path, "the file", path.stat().st_size)
    reader = load_package(path, "mcap.reader", "mcap")
    times: dict[str, list[int]] = {}
    values: dict[str, list[float]] = {}
    skipped: set[str] = set()
    with format_errors(path, "MCAP"), path.open("rb") as stream:
        factories = list(_decoder_factories())
        for schema, channel, message in reader.make_reader(stream).iter_messages():
            content = _decoded(factories, schema, channel, message)
            if content is None:
                skipped.add(channel.message_encoding)
                continue
            for name, number in _leaves(content, channel.topic.strip("/").replace("/", "."), 0):
                times.setdefault(name, []).append(message.log_time)
                values.setdefault(name, []).append(number)
    start = min((stamps[0] for stamps in times.values()), default=0)
    return {
        name: (1e-9 * np.array([t - start for t in times[name]]), np.array(values[name])) for name in times
    }, skipped


def _decoder_factories() -> Iterator[Any]:
    for module in DECODERS:
        with suppress(ImportError):
            yield import_module(module).DecoderFactory()


def _decoded(factories: Sequence[Any], schema: Any, channel: Any, message: Any) -> Any:
    """Return the content of a message, or None if nothing decodes it."""
    if channel.message_encoding == "json":
        return json.loads(message.data)
    for factory in factories:
        decode = factory.decoder_for(channel.message_encoding, schema)
        if decode is not None:
            return decode(message.data)
    return None


def _leaves(content: Any, name: str, depth: int) -> Iterator[tuple[str, float]]:
    """Yield the numbers in a message, by their path from the topic; items of a list count from 1."""
    if isinstance(content, int | float) and not isinstance(content, bool):
        yield name, float(content)
    elif depth < MAX_DEPTH and not isinstance(content, str | bytes | bytearray):
        for key, part in _parts(content):
            yield from _leaves(part, f"{name}.{key}", depth + 1)


def _parts(content: Any) -> Iterator[tuple[str, Any]]:
    """Yield the parts of a message by name: of JSON, a list, Protocol Buffers, or ROS."""
    if isinstance(content, Mapping):
        yield from content.items()
    elif isinstance(content, Sequence):  # also arrays of ROS, and repeated fields of Protocol Buffers
        yield from ((str(number), part) for number, part in enumerate(content[:MAX_ITEMS], start=1))
    elif hasattr(content, "DESCRIPTOR"):
        yield from ((field.name, getattr(content, field.name)) for field in content.DESCRIPTOR.fields)
    elif hasattr(content, "__slots__"):
        yield from ((key.lstrip("_"), getattr(content, key, None)) for key in content.__slots__)
