"""Draw what benchmarks/peer_table.py --json FILE has measured: python benchmarks/peer_figure.py FILE PNG."""

import json
import sys
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

OWN, OTHERS = "#1b6ca8", "#b9c3cc"


def main(source: Path, target: Path) -> None:
    """Draw simulated seconds per second of computing, with the error of each, fastest on top."""
    rows = sorted(json.loads(source.read_text(encoding="utf-8")), key=lambda row: row["speed"])
    figure = Figure(figsize=(8, 0.8 + 0.26 * len(rows)), layout="constrained")
    axes = figure.subplots()
    colours = [OWN if row["name"] == "fraexp" else OTHERS for row in rows]
    axes.barh(range(len(rows)), [row["speed"] for row in rows], color=colours, height=0.75)
    axes.set_yticks(range(len(rows)), [f"{row['name']}, {row['settings']}" for row in rows], fontsize=8)
    for place, row in enumerate(rows):
        text = f" {row['speed']:,.3g}   error {row['error']:.0e}"
        axes.text(row["speed"], place, text, va="center", fontsize=7.5, color="#333333")
    axes.set_xscale("log")
    axes.set_xlim(right=40 * max(row["speed"] for row in rows))
    axes.set_ylim(-0.6, len(rows) - 0.4)
    axes.set_xlabel("simulated seconds per second of computing, one core")
    axes.set_title("The paper's closed loop with 20 friction elements", loc="left", fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)
    FigureCanvasAgg(figure).print_figure(target, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
