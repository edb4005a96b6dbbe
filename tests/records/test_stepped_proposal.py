"""The listing of a stepped sine with a column of its frequency."""

from pathlib import Path

import numpy as np
import pytest

from fraexp.components.registry import Registry
from fraexp.records.proposals import propose_import
from fraexp.records.record_files import list_contents


@pytest.mark.parametrize(("is_stepped", "proposed"), [(True, "--frequency Freq"), (False, "--samples-per-period 200")])
def test_a_column_of_steps_is_proposed_as_the_frequency(
    tmp_path: Path, registry: Registry, is_stepped: bool, proposed: str
) -> None:
    time = np.arange(2400) / 1000.0
    frequency = np.repeat([5.0, 0.0, 10.0], 800) if is_stepped else 5 + time
    u = np.sin(2 * np.pi * (frequency if is_stepped else 5.0) * time)
    path = tmp_path / "a.csv"
    np.savetxt(
        path,
        np.column_stack([time, frequency, u, np.roll(u, 3)]),
        delimiter=",",
        header="Time [s],Freq [Hz],u [N],y [um]",
        comments="",
        fmt="%.9g",
    )
    command = propose_import(path, list_contents(path, registry), registry).command
    assert proposed in command
    assert ("--frequency" in command) is is_stepped
