"""A report of runs as one HTML file that needs nothing else: figures, tables, and printed numbers beside ours."""

import os
import shlex
from base64 import b64encode
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import nan
from pathlib import Path
from string import Template
from typing import Any

from fraexp.components.registry import Registry
from fraexp.data.results import Result
from fraexp.data.units import factor, with_powers
from fraexp.errors import FraexpError, StudyError
from fraexp.figures.elements.label_units import label_units
from fraexp.figures.elements.labels import label_columns, label_texts, printable
from fraexp.store import RunSummary, Store, StoredSweep
from fraexp.study.published_values import (
    HALF_WIDTH,
    Candidate,
    PublishedComparison,
    half_widths,
    readable,
    rounded,
    written,
)
from fraexp.study.study_file import Study, described, find_studies

MOST = 50
"""Sweeps of a run that are shown one by one."""
UPRIGHT = 6
"""Up to so many sweeps stand side by side, with a row for each number."""
LEAST_SHARE = 0.001
"""Differences from this share on [%] are told as a share too."""
LONG = 28
"""Characters from which a table's cell breaks into lines."""
SUFFIXES = (".html", ".htm")
MARK = '<meta name="generator" content="fraexp report">'
"""In the head of a report: by it one is told from other files."""
HEAD = 1000
"""Bytes within which the mark is looked for."""
Row = Sequence[str]


@dataclass(frozen=True)
class Chapter:
    """What a report says of one run."""

    run: RunSummary
    study: Study
    """Its words and printed numbers, without sweeps."""
    sweeps: Sequence[StoredSweep]
    results: Mapping[str, Result]
    units: Mapping[str, str]
    """Units of the labels, by path."""
    compared: Sequence[PublishedComparison]
    figures: Sequence[Path]
    command: str
    """What makes the run again."""
    notes: Sequence[str]
    """What had to be left out."""


def chapter(
    store: Store,
    number: int,
    folder: Path,
    registry: Registry,
    draw: Callable[[Study, Sequence[StoredSweep]], Iterable[Path]],
) -> Chapter:
    """Gather what a report says of a stored run; `draw` returns the PNG files that show it."""
    run, sweeps = store.run(number), store.sweeps(number)
    results = store.results(sweep.key for sweep in sweeps)
    study, notes = _study(run, folder)
    sections = [{**sweep.experiment, "estimator": sweep.estimator} for sweep in sweeps]
    units = label_units(((of.labels, parts) for of, parts in zip(sweeps, sections, strict=True)), registry)
    candidates = [
        Candidate(sweep.labels, parts, results[sweep.key].metrics, half_widths(results[sweep.key]))
        for sweep, parts in zip(sweeps, sections, strict=True)
        if sweep.key in results
    ]
    compared = [printed.beside(candidates) for printed in study.printed]
    try:
        figures = list(draw(study, sweeps))
    except FraexpError as error:
        figures, notes = [], [*notes, f"no figure: {error}"]
    return Chapter(run, study, sweeps, results, units, compared, figures, _command(run, folder), notes)


def _study(run: RunSummary, folder: Path) -> tuple[Study, list[str]]:
    """Return the words of a run's study, as its file has them today."""
    bare = Study(run.study, Path(run.study_file), run.study, "", ())
    if not run.study_file.endswith(".toml"):  # a fit to stored responses
        return bare, []
    try:
        return described(run.study, _file(run, folder)), []
    except FraexpError as error:
        return bare, [f"title, question and printed numbers are left out: {error}"]


def _file(run: RunSummary, folder: Path) -> Path:
    """Return the study's file: where the run found it, or where a study of this name is now."""
    file = Path(run.study_file)
    return file if file.is_file() else find_studies(run.study, folder)[0][1]


def _command(run: RunSummary, folder: Path) -> str:
    """Return the command that makes this run again, alone among those that were run with it."""
    words = shlex.split(run.command)
    if words[:2] != ["fraexp", "run"]:
        return run.command
    try:
        file = find_studies(run.study, folder)[0][1]
        name = run.study if os.path.realpath(file) == os.path.realpath(run.study_file) else run.study_file
    except StudyError:
        name = run.study_file
    return shlex.join([*words[:2], name, *(word for word in words if word.startswith("--set="))])


def check_target(path: Path, force: bool = False) -> None:
    """Raise FraexpError if a report cannot be written there, or would replace a file that is no earlier report."""
    if path.suffix.lower() not in SUFFIXES:
        raise FraexpError(f"{path}: a report cannot be written as '{path.suffix}'; choose a name that ends in .html")
    try:
        if force or not path.exists():
            return
        with path.open("rb") as file:
            ours = MARK.encode() in file.read(HEAD)
    except OSError as error:
        raise FraexpError(f"{path}: the report cannot be written: {error.strerror or error}") from None
    if not ours:
        raise FraexpError(f"{path}: the file exists and is no earlier report; give --force to replace it")


def write(path: Path, title: str, chapters: Sequence[Chapter]) -> None:
    """Write a report; the file appears whole or not at all."""
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_text(render(title, chapters), encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise FraexpError(f"{path}: the report cannot be written: {error.strerror or error}") from None


def render(title: str, chapters: Sequence[Chapter]) -> str:
    """Return the report as HTML. The same runs give the same text."""
    anchors = [f"run-{number}" for number in range(1, len(chapters) + 1)]
    entries = [
        f'<li><a href="#{anchor}">{_text(of.run.study)}</a> {_text(of.study.title)}</li>'
        for anchor, of in zip(anchors, chapters, strict=True)
    ]
    pairs = [(of, one) for of in chapters for one in of.compared]
    hrefs = dict(zip((of.run.number for of in chapters), anchors, strict=True))
    studies = [f'<a href="#{hrefs[of.run.number]}">{_text(of.run.study)}</a>' for of, _ in pairs]
    return PAGE.substitute(
        mark=MARK,
        title=_text(title),
        about=_about([of.run for of in chapters]),
        contents="".join(entries),
        summary=_summary([one for _, one in pairs], studies),
        chapters="".join(_section(anchor, of) for anchor, of in zip(anchors, chapters, strict=True)),
        packages=_packages([of.run for of in chapters]),
    )


def verdict(compared: Sequence[PublishedComparison]) -> str:
    """Return in words how many printed numbers are met; empty if there are none."""
    agreeing, plural = sum(one.agrees for one in compared), "" if len(compared) == 1 else "s"
    return f"{agreeing} of {len(compared)} printed number{plural} met" if compared else ""


def _summary(compared: Sequence[PublishedComparison], studies: Sequence[str]) -> str:
    if not compared:
        return ""
    return f"<h2>Printed numbers and ours</h2><p>{verdict(compared)}.</p>{_compared(compared, studies)}"


def _compared(compared: Sequence[PublishedComparison], studies: Sequence[str] = ()) -> str:
    """Return the table of printed numbers; `studies` are links, if the table is not within its study's chapter."""
    if not compared:
        return ""
    titles = ["number", "source", *(["study"] if studies else []), "unit", "printed", "ours", "difference", "expected"]
    rows = []
    for index, one in enumerate(compared):
        of = one.printed
        cells = [
            _text(of.what),
            _text(of.source),
            *studies[index : index + 1],
            _text(_unit(of.unit)),
        ]
        if one.remark:
            rows.append([*cells, f"{of.value:g}", "–", "", _expected(one), f'<b class="no">{_text(one.remark)}</b>'])
            continue
        met = "<b>yes</b>" if one.agrees else '<b class="no">no</b>'
        ours = written(one.ours, one.half, of.margin)
        rows.append([*cells, f"{of.value:g}", ours, _difference(one), _expected(one), met])
    return _table([*titles, "met"], rows)


def _difference(one: PublishedComparison) -> str:
    """Return the difference in the digits of what is expected, with the share that it is of the printed number."""
    of = one.printed
    if of.compare != "about":
        return f"{'' if one.difference < 0 else '+'}{written(one.difference)}"
    share = 100 * one.difference / of.value if of.value else 0.0
    difference = rounded(one.difference, of.margin / 10)
    signed = difference if difference.startswith("-") else f"+{difference}"
    return signed + (f" ({share:+.2g} %)" if abs(share) >= LEAST_SHARE else "")


def _expected(one: PublishedComparison) -> str:
    of = one.printed
    if of.compare != "about":
        return f"{of.compare} {of.value:g}"
    return f"± {_text(of.tolerance if isinstance(of.tolerance, str) else f'{of.margin:g}')}"


def _section(anchor: str, of: Chapter) -> str:
    run = of.run
    figures = "".join(_figure(path, of.study.title) for path in of.figures)
    took = f", {(run.ended - run.started).total_seconds():.2g} s" if run.ended else ""
    computing = sum(sweep.elapsed for sweep in of.sweeps)
    return "".join([
        f'<section id="{anchor}"><h2>{_text(run.study)}: {_text(of.study.title)}</h2>',
        f"<p>{_text(of.study.question)}</p>" if of.study.question else "",
        *(f'<p class="no">{_text(note)}</p>' for note in of.notes),
        figures,
        _compared(of.compared),
        _sweeps(of),
        f"<p>Run {run.number}, {_text(run.state)}, {run.started:%Y-%m-%d %H:%M} UTC{took}: {run.computed} computed, "
        f"{run.reused} reused, {run.failed} failed; computing time of all {run.total} sweeps {computing:.2g} s. "
        f"To make it again: <code>{_text(of.command)}</code></p></section>",
    ])  # fmt: skip


def _figure(path: Path, title: str) -> str:
    data = b64encode(path.read_bytes()).decode("ascii")
    return f'<img alt="{_text(title)}" src="data:image/png;base64,{data}">'


def _sweeps(of: Chapter) -> str:
    """Return the table of sweeps: labels, outcome, settled points, metrics, message."""
    shown = of.sweeps[:MOST]
    names = label_columns([sweep.labels for sweep in shown])
    columns = dict(_labels(name, of.units.get(path, ""), [sweep.labels.get(path) for sweep in shown])
                   for path, name in names.items())  # fmt: skip
    columns["outcome"] = [sweep.outcome.name.lower().replace("_", " ") if sweep.outcome else sweep.state
                          for sweep in shown]  # fmt: skip
    columns["settled"] = [_settled(of.results.get(sweep.key)) for sweep in shown]
    columns |= _metrics([of.results.get(sweep.key) for sweep in shown],
                        {one.metric: one.unit for one in of.study.printed})  # fmt: skip
    columns["message"] = [sweep.message for sweep in shown]
    known = {title: [_text(cell) for cell in cells] for title, cells in columns.items() if any(cells)}
    rows = [[_text(title), *cells] for title, cells in known.items()]
    left_out = len(of.sweeps) - len(shown)
    more = f"<p>{left_out} more sweeps: <code>fraexp show {of.run.number} --all</code></p>" if left_out else ""
    table = [list(row) for row in zip(*rows, strict=True)]
    if len(shown) <= UPRIGHT and len(rows) > len(shown):
        table = rows
    return _table(table[0], table[1:]) + more if shown else ""


def _labels(name: str, unit: str, values: Sequence[Any]) -> tuple[str, list[str]]:
    """Return title and cells of a column of labels."""
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return _title(name, unit), label_texts(values)
    scale, shown = readable(unit, values)
    return _title(name, shown), label_texts([float(f"{scale * value:.12g}") if scale != 1 else value
                                             for value in values])  # fmt: skip


def _metrics(results: Sequence[Result | None], stated: Mapping[str, str]) -> dict[str, list[str]]:
    """Return a column of cells for each metric, by its title, in the unit that is stated for it or that people use."""
    found = [{(metric.name, metric.unit): metric.value for metric in result.metrics} if result else {}
             for result in results]  # fmt: skip
    halves = [half_widths(result) if result else {} for result in results]
    columns = {}
    for name, unit in dict.fromkeys(key for values in found for key in values):
        if name.endswith(HALF_WIDTH) and any(name.removesuffix(HALF_WIDTH) in half for half in halves):
            continue
        column = [values.get((name, unit)) for values in found]
        scale, shown = _scale(unit, stated.get(name), [value for value in column if value is not None])
        columns[_title(name, shown)] = [
            "" if value is None else written(scale * value, scale * half.get(name, nan))
            for value, half in zip(column, halves, strict=True)
        ]
    return columns


def _scale(unit: str, stated: str | None, values: Sequence[float]) -> tuple[float, str]:
    """Return the factor to, and the name of, the unit of a column."""
    try:
        return (factor(unit, stated), stated) if stated else readable(unit, values)
    except FraexpError:  # the table of printed numbers says so
        return readable(unit, values)


def _settled(result: Result | None) -> str:
    response = result.response if result else None
    return f"{int(response.settled.sum())}/{len(response.settled)}" if response is not None else ""


def _title(name: str, unit: str) -> str:
    return f"{name} [{_unit(unit)}]" if _unit(unit) else name


def _unit(unit: str) -> str:
    shown = with_powers(unit)
    return "" if unit == "1" else f"µ{shown[1:]}" if shown.startswith("u") and len(shown) > 1 else shown


def _table(titles: Row, rows: Iterable[Row]) -> str:
    """Return a table of cells that are HTML already."""
    head = "".join(f"<th>{title}</th>" for title in titles)
    body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _cell(html: str) -> str:
    return f'<td class="long">{html}</td>' if len(html) > LONG and not html.startswith("<a") else f"<td>{html}</td>"


def _about(runs: Sequence[RunSummary]) -> str:
    """Return when and with what the runs were made."""
    last = max(((run.ended or run.started) for run in runs), default=None)
    codes = dict.fromkeys(_code(run.provenance) for run in runs)
    date = f"Results of {last:%Y-%m-%d %H:%M} UTC. " if last else ""
    return _text(f"{date}Made with {'; '.join(codes)}.")


def _code(provenance: Mapping[str, Any]) -> str:
    git, python, machine = (provenance.get(key) or {} for key in ("git", "python", "machine"))
    changed = ", with local changes" if git.get("dirty") else ""
    parts = [
        f"fraexp {provenance.get('fraexp') or '(version unknown)'}",
        f"commit {git['commit'][:12]}{changed}" if git.get("commit") else "",
        f"Python {python['version']}" if python.get("version") else "",
        machine.get("platform") or "",
        f"{machine['cpu']}, {machine.get('usable_cores')} cores" if machine.get("cpu") else "",
    ]
    return ", ".join(part for part in parts if part)


def _packages(runs: Sequence[RunSummary]) -> str:
    pairs = {(name, version) for run in runs for name, version in (run.provenance.get("packages") or {}).items()}
    return _text(", ".join(f"{name} {version}" for name, version in sorted(pairs, key=str)))


def _text(value: object) -> str:
    """Return any text in one line, fit to stand in HTML: names come from strangers."""
    return escape(printable(" ".join(str(value).split())))


PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
$mark
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>$title</title>
<style>
:root { color-scheme: light dark; --ink: #1b1b1b; --paper: #fff; --link: #0b57a4; --line: #ddd; --no: #b3261e; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e2e2e2; --paper: #16181b; --link: #7db7f0; --line: #3a3d42; --no: #f2928c; }
}
body { font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem;
  color: var(--ink); background: var(--paper); }
a { color: var(--link); }
h2 { margin-top: 3rem; line-height: 1.25; }
img { display: block; max-width: 100%; height: auto; margin: 1rem 0; background: #fff; border-radius: 4px; }
.wide { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: 0.875rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: 0.25rem 0.75rem 0.25rem 0;
  border-bottom: 1px solid var(--line); }
td { white-space: nowrap; }
td.long { white-space: normal; min-width: 12rem; }
code { overflow-wrap: anywhere; }
.no { color: var(--no); }
@media print { section { break-before: page; } }
</style>
</head>
<body>
<h1>$title</h1>
<p>$about Behind a number of ours, ± is half the width of its 95 % interval.</p>
<nav><ol>$contents</ol></nav>
$summary
$chapters
<details><summary>Packages</summary><p>$packages</p></details>
</body>
</html>
""")
