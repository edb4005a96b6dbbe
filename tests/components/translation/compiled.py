"""Blocks compiled by gcc and called from Python, and blocks of friction laws."""

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fraexp.components.kinds import FrictionModel
from fraexp.components.translation.blocks import Block, BlockInput, friction_force
from fraexp.components.translation.c_code import c_text

STRICT = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Wno-sign-conversion", "-Werror", "-pedantic"]
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")


def friction_block(model: FrictionModel, name: str = "friction", samples: int = 40) -> Block:
    """Return the block of a friction model, whose test vector sticks and slides."""
    moved = np.random.default_rng(7).normal(size=samples) * 3e-6
    states = {"z": model.state_size, "z_next": model.state_size}
    constants = {"friction": (model.law, model.law_arguments(), float(model.viscous))}
    inputs = (BlockInput("moved", "m", "displacement"), BlockInput("time", "s", "time"))
    rows = np.column_stack([moved, np.full(samples, 5e-4)])
    return Block(name, "friction", friction_force, states, inputs, constants, BlockInput("force", "N", "force"), rows)


def compile_c(folder: Path, source: str, *options: str) -> Path:
    """Compile C without a warning, and return the file that the compiler wrote."""
    (folder / "source.c").write_text(source, encoding="utf-8")
    target = folder / "compiled"
    command = ["gcc", *STRICT, *options, str(folder / "source.c"), "-o", str(target), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return target


class CompiledBlocks:
    """Blocks in a shared library, each with a loop over samples."""

    def __init__(self, folder: Path, blocks: Sequence[Block], is_single: bool = False) -> None:
        self._blocks = {block.name: block for block in blocks}
        loops = "".join(self._loop(block) for block in blocks)
        library = compile_c(folder, c_text(blocks, "axis", ["test"], is_single) + loops, "-shared", "-fPIC")
        self._library = ctypes.CDLL(str(library))

    @staticmethod
    def _loop(block: Block) -> str:
        count = len(block.inputs)
        given = ", ".join(f"(axis_real)in[{count} * k + {i}]" for i in range(count))
        return (
            f"void run_{block.name}(long n, const double *in, double *out);\n"
            f"void run_{block.name}(long n, const double *in, double *out) {{\n"
            f"    axis_{block.name}_state state;\n    axis_{block.name}_reset(&state);\n"
            f"    for (long k = 0; k < n; ++k) out[k] = (double)axis_{block.name}_step(&state, {given});\n}}\n"
        )

    def run(self, name: str, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the outputs of a block for inputs of shape (samples, inputs)."""
        rows, found = np.ascontiguousarray(inputs, dtype=float), np.empty(len(inputs))
        pointer = ctypes.POINTER(ctypes.c_double)
        run = getattr(self._library, f"run_{name}")
        run(ctypes.c_long(len(rows)), rows.ctypes.data_as(pointer), found.ctypes.data_as(pointer))
        return found
