"""A program of the user's own that plays an excitation and prints what is recorded."""

import os
import selectors
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO

import numpy as np

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

EXCITATION_MARK = "{file}"
"""What stands in the command for the file with the excitation."""
CHUNK_SAMPLES = 200
"""Samples of a chunk."""
READ_BYTES = 1 << 16
"""Maximum bytes per read of what the program prints."""
SILENCE_S = 0.25
"""Time without a line after which a program has printed all: one that goes on has been at its end for that long."""
MAX_ERROR_LETTERS = 200
"""Letters of what a program that failed has said last."""
TERMINATION_TIMEOUT_S = 5.0
"""Time that the program has to bring the machine to rest after it was asked to."""


class CommandMachine(MachineDriver, name="command", version=1):
    """A program that is started for each play, such as ``program = ["./measure.sh", "{file}"]``.

    It gets the excitation in the unit of `u` as text, one sample a line: from the file whose name stands in place of
    ``{file}``, or from standard input. It prints a line for each sample, with the channels' values separated by commas,
    and nothing else: one line more would shift all rows. Then it ends.
    At SIGTERM, and where its output is closed, it must bring the machine to rest: that is all that is left of fraexp
    when fraexp dies. How many samples it gets is known before: a play cannot be ended early because it is good enough.
    A program that ends too early with another exit code than 0 has failed: the measurement ends with the last line of
    its standard error. With exit code 0 the connection to the machine counts as lost, and the play is repeated.
    """

    program: tuple[str, ...] = param("", "program and its arguments, relative to the workspace")
    sample_time: float = param("s", "sample time", inherit="loop.sample_time", above=0)
    channels: tuple[str, ...] = param("", "channels that it prints, in their order", ("y", "u"))
    units: tuple[str, ...] = param("", "their units", ("m", "N"))
    timeout: float = param("s", "time without a line after which the machine counts as lost", 10.0, above=0)

    def address(self, folder: Path) -> str:
        return f"{folder.resolve()} {' '.join(self.program)}"

    def consent(self, folder: Path) -> str:
        words = [self.program_path(folder) or "", *self.program[1:]]
        return f"run {shlex.join(words)} in {folder.resolve()}" if self.program else ""

    def program_path(self, folder: Path) -> str | None:
        """Return the file that is run: one of the workspace, else one on the PATH; None if there is none."""
        local = folder.resolve() / self.program[0]
        return str(local) if local.is_file() else shutil.which(self.program[0])

    def connect(self, folder: Path) -> "CommandSession":
        if len(self.channels) != len(self.units) or not self.program:
            raise MachineError(
                f"command has {len(self.channels)} channels, {len(self.units)} units and {len(self.program)} words of "
                "a program; expected a program, and a unit for each channel"
            )
        if self.program_path(folder) is None:
            raise MachineError(
                f"command: there is no program '{self.program[0]}'; expected one in {folder} or on the PATH"
            )
        return CommandSession(self, folder)


class CommandSession(MachineSession):
    """One process for each play."""

    def __init__(self, machine: CommandMachine, folder: Path) -> None:
        self._machine, self._folder = machine, folder
        self._process: subprocess.Popen[bytes] | None = None
        self._patience = machine.timeout

    @property
    def description(self) -> MachineDescription:
        machine = self._machine
        units = dict(zip(machine.channels, machine.units, strict=True))
        return MachineDescription(units, machine.sample_time, watchdog=machine.timeout, is_live=False)

    def play(self, request: PlayRequest) -> Iterator[Chunk]:
        lines = [f"{sample!r}\n" for sample in request.excitation(0, request.samples).tolist()]
        with tempfile.TemporaryDirectory() as spare:
            excitation, errors = Path(spare) / "excitation.txt", Path(spare) / "errors.txt"
            excitation.write_text("".join(lines), encoding="utf-8")
            with excitation.open(encoding="utf-8") as source, errors.open("wb") as error_file:
                self._process = self._start(excitation, source, error_file)
                try:
                    yield from self._chunks(request.samples, errors)
                finally:
                    self.stop()

    def _start(self, excitation: Path, source: IO[str], errors: IO[bytes]) -> subprocess.Popen[bytes]:
        words = [word.replace(EXCITATION_MARK, str(excitation)) for word in self._machine.program]
        words[0] = self._machine.program_path(self._folder) or words[0]
        is_file = any(EXCITATION_MARK in word for word in self._machine.program)
        return subprocess.Popen(
            words,
            cwd=self._folder,
            stdin=subprocess.DEVNULL if is_file else source,
            stdout=subprocess.PIPE,
            stderr=errors,
            start_new_session=True,
        )

    def _chunks(self, samples: int, errors: Path) -> Iterator[Chunk]:
        process = self._process
        assert process is not None and process.stdout is not None
        start, rows, self._patience = 0, list[list[float]](), self._machine.timeout
        lines = self._lines(process.stdout.fileno())
        for number, line in enumerate(lines, start=1):
            rows.append(self._values(line, number))
            if len(rows) == CHUNK_SAMPLES or start + len(rows) == samples:
                yield Chunk(start, dict(zip(self._machine.channels, np.array(rows).T, strict=True)))
                start, rows = start + len(rows), []
            if self._process is not process:
                return  # stopped by whoever took the chunk: the output is closed
            if start == samples:
                return self._check_end(lines, samples)
        code, said = process.wait(), errors.read_text(encoding="utf-8", errors="replace").split("\n")
        ended = f"{self._machine.program[0]} ended with exit code {code} after {start + len(rows)} of {samples} samples"
        if code == 0:
            raise ConnectionLostError(ended)
        last = next((line.strip()[:MAX_ERROR_LETTERS] for line in reversed(said) if line.strip()), "")
        raise MachineError(f"{ended}{f': {last}' if last else ''}; fix the program, or run it manually")

    def _check_end(self, lines: Iterator[str], samples: int) -> None:
        """Raise MachineError if lines follow those of all samples: which of them is no sample is not known."""
        more, self._patience = "", min(self._machine.timeout, SILENCE_S)
        with suppress(ConnectionLostError):  # it goes on in silence, until it is told to end
            more = next((line for line in lines if line.strip()), "")
        if more:
            raise MachineError(
                f"{self._machine.program[0]}, line {samples + 1}: '{more.strip()[:60]}', after a line for each of the "
                f"{samples} samples; expected no other lines, such as a header, as they shift all rows: print them to "
                "standard error"
            )

    def _lines(self, pipe: int) -> Iterator[str]:
        """Yield the lines that the program prints; ConnectionLostError if nothing comes for as long as the timeout."""
        begun = b""
        with selectors.DefaultSelector() as selector:
            if os.name == "posix":  # elsewhere a pipe cannot be waited for
                selector.register(pipe, selectors.EVENT_READ)
            while True:
                if selector.get_map() and not selector.select(self._patience):
                    raise ConnectionLostError(
                        f"{self._machine.program[0]} printed nothing for {self._patience:g} s (timeout)"
                    )
                printed = os.read(pipe, READ_BYTES)
                *lines, begun = (begun + printed).split(b"\n")
                yield from (line.decode(errors="replace") for line in lines)
                if not printed:
                    break
        if begun:
            yield begun.decode(errors="replace")

    def _values(self, line: str, number: int) -> list[float]:
        try:
            values = [float(cell) for cell in line.split(",")]
        except ValueError:
            values = []
        if len(values) != len(self._machine.channels):
            expected = ",".join(self._machine.channels)
            raise MachineError(
                f"{self._machine.program[0]}, line {number}: '{line.strip()[:60]}'; expected numbers for {expected}"
            )
        return values

    def stop(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        if process.stdout:
            process.stdout.close()
        if process.poll() is None:
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(TERMINATION_TIMEOUT_S)
        if process.poll() is None:
            process.kill()
            process.wait()
