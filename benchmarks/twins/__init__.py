"""The sampled loop with rolling friction written by hand in C, to compare fraexp's kernel with."""

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from loops import Loops

HERE = Path(__file__).parent
FLAGS = ("-O3", "-march=native", "-ffp-contract=fast", "-w", "-shared", "-fPIC")
INTEGERS = np.ctypeslib.ndpointer(np.int64, flags="C")
NUMBERS = np.ctypeslib.ndpointer(np.float64, flags="C")
ALIGNMENT = 64


def compiler() -> str | None:
    """Return the C compiler, or None if there is none."""
    return shutil.which("gcc")


def compiled(name: str, folder: Path, elements: int, fixed: dict[str, int] | None = None) -> Any:
    """Return the function `run` of a C file with this number of friction elements, and with sizes that are fixed."""
    given = {"ELEMENTS": elements, **(fixed or {})}
    library = folder / f"{name}_{'_'.join(str(value) for value in given.values())}.so"
    options = [f"-D{key}={value}" for key, value in given.items()]
    command = [str(compiler()), *FLAGS, *options, str(HERE / f"{name}.c"), "-o", str(library), "-lm"]
    subprocess.run(command, check=True)
    function = ctypes.CDLL(str(library)).run
    function.restype = ctypes.c_int64
    function.argtypes = [
        NUMBERS, INTEGERS, NUMBERS, NUMBERS, INTEGERS, INTEGERS, ctypes.c_int64, ctypes.c_int64, ctypes.c_int64,
        *[ctypes.c_double] * 4, NUMBERS, NUMBERS, NUMBERS,
    ]  # fmt: skip
    return function


def prepared(function: Any, loops: Loops, pool: np.ndarray) -> Callable[[], int]:
    """Return an action that runs the same jobs as fraexp's kernel, all of one machine, and returns how many batches."""
    work, jobs = loops.work.arrays, loops.work.arrays.jobs
    width, record = work.lanes.size, int(jobs["record"][0])
    store = aligned(work.machines[0])
    ramp, goals = int(jobs["ramp"][0]), np.ascontiguousarray(jobs["reference"])
    begin, period = np.ascontiguousarray(jobs["first_sample"]), np.ascontiguousarray(jobs["period"])
    sizes = np.array(list(loops.sizes.values()))
    history, others = np.empty(width * (ramp + record)), np.empty(width * 3 * record)

    start, rise = float(jobs["start_amplitude"][0]), float(jobs["amplitude_rise"][0])
    resolution, limit = loops.setup.resolution, loops.setup.divergence_limit

    def action() -> int:
        done: int = function(
            store, sizes, work.waveforms, goals, begin, period, loops.batches, ramp, record, start, rise,
            resolution, limit, history, others, pool,
        )  # fmt: skip
        return done

    return action


def aligned(values: np.ndarray) -> np.ndarray:
    """Return a copy that begins where a vector register likes it."""
    place = np.empty(values.size + ALIGNMENT // 8)
    first = (-place.ctypes.data % ALIGNMENT) // 8
    found = place[first : first + values.size]
    found[:] = values
    return found
