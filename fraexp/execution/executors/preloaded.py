"""What a fork server imports for all of its workers: how they serve, the compiler, and all that this needs.

Nothing of it is garbage: without looking for some the server starts in two thirds of the time, and workers look for
none in it.
"""

import gc
import importlib

gc.disable()
for module in ("fraexp.execution.executors.worker", "fraexp.kernels.batch", "fraexp.kernels.prescribed_motion"):
    importlib.import_module(module)
gc.freeze()
gc.enable()
