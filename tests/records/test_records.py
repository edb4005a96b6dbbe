"""From [record] to signals: units, clock, periods, lines, steps, identity, and what is refused."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fraexp.analysis.fourier import mean_spectrum, phasors
from fraexp.components.registry import Registry
from fraexp.data.identity import key_of
from fraexp.data.results import Outcome
from fraexp.data.signals import Signals
from fraexp.errors import FraexpError, ParameterError, RecordError
from fraexp.records import RecordSettings, load, resolve
from fraexp.records.cutting import coherent_block

Read = Callable[..., Signals]


def test_units_and_scale_turn_columns_into_si(tmp_path: Path, signals_of: Read, bench: Any) -> None:
    rows = bench.rows(4)
    bench.write(tmp_path / "bench.csv", rows)
    signals = signals_of()
    assert signals.units == {"u": "A", "y": "m"}
    (segment,) = signals.segments
    assert segment.channels["y"].shape == (4, bench.period)
    np.testing.assert_allclose(segment.channels["y"].ravel(), -1e-3 * rows[:, 2], rtol=1e-15)
    assert segment.sample_time == 1 / bench.rate
    assert segment.settling is None


def test_the_studys_unit_is_used_where_the_file_tells_none(tmp_path: Path, signals_of: Read, bench: Any) -> None:
    rows = bench.rows(3)
    for heading in ("Position", "Position (filtered)", "Position [-]"):
        bench.write(tmp_path / "bench.csv", rows, f"Time [s],iq,{heading}")
        signals = signals_of(channels={"u": "iq [A]", "y": "Position [um]"})
        np.testing.assert_allclose(signals.segments[0].channels["y"].ravel(), 1e-6 * rows[:, 2], rtol=1e-15)


def test_a_unit_beside_an_unknown_one_of_the_file_needs_a_factor(tmp_path: Path, signals_of: Read, bench: Any) -> None:
    rows = bench.rows(3)
    bench.write(tmp_path / "bench.csv", rows, "Time [s],iq [A],Position [inc]")
    with pytest.raises(RecordError, match=r"the file says 'inc'.*'Position \* 1 \[um\]'"):
        signals_of(channels={"u": "iq", "y": "Position [um]"})
    signals = signals_of(channels={"u": "iq", "y": "Position * 1 [um]"})
    np.testing.assert_allclose(signals.segments[0].channels["y"].ravel(), 1e-6 * rows[:, 2], rtol=1e-15)


def odd(periods: int, unexcited: float = 0.0, noise: float = 0.0) -> np.ndarray:
    """Time, input and output of an odd multisine; 200 samples per period at 1 kHz, 5 to 195 Hz."""
    rng = np.random.default_rng(4)
    angle = 2 * np.pi * np.outer(np.arange(200), np.arange(1, 41)) / 200
    amplitude = np.where(np.arange(1, 41) % 2, 0.3, unexcited)
    u = np.tile((amplitude * np.cos(angle + rng.uniform(0, 2 * np.pi, 40))).sum(axis=1), periods)
    u += noise * rng.normal(size=u.size)
    return np.column_stack([np.arange(u.size) / 1000, u, np.roll(u, 2)])


@pytest.mark.parametrize(("unexcited", "noise"), [(2e-13, 0.0), (0.0, 1e-4), (1e-5, 1e-3)])
def test_unexcited_lines_between_lowest_and_highest_are_left_out(
    tmp_path: Path, signals_of: Read, bench: Any, unexcited: float, noise: float
) -> None:
    bench.write(tmp_path / "bench.csv", odd(5, unexcited, noise))
    assert signals_of(min_frequency=5, max_frequency=195).segments[0].lines.tolist() == list(range(1, 40, 2))
    assert signals_of(min_frequency=12, max_frequency=60).segments[0].lines.tolist() == [3, 5, 7, 9, 11]
    with pytest.raises(RecordError, match=r"'u' does not excite 10 Hz \(harmonic 2\)") as caught:
        signals_of(harmonics=[1, 2, 3])
    assert "\n" not in str(caught.value)


def test_a_stated_line_may_be_weak_if_it_is_more_than_noise(tmp_path: Path, signals_of: Read, bench: Any) -> None:
    bench.write(tmp_path / "bench.csv", odd(5, unexcited=1e-4))
    assert signals_of(harmonics=[1, 2]).segments[0].lines.tolist() == [1, 2]


def test_skipped_periods_and_time_are_left_out(tmp_path: Path, signals_of: Read, bench: Any) -> None:
    rows = bench.rows(5)
    bench.write(tmp_path / "bench.csv", rows)
    segment = signals_of(skip_periods=1, skip_time=0.01).segments[0]
    assert segment.channels["u"].shape == (3, bench.period)
    assert segment.channels["u"][0, 0] == rows[bench.period + 10, 1]


def test_a_period_between_samples_takes_several_periods(tmp_path: Path, signals_of: Read, bench: Any) -> None:
    time = np.arange(1000) / bench.rate
    wave = np.sin(2 * np.pi * 80 * time / 3)
    bench.write(tmp_path / "bench.csv", np.column_stack([time, wave, np.roll(wave, 2)]))
    segment = signals_of(samples_per_period=None, period_time=0.0375).segments[0]  # 37.5 samples
    assert segment.channels["u"].shape == (13, 75)
    assert segment.lines.tolist() == [2]
    assert segment.frequency[0] == pytest.approx(80 / 3, rel=1e-12)
    assert coherent_block(37.5, 1000, 1e-3) == (75, 2)
    assert coherent_block(51.5463918, 10_000, 1e-6) == (5000, 97)
    assert coherent_block(np.pi * 10, 300, 1e-6) is None


@pytest.mark.parametrize("as_column", [False, True])
def test_a_stepped_sine_is_cut_into_its_frequencies(
    tmp_path: Path, signals_of: Read, as_column: bool, bench: Any
) -> None:
    steps = [(0.0, 1.0, 10.0), (1.2, 2.0, 38.8), (2.0, 3.5, 80.0)]
    time = np.arange(3500) / bench.rate
    frequency, u, y = np.zeros((3, 3500))
    for start, stop, value in steps:
        inside = (time >= start - 1e-9) & (time < stop - 1e-9)
        frequency[inside] = value
        u[inside] = np.sin(2 * np.pi * value * time[inside])
        y[inside] = 2 * np.sin(2 * np.pi * value * time[inside] - 0.5)
    bench.write(tmp_path / "bench.csv", np.column_stack([time, u, y, frequency]), "Time,iq [A],Position [mm],f [Hz]")
    listed = [{"start": start, "stop": stop, "frequency": value} for start, stop, value in steps]
    way = {"frequency_column": "f"} if as_column else {"steps": listed}
    signals = signals_of(samples_per_period=None, skip_periods=1, max_phase_slip=0.01, **way)
    assert [float(segment.frequency[0]) for segment in signals.segments] == pytest.approx([10.0, 38.8, 80.0], rel=1e-9)
    for segment in signals.segments:
        spectrum = mean_spectrum(segment.frequency, phasors(segment, "u"), phasors(segment, "y"))
        exact = segment.frequency[0] != pytest.approx(38.8)  # that one slips by 1 % of a period per block, and leaks so
        np.testing.assert_allclose(
            spectrum.output / spectrum.input, -2e-3 * np.exp(-0.5j), rtol=1e-12 if exact else 0.01
        )


def test_the_same_signals_have_one_key_however_they_are_described(
    tmp_path: Path, registry: Registry, bench: Any
) -> None:
    bench.write(tmp_path / "bench.csv", bench.rows(4))
    described = [
        bench.settings,
        {**bench.settings, "samples_per_period": None, "period_time": "200 ms"},
        {
            **bench.settings,
            "channels": {"y": {"column": "Position", "unit": "mm", "scale": -1}, "u": "iq [A]"},
            "line_channel": "u",
        },
        {**bench.settings, "min_frequency": 10, "max_frequency": "0.2 kHz", "sample_rate": 1000},
    ]
    keys = {key_of(resolve(RecordSettings.parse(one, "record"), tmp_path, registry)[0]) for one in described}
    assert len(keys) == 1
    other = RecordSettings.parse({**bench.settings, "skip_periods": 1}, "record")
    assert key_of(resolve(other, tmp_path, registry)[0]) not in keys


def test_the_experiment_names_the_content_and_not_the_path(tmp_path: Path, registry: Registry, bench: Any) -> None:
    bench.write(tmp_path / "bench.csv", bench.rows(4))
    experiment, files = resolve(RecordSettings.parse(bench.settings, "record"), tmp_path, registry)
    assert str(tmp_path) not in str(experiment)
    moved = tmp_path / "moved.txt"
    Path(files["record"]).rename(moved)
    assert load(experiment, {"record": str(moved)}, registry).units == {"u": "A", "y": "m"}
    with moved.open("a") as stream:
        stream.write("9,9,9\n")
    with pytest.raises(RecordError, match=r"moved\.txt: the file has changed since the study was read"):
        load(experiment, {"record": str(moved)}, registry)


def test_settings_survive_the_way_through_plain_data(bench: Any) -> None:
    settings = RecordSettings.parse(
        {**bench.settings, "steps": [{"start": 0, "stop": 1, "frequency": "0.1 kHz"}], "samples_per_period": None},
        "record",
    )
    assert settings.steps[0].frequency == 100
    plain = {key: value for key, value in settings.plain().items() if value is not None}
    assert RecordSettings.parse(plain, "record") == settings


@pytest.mark.parametrize(("settled", "outcome"), [(True, Outcome.OK), (False, Outcome.NOT_SETTLED)])
def test_a_segment_that_had_not_settled_shows_in_the_outcome(
    settled: bool, outcome: Outcome, tmp_path: Path, bench: Any, signals_of: Read
) -> None:
    bench.write(tmp_path / "bench.csv", bench.rows(8))
    one = {"start": 400, "samples": 200, "periods": 2, "harmonics": [*bench.lines], "rest": 0, "settled": True}
    both = [one, {**one, "start": 1000, "settled": settled}]
    signals = signals_of(segments=both, samples_per_period=None)
    assert signals.outcome is outcome
    assert [(of.kind, of.place) for of in signals.findings] == (
        [] if settled else [("not periodic", "1 of 2 segments")]
    )


REFUSED = {
    "no channels": ({"channels": {}}, r"channels is no table of channels"),
    "no folder": ({"file": "there/bench.csv"}, r"no folder '.*there'"),
    "unknown unit": ({"channels": {"u": "iq [qq]"}}, r"channel 'u': 'qq' is no known unit"),
    "unit of another kind": (
        {"channels": {"u": "iq", "y": "Position [N]"}},
        r"'y': the unit is given as N, but the file says mm for column 'Position'; choose",
    ),
    "time in metres": (
        {"file": "bare.csv", "time_column": "Time [m]", "channels": {"u": "iq [A]"}},
        r"the time is in 'm'; expected a unit such as s",
    ),
    "too short": ({"skip_periods": 3}, r"200 samples are left, 1\.00 periods; expected at least 2 periods"),
    "no lines": ({"min_frequency": 300}, r"none of the excited lines, 10 to 200 Hz, is between"),
    "lines too high": ({"harmonics": [2, 120]}, r"excited harmonics are 2 to 120; expected some from 1 to 99"),
    "constant": ({"file": "still.csv"}, r"channel 'y' \(column 'Position'\) is constant, 3"),
    "backwards": ({"file": "backwards.csv"}, r"does not increase after sample 500"),
}


@pytest.fixture
def records(tmp_path: Path, bench: Any) -> None:
    rows = bench.rows(4)
    bench.write(tmp_path / "bench.csv", rows)
    bench.write(tmp_path / "bare.csv", rows, "Time,iq,Position")
    changed = {name: rows.copy() for name in ("still", "backwards")}
    changed["still"][:, 2] = 3
    changed["backwards"][500:, 0] -= 0.1
    for name, table in changed.items():
        bench.write(tmp_path / f"{name}.csv", table)


@pytest.mark.usefixtures("records")
@pytest.mark.parametrize(("changes", "sentence"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused_in_one_line(signals_of: Read, changes: dict[str, object], sentence: str) -> None:
    with pytest.raises(FraexpError, match=sentence) as caught:
        signals_of(**changes)
    assert isinstance(caught.value, RecordError | ParameterError | FraexpError)
    assert "\n" not in str(caught.value)
