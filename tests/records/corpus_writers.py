"""Files as instruments, drives and programs write them, of one machine whose response is known."""

import json
from base64 import b85encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tests.records.strangers import write_hdf5

RATE_HZ, PERIOD, PERIODS = 1000.0, 250, 4
LINES = np.arange(2, 60, 3)
SINUMERIK = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ!#$`()*+-/:;=?@[]^_{|}~"
STANDARD = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%&()*+-;<=>?@^_`{|}~"
TO_STANDARD, TO_SINUMERIK = str.maketrans(SINUMERIK, STANDARD), str.maketrans(STANDARD, SINUMERIK)
"""Base 85 of the control, and of the standard library."""


def plant(frequency: np.ndarray) -> np.ndarray:
    """Return the response of a spring and a damped mass behind a dead time [m/N]."""
    ratio = frequency / 90.0
    return 2e-6 / (1 - ratio**2 + 0.2j * ratio) * np.exp(-2j * np.pi * frequency * 1e-3)


def signals(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the force [N] and the position [um] at any instants [s]."""
    frequency = LINES * RATE_HZ / PERIOD
    phases = np.random.default_rng(7).uniform(0, 2 * np.pi, LINES.size)
    turning = np.exp(2j * np.pi * np.outer(time, frequency) + 1j * phases)
    return turning.real.sum(axis=1), 1e6 * (turning * plant(frequency)).real.sum(axis=1)


TIME = np.arange(PERIOD * PERIODS) / RATE_HZ
FORCE, POSITION = signals(TIME)
FREQUENCY = np.geomspace(2, 200, 40)
RESPONSE = 1e6 * plant(FREQUENCY)
MAGNITUDE_DB, PHASE_DEG = 20 * np.log10(np.abs(RESPONSE)), np.degrees(np.angle(RESPONSE))
"""Of the response [um/N]."""


@dataclass(frozen=True)
class Layout:
    """A file of one layout."""

    files: Sequence[str]
    write: Callable[[Path], None]
    proposed: Sequence[str]
    """What the listing proposes."""
    needs: str = ""
    """What the listing says it needs, if the file does not contain it."""
    options: Sequence[str] = ()
    """Options of the command that gives the response, where the proposal does not."""
    tolerance: float = 1e-4
    extra: str = ""
    """Package that the reader needs."""


def lines_of(format_: str, *columns: np.ndarray, separator: str = ",", comma: bool = False, end: str = "") -> str:
    rows = (separator.join(format_ % value for value in row) + end for row in zip(*columns, strict=True))
    text = "\n".join(rows) + "\n"
    return text.replace(".", ",") if comma else text


def filled(template: str) -> str:
    """Return a line per sample with number k, time t [s], nanoseconds ns, date m, force u [N] and position y [um]."""
    start = datetime(2024, 3, 4, 11, 59, 59, 500_000)  # the record passes noon
    return "".join(
        template.format(
            k=k, t=t, ns=1_709_547_133_000_000_000 + 1_000_000 * k, m=start + timedelta(milliseconds=k), u=u, y=y
        )
        for k, (t, u, y) in enumerate(zip(TIME, FORCE, POSITION, strict=True))
    )


def text_file(name: str, head: str, body: str, encoding: str = "utf-8") -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        (folder / name).write_bytes((head + body).encode(encoding))

    return write


def text(head: str, body: str, *proposed: str, encoding: str = "utf-8", **more: Any) -> Layout:
    """Return the layout of a text file."""
    return Layout(["a.csv"], text_file("a.csv", head, body, encoding), proposed, **more)


def named(u: str, y: str, *more: str) -> list[str]:
    """Return the options that import two columns with 250 samples per period."""
    return ["--channel", f"u={u}", "--channel", f"y={y}", *more, "--samples-per-period", "250"]


def response(frequency: str, **parts: str) -> list[str]:
    """Return the options that import a response [um/N]."""
    columns = {"frequency": frequency, **parts}
    return [*(word for name, column in columns.items() for word in ("--channel", f"{name}={column}")), "--unit", "um/N"]


COLUMNS = lines_of("%.10g", TIME, FORCE, POSITION)
PROPOSED = ("--channel u=force", "--channel y=position", "--samples-per-period 250")


def padded_side_by_side(folder: Path) -> None:
    """Two recorders with clocks of their own: the shorter columns end before the others."""
    fast = np.arange(4000) / 4000
    force, position = signals(fast)[0], signals(TIME)[1]
    rows = [
        f"{fast[k]:.10g};{force[k]:.10g};" + (f"{TIME[k]:.10g};{position[k]:.10g}" if k < TIME.size else ";")
        for k in range(fast.size)
    ]
    (folder / "a.csv").write_text("t1 [s];force [N];t2 [s];position [um]\n" + "\n".join(rows) + "\n", encoding="utf-8")


def settings_beside_samples(folder: Path) -> None:
    """An oscilloscope that writes its settings into the first columns of the first rows, and no headings."""
    settings = (
        "Record Length,1.000000e+03", "Sample Interval,1.000000e-03", "Trigger Point,5.0e+02", ",", ",", "Source,CH1",
        "Vertical Units,V", "Vertical Scale,5.0", "Horizontal Units,s", "Horizontal Scale,2.5e-4", "Probe Atten,1",
    )  # fmt: skip
    lines = filled(",,{t:.10g},{u:.10g},{y:.10g},\n").splitlines()
    text = [(settings[k] if k < len(settings) else ",") + line for k, line in enumerate(lines)]
    (folder / "a.csv").write_text("\n".join(text) + "\n", encoding="utf-8")


def jittered(folder: Path) -> None:
    dice = np.random.default_rng(3)
    time = (np.arange(TIME.size * 4 + 2) + dice.uniform(-0.2, 0.2, TIME.size * 4 + 2)) / 4000
    text_file("a.csv", "time [s],force [N],position [um]\n", lines_of("%.10g", time, *signals(time)))(folder)


def twincat_export(
    channels: Mapping[str, tuple[str, float, Sequence[float] | np.ndarray]],
    delimiter: str = "\t", shared: bool = False, point: str = ".", end: bool = True, quoted: bool = False,
) -> str:  # fmt: skip
    """Return an export of TwinCAT 3 Scope, of channels: unit, step [ms], values; those of 1 ms may share a time."""
    columns = []
    for number, (name, (unit, step, values)) in enumerate(channels.items()):
        if not shared or number == 0 or step != 1.0:
            columns.append(["Name", "SampleTime[ms]", "Unit", [f"{k * step:.10g}" for k in range(len(values))]])
        columns.append([name, f"{step:g}", unit, [f"{value:.10g}" for value in values]])
    length = max(len(column[3]) for column in columns)
    cells = [[column[3][k] if k < len(column[3]) else "" for column in columns] for k in range(length)]
    properties = [[column[row] for column in columns] for row in range(3)]
    decimal = [[cell.replace(".", point) for cell in row] for row in (properties[1], *cells)]
    rows = [["Name", "axis 3"], ["File", "a.csv"], [], properties[0], decimal[0], properties[2], [], *decimal[1:]]
    lines = [delimiter.join(f'"{cell}"' if quoted and cell else cell for cell in row) for row in rows]
    return "\n".join([*lines, *(["EOF"] if end else [])]) + "\n"


def scope(second_step: float = 1.0) -> Callable[[Path], None]:
    """Return a writer of a TwinCAT Scope export whose second channel has a step of its own [ms]."""
    position = signals(np.arange(round(TIME.size / second_step)) * second_step * 1e-3)[1]
    text = twincat_export(
        {"SetTorque": ("N (Newton)", 1.0, FORCE), "ActPos": ("um (Micrometer)", second_step, position)}
    )
    return text_file("axis.csv", "", text)


def base85(values: np.ndarray) -> str:
    """Return doubles as a Sinumerik control writes them."""
    standard = b85encode(values.astype(">f8").tobytes()).decode().translate(TO_SINUMERIK)
    groups = (standard[at : at + 5] for at in range(0, len(standard), 5))
    return "".join("." if group == "00000" else group for group in groups)


def number_array(name: str, values: np.ndarray, kind: str = "double") -> str:
    plain = values.view(float) if kind == "ComplexNumber" else values
    return (
        f'<NumericArray elementtype="{kind}" format="base85" name="{name}"><unsigned_int name="m_length">{values.size}'
        f'</unsigned_int><raw name="m_pNumberArray"><![CDATA[{base85(plain)}]]></raw></NumericArray>'
    )


def sinumerik_measurement(folder: Path) -> None:
    """Node 7 is excited, node 8 answers."""
    spectra = {
        7: (np.ones(40, complex), "m_autospectrumInfo", 7), 8: (np.abs(RESPONSE) ** 2 + 0j, "m_autospectrumInfo", 8),
    }  # fmt: skip
    text = "<ResponseTestCustom>"
    for node, (auto, name, _) in spectra.items():
        text += f'<PlatformSignalNode><unsigned_int name="m_uNodeId">{node}</unsigned_int>'
        parts = [(name, node, auto)] + ([("m_crossSpecInfoList_el", 8, RESPONSE)] if node == 7 else [])
        for part, other, spectrum in parts:
            text += f'<SigNodeCrossSpectrumInfo name="{part}"><unsigned_int name="m_uSignodeId">{other}</unsigned_int>'
            text += number_array("m_ValueVector", spectrum, "ComplexNumber")
            text += number_array("m_FrequencyVector", FREQUENCY) + "</SigNodeCrossSpectrumInfo>"
        text += "</PlatformSignalNode>"
    (folder / "a.xml").write_text(text + "</ResponseTestCustom>", encoding="latin-1")


def sinumerik_trace(folder: Path) -> None:
    rows = "".join(
        f'<rec time="{t:.6f}" f1="{u:.10g}" f2="{y:.10g}"/>' for t, u, y in zip(TIME, FORCE, POSITION, strict=True)
    )
    head = '<dataSignal id="f1" description="Torque setpoint"/><dataSignal id="f2" description="Encoder position"/>'
    text = f"<traceData><dataFrame><frameHeader>{head}</frameHeader>{rows}</dataFrame></traceData>"
    (folder / "a.xml").write_text(text, encoding="utf-8")


def hdf5(folder: Path) -> None:
    with h5py.File(folder / "a.h5", "w") as file:
        group = file.create_group("measurement")
        group.attrs["sample_rate"] = RATE_HZ
        for name, values, unit in (("force", FORCE, "N"), ("position", POSITION, "um")):
            group.create_dataset(name, data=values).attrs["unit"] = unit


def uff_time(folder: Path) -> None:
    _write_uff(folder / "a.uff", [(1, TIME, FORCE, 1, "N"), (1, TIME, POSITION, 2, "um")])


def uff_response(folder: Path) -> None:
    _write_uff(folder / "a.unv", [(4, FREQUENCY, RESPONSE, 2, "")])


def _write_uff(path: Path, functions: list[tuple[int, np.ndarray, np.ndarray, int, str]]) -> None:
    import pyuff

    for kind, x, data, node, unit in functions:
        one = pyuff.prepare_58(
            binary=0, func_type=kind, rsp_node=node, rsp_dir=3, ref_dir=3, ref_node=1, data=data, x=x,
            id1="a", rsp_ent_name="a", ref_ent_name="a", abscissa_spacing=int(kind == 1),
            abscissa_spec_data_type=17 if kind == 1 else 18,
            ordinate_spec_data_type=8, ordinate_axis_units_lab=unit or "NONE",
            orddenom_spec_data_type=0, abscissa_min=x[0], abscissa_inc=x[1] - x[0],
        )  # fmt: skip
        pyuff.UFF(str(path)).write_sets([one], "add")


def tdms(folder: Path) -> None:
    from nptdms import ChannelObject, RootObject, TdmsWriter

    with TdmsWriter(folder / "a.tdms") as file:
        file.write_segment(
            [
                RootObject(properties={"rig": "bench"}),
                *(
                    ChannelObject("run", name, values, {"wf_increment": 1 / RATE_HZ, "unit_string": unit})
                    for name, values, unit in (("force", FORCE, "N"), ("position", POSITION, "um"))
                ),
            ]
        )


def mdf(folder: Path) -> None:
    from asammdf import MDF, Signal

    fast = np.arange(4000) / 4000
    with MDF() as file:
        file.append([Signal(signals(fast)[0], fast, name="force", unit="N")])
        file.append([Signal(POSITION, TIME, name="position", unit="um")])
        file.save(folder / "a.mf4")


def mcap(folder: Path) -> None:
    from mcap.writer import Writer

    with (folder / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("joint", "jsonschema", b"{}")
        channel = writer.register_channel("/joint", "json", schema)
        for t, u, y in zip(TIME, FORCE, POSITION, strict=True):
            stamp = round(1e9 * t) + 1_700_000_000_000_000_000
            data = json.dumps({"name": "a", "effort": [u], "position": [1e-6 * y]}).encode()
            writer.add_message(channel, log_time=stamp, data=data, publish_time=stamp)
        writer.finish()


def mcap_of_ros(folder: Path) -> None:
    """Joint states as ROS 2 logs them."""
    from mcap_ros2.writer import Writer

    definition = "string[] name\nfloat64[] position\nfloat64[] effort\n"
    with (folder / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        schema = writer.register_msgdef("bench/msg/JointState", definition)
        for t, u, y in zip(TIME, FORCE, POSITION, strict=True):
            stamp = round(1e9 * t) + 1_700_000_000_000_000_000
            message = {"name": ["a"], "position": [1e-6 * y], "effort": [u]}
            writer.write_message("/joint_states", schema, message, log_time=stamp, publish_time=stamp)
        writer.finish()


def mcap_of_protobuf(folder: Path) -> None:
    """A message within a message, with a repeated field."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap_protobuf.writer import Writer

    file = descriptor_pb2.FileDescriptorProto(name="bench.proto", package="bench", syntax="proto3")
    state, axis = file.message_type.add(name="State"), file.message_type.add(name="Axis")
    axis.field.add(name="force", number=1, type=1, label=1)
    axis.field.add(name="position", number=2, type=1, label=3)
    state.field.add(name="axis", number=1, type=11, label=1, type_name=".bench.Axis")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName("bench.State"))
    with (folder / "a.mcap").open("wb") as stream, Writer(stream) as writer:
        for t, u, y in zip(TIME, FORCE, POSITION, strict=True):
            stamp = round(1e9 * t) + 1_700_000_000_000_000_000
            message = kind(axis={"force": u, "position": [1e-6 * y]})
            writer.write_message(topic="/bench", message=message, log_time=stamp, publish_time=stamp)


def parquet(folder: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    stamps = np.datetime64("2026-01-01T12:00:00", "us") + np.rint(1e6 * TIME).astype("timedelta64[us]")
    table = pa.table({"timestamp": stamps, "force [N]": FORCE, "position [um]": POSITION, "remark": ["x"] * TIME.size})
    pq.write_table(table, folder / "a.parquet")


def joined(folder: Path) -> None:
    """Two instruments; one began 40 ms later."""
    late = TIME[:900] + 0.04
    text_file("force.csv", "time [s],force [N]\n", lines_of("%.10g", TIME, FORCE))(folder)
    text_file("laser.csv", "time [s];position [um]\n", lines_of("%.10g", late, signals(late)[1], separator=";"))(folder)


def frd_in_hdf5(folder: Path) -> None:
    """MATLAB 7.3 stores a complex array as pairs, transposed."""
    pairs = np.empty((FREQUENCY.size, 1, 1), dtype=[("real", "f8"), ("imag", "f8")])
    pairs["real"], pairs["imag"] = RESPONSE.real[:, None, None], RESPONSE.imag[:, None, None]
    write_hdf5(folder / "a.mat", {"freq": FREQUENCY[:, None], "resp": pairs.T})
