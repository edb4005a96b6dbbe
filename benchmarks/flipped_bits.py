"""Databases with flipped bits: nothing changed is shown, exported or merged as sound.

python benchmarks/flipped_bits.py --databases 200 --seed 1 takes a database of real studies, flips 1 to 20 random bits
anywhere in each copy of the file, and lets the commands list, show, compare, export, merge and doctor read it. What
they print is compared with what they print of the undamaged file. It prints a table and fails if a changed value was
shown as sound, something was left out without a word, the merge's counts do not add up, doctor called a database sound
of which something had changed, or a command ended with a traceback. The same seed makes the same databases. With
--base FILE another database is taken; --keep FOLDER keeps the copies with a finding.
"""

import argparse
import contextlib
import io
import json
import shutil
import sqlite3
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import h5py
import numpy as np
from scipy.io import loadmat

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main as fraexp
from fraexp.store import Store

STUDIES = ("quick", "record", "friction/hysteresis", "identification/friction_viscous")
ROOT = Path(__file__).parents[1]
MAX_FLIPS = 20
EXPORTED_SWEEPS = 2
SUFFIXES = (".csv", ".json", ".h5", ".mat", ".unv")
TIMING = ("heartbeat", "progress")
"""Keys of documents that only show how a run goes on."""
FINDINGS = ("changed and shown as sound", "left out without a word", "doctor calls it sound", "traceback", "counts")


@dataclass
class Reading:
    """All that the commands print of a database."""

    runs: dict[int, Any] = field(default_factory=dict)
    listed: dict[str, Any] = field(default_factory=dict)
    shown: dict[tuple[int, str], Any] = field(default_factory=dict)
    sweeps: dict[str, Any] = field(default_factory=dict)
    compared: dict[int, Any] = field(default_factory=dict)
    files: dict[tuple[str, str], Any] = field(default_factory=dict)
    refusals: dict[str, str] = field(default_factory=dict)
    """What was refused, by command, with the last line."""
    doctor: str = ""
    """What doctor says of the database; empty for sound."""
    merged: Any = None


def main() -> int:
    """Damage databases, and return 1 if there is a finding."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--databases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--base", type=Path, help="a database to damage; by default one of real studies is made")
    parser.add_argument("--keep", type=Path, help="folder for copies with a finding")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder) / "base.db"
        if given.base:
            shutil.copyfile(given.base, base)
        else:
            make_base(base)
        return attack(base, given.databases, given.seed, Path(folder), given.keep)


def make_base(file: Path) -> None:
    """Run real studies, one of them twice, and annotate some of their sweeps."""
    for study in (*STUDIES, STUDIES[0]):
        code, text = command(["run", study, "--workspace", str(ROOT), "--db", str(file), "--executor", "serial"])
        if code:
            raise SystemExit(f"{study}: {text.splitlines()[-1]}")
    with Store.open(str(file)) as store:
        keys = store.keys()
        store.tag(keys[::3], "baseline")
        for key in keys[::4]:
            store.annotate(key, f"measured by hand, see page {int(key[4:8], 16)}")


def attack(base: Path, count: int, seed: int, folder: Path, keep: Path | None = None) -> int:
    """Damage copies of a database, print the table, and return whether there is a finding."""
    prepare(base)
    whole = read(base, folder, doctor=True)
    # A run of one sweep has nothing to compare, and a sweep without numbers nothing to export.
    refused = [words for words in whole.refusals if not words.startswith(("compare", "export"))]
    if refused or whole.doctor:
        raise SystemExit(f"the undamaged database is refused: {refused or whole.doctor}")
    found: Counter[str] = Counter()
    started = time.monotonic()
    for index in range(count):
        random = Random(f"{seed}/{index}")
        copy = folder / "copy.db"
        shutil.copyfile(base, copy)
        flips = flip(copy, random)
        reading = read(copy, folder, doctor=True)
        findings = list(judge(whole, reading))
        outcome = "as undamaged" if is_same(whole, reading) else "refused in part or whole, or shown as damaged"
        found[outcome] += 1
        found["opened not at all"] += not reading.runs and not reading.listed
        found["doctor says what is damaged"] += bool(reading.doctor)
        for kind in {kind for kind, _ in findings}:
            found[kind] += 1
        for kind, what in findings[:5]:
            print(f"  database {index} ({flips} bits): {kind}: {what[:300]}", flush=True)
        if findings and keep:
            keep.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(copy, keep / f"{seed}-{index}.db")
    print(f"{count} databases of {base.stat().st_size / 1024:.0f} KiB with 1 to {MAX_FLIPS} flipped bits, seed {seed}:")
    for name in ("as undamaged", "refused in part or whole, or shown as damaged", "opened not at all"):
        print(f"  {name:48} {found[name]:5}")
    print(f"  {'doctor says what is damaged':48} {found['doctor says what is damaged']:5}")
    for name in FINDINGS:
        print(f"  {name:48} {found[name]:5}{'  missed' if found[name] else ''}")
    print(f"  {(time.monotonic() - started) / max(count, 1):.1f} s each")
    return int(any(found[name] for name in FINDINGS))


def prepare(file: Path) -> None:
    """Make the database a single file, without a log."""
    with contextlib.closing(sqlite3.connect(file)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    for suffix in ("-wal", "-shm"):
        Path(f"{file}{suffix}").unlink(missing_ok=True)


def flip(file: Path, random: Random) -> int:
    """Flip 1 to 20 random bits of a file, and return their number."""
    data = bytearray(file.read_bytes())
    count = random.randint(1, MAX_FLIPS)
    for bit in random.sample(range(8 * len(data)), count):
        data[bit // 8] ^= 1 << bit % 8
    file.write_bytes(bytes(data))
    return count


def read(file: Path, folder: Path, doctor: bool = False) -> Reading:
    """Return all that the commands print of a database."""
    for suffix in ("-wal", "-shm"):
        Path(f"{file}{suffix}").unlink(missing_ok=True)
    found = Reading()
    place = ["--db", str(file), "--workspace", str(folder)]
    _read_listings(found, place)
    keys = sorted(found.listed)
    for key in keys:
        document = _document(found, ["show", key, "--json", "--points", *place])
        if document:
            found.sweeps[key] = document
    for key in keys[:: max(1, len(keys) // EXPORTED_SWEEPS)]:
        for suffix in SUFFIXES:
            target = folder / f"out{suffix}"
            code, text = command(["export", key, "-o", str(target), "--force", *place])
            if code:
                found.refusals[f"export {key} {suffix}"] = text
            else:
                found.files[key, suffix] = _contents(target)
    _merge(found, file, folder)
    if doctor:
        found.doctor = _doctor(found, place)
    return found


def _read_listings(found: Reading, place: Sequence[str]) -> None:
    runs = _document(found, ["list", "--json", *place]) or {"runs": []}
    found.runs = {run["number"]: run for run in runs["runs"]}
    listed = _document(found, ["list", "--sweeps", "--limit", "10000", "--json", *place]) or {"sweeps": []}
    found.listed = {row["key"]: row for row in listed["sweeps"]}
    for number in found.runs:
        document = _document(found, ["show", str(number), "--json", "--points", *place])
        for row in document["sweeps"] if document else ():
            found.shown[number, row["key"]] = row
        if document:
            found.runs[number] = {name: value for name, value in document.items() if name != "sweeps"}
        compared = _document(found, ["compare", str(number), "--json", *place])
        if compared:
            found.compared[number] = compared


def _merge(found: Reading, file: Path, folder: Path) -> None:
    """Merge the database into a new one, and read that."""
    target = folder / "merged.db"
    for suffix in ("", "-wal", "-shm"):
        Path(f"{target}{suffix}").unlink(missing_ok=True)
    place = ["--db", str(target), "--workspace", str(folder)]
    code, text = command(["merge", str(file), "--json", *place])
    if code not in (ExitCode.OK, ExitCode.INCOMPLETE):
        found.refusals["merge"] = text
        return
    merged = json.loads(text[text.index("{") : text.rindex("}") + 1])
    inside = Reading()
    _read_listings(inside, place)
    found.merged = (merged, inside)


def _doctor(found: Reading, place: Sequence[str]) -> str:
    try:
        with Store.open(place[1], read_only=True) as store:
            finding = store.health()
    except Exception as error:
        if type(error).__name__ != "StoreError":
            found.refusals["doctor"] = f"Traceback {type(error).__name__}: {error}"
        return str(error) or type(error).__name__
    return "" if finding == "sound" else finding


def _document(found: Reading, words: list[str]) -> Any:
    code, text = command(words)
    if code not in (ExitCode.OK, ExitCode.INCOMPLETE):
        found.refusals[" ".join(words[:2])] = text
        return None
    return json.loads(text[text.index("{") : text.rindex("}") + 1])


def command(words: list[str]) -> tuple[int, str]:
    """Run a command, and return its exit code with all that it prints."""
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        code = fraexp(words)
    return code, out.getvalue() if code in (0, 1) and out.getvalue().strip() else errors.getvalue()


def _contents(file: Path) -> Any:
    """Return what a file says, without the time of its writing."""
    if file.suffix == ".mat":
        return {name: repr(value) for name, value in loadmat(file).items() if name != "__header__"}
    if file.suffix == ".h5":
        found: dict[str, Any] = {}
        with h5py.File(file) as opened:
            opened.visititems(lambda name, item: found.update({name: _hdf5_text(item)}))
            found["/"] = {name: repr(value) for name, value in opened.attrs.items()}
        return found
    return file.read_text(encoding="utf-8", errors="replace")


def _hdf5_text(item: Any) -> str:
    values = np.asarray(item[()]).tobytes() if isinstance(item, h5py.Dataset) else b""
    return f"{values!r} { {name: repr(value) for name, value in item.attrs.items()} }"


def judge(whole: Reading, reading: Reading) -> Iterator[tuple[str, str]]:
    """Yield the findings: their kind, and where."""
    for where, text in reading.refusals.items():
        if "Traceback" in text or "internal error" in text:
            yield "traceback", f"{where}: {text}"
    yield from _judge_listings(whole, reading, "")
    refused = not reading.listed or any(key not in whole.listed for key in reading.listed)
    for key, document in whole.sweeps.items():
        yield from _compare_sweep(
            f"show {key[4:12]}", document, reading.sweeps.get(key), f"show {key}" in reading.refusals or refused
        )
    for of, content in reading.files.items():
        if content != whole.files.get(of):
            yield "changed and shown as sound", f"export {of}"
    if reading.merged is not None:
        merged, inside = reading.merged
        named = {one["key"] for one in (*merged["damaged"], *merged["conflicts"])}
        named |= {one["key"] for one in (*merged["damaged_runs"], *merged["run_conflicts"])}
        yield from _judge_merge(whole, merged, inside, named)
    if not reading.doctor and not is_same(whole, reading):
        yield "doctor calls it sound", str(list(reading.refusals.items())[:1])


def _judge_listings(whole: Reading, reading: Reading, where: str) -> Iterator[tuple[str, str]]:
    refused = reading.refusals
    # A damaged sweep is shown as such, and counts as unusable in its runs, or no longer.
    is_listed = any(one["outcome"] == "damaged" for one in reading.listed.values())
    shows = {number for (number, _), one in reading.shown.items() if one["outcome"] == "damaged"}
    for number, document in whole.runs.items():
        now = reading.runs.get(number)
        counted = {"unusable"} if is_listed or number in shows else set()
        if now is None:
            if "list --json" not in refused:
                yield "left out without a word", f"{where}run {number}"
        elif now["state"] != "damaged" and not _is_part(now, {**document, **{name: now.get(name) for name in counted}}):
            yield "changed and shown as sound", f"{where}run {number}: {_difference(document, now)}"
    for number in reading.runs.keys() - whole.runs.keys():
        if reading.runs[number]["state"] != "damaged":
            yield "changed and shown as sound", f"{where}run {number} is new"
    # A damaged sweep may be shown under a damaged key.
    renamed = {key for key in (*reading.listed, *(of for _, of in reading.shown)) if key not in whole.listed}
    for key, document in whole.listed.items():
        gone = "list --sweeps" in refused or bool(renamed)
        yield from _compare_sweep(f"{where}list {key[4:12]}", document, reading.listed.get(key), gone)
    for (number, key), document in whole.shown.items():
        gone = (
            f"show {number}" in refused
            or bool(renamed)
            or reading.runs.get(number, {"state": "damaged"})["state"] == "damaged"
        )
        yield from _compare_sweep(f"{where}show {number} {key[4:12]}", document, reading.shown.get((number, key)), gone)
    for key in reading.listed.keys() - whole.listed.keys():
        if reading.listed[key]["outcome"] != "damaged":
            yield "changed and shown as sound", f"{where}list {key} is new"
    for number, compared in reading.compared.items():
        yield from _judge_comparison(f"{where}compare {number}", whole.compared.get(number), compared)


def _judge_comparison(where: str, before: Any, now: Any) -> Iterator[tuple[str, str]]:
    """Compare the values of each sweep that both have; those that all sweeps share are not in either."""
    if before is None:
        return
    places = {of["key"]: index for index, of in enumerate(before["sweeps"])}
    for index, of in enumerate(now["sweeps"]):
        if of["key"] not in places:
            yield "changed and shown as sound", f"{where}: {of['key']} is new"
            continue
        for group in ("parameters", "metrics", "fits"):
            for name, values in now[group].items():
                if name in before[group] and values[index] != before[group][name][places[of["key"]]]:
                    yield "changed and shown as sound", f"{where}: {name} of {of['key'][4:12]}"
    if now["sweeps"] and before["sweeps"] and now["sweeps"][0]["key"] == before["sweeps"][0]["key"]:
        known = {of["key"]: of for of in before["responses"]}
        for of in now["responses"]:
            if of != known.get(of["key"]):
                yield "changed and shown as sound", f"{where}: response of {of['key'][4:12]}"


def _judge_merge(whole: Reading, merged: Any, inside: Reading, named: set[str]) -> Iterator[tuple[str, str]]:
    sums = merged["added"] + merged["there"] + len(merged["conflicts"]) + len(merged["damaged"])
    runs = merged["runs"] + merged["known_runs"] + len(merged["run_conflicts"]) + len(merged["damaged_runs"])
    if sums != merged["read"] or runs != merged["read_runs"]:
        yield "counts", f"{sums} of {merged['read']} sweeps, {runs} of {merged['read_runs']} runs"
    damaged_runs = {int(of["key"].split()[1]) for of in merged["damaged_runs"]}
    for key, document in whole.listed.items():
        now = inside.listed.get(key)
        if now is None and key not in named:
            yield "left out without a word", f"merge {key[4:12]}"
        elif now is not None and key not in named and document["run"] not in damaged_runs and not damaged_runs:
            yield from _compare_sweep(f"merged {key[4:12]}", {**document, "run": 0}, {**now, "run": 0}, False)
    known: dict[str, Mapping[str, Any]] = {key: row for (_, key), row in whole.shown.items()}
    for (_, key), now in inside.shown.items():
        if key not in known:
            yield "changed and shown as sound", f"merged {key} is new"
            continue
        same = ("experiment", "estimator", "metrics", "response", "curves", "fits", "outcome", "created", "elapsed")
        for name in same:
            if now["outcome"] is not None and now.get(name) != known[key].get(name):
                yield "changed and shown as sound", f"merged {key[4:12]}: {name}"


def _compare_sweep(where: str, before: Any, now: Any, refused: bool) -> Iterator[tuple[str, str]]:
    if now is None:
        if not refused:
            yield "left out without a word", where
    elif now["outcome"] != "damaged" and not _is_part(now, before):
        yield "changed and shown as sound", f"{where}: {_difference(before, now)}"


def _is_part(now: Mapping[str, Any], before: Mapping[str, Any]) -> bool:
    """Return whether all that a document says was said of the undamaged database; a refused command says nothing."""
    return all(before.get(name) == value for name, value in _plain(now).items())


def _plain(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a document without what only shows how a run goes on, and without what is shown as damaged."""
    return {name: value for name, value in document.items() if name not in TIMING and value != "damaged"}


def _difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    return "; ".join(
        f"{name}: {str(before.get(name))[:60]} -> {str(now.get(name))[:60]}"
        for name in {**before, **now}
        if before.get(name) != now.get(name)
    )


def is_same(whole: Reading, reading: Reading) -> bool:
    """Return whether a database reads like the undamaged one."""
    if reading.refusals.keys() != whole.refusals.keys():
        return False
    runs = {number: _plain(of) for number, of in reading.runs.items()}
    return runs == {number: _plain(of) for number, of in whole.runs.items()} and all(
        getattr(whole, name) == getattr(reading, name) for name in ("listed", "shown", "sweeps", "compared", "files")
    )


if __name__ == "__main__":
    sys.exit(main())
