"""A researcher's session in ten lines, as somebody would type it into a notebook."""

from pathlib import Path

import numpy as np
import pytest

SESSION = """
import fraexp
workspace = fraexp.Workspace()
run = workspace.run("paper/fig12", {"excitation.points": 20}, progress=False)
data = run.to_xarray()
plant = run.one("estimator=effective_input excitation.amplitude=75").to_frd()
margins = control.margin(plant * control.tf([6000], [1]))
spread = abs(data.response.sel(amplitude=12) / data.response.sel(amplitude=75) - 1).max("frequency")
figure = run.plot()
law = fraexp.FrictionLaw(Spring(stiffness=2e6))
apparent = law.describing_function([1e-6, 1e-5])
"""


@pytest.mark.filterwarnings("ignore::FutureWarning:control")
def test_ten_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import control

    from fraexp.api import FrictionModel, param

    class Spring(FrictionModel, name="spring_of_a_test", version=1):
        """A spring."""

        stiffness: float = param("N/m", "stiffness", above=0)

        @staticmethod
        def advance(z, dy, dt, z_next, stiffness):
            z_next[0] = z[0] + stiffness * dy
            return z_next[0]

        states = ("force [N]",)

    monkeypatch.chdir(tmp_path)
    names = {"control": control, "Spring": Spring}
    exec(SESSION, names)

    assert len(SESSION.strip().splitlines()) == 10
    assert np.isfinite(names["margins"][2:]).any()
    spread = names["spread"]
    assert float(spread.sel(estimator="conventional")) > 0.9  # friction hides the plant at 12 N
    assert float(spread.sel(estimator="effective_input")) < 0.7  # and below 2 Hz its observer is short of resolution
    assert names["figure"].axes
    np.testing.assert_allclose(names["apparent"], 2e6, rtol=1e-9)
