"""Record files and databases from strangers."""

import contextlib
import io
import json
import shutil
import sqlite3
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
from scipy.io import savemat

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.components.registry import Registry
from fraexp.errors import FraexpError
from fraexp.records.proposals import propose_import
from fraexp.records.record_files import find_reader, list_contents
from fraexp.store.codec import decode_array, encode_array
from fraexp.store.tables import metadata
from fraexp.store.validation import parse_json
from tests.cli.conftest import fill
from tests.fuzz import mutation
from tests.fuzz.targets import CSV
from tests.fuzz.watching import Target
from tests.records.corpus import LAYOUTS
from tests.store.conftest import reseal

TABLES = (
    CSV,
    CSV.replace(",", ";").replace(".", ","),
    CSV.replace(",", "\t"),
    "# comment\n" + CSV.replace(",", " "),
    "1\n2\n3\n",
)
CELLS = (",", ";", "\t", '"', "#", "%", "\n", "\r", "\x00", "[mm]", "(N)", "nan", "1e400", "1,5", "u [N]")
LIKELY = 7
"""Refusals of a file in which some of the columns are there."""
SUFFIXES = (".csv", ".json", ".mat", ".h5")
ESCAPE = "\x1b"
COMMANDS = [words.split() for words in (
    "list", "list --json", "show 1", "show 1 --json", "compare 1", "list state=computed", "list laser",
)]  # fmt: skip
STORED = (
    "null",
    '{"a": NaN, "b": Infinity}',
    "[1,2]",
    '{"\\u001b[31m": "\\u001b[0m"}',
    "2026-13-45",
    "OK",
    "FAILED",
    "complete",
)
"""Texts that columns of a database contain, or nearly."""
ODD = (*mutation.HOSTILE, *mutation.NUMBERS, *STORED, None, 0, -1, 2**62, 10**9, 1.5, float("inf"))


def targets(folder: Path, registry: Registry) -> list[Target]:
    """Return the readers of files."""
    arrays = [
        encode_array(np.arange(n, dtype=float).reshape(shape), "") for n, shape in ((4, 4), (8, (2, 2, 2)), (0, 0))
    ]
    classic, hdf5 = _matlab(folder)
    fill(folder / "model.db")
    for name in ("model.db-wal", "model.db-shm"):
        (folder / name).unlink(missing_ok=True)
    with contextlib.suppress(FraexpError):
        _database(folder, [], plot=True)  # what is imported once, and takes its time
    tables = [table.encode() for table in (*TABLES, TABLES[0].encode("utf-16").decode("latin-1"))]
    return [
        Target("CSV as text", _texts(TABLES), partial(_csv, folder, registry), 0.003),
        Target("CSV as bytes", _octets(tables), partial(read_file, folder, registry, "b.csv"), 0.003),
        Target("MATLAB 4 to 7", _octets(classic), partial(read_file, folder, registry, "b.mat"), 0.004),
        Target("MATLAB 7.3", _octets(hdf5), partial(read_file, folder, registry, "c.mat"), 0.001),
        Target(
            "instruments' files", partial(_damaged, _instruments(folder)), partial(_read_any, folder, registry), 0.02
        ),
        Target("stored arrays", _octets(arrays), decode_array, 0.1),
        Target("stored JSON", _json, _plain_data, 0.1),
        Target("database rows", random_rows, partial(_database, folder), 0.0002),
        Target("database files", _octets([(folder / "model.db").read_bytes()]), partial(_file, folder), 0.0002),
    ]


def _instruments(folder: Path) -> list[tuple[str, bytes]]:
    """Return the files of the corpus of records, by name."""
    seeds = []
    for layout in LAYOUTS.values():
        with contextlib.suppress(ImportError):  # a format whose library is not installed
            layout.write(folder)
            seeds += [(name, (folder / name).read_bytes()) for name in layout.files]
    return seeds


def _damaged(seeds: Sequence[tuple[str, bytes]], rng: Random) -> tuple[str, bytes]:
    name, data = rng.choice(seeds)
    return name, mutation.octets(rng, data, [data])


def _read_any(folder: Path, registry: Registry, made: tuple[str, bytes]) -> None:
    """List a file, propose its import, and read its first column."""
    file = folder / made[0]
    file.write_bytes(made[1])
    found = list_contents(file, registry)
    propose_import(file, found, registry)
    find_reader("", file, registry).read(file, [found[0].name])


def _texts(seeds: Sequence[str]) -> Callable[[Random], str]:
    return lambda rng: mutation.text(rng, rng.choice(seeds), seeds, CELLS)


def _octets(seeds: Sequence[bytes]) -> Callable[[Random], bytes]:
    return lambda rng: mutation.octets(rng, rng.choice(seeds), seeds)


def _matlab(folder: Path) -> tuple[list[bytes], list[bytes]]:
    values = {
        "t": np.arange(40.0),
        "u": np.ones((40, 2)),
        "s": {"a": np.arange(3), "c": np.array([1, "x"], dtype=object)},
    }
    classic = []
    for options in ({}, {"do_compression": True}, {"format": "4"}):
        file = folder / "seed.mat"
        savemat(file, {"t": values["t"], "u": values["u"]} if "format" in options else values, **options)
        classic.append(file.read_bytes())
    with h5py.File(folder / "seed.h5", "w", userblock_size=512) as file:
        file["t"], file["g/u"] = values["t"], values["u"]
        file["z"] = np.zeros(1000)
        file["r"] = np.array([file["t"].ref, file["g/u"].ref], dtype=h5py.ref_dtype)
        file.create_dataset("big", (2**20, 2**10), float, chunks=True, compression="gzip")
    return classic, [(folder / "seed.h5").read_bytes()]


def _csv(folder: Path, registry: Registry, text: str) -> None:
    read_file(folder, registry, "b.csv", text.encode("utf-8", "surrogatepass"))


def read_file(folder: Path, registry: Registry, name: str, data: bytes) -> None:
    file = folder / name
    file.write_bytes(data)
    reader = find_reader("", file, registry)
    refusals: list[FraexpError] = []
    for columns in (["t"], ["u"], ["y"], ["s.a", "s.c.1"], ["1"], ["u.2"], ["g.u.1", "r.1"], ["big"]):
        try:
            reader.read(file, columns)
        except FraexpError as error:
            refusals.append(error)
    found = list_contents(file, registry)
    try:
        propose_import(file, found, registry)
    except FraexpError as error:
        refusals.append(error)
    if len(refusals) > LIKELY:
        raise refusals[0]


def _json(rng: Random) -> str:
    seeds = ('{"a": [1, 2.5e3, null, {"b": true}], "c": "d\\u001b"}', "[]", '{"record": {"lines": [1, 2, 3]}}')
    return mutation.text(rng, rng.choice(seeds), seeds, ('"', "{", "[", ":", ",", "NaN", "Infinity", "\\ud800"))


def _plain_data(text: str) -> None:
    with contextlib.suppress(ValueError, RecursionError):  # which a store turns into its refusal
        parse_json(text)


def random_rows(rng: Random) -> list[tuple[str, str, Any]]:
    changes = []
    for _ in range(1 + int(rng.expovariate(1))):
        table = rng.choice(list(COLUMNS))
        value: Any = rng.choice(ODD)
        if rng.random() < 0.2:
            value = mutation.octets(rng, encode_array(np.arange(40.0), ""), [encode_array(np.zeros((3, 2)), "")])
        changes.append((table, rng.choice(COLUMNS[table]), value))
    return changes


COLUMNS = {table.name: [column.name for column in table.columns] for table in metadata.sorted_tables}


def _database(folder: Path, changes: Sequence[tuple[str, str, Any]], plot: bool = False) -> None:
    file = folder / "rows.db"
    shutil.copyfile(folder / "model.db", file)
    change_rows(file, changes)
    _shown(folder, file, plot or len(changes) > 1)


def change_rows(file: Path, changes: Sequence[tuple[str, str, Any]]) -> None:
    """Change columns of a database, with digests that fit where they can be computed."""
    with contextlib.closing(sqlite3.connect(file)) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")
        for table, column, new in changes:
            with contextlib.suppress(sqlite3.Error, OverflowError, UnicodeError):
                value = new.encode("utf-8", "replace").decode() if isinstance(new, str) else new
                connection.execute(f"UPDATE OR IGNORE {table} SET {column} = ?", (value,))
        connection.commit()
    with contextlib.suppress(Exception):  # strangers can compute digests; what has none is damaged
        reseal(str(file))


def _file(folder: Path, data: bytes) -> None:
    file = folder / "bytes.db"
    file.write_bytes(data)
    for name in ("bytes.db-wal", "bytes.db-shm"):
        (folder / name).unlink(missing_ok=True)
    _shown(folder, file)


def _shown(folder: Path, file: Path, plot: bool = False) -> None:
    """Show all that a database holds; no command fails but in a line, and none lets escape codes through."""
    place = ["--db", str(file), "--workspace", str(folder)]
    codes = [command([*words, *place]) for words in COMMANDS]
    keys = [line.split()[0] for line in codes[0][1].splitlines()[1:2] if line.split()]
    with contextlib.closing(sqlite3.connect(file)) as connection, contextlib.suppress(sqlite3.Error, UnicodeError):
        keys += [str(key)[4:] for (key,) in connection.execute("SELECT key FROM sweep LIMIT 3")]
    for key in keys:
        codes.append(command(["show", key, *place]))
        target = folder / f"out{SUFFIXES[len(key) % 4]}"
        codes.append(command(["export", key, "-o", str(target), "--force", *place]))
    if plot:
        codes.append(command(["plot", "1", "-o", str(folder / "out.png"), *place]))
    for code, text in codes:
        if code == ExitCode.INTERNAL:
            raise AssertionError(text.splitlines()[-1][:120])
        if ESCAPE in text or "\u202e" in text:
            raise AssertionError("escape codes are let through")
    _merge(folder, file)
    if any(code for code, _ in codes):
        raise FraexpError("refused")


def _merge(folder: Path, file: Path) -> None:
    """Merge a hostile database into a new one; all that is read is counted, and the new one is sound."""
    target = folder / "merged.db"
    for suffix in ("", "-wal", "-shm"):
        (folder / f"merged.db{suffix}").unlink(missing_ok=True)
    code, text = command(["merge", str(file), "--db", str(target), "--workspace", str(folder), "--json"])
    if code == ExitCode.INTERNAL:
        raise AssertionError(text.splitlines()[-1][:120])
    if code not in (ExitCode.OK, ExitCode.INCOMPLETE):
        return
    merged = json.loads(text[text.index("{") : text.rindex("}") + 1])
    sweeps = merged["added"] + merged["there"] + len(merged["conflicts"]) + len(merged["damaged"])
    runs = merged["runs"] + merged["known_runs"] + len(merged["run_conflicts"]) + len(merged["damaged_runs"])
    if (sweeps, runs) != (merged["read"], merged["read_runs"]):
        raise AssertionError(f"the counts of a merge do not add up: {sweeps} of {merged['read']} sweeps")


def command(words: list[str]) -> tuple[int, str]:
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        code = main(words)
    return code, out.getvalue()
