"""Databases with flipped bits: what the commands print of a damaged copy against what they print of the original.

1 to 20 random bits are flipped anywhere in each copy of the file, and the commands list, show, compare, export, merge
and doctor read it. A changed value may not be shown as sound, nothing may be left out silently, the merge's counts must
add up, doctor may not call a database sound of which something has changed, and no command may end with a traceback.
"""

import contextlib
import io
import json
import shutil
import sqlite3
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
from scipy.io import loadmat

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main as fraexp
from fraexp.store import Store

MAX_FLIPS = 20
EXPORTED_SWEEPS = 2
SUFFIXES = (".csv", ".json", ".h5", ".mat")
TIMING = ("heartbeat", "progress")
"""Keys of documents that only show how a run goes on."""
MERGED = ("experiment", "estimator", "metrics", "response", "curves", "fits", "outcome", "created", "elapsed")
"""What a merge keeps of a sweep."""
FINDINGS = ("changed and shown as sound", "left out silently", "doctor calls it sound", "traceback", "counts")
Row = Mapping[str, Any]


@dataclass
class Reading:
    """All that the commands print of a database."""

    rows: dict[tuple[str, str], Row] = field(default_factory=dict)
    """What a command prints of a run or a sweep, by command and its number or key."""
    refusals: dict[str, str] = field(default_factory=dict)
    """What was refused, by command, with the last line."""
    doctor: str = ""
    """What doctor says of the database; empty for sound."""
    merge: Any = None
    """The merge's counts, and the reading of what it has made."""

    def of(self, command: str) -> dict[str, Row]:
        """Return the rows of a command by number or key."""
        return {row_id: row for (name, row_id), row in self.rows.items() if name == command}

    @property
    def commands(self) -> list[str]:
        """The commands that printed something."""
        return list(dict.fromkeys(name for name, _ in self.rows))


def attack(base: Path, count: int, seed: int, folder: Path, keep: Path | None = None) -> Counter[str]:
    """Damage copies of a database; return how many came to what, with all findings, and print where these are."""
    prepare(base)
    whole = read(base, folder)
    # A run of one sweep has nothing to compare, and a sweep without numbers nothing to export.
    refused = [words for words in whole.refusals if not words.startswith(("compare", "export"))]
    if refused or whole.doctor:
        raise SystemExit(f"the undamaged database is refused: {refused or whole.doctor}")
    found: Counter[str] = Counter(dict.fromkeys(FINDINGS, 0))
    for index in range(count):
        copy = folder / "copy.db"
        shutil.copyfile(base, copy)
        flips = flip(copy, Random(f"{seed}/{index}"))
        reading = read(copy, folder)
        findings = list(judge(whole, reading))
        found["as undamaged" if is_same(whole, reading) else "refused in part or whole, or shown as damaged"] += 1
        found["doctor says what is damaged"] += bool(reading.doctor)
        found.update({kind for kind, _ in findings})
        for kind, what in findings[:5]:
            print(f"  database {index} ({flips} bits): {kind}: {what[:300]}", flush=True)
        if findings and keep:
            keep.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(copy, keep / f"{seed}-{index}.db")
    return found


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


def read(file: Path, folder: Path) -> Reading:
    """Return all that the commands print of a database."""
    for suffix in ("-wal", "-shm"):
        Path(f"{file}{suffix}").unlink(missing_ok=True)
    found, place = Reading(), ["--db", str(file), "--workspace", str(folder)]
    _read_listings(found, place)
    keys = sorted(found.of("list --sweeps"))
    for key in keys:
        if document := _document(found, ["show", key, "--json", "--points", *place]):
            found.rows[f"show {key}", key] = document
    for key in keys[:: max(1, len(keys) // EXPORTED_SWEEPS)]:
        for suffix in SUFFIXES:
            target, words = folder / f"out{suffix}", f"export {key} {suffix}"
            code, text = command(["export", key, "-o", str(target), "--force", *place])
            if code:
                found.refusals[words] = text
            else:
                found.rows[words, key] = {"file": _contents(target)}
    _merge(found, file, folder)
    try:
        with Store.open(str(file), read_only=True) as store:
            finding = store.health()
            found.doctor = "" if finding == "sound" else finding
    except Exception as error:
        if type(error).__name__ != "StoreError":
            found.refusals["doctor"] = f"Traceback {type(error).__name__}: {error}"
        found.doctor = str(error) or type(error).__name__
    return found


def _read_listings(found: Reading, place: Sequence[str]) -> None:
    runs = _document(found, ["list", "--json", *place]) or {"runs": []}
    listed = _document(found, ["list", "--sweeps", "--limit", "10000", "--json", *place]) or {"sweeps": []}
    found.rows |= {("list --sweeps", row["key"]): row for row in listed["sweeps"]}
    for row in runs["runs"]:
        number = str(row["number"])
        document = _document(found, ["show", number, "--json", "--points", *place]) or {"sweeps": [], **row}
        found.rows["list", number] = {name: value for name, value in document.items() if name != "sweeps"}
        found.rows |= {(f"show {number}", each["key"]): each for each in document["sweeps"]}
        compared = _document(found, ["compare", number, "--json", *place]) or {"sweeps": [], "responses": []}
        curves = {each["key"]: each for each in compared["responses"]}
        for index, sweep in enumerate(compared["sweeps"]):
            groups = [(group, compared[group]) for group in ("parameters", "metrics", "fits")]
            cells = {f"{group}.{name}": each[index] for group, named in groups for name, each in named.items()}
            is_first = compared["sweeps"][0]["key"]  # whose response the others are compared with
            found.rows[f"compare {number}", sweep["key"]] = {**cells, is_first: curves.get(sweep["key"])}


def _merge(found: Reading, file: Path, folder: Path) -> None:
    """Merge the database into a new one, and read that."""
    target = folder / "merged.db"
    for suffix in ("", "-wal", "-shm"):
        Path(f"{target}{suffix}").unlink(missing_ok=True)
    place = ["--db", str(target), "--workspace", str(folder)]
    if merged := _document(found, ["merge", str(file), "--json", *place], "merge"):
        inside = Reading()
        _read_listings(inside, place)
        found.merge = merged, inside


def _document(found: Reading, words: list[str], name: str = "") -> Any:
    """Return the JSON that a command prints; None if it is refused."""
    code, text = command(words)
    if code not in (ExitCode.OK, ExitCode.INCOMPLETE):
        found.refusals[name or " ".join(words[:2])] = text
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
    # A damaged sweep may be shown under a damaged key; it counts as unusable in its runs, or no longer.
    is_any_damaged = any(map(is_damaged, reading.rows.values()))
    is_renamed = any(key not in whole.of("list --sweeps") for key in reading.of("list --sweeps"))
    for name in dict.fromkeys([*whole.commands, *reading.commands]):
        before, now = whole.of(name), reading.of(name)
        is_whole = not (name.startswith(("export", "compare")) or is_renamed or _is_refused(reading, name))
        for row_id in before.keys() - now.keys() if is_whole else ():
            yield "left out silently", f"{name}: {row_id}"
        for row_id, row in now.items():
            if is_damaged(row):
                continue
            known = before.get(row_id)
            if known is None:
                yield "changed and shown as sound", f"{name}: {row_id} is new"
            elif wrong := [key for key, value in _sound(row, is_any_damaged) if not _holds(name, known, key, value)]:
                yield "changed and shown as sound", f"{name}: {row_id}: {', '.join(wrong)}"
    if reading.merge is not None:
        yield from _judge_merge(whole, *reading.merge)
    if not reading.doctor and not is_same(whole, reading):
        yield "doctor calls it sound", str(list(reading.refusals.items())[:1])


def _is_refused(reading: Reading, name: str) -> bool:
    """Return whether a command was refused, or shows a run or sweep that a listing does not show as sound."""
    listed = reading.of("list") | reading.of("list --sweeps")
    of = name.removeprefix("show ")
    is_unsound = name.startswith("show") and (of not in listed or is_damaged(listed[of]))
    return is_unsound or (f"{name} --json" if name == "list" else name) in reading.refusals


def is_damaged(row: Row) -> bool:
    """Return whether a run or sweep is shown as damaged."""
    return "damaged" in (row.get("outcome"), row.get("state"))


def _sound(row: Row, is_any_damaged: bool) -> Iterator[tuple[str, Any]]:
    """Yield what a row says for sound, without what only shows how a run goes on."""
    for key, value in row.items():
        if key not in TIMING and value != "damaged" and not (is_any_damaged and key == "unusable"):
            yield key, value


def _holds(name: str, known: Row, key: str, value: Any) -> bool:
    """Return whether a value was that of the undamaged database; a comparison leaves out what all sweeps share."""
    return known.get(key, value if name.startswith("compare") else None) == value


def _judge_merge(whole: Reading, merged: Any, inside: Reading) -> Iterator[tuple[str, str]]:
    sums = merged["added"] + merged["there"] + len(merged["conflicts"]) + len(merged["damaged"])
    runs = merged["runs"] + merged["known_runs"] + len(merged["run_conflicts"]) + len(merged["damaged_runs"])
    if sums != merged["read"] or runs != merged["read_runs"]:
        yield "counts", f"{sums} of {merged['read']} sweeps, {runs} of {merged['read_runs']} runs"
    named = {one["key"] for one in (*merged["damaged"], *merged["conflicts"])}
    known = {key: row for (name, key), row in whole.rows.items() if name.startswith("show")}
    for key in whole.of("list --sweeps").keys() - inside.of("list --sweeps").keys() - named:
        yield "left out silently", f"merge {key}"
    for (name, key), row in inside.rows.items():
        if not name.startswith("show") or row["outcome"] in (None, "damaged"):
            continue
        if key not in known:
            yield "changed and shown as sound", f"merged {key} is new"
        elif wrong := [part for part in MERGED if row.get(part) != known[key].get(part)]:
            yield "changed and shown as sound", f"merged {key}: {', '.join(wrong)}"


def is_same(whole: Reading, reading: Reading) -> bool:
    """Return whether a database reads like the undamaged one."""
    plain = [{place: dict(_sound(row, False)) for place, row in each.rows.items()} for each in (whole, reading)]
    return reading.refusals.keys() == whole.refusals.keys() and plain[0] == plain[1]
