"""The parsers of texts and plain data, each with valid inputs to begin with."""

import contextlib
import io
import json
import tomllib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import pytest

from fraexp.cli.main import UsageError, parse
from fraexp.components.registry import Registry
from fraexp.data import toml, units
from fraexp.data.identity import TAG
from fraexp.data.texts import printable
from fraexp.errors import FraexpError
from fraexp.records import RecordSettings, resolve
from fraexp.records.channels import parse_channel
from fraexp.records.study_writer import ImportRequest, study_data, study_text
from fraexp.store.queries.filters import parse_filter, parse_number, parse_time_span
from fraexp.study import study_file
from fraexp.study.published_values import PublishedNumber
from fraexp.study.random_draws import Draws
from fraexp.study.sections import override
from fraexp.views import entries
from fraexp.views.words import flatten, value_text
from tests.fuzz import mutation
from tests.fuzz.watching import Target

FEW = 60
"""Sweeps of a study here: what a point of a grid leads to is looked at, and as many are refused as usual."""
UNITS = (
    "1 mm", "0.1 um", "12 N", "3 N/um", "1.5 rad/s", "2 m/s**2", "5 kg*m^2/s^2", "90 deg", "1", "1e-3 V",
    "2 (m/s)**2", "3 m²", "4 N*m", "5 s⁻¹", "6 inch squared", "7 per s", "8 m/(s*K)", "9 m**0.5",
)  # fmt: skip
UNIT_WORDS = ("m", "um", "**", "^", "squared", "cubed", "²", "(", ")", "/", "per")
CHANNELS = (
    "iq [A]", "volts * 31.5 [N]", "(volts - 2.5) * 31.5 + 4 [N]", "(a - b) / 2 [um]", "counts / 4096 + 0.5", "y",
    "data.y.3", "force(:,:,1,2) [N]", "x{level} [mm]",
)  # fmt: skip
FILTERS = (
    "estimator=effective_input excitation.amplitude>=12 -tag:baseline",
    '"two words" state!=failed',
    "metric.gain<0.1um run=1",
    "created:today message:'x'",
    'study:"a\\"b" elapsed>1',
    "created=2026-03-31T12:00 -outcome:ok key:fx1 plant.gain=1e-3",
)
OVERRIDES = (
    "excitation.amplitude=20",
    'estimator={ name = "effective_input", friction = "dahl" }',
    "grid.excitation.amplitude=[12, 75]",
    "random.seed=3",
    "plant.modes=[{ frequency = 40, damping = 0.01 }]",
    "loop.resolution=1 um",
    "record.file=../x.csv",
    "limits.stroke=1 mm",
)
COMMAND_LINES = (
    "run quick paper --set excitation.points=5 --executor processes:2 --rerun all --time-limit 90 --memory-limit 2GB",
    "run own --dry-run --json --db sqlite:///a.db --workspace w",
    "list outcome=ok created:today --sort -elapsed --json",
    "show 1 fx1-2a --json",
    "plot 1 --kind bode -o a.pdf --force --frequency-range 1:100",
    "import a.csv --channel u=force[N] --channel y=y --sample-rate 1000 --samples-per-period 100 --harmonics 1,2,3",
    "check rolling --quick --json",
    "merge other.db --json",
    "tag 1 baseline",
    "compare 1 2",
    "delete 1 --dry-run",
    "fit own --estimator modal_fit --frequencies 1,2,3",
)
CSV = "t [s],u [N],y [mm],level\n" + "".join(
    f"{k / 100},{k % 10 - 4.5},{(k % 10) ** 2},{k // 50 + 1}\n" for k in range(100)
)
SECTION: dict[str, Any] = {"file": "a.csv", "channels": {"u": "u", "y": "y"}}
PERIODIC = SECTION | {"samples_per_period": 10}
RECORDS: tuple[dict[str, Any], ...] = (
    PERIODIC | {"channels": {"u": "u", "y": {"column": "y", "scale": -1.0}}, "time_column": "t"},
    SECTION | {"file": ["a.csv"], "sample_rate": 100.0, "period_time": "0.1 s", "skip_periods": 1},
    SECTION | {"time_column": "t", "steps": [{"start": 0.0, "stop": 1.0, "frequency": 10}]},
    SECTION | {"periodic": False, "min_frequency": 5.0, "max_frequency": 20.0},
    PERIODIC | {"segment_column": "level", "harmonics": [1, 2, 3]},
    PERIODIC | {"select": "level = {level}", "level": 1, "periods_per_realisation": 2},
)
PUBLISHED = {"what": "k0", "value": 177.0, "unit": "mm/(N*s^2)", "tolerance": "1 %", "metric": "k0", "origin": "input"}
PRINTED: tuple[dict[str, Any], ...] = (
    PUBLISHED | {"where": {"case": "a"}},
    {"what": "f1", "value": 41.9, "unit": "Hz", "compare": "above", "metric": "f1"},
)
RANDOM: tuple[dict[str, Any], ...] = (
    {"count": 3, "seed": 1, "draw": [{"paths": ["plant.gain"], "relative": 0.05}]},
    {"count": 2, "draw": [{"paths": "friction.scale", "std": "1 um", "distribution": "uniform"}]},
)


def targets(folder: Path, registry: Registry) -> list[Target]:
    """Return the parsers, which may use a folder."""
    studies = packaged()
    names = _names(studies, registry)
    (folder / "a.csv").write_text(CSV)
    texts = [of for of, _ in studies]
    data = [of for _, of in studies]
    return [
        Target("units", _texts(UNITS, UNIT_WORDS), _unit, 0.06),
        Target("channel expressions", _texts(CHANNELS, (*"*/+-[]() ", "{level}")), _channel, 0.26),
        Target("filters", _texts(FILTERS, (*names[:40], *':-"\\', ">=", "today", "1um")), _filter, 0.13),
        Target("--set and forms", _texts(OVERRIDES, names), _override, 0.2),
        Target("studies as text", _texts(texts, names), partial(_study_text, folder, registry), 0.012),
        Target("studies as data", _plain(data, names), partial(_study, folder, registry), 0.012),
        Target("record sections", _plain(RECORDS, names), partial(_record, folder, registry), 0.01),
        Target("printed numbers", _plain([list(PRINTED)], names), PublishedNumber.parse_all, 0.04),
        Target("random sections", _plain(RANDOM, names), Draws.parse, 0.04),
        Target("command lines", _command_line, _parse_command_line, 0.02),
        Target("imports", _imports, partial(_import, folder, registry), 0.008),
    ]


def _texts(seeds: Sequence[str], words: Sequence[str]) -> Callable[[Random], str]:
    return lambda rng: mutation.text(rng, rng.choice(seeds), seeds, words)


def _plain(seeds: Sequence[Any], names: Sequence[str]) -> Callable[[Random], Any]:
    return lambda rng: mutation.plain(rng, rng.choice(seeds), names)


def packaged() -> list[tuple[str, dict[str, Any]]]:
    """Return text and data of all studies and machines that come along."""
    files = sorted(study_file.packaged_studies().rglob("*.toml"))
    return [(text, tomllib.loads(text)) for text in (file.read_text(encoding="utf-8") for file in files)]


def _names(studies: Sequence[tuple[str, dict[str, Any]]], registry: Registry) -> list[str]:
    """Return what studies consist of: sections, parameters by path, components, and a few values."""
    found = {name for _, data in studies for path in flatten(data) for name in (path, *path.split("."))}
    found |= {name for _, name in registry.providers}
    found |= {name for provider in registry.providers.values() for name in provider.component.model_fields}
    found |= {
        "grid", "case", "monte_carlo", "published", "limits", "compensation", "record", "label", "fit", "preset",
        "version",
    }  # fmt: skip
    return sorted(found)


def _unit(text: str) -> None:
    parse_number(text)
    units.number(text, "m")


def _channel(text: str) -> None:
    parse_channel(text, "channels.u")


def _filter(text: str) -> None:
    from datetime import UTC, datetime

    for condition in parse_filter(text):
        parse_number(condition.value)
        if condition.field == "created":
            parse_time_span(condition.value, datetime.now(UTC))


def _override(text: str) -> None:
    value = text.partition("=")[2]
    entries.entry_text(toml.value(value))
    value_text(toml.value(value))
    override(text)


def _study_text(folder: Path, registry: Registry, text: str) -> None:
    file = folder / "study.toml"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    _study(folder, registry, study_file.read(file))


def _study(folder: Path, registry: Registry, data: Any) -> None:
    if not isinstance(data, dict):
        return
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study_file, "MAX_SWEEPS", FEW)
        found = study_file.resolve("study", folder / "study.toml", data, folder, registry)
    for sweep in found.sweeps[:3]:
        assert sweep.key.startswith(f"{TAG}-")
        printable(str(sweep.labels))
        json.dumps(sweep.labels)


def _command_line(rng: Random) -> list[str]:
    """Return the words of a command line, of which some are changed, doubled, missing or of another command."""
    words = rng.choice(COMMAND_LINES).split()
    for _ in range(1 + int(rng.expovariate(0.8))):
        place = rng.randrange(len(words) + 1)
        word = rng.choice(
            (*mutation.HOSTILE, *mutation.NUMBERS, *" ".join(COMMAND_LINES).split(), "--", "-", "--x=", "@a")
        )
        words[place : place + rng.randrange(3)] = [word, mutation.text(rng, word or "-", [word], ["-", "=", "--"])][
            : rng.randrange(3)
        ]
    return words


def _parse_command_line(words: list[str]) -> None:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):  # what help prints and ends with
        try:
            parse(words)
        except UsageError as error:
            assert len(printable(str(error)).splitlines()) == 1, "a refusal of several lines"
            raise FraexpError(str(error)) from None


def _record(folder: Path, registry: Registry, data: Any) -> None:
    if isinstance(data, dict):
        resolve(RecordSettings.parse(data, "record"), folder, registry)


def _imports(rng: Random) -> dict[str, Any]:
    column = rng.choice((*mutation.HOSTILE, "y", "y [mm]", "y * 2"))
    name = rng.choice((*mutation.HOSTILE, "y", "y.1", 'a"b'))
    options = {
        "samples_per_period": 10,
        "sample_rate": 100.0,
        rng.choice(("select", "reader", "line_channel")): rng.choice(mutation.HOSTILE),
    }
    return {"channels": {"u": mutation.text(rng, "u [N]", CHANNELS, CHANNELS), name: column}, "options": options}


def _import(folder: Path, registry: Registry, made: dict[str, Any]) -> None:
    """What is written is read back the same, or refused before."""
    data = study_data(ImportRequest([folder / "a.csv"], **made), folder, registry)
    file = folder / "import.toml"
    with contextlib.suppress(FraexpError):
        resolve(RecordSettings.parse(data["record"], "record"), folder, registry)
    file.write_text(study_text(data), encoding="utf-8")
    assert study_file.read(file) == data
