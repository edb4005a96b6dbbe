"""Any machine of a study as if it were a real one: a process of its own, behind a socket."""

import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Chunk,
    ConnectionLostError,
    ControlLoop,
    MachineDescription,
    MachineDriver,
    MachineError,
    MachineSession,
    PlayRequest,
    param,
    workspace_path,
)
from fraexp_plugins.machines._shared.axis_server import Message, MessageStream

PATIENCE_SHARE = 0.3
"""Part of the watchdog's time after which what is missing is asked for again."""
RECONNECT_INTERVAL_S = 0.01
"""Wait between two attempts to connect."""


class SimulatedMachine(MachineDriver, name="simulated", version=1):
    """The study's machine, or another one, simulated sample by sample in a process that knows nothing of the study.

    `speed` is that of real time; with 0 the machine waits for whoever measures, so that the same samples come whatever
    else the computer does. Packets can get lost and be late, and the connection can be cut. The machine stops by its
    watchdog, like a real one. `from_rest` lets each play begin as an experiment of a run does, with the same noise.
    """

    speed: float = param("1", "machine time over real time; 0 to wait for whoever measures", 0.0, at_least=0)
    from_rest: bool = param("", "whether each play begins with a machine that has never moved", True)
    loss: float = param("1", "part of the packets that get lost", 0.0, at_least=0, below=1)
    delay: float = param("s", "delay of each packet", 0.0, at_least=0, at_most=10)
    cut_after: float = param("s", "machine time after which the connection is cut once; 0 for never", 0.0, at_least=0)
    seed: int = param("1", "seed of the losses", 0, at_least=0)
    watchdog: float = param("s", "time without a sign of life after which it stops", 0.5, above=0)
    limits: dict[str, Any] = param("", "limits that it states, by the names of [limits]", {})
    log: str = param("", "file to which it writes when it plays, stops and rests; empty for none", "")
    plant: dict[str, Any] = param("", "plant", inherit="plant")
    friction: dict[str, Any] = param("", "friction, or one for each contact", inherit="friction")
    controller: dict[str, Any] = param("", "controller", inherit="controller")
    loop: dict[str, Any] = param("", "sampled loop with delays and encoder", inherit="loop")
    numerics: dict[str, Any] = param("", "how finely it is computed", {}, inherit="numerics")

    def model_post_init(self, context: object) -> None:
        """Check the loop."""
        self.plain_loop()

    def plain_loop(self) -> dict[str, Any]:
        """Return the loop as plain data in SI units, whose values may have been written as texts with units."""
        rotary = bool(self.loop.get("rotary", False))
        return ControlLoop.parse(self.loop, "measurement.machine.loop", rotary=rotary).plain()

    def connect(self, folder: Path) -> "SimulatedSession":
        return SimulatedSession(self, folder)


class SimulatedSession(MachineSession):
    """The connection to a simulated machine, which it has started."""

    def __init__(self, machine: SimulatedMachine, folder: Path) -> None:
        self._machine = machine
        loop = machine.plain_loop()
        position, force = ("rad", "N m") if loop.get("rotary") else ("m", "N")
        self._units = {"y": position, "u": force, "excitation": force}
        log = str(workspace_path(folder, machine.log, "log")) if machine.log else ""
        order = {**machine.plain(), "loop": loop, "folder": str(folder), "channels": list(self._units), "log": log}
        order["sections"] = {key: order.pop(key) for key in ("plant", "friction", "controller", "loop", "numerics")}
        if not order["sections"]["numerics"]:
            del order["sections"]["numerics"]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "fraexp_plugins.machines._shared.axis_server"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for whoever measures, who lets the machine come to rest
        )
        self._port = self._start(order)
        self._stream = MessageStream(socket.create_connection(("127.0.0.1", self._port)))
        self._early: dict[int, NDArray[np.float64]] = {}
        self._is_playing, self._plays = False, 0
        self._description = MachineDescription(
            self._units, loop["sample_time"], machine.limits, machine.watchdog, keeps_time=False
        )

    @property
    def description(self) -> MachineDescription:
        return self._description

    def _start(self, order: dict[str, Any]) -> int:
        """Give the process its order, and return its port."""
        assert self._process.stdin and self._process.stdout
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()
        answer = json.loads(self._process.stdout.readline() or '{"error": "its process has ended"}')
        if "error" in answer:
            self._process.kill()
            raise MachineError(f"the simulated machine cannot be started: {answer['error']}")
        return int(answer["port"])

    def play(self, request: PlayRequest) -> Iterator[Chunk]:
        self._plays += 1
        order = {
            "do": "play", "name": self._plays, "number": request.number, "repetitions": request.repetitions,
            "amplitude_rise": request.amplitude_rise, "ramp_out": request.ramp_out,
        }  # fmt: skip
        self._early, self._is_playing, expected = {}, True, 0
        self._stream.send(order, request.waveform)
        try:
            while (chunk := self._next_chunk(expected)) is not None:
                expected += chunk.size
                yield chunk
                self._say({"do": "acknowledge", "samples": expected})
        finally:
            self.stop()
            self._is_playing = False

    def stop(self) -> None:
        if self._is_playing:
            self._say({"do": "stop"})

    def disable(self) -> None:
        self._say({"do": "disable"})

    def close(self) -> None:
        super().close()
        self._say({"do": "quit"})
        self._stream.close()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe:
                pipe.close()
        try:
            self._process.wait(self._machine.watchdog + 5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _say(self, table: dict[str, Any]) -> None:
        """Send a message that may get lost with the connection."""
        with suppress(OSError):  # found, and mended, where the next samples are waited for
            self._stream.send(table)

    def _next_chunk(self, expected: int) -> Chunk | None:
        """Return the samples from `expected` on; None at the end of the play."""
        note, patience = "", PATIENCE_SHARE * self._machine.watchdog
        while expected not in self._early:
            try:
                message = self._stream.receive(patience)
            except OSError:
                note = self._reconnect(expected)
                message = None
            if message is not None and message[0]["of"] != self._plays:
                continue  # of a play that was given up
            if message is None:
                note = note or f"samples from {expected} on were asked for again"
                self._say({"do": "again", "start": expected})
            elif message[0]["is"] == "end":
                if self._is_end(message[0], expected):
                    return None
                self._say({"do": "again", "start": expected})
            elif missing := self._keep(message, expected):
                note = f"samples {expected} to {missing} were lost, and sent again"
                self._say({"do": "again", "start": expected, "end": missing})
        numbers = self._early.pop(expected)
        self._early = {start: early for start, early in self._early.items() if start > expected}
        return Chunk(expected, dict(zip(self._units, numbers, strict=True)), note)

    def _is_end(self, table: dict[str, Any], expected: int) -> bool:
        """Return whether a play has ended whose samples have all arrived; raise an error if the machine ended it."""
        if table["reason"]:
            raise ConnectionLostError(
                f"the machine stopped by its {table['reason']} at sample {table['samples']}, because it heard nothing"
            )
        return bool(expected >= table["samples"])

    def _keep(self, message: Message, expected: int) -> int:
        """Keep samples that have arrived; return the first sample that is there if those before it are missing."""
        table, numbers = message
        start, samples = int(table["start"]), numbers.reshape(len(self._units), -1)
        if start <= expected < start + samples.shape[1]:
            self._early[expected] = samples[:, expected - start :]
        elif start > expected and start not in self._early:
            self._early[start] = samples
            return start if start == min(self._early) else 0
        return 0

    def _reconnect(self, expected: int) -> str:
        """Connect again within the time of the watchdog, and return a note."""
        self._stream.close()
        until = time.monotonic() + self._machine.watchdog
        while time.monotonic() < until:
            try:
                self._stream = MessageStream(socket.create_connection(("127.0.0.1", self._port)))
                return f"the connection was cut at sample {expected}, and resumed there"
            except OSError:
                time.sleep(RECONNECT_INTERVAL_S)
        raise ConnectionLostError(f"the connection was lost at sample {expected}")
