"""Trying a friction model: its force loop and describing function, redrawn while its parameters are typed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.timer import Timer
from textual.widgets import Input, Static

from fraexp.components.kinds import FrictionModel
from fraexp.components.parameters import unit_of
from fraexp.figures.elements.labels import printable
from fraexp.tui.page import Page, shortened
from fraexp.tui.plotting.panels import SmallPlot, scaled
from fraexp.tui.services.plugin_watch import PluginsChanged
from fraexp.views.entries import ParameterEntry, entries, example, told, written
from fraexp.views.law_trial import STUDY, ForceLoop, Sine, Trial, overrides
from fraexp.workspace.workspace import Workspace

PAUSE = 0.1
"""Seconds without a key before the law is tried."""
SHARE = 0.05
"""Share by which up and down change a number."""
MOTION = "excitation."
"""Begin of the paths that are the motion's."""
OWN = "friction."
"""Begin of the paths that are the model's."""


@dataclass(frozen=True)
class Form:
    """What can be written: the model in plain data, its parameters and those of the motion."""

    base: Mapping[str, Any]
    entries: tuple[ParameterEntry, ...]

    @classmethod
    def of(cls, name: str, workspace: Workspace) -> "Form":
        """Return the form of a friction model, with sensible values."""
        registry = workspace.registry
        component = registry.supply(FrictionModel.kind, name).component
        base = example(component, registry)
        own = [ParameterEntry(OWN + one.path, one.info, one.text) for one in entries(component, base, registry)]
        motion = [
            ParameterEntry(MOTION + one.path, one.info, one.text) for one in entries(Sine, Sine().plain(), registry)
        ]
        return cls(base, (*own, *motion))

    def read(self, texts: Mapping[str, str], workspace: Workspace) -> tuple[dict[str, Any], Sine, list[str]]:
        """Return model, motion, and what a study is to be told for them; FraexpError if the motion is none."""
        registry = workspace.registry
        own = {path.removeprefix(OWN): text for path, text in texts.items() if path.startswith(OWN)}
        motion = {path.removeprefix(MOTION): text for path, text in texts.items() if path.startswith(MOTION)}
        sine = Sine.parse(written({}, motion), MOTION[:-1])
        spec = written(self.base, own)
        component = registry.supply(FrictionModel.kind, str(spec["name"])).component
        return spec, sine, overrides(told(component, spec, registry), sine)


class NumberInput(Input):
    """A line for a value, which up and down change."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", f"move({SHARE})", "more", id="trial.more", tooltip="5 % more, or the next of few values"),
        Binding("down", f"move(-{SHARE})", "less", id="trial.less", tooltip="5 % less, or the one before"),
    ]

    def __init__(self, entry: ParameterEntry) -> None:
        super().__init__(entry.text, compact=True, select_on_focus=False)
        self.entry = entry

    def action_move(self, share: float) -> None:
        """Change the value by a share of itself."""
        self.value = self.entry.moved(self.value, share)
        self.cursor_position = len(self.value)


class TrialInput(Horizontal):
    """A parameter's name, value and unit."""

    DEFAULT_CSS = """
    TrialInput { height: 1; }
    TrialInput > .wrong { width: 2; color: $text-error; }
    TrialInput > .name { width: 45%; text-wrap: nowrap; text-overflow: ellipsis; padding-right: 1; }
    TrialInput > NumberInput { width: 1fr; background: $surface; }
    TrialInput > NumberInput:focus { background: $panel-lighten-1; text-style: bold; }
    TrialInput > .unit { width: 7; padding-left: 1; }
    """

    def __init__(self, entry: ParameterEntry) -> None:
        super().__init__()
        self.entry = entry

    def compose(self) -> ComposeResult:
        """Show them."""
        unit = unit_of(self.entry.info)
        yield Static("", classes="wrong")
        yield Static(Text(self.entry.path.rpartition(".")[2]), classes="name")
        yield NumberInput(self.entry)
        yield Static(Text(unit if unit != "1" else ""), classes="unit")

    @property
    def input(self) -> NumberInput:
        """Where the value stands."""
        return self.query_one(NumberInput)

    def blame(self, wrong: bool) -> None:
        """Tell whether the value is what is wrong."""
        self.query_one(".wrong", Static).update("!" if wrong else "")


class TrialPage(Page):
    """A friction model to be tried."""

    PLACE: ClassVar[str] = "plugins"
    HELP: ClassVar[str] = """
The friction model is driven along y = A sin(2 pi f t) and drawn: its force over the displacement, from rest (dotted)
and once it repeats itself; and its describing function N(A), the stiffness of the first harmonic over the amplitude, in
magnitude and phase. 90 degrees is all loss, 0 degrees is all spring. The bar marks the amplitude A.
Values may have a unit: 45 um. Tab goes on to the next one, up and down change it by 5 %.
The law is computed in plain Python, at once; the command at the top drives it in the same way, compiled, and stores it.
"""
    DEFAULT_CSS = """
    TrialPage #form { width: 34; }
    TrialPage.-wide #form { width: 56; }
    TrialPage #fields { height: 1fr; }
    TrialPage .title { text-style: bold; padding: 0 2; }
    TrialPage #hint { height: auto; max-height: 5; padding: 0 1; border-top: solid $panel-lighten-2; }
    TrialPage #wrong { height: auto; max-height: 9; padding: 0 1; color: $text-error; text-style: bold; }
    TrialPage #numbers { height: auto; padding: 0 1; }
    TrialPage.-low #phase { display: none; }
    TrialPage.-low.-turned #phase { display: block; }
    TrialPage.-low.-turned #loop { display: none; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f6", "turn", "plots", id="trial.plots", tooltip="show the other plots, where two fit"),
    ]

    def __init__(self, name: str) -> None:
        super().__init__()
        self._model = name
        self._form: Form | None = None
        self._timer: Timer | None = None
        self._turn = 0
        self._numbers = ""

    def body(self) -> ComposeResult:
        """Show the parameters beside what comes of them."""
        self.heading = f"friction {self._model}"
        self.command = f"fraexp run {STUDY}"
        with Horizontal():
            with Vertical(id="form"):
                yield VerticalScroll(id="fields", can_focus=False)
                yield Static(id="wrong")
                yield Static(id="hint")
            with Vertical(id="plots"):
                yield Static(id="numbers")
                yield SmallPlot("force [N]", id="loop")
                yield SmallPlot("|N| [N/m] over amplitude [m]", x_decades=True, y_decades=True, id="magnitude")
                yield SmallPlot("phase of N [deg] over amplitude [m]", x_decades=True, id="phase")

    async def load(self) -> None:
        """Make the form, once; what is tried does not depend on the database."""
        if self._form is None:
            await self._make()

    async def _make(self) -> None:
        """Make the form anew, and keep what was written in fields that are still there."""
        form = await self.fetch(self.app.desk.work(lambda workspace: Form.of(self._model, workspace)), self._complain)
        if form is None:
            return
        kept = self._texts()
        place = self.query_one("#fields", VerticalScroll)
        fields = [TrialInput(ParameterEntry(one.path, one.info, kept.get(one.path, one.text))) for one in form.entries]
        await place.remove_children()
        groups: dict[str, list[TrialInput]] = {}
        for field in fields:
            groups.setdefault(field.entry.path.rpartition(".")[0], []).append(field)
        titles = {group: Static(Text(printable(group)), classes="title") for group in groups}
        await place.mount(*(line for group, those in groups.items() for line in (titles[group], *those)))
        self._form = form
        fields[0].input.focus()
        self._try()

    def _texts(self) -> dict[str, str]:
        return {field.entry.path: field.input.value for field in self.query(TrialInput)}

    @on(PluginsChanged)
    def _loaded_anew(self) -> None:
        self.run_worker(self._make(), group="load", exclusive=True)

    @on(Input.Changed)
    def _typed(self) -> None:
        if self._timer:
            self._timer.stop()
        self._timer = self.set_timer(PAUSE, self._try)

    @on(Input.Submitted)
    def _next(self) -> None:
        self.focus_next(NumberInput)

    def on_descendant_focus(self) -> None:
        """Tell what the parameter is whose turn it is."""
        if isinstance(self.focused, NumberInput):
            entry = self.focused.entry
            self.query_one("#hint", Static).update(Text(printable(f"{entry.path}: {entry.hint}")))

    def _try(self) -> None:
        self._turn += 1
        self.run_worker(self._tried(self._turn, self._texts()), group="trial", exclusive=True)

    async def _tried(self, turn: int, texts: Mapping[str, str]) -> None:
        """Try the law with what is written: the loop first, then the describing function."""
        form = self._form
        if form is None:
            return

        def begin(workspace: Workspace) -> tuple[Trial, ForceLoop, str]:
            spec, sine, told = form.read(texts, workspace)
            trial = Trial(spec, sine, workspace.registry)
            return trial, trial.loop(), workspace.command(STUDY, told)

        found = await self.fetch(self.app.desk.work(begin), self._complain)
        if found is None:
            return
        trial, loop, self.command = found
        self._complain("")
        self._show_loop(trial, loop)
        wanted = self.app.desk.work(lambda _: trial.describing_function(lambda: self._turn == turn))
        described = await self.fetch(wanted, self._complain)
        if described is not None and self._turn == turn:
            self._show_describing(trial, *described)

    def _complain(self, text: str) -> None:
        """Tell what is wrong, and by which value."""
        self.query_one("#wrong", Static).update(Text(printable(shortened(text))))
        self.query_one("#numbers", Static).update(Text(f"before: {self._numbers}" if text else self._numbers))
        named = [field for field in self.query(TrialInput) if _names(text, field.entry.path)]
        worst = max(named, key=lambda field: len(field.entry.path), default=None)
        for field in self.query(TrialInput):
            field.blame(field is worst)

    def _show_loop(self, trial: Trial, loop: ForceLoop) -> None:
        factor, unit = (1e3, "mm") if trial.sine.amplitude >= 1e-3 else (1e6, "um")
        panel = self.query_one("#loop", SmallPlot)
        panel.draw(
            [(factor * np.append(loop.displacement, loop.displacement[0]), np.append(loop.force, loop.force[0]))],
            dotted=[(factor * loop.virgin[0], loop.virgin[1])],
            title=f"force [N] over displacement [{unit}]",
        )
        value = loop.describing
        phase = f", {round(np.degrees(np.angle(value)), 1) + 0.0:.1f} deg" if value else ""
        stiffness, energy = scaled(abs(value), "N/m"), scaled(loop.energy, "J")
        drift = "" if loop.closed else "; it does not repeat itself: the law drifts"
        self._numbers = f"N {stiffness}{phase}, {energy}/cycle{drift}"
        self.query_one("#numbers", Static).update(Text(self._numbers))

    def _show_describing(self, trial: Trial, amplitudes: np.ndarray, values: np.ndarray) -> None:
        known = np.abs(values) > 0
        x, here = np.log10(amplitudes[known]), float(np.log10(trial.sine.amplitude))
        self.query_one("#magnitude", SmallPlot).draw([(x, np.log10(np.abs(values[known])))], bar=here)
        self.query_one("#phase", SmallPlot).draw([(x, np.degrees(np.angle(values[known])))], bar=here)

    def action_turn(self) -> None:
        """Show the other plots."""
        self.toggle_class("-turned")


def _names(text: str, path: str) -> bool:
    """Return whether a complaint names a parameter: in whole, or by its last part."""
    words = text.replace("'", " ").replace(":", " ").replace(",", " ").replace(";", " ").split()
    inner = path.removeprefix(OWN).removeprefix(MOTION)
    return any(word == inner or word.endswith(f".{inner}") or path.endswith(f".{word}") for word in words)
