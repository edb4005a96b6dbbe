"""Compiled kernels: kept in the cache folder, compiled once, and again where anything behind them has changed."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.examples import thorough

USE = """
import sys, time
from pathlib import Path
import numpy as np
from fraexp.kernels.announcement import compilation_listener
from fraexp.components.registry import create, discover
from fraexp.components.kinds import FrictionModel

said = []
with compilation_listener(said.append):
    model = create(discover(Path(sys.argv[1])), FrictionModel, {"name": "spring", "stiffness": 2.0})
    force = model.force(np.array([0.0, 1.0, 2.0]), 1e-3)
print(force.tolist(), sum(said))
"""
LAW = '''
"""A law in a file of its own."""

from fraexp.api import FrictionModel, param

FACTOR = {factor}


class Spring(FrictionModel, name="spring", version=1):
    """A spring."""

    states = ("deflection [m]",)
    stiffness: float = param("N/m", "stiffness", above=0)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness):
        """Friction force [N]."""
        z_next[0] = z[0] + dy
        {line}
        return FACTOR * stiffness * z_next[0]
'''


class Bench:
    """A folder with a law, and a cache of its own."""

    def __init__(self, folder: Path) -> None:
        self.plugins, self.cache = folder / "plugins", folder / "cache"
        self.plugins.mkdir()
        self.write()

    def write(self, factor: str = "1.0", line: str = "pass") -> None:
        (self.plugins / "spring.py").write_text(LAW.format(factor=factor, line=line), encoding="utf-8")

    def start(self) -> "subprocess.Popen[str]":
        command = [sys.executable, "-W", "error", "-c", USE, str(self.plugins)]
        environment = {**os.environ, "FRAEXP_CACHE_DIR": str(self.cache)}
        return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def use(self) -> tuple[str, int]:
        """Return the force as a fresh process computes it, and how much it has compiled."""
        return answer(self.start())

    def share_what_all_laws_share(self) -> None:
        """Begin with the kernels of all other tests: what all laws share is compiled once for all of them."""
        (self.cache / "kernels").mkdir(parents=True)
        for kernel in Path(os.environ["FRAEXP_CACHE_DIR"]).glob("kernels/*.kernel"):
            shutil.copy(kernel, self.cache / "kernels")

    def kernels(self) -> list[Path]:
        return sorted(self.cache.rglob("*.kernel"))


def answer(process: "subprocess.Popen[str]") -> tuple[str, int]:
    said, error = process.communicate()
    assert process.returncode == 0, error
    force, _, compiled = said.strip().rpartition(" ")
    return force, int(compiled)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


@pytest.mark.thorough
def test_an_edited_law_or_constant_is_compiled_again_and_nothing_else(bench: Bench) -> None:
    bench.share_what_all_laws_share()
    bench.use()
    before = {path: path.stat().st_mtime_ns for path in bench.kernels()}
    bench.write(factor="3.0")
    assert bench.use() == ("[0.0, 6.0, 12.0]", 1)
    bench.write(line="dt = dt + 0.0")
    assert bench.use() == ("[0.0, 2.0, 4.0]", 1)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert len(bench.kernels()) == len(before) + 2


@pytest.mark.thorough
def test_processes_that_start_together_compile_once(bench: Bench) -> None:
    found = [answer(process) for process in [bench.start() for _ in range(3)]]
    assert {force for force, _ in found} == {"[0.0, 2.0, 4.0]"}
    assert sum(compiled for _, compiled in found) == 2


@pytest.mark.thorough
def test_laws_of_one_name_that_two_processes_have_compiled_stay_two(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    other = Bench(tmp_path / "other")
    other.cache = bench.cache
    other.write(factor="5.0")
    assert bench.use()[0] == "[0.0, 2.0, 4.0]"
    assert other.use()[0] == "[0.0, 10.0, 20.0]"
    first, second = (f"import sys\nsys.argv[1] = {str(each.plugins)!r}\n{USE}" for each in (bench, other))
    code = f"{first}\nkept = model\n{second}\nprint(kept.force(np.array([0.0, 1.0, 2.0]), 1e-3).tolist())"
    command = [sys.executable, "-W", "error", "-c", code, str(bench.plugins)]
    environment = {**os.environ, "FRAEXP_CACHE_DIR": str(bench.cache)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["[0.0, 2.0, 4.0] 0", "[0.0, 10.0, 20.0] 0", "[0.0, 2.0, 4.0]"]


def with_a_flipped_bit(content: bytes) -> bytes:
    middle = len(content) // 2  # of the machine code, which would crash
    return content[:middle] + bytes([content[middle] ^ 4]) + content[middle + 1 :]


FORMAT_FAULT = (
    "Use of unsupported opcode (FORMAT_WITH_SPEC) found"
    if sys.version_info >= (3, 13)  # whose bytecode has an instruction of its own for it
    else "format spec in f-strings not supported"
)


@pytest.mark.thorough
def test_a_law_that_calls_the_runtime_of_numba_is_loaded(bench: Bench) -> None:
    """Without the functions that its machine code calls LLVM would end the process."""
    bench.write(line="z_next[0] += 0.0 * hash('slip' if dy > 0 else 'stick')")
    first, second = bench.use(), bench.use()
    assert first[0] == second[0] == "[0.0, 2.0, 4.0]"
    assert second[1] == 0


def test_a_damaged_kernel_is_compiled_again(bench: Bench) -> None:
    bench.share_what_all_laws_share()
    shared = bench.kernels()
    bench.use()
    for path in set(bench.kernels()) - set(shared):
        path.write_bytes(with_a_flipped_bit(path.read_bytes()))
    assert bench.use()[0] == "[0.0, 2.0, 4.0]"
    assert bench.use() == ("[0.0, 2.0, 4.0]", 0)


@pytest.mark.thorough
def test_without_a_folder_to_write_each_process_compiles(bench: Bench) -> None:
    bench.cache.write_text("not a folder", encoding="utf-8")
    assert bench.use() == ("[0.0, 2.0, 4.0]", 2)


@pytest.mark.parametrize(
    ("line", "said"), [thorough("dy = f'{dy:03d}'", FORMAT_FAULT), ("dy.wrong()", "Unknown attribute 'wrong'")]
)
def test_a_law_that_cannot_be_compiled_is_named_with_its_file_and_line(bench: Bench, line: str, said: str) -> None:
    bench.share_what_all_laws_share()
    bench.write(line=f"if dy > 1e300:\n            {line}")
    process = bench.start()
    _, error = process.communicate()
    last = error.splitlines()[-1]
    number = 1 + next(
        at for at, text in enumerate((bench.plugins / "spring.py").read_text().splitlines()) if line in text
    )
    assert f"Spring.advance (spring.py, line {number}) cannot be compiled: {said}" in last
