"""The corpus: a file of each layout by name, with what the listing proposes for it, or the options that it needs."""

import numpy as np
from scipy.io import savemat

from tests.records.corpus_writers import (
    COLUMNS,
    FORCE,
    FREQUENCY,
    MAGNITUDE_DB,
    PHASE_DEG,
    POSITION,
    PROPOSED,
    RATE_HZ,
    RESPONSE,
    TIME,
    Layout,
    filled,
    frd_in_hdf5,
    hdf5,
    jittered,
    joined,
    lines_of,
    mcap,
    mcap_of_protobuf,
    mcap_of_ros,
    mdf,
    named,
    padded_side_by_side,
    parquet,
    response,
    scope,
    settings_beside_samples,
    sinumerik_measurement,
    sinumerik_trace,
    tdms,
    text,
    uff_response,
    uff_time,
)

NUMBER, OMEGA = range(TIME.size), 2 * np.pi * FREQUENCY
UNKNOWN, NO_INPUT, RATIO = "the unit of '{}' is unknown", "no name or unit shows the input", "replace OUTPUT/INPUT"
LABVIEW_HEAD = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\n***End_of_Header***\t\n\t\nChannels\t2\t\n"
    "Samples\t1000\t1000\nX_Dimension\tTime\tTime\n***End_of_Header***\t\t\nX_Value\tforce\tposition\tComment\n"
)
RAPID_PROTOTYPING_HEAD = (
    '"measurement","exp_001"\n"date","2024-03-04"\n"path","","Model Root/Force/Out1","Model Root/Position/Out1"\n'
    '"name","Time","Force","Position"\n"unit","s","N","um"\n'
)
RECORDER_HEAD = (
    '"Header Size",9\n"Model Name","recorder"\n"TraceName","Force","Position"\n"BlockSize",1000,1000\n'
    '"VUnit","N","um"\n"SampleRate",1000.0,1000.0\n"HOffset",0.0,0.0\n"HUnit","s","s"\n\n'
)
TREND_HEAD = (
    '"Controller Name:","PLC1"\n"Trend Tags:",2\n"Sample Period:","1 ms"\n"Start Time:","3/4/2024;10:12:13 AM"\n'
    '"Header:","Date","Time","Axis.TorqueReference","Axis.ActualPosition"\n'
)
STARTDRIVE_HEAD = (
    '\ufeff"Trace";"Axis_1"\r\n"Datum";"17.03.2024 10:22:31"\r\n\r\n'
    '"Sample";"Zeit [ms]";"r80[0]: Kraftistwert [N]";"r482[0]: Encoder 1 Lageistwert XIST1 [µm]"\r\n'
)
INDRAWORKS_HEAD = (
    "[IndraWorks Oscilloscope]\nVersion;1.2\nAbtastzeit [us];1000\n[Kanal1]\nIdent;S-0-0084\nEinheit;N\n"
    "[Kanal2]\nIdent;S-0-0051\nEinheit;um\n[Daten]\nt[us];S-0-0084;S-0-0051\n"
)
TEXTS = {
    "comma": text("time [s],force [N],position [um]\n", COLUMNS, *PROPOSED),
    "padded columns": text(
        "", lines_of("%18.8e", TIME, FORCE, POSITION, separator=" "), "'u=COLUMN [UNIT]'",
        needs=NO_INPUT, options=named("2 [N]", "3 [um]", "--time", "1 [s]"),
    ),
    "rate once in a column": text(
        "force [N],position [um],fs\n", filled("{u:.10g},{y:.10g},\n").replace(",\n", ",1000\n", 1),
        *PROPOSED, "--sample-rate 1000",
    ),
    "commands beside measurements": text(
        "Zeit [s],SetPos [um],PosError [um],ActPos [um],TorqueCmd [N]\n",
        lines_of("%.10g", TIME, POSITION, 0 * POSITION, POSITION, FORCE),
        "u=TorqueCmd", "y=ActPos", "reference=SetPos",
    ),
    "LabVIEW text": text(
        LABVIEW_HEAD, lines_of("%.10g", TIME, FORCE, POSITION, separator="\t").replace("\n", "\tstart\n", 1),
        "u=force [UNIT]", "y=position [UNIT]",
        needs=UNKNOWN.format("force"), options=named("force [N]", "position [um]", "--time", "X_Value [s]"),
    ),
    "German drive": text(
        "Antriebsmessung;;;;\r\nGerät:;AX5206;;;\r\n\r\nZeit;Status;Drehmoment[0];Lageistwert;\r\nms;;kNm;grad;\r\n",
        "".join(
            f"{1e3 * t:.1f};RUN;{1e-3 * u:.12g};{y:.12g};\r\n".replace(".", ",")
            for t, u, y in zip(TIME, FORCE, np.degrees(1e-6 * POSITION), strict=True)
        ),
        "u=Drehmoment[0]", "'y=Lageistwert [UNIT]'", "--time Zeit", encoding="latin-1",
        needs="Lageistwert", options=named("Drehmoment[0]", "Lageistwert [deg]", "--time", "Zeit"),
    ),
    "Startdrive": text(
        STARTDRIVE_HEAD,
        lines_of("%.10g", NUMBER, 1e3 * TIME, FORCE, POSITION, separator=";", comma=True, end="\r"),
        "u=r80[0]: Kraftistwert", "y=r482[0]: Encoder 1 Lageistwert XIST1", "--time Zeit",
    ),
    "ACS": text(
        "Time (msec),CH1: DCOM(0),CH2: FPOS(0)\n", lines_of("%.10g", 1e3 * TIME, FORCE, POSITION / 1e3),
        "'u=COLUMN [UNIT]'", needs=NO_INPUT,
        options=named("CH1: DCOM(0) [N]", "CH2: FPOS(0) [mm]", "--time", "Time"),
    ),
    "IndraWorks": text(
        INDRAWORKS_HEAD, lines_of("%.10g", 1e6 * TIME, FORCE, POSITION, separator=";", comma=True),
        "'u=COLUMN [UNIT]'", needs=NO_INPUT, options=named("S-0-0084 [N]", "S-0-0051 [um]", "--time", "t"),
    ),
    "quotients as headings": text(
        "t/s;F/kN;s/mm\n", lines_of("%.10g", TIME, FORCE / 1e3, POSITION / 1e3, separator=";", comma=True),
        "u=F ", "y=s ", "--time t ", "--samples-per-period 250",
    ),
    "labelled rows": text(
        RAPID_PROTOTYPING_HEAD,
        filled('"",{t:.10g},{u:.10g},{y:.10g}\n').replace('""', '"trace_values"', 1), "u=Force ", "y=Position ",
    ),
    "labelled rows without a time": text(
        RECORDER_HEAD, filled(",{u:.10g},{y:.10g}\n"), "u=Force ", "y=Position ",
    ),
    "trend of a PLC": text(
        TREND_HEAD, filled('"Data:","3/4/2024","10:12:13;{k:03d}",{u:.10g},{y:.10g}\n'),
        "'u=Axis.TorqueReference [UNIT]'", "'y=Axis.ActualPosition [UNIT]'",
        needs=UNKNOWN.format("Axis.ActualPosition"),
        options=named("Axis.TorqueReference [N]", "Axis.ActualPosition [um]"),
    ),
    "American dates": text(
        "Time - Force\tAmplitude - Force\tTime - Position\tAmplitude - Position\n",
        filled("{m:%m/%d/%Y %I:%M:%S.%f %p}\t{u:.10g}\t{m:%m/%d/%Y %I:%M:%S.%f %p}\t{y:.10g}\n"),
        "'u=\"Amplitude - Force\" [UNIT]'", "'y=\"Amplitude - Position\" [UNIT]'",
        needs=UNKNOWN.format("Amplitude - Force"),
        options=named('"Amplitude - Force" [N]', '"Amplitude - Position" [um]'),
    ),
    "channels called by numbers": text(
        "x-axis,1,2\nsecond,Volt,Volt\n", lines_of("%.10g", TIME, FORCE / 31.5, POSITION / 20),
        "'u=COLUMN [UNIT]'", "--time x-axis",
        needs="the input may be '1' or '2'", options=named("1 * 31.5 [N]", "2 * 20 [um]"),
    ),
    "samples counted": text(
        "X,CH1,CH2,Start,Increment\nSequence,Volt,Volt,0.000000e+00,1.000000e-03\n",
        filled("{k},{u:.10g},{y:.10g},,\n"), "'u=COLUMN [UNIT]'",
        needs="the input may be 'CH1' or 'CH2'", options=named("CH1 * 2 [N]", "CH2 * 2 [um]"),
    ),
    "two rows of headings": text(
        "Segment,TrigTime,TimeSinceSegment1\n#1,4-Mar-2024,0\nTime,Force,Position\n", COLUMNS,
        "'u=Force [UNIT]'", "'y=Position [UNIT]'", "--time 'Time [s]'",
        needs=UNKNOWN.format("Force"), options=named("Force [N]", "Position [um]", "--time", "Time"),
    ),
    "currents counted": text(
        "Recorder\n\nTime (ms),IL.FB (Arms),PL.FB (um)\n", lines_of("%.10g", 1e3 * TIME, FORCE / 3, POSITION),
        "u=IL.FB ", "y=PL.FB ", "--time Time ", options=named("IL.FB * 3 [N]", "PL.FB"),
    ),
    "microseconds in the name": text(
        "time_us,force_N,pos_um\n", lines_of("%.10g", 1e6 * TIME, FORCE, POSITION),
        "'u=force_N [N]'", "'y=pos_um [um]'", "'time_us [us]'",
    ),
    "types below the units": text(
        "ItemFile\trecord\nsampleCount\t1000\ntime\tforce\tposition\ns\tN\tum\nf8\tf8\tf8\n",
        lines_of("%.10g", TIME, FORCE, POSITION, separator="\t"), "u=force ", "y=position ", "--time time ",
    ),
    "time of day and a footer": text(
        "Uhrzeit;Kraft [N];Weg [um]\n",
        filled("10:12:13,{k:03d};{u:.10g};{y:.10g}\n").replace(".", ",") + "Ende der Messung;;\n",
        "u=Kraft ", "y=Weg ", "--time Uhrzeit ", tolerance=1e-3,
    ),
    "nanoseconds since 1970": text(
        "timestamp|force [N]|position [um]\n", filled("{ns}|{u:.10g}|{y:.10g}\n"),
        "u=force ", "y=position ", "'timestamp [ns]'", tolerance=1e-3,
    ),
    "settings beside the samples": Layout(
        ["a.csv"], settings_beside_samples, ["'u=COLUMN [UNIT]'"],
        NO_INPUT, named("5 [N]", "6 [um]", "--time", "4 [s]"),
    ),
    "two clocks side by side": Layout(
        ["a.csv"], padded_side_by_side, ["u=force", "y=position", "--resample cubic"], tolerance=2e-3
    ),
    "jitter": Layout(
        ["a.csv"], jittered, ["u=force", "y=position", "--resample cubic", "--period-time 0.25"], tolerance=5e-3
    ),
    "two files": Layout(
        ["force.csv", "laser.csv"], joined, ["u=force", "y=position", "--join-files"], "state the period",
        named("force", "position", "--join-files", "--resample", "cubic"), tolerance=1e-2,
    ),
}  # fmt: skip
FORMATS = {
    "TwinCAT, tab": Layout(["axis.csv"], scope(), ["u=SetTorque", "y=ActPos", "--samples-per-period 250"]),
    "TwinCAT, two rates": Layout(
        ["axis.csv"], scope(0.25), ["u=SetTorque", "y=ActPos", "--resample cubic"], tolerance=2e-3
    ),
    "Sinumerik measurement": Layout(
        ["a.xml"], sinumerik_measurement, ["frequency=frequency", "--unit OUTPUT/INPUT"],
        RATIO, response("frequency", real="response8_7.real", imaginary="response8_7.imaginary"),
    ),
    "Sinumerik trace": Layout(
        ["a.xml"], sinumerik_trace, ["'u=Torque setpoint [UNIT]'", "'y=Encoder position [UNIT]'"],
        UNKNOWN.format("Torque setpoint"), named("Torque setpoint [N]", "Encoder position [um]"),
    ),
    "MATLAB 5": Layout(
        ["a.mat"], lambda folder: savemat(folder / "a.mat", {"force": FORCE, "position": POSITION, "fs": RATE_HZ}),
        ["'u=force [UNIT]'", "--sample-rate 1000"],
        UNKNOWN.format("force"), named("force [N]", "position [um]", "--sample-rate", "1000"),
    ),
    "MATLAB 5, struct": Layout(
        ["a.mat"],
        lambda folder: savemat(
            folder / "a.mat", {"run": {"force_N": FORCE, "pos_um": POSITION, "Ts": 1e-3}}, do_compression=True
        ),
        ["'u=run.force_N [N]'", "'y=run.pos_um [um]'", "--sample-rate 1000"],
    ),
    "MATLAB 4": Layout(
        ["a.mat"], lambda folder: savemat(folder / "a.mat", {"u": FORCE, "y": POSITION, "t": TIME}, format="4"),
        ["'u=u [UNIT]'", "'y=y [UNIT]'"], UNKNOWN.format("u"), named("u [N]", "y [um]", "--time", "t [s]"),
    ),
    "HDF5 with attributes": Layout(["a.h5"], hdf5, ["u=measurement.force", "y=measurement.position"]),
    "npz": Layout(
        ["a.npz"], lambda folder: np.savez(folder / "a.npz", u=FORCE, y=POSITION, dt=1e-3),
        ["'u=u [UNIT]'", "--sample-rate 1000"], UNKNOWN.format("u"),
        named("u [N]", "y [um]", "--sample-rate", "1000"),
    ),
    "npy": Layout(
        ["a.npy"], lambda folder: np.save(folder / "a.npy", np.column_stack([FORCE, POSITION])),
        ["'u=COLUMN [UNIT]'", "--sample-rate HZ"], "replace HZ",
        named("data.1 [N]", "data.2 [um]", "--sample-rate", "1000"),
    ),
    "UFF 58 over time": Layout(["a.uff"], uff_time, ["u=signal_1Z"]),
    "UFF 58 response": Layout(
        ["a.unv"], uff_response, ["frequency=frequency", "real=response_2Z_1Z.real"], RATIO,
        response("frequency", real="response_2Z_1Z.real", imaginary="response_2Z_1Z.imaginary"), tolerance=1e-3,
    ),
    "TDMS": Layout(["a.tdms"], tdms, PROPOSED, extra="nptdms"),
    "MDF 4, two rates": Layout(
        ["a.mf4"], mdf, ["u=force", "y=position", "--resample cubic"], tolerance=2e-3, extra="asammdf"
    ),
    "MCAP": Layout(
        ["a.mcap"], mcap, ["'u=joint.effort.1 [UNIT]'", "'y=joint.position.1 [UNIT]'"],
        UNKNOWN.format("joint.effort.1"), named("joint.effort.1 [N]", "joint.position.1 [m]"), extra="mcap",
    ),
    "MCAP of ROS 2": Layout(
        ["a.mcap"], mcap_of_ros, ["'u=joint_states.effort.1 [UNIT]'", "'y=joint_states.position.1 [UNIT]'"],
        UNKNOWN.format("joint_states.effort.1"),
        named("joint_states.effort.1 [N]", "joint_states.position.1 [m]"), extra="mcap_ros2",
    ),
    "MCAP with Protocol Buffers": Layout(
        ["a.mcap"], mcap_of_protobuf, ["'u=bench.axis.force [UNIT]'", "'y=bench.axis.position.1 [UNIT]'"],
        UNKNOWN.format("bench.axis.force"), named("bench.axis.force [N]", "bench.axis.position.1 [m]"),
        extra="mcap_protobuf",
    ),
    "Parquet": Layout(["a.parquet"], parquet, ["u=force", "y=position", "--time timestamp"], extra="pyarrow"),
}  # fmt: skip
RESPONSES = {
    "Bode in dB and degrees": text(
        "Frequency [Hz],Magnitude [dB],Phase [deg]\n", lines_of("%.10g", FREQUENCY, MAGNITUDE_DB, PHASE_DEG),
        "frequency=Frequency", "magnitude=Magnitude", "phase=Phase",
        needs=RATIO, options=response("Frequency", magnitude="Magnitude", phase="Phase"),
    ),
    "Bode in real and imaginary part": text(
        "freq [Hz];re;im;coherence [%]\n",
        lines_of("%.10g", FREQUENCY, RESPONSE.real, RESPONSE.imag, np.full(40, 99.0), separator=";"),
        "frequency=freq", "real=re", "imaginary=im", "coherence=coherence", needs=RATIO,
        options=[*response("freq", real="re", imaginary="im", coherence="coherence"), "--averages", "16"],
    ),
    "response in NumPy": Layout(
        ["a.npz"],
        lambda folder: np.savez(folder / "a.npz", omega=OMEGA, mag=np.abs(RESPONSE), phase=np.radians(PHASE_DEG)),
        ["'frequency=omega [rad/s]'", "magnitude=mag", "'phase=phase [rad]'"],
        RATIO, response("omega [rad/s]", magnitude="mag", phase="phase [rad]"),
    ),
    "names of traces": text(
        "Frequency in Hz;Trace 1: Gain: Magnitude in dB;Trace 1: Gain: Phase in °\n",
        lines_of("%.10g", FREQUENCY, MAGNITUDE_DB, PHASE_DEG, separator=";", comma=True),
        "frequency=Frequency", "magnitude=Trace 1: Gain: Magnitude", "phase=Trace 1: Gain: Phase", needs=RATIO,
        options=response("Frequency", magnitude="Trace 1: Gain: Magnitude", phase="Trace 1: Gain: Phase"),
    ),
    "complex numbers of Python": text(
        "frequency_hz,response\n",
        "".join(f"{f:.10g},({z.real:.10g}{z.imag:+.10g}j)\n" for f, z in zip(FREQUENCY, RESPONSE, strict=True)),
        "'frequency=frequency_hz [Hz]'", "real=response.real", "imaginary=response.imaginary",
        needs=RATIO, options=response("frequency_hz [Hz]", real="response.real", imaginary="response.imaginary"),
    ),
    "complex numbers of MATLAB": text(
        "omega [rad/s];G\n",
        "".join(
            f"{w:.10g};{z.real:.10g} {'-' if z.imag < 0 else '+'} {abs(z.imag):.10g}i\n"
            for w, z in zip(OMEGA, RESPONSE, strict=True)
        ),
        "frequency=omega ", "real=G.real", "imaginary=G.imaginary",
        needs=RATIO, options=response("omega", real="G.real", imaginary="G.imaginary"),
    ),
    "frd in MATLAB": Layout(
        ["a.mat"],
        lambda folder: savemat(folder / "a.mat", {"G": {"resp": RESPONSE[None, None], "freq": FREQUENCY[:, None]}}),
        ["'frequency=G.freq [UNIT]'", "real=G.resp.real", "imaginary=G.resp.imaginary"],
        UNKNOWN.format("G.freq"), response("G.freq [Hz]", real="G.resp.real", imaginary="G.resp.imaginary"),
    ),
    "frd in MATLAB 7.3": Layout(
        ["a.mat"], frd_in_hdf5, ["'frequency=freq [UNIT]'", "real=resp.real", "imaginary=resp.imaginary"],
        UNKNOWN.format("freq"), response("freq [Hz]", real="resp.real", imaginary="resp.imaginary"),
    ),
    "frd in python-control": Layout(
        ["a.npz"], lambda folder: np.savez(folder / "a.npz", omega=OMEGA, frdata=RESPONSE[None, None]),
        ["'frequency=omega [rad/s]'", "real=frdata.real", "imaginary=frdata.imaginary"],
        RATIO, response("omega [rad/s]", real="frdata.real", imaginary="frdata.imaginary"),
    ),
}  # fmt: skip
LAYOUTS = TEXTS | FORMATS | RESPONSES
