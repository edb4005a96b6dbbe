"""A trial of a friction model: force loop and describing function, redrawn as its parameters are edited."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.widgets import Static

from fraexp.components.kinds import FrictionModel
from fraexp.components.parameters import unit_of
from fraexp.data.texts import printable
from fraexp.errors import errors_within
from fraexp.tui.page import LOAD_GROUP, shorten
from fraexp.tui.plotting.plot_stack import PlotStack
from fraexp.tui.plotting.plotted_curves import REFERENCE, Picture, PlotPanel, PlotTrace
from fraexp.tui.services.launch_form import FieldGroup, FormField
from fraexp.tui.services.plugin_watch import PluginsChanged
from fraexp.tui.widgets.field_list import FieldList, FormDraft, FormPage
from fraexp.views.entries import ParameterEntry, apply_texts, example_spec, parameter_entries, without_defaults
from fraexp.views.law_trial import TRIAL_STUDY, ForceLoop, SineMotion, SineTrial, trial_overrides
from fraexp.views.words import prefixed_text
from fraexp.workspace.workspace_service import WorkspaceService

BAR = 1
"""Curve of the bar at the amplitude."""
MIN_PLOT_ROWS = 9
"""Minimum height of a plot: the others are shown by a key."""
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
    groups: list[FieldGroup]

    @classmethod
    def of(cls, name: str, workspace: WorkspaceService) -> "TrialForm":
        """Return the form of a friction model, with sensible values."""
        registry = workspace.registry
        component = registry.provider(FrictionModel.kind, name).component
        base = example_spec(component, registry)
        fields = [
            *_fields(MODEL_PREFIX, parameter_entries(component, base, registry)),
            *_fields(MOTION_PREFIX, parameter_entries(SineMotion, SineMotion().plain(), registry)),
        ]
        groups: dict[str, list[FormField]] = {}
        for field in fields:
            groups.setdefault(field.path.rpartition(".")[0], []).append(field)
        return cls(base, [FieldGroup(title, tuple(those)) for title, those in groups.items()])

    def read(self, written: FormDraft, workspace: WorkspaceService) -> tuple[dict[str, object], SineMotion, list[str]]:
        """Return model, motion, and the overrides of a study for them; FraexpError if the motion is invalid."""
        registry = workspace.registry
        texts = {field.path: written.text(field) for group in self.groups for field in group.fields}
        own, motion = (
            {path.removeprefix(prefix): text for path, text in texts.items() if path.startswith(prefix)}
            for prefix in (MODEL_PREFIX, MOTION_PREFIX)
        )
        with errors_within(MOTION_PREFIX[:-1]):
            sine = SineMotion.parse(apply_texts({}, motion), MOTION_PREFIX[:-1])
        spec = apply_texts(self.base, own)
        component = registry.provider(FrictionModel.kind, str(spec["name"])).component
        return spec, sine, trial_overrides(without_defaults(component, spec, registry), sine)


def _fields(prefix: str, entries: Iterable[ParameterEntry]) -> Iterator[FormField]:
    """Yield the lines of parameters."""
    for entry in entries:
        last = entry.path.rpartition(".")[2]
        yield FormField(
            prefix + entry.path, entry.text, unit_of(entry.info), entry.hint, choices=entry.choices,
            label=last, step=entry.next_text,
        )  # fmt: skip


class TrialPage(FormPage):
    """A trial of a friction model."""

    PLACE: ClassVar[str] = "plugins"
    HELP: ClassVar[str] = """
The friction model is driven along y = A sin(2 pi f t). The plots show its force over the displacement, from rest
(dotted) and in steady state, and its describing function N(A), the stiffness of the first harmonic over the amplitude,
in magnitude and phase. 90 degrees is pure loss, 0 degrees a pure spring. The bar marks the amplitude A.
Values may have a unit: 45 um. Tab moves to the next value, up and down change it by 5 %.
The law is evaluated in plain Python; the command at the top computes the same loop compiled, and stores it.
"""
    CHECK_DELAY_S = 0.1
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", f"step({STEP_FRACTION})", "more", tooltip="increase by 5 %, or next choice", priority=True),
        Binding(
            "down", f"step(-{STEP_FRACTION})", "less", tooltip="decrease by 5 %, or previous choice", priority=True
        ),
        Binding("tab", "next(1)", "next", show=False, tooltip="next value"),
        Binding("shift+tab", "next(-1)", "previous", show=False, tooltip="previous value"),
        Binding("f6", "turn", "plots", tooltip="show the other plots, if only two fit"),
    ]

    def __init__(self, name: str) -> None:
        super().__init__(FormDraft())
        self._model = name
        self._trial: TrialForm | None = None
        self._turn = 0
        self._numbers = ""
        self._panels: tuple[PlotPanel, ...] = ()

    def body(self) -> ComposeResult:
        """Show the parameters beside the plots."""
        self.heading = f"friction {self._model}"
        self.command = f"fraexp run {TRIAL_STUDY}"
        with Horizontal():
            with Vertical(id="form"):
                yield FieldList(self.written)
                yield Static(id="wrong")
                yield Static(id="hint")
            with Vertical(id="plots"):
                yield Static(id="numbers")
                yield PlotStack()

    async def load(self) -> None:
        """Build the form once, as the trial does not depend on the database."""
        if self._trial is None:
            await self._build()

    async def _build(self) -> None:
        """Build the form again; what is written stays where its field still exists."""
        trial = await self.compute(lambda workspace: TrialForm.of(self._model, workspace), self._show_fault)
        if trial is not None:
            self._trial = trial
            self.form.show(trial.groups)
            if self.form.field is None:
                self.action_next(1)
            await self.check()

    @on(PluginsChanged)
    def _handle_reload(self) -> None:
        self.run_worker(self._build(), group=LOAD_GROUP, exclusive=True)

    def action_step(self, share: float) -> None:
        """Change the value of the line by a fraction of itself."""
        if self.form.field is not None:
            self.form.write(self.form.field.step(self.written.text(self.form.field), share))

    async def check(self) -> None:
        """Evaluate the law."""
        self._turn += 1
        self.run_worker(self._run_trial(self._turn), group="trial", exclusive=True)

    async def _run_trial(self, turn: int) -> None:
        """Evaluate the law: the loop first, then the describing function."""
        form = self._trial
        if form is None:
            return

        def begin(workspace: WorkspaceService) -> tuple[SineTrial, ForceLoop, str]:
            spec, sine, told = form.read(self.written, workspace)
            with errors_within(MODEL_PREFIX[:-1]):
                trial = SineTrial(spec, sine, workspace.registry)
                return trial, trial.loop(), workspace.command(TRIAL_STUDY, told)

        found = await self.compute(begin, self._show_fault)
        if found is None:
            return
        trial, loop, self.command = found
        self._show_fault("")
        self._show_loop(trial, loop)
        described = await self.compute(
            lambda _: trial.describing_function(lambda: self._turn == turn), self._show_fault
        )
        if described is not None and self._turn == turn:
            self._show_describing(trial, *described)

    def _show_fault(self, text: str) -> None:
        """Show an error, and mark the value that it names."""
        self.query_one("#wrong", Static).update(Text(printable(shorten(text))))
        self.query_one("#numbers", Static).update(Text(f"previous: {self._numbers}" if text else self._numbers))
        self.mark_fault(self.fault if text else None)

    def _show_loop(self, trial: SineTrial, loop: ForceLoop) -> None:
        factor, unit = (1e3, "mm") if trial.sine.amplitude >= 1e-3 else (1e6, "µm")
        closed = (np.append(values, values[0]) for values in (factor * loop.displacement, loop.force))
        traces = _trace(0, *closed), _trace(REFERENCE, factor * loop.virgin[0], loop.virgin[1])
        self._show_panels(PlotPanel(f"force [N] over displacement [{unit}]", "N", "", traces), *self._panels[1:])
        value = loop.describing_function
        phase = f", {round(np.degrees(np.angle(value)), 1) + 0.0:.1f} deg" if value else ""
        stiffness, energy = prefixed_text(abs(value), "N/m"), prefixed_text(loop.energy, "J")
        drift = "" if loop.is_periodic else "; not periodic: the law drifts"
        self._numbers = f"N {stiffness}{phase}, {energy}/cycle{drift}"
        self.query_one("#numbers", Static).update(Text(self._numbers))

    def _show_describing(
        self, trial: SineTrial, amplitudes: NDArray[np.float64], values: NDArray[np.complex128]
    ) -> None:
        known = np.abs(values) > 0
        x, here = np.log10(amplitudes[known]), float(np.log10(trial.sine.amplitude))
        panels = []
        for title, y in (("|N| [N/m]", np.log10(np.abs(values[known]))), ("phase of N [deg]", _degrees(values[known]))):
            ends = np.array([y.min(), y.max()]) if y.size else np.empty(0)
            traces = _trace(0, x, y), _trace(BAR, np.full(ends.size, here), ends)
            is_stiffness = title.startswith("|")
            panels.append(PlotPanel(f"{title} over amplitude [m]", "", "", traces, 1, True, decades=is_stiffness))
        self._show_panels(self._panels[0], *panels)

    def _show_panels(self, *panels: PlotPanel) -> None:
        self._panels, stack = panels, self.query_one(PlotStack)
        stack.home()  # another law has other scales
        stack.display_picture(Picture("trial", "", panels), cursor=False)

    def on_mount(self) -> None:
        """Give each plot its room."""
        self.query_one(PlotStack).min_panel_rows = MIN_PLOT_ROWS

    def action_turn(self) -> None:
        """Show the other plots."""
        stack = self.query_one(PlotStack)
        stack.turn(1 if stack.first == 0 else -1)


def _trace(curve: int, x: NDArray[np.float64], y: NDArray[np.float64]) -> PlotTrace:
    return PlotTrace(curve, x, y, np.isfinite(x) & np.isfinite(y), x)


def _degrees(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.asarray(np.degrees(np.angle(values)))
