"""A trial of a friction model: force loop and describing function, redrawn as its parameters are edited."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.timer import Timer
from textual.widgets import Input, Static

from fraexp.components.kinds import FrictionModel
from fraexp.components.parameters import unit_of
from fraexp.data.terminal_text import printable
from fraexp.tui.page import Page, shorten
from fraexp.tui.plotting.panels import SmallPlot, prefixed_text
from fraexp.tui.services.plugin_watch import PluginsChanged
from fraexp.views.entries import ParameterEntry, apply_texts, example_spec, parameter_entries, without_defaults
from fraexp.views.law_trial import TRIAL_STUDY, ForceLoop, LawTrial, SineMotion, trial_overrides
from fraexp.workspace.workspace_service import WorkspaceService

TRIAL_DELAY_S = 0.1
"""Seconds without a key before the law is evaluated."""
STEP_FRACTION = 0.05
"""Fraction by which up and down change a number."""
MOTION_PREFIX = "excitation."
"""Prefix of the paths of the motion."""
MODEL_PREFIX = "friction."
"""Prefix of the paths of the model."""


@dataclass(frozen=True)
class TrialForm:
    """The editable values: the model in plain data, its parameters and those of the motion."""

    base: Mapping[str, object]
    entries: tuple[ParameterEntry, ...]

    @classmethod
    def of(cls, name: str, workspace: WorkspaceService) -> "TrialForm":
        """Return the form of a friction model, with sensible values."""
        registry = workspace.registry
        component = registry.provider(FrictionModel.kind, name).component
        base = example_spec(component, registry)
        own = [
            ParameterEntry(MODEL_PREFIX + one.path, one.info, one.text)
            for one in parameter_entries(component, base, registry)
        ]
        motion = [
            ParameterEntry(MOTION_PREFIX + one.path, one.info, one.text)
            for one in parameter_entries(SineMotion, SineMotion().plain(), registry)
        ]
        return cls(base, (*own, *motion))

    def read(
        self, texts: Mapping[str, str], workspace: WorkspaceService
    ) -> tuple[dict[str, object], SineMotion, list[str]]:
        """Return model, motion, and the overrides of a study for them; FraexpError if the motion is invalid."""
        registry = workspace.registry
        own = {path.removeprefix(MODEL_PREFIX): text for path, text in texts.items() if path.startswith(MODEL_PREFIX)}
        motion = {
            path.removeprefix(MOTION_PREFIX): text for path, text in texts.items() if path.startswith(MOTION_PREFIX)
        }
        sine = SineMotion.parse(apply_texts({}, motion), MOTION_PREFIX[:-1])
        spec = apply_texts(self.base, own)
        component = registry.provider(FrictionModel.kind, str(spec["name"])).component
        return spec, sine, trial_overrides(without_defaults(component, spec, registry), sine)


class NumberInput(Input):
    """An input for a value, which up and down change."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", f"move({STEP_FRACTION})", "more", tooltip="increase by 5 %, or next choice"),
        Binding("down", f"move(-{STEP_FRACTION})", "less", tooltip="decrease by 5 %, or previous choice"),
    ]

    def __init__(self, entry: ParameterEntry) -> None:
        super().__init__(entry.text, compact=True, select_on_focus=False)
        self.entry = entry

    def action_move(self, share: float) -> None:
        """Change the value by a fraction of itself."""
        self.value = self.entry.next_text(self.value, share)
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
        """Show name, value and unit."""
        unit = unit_of(self.entry.info)
        yield Static("", classes="wrong")
        yield Static(Text(self.entry.path.rpartition(".")[2]), classes="name")
        yield NumberInput(self.entry)
        yield Static(Text(unit if unit != "1" else ""), classes="unit")

    @property
    def input(self) -> NumberInput:
        """The input of the value."""
        return self.query_one(NumberInput)

    def blame(self, wrong: bool) -> None:
        """Mark the value as invalid, or as valid."""
        self.query_one(".wrong", Static).update("!" if wrong else "")


class TrialPage(Page):
    """A trial of a friction model."""

    PLACE: ClassVar[str] = "plugins"
    HELP: ClassVar[str] = """
The friction model is driven along y = A sin(2 pi f t). The plots show its force over the displacement, from rest
(dotted) and in steady state, and its describing function N(A), the stiffness of the first harmonic over the amplitude,
in magnitude and phase. 90 degrees is pure loss, 0 degrees a pure spring. The bar marks the amplitude A.
Values may have a unit: 45 um. Tab moves to the next value, up and down change it by 5 %.
The law is evaluated in plain Python; the command at the top computes the same loop compiled, and stores it.
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
        Binding("f6", "turn", "plots", tooltip="show the other plots, if only two fit"),
    ]

    def __init__(self, name: str) -> None:
        super().__init__()
        self._model = name
        self._form: TrialForm | None = None
        self._timer: Timer | None = None
        self._turn = 0
        self._numbers = ""

    def body(self) -> ComposeResult:
        """Show the parameters beside the plots."""
        self.heading = f"friction {self._model}"
        self.command = f"fraexp run {TRIAL_STUDY}"
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
        """Build the form once, as the trial does not depend on the database."""
        if self._form is None:
            await self._build()

    async def _build(self) -> None:
        """Build the form again, and keep the texts of fields that still exist."""
        form = await self.fetch(
            self.app.backend.work(lambda workspace: TrialForm.of(self._model, workspace)), self._show_fault
        )
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
    def _handle_reload(self) -> None:
        self.run_worker(self._build(), group="load", exclusive=True)

    @on(Input.Changed)
    def _handle_input(self) -> None:
        if self._timer:
            self._timer.stop()
        self._timer = self.set_timer(TRIAL_DELAY_S, self._try)

    @on(Input.Submitted)
    def _next(self) -> None:
        self.focus_next(NumberInput)

    def on_descendant_focus(self) -> None:
        """Show the hint of the focused parameter."""
        if isinstance(self.focused, NumberInput):
            entry = self.focused.entry
            self.query_one("#hint", Static).update(Text(printable(f"{entry.path}: {entry.hint}")))

    def _try(self) -> None:
        self._turn += 1
        self.run_worker(self._run_trial(self._turn, self._texts()), group="trial", exclusive=True)

    async def _run_trial(self, turn: int, texts: Mapping[str, str]) -> None:
        """Evaluate the law: the loop first, then the describing function."""
        form = self._form
        if form is None:
            return

        def begin(workspace: WorkspaceService) -> tuple[LawTrial, ForceLoop, str]:
            spec, sine, told = form.read(texts, workspace)
            trial = LawTrial(spec, sine, workspace.registry)
            return trial, trial.loop(), workspace.command(TRIAL_STUDY, told)

        found = await self.fetch(self.app.backend.work(begin), self._show_fault)
        if found is None:
            return
        trial, loop, self.command = found
        self._show_fault("")
        self._show_loop(trial, loop)
        wanted = self.app.backend.work(lambda _: trial.describing_function(lambda: self._turn == turn))
        described = await self.fetch(wanted, self._show_fault)
        if described is not None and self._turn == turn:
            self._show_describing(trial, *described)

    def _show_fault(self, text: str) -> None:
        """Show an error, and mark the value that it names."""
        self.query_one("#wrong", Static).update(Text(printable(shorten(text))))
        self.query_one("#numbers", Static).update(Text(f"previous: {self._numbers}" if text else self._numbers))
        named = [field for field in self.query(TrialInput) if _is_named(text, field.entry.path)]
        worst = max(named, key=lambda field: len(field.entry.path), default=None)
        for field in self.query(TrialInput):
            field.blame(field is worst)

    def _show_loop(self, trial: LawTrial, loop: ForceLoop) -> None:
        factor, unit = (1e3, "mm") if trial.sine.amplitude >= 1e-3 else (1e6, "µm")
        panel = self.query_one("#loop", SmallPlot)
        panel.draw(
            [(factor * np.append(loop.displacement, loop.displacement[0]), np.append(loop.force, loop.force[0]))],
            dotted=[(factor * loop.virgin[0], loop.virgin[1])],
            title=f"force [N] over displacement [{unit}]",
        )
        value = loop.describing_function
        phase = f", {round(np.degrees(np.angle(value)), 1) + 0.0:.1f} deg" if value else ""
        stiffness, energy = prefixed_text(abs(value), "N/m"), prefixed_text(loop.energy, "J")
        drift = "" if loop.is_periodic else "; not periodic: the law drifts"
        self._numbers = f"N {stiffness}{phase}, {energy}/cycle{drift}"
        self.query_one("#numbers", Static).update(Text(self._numbers))

    def _show_describing(
        self, trial: LawTrial, amplitudes: NDArray[np.float64], values: NDArray[np.complex128]
    ) -> None:
        known = np.abs(values) > 0
        x, here = np.log10(amplitudes[known]), float(np.log10(trial.sine.amplitude))
        self.query_one("#magnitude", SmallPlot).draw([(x, np.log10(np.abs(values[known])))], bar=here)
        self.query_one("#phase", SmallPlot).draw([(x, np.degrees(np.angle(values[known])))], bar=here)

    def action_turn(self) -> None:
        """Show the other plots."""
        self.toggle_class("-turned")


def _is_named(text: str, path: str) -> bool:
    """Return whether an error names a parameter, by its path or the last part of it."""
    words = text.replace("'", " ").replace(":", " ").replace(",", " ").replace(";", " ").split()
    inner = path.removeprefix(MODEL_PREFIX).removeprefix(MOTION_PREFIX)
    return any(word == inner or word.endswith(f".{inner}") or path.endswith(f".{word}") for word in words)
