"""Files as instruments, drives and programs write them, each with the command that imports it and the true response."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

RATE_HZ, PERIOD, PERIODS = 1000.0, 250, 4
LINES = np.arange(2, 60, 3)
SINUMERIK_ALPHABET = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ!#$`()*+-/:;=?@[]^_{|}~"


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


@dataclass(frozen=True)
class Layout:
    """A file of one layout."""

    kind: str
    """What writes such files."""
    files: Sequence[str]
    write: Callable[[Path], None]
    options: Sequence[str]
    """Options of the command that gives the response."""
    proposed: Sequence[str] = ()
    """What the listing proposes."""
    needs: str = ""
    """What the listing says it needs, if the file does not contain it."""
    tolerance: float = 1e-4
    extra: str = ""
    """Package that the reader needs."""
    more: dict[str, object] = field(default_factory=dict)


def lines_of(format_: str, *columns: np.ndarray, separator: str = ",", comma: bool = False, end: str = "") -> str:
    rows = (separator.join(format_ % value for value in row) + end for row in zip(*columns, strict=True))
    text = "\n".join(rows) + "\n"
    return text.replace(".", ",") if comma else text


def text_file(name: str, head: str, body: str, encoding: str = "utf-8") -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        (folder / name).write_text(head + body, encoding=encoding)

    return write


COLUMNS = lines_of("%.10g", TIME, FORCE, POSITION)
FORCE_AND_POSITION = ["--channel", "u=force", "--channel", "y=position"]
PERIODIC = ["--samples-per-period", "250"]
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


def rate_in_a_column(folder: Path) -> None:
    rows = [
        f"{u:.10g},{y:.10g},{'1000' if k == 0 else ''}" for k, (u, y) in enumerate(zip(FORCE, POSITION, strict=True))
    ]
    (folder / "a.csv").write_text("force [N],position [um],fs\n" + "\n".join(rows) + "\n", encoding="utf-8")


def text_and_flags(folder: Path) -> None:
    rows = [
        f"{t:.10g},RUN,{u:.10g},{y:.10g},{k % 2},ok"
        for k, (t, u, y) in enumerate(zip(TIME, FORCE, POSITION, strict=True))
    ]
    (folder / "a.csv").write_text("time [s],mode,force [N],position [um],enabled,remark\n" + "\n".join(rows) + "\n")


def jittered(folder: Path) -> None:
    dice = np.random.default_rng(3)
    time = (np.arange(TIME.size * 4 + 2) + dice.uniform(-0.2, 0.2, TIME.size * 4 + 2)) / 4000
    text_file("a.csv", "time [s],force [N],position [um]\n", lines_of("%.10g", time, *signals(time)))(folder)


def scope(separator: str, second_step: float = 1.0, comma: bool = False) -> Callable[[Path], None]:
    """Return a writer of a TwinCAT Scope export with a time for each channel."""

    def write(folder: Path) -> None:
        stamps = np.arange(round(TIME.size / second_step)) * second_step
        position = signals(stamps * 1e-3)[1]
        head = [
            ["Name", "axis 1"], ["File", "axis.csv"], [""],
            ["Name", "SetTorque", "Name", "ActPos"],
            ["SampleTime[ms]", "1", "SampleTime[ms]", f"{second_step:g}"],
            ["Unit", "N (Newton)", "Unit", "um (Micrometer)"], [""],
        ]  # fmt: skip
        rows = []
        for k in range(max(TIME.size, stamps.size)):
            left = [f"{1e3 * TIME[k]:.7g}", f"{FORCE[k]:.10g}"] if k < TIME.size else ["", ""]
            right = [f"{stamps[k]:.7g}", f"{position[k]:.10g}"] if k < stamps.size else ["", ""]
            rows.append([cell.replace(".", ",") if comma else cell for cell in left + right])
        text = "\n".join(separator.join(row) for row in head + rows)
        (folder / "axis.csv").write_text(text + "\nEOF\n", encoding="utf-8")

    return write


def base85(values: np.ndarray) -> str:
    """Return doubles as a Sinumerik control writes them."""
    text = ""
    for word in np.frombuffer(values.astype(">f8").tobytes(), dtype=">u4").tolist():
        digits = ""
        for power in range(5):
            digits = SINUMERIK_ALPHABET[word // 85**power % 85] + digits
        text += "." if digits == "00000" else digits
    return text


def number_array(name: str, values: np.ndarray, kind: str = "double") -> str:
    plain = values.view(float) if kind == "ComplexNumber" else values
    return (
        f'<NumericArray elementtype="{kind}" format="base85" name="{name}"><unsigned_int name="m_length">{values.size}'
        f'</unsigned_int><raw name="m_pNumberArray"><![CDATA[{base85(plain)}]]></raw></NumericArray>'
    )


def sinumerik_measurement(folder: Path) -> None:
    """Node 7 is excited, node 8 answers."""
    response = 1e6 * plant(FREQUENCY)
    spectra = {
        7: (np.ones(40, complex), "m_autospectrumInfo", 7), 8: (np.abs(response) ** 2 + 0j, "m_autospectrumInfo", 8),
    }  # fmt: skip
    text = "<ResponseTestCustom>"
    for node, (auto, name, _) in spectra.items():
        text += f'<PlatformSignalNode><unsigned_int name="m_uNodeId">{node}</unsigned_int>'
        parts = [(name, node, auto)] + ([("m_crossSpecInfoList_el", 8, response)] if node == 7 else [])
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


def hdf5_matrix(folder: Path) -> None:
    with h5py.File(folder / "a.hdf5", "w") as file:
        file["data"] = np.column_stack([FORCE, POSITION])


def uff_time(folder: Path) -> None:
    _write_uff(folder / "a.uff", [(1, TIME, FORCE, 1, "N"), (1, TIME, POSITION, 2, "um")])


def uff_response(folder: Path) -> None:
    _write_uff(folder / "a.unv", [(4, FREQUENCY, 1e6 * plant(FREQUENCY), 2, "")])


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


MAGNITUDE_DB, PHASE_DEG = 20 * np.log10(np.abs(1e6 * plant(FREQUENCY))), np.degrees(np.angle(plant(FREQUENCY)))
RESPONSE = 1e6 * plant(FREQUENCY)
BODE = [
    "--channel",
    "frequency=Frequency",
    "--channel",
    "magnitude=Magnitude",
    "--channel",
    "phase=Phase",
    "--unit",
    "um/N",
]
SWEEP_HEAD = "Model,SDS1104\nRecord Length,Analog:1000\nSample Interval,0.001\nVertical Units,V\n,,\nTIME,CH1,CH2\n"
LVM_HEAD = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\n***End_of_Header***\t\n\t\nChannels\t2\t\n"
    "Samples\t1000\t1000\nX_Dimension\tTime\tTime\n***End_of_Header***\t\t\nX_Value\tforce\tposition\tComment\n"
)
