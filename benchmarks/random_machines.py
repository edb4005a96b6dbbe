"""Compare fraexp with an independent fine simulation on machines drawn at random, and print a table.

    python benchmarks/random_machines.py                         40 machines
    python benchmarks/random_machines.py --seed 7 --only 3 17    these two of a seed
    python benchmarks/random_machines.py --law coulomb           40 with this kind of friction

Mass, modes, damping, dead times, lags, friction of every kind, sample time, controller and amplitude are drawn. The
encoder is ideal. At every point that fraexp calls ok the conventional response must lie within `numerics.tolerance`
of the reference (`reference_loop`), and the proposed one (matched) within twice the tolerance of P(jω), or either
within its band. Points that are not ok are listed with the reason. Where physics allows better, as the reference shows,
they must be fewer than a tenth of all.
"""

from dataclasses import dataclass

import numpy as np
from drawn_machines import LAWS, TOLERANCE, DrawnMachine, drawn_machine
from friction_bands import within_limits
from harness import Bench, run
from reference_loop import reference_response

from fraexp.data.results import FrequencyResponse, Result
from fraexp.execution.job import Failure, Job, run_job

GOAL = 0.1 * TOLERANCE
"""Error of the reference before extrapolation: a tenth of what it has to judge."""
MAX_WITHHELD = 0.1
"""Greatest share of points that are not ok although physics allows better."""
FEW = 10
"""Machines below which this share means nothing."""
WITHOUT_HIDDEN_FORCE = 0.01
"""Error of P̂ below which the sampled motion shows the friction force."""
REST = 1e-12
"""Amplitude [m] that is no motion: a hundredth of an atom."""


@dataclass(frozen=True)
class Finding:
    """What fraexp and the reference say at one frequency of one machine."""

    frequency: float
    amplitude: float
    """Amplitude of the measured position [m]."""
    conventional: float
    """|fraexp/reference - 1|."""
    proposed: float
    """|P̂/P - 1|."""
    is_in_band: tuple[bool, bool]
    """Whether the reference lies within the band around y/u, and P within that around P̂."""
    reference_error: float
    is_ok: tuple[bool, bool]
    """Whether fraexp calls the conventional and the proposed number ok."""
    spread: float
    """Relative spread of the reference over the last half of its time: more than GOAL if it is not periodic."""

    @property
    def is_periodic(self) -> bool:
        """Whether the reference became periodic."""
        return self.spread <= GOAL

    @property
    def missed(self) -> tuple[bool, bool]:
        """Whether either number is called ok and lies outside its bound."""
        limits = TOLERANCE + self.reference_error + self.spread, 2 * TOLERANCE
        beyond = self.conventional > limits[0], self.proposed > limits[1]
        first, second = (self.is_ok[way] and beyond[way] and not self.is_in_band[way] for way in (0, 1))
        return first, second

    @property
    def is_withheld(self) -> tuple[bool, bool]:
        """Whether either number is not ok although the motion is periodic, and shows the friction force."""
        is_possible = self.is_periodic and self.amplitude > REST
        is_shown = self.is_ok[0] and self.proposed <= WITHOUT_HIDDEN_FORCE
        return is_possible and not self.is_ok[0], is_possible and is_shown and not self.is_ok[1]


@dataclass(frozen=True)
class Report:
    """One machine's findings, and what fraexp says of its two sweeps."""

    machine: DrawnMachine
    findings: tuple[Finding, ...]
    messages: tuple[str, str]
    numerics: str


def compared(machine: DrawnMachine) -> Report:
    """Return what fraexp and the reference say of a machine."""
    answers = _sweeps(machine)
    both = [answer for answer in answers if isinstance(answer, Result)]
    if len(both) < len(answers):
        failures = [answer.message for answer in answers if isinstance(answer, Failure)]
        return Report(machine, (), (f"error: {failures[0]}", f"error: {failures[-1]}"), "")
    messages = tuple(f"{sweep.outcome.name.lower()}: {sweep.message}".rstrip(": ") for sweep in both)
    responses = [sweep.response for sweep in both]
    findings: list[Finding] = []
    if responses[0] is not None and responses[1] is not None:
        for index in range(responses[0].frequency.size):
            findings.append(_finding(machine, both, responses[0], responses[1], index))
    return Report(machine, tuple(findings), (messages[0], messages[1]), both[0].numerics)


def _sweeps(machine: DrawnMachine) -> list[Result | Failure]:
    sections = machine.sections()
    matched = {"name": "effective_input", "friction": sections["friction"], **machine.delays()}
    return run_job(Job(sections, ({"name": "conventional"}, matched)), lambda _: None)


def _finding(
    machine: DrawnMachine, sweeps: list[Result], first: FrequencyResponse, second: FrequencyResponse, index: int
) -> Finding:
    frequency = float(first.frequency[index])
    truth = reference_response(machine.reference, frequency, machine.amplitude, GOAL)
    plant = machine.reference.plant(np.array([frequency]))[0]
    ratios = first.response[index] / truth.value, second.response[index] / plant
    # settled points of a sweep of which others are not settled count, unless its message doubts all of them
    certain = [sweep.outcome.name in ("OK", "NOT_SETTLED") and len(sweep.findings) < 2 for sweep in sweeps]
    return Finding(
        frequency, float(first.output_amplitude[index]), abs(ratios[0] - 1), abs(ratios[1] - 1),
        (_is_in_band(first, index, 1 / ratios[0]), _is_in_band(second, index, 1 / ratios[1])), truth.error,
        (certain[0] and bool(first.settled[index]), certain[1] and bool(second.settled[index])), truth.spread,
    )  # fmt: skip


def _is_in_band(response: FrequencyResponse, index: int, ratio: complex) -> bool:
    """Return whether the band of a response holds the response times `ratio`."""
    if response.numerical_error is not None and abs(ratio - 1) <= response.numerical_error[index]:
        return True  # without scatter no band is drawn, and the numerical error is all of it
    return bool(within_limits(response, ratio * response.response)[:, index].all())


def machines(bench: Bench) -> None:
    """Worst errors at the points that are called ok, of both methods."""
    reports, only, law = [], [int(text) for text in bench.options.only], bench.options.law
    if law and law not in {*LAWS, "none"}:
        raise SystemExit(f"no law {law!r}; known: {', '.join(sorted({*LAWS, 'none'}))}")
    for number in only or range(bench.options.machines):
        report = compared(drawn_machine(number, bench.seed, law))
        reports.append(report)
        what = f"{number} {report.machine.law}, A/F {report.machine.relative_amplitude:.2f}"
        missed = any(any(finding.missed) for finding in report.findings)
        bench.row(what, line(report), bool(report.findings) and not missed)
    summarise(bench, reports)


def line(report: Report) -> str:
    """Return a machine's worst numbers at its points called ok."""
    findings = report.findings
    worst = [max((f.conventional for f in findings if f.is_ok[0]), default=np.nan)]
    worst.append(max((f.proposed for f in findings if f.is_ok[1]), default=np.nan))
    missed = [sum(f.missed[way] for f in findings) for way in (0, 1)]
    error = max((f.reference_error for f in findings), default=np.nan)
    ok = "/".join(str(sum(f.is_ok[way] for f in findings)) for way in (0, 1))
    text = f"conventional {worst[0]:8.1e} ({missed[0]} missed) proposed {worst[1]:8.1e} ({missed[1]} missed) "
    text += f"ok {ok} of {len(findings)}, reference {error:7.1e}; "
    text += report.numerics
    unlike = [message for message in dict.fromkeys(report.messages) if message != "ok"]
    return text + "".join(f"\n      {message}" for message in unlike)


def summarise(bench: Bench, reports: list[Report]) -> None:
    """Print the figures over all machines."""
    findings = [finding for report in reports for finding in report.findings]
    for way, name in enumerate(("conventional", "proposed")):
        ok = [f for f in findings if f.is_ok[way]]
        values = np.array([(f.conventional, f.proposed)[way] for f in ok])
        text = f"{len(ok)} of {len(findings)} points ok"
        text += f"; median {np.median(values):.1e}, worst {values.max():.1e}" if values.size else ""
        wide = sum(f.proposed > 2 * TOLERANCE and f.is_in_band[1] for f in ok)
        bench.row(name, text + (f"; {wide} beyond {2 * TOLERANCE:g} but within the band" if way else ""))
        withheld = sum(f.is_withheld[way] for f in findings)
        is_met = len(reports) < FEW or withheld <= MAX_WITHHELD * len(findings)
        bench.row(f"{name}: not ok where physics allows better", f"{withheld} of {len(findings)} points", is_met)
    aperiodic = [f for f in findings if not f.is_periodic]
    called = sum(f.is_ok[0] for f in aperiodic)
    bench.row("reference not periodic", f"{len(aperiodic)} points, of which {called} are called ok")


if __name__ == "__main__":
    run(__doc__, machines, machines=(40, 10), only=[], law="")
