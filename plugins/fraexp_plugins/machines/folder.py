"""A machine that takes excitations from a folder, and puts records there."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fraexp.api import (
    Chunk,
    MachineDescription,
    MachineDriver,
    MachineError,
    MachineSession,
    PlayRequest,
    param,
    workspace_path,
)

POLL_INTERVAL_S = 0.05
"""Interval at which the folder is looked into."""


class FolderMachine(MachineDriver, name="folder", version=1):
    """A folder in which files are exchanged with a controller, or with somebody who carries them to it.

    For each play ``play-0001.csv`` appears, with the excitation in the unit of `u`; it is complete as soon as it
    has that name. Then ``play-0001-record.csv`` is waited for: a header with the names of the channels, a line for each
    sample. Write it under another name, and rename it. Where the machine must be stopped, a file ``stop`` appears, and
    the play disappears.
    """

    folder: str = param("", "folder, relative to the workspace")
    sample_time: float = param("s", "sample time", inherit="loop.sample_time", above=0)
    channels: tuple[str, ...] = param("", "channels of a record", ("y", "u"))
    units: tuple[str, ...] = param("", "their units", ("m", "N"))
    timeout: float = param("s", "time for which a record is waited for", 3600.0, above=0)

    def address(self, folder: Path) -> str:
        return str((folder / self.folder).resolve())

    def connect(self, folder: Path) -> "FolderSession":
        if len(self.channels) != len(self.units):
            raise MachineError(
                f"folder has {len(self.channels)} channels and {len(self.units)} units; expected as many"
            )
        if "u" not in self.channels:
            raise MachineError(f"folder has the channels {', '.join(self.channels)}; expected y and u among them")
        place = workspace_path(folder, self.folder, "folder")
        if not place.is_dir():
            raise MachineError(f"there is no folder {place}; make it, or correct measurement.machine.folder")
        return FolderSession(self, place)


class FolderSession(MachineSession):
    """Files that are exchanged, numbered in their order."""

    def __init__(self, machine: FolderMachine, folder: Path) -> None:
        self._machine, self._folder = machine, folder
        self._stop_file, self._is_playing = folder / "stop", False
        self._stop_file.unlink(missing_ok=True)

    @property
    def description(self) -> MachineDescription:
        machine = self._machine
        units = dict(zip(machine.channels, machine.units, strict=True))
        return MachineDescription(units, machine.sample_time, watchdog=machine.timeout, is_live=False)

    def play(self, request: PlayRequest) -> Iterator[Chunk]:
        name = f"play-{self._next_number():04d}"
        draft = self._folder / f".{name}.part"
        force = request.excitation(0, request.samples)
        np.savetxt(draft, force, fmt="%.17g", header=f"excitation [{self.description.channels['u']}]", comments="")
        self._play, self._is_playing = self._folder / f"{name}.csv", True
        draft.replace(self._play)
        record = self._folder / f"{name}-record.csv"
        try:
            self._wait_for(record)
        except BaseException:
            self.stop()
            raise
        self._is_playing = False
        columns = self._columns(record)
        rows = columns["u"].size
        if rows > request.samples:
            raise MachineError(
                f"{record.name} has {rows} rows of samples, and {name}.csv {request.samples}; expected one for each: "
                "record from its first sample to its last, at its sample time"
            )
        yield Chunk(0, columns)

    def _next_number(self) -> int:
        """Return a number above those of all plays and records that are there: an old record is never a new one."""
        files = self._folder.glob("play-[0-9][0-9][0-9][0-9]*.csv")
        return 1 + max((int(file.name[5:9]) for file in files), default=0)

    def _wait_for(self, record: Path) -> None:
        """Wait for a record; MachineError after the timeout, which is none of a connection: it is not played again."""
        until = time.monotonic() + self._machine.timeout
        while not record.exists():
            if time.monotonic() > until:
                raise MachineError(
                    f"no {record.name} within {self._machine.timeout:g} s; {self._play.name} was taken back, and the "
                    "machine told to stop: see why it does not answer, or raise measurement.machine.timeout; the same "
                    "command then continues"
                )
            time.sleep(POLL_INTERVAL_S)

    def _columns(self, record: Path) -> dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]:
        with record.open(encoding="utf-8") as stream:
            names = [cell.strip() for cell in stream.readline().split(",")]
            missing = [name for name in self._machine.channels if name not in names]
            if missing:
                raise MachineError(f"{record.name}: no column is called '{missing[0]}'; found {', '.join(names)}")
            try:
                table = np.loadtxt(stream, delimiter=",", ndmin=2)
            except ValueError as error:
                raise MachineError(f"{record.name}: {error}") from None
        return {name: table[:, names.index(name)] for name in self._machine.channels}

    def stop(self) -> None:
        if self._is_playing:
            self._play.unlink(missing_ok=True)
            self._stop_file.write_text(f"{os.getpid()}\n", encoding="utf-8")
            self._is_playing = False
