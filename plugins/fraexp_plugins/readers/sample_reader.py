"""Files of samples that fraexp measure writes."""

from collections.abc import Sequence
from pathlib import Path

from fraexp.api import RecordReader, RecordTable, read_header, read_samples
from fraexp_plugins.readers._shared.record_arrays import pick_columns


class SampleReader(RecordReader, name="sample", version=1):
    """What a machine has recorded under `fraexp measure`: a line of JSON, then rows of float64, little endian."""

    suffixes = (".samples",)

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        header, length = read_header(path)
        places = pick_columns(path, columns, {name: at for at, name in enumerate(header.units)})
        values = read_samples(path, list(places.values()), header, length)
        units = {name: header.units[name] for name in columns}
        return RecordTable(dict(zip(columns, values, strict=True)), header.sample_time, units)

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return length and unit of each column by its name."""
        header, length = read_header(path)
        rows = (path.stat().st_size - length) // (8 * len(header.units))
        return {name: ((rows,), unit) for name, unit in header.units.items()}
