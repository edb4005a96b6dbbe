"""The files that the page on records imports, and whether what was found in them is the truth."""

from pathlib import Path

import numpy as np

from fraexp.data.results import Result
from fraexp.store import Store
from tests.records.strangers import Drive, Structure, point_to_point, slow_noise, write_classic

DRIVE, STRUCTURE = Drive(), Structure()
REALISATIONS, PERIODS = 4, 3


def write_drive(path: Path, reference: np.ndarray) -> None:
    """Write the record of a motion [m]."""
    volts, counts = DRIVE.follow(reference)
    increments = counts[:, None].astype(np.int32)
    write_classic(
        path, {"servo_volt": volts[:, None], "enc_cnt": increments, "soll_mm": 1e3 * reference, "fs": DRIVE.rate}
    )


def write_level(path: Path, force: np.ndarray, acceleration: np.ndarray) -> None:
    """Write the realisations of one level, each of shape (samples, periods, realisations), as a table."""
    time = np.arange(force.size) / STRUCTURE.rate
    run = np.repeat(np.arange(1, force.shape[2] + 1), force.shape[0] * force.shape[1])
    rows = np.column_stack([time, force.ravel(order="F"), acceleration.ravel(order="F"), run])
    np.savetxt(path, rows, "%.9g", ";", header="t [s];Force [N];Acceleration [m/s^2];run", comments="")


def write_strangers(folder: Path) -> None:
    """Write all files that the page on records names."""
    write_drive(folder / "drive.mat", point_to_point(DRIVE.rate))
    write_drive(folder / "drive_noise.mat", slow_noise(DRIVE.rate))
    force, acceleration = STRUCTURE.all_records(REALISATIONS, PERIODS)
    write_classic(folder / "vibration.mat", {"force_N": force, "acc_g": acceleration / 9.80665, "Fs": STRUCTURE.rate})
    for level in (0, 1):
        write_level(folder / f"level_{level + 1}.csv", force[..., level], acceleration[..., level])


def results(folder: Path, study: str) -> list[Result]:
    """Return the results of a study's newest run, in its order."""
    with Store.open(str(folder / "results.db"), read_only=True) as store:
        number = max(run.number for run in store.runs() if run.study == study)
        sweeps = store.sweeps(number)
        found = store.results([sweep.key for sweep in sweeps])
        return [found[sweep.key] for sweep in sweeps]


def check_drive(result: Result) -> None:
    """Mass within 2 %, friction within 5 %: what a user may expect of any record; these are better than 1 %."""
    values = {metric.name: metric.value for metric in result.metrics}
    truth = {
        "mass": DRIVE.mass,
        "Coulomb force": DRIVE.coulomb,
        "viscous coefficient": DRIVE.viscous,
        "offset": DRIVE.offset,
    }
    for name, value in truth.items():
        assert abs(values[name] / value - 1) < 0.01, name


def check_response(with_friction: Result, without: Result) -> None:
    """The proposed method is left with the mass; the other one is biased by friction where the thrust is small."""
    errors = []
    for result in (with_friction, without):
        kinds = {each.kind for each in result.findings}  # nothing of what these methods do not need
        assert kinds <= {"band by noise"} | (
            {"hidden by standstill", "band by friction", "no harmonics"} if result is without else set()
        ), kinds
        response = result.response
        assert response is not None
        mass = 1 / (DRIVE.mass * (2j * np.pi * response.frequency) ** 2)
        errors.append(np.abs(response.response / mass - 1))
    assert np.median(errors[1]) < 0.02
    assert np.percentile(errors[1], 95) < 0.1
    assert np.median(errors[0]) > 5 * np.median(errors[1])


def check_levels(found: list[Result], displacement: bool) -> None:
    """The lowest level is the structure itself; with the level nonlinear distortions rise, noise falls, relatively."""
    shares = []
    for result in found:
        response = result.response
        assert response is not None
        np.testing.assert_allclose(response.frequency, STRUCTURE.frequency(), rtol=1e-12)
        truth = STRUCTURE.linear() / ((2j * np.pi * response.frequency) ** 2 if displacement else 1.0)
        error = np.abs(response.response / truth - 1)
        shares.append((np.median(error), np.sqrt(np.median(response.nonlinear_variance / np.abs(truth) ** 2))))
        assert response.noise_variance is not None
        relative = np.sqrt(np.median(response.noise_variance)) / np.median(np.abs(truth))
        assert relative < 5e-3
    assert shares[0][0] < 0.01  # the time step of the simulation is a quarter of that
    distortion = [share for _, share in shares]
    assert distortion == sorted(distortion)
    assert distortion[-1] > 5 * distortion[0]


def check_strangers(folder: Path) -> None:
    """Compare with the truth what the page's commands have found."""
    check_drive(results(folder, "drive_friction")[0])
    check_response(*results(folder, "drive_noise"))
    levels = results(folder, "levels")
    assert len(levels) == len(STRUCTURE.levels)
    check_levels(levels, displacement=True)
    assert len(results(folder, "files")) == 2
