"""Each refusal of `fraexp import` that names a remedy: the remedy, as the message states it, works."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import scipy.io

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from tests.examples import thorough

RATE, PERIOD, PERIODS = 1000.0, 200, 6


class Case(NamedTuple):
    """A record that is refused with a remedy."""

    write: Callable[[Path], object]
    arguments: list[str]
    message: str
    """Pattern of the message, with the remedy."""
    mended: list[str]


def wave(seed: int = 0, periods: int = PERIODS, period: int = PERIOD) -> np.ndarray:
    rng = np.random.default_rng(seed)
    lines = np.arange(1, 31)
    angle = 2 * np.pi * np.outer(np.arange(period), lines) / period + rng.uniform(0, 2 * np.pi, lines.size)
    return np.tile(np.cos(angle).sum(axis=1), periods)


def pair(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return an input, and an output that is half of it three samples later."""
    return u, 0.5 * np.roll(u, 3)


def write_columns(path: Path, header: str, *columns: np.ndarray, digits: int = 12) -> None:
    rows = "\n".join(",".join(f"{value:.{digits}g}" for value in row) for row in np.column_stack(columns))
    path.write_text(f"{header}\n{rows}\n", encoding="utf-8")


def csv(u: np.ndarray, header: str = "u [N],y [um]") -> Callable[[Path], object]:
    return lambda folder: write_columns(folder / "a.csv", header, *pair(u))


def stamped(
    stamps: Callable[[np.ndarray], np.ndarray], header: str = "time [s],u [N],y [um]", digits: int = 12
) -> Callable[[Path], object]:
    def write(folder: Path) -> None:
        u, y = pair(wave(periods=20))
        time = stamps(np.arange(u.size) / RATE)
        write_columns(folder / "a.csv", header, time, u[: time.size], y[: time.size], digits=digits)

    return write


def jittered(time: np.ndarray) -> np.ndarray:
    return time + np.random.default_rng(1).uniform(-2e-4, 2e-4, time.size)


def drifting(time: np.ndarray) -> np.ndarray:
    return time * (1 + 2e-3 * time / time[-1])


def write_matlab(folder: Path) -> None:
    u, y = pair(wave())
    both = {"u": u.reshape(PERIODS, PERIOD).T, "y": y.reshape(PERIODS, PERIOD).T}
    scipy.io.savemat(folder / "a.mat", {**both, "three": np.stack([both["u"], both["y"]], axis=2), "fs": RATE})


def write_levels(folder: Path) -> None:
    u, y = pair(wave())
    for level in (1, 2):
        write_columns(folder / f"a{level}.csv", "u [N],y [um]", level * u, level * y)


def write_response(folder: Path) -> None:
    frequency = np.geomspace(1, 100, 20)
    write_columns(
        folder / "a.csv", "f [Hz],mag [dB],phase [deg]", frequency, -40 * np.log10(frequency), 0 * frequency - 180
    )


def columns(u: str, y: str) -> list[str]:
    return ["--channel", f"u={u}", "--channel", f"y={y}"]


UY = columns("u", "y")
CLOCK = ["--sample-rate", "1000"]
EACH = ["--samples-per-period", "200"]
CLOCKED = [*UY, *CLOCK, *EACH]
TIMED = [*UY, "--time", "time [s]", *EACH]
NO_FEEDBACK = ["--set", "estimator.excitation_channel=u"]
APERIODIC = ["--aperiodic", "--estimator", "local_polynomial"]
RESPONSE = ["--channel", "frequency=f", "--channel", "magnitude=mag", "--channel", "phase=phase"]
NOISE = csv(np.random.default_rng(0).normal(size=3000))
TWO_REALISATIONS = csv(np.concatenate([wave(1, 3), wave(2, 3)]))
CASES = {
    "period unknown": Case(csv(wave()), [*UY, *CLOCK], r"give samples_per_period = 200 \(--samples-per", CLOCKED),
    "period wrong": Case(
        csv(wave()), [*UY, *CLOCK, "--samples-per-period", "150"], r"seems to repeat every 200 samples", CLOCKED
    ),
    "not periodic": Case(NOISE, [*UY, *CLOCK], r"periodic = false \(--aperiodic\)", [*UY, *CLOCK, *APERIODIC]),
    "aperiodic without an estimator": Case(
        NOISE, [*UY, *CLOCK, "--aperiodic"],
        r"needs --estimator: .*, local_polynomial for a response", [*UY, *CLOCK, *APERIODIC],
    ),
    "realisations": Case(
        TWO_REALISATIONS, CLOCKED, r"\(--periods 3\)", [*CLOCKED, "--periods", "3", *NO_FEEDBACK],
    ),
    "realisations without their excitation": Case(
        TWO_REALISATIONS, [*CLOCKED, "--periods", "3"],
        r"\(--set estimator.excitation_channel=u\)", [*CLOCKED, "--periods", "3", *NO_FEEDBACK],
    ),
    "not whole realisations": Case(
        csv(wave()), [*CLOCKED, "--periods", "4", *NO_FEEDBACK],
        r"correct periods_per_realisation \(--periods\)", [*CLOCKED, "--periods", "3", *NO_FEEDBACK],
    ),
    "settling": Case(
        csv(np.concatenate([wave(1, 1), wave(2, 5)])), CLOCKED,
        r"\(--skip-periods 1\)", [*CLOCKED, "--skip-periods", "1"],
    ),
    "rate unknown, time known": Case(
        stamped(lambda time: time, "time,u [N],y [um]"), [*UY, *EACH], r"\(--time 'time \[s\]'\)", TIMED,
    ),
    "rate unknown, rate in the file": Case(
        write_matlab, [*columns("u(:,:) [N]", "y(:,:) [um]"), *EACH],
        r"\(--sample-rate 1000\)", [*columns("u(:,:) [N]", "y(:,:) [um]"), *EACH, *CLOCK],
    ),
    "rate contradicts": Case(
        stamped(lambda time: time), [*TIMED, "--sample-rate", "900"],
        r"the time in the file says 1000 Hz", [*TIMED, "--sample-rate", "1000"],
    ),
    "jitter": Case(stamped(jittered), TIMED, r"\(--resample cubic\)", [*TIMED, "--resample", "cubic"]),
    "jitter of the stamps only": Case(
        stamped(jittered), TIMED, r"leave out time_column and give sample_rate = [\d.]+", CLOCKED,
    ),
    "drift": Case(stamped(drifting), TIMED, r"\(--resample cubic\)", [*TIMED, "--resample", "cubic"]),
    "rounded": Case(
        stamped(lambda time: np.floor(100 * time) / 100, digits=6), TIMED,
        r"\(--sample-rate 999.997\)", [*UY, *EACH, "--sample-rate", "999.997"],
    ),
    "no unit": Case(
        csv(wave(), "u,y"), CLOCKED, r"channel 'u' has no unit; give unit = such as mm, or 1",
        [*columns("u [N]", "y [um]"), *CLOCK, *EACH],
    ),
    "other unit": Case(csv(wave()), [*columns("u", "y [mm]"), *CLOCK, *EACH], r"leave the unit out", CLOCKED),
    "formula without blanks": Case(
        csv(wave(), "volt-age,y [um]"), [*columns("volt-age*31.5 [N]", "y"), *CLOCK, *EACH],
        r"with blanks around the signs|no column", [*columns("volt-age * 31.5 [N]", "y"), *CLOCK, *EACH],
    ),
    "array of periods": Case(
        write_matlab, [*columns("u [N]", "y [um]"), *CLOCK, *EACH],
        r"or 'u\(:,:\)' for periods one after another", [*columns("u(:,:) [N]", "y(:,:) [um]"), *CLOCK, *EACH],
    ),
    "array of three dimensions": Case(
        write_matlab, [*columns("three [N]", "y(:,:) [um]"), *CLOCK, *EACH],
        r"such as 'three\(:,:,1\)'", [*columns("three(:,:,1) [N]", "y(:,:) [um]"), *CLOCK, *EACH],
    ),
    "two columns of one name": Case(
        csv(wave(), "a [N],a [um]"), [*columns("a", "a"), *CLOCK, *EACH],
        r"give 'a #1' to 'a #2'", [*columns("a #1", "a #2"), *CLOCK, *EACH],
    ),
    "typing error": Case(
        csv(wave(), "force [N],y [um]"), [*columns("forze", "y"), *CLOCK, *EACH],
        r"did you mean 'force'", [*columns("force", "y"), *CLOCK, *EACH],
    ),
    "no formula": Case(
        csv(wave()), ["--channel", "u", "--channel", "y=y", *CLOCK, *EACH],
        r"expected NAME=COLUMN, such as u=force", CLOCKED,
    ),
    "levels without a placeholder's value": Case(
        write_levels, CLOCKED, r"give level \(--level\)", [*CLOCKED, "--level", "1", "--level", "2"],
    ),
    "above Nyquist": Case(
        csv(wave()), [*CLOCKED, "--min-frequency", "5", "--max-frequency", "600"],
        r"expected at most half the sample rate, 500 Hz",
        [*CLOCKED, "--min-frequency", "5", "--max-frequency", "150"],
    ),
    "response without its unit": Case(
        write_response, RESPONSE, r"such as mm/N.*\(--unit\)", [*RESPONSE, "--unit", "mm/N"],
    ),
}  # fmt: skip
QUICK = ("period unknown", "jitter", "no unit", "typing error")
"""Cases of the suite for people; each imports twice."""


def run(folder: Path, arguments: list[str], study: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Import the files of a folder; return exit code and what is printed."""
    found = sorted(folder.glob("a*.*"))
    name = "a{level}.csv" if len(found) > 1 else found[0].name
    target = str(folder / f"{study}.toml")
    code = main(["import", str(folder / name), *arguments, "--study", target, "--workspace", str(folder)])
    printed = capsys.readouterr()
    return code, printed.out + printed.err


@pytest.mark.parametrize("name", [name if name in QUICK else thorough(name) for name in CASES])
def test_the_remedy_of_a_refusal_works(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = CASES[name]
    case.write(tmp_path)
    code, text = run(tmp_path, case.arguments, "refused", capsys)
    assert code != ExitCode.OK, text
    assert re.search(case.message, text), text
    code, text = run(tmp_path, case.mended, "mended", capsys)
    assert code == ExitCode.OK, text
    assert " 0 failed" in text


def test_another_analysis_of_a_record_is_told_a_file_for_its_study(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    csv(wave())(tmp_path)
    words = ["import", str(tmp_path / "a.csv"), *UY, *CLOCK, *EACH, "--workspace", str(tmp_path)]
    assert main(words) == ExitCode.OK
    again = [*words, "--max-frequency", "50", "--min-frequency", "5"]
    capsys.readouterr()
    assert main(again) != ExitCode.OK
    found = re.search(r"such as (--study) (\S+a-2\.toml)", capsys.readouterr().err)
    assert found
    assert main([*again, *found.groups()]) == ExitCode.OK


def test_an_estimator_of_whole_periods_refuses_a_record_without_any(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    NOISE(tmp_path)
    code, text = run(tmp_path, [*UY, *CLOCK, "--aperiodic", "--estimator", "conventional"], "noise", capsys)
    assert code == ExitCode.INCOMPLETE
    assert "does not repeat itself" in text
    assert "take h1_h2_hv or local_polynomial" in text
