"""A proposal of the command that imports a file, and what it still needs to know."""

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import RecordReader
from fraexp.components.registry import Registry
from fraexp.data.signals import RecordTable
from fraexp.errors import RecordError
from fraexp.records.channels import (
    CLOCK_ROLES,
    UNITLESS_MARKS,
    FileContent,
    clock_unit,
    column_text,
    is_auxiliary,
    is_usable_unit,
    si_unit,
)
from fraexp.records.cutting import find_runs
from fraexp.records.record_files import FILE_SIGN, existing_file, find_reader, list_remarks, read_columns
from fraexp.records.repeats import detect_period
from fraexp.records.resampling import plan_clock, resample
from fraexp.records.stated_response import CARTESIAN, POLAR, is_response_unit
from fraexp.records.timebase import examine_stamps, sample_rate_of, stamps_text

NUMBERED_NAME = re.compile(r"^(?P<head>.*?)(?P<number>\d+)(?P<tail>\D*)$")
MAX_OUTPUTS = 4
"""Largest number of outputs that are proposed."""
ANGULAR_FREQUENCY = re.compile(r"w|omega|OMEGA|Omega|ω")
"""Names of a frequency in rad/s, as python-control and MATLAB return it."""
MIN_STEP_SAMPLES = 50
"""Mean number of samples from which a column of frequencies is that of a stepped sine."""
MAX_RADIANS, MIN_DEGREES = 7.0, 30.0
"""Largest phase up to which it is in radians, and from which it is in degrees, if nothing states its unit."""


FLAGS = {
    "response_unit": "--unit",
    "time_column": "--time",
    "frequency_column": "--frequency",
    "periodic": "--aperiodic",
}
"""Options of the command for keys of [record] that are not called like them."""


@dataclass
class Proposal:
    """How files are probably imported, with words in capitals that the user must replace."""

    files: list[Path]
    channels: dict[str, str] = field(default_factory=dict)
    options: dict[str, str | float | bool] = field(default_factory=dict)
    """Keys of the section [record]."""
    levels: list[str] = field(default_factory=list)
    needs: list[str] = field(default_factory=list)
    """What the listing cannot know, in sentences."""
    findings: list[str] = field(default_factory=list)
    """What was found in the files, in sentences."""

    @property
    def command(self) -> str:
        """The command as one would type it."""
        words = ["fraexp", "import", *map(str, self.files)]
        words += [part for name, text in self.channels.items() for part in ("--channel", f"{name}={text}")]
        words += [part for level in self.levels for part in ("--level", level)]
        for key, value in self.options.items():
            words.append(FLAGS.get(key, f"--{key.replace('_', '-')}"))
            if not isinstance(value, bool):
                words.append(f"{value:.10g}" if isinstance(value, float) else str(value))
        if not self.options.get("periodic", True):
            words += ["--estimator", "friction_identification", "--set", 'estimator.laws=["coulomb"]']
        return shlex.join(words)

    def add_channel(self, name: str, text: str, one: FileContent | None = None) -> None:
        """Add a channel, and say if its unit is unknown."""
        self.channels[name] = text
        if one is not None and text.endswith("UNIT]"):
            stated = f" (the file says '{one.unit}')" if one.unit.strip() not in UNITLESS_MARKS else ""
            self.needs.append(f"the unit of '{one.name}' is unknown{stated}: replace UNIT")


def propose_files(found: Mapping[Path, Sequence[FileContent]], registry: Registry) -> Proposal:
    """Return how files are imported: one, several of one kind, or several with the channels of one record."""
    first, *others = found
    names = [{one.name for one in contents} for contents in found.values()]
    if any(these != names[0] for these in names):
        return _propose_join(found)
    proposal = propose_import(first, found[first], registry)
    if others:
        proposal.files = list(found)
        proposal.findings.append(
            "the files have the same columns: they are taken for records of one experiment; --separate-files takes "
            "each for an experiment, --join-files for channels of one record"
        )
    return proposal


def propose_import(file: Path, found: Sequence[FileContent], registry: Registry) -> Proposal:
    """Return the command that imports a file, as far as names, units and values support one."""
    path = existing_file(file)
    source = _Source(path, find_reader("", path, registry), found, Proposal([file]))
    if not source.propose_response():
        source.propose_record()
    source.proposal.findings += list_remarks(file, registry)
    return source.proposal


def _propose_join(found: Mapping[Path, Sequence[FileContent]]) -> Proposal:
    """Return the command that imports several files as channels of one record, as far as names and units support it."""
    proposal = Proposal(list(found))
    names = [one.name for contents in found.values() for one in contents]
    signals = [
        replace(one, name=one.name if names.count(one.name) == 1 else f"{file.name}{FILE_SIGN}{one.name}")
        for file, contents in found.items()
        for one in contents
        if one.size > 1
    ]
    inputs, outputs = _inputs_and_outputs([one for one in signals if one.guess != "time"])
    _propose_channels(proposal, inputs, outputs, [])
    proposal.options["join_files"] = True
    if len({one.size for one in (*inputs, *outputs)}) > 1:
        proposal.options["resample"] = "cubic"
    proposal.findings.append("the files have different columns: they are taken for channels of one record")
    proposal.needs.append("state the period, --samples-per-period or --period-time, or --aperiodic")
    return proposal


def _propose_channels(
    proposal: Proposal, inputs: Sequence[FileContent], outputs: Sequence[FileContent], level: Sequence[str]
) -> None:
    if len(inputs) == 1:
        proposal.add_channel("u", _with_level(inputs[0].quantity, level), inputs[0])
    else:
        proposal.add_channel("u", "COLUMN [UNIT]")
        names = " or ".join(f"'{one.name}'" for one in inputs[:MAX_OUTPUTS])
        reason = f"the input may be {names}" if inputs else "no name or unit shows the input"
        proposal.needs.append(f"{reason}: replace the COLUMN of u")
    for number, one in enumerate(outputs[:MAX_OUTPUTS], start=1):
        proposal.add_channel("y" if number == 1 else f"y{number}", _with_level(one.quantity, level), one)
    if not outputs:
        proposal.add_channel("y", "COLUMN [UNIT]")
        proposal.needs.append("no name or unit shows the output: replace the COLUMN of y")


def _best(signals: Sequence[FileContent], role: str) -> list[FileContent]:
    """Return the variables for whose role most speaks: several if the evidence is equal."""
    able = [one for one in signals if one.guess == role]
    highest = max((one.score for one in able), default=0)
    return [one for one in able if one.score == highest]


def _longest(signals: Sequence[FileContent]) -> list[FileContent]:
    """Return the variables as long as the one with most samples that has a role, or than all."""
    able = [one for one in signals if one.guess in ("u", "y")] or list(signals)
    longest = max((one.size for one in able), default=0)
    return [one for one in signals if one.size == longest]


def _inputs_and_outputs(alike: Sequence[FileContent]) -> tuple[list[FileContent], list[FileContent]]:
    """Return probable inputs and outputs; the only variable of an unknown role is what the other one lacks."""
    inputs, outputs = _best(alike, "u"), _best(alike, "y")
    unknown = [one for one in alike if not one.guess and not is_auxiliary(one.name)]
    if len(unknown) == 1 and bool(inputs) != bool(outputs):
        return (inputs, unknown) if inputs else (unknown, outputs)
    return inputs, outputs


def _matrix_columns(alike: Sequence[FileContent]) -> list[FileContent]:
    """Return the columns of the only variable if it is a matrix: they are probably the channels."""
    if len(alike) != 1 or len(alike[0].shape) != 2 or min(alike[0].shape) == 1:
        return list(alike)
    one = alike[0]
    count, length = sorted(one.shape)
    return [FileContent(f"{one.name}.{number + 1}", (length,), "", "") for number in range(count)]


def _common_levels(
    inputs: Sequence[FileContent], outputs: Sequence[FileContent], found: Sequence[FileContent]
) -> list[str]:
    """Return the numbers in the names of input and output, if each of these exists with both."""
    numbers: list[list[str]] = []
    families = set()
    for several in (inputs, outputs):
        match = NUMBERED_NAME.match(several[0].name) if several else None
        if match is None:
            return []
        families.add((match["head"], match["tail"]))
        others = (re.fullmatch(rf"{re.escape(match['head'])}(\d+){re.escape(match['tail'])}", of.name) for of in found)
        numbers.append([other[1] for other in others if other])
    return numbers[0] if numbers[0] == numbers[1] and len(numbers[0]) > 1 and len(families) > 1 else []


def _with_level(text: str, level: Sequence[str]) -> str:
    match = NUMBERED_NAME.match(re.split(r"\(| \[| \* ", text)[0]) if level else None
    return text if match is None else f"{match['head']}{{level}}{match['tail']}{text[match.end() :]}"


@dataclass(frozen=True)
class _Source:
    """A file with its variables, for which a command is proposed."""

    path: Path
    reader: RecordReader
    found: Sequence[FileContent]
    proposal: Proposal

    @property
    def signals(self) -> list[FileContent]:
        """Its variables of several values."""
        return [one for one in self.found if one.size > 1]

    def values(self, name: str) -> NDArray[np.float64]:
        """Return the numbers of a variable."""
        return self.reader.read(self.path, [name]).columns[name]

    def propose_response(self) -> bool:
        """Propose the import of a response over frequency; False if the file has no such columns."""
        proposal, signals = self.proposal, self.signals
        best = {role: _best(signals, role) for role in ("frequency", *POLAR, *CARTESIAN, "coherence")}
        pair = next((pair for pair in (POLAR, CARTESIAN) if all(best[role] for role in pair)), None)
        if pair is None or not best["frequency"] or _best(signals, "time"):
            return False
        for role in ("frequency", *pair, *(("coherence",) if best["coherence"] else ())):
            one = best[role][0]
            states_unit = is_usable_unit(one.unit) or one.unit.lower() == "db"
            unit = "" if states_unit else self._response_unit(role, one)
            written = column_text(one.name)
            proposal.add_channel(role, f"{written} [{unit}]" if unit else written, one if unit == "UNIT" else None)
        stated = best[pair[0]][0].unit.strip()
        is_known = is_response_unit(stated)
        proposal.options["response_unit"] = stated if is_known else "OUTPUT/INPUT"
        if not is_known:
            proposal.needs.append("the unit of the response is unknown: replace OUTPUT/INPUT, such as mm/N")
        return True

    def _response_unit(self, role: str, one: FileContent) -> str:
        """Return the unit of a column of a response that states none; empty for a ratio, UNIT if nothing shows it.

        The values show it where the name does not: a ratio is not negative, and degrees are more than a few.
        """
        ending = re.split(r"[_ ]", one.name.lower())[-1]
        if role == "frequency":
            by_name = "Hz" if ending in ("hz", "f") else "kHz" if ending == "khz" else ""
            return by_name or ("rad/s" if ANGULAR_FREQUENCY.fullmatch(one.name.rpartition(".")[2]) else "UNIT")
        if role not in POLAR:
            return ""
        values = self.values(one.name)
        if role == "magnitude":
            is_decibel = "db" in one.name.lower() or bool((values < 0).any())
            return "dB" if is_decibel else ""
        if ending in ("deg", "rad"):
            return ending
        largest = float(np.abs(values).max())
        unit = "rad" if largest < MAX_RADIANS else "deg" if largest > MIN_DEGREES else "UNIT"
        if unit != "UNIT":
            self.proposal.findings.append(f"'{one.name}' reaches {largest:.3g}: it is taken for {unit}")
        return unit

    def propose_record(self) -> None:
        """Propose the import of samples over time."""
        proposal, signals = self.proposal, self.signals
        alike = _matrix_columns(_longest(signals))
        inputs, outputs = _inputs_and_outputs(alike)
        if not inputs or not outputs:  # the other one may have a clock of its own
            inputs, outputs = _inputs_and_outputs(signals) if len(signals) > 1 else (inputs, outputs)
        level = _common_levels(inputs, outputs, self.found)
        if level:
            inputs, outputs = inputs[:1], outputs[:1]
        chosen = inputs[0] if len(inputs) == 1 else None
        _propose_channels(proposal, inputs, outputs, level)
        for name, role in (("reference", "r"), ("excitation", "excitation")):
            for one in [one for one in _best(alike, role) if chosen is None or one.size == chosen.size][:1]:
                proposal.add_channel(name, one.quantity, one)
        proposal.levels += level
        self._propose_clock(chosen, [*inputs, *outputs])

    def _propose_clock(self, chosen: FileContent | None, used: Sequence[FileContent]) -> None:
        """Propose sample rate and period."""
        names = [one.column for one in used] or [one.column for one in self.signals][:1]
        if not names:
            return
        try:
            table = read_columns(self.reader, self.path, set(names))
        except RecordError as error:
            self.proposal.needs.append(str(error))
            return
        if table.sample_time is None and not table.times:
            self._propose_rate(used[0].size if used else max(one.size for one in self.found))
        if chosen is not None:
            self._propose_period(chosen, table)

    def _propose_rate(self, size: int) -> None:
        time = self._time_column(size)
        if time is not None:
            unit = clock_unit(time.name, self.values(time.column))
            stated = "" if is_usable_unit(time.unit) else f" [{unit or 'UNIT'}]"
            self.proposal.options["time_column"] = column_text(time.column) + stated
            if stated and not unit:
                self.proposal.needs.append(f"the unit of '{time.name}' is unknown: replace UNIT")
            return
        for one in self.found:
            if one.guess in CLOCK_ROLES:
                value = float(self.values(one.name)[0])
                rate = value if one.guess == "sample rate" else 1 / value if value else 0.0
                if rate > 0:
                    self.proposal.options["sample_rate"] = rate
                    return
        self.proposal.options["sample_rate"] = "HZ"
        self.proposal.needs.append("the file does not state the sample rate: replace HZ")

    def _time_column(self, size: int) -> FileContent | None:
        """Return the column of time stamps; one without a unit only if no number of the file states the rate."""
        time = next((one for one in _best(self.found, "time") if one.size == size), None)
        is_stated = any(one.guess in CLOCK_ROLES for one in self.found)
        return None if time is None or (is_stated and not time.has_unit) else time

    def _propose_period(self, chosen: FileContent, table: RecordTable) -> None:
        proposal = self.proposal
        sides = [side for side in chosen.shape if side > 1]
        if len(sides) > 1:
            proposal.options["samples_per_period"] = max(sides)
            return
        if self._propose_steps(chosen):
            return
        values, rate = table.columns[chosen.column], None
        time = self._time_of(chosen, table)
        if time is not None:
            values, rate = self._even_values(values, time, table)
        period = detect_period(values)
        if period is None:
            proposal.options["periodic"] = False
            proposal.findings.append(f"'{chosen.name}' does not repeat itself")
            return
        every = f"every {period} samples" + (f" ({period / rate:.6g} s)" if rate else "")
        proposal.findings.append(f"'{chosen.name}' repeats {every}, by its autocorrelation")
        if "resample" in proposal.options and rate:
            proposal.options["period_time"] = float(f"{period / rate:.6g}")
        else:
            proposal.options["samples_per_period"] = period

    def _propose_steps(self, chosen: FileContent) -> bool:
        """Propose the frequencies of a stepped sine; False if no column holds them, each for a while."""
        column = next((one.column for one in _best(self.found, "frequency") if one.size == chosen.size), None)
        if column is None:
            return False
        values = self.values(column)
        runs = find_runs(values)
        if not runs or len(runs) * MIN_STEP_SAMPLES > chosen.size:
            return False
        steps = sorted({float(values[start]) for start, _ in runs})
        self.proposal.options["frequency_column"] = column_text(column)
        self.proposal.findings.append(
            f"'{column}' is constant for a while at {len(steps)} values: it is a stepped sine's frequency"
        )
        return True

    def _time_of(self, chosen: FileContent, table: RecordTable) -> NDArray[np.float64] | None:
        """Return the time stamps of the input [s], if the file has some."""
        if chosen.column in table.times:
            return table.times[chosen.column]
        of = self._time_column(chosen.size)
        if of is None or table.sample_time is not None:
            return None
        values = self.values(of.column)
        unit = of.unit.strip() if is_usable_unit(of.unit) else clock_unit(of.name, values)
        if not unit:
            return None
        return np.asarray(values * si_unit(unit, self.path.name)[0])

    def _even_values(
        self, values: NDArray[np.float64], time: NDArray[np.float64], table: RecordTable
    ) -> tuple[NDArray[np.float64], float | None]:
        """Return the input at even instants, and its rate [Hz]; say what its time stamps show."""
        proposal, several = self.proposal, len({stamps.size for stamps in table.times.values()}) > 1
        try:
            rate = sample_rate_of(time, "the time")
            if not several:
                return values, rate
            proposal.findings.append("the channels have several sample rates")
        except RecordError as error:
            try:
                clock = plan_clock({"input": time}, None, None, "cubic", "the file")
            except RecordError:
                proposal.needs.append(str(error))
                return values, None
            proposal.findings.append(stamps_text(examine_stamps(time)))
            values, rate = resample(values, time, clock), clock.rate
        proposal.options["resample"] = "cubic"
        return values, rate
