"""Traces as the tools of drives write them, from the layouts that their manuals show."""

from collections.abc import Callable
from pathlib import Path

from tests.records.corpus_writers import FORCE, PERIODIC, POSITION, TIME, Layout, lines_of, text_file

NUMBER = range(TIME.size)


def startdrive(folder: Path) -> None:
    """Write a trace with a byte-order mark, quotes, names behind the drive's parameters and decimal commas."""
    head = '"Trace";"Axis_1"\r\n"Datum";"17.03.2024 10:22:31"\r\n\r\n'
    names = '"Sample";"Zeit [ms]";"r80[0]: Kraftistwert [N]";"r482[0]: Encoder 1 Lageistwert XIST1 [µm]"\r\n'
    rows = lines_of("%.10g", NUMBER, 1e3 * TIME, FORCE, POSITION, separator=";", comma=True, end="\r")
    (folder / "a.csv").write_bytes(("\ufeff" + head + names + rows).encode())


def two_clocks(name: str, head: str, unit: str) -> Callable[[Path], None]:
    """Return a writer of a table in which each channel has a column of time in milliseconds beside it."""
    names = f"{head}Time [{unit}],Force [N],Time [{unit}],Position [um]\n"
    return text_file(name, names, lines_of("%.10g", 1e3 * TIME, FORCE, 1e3 * TIME, POSITION))


INDRAWORKS_HEAD = (
    "[IndraWorks Oscilloscope]\nVersion;1.2\nAbtastzeit [us];1000\n[Kanal1]\nIdent;S-0-0084\nEinheit;N\n"
    "[Kanal2]\nIdent;S-0-0051\nEinheit;um\n[Daten]\nt[us];S-0-0084;S-0-0051\n"
)
AUTOMATION_HEAD = (
    "// Data Plot\n// Sample Rate (kHz): 1\nSample\tTime (sec)\tX Position Command (um)\tX Position Feedback (um)\t"
    "X Force (N)\n"
)
DRIVE_LAYOUTS = {
    "Startdrive": Layout(
        "Startdrive",
        ["a.csv"],
        startdrive,
        [
            "--channel",
            "u=r80[0]: Kraftistwert",
            "--channel",
            "y=r482[0]: Encoder 1 Lageistwert XIST1",
            "--time",
            "Zeit",
            *PERIODIC,
        ],
        ("u=r80[0]: Kraftistwert", "y=r482[0]: Encoder 1 Lageistwert XIST1", "--time Zeit"),
    ),
    "Elmo": Layout(
        "Elmo",
        ["a.txt"],
        text_file(
            "a.txt",
            "Application Studio Recording\nResolution: 1000 us\n\nTime [us]\tTorque Command [N]\tPosition [um]\n",
            lines_of("%.10g", 1e6 * TIME, FORCE, POSITION, separator="\t"),
        ),
        ["--channel", "u=Torque Command", "--channel", "y=Position", "--time", "Time", *PERIODIC],
        ("u=Torque Command", "y=Position"),
    ),
    "ACS": Layout(
        "ACS",
        ["a.csv"],
        text_file(
            "a.csv", "Time (msec),CH1: DCOM(0),CH2: FPOS(0)\n", lines_of("%.10g", 1e3 * TIME, FORCE, POSITION / 1e3)
        ),
        ["--channel", "u=CH1: DCOM(0) [N]", "--channel", "y=CH2: FPOS(0) [mm]", "--time", "Time", *PERIODIC],
        ("'u=COLUMN [UNIT]'",),
        "no name or unit shows the input",
    ),
    "ACS, a clock for each channel": Layout(
        "ACS",
        ["a.csv"],
        two_clocks("a.csv", "", "msec"),
        ["--channel", "u=Force", "--channel", "y=Position", *PERIODIC],
        ("u=Force", "y=Position"),
    ),
    "Aerotech": Layout(
        "Aerotech",
        ["a.txt"],
        text_file("a.txt", AUTOMATION_HEAD, lines_of("%.10g", NUMBER, TIME, POSITION, POSITION, FORCE, separator="\t")),
        ["--channel", "u=X Force", "--channel", "y=X Position Feedback", "--time", "Time", *PERIODIC],
        ("u=X Force", "y=X Position Feedback", "reference=X Position Command"),
    ),
    "IndraWorks": Layout(
        "IndraWorks",
        ["a.csv"],
        text_file(
            "a.csv",
            INDRAWORKS_HEAD,
            lines_of("%.10g", 1e6 * TIME, FORCE, POSITION, separator=";", comma=True),
            "latin-1",
        ),
        ["--channel", "u=S-0-0084 [N]", "--channel", "y=S-0-0051 [um]", "--time", "t", *PERIODIC],
        ("'u=COLUMN [UNIT]'",),
        "no name or unit shows the input",
    ),
}
