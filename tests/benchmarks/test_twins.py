"""The loop by hand in C, which the kernel's speed is measured against, computes what the kernel does."""

import shutil

import kernel
import numpy as np
import pytest
import twins


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler here: install gcc")
@pytest.mark.parametrize("kind", ["lanes", "scalar"])
@pytest.mark.parametrize("steps", [1, 3])
def test_channels_are_those_of_the_loop_by_hand_in_c(kind, steps, tmp_path):
    loops = kernel.Loops.of(kernel.setup_of(kernel.rolling(5), steps, kind == "lanes"), 1)
    run = twins.compiled(kind, tmp_path, 5, loops.sizes if kind == "lanes" else None)
    pool = np.zeros_like(loops.pool)
    twins.prepared(run, loops, pool)()
    loops.run()
    assert kernel.distance(loops.channels(pool), loops.channels()) < kernel.AGREEMENT
