"""The part of the corpus that instruments, test machines and programs of measurement write, as such files look."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from tests.records.corpus_writers import FORCE, PERIODIC, POSITION, TIME, Layout, lines_of, signals, text_file

NUMBER = range(TIME.size)
MILLISECONDS, MICROSECONDS = 1e3 * TIME, 1e6 * TIME
EPOCH_NS = [1_709_547_133_000_000_000 + 1_000_000 * k for k in NUMBER]
SETTINGS = (
    "Record Length,1.000000e+03", "Sample Interval,1.000000e-03", "Trigger Point,5.0e+02", ",", ",", ",", "Source,CH1",
    "Vertical Units,V", "Vertical Scale,5.0", "Vertical Offset,0.0", "Horizontal Units,s", "Horizontal Scale,2.5e-4",
    "Pt Fmt,Y", "Yzero,0", "Probe Atten,1", "Model Number,TDS", "Serial Number,C1", "Firmware Version,FV",
)  # fmt: skip
CONTROL_HEAD = (
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


def settings_beside_samples(folder: Path) -> None:
    """An oscilloscope that writes its settings into the first columns of the first rows, and no headings."""
    rows = zip(NUMBER, TIME, FORCE, POSITION, strict=True)
    text = [f"{SETTINGS[k] if k < len(SETTINGS) else ','},,{t:.10g},{u:.10g},{y:.10g}," for k, t, u, y in rows]
    (folder / "a.csv").write_text("\n".join(text) + "\n", encoding="utf-8")


def labelled_rows(folder: Path) -> None:
    rows = zip(NUMBER, TIME, FORCE, POSITION, strict=True)
    text = "".join(f'"{"" if k else "trace_values"}",{t:.10g},{u:.10g},{y:.10g}\n' for k, t, u, y in rows)
    (folder / "a.csv").write_text(CONTROL_HEAD + text, encoding="utf-8")


def trend(folder: Path) -> None:
    """A trend of a PLC: each row begins with a label, a date and a time that no other program writes so."""
    rows = zip(NUMBER, FORCE, POSITION, strict=True)
    text = "".join(f'"Data:","3/4/2024","10:12:13;{k:03d}",{u:.10g},{y:.10g}\n' for k, u, y in rows)
    (folder / "a.csv").write_text(TREND_HEAD + text, encoding="utf-8")


def american_dates(folder: Path) -> None:
    """Two channels of a data acquisition, each with its dates: the record passes noon."""
    moments = [datetime(2024, 3, 4, 11, 59, 59, 500_000) + timedelta(milliseconds=k) for k in NUMBER]
    rows = zip((f"{moment:%m/%d/%Y %I:%M:%S.%f %p}" for moment in moments), FORCE, POSITION, strict=True)
    text = "".join(f"{moment}\t{u:.10g}\t{moment}\t{y:.10g}\n" for moment, u, y in rows)
    head = "Time - Force\tAmplitude - Force\tTime - Position\tAmplitude - Position\n"
    (folder / "a.txt").write_text(head + text, encoding="utf-8")


def counted_samples(folder: Path) -> None:
    rows = zip(NUMBER, FORCE, POSITION, strict=True)
    head = "X,CH1,CH2,Start,Increment\nSequence,Volt,Volt,0.000000e+00,1.000000e-03\n"
    text = "".join(f"{k},{u:.10g},{y:.10g},,\n" for k, u, y in rows)
    (folder / "a.csv").write_text(head + text, encoding="utf-8")


def time_of_day(folder: Path) -> None:
    rows = zip(NUMBER, FORCE, POSITION, strict=True)
    text = "".join(f"10:12:13,{k:03d};{u:.10g};{y:.10g}\n".replace(".", ",") for k, u, y in rows)
    (folder / "a.csv").write_text(f"Uhrzeit;Kraft [N];Weg [um]\n{text}Ende der Messung;;\n", encoding="utf-8")


def channels(u: str, y: str, *more: str) -> list[str]:
    return ["--channel", f"u={u}", "--channel", f"y={y}", *more, *PERIODIC]


FAST = signals(np.arange(2 * TIME.size) / 2000)
INSTRUMENT_LAYOUTS = {
    "quotients as headings": Layout(
        "test stand",
        ["a.txt"],
        text_file(
            "a.txt", "t/s;F/kN;s/mm\n", lines_of("%.10g", TIME, FORCE / 1e3, POSITION / 1e3, separator=";", comma=True)
        ),
        channels("F", "s"),
        ("u=F ", "y=s ", "--time t ", "--samples-per-period 250"),
    ),
    "quotients with blanks": Layout(
        "test stand",
        ["a.csv"],
        text_file(
            "a.csv", "Zeit / s;Kraft / N;Weg / µm\n", lines_of("%.10g", TIME, FORCE, POSITION, separator=";"), "latin-1"
        ),
        channels("Kraft", "Weg"),
        ("u=Kraft ", "y=Weg ", "--time Zeit "),
    ),
    "sample time with a decimal comma": Layout(
        "test stand",
        ["a.csv"],
        text_file(
            "a.csv",
            "Messung;Achse 1\nAbtastzeit [ms];0,5\nKraft [N];Weg [um]\n",
            lines_of("%.10g", *FAST, separator=";", comma=True),
        ),
        ["--channel", "u=Kraft", "--channel", "y=Weg", "--samples-per-period", "500"],
        ("u=Kraft ", "y=Weg ", "--samples-per-period 500"),
    ),
    "labelled rows": Layout(
        "rapid prototyping", ["a.csv"], labelled_rows, channels("Force", "Position"), ("u=Force ", "y=Position ")
    ),
    "labelled rows without a time": Layout(
        "scope recorder",
        ["a.csv"],
        text_file(
            "a.csv", RECORDER_HEAD, "".join(f",{u:.10g},{y:.10g}\n" for u, y in zip(FORCE, POSITION, strict=True))
        ),
        channels("Force", "Position"),
        ("u=Force ", "y=Position "),
    ),
    "trend of a PLC": Layout(
        "PLC",
        ["a.csv"],
        trend,
        channels("Axis.TorqueReference [N]", "Axis.ActualPosition [um]"),
        ("'u=Axis.TorqueReference [UNIT]'", "'y=Axis.ActualPosition [UNIT]'"),
        "the unit of 'Axis.ActualPosition' is unknown",
    ),
    "American dates": Layout(
        "data acquisition",
        ["a.txt"],
        american_dates,
        channels('"Amplitude - Force" [N]', '"Amplitude - Position" [um]'),
        ("'u=\"Amplitude - Force\" [UNIT]'", "'y=\"Amplitude - Position\" [UNIT]'"),
        "the unit of 'Amplitude - Force' is unknown",
    ),
    "settings beside the samples": Layout(
        "oscilloscope",
        ["a.csv"],
        settings_beside_samples,
        channels("5 [N]", "6 [um]", "--time", "4 [s]"),
        ("'u=COLUMN [UNIT]'",),
        "no name or unit shows the input",
    ),
    "channels called by numbers": Layout(
        "oscilloscope",
        ["a.csv"],
        text_file("a.csv", "x-axis,1,2\nsecond,Volt,Volt\n", lines_of("%.10g", TIME, FORCE / 31.5, POSITION / 20)),
        channels("1 * 31.5 [N]", "2 * 20 [um]"),
        ("'u=COLUMN [UNIT]'", "--time x-axis"),
        "the input may be '1' or '2'",
    ),
    "samples counted": Layout(
        "oscilloscope",
        ["a.csv"],
        counted_samples,
        channels("CH1 * 2 [N]", "CH2 * 2 [um]"),
        ("'u=COLUMN [UNIT]'",),
        "the input may be 'CH1' or 'CH2'",
    ),
    "two rows of headings": Layout(
        "oscilloscope",
        ["a.csv"],
        text_file(
            "a.csv",
            "Segment,TrigTime,TimeSinceSegment1\n#1,4-Mar-2024,0\nTime,Force,Position\n",
            lines_of("%.10g", TIME, FORCE, POSITION),
        ),
        channels("Force [N]", "Position [um]", "--time", "Time"),
        ("'u=Force [UNIT]'", "'y=Position [UNIT]'", "--time 'Time [s]'"),
        "the unit of 'Force' is unknown",
    ),
    "units written out": Layout(
        "test machine",
        ["a.txt"],
        text_file(
            "a.txt",
            "Acquisition\tTime:\t0.9\tSec\n\nTime\tAxial Force\tAxial Displacement\nSec\tN\tum\n",
            lines_of("%.10g", TIME, FORCE, POSITION, separator="\t"),
        ),
        channels("Axial Force", "Axial Displacement"),
        ("u=Axial Force", "y=Axial Displacement", "--time Time "),
    ),
    "currents counted": Layout(
        "servo drive",
        ["a.csv"],
        text_file(
            "a.csv",
            "Recorder\n\nTime (ms),IL.FB (Arms),PL.FB (um)\n",
            lines_of("%.10g", MILLISECONDS, FORCE / 3, POSITION),
        ),
        channels("IL.FB * 3 [N]", "PL.FB"),
        ("u=IL.FB ", "y=PL.FB ", "--time Time "),
    ),
    "microseconds in the name": Layout(
        "microcontroller",
        ["a.csv"],
        text_file("a.csv", "time_us,force_N,pos_um\n", lines_of("%.10g", MICROSECONDS, FORCE, POSITION)),
        channels("force_N [N]", "pos_um [um]", "--time", "time_us"),
        ("'u=force_N [N]'", "'y=pos_um [um]'", "'time_us [us]'"),
    ),
    "milliseconds since the start": Layout(
        "microcontroller",
        ["a.log"],
        text_file("a.log", "millis,force_N,encoder_um\n", lines_of("%.10g", MILLISECONDS, FORCE, POSITION)),
        channels("force_N [N]", "encoder_um [um]", "--time", "millis"),
        ("'u=force_N [N]'", "'y=encoder_um [um]'", "'millis [ms]'"),
    ),
    "types below the units": Layout(
        "vehicle calibration",
        ["a.ascii"],
        text_file(
            "a.ascii",
            "ItemFile\trecord\nsampleCount\t1000\ntime\tforce\tposition\ns\tN\tum\nf8\tf8\tf8\n",
            lines_of("%.10g", TIME, FORCE, POSITION, separator="\t"),
        ),
        channels("force", "position"),
        ("u=force ", "y=position ", "--time time "),
    ),
    "time of day and a footer": Layout(
        "logger",
        ["a.csv"],
        time_of_day,
        channels("Kraft", "Weg"),
        ("u=Kraft ", "y=Weg ", "--time Uhrzeit "),
        tolerance=1e-3,
    ),
    "nanoseconds since 1970": Layout(
        "robot log",
        ["a.csv"],
        text_file(
            "a.csv",
            "timestamp|force [N]|position [um]\n",
            "".join(f"{t}|{u:.10g}|{y:.10g}\n" for t, u, y in zip(EPOCH_NS, FORCE, POSITION, strict=True)),
        ),
        channels("force", "position", "--time", "timestamp"),
        ("u=force ", "y=position ", "'timestamp [ns]'"),
        tolerance=1e-3,
    ),
}
