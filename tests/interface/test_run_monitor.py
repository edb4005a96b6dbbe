"""Progress of single computations: what is compiled is said once, with a name."""

import pytest

from fraexp.interface.run_monitor import computing_meter
from fraexp.kernels.announcement import announced_compilation, compilation_listener

LAW = {"name": "rolling"}


@pytest.mark.parametrize(
    ("computed", "expected"),
    [
        ({"friction": LAW}, "compiling friction law 'rolling' (once per machine)"),
        (
            {"estimator": {"name": "effective_input", "friction": LAW}},
            "compiling friction law 'rolling' for effective_input (once per machine)",
        ),
        (
            {"estimator": {"name": "friction_identification", "law": "gms"}},
            "compiling the friction law for friction_identification (once per machine)",
        ),
    ],
)
def test_a_compilation_is_announced_once_by_name(
    computed: dict[str, object], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with computing_meter(computed):
        for _ in range(3):
            with announced_compilation(), announced_compilation():
                pass
    assert capsys.readouterr().err.splitlines() == [expected]


def test_the_end_of_a_compilation_is_said_and_what_it_compiles_within_is_part_of_it() -> None:
    said: list[bool] = []
    with compilation_listener(said.append):
        with announced_compilation(), announced_compilation():
            assert said == [True]
        with pytest.raises(ZeroDivisionError), announced_compilation():
            raise ZeroDivisionError
    assert said == [True, False, True, False]
