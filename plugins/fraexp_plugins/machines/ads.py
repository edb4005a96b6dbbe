"""TwinCAT controllers over ADS, through the package pyads."""

import ctypes
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Chunk,
    ConnectionLostError,
    MachineDescription,
    MachineDriver,
    MachineError,
    MachineSession,
    PlayRequest,
    param,
)

BLOCK_SOURCE = Path(__file__).parent / "_shared" / "FB_FraexpMachine.st"
"""The function block that the PLC must have."""
SYMBOLS = ("SampleTime", "WaveSize", "RingSize", "Wave", "Order", "Play", "Halt", "Taken", "Status", "Record")
"""Variables of the block that are written or read."""
CHANNELS = ("y", "u", "excitation")
"""Channels of a record, in their order in the block."""
PACKET_NUMBERS = 400
"""Numbers that are written or read at once: about 3 kB, which every ADS router takes."""
REST_TIMEOUT_S = 5.0
"""Time for which the end of an earlier play is waited for, and the begin of the next one."""
LREAL_SIZE = 8
"""Bytes of a number."""
LOG_LEVEL, SILENT_LEVEL = "_ZN6Logger8logLevelE", 4
"""Symbol of the level from which the library prints, and one above that of its errors."""
AT_REST = 0
"""State of the block in which it plays nothing."""
STOP_REASONS = {
    2: "it stopped by its watchdog, because its samples were not taken",
    3: "it stopped, because its samples were taken too slowly: lengthen Record and RingSize of the block",
    4: "it refused the order",
}
"""Why the block has stopped by itself, by its number."""


class AdsMachine(MachineDriver, name="ads", version=1):
    """A PLC of Beckhoff, whose function block FB_FraexpMachine plays, records, and stops when nobody takes its samples.

    The block is called in each cycle of the position loop. fraexp writes the excitation into its array, and takes the
    recorded samples from another one while they come. Protocol: Beckhoff Information System, ADS, index groups and
    symbols by name.
    """

    net_id: str = param("", "AMS net id of the controller, such as 5.12.82.20.1.1")
    port: int = param("1", "AMS port of the PLC's runtime", 851, at_least=1, at_most=65535)
    host: str = param("", "IP address of the controller; empty: the first four numbers of the net id", "")
    block: str = param("", "path of the function block's instance", "MAIN.Machine")
    sample_time: float = param("s", "cycle time of the block", inherit="loop.sample_time", above=0)
    units: tuple[str, str] = param("", "units of position and control input", ("m", "N"))
    limits: dict[str, Any] = param("", "limits of the axis, by the names of [limits]", {})
    watchdog: float = param("s", "time without a sample taken after which the block stops", 0.5, above=0)
    poll: float = param("s", "time between two looks for samples", 0.01, above=0)

    def address(self, folder: Path) -> str:
        return f"{self.net_id} {self.port} {self.block.lower()}"

    def consent(self, folder: Path) -> str:
        host = f" at {self.host}" if self.host else ""
        return f"write to the PLC {self.net_id}{host}, port {self.port}, and move the axis of its block {self.block}"

    def connect(self, folder: Path) -> "AdsSession":
        try:
            pyads = import_module("pyads")
        except (ImportError, OSError):  # its library may be missing for this platform
            raise MachineError("ads needs the package pyads for this platform; pip install 'fraexp[ads]'") from None
        _silence(pyads)
        return AdsSession(self, pyads)


def _silence(pyads: Any) -> None:
    """Keep Beckhoff's library from printing between fraexp's lines: what goes wrong is an error of pyads, too.

    Its level has no function; libraries for other platforms lack it, and print nothing.
    """
    with suppress(AttributeError, ValueError):
        ctypes.c_size_t.in_dll(pyads.pyads_ex._adsDLL, LOG_LEVEL).value = SILENT_LEVEL


class AdsSession(MachineSession):
    """A connection to the block."""

    def __init__(self, machine: AdsMachine, pyads: Any) -> None:
        self._machine, self._pyads = machine, pyads
        self._symbols: dict[str, tuple[int, int]] = {}
        self._play, self._is_playing = 0, False
        try:
            self._plc = pyads.Connection(machine.net_id, machine.port, machine.host or None)
            self._plc.open()
        except (pyads.ADSError, ValueError, OSError) as error:
            raise MachineError(f"ads: no connection to {machine.net_id}, port {machine.port} ({error})") from None
        try:
            for name in SYMBOLS:
                self._symbols[name] = self._find(name)
            self._sample_time = self._numbers("SampleTime", 1)[0]
            sizes = [self._integers(name, 1)[0] for name in ("WaveSize", "RingSize")]
            self._wave_size, self._ring_size = sizes
        except BaseException:
            self._plc.close()
            raise
        if abs(self._sample_time / machine.sample_time - 1) > 1e-9:
            self._plc.close()
            raise MachineError(
                f"ads: {machine.block}.SampleTime is {self._sample_time:g} s; the study's is {machine.sample_time:g} s"
                ": let both be the cycle time of the block"
            )

    def _find(self, name: str) -> tuple[int, int]:
        """Return index group and offset of a variable of the block."""
        path = f"{self._machine.block}.{name}"
        try:
            symbol = self._plc.get_symbol(path)
        except (self._pyads.ADSError, ValueError, TypeError) as error:
            raise MachineError(
                f"ads: the PLC has no variable {path} ({error}); import {BLOCK_SOURCE} into its project, and give the "
                "path of its instance as measurement.machine.block"
            ) from None
        return int(symbol.index_group), int(symbol.index_offset)

    @property
    def description(self) -> MachineDescription:
        position, force = self._machine.units
        units = dict(zip(CHANNELS, (position, force, force), strict=True))
        return MachineDescription(units, float(self._sample_time), self._machine.limits, self._machine.watchdog)

    def play(self, request: PlayRequest) -> Iterator[Chunk]:
        with self._connection_errors():
            self._begin(request)
        try:
            taken = 0
            while True:
                with self._connection_errors():
                    rows = self._await_samples(taken)
                if not rows.shape[1]:
                    return
                yield Chunk(taken, dict(zip(CHANNELS, rows, strict=True)))
                taken += rows.shape[1]
                with self._connection_errors():
                    self._write_integer("Taken", taken)
        finally:
            self.stop()

    def _begin(self, request: PlayRequest) -> None:
        """Write the order, and let the block begin as soon as it rests."""
        size = request.waveform.size
        if size > self._wave_size:
            raise MachineError(
                f"ads: a period has {size:,} samples, and the block holds {self._wave_size:,}: lengthen Wave and "
                "WaveSize of the block, or raise the lowest frequency"
            )
        until = time.monotonic() + REST_TIMEOUT_S + self._machine.watchdog
        while (status := self._integers("Status", 4))[1] != AT_REST:
            self._wait(until, "the block does not come to rest")
        watchdog = round(self._machine.watchdog / self._sample_time)
        order = (size, request.repetitions, request.amplitude_rise, request.ramp_out, max(watchdog, 1))
        self._write_numbers("Wave", request.waveform)
        self._write_numbers("Order", np.array(order, dtype=float))
        self._write_integer("Taken", 0)
        self._play, self._is_playing = max(status[3], self._integers("Play", 1)[0]) + 1, True
        self._write_integer("Play", self._play)
        until = time.monotonic() + REST_TIMEOUT_S
        while self._integers("Status", 4)[3] != self._play:
            self._wait(until, "the block does not begin: is it called in each cycle?")

    def _await_samples(self, taken: int) -> NDArray[np.float64]:
        """Return the next samples, shape (channels, n), as soon as there are some; n = 0 at the end of the play."""
        until = time.monotonic() + self._machine.watchdog + REST_TIMEOUT_S
        while True:
            samples, state, reason, play = self._integers("Status", 4)
            if play != self._play or reason in STOP_REASONS:
                raise ConnectionLostError(f"ads: {STOP_REASONS.get(reason, 'another play has begun')}")
            if samples > taken:
                return self._record(taken, samples)
            if state == AT_REST:
                self._is_playing = False
                return np.empty((len(CHANNELS), 0))
            self._wait(until, "no samples come any more")

    def _record(self, start: int, end: int) -> NDArray[np.float64]:
        """Return samples from the block's ring, up to its end, shape (channels, n)."""
        place = start % self._ring_size
        count = min(end - start, self._ring_size - place, PACKET_NUMBERS // len(CHANNELS))
        numbers = self._numbers("Record", len(CHANNELS) * count, len(CHANNELS) * place)
        return np.array(numbers).reshape(count, len(CHANNELS)).T

    def stop(self) -> None:
        if self._is_playing:
            self._is_playing = False
            with suppress(self._pyads.ADSError):  # the watchdog stops it
                self._write_integer("Halt", self._play)

    def close(self) -> None:
        super().close()
        with suppress(self._pyads.ADSError):
            self._plc.close()

    def _wait(self, until: float, fault: str) -> None:
        if time.monotonic() > until:
            raise ConnectionLostError(f"ads: {fault}")
        time.sleep(self._machine.poll)

    def _numbers(self, name: str, count: int, first: int = 0) -> list[float]:
        group, offset = self._symbols[name]
        kind = self._pyads.PLCTYPE_LREAL * count
        return list(self._plc.read(group, offset + LREAL_SIZE * first, kind))

    def _integers(self, name: str, count: int) -> list[int]:
        group, offset = self._symbols[name]
        return list(self._plc.read(group, offset, self._pyads.PLCTYPE_DINT * count))

    def _write_numbers(self, name: str, values: NDArray[np.float64]) -> None:
        group, offset = self._symbols[name]
        for first in range(0, values.size, PACKET_NUMBERS):
            part = values[first : first + PACKET_NUMBERS].tolist()
            kind = self._pyads.PLCTYPE_LREAL * len(part)
            self._plc.write(group, offset + LREAL_SIZE * first, part, kind)

    def _write_integer(self, name: str, value: int) -> None:
        self._plc.write(*self._symbols[name], value, self._pyads.PLCTYPE_DINT)

    @contextmanager
    def _connection_errors(self) -> Iterator[None]:
        """Turn errors of the protocol into ConnectionLostError: the point is then played again."""
        try:
            yield
        except self._pyads.ADSError as error:
            raise ConnectionLostError(f"ads: {error}") from None
