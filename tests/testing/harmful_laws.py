"""Friction laws that do harm: beyond their memory, without end, as no number, by chance, or while they are loaded."""

from typing import NamedTuple

HEAD = '''"""A law that does harm."""

import itertools
import math
import os
import random
import sys
import time

import numpy as np

from fraexp.api import FrictionModel, param, where

TABLE = np.zeros(4)
HISTORY = []
COUNT = 0
{module}

class Hostile(FrictionModel, name="{name}", version=1):
    """One elasto-slide element (Jenkins 1962), with a fault."""

    stiffness: float = param("N/m", "stiffness before it slips", 4e5, above=0)
    limit: float = param("N", "force at which it slips", 18.0, above=0)
    weights: tuple[float, ...] = param("1", "two numbers", (1.0, 2.0))
    states = ("force [N]", "sign [1]", "reversals [1]")
    max_stiffness = property(lambda self: self.stiffness)
    {attributes}

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit, weights):
        """Friction force [N]."""
        force = min(max(z[0] + stiffness * dy, -limit), limit)
        sign = z[1]
        reversals = z[2]
        if dy != 0.0:
            sign = math.copysign(1.0, dy)
            if sign * z[1] < 0.0:
                reversals = z[2] + 1.0
        z_next[0] = force
        z_next[1] = sign
        z_next[2] = reversals
        {body}
        return {returned}
'''
SOFT = '''
class Hostile(FrictionModel, name="{name}", version=1):
    """A damper in lanes (Newton 1687), with a fault."""

    states = ("deflection [m]",)
    max_stiffness = property(lambda self: 1e3)

    @staticmethod
    def advance(z, dy, dt, z_next):
        """Friction force [N]."""
        z_next[0] = min(max(z[0] + dy, -1e-2), 1e-2)
        {body}
        return 1e3 * z_next[0]
'''
"""A law without branches on values, so soft that it runs in lanes."""

LATE = "reversals > 60.0"
VERY_LATE = "reversals > 5000.0"
RARE = "0.7 < force / limit < 0.701"


class Law(NamedTuple):
    """What is put into the template of a hostile law."""

    body: str = "pass"
    returned: str = "force"
    attributes: str = ""
    module: str = ""
    is_soft: bool = False

    def source(self, name: str) -> str:
        """Return the text of the plugin."""
        if self.is_soft:
            head = HEAD.partition("class Hostile")[0].format(module=self.module, name=name)
            return head + SOFT.format(name=name, body=self.body)
        return HEAD.format(
            name=name, **{key: getattr(self, key) for key in ("body", "returned", "attributes", "module")}
        )


def when(condition: str, statement: str) -> str:
    """Return a statement in a branch."""
    return f"if {condition}:\n            {statement}"


LAWS = {
    # beyond the memory
    "writes_beyond": Law("z_next[3] = 1.0"),
    "writes_far_beyond": Law("z_next[100000000] = 1.0"),
    "writes_beyond_late": Law(when(LATE, "z_next[3] = 1.0")),
    "writes_beyond_after_5000": Law(when(VERY_LATE, "z_next[3] = 1.0"), module="# a long study"),
    "writes_far_beyond_late": Law(when(LATE, "z_next[100000000] = 1.0")),
    "writes_before_late": Law(when(LATE, "z_next[-4] = 1.0")),
    "writes_beyond_rarely": Law(when(RARE, "z_next[3] = 1.0")),
    "reads_beyond_late": Law(when(LATE, "force = z[3]")),
    "reads_parameter_beyond": Law(when(LATE, "force = weights[int(reversals)]")),
    "writes_state_late": Law(when(LATE, "z[0] = 0.0")),
    "writes_parameter_late": Law(when(LATE, "weights[2] = 0.0")),
    "helper_writes_beyond": Law(
        when(LATE, "helper(z_next, 7)"), module="\ndef helper(z_next, i):\n    z_next[i] = 1.0\n\n"
    ),
    "index_grows": Law("z_next[int(reversals) % 5] += 0.0"),
    "lanes_write_beyond": Law("z_next[1] = 0.0", is_soft=True),
    "lanes_write_at_short_steps": Law(when("dt != 1e-4 and dt < 0.9", "z_next[30] = 0.0"), is_soft=True),
    # never returns
    "never_returns": Law("while True:\n            force += 1e-9"),
    "never_returns_late": Law(when(LATE, "while reversals > 0.0: force += 1e-9")),
    "never_returns_rarely": Law(when(RARE, "while limit > 0.0: force += 1e-9")),
    "never_returns_at_short_steps": Law(when("dt < 9e-5", "while dt > 0.0: force += 1e-9")),
    "recurses": Law(
        "force += helper(force)", module="\ndef helper(x):\n    return helper(x + 1.0) if x < 1e300 else 0.0\n\n"
    ),
    "hangs_in_stiffness": Law(
        attributes="max_stiffness = property(lambda self: next(x for x in itertools.count() if x < 0))"
    ),
    "hangs_in_viscous": Law(attributes="viscous = property(lambda self: next(x for x in itertools.count() if x < 0))"),
    "hangs_in_c": Law("force += 0.0 * len(str(3 ** 10 ** 8))"),
    "hangs_when_loaded": Law(module="while True:\n    COUNT += 1\n"),
    # no number
    "nan": Law(returned="force * math.nan"),
    "nan_late": Law(when(LATE, "force = math.nan")),
    "nan_rarely": Law(when(RARE, "force = math.nan")),
    "nan_in_state_late": Law(when(LATE, "z_next[0] = math.nan")),
    "infinite_late": Law(when(LATE, "force = math.inf")),
    "divides_by_zero_late": Law(when(LATE, "force = force / (limit - limit)")),
    "root_of_negative": Law("force = force * math.sqrt(0.999 - force * force / (limit * limit))"),
    "lanes_give_nan": Law("z_next[0] = where(z_next[0] > 2e-5, math.nan, z_next[0])", is_soft=True),
    # errors
    "raises": Law("raise ValueError('boom')"),
    "raises_late": Law(when(LATE, "raise ValueError('boom')")),
    "exits": Law("sys.exit(0)"),
    "interrupts": Law("raise KeyboardInterrupt"),
    "exits_at_once": Law("os._exit(0)"),
    "aborts": Law("os.abort()"),
    "exits_when_loaded": Law(module="os._exit(0)\n"),
    "aborts_late": Law(when(LATE, "os.abort()")),
    # memory beside z, and chance
    "keeps_list": Law("HISTORY.append(dy)", "force + 1e-3 * len(HISTORY)"),
    "keeps_array": Law("TABLE[0] += dy", "force + 1e3 * TABLE[0]"),
    "keeps_array_late": Law(when(LATE, "TABLE[0] += dy"), "force + 1e3 * TABLE[0]"),
    "counts": Law("global COUNT\n        COUNT += 1", "force + 1e-3 * COUNT"),
    "argument_changes": Law(
        module="TICKS = itertools.count(1)\n", attributes="limit = property(lambda self: 18.0 + next(TICKS))"
    ),
    "reads_older_state": Law(
        "if z_next[3] > 60.0: force = 0.5 * force\n        z_next[3] = z[3] + 1.0",
        attributes="state_size = property(lambda self: 4)",
    ),
    "lanes_read_older_state": Law("z_next[0] = 0.5 * z_next[0] + 0.5 * z_next[1]; z_next[1] = z[0]", is_soft=True),
    "leaves_unwritten_late": Law(
        "if reversals < 60.0: z_next[3] = reversals\n        force += 1e-9 * z[3]",
        attributes="state_size = property(lambda self: 4)",
    ),
    "unassigned_rarely": Law(f"if not ({RARE}):\n            extra = 0.0\n        force += extra"),
    "unwritten_memory": Law("scratch = np.empty(5)\n        force += 1e-3 * scratch[3]"),
    "reads_an_address": Law("force += 1e-9 * (z.ctypes.data % 4096)"),
    "prints_late": Law(when(LATE, "print(dy)")),
    "random": Law(returned="force + 0.1 * random.random()"),
    "random_rarely": Law(when(RARE, "force += np.random.random()")),
    "clock": Law(returned="force + 1e-9 * time.time()"),
    # wrong sizes and types
    "too_few_states": Law(attributes="state_size = property(lambda self: 1)"),
    "negative_size": Law(attributes="state_size = property(lambda self: -3)"),
    "size_is_text": Law(attributes="state_size = property(lambda self: 'three')"),
    "million_states": Law(attributes="state_size = property(lambda self: 1_000_000)"),
    "returns_none": Law(returned="None"),
    "returns_array": Law(returned="z_next"),
    "leaves_unwritten": Law(attributes="state_size = property(lambda self: 4)"),
    "many_states": Law(
        "for i in range(3, z.size): z_next[i] = z[i]", attributes="state_size = property(lambda self: 90_000)"
    ),
    "states_as_text": Law(attributes='states = "force [N]"'),
    "stiffness_too_low": Law(attributes="max_stiffness = property(lambda self: 1.0)"),
    "stiffness_absurd": Law(attributes="max_stiffness = property(lambda self: 1e14)"),
    "stiffness_is_text": Law(attributes="max_stiffness = property(lambda self: 'stiff')"),
    "stiffness_changes": Law(attributes="max_stiffness = property(lambda self: 4e5 * (1.0 + random.random()))"),
    "complex_late": Law(when(LATE, "force = force + 0j")),
    # what harms the whole process while it is loaded
    "forks_when_loaded": Law(module="os.fork()\n"),
    "stops_when_loaded": Law(module="os.kill(os.getpid(), 19)\n"),
    "changes_folder": Law(module="os.chdir('/')\n"),
    "sets_an_alarm": Law(module="import signal\nsignal.alarm(1)\n"),
    "hangs_at_exit": Law(module="import atexit\natexit.register(time.sleep, 1000)\n"),
    "stops_the_clock": Law(module="time.monotonic = lambda: 0.0\n"),
    "sleeps_when_loaded": Law(module="time.sleep(1000)\n"),
    # slow, or large
    "huge_tuple": Law("force += BIG[int(reversals) % 5]", module="BIG = tuple(0.0 * k for k in range(20_000))\n"),
    "huge_array": Law("force += BIG[int(reversals) % BIG.size]", module="BIG = np.zeros(20_000_000)\n"),
    "allocates_late": Law(when(LATE, "force += 0.0 * np.ones(400_000_000).sum()")),
    "slow": Law("for i in range(3_000_000): force += 1e-20 * i"),
    "slow_late": Law(when(LATE, "for i in range(100_000_000_000): force += 1e-20 * math.sin(i)")),
    "very_long": Law("\n        ".join(f"force += {k}e-12 * math.sin(force + {k})" for k in range(3000))),
    # energy from nothing
    "drives": Law(returned="-force"),
    "negative_damper": Law(returned="force - 30.0 * dy / dt"),
    "negative_viscous": Law(attributes="viscous = property(lambda self: -50.0)"),
    # what cannot be compiled
    "uses_a_generator": Law("force += next(x for x in itertools.count())"),
    "uses_an_object": Law("force = float(str(force))"),
}
