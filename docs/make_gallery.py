"""Figures with the study behind each: a page of the site, and the figures in docs/figures.

python docs/make_gallery.py FILE.png ...   # runs the studies of these figures, and writes them to docs/figures
"""

import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).resolve().parent
COLOURS = 256
"""Colours of a figure: lines and text need no more, and a file is a third as large."""


@dataclass(frozen=True)
class Entry:
    """A figure of the gallery."""

    study: str
    file: str
    shows: str
    """What one sees, for readers who do not see it."""
    page: str
    """The page that explains more, with its title."""


ENTRIES = [
    Entry(
        "paper/fig12",
        "fig12.png",
        "Bode plot: two conventional responses that differ by 42 dB at 1 Hz, and two proposed ones on the plant",
        "[Concepts](concepts.md#the-loop-and-its-signals)",
    ),
    Entry(
        "paper/fig14_likelihood",
        "fig14_likelihood.png",
        "Bode plot: with ΣF_m 10 % wrong the proposed response is 40 dB off at 1 Hz, maximum likelihood on the plant",
        "[Methods](methods.md#a-friction-model-that-need-not-be-right)",
    ),
    Entry(
        "methods/comparison",
        "comparison.png",
        "Error of each method against the plant over frequency",
        "[Methods](methods.md#comparison)",
    ),
    Entry(
        "methods/maximum_likelihood",
        "maximum_likelihood.png",
        "Error of the proposed method and of maximum likelihood, both with a friction model that is 20 % wrong",
        "[Methods](methods.md#a-friction-model-that-need-not-be-right)",
    ),
    Entry(
        "methods/amplitude_map",
        "amplitude_map.png",
        "Maps of magnitude and phase error over frequency and amplitude: red near the modes, blue below them",
        "[Figures and reports](figures-and-reports.md)",
    ),
    Entry(
        "friction/hysteresis",
        "hysteresis.png",
        "Six loops of friction force over displacement, from a rectangle (Coulomb) to slender leaves (rolling, GMS)",
        "[Friction laws](reference/friction.md)",
    ),
    Entry(
        "contacts/ball_screw",
        "ball_screw.png",
        "Bode plot from motor to table: two conventional responses that differ, and proposed ones on the plant",
        "[Machines with several contacts](contacts.md)",
    ),
    Entry(
        "paper/fig08_identified",
        "identified.png",
        "Position over target after a step: the design on the conventional response overshoots, two others settle",
        "[From response to motion](identification.md)",
    ),
    Entry(
        "positioning/robustness",
        "robustness.png",
        "Distributions of overshoot, settling time and peak thrust over 200 machines",
        "[Random draws](studies.md#random-draws)",
    ),
]


def main(files: list[str]) -> None:
    """Draw the figures that are named."""
    for entry in ENTRIES:
        if entry.file in files:
            _draw(entry)
            print(DOCS / "figures" / entry.file)


def page() -> str:
    """Return the text of the gallery."""
    lines = ["# Gallery", ""]
    lines += ["Each figure is drawn by one command from a study that comes with fraexp. It is written to `figures/` in"]
    lines += ["the workspace; `fraexp plot` draws stored results again, as PNG, SVG or PDF."]
    for entry in ENTRIES:
        study = tomllib.loads((DOCS.parent / "studies" / f"{entry.study}.toml").read_text("utf-8"))
        lines += ["", f"## {study['title']}", "", study["question"], "", f"![{entry.shows}](figures/{entry.file})"]
        lines += ["", "```text", f"fraexp run {entry.study}", "```", "", f"Study: `studies/{entry.study}.toml`. "]
        lines[-1] += f"More: {entry.page}."
    return "\n".join(lines) + "\n"


def _draw(entry: Entry) -> None:
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "fraexp", "run", entry.study], cwd=folder, check=True)
        with Image.open(Path(folder) / "figures" / f"{entry.study}.png") as drawn:
            image = drawn.convert("RGB")
    reduced = image.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    reduced.save(DOCS / "figures" / entry.file, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1:])
