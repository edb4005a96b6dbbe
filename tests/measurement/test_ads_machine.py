"""The machine 'ads' against the test server of pyads, behind which the PLC's function block runs, translated to Python.

The axis is a mass with viscous friction and a controller, whose response is known in closed form.
"""

import re
import socket
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fraexp_plugins.machines.ads import BLOCK_SOURCE, AdsMachine, AdsSession

from fraexp.components.machine_session import PlayRequest
from fraexp.errors import ConnectionLostError, MachineError
from fraexp.workspace.measurement_service import MeasurementService
from fraexp.workspace.workspace_service import WorkspaceService
from tests.measurement.test_excitation_files import StructuredText
from tests.refusals import refused
from tests.waiting import wait_until

try:
    from pyads.testserver import handler, testserver
except (ImportError, OSError) as error:  # not installed, or its library is not made for this platform
    pytest.skip(f"pyads cannot be used here ({error}); pip install 'fraexp[ads]'", allow_module_level=True)

NET_ID, SAMPLE_TIME = "127.0.0.1.1.1", 0.5e-3
GROUP, NAME_INFO = 0x4040, 0xF009
"""Index groups: of the PLC's variables, and of the information on a variable by its name."""
CYCLES_PER_REQUEST = 23
"""Cycles of the PLC between two requests: its time goes on with those, and with nothing else."""
MASS, VISCOUS, STIFFNESS, DAMPING = 7.5, 60.0, 20_000.0, 400.0
"""Axis [kg, N s/m] and controller [N/m, N s/m]."""


class FunctionBlock(StructuredText):
    """FB_FraexpMachine with the arrays that it declares."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.values |= {"LREAL_TO_DINT": int}
        for name, last, kind in re.findall(r"(\w+) : ARRAY\[0\.\.(\d+)\] OF (\w+);", text):
            self.values[name] = [0.0 if kind == "LREAL" else 0] * (int(last) + 1)

    def cycle(self, position: float, feedback: float) -> float:
        self.values |= {"Position": position, "Feedback": feedback}
        exec(self.code, {}, self.values)
        return float(self.values["ControlInput"])


class ControllerHandler(handler.AbstractHandler):
    """The PLC: variables at addresses, and a position loop that calls the block."""

    def __init__(self) -> None:
        self.block = FunctionBlock(BLOCK_SOURCE.read_text(encoding="utf-8"))
        self.offsets: dict[str, int] = {}
        self.position = self.velocity = 0.0
        self.forces: list[float] = []
        self.is_running = True
        self.fails = 0
        """Requests that are answered with an error."""
        offset = 1000
        for name in (
            "SampleTime",
            "WaveSize",
            "RingSize",
            "Wave",
            "Order",
            "Play",
            "Halt",
            "Taken",
            "Status",
            "Record",
        ):
            value = self.block.values[name]
            self.offsets[name] = offset
            offset += 8 * (len(value) if isinstance(value, list) else 1)

    def cycle(self) -> None:
        feedback = -STIFFNESS * self.position - DAMPING * self.velocity
        force = self.block.cycle(self.position, feedback)
        self.forces.append(float(self.block.values["Force"]))
        self.velocity += SAMPLE_TIME * (force - VISCOUS * self.velocity) / MASS
        self.position += SAMPLE_TIME * self.velocity

    def handle_request(self, request: Any) -> Any:
        for _ in range(CYCLES_PER_REQUEST if self.is_running else 0):
            self.cycle()
        header = request.ams_header
        command = struct.unpack("<H", header.command_id)[0]
        state = struct.pack("<H", struct.unpack("<H", header.state_flags)[0] | 1)
        self.fails -= self.fails > 0
        if self.fails:
            return testserver.AmsResponseData(state, struct.pack("<I", 0), struct.pack("<II", 0x745, 0))
        content = self.answer(command, header.data)
        if content is None:
            return testserver.AmsResponseData(state, struct.pack("<I", 0), struct.pack("<II", 0x710, 0))
        return testserver.AmsResponseData(state, header.error_code, bytes(4) + content)

    def answer(self, command: int, data: bytes) -> bytes | None:
        """Return the content of a response; None if there is no such variable."""
        group, offset, length = struct.unpack("<III", data[:12])
        if command == 2:
            values = self.memory(offset, length)
            return struct.pack("<I", len(values)) + values
        if command == 3:
            self.store(offset, data[12 : 12 + length])
            return b""
        assert (command, group) == (9, NAME_INFO)
        (written,) = struct.unpack("<I", data[12:16])
        path = data[16 : 16 + written].decode().strip("\0")
        prefix, _, name = path.rpartition(".")
        if prefix != "MAIN.Machine" or name not in self.offsets:
            return None
        kind = "LREAL" if isinstance(self.flat(name)[0], float) else "DINT"
        texts = path.encode() + b"\0" + kind.encode() + b"\0" + b"\0"
        size = len(self.flat(name)) * (8 if kind == "LREAL" else 4)
        info = struct.pack(
            "<IIIIIIHHH", 30 + len(texts), GROUP, self.offsets[name], size, 5, 0, len(path), len(kind), 0
        )
        return struct.pack("<I", len(info + texts)) + info + texts

    def flat(self, name: str) -> list[Any]:
        value = self.block.values[name]
        return value if isinstance(value, list) else [value]

    def place(self, offset: int) -> tuple[str, str, int]:
        """Return name, format and index of a variable at an address."""
        name = max((of for of in self.offsets if self.offsets[of] <= offset), key=self.offsets.__getitem__)
        code, size = ("d", 8) if isinstance(self.flat(name)[0], float) else ("i", 4)
        return name, code, (offset - self.offsets[name]) // size

    def memory(self, offset: int, length: int) -> bytes:
        name, code, first = self.place(offset)
        count = length // struct.calcsize(code)
        values = self.flat(name)[first : first + count]
        assert len(values) == count, f"{name} is read beyond its end"
        return struct.pack(f"<{count}{code}", *values)

    def store(self, offset: int, data: bytes) -> None:
        name, code, first = self.place(offset)
        values = struct.unpack(f"<{len(data) // struct.calcsize(code)}{code}", data)
        if not isinstance(self.block.values[name], list):
            (self.block.values[name],) = values
            return
        assert first + len(values) <= len(self.block.values[name]), f"{name} is written beyond its end"
        self.block.values[name][first : first + len(values)] = values


class Switchboard(handler.AbstractHandler):
    """Passes requests on to the PLC of the test that runs."""

    plc: ControllerHandler

    def handle_request(self, request: Any) -> Any:
        return self.plc.handle_request(request)


@pytest.fixture(scope="module")
def switchboard() -> Iterator[Switchboard]:
    """A server at this computer's ADS port, of which there is one."""
    found = Switchboard()
    if is_listening():
        pytest.skip("another program has the ADS port 48898 of this computer")
    with testserver.AdsTestServer(found, logging=False):
        wait_until(is_listening)
        yield found


@pytest.fixture
def plc(switchboard: Switchboard) -> ControllerHandler:
    """A PLC that has just been switched on."""
    switchboard.plc = ControllerHandler()
    return switchboard.plc


def is_listening() -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", testserver.ADS_PORT)) == 0


def connect(**settings: Any) -> AdsSession:
    """Return a session; skip where the library of pyads does not reach the server of this computer."""
    machine = AdsMachine(net_id=NET_ID, host="127.0.0.1", **{"sample_time": SAMPLE_TIME, "poll": 1e-4, **settings})
    return machine.connect(Path())


def play(session: AdsSession, request: PlayRequest, use: Callable[[int], None] = lambda _: None) -> np.ndarray:
    """Return what is recorded, shape (channels, n); `use` is called with the samples after each chunk."""
    parts, count = [], 0
    for chunk in session.play(request):
        assert chunk.start == count
        count += chunk.size
        parts.append(np.array([chunk.channels[name] for name in ("y", "u", "excitation")]))
        use(count)
    return np.hstack(parts)


def test_the_library_prints_nothing(plc: ControllerHandler, capfd: pytest.CaptureFixture[str]) -> None:
    """It says when a connection ends, for one."""
    with connect():
        pass
    assert capfd.readouterr() == ("", "")


def request_of(repetitions: int = 5, size: int = 1000) -> PlayRequest:
    wave = 30 * np.sin(2 * np.pi * 10 * np.arange(size) / size) + 0.1
    return PlayRequest(0, wave, repetitions, amplitude_rise=1 / 300, ramp_out=200)


def test_the_block_plays_the_request_and_its_record_is_whole(plc: ControllerHandler) -> None:
    with connect() as session:
        for repetitions in (5, 9):  # more than the ring holds
            request = request_of(repetitions)
            _, u, excitation = play(session, request)
            expected = request.excitation(0, request.samples)
            np.testing.assert_allclose(excitation, expected, rtol=1e-14, atol=1e-12)
            assert u.size == request.samples
    played = np.array(plc.forces)
    first = int(np.flatnonzero(played)[0])
    np.testing.assert_array_equal(played[first : first + 100], expected[:101][expected[:101] != 0][:100])


def test_stop_lets_the_excitation_fall_and_the_next_play_begins_from_rest(plc: ControllerHandler) -> None:
    request = request_of(repetitions=50)
    with connect() as session:
        _, _, excitation = play(session, request, lambda count: session.stop() if count > 1500 else None)
        stop = excitation.size - request.ramp_out
        assert 1500 < stop < 4000
        np.testing.assert_allclose(excitation, request.excitation(0, excitation.size, stop), rtol=1e-14, atol=1e-12)
        again = play(session, request_of(1))
        assert again.shape[1] == 1200


def test_the_block_stops_by_itself_if_nobody_takes_its_samples(plc: ControllerHandler) -> None:
    request = request_of(repetitions=50)
    with connect(watchdog=0.1) as session:
        chunks = session.play(request)
        first = next(chunks)
        for _ in range(3000):
            plc.cycle()
        status, ramp, watchdog = plc.block.values["Status"], request.ramp_out, round(0.1 / SAMPLE_TIME)
        assert (status[1], status[2]) == (0, 2)
        assert first.size < status[0] <= first.size + watchdog + ramp + 4 * CYCLES_PER_REQUEST
        assert plc.forces[-1] == 0.0
        with refused(ConnectionLostError, "ads", "watchdog"):
            next(chunks)
        assert play(session, request_of(1)).shape[1] == 1200


def test_samples_that_are_taken_too_slowly_stop_it(plc: ControllerHandler) -> None:
    request = request_of(repetitions=50)
    with connect(watchdog=10.0) as session:
        chunks = session.play(request)
        next(chunks)
        for _ in range(6000):
            plc.cycle()
        with refused(ConnectionLostError, "ads", "Record", "RingSize"):
            list(chunks)


def test_the_block_states_the_lengths_of_its_arrays() -> None:
    values = FunctionBlock(BLOCK_SOURCE.read_text(encoding="utf-8")).values
    assert (len(values["Wave"]), len(values["Record"])) == (values["WaveSize"], 3 * values["RingSize"])
    assert (len(values["Order"]), len(values["Status"])) == (5, 4)


def test_what_does_not_fit_is_refused_before_anything_moves(plc: ControllerHandler) -> None:
    with connect() as session, refused(MachineError, "30,000 samples", "20,000", "Wave", "WaveSize"):
        next(session.play(request_of(size=30_000)))
    with refused(MachineError, "MAIN.Machine.SampleTime", "0.0005 s", "0.001 s"):
        connect(sample_time=1e-3)
    with refused(MachineError, "GVL.Other.SampleTime", "FB_FraexpMachine.st", "measurement.machine.block"):
        connect(block="GVL.Other")
    assert set(plc.forces) == {0.0}


def test_a_request_that_fails_is_a_lost_connection(plc: ControllerHandler) -> None:
    with connect() as session:
        chunks = session.play(request_of(repetitions=50))
        next(chunks)
        plc.fails = 3
        with refused(ConnectionLostError, "ads", "ADSError"):
            list(chunks)


STUDY = """
title = "An axis with a PLC"
plant = { name = "modal", rigid_body_gain = 0.13333, frequencies = [], damping_ratios = [], modal_gain_ratios = [] }
friction = { name = "none", viscous_coefficient = 60.0 }
controller = { name = "pid", proportional = 20000.0, derivative_time = 0.02, filter_time = 0.001 }
loop = { sample_time = 500e-6 }
excitation = { name = "stepped_sine", frequencies = [10.0, 40.0], amplitude = 20, recorded_periods = 4 }
estimator = { name = "conventional" }

[limits]
stroke = "20 mm"
velocity = "0.5 m/s"
force = 150

[measurement]
machine = { name = "ads", net_id = "127.0.0.1.1.1", host = "127.0.0.1", poll = 1e-4 }
"""


@pytest.mark.thorough
def test_a_study_is_measured_on_the_plc(plc: ControllerHandler, tmp_path: Path) -> None:
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "axis.toml").write_text(STUDY, encoding="utf-8")
    workspace = WorkspaceService.open(tmp_path)
    for _ in MeasurementService(workspace, "axis", is_trusted=True).measure():
        pass
    with workspace.open_store() as store:
        (sweep,) = store.sweeps(store.runs()[0].number)
        response = store.results([sweep.key])[sweep.key].response
    assert response is not None and response.settled.all()
    z = np.exp(2j * np.pi * response.frequency * SAMPLE_TIME)
    velocity = SAMPLE_TIME / MASS / (z - 1 + SAMPLE_TIME * VISCOUS / MASS)
    expected = SAMPLE_TIME * z * velocity / (z - 1)
    np.testing.assert_allclose(response.response, expected, rtol=1e-9)
