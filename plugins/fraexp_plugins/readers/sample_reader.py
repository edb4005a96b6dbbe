"""Files of samples that fraexp measure writes."""

from collections.abc import Sequence
from pathlib import Path

from fraexp.api import RecordError, RecordReader, RecordTable, did_you_mean, read_header, read_samples


class SampleReader(RecordReader, name="sample", version=1):
    """What a machine has recorded under `fraexp measure`: a line of JSON, then rows of float64, little endian."""

    suffixes = (".samples",)

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        header, length = read_header(path)
        names = list(header.units)
        for name in columns:
            if name not in names:
                raise RecordError(f"{path.name}: no column is called '{name}'{did_you_mean(name, names)}")
        values = read_samples(path, [names.index(name) for name in columns], header, length)
        found = dict(zip(columns, values, strict=True))
        units = {name: header.units[name] for name in columns if header.units[name]}
        return RecordTable(found, header.sample_time, units)

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return length and unit of each column by its name."""
        header, length = read_header(path)
        rows = (path.stat().st_size - length) // (8 * len(header.units))
        return {name: ((rows,), unit) for name, unit in header.units.items()}
