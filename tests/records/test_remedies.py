"""Each refusal of `fraexp import` that names a remedy: the remedy, copied from the message, works."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import scipy.io

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main

RATE, PERIOD, PERIODS = 1000.0, 200, 6
Remedy = Callable[[list[str], re.Match[str]], list[str]]
"""From the arguments that were refused, and what the message says, to those that are accepted."""


class Case(NamedTuple):
    """A record that is refused with a remedy."""

    name: str
    write: Callable[[Path], object]
    arguments: list[str]
    message: str
    """Pattern of the message; its groups are what the remedy takes from it."""
    remedy: Remedy


QUICK = ("period unknown", "jitter", "no unit", "typing error")
"""Cases of the suite for people; each imports twice."""
NO_FEEDBACK = ["--set", "estimator.excitation_channel=u"]


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


def append(*words: str) -> Remedy:
    """Return the remedy of more options; ``{1}`` is what the message says first."""
    return lambda arguments, found: [*arguments, *(word.format("", *found.groups()) for word in words)]


def change(old: str, new: str) -> Remedy:
    """Return the remedy of another word in place of one."""
    return lambda arguments, found: [new.format("", *found.groups()) if word == old else word for word in arguments]


def without(option: str, *more: str) -> Remedy:
    """Return the remedy of an option less, with its value, and of others more."""

    def remove(arguments: list[str], found: re.Match[str]) -> list[str]:
        at = arguments.index(option)
        return [*arguments[:at], *arguments[at + 2 :], *(word.format("", *found.groups()) for word in more)]

    return remove


def jittered(time: np.ndarray) -> np.ndarray:
    return time + np.random.default_rng(1).uniform(-2e-4, 2e-4, time.size)


def drifting(time: np.ndarray) -> np.ndarray:
    return time * (1 + 2e-3 * time / time[-1])


def gap(place: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda time: np.where(time > place, time + 0.7303, time)


def two_rates(folder: Path) -> None:
    """Two clocks side by side, the second at half the rate and padded."""
    u, y = pair(wave(periods=20))
    lines = ["t1 [s],u [N],t2 [s],y [um]"]
    for k, value in enumerate(u):
        other = f"{2 * k / RATE:.6f},{y[2 * k]:.9g}" if 2 * k < y.size else ","
        lines.append(f"{k / RATE:.6f},{value:.9g},{other}")
    (folder / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


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


UY = ["--channel", "u=u", "--channel", "y=y"]
CLOCK = ["--sample-rate", "1000"]
EACH = ["--samples-per-period", "200"]
TIMED = ["--time", "time [s]", *EACH]
CASES = [
    Case(
        "period unknown",
        csv(wave()),
        [*UY, *CLOCK],
        r"give samples_per_period = (\d+)",
        append("--samples-per-period", "{1}"),
    ),
    Case(
        "period wrong",
        csv(wave()),
        [*UY, *CLOCK, "--samples-per-period", "150"],
        r"seems to repeat every (\d+) samples",
        change("150", "{1}"),
    ),
    Case(
        "period nearly right",
        csv(wave()),
        [*UY, *CLOCK, "--samples-per-period", "199"],
        r"give samples_per_period = (\d+)",
        change("199", "{1}"),
    ),
    Case(
        "not periodic",
        csv(np.random.default_rng(0).normal(size=3000)),
        [*UY, *CLOCK],
        r"periodic = false \((--aperiodic)\)",
        append("{1}", "--estimator", "local_polynomial"),
    ),
    Case(
        "aperiodic without an estimator",
        csv(np.random.default_rng(0).normal(size=3000)),
        [*UY, *CLOCK, "--aperiodic"],
        r"needs --estimator: .*, (local_polynomial) for a response",
        append("--estimator", "{1}"),
    ),
    Case(
        "realisations",
        csv(np.concatenate([wave(1, 3), wave(2, 3)])),
        [*UY, *CLOCK, *EACH],
        r"\(--periods (\d+)\)",
        append("--periods", "{1}", *NO_FEEDBACK),
    ),
    Case(
        "settling",
        csv(np.concatenate([wave(1, 1), wave(2, 5)])),
        [*UY, *CLOCK, *EACH],
        r"\(--skip-periods (\d+)\)",
        append("--skip-periods", "{1}"),
    ),
    Case(
        "not whole realisations",
        csv(wave()),
        [*UY, *CLOCK, *EACH, "--periods", "4", *NO_FEEDBACK],
        r"correct periods_per_realisation \((--periods)\)",
        change("4", "3"),
    ),
    Case(
        "realisations without their excitation",
        csv(np.concatenate([wave(1, 3), wave(2, 3)])),
        [*UY, *CLOCK, *EACH, "--periods", "3"],
        r"\(--set (estimator.excitation_channel=u)\)",
        append("--set", "{1}"),
    ),
    Case(
        "rate unknown, time known",
        stamped(lambda time: time, "time,u [N],y [um]"),
        [*UY, *EACH],
        r"\(--time '(time \[s\])'\)",
        append("--time", "{1}"),
    ),
    Case(
        "rate unknown, rate in the file",
        write_matlab,
        ["--channel", "u=u(:,:) [N]", "--channel", "y=y(:,:) [um]", *EACH],
        r"\(--sample-rate (\d+)\)",
        append("--sample-rate", "{1}"),
    ),
    Case(
        "rate contradicts",
        stamped(lambda time: time),
        [*UY, *EACH, "--sample-rate", "900", "--time", "time [s]"],
        r"the time in the file says (\d+) Hz",
        change("900", "{1}"),
    ),
    Case(
        "jitter",
        stamped(jittered),
        [*UY, *TIMED],
        r"\((--resample cubic)\)",
        append("--resample", "cubic"),
    ),
    Case(
        "jitter of the stamps only",
        stamped(jittered),
        [*UY, *TIMED],
        r"leave out time_column and give sample_rate = ([\d.]+)",
        without("--time", "--sample-rate", "1000"),
    ),
    Case("drift", stamped(drifting), [*UY, *TIMED], r"\(--resample (cubic)\)", append("--resample", "{1}")),
    Case(
        "rounded",
        stamped(lambda time: np.floor(100 * time) / 100, digits=6),
        [*UY, *TIMED],
        r"\(--sample-rate ([\d.]+)\)",
        without("--time", "--sample-rate", "{1}"),
    ),
    Case("late gap", stamped(gap(3.0)), [*UY, *TIMED], r"\(--end-time ([\d.]+)\)", append("--end-time", "{1}")),
    Case("early gap", stamped(gap(0.4)), [*UY, *TIMED], r"\(--start-time ([\d.]+)\)", append("--start-time", "{1}")),
    Case(
        "lost lines",
        stamped(lambda time: np.delete(time, [700, 701])),
        [*UY, *CLOCK, *EACH],
        r"--time '(time)'",
        append("--time", "{1}", "--resample", "cubic"),
    ),
    Case("two rates", two_rates, [*UY, "--period-time", "0.2"], r"\(--resample (cubic)\)", append("--resample", "{1}")),
    Case(
        "no unit",
        csv(wave(), "u,y"),
        [*UY, *CLOCK, *EACH],
        r"channel 'u' has no unit; give unit = such as (mm), or 1",
        lambda arguments, _: [
            "u=u [N]" if word == "u=u" else "y=y [um]" if word == "y=y" else word for word in arguments
        ],
    ),
    Case(
        "other unit",
        csv(wave()),
        [*["--channel", "u=u", "--channel", "y=y [mm]"], *CLOCK, *EACH],
        r"leave the unit out",
        change("y=y [mm]", "y=y"),
    ),
    Case(
        "formula without blanks",
        csv(wave(), "volt-age,y [um]"),
        ["--channel", "u=volt-age*31.5 [N]", "--channel", "y=y", *CLOCK, *EACH],
        r"with blanks around the signs|no column",
        change("u=volt-age*31.5 [N]", "u=volt-age * 31.5 [N]"),
    ),
    Case(
        "array of periods",
        write_matlab,
        ["--channel", "u=u [N]", "--channel", "y=y [um]", *CLOCK, *EACH],
        r"or '(u\(:,:\))' for periods one after another",
        lambda arguments, found: [
            f"u={found[1]} [N]" if word == "u=u [N]" else "y=y(:,:) [um]" if word == "y=y [um]" else word
            for word in arguments
        ],
    ),
    Case(
        "array of three dimensions",
        write_matlab,
        ["--channel", "u=three [N]", "--channel", "y=y(:,:) [um]", *CLOCK, *EACH],
        r"such as '(three\([:,1]+\))'",
        change("u=three [N]", "u={1} [N]"),
    ),
    Case(
        "two columns of one name",
        csv(wave(), "a [N],a [um]"),
        ["--channel", "u=a", "--channel", "y=a", *CLOCK, *EACH],
        r"give '(a #1)' to '(a #2)'",
        lambda arguments, found: [
            f"u={found[1]}" if word == "u=a" else f"y={found[2]}" if word == "y=a" else word for word in arguments
        ],
    ),
    Case(
        "typing error",
        csv(wave(), "force [N],y [um]"),
        ["--channel", "u=forze", "--channel", "y=y", *CLOCK, *EACH],
        r"did you mean '(force)'",
        change("u=forze", "u={1}"),
    ),
    Case(
        "no formula",
        csv(wave()),
        ["--channel", "u", "--channel", "y=y", *CLOCK, *EACH],
        r"expected NAME=COLUMN, such as (u)=force",
        change("u", "{1}=u"),
    ),
    Case(
        "levels without a placeholder's value",
        write_levels,
        [*UY, *CLOCK, *EACH],
        r"give level \((--level)\)",
        append("{1}", "1", "{1}", "2"),
    ),
    Case(
        "harmonics with steps",
        csv(wave()),
        [*UY, *CLOCK, *EACH, "--harmonic-step", "2"],
        r"given without min_frequency and max_frequency; give both",
        append("--min-frequency", "5", "--max-frequency", "100"),
    ),
    Case(
        "above Nyquist",
        csv(wave()),
        [*UY, *CLOCK, *EACH, "--min-frequency", "5", "--max-frequency", "600"],
        r"expected at most half the sample rate, (\d+) Hz",
        change("600", "150"),
    ),
    Case(
        "response without its unit",
        write_response,
        ["--channel", "frequency=f", "--channel", "magnitude=mag", "--channel", "phase=phase"],
        r"such as (mm/N).*\(--unit\)",
        append("--unit", "{1}"),
    ),
]


def run(folder: Path, arguments: list[str], study: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Import the files of a folder; return exit code and what is printed."""
    found = sorted(folder.glob("a*.*"))
    name = "a{level}.csv" if len(found) > 1 else found[0].name
    target = str(folder / f"{study}.toml")
    code = main(["import", str(folder / name), *arguments, "--study", target, "--workspace", str(folder)])
    printed = capsys.readouterr()
    return code, printed.out + printed.err


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, id=case.name, marks=() if case.name in QUICK else pytest.mark.thorough) for case in CASES],
)
def test_the_remedy_of_a_refusal_works(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case.write(tmp_path)
    code, text = run(tmp_path, case.arguments, "refused", capsys)
    assert code != ExitCode.OK, text
    found = re.search(case.message, text)
    assert found, text
    arguments = case.remedy(case.arguments, found)
    code, text = run(tmp_path, arguments, "mended", capsys)
    assert code == ExitCode.OK, (arguments, text)
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
