"""Files as instruments, drives and programs write them, each with the command that imports it and the true response."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

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

LAYOUTS = {
    "comma": Layout(
        "logger",
        ["a.csv"],
        text_file("a.csv", "time [s],force [N],position [um]\n", COLUMNS),
        [*FORCE_AND_POSITION, *PERIODIC],
        PROPOSED,
    ),
    "decimal comma": Layout(
        "spreadsheet",
        ["a.csv"],
        text_file(
            "a.csv",
            "Zeit [s];Kraft [N];Weg [um]\n",
            lines_of("%.10g", TIME, FORCE, POSITION, separator=";", comma=True),
        ),
        ["--channel", "u=Kraft", "--channel", "y=Weg", *PERIODIC],
        ("u=Kraft", "y=Weg", "--time Zeit"),
    ),
    "tab": Layout(
        "spreadsheet",
        ["a.tsv"],
        text_file(
            "a.tsv", "time [s]\tforce [N]\tposition [um]\n", lines_of("%.10g", TIME, FORCE, POSITION, separator="\t")
        ),
        [*FORCE_AND_POSITION, *PERIODIC],
        PROPOSED,
    ),
    "padded columns": Layout(
        "Fortran",
        ["a.dat"],
        text_file("a.dat", "", lines_of("%18.8e", TIME, FORCE, POSITION, separator=" ")),
        ["--channel", "u=2 [N]", "--channel", "y=3 [um]", "--time", "1 [s]", *PERIODIC],
        ("'u=COLUMN [UNIT]'",),
        "no name or unit shows the input",
    ),
    "metadata and a line of units": Layout(
        "data acquisition",
        ["a.csv"],
        text_file("a.csv", "Device: DAQ 7\nOperator: nobody\n\nTime,Force,Position\ns,N,um\n", COLUMNS),
        ["--channel", "u=Force", "--channel", "y=Position", *PERIODIC],
        ("u=Force", "y=Position"),
    ),
    "rate in the metadata": Layout(
        "data acquisition",
        ["a.txt"],
        text_file(
            "a.txt",
            "Sample rate [kHz]: 1\n\nforce [N]\tposition [um]\n",
            lines_of("%.10g", FORCE, POSITION, separator="\t"),
        ),
        [*FORCE_AND_POSITION, *PERIODIC],
        PROPOSED,
    ),
    "rate once in a column": Layout(
        "data acquisition",
        ["a.csv"],
        rate_in_a_column,
        [*FORCE_AND_POSITION, "--sample-rate", "1000", *PERIODIC],
        (*PROPOSED, "--sample-rate 1000"),
    ),
    "text and flags": Layout("PLC", ["a.csv"], text_and_flags, [*FORCE_AND_POSITION, *PERIODIC], PROPOSED),
    "two clocks side by side": Layout(
        "data acquisition",
        ["a.csv"],
        padded_side_by_side,
        [*FORCE_AND_POSITION, "--resample", "cubic", *PERIODIC],
        ("u=force", "y=position", "--resample cubic"),
        tolerance=2e-3,
    ),
    "trailing separators": Layout(
        "spreadsheet",
        ["a.csv"],
        text_file(
            "a.csv",
            "time [s];force [N];position [um];\n",
            lines_of("%.10g", TIME, FORCE, POSITION, separator=";", end=";"),
        ),
        [*FORCE_AND_POSITION, *PERIODIC],
        PROPOSED,
    ),
    "index in the name": Layout(
        "PLC",
        ["a.csv"],
        text_file("a.csv", "time [s],iq[0],pos[0]\n", COLUMNS),
        ["--channel", "u=iq[0] [N]", "--channel", "y=pos[0] [um]", *PERIODIC],
        ("u=iq[0] [UNIT]", "y=pos[0] [UNIT]"),
        "the unit of 'iq[0]' is unknown: replace UNIT",
    ),
    "UTF-16": Layout(
        "spreadsheet",
        ["a.txt"],
        text_file("a.txt", "time [s],force [N],position [um]\n", COLUMNS, "utf-16"),
        [*FORCE_AND_POSITION, *PERIODIC],
        PROPOSED,
    ),
    "Latin-1": Layout(
        "spreadsheet",
        ["a.csv"],
        text_file("a.csv", "time [s],force [N],position [µm]\n", COLUMNS, "latin-1"),
        [*FORCE_AND_POSITION, *PERIODIC],
        PROPOSED,
    ),
    "quoted": Layout(
        "database",
        ["a.csv"],
        text_file("a.csv", '"time [s]","force [N]","position [um]"\n', lines_of('"%.10g"', TIME, FORCE, POSITION)),
        [*FORCE_AND_POSITION, *PERIODIC],
        PROPOSED,
    ),
    "header in a comment": Layout(
        "NumPy",
        ["a.txt"],
        text_file("a.txt", "# time [s] force [N] position [um]\n".replace(" [", "["), COLUMNS.replace(",", " ")),
        ["--channel", "u=force", "--channel", "y=position", *PERIODIC],
        ("u=force", "y=position"),
    ),
    "oscilloscope": Layout(
        "oscilloscope",
        ["a.csv"],
        text_file("a.csv", SWEEP_HEAD, COLUMNS),
        ["--channel", "u=CH1 * 1 [N]", "--channel", "y=CH2 [um]", "--time", "TIME [s]", *PERIODIC],
        ("'u=COLUMN [UNIT]'",),
        "no name or unit shows the input",
    ),
    "LabVIEW text": Layout(
        "LabVIEW",
        ["a.lvm"],
        text_file("a.lvm", LVM_HEAD, lines_of("%.10g", TIME, FORCE, POSITION, separator="\t")),
        ["--channel", "u=force [N]", "--channel", "y=position [um]", "--time", "X_Value [s]", *PERIODIC],
        ("u=force [UNIT]", "y=position [UNIT]"),
        "the unit of 'force' is unknown",
    ),
    "commands beside measurements": Layout(
        "PLC",
        ["a.csv"],
        text_file(
            "a.csv",
            "Zeit [s],SetPos [um],PosError [um],ActPos [um],TorqueCmd [N]\n",
            lines_of("%.10g", TIME, POSITION, 0 * POSITION, POSITION, FORCE),
        ),
        ["--channel", "u=TorqueCmd", "--channel", "y=ActPos", *PERIODIC],
        ("u=TorqueCmd", "y=ActPos", "reference=SetPos"),
    ),
    "jitter": Layout(
        "logger",
        ["a.csv"],
        jittered,
        [*FORCE_AND_POSITION, "--resample", "cubic", "--period-time", "0.25"],
        ("u=force", "y=position", "--resample cubic", "--period-time 0.25"),
        tolerance=5e-3,
    ),
    "two files": Layout(
        "two instruments",
        ["force.csv", "laser.csv"],
        joined,
        [*FORCE_AND_POSITION, "--join-files", "--resample", "cubic", *PERIODIC],
        ("u=force", "y=position", "--join-files"),
        "state the period",
        tolerance=1e-2,
    ),
    "TwinCAT, tab": Layout(
        "TwinCAT Scope",
        ["axis.csv"],
        scope("\t"),
        ["--channel", "u=SetTorque", "--channel", "y=ActPos", *PERIODIC],
        ("u=SetTorque", "y=ActPos", "--samples-per-period 250"),
    ),
    "TwinCAT, decimal comma": Layout(
        "TwinCAT Scope",
        ["axis.csv"],
        scope(";", comma=True),
        ["--channel", "u=SetTorque", "--channel", "y=ActPos", *PERIODIC],
        ("u=SetTorque", "y=ActPos"),
    ),
    "TwinCAT, two rates": Layout(
        "TwinCAT Scope",
        ["axis.csv"],
        scope("\t", 0.25),
        ["--channel", "u=SetTorque", "--channel", "y=ActPos", "--resample", "cubic", *PERIODIC],
        ("u=SetTorque", "y=ActPos", "--resample cubic"),
        tolerance=2e-3,
    ),
    "Sinumerik measurement": Layout(
        "Sinumerik",
        ["a.xml"],
        sinumerik_measurement,
        [
            "--channel",
            "frequency=frequency",
            "--channel",
            "real=response8_7.real",
            "--channel",
            "imaginary=response8_7.imaginary",
            "--unit",
            "um/N",
        ],
        ("frequency=frequency", "--unit OUTPUT/INPUT"),
        "replace OUTPUT/INPUT",
    ),
    "Sinumerik trace": Layout(
        "Sinumerik",
        ["a.xml"],
        sinumerik_trace,
        ["--channel", "u=Torque setpoint [N]", "--channel", "y=Encoder position [um]", *PERIODIC],
        ("'u=Torque setpoint [UNIT]'", "'y=Encoder position [UNIT]'"),
        "the unit of 'Torque setpoint' is unknown",
    ),
    "MATLAB 5": Layout(
        "MATLAB",
        ["a.mat"],
        lambda folder: savemat(folder / "a.mat", {"force": FORCE, "position": POSITION, "fs": RATE_HZ}),
        ["--channel", "u=force [N]", "--channel", "y=position [um]", "--sample-rate", "1000", *PERIODIC],
        ("'u=force [UNIT]'", "--sample-rate 1000"),
        "the unit of 'force' is unknown",
    ),
    "MATLAB 5, struct": Layout(
        "MATLAB",
        ["a.mat"],
        lambda folder: savemat(
            folder / "a.mat", {"run": {"force_N": FORCE, "pos_um": POSITION, "Ts": 1e-3}}, do_compression=True
        ),
        ["--channel", "u=run.force_N [N]", "--channel", "y=run.pos_um [um]", "--sample-rate", "1000", *PERIODIC],
        ("'u=run.force_N [N]'", "'y=run.pos_um [um]'", "--sample-rate 1000"),
    ),
    "MATLAB 4": Layout(
        "MATLAB",
        ["a.mat"],
        lambda folder: savemat(folder / "a.mat", {"u": FORCE, "y": POSITION, "t": TIME}, format="4"),
        ["--channel", "u=u [N]", "--channel", "y=y [um]", "--time", "t [s]", *PERIODIC],
        ("'u=u [UNIT]'", "'y=y [UNIT]'"),
        "the unit of 'u' is unknown",
    ),
    "HDF5 with attributes": Layout(
        "HDF5",
        ["a.h5"],
        hdf5,
        ["--channel", "u=measurement.force", "--channel", "y=measurement.position", *PERIODIC],
        ("u=measurement.force", "y=measurement.position"),
    ),
    "HDF5 matrix": Layout(
        "HDF5",
        ["a.hdf5"],
        hdf5_matrix,
        ["--channel", "u=data.1 [N]", "--channel", "y=data.2 [um]", "--sample-rate", "1000", *PERIODIC],
        ("'u=COLUMN [UNIT]'",),
        "no name or unit shows the input",
    ),
    "npz": Layout(
        "NumPy",
        ["a.npz"],
        lambda folder: np.savez(folder / "a.npz", u=FORCE, y=POSITION, dt=1e-3),
        ["--channel", "u=u [N]", "--channel", "y=y [um]", "--sample-rate", "1000", *PERIODIC],
        ("'u=u [UNIT]'", "--sample-rate 1000"),
        "the unit of 'u' is unknown",
    ),
    "npy": Layout(
        "NumPy",
        ["a.npy"],
        lambda folder: np.save(folder / "a.npy", np.column_stack([FORCE, POSITION])),
        ["--channel", "u=data.1 [N]", "--channel", "y=data.2 [um]", "--sample-rate", "1000", *PERIODIC],
        ("'u=COLUMN [UNIT]'", "--sample-rate HZ"),
        "replace HZ",
    ),
    "UFF 58 over time": Layout(
        "modal analysis",
        ["a.uff"],
        uff_time,
        ["--channel", "u=signal_1Z [N]", "--channel", "y=signal_2Z [um]", *PERIODIC],
        ("u=signal_1Z",),
    ),
    "UFF 58 response": Layout(
        "modal analysis",
        ["a.unv"],
        uff_response,
        [
            "--channel",
            "frequency=frequency",
            "--channel",
            "real=response_2Z_1Z.real",
            "--channel",
            "imaginary=response_2Z_1Z.imaginary",
            "--unit",
            "um/N",
        ],
        ("frequency=frequency", "real=response_2Z_1Z.real"),
        "replace OUTPUT/INPUT",
        tolerance=1e-3,
    ),
    "TDMS": Layout("LabVIEW", ["a.tdms"], tdms, [*FORCE_AND_POSITION, *PERIODIC], PROPOSED, extra="nptdms"),
    "MDF 4, two rates": Layout(
        "vehicle bus logger",
        ["a.mf4"],
        mdf,
        [*FORCE_AND_POSITION, "--resample", "cubic", *PERIODIC],
        ("u=force", "y=position", "--resample cubic"),
        tolerance=2e-3,
        extra="asammdf",
    ),
    "MCAP": Layout(
        "robot log",
        ["a.mcap"],
        mcap,
        ["--channel", "u=joint.effort.1 [N]", "--channel", "y=joint.position.1 [m]", *PERIODIC],
        ("'u=joint.effort.1 [UNIT]'", "'y=joint.position.1 [UNIT]'"),
        "the unit of 'joint.effort.1' is unknown",
        extra="mcap",
    ),
    "Parquet": Layout(
        "data platform",
        ["a.parquet"],
        parquet,
        [*FORCE_AND_POSITION, *PERIODIC],
        ("u=force", "y=position", "--time timestamp"),
        extra="pyarrow",
    ),
    "Bode in dB and degrees": Layout(
        "spectrum analyser",
        ["a.csv"],
        text_file(
            "a.csv",
            "Frequency [Hz],Magnitude [dB],Phase [deg]\n",
            lines_of("%.10g", FREQUENCY, MAGNITUDE_DB, PHASE_DEG),
        ),
        BODE,
        ("frequency=Frequency", "magnitude=Magnitude", "phase=Phase"),
        "replace OUTPUT/INPUT",
    ),
    "Bode in real and imaginary part": Layout(
        "spectrum analyser",
        ["a.csv"],
        text_file(
            "a.csv",
            "freq [Hz];re;im;coherence\n",
            lines_of("%.10g", FREQUENCY, RESPONSE.real, RESPONSE.imag, np.full(40, 0.99), separator=";"),
        ),
        [
            "--channel",
            "frequency=freq",
            "--channel",
            "real=re",
            "--channel",
            "imaginary=im",
            "--channel",
            "coherence=coherence",
            "--averages",
            "16",
            "--unit",
            "um/N",
        ],
        ("frequency=freq", "real=re", "imaginary=im", "coherence=coherence"),
        "replace OUTPUT/INPUT",
    ),
    "response in NumPy": Layout(
        "python-control",
        ["a.npz"],
        lambda folder: np.savez(
            folder / "a.npz", omega=2 * np.pi * FREQUENCY, mag=np.abs(RESPONSE), phase=np.radians(PHASE_DEG)
        ),
        [
            "--channel",
            "frequency=omega [rad/s]",
            "--channel",
            "magnitude=mag",
            "--channel",
            "phase=phase [rad]",
            "--unit",
            "um/N",
        ],
        ("frequency=", "magnitude=mag"),
        "replace OUTPUT/INPUT",
    ),
}
