"""The colours of the themes: every text can be read, and a state is known without its colour."""

import pytest
from rich.style import Style
from textual.color import Color
from textual.pilot import Pilot
from textual.theme import BUILTIN_THEMES

from fraexp.data.results import Outcome
from fraexp.tui.app import FraexpApp
from fraexp.tui.plotting.curve_styles import ON_DARK, ON_LIGHT
from fraexp.tui.services.themes import DARK, LIGHT, STATE_SIGNS, rich_colour, state_cell, state_sign
from fraexp.tui.widgets.paged_table import PagedTable
from tests.tui.pilots import pilot_of, screen_text, settle, shows
from tests.tui.test_snapshots import SCREENS, store_examples, walk

AA_TEXT, AA_GRAPHICS = 4.5, 3.0
"""Contrasts of WCAG 2.2: 1.4.3 for texts, 1.4.11 for graphical objects."""
TEXTS = (
    "foreground", "text-muted", "text-disabled", "text-error", "text-success", "text-warning", "text-accent",
    "primary", "accent", "error", "success", "warning", "axis", "footer-description-foreground",
)  # fmt: skip
GROUNDS = ("background", "surface", "panel")
THEMES = {**BUILTIN_THEMES, DARK.name: DARK, LIGHT.name: LIGHT}
PAGES = SCREENS | {
    "plugins": (("p",), ("friction",)),
    "trial": (("p", "slash", *"lugre", "enter", "enter"), ("|N| [N/m] over amplitude [m]",)),
}
"""The screens that have a snapshot, and those whose content changes with each plugin."""


def colours_of(name: str) -> dict[str, str]:
    return {**THEMES[name].to_color_system().generate(), **THEMES[name].variables}


def luminance(text: str) -> float:
    parts = [part / 255 for part in Color.parse(text).rgb]
    linear = [part / 12.92 if part <= 0.03928 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("theme", [DARK, LIGHT], ids=lambda theme: theme.name)
def test_every_text_stands_out_on_every_ground(theme):
    colours = {**theme.to_color_system().generate(), **theme.variables}
    grounds = [ground for ground in GROUNDS if ground != "panel"]
    pairs = [(text, ground) for text in TEXTS for ground in grounds]
    pairs += [
        (text, "panel") for text in ("foreground", "text-muted", "primary", "accent", "footer-description-foreground")
    ]
    pairs += [(f"{of}-foreground", f"{of}-background") for of in ("block-cursor", "block-cursor-blurred")]
    found = {pair: contrast(colours[pair[0]], colours[pair[1]]) for pair in pairs}
    assert {pair: value for pair, value in found.items() if value < AA_TEXT} == {}


@pytest.mark.parametrize(("theme", "curves"), [(DARK, ON_DARK), (LIGHT, ON_LIGHT)])
def test_every_curve_stands_out_on_the_ground_of_its_theme(theme, curves):
    assert min(contrast(colour, str(theme.background)) for colour in curves) >= AA_GRAPHICS
    assert len(set(curves)) == len(curves)


def test_each_state_has_a_sign_that_tells_it_without_its_colour():
    colours = {state_sign(state)[1] for state in STATE_SIGNS}
    signs = {colour: {sign for sign, of in STATE_SIGNS.values() if of == colour} for colour in colours}
    assert all(not signs[one] & signs[other] for one in colours for other in colours if one != other)


@pytest.mark.parametrize(
    ("state", "sign"),
    [("complete", "●"), ("running 40 %", "▶"), ("1 interrupted", "■"), ("diverged", "✗"), ("no motion", "✗"),
     ("running, silent for 5 min", "▶"), ("inaccurate", "◐")],
)  # fmt: skip
def test_a_state_is_known_by_its_first_words(state, sign):
    assert state_cell(state) == f"{sign} {state}"


def test_no_outcome_but_the_usable_ones_looks_fine():
    fine = {outcome for outcome in Outcome if state_sign(outcome.name.lower().replace("_", " "))[1] == "success"}
    assert fine == {Outcome.OK}


@pytest.mark.parametrize("name", THEMES)
def test_each_colour_of_a_theme_can_be_a_style_of_rich(name):
    colours = colours_of(name)
    for colour in (name for name, text in colours.items() if name in TEXTS or text.startswith(("#", "auto", "ansi_"))):
        assert Style.parse(f"bold {rich_colour(colours, colour)}").color is not None


def test_a_muted_text_stands_out_less_than_others():
    colours = THEMES["nord"].to_color_system().generate()
    ground, muted, full = (rich_colour(colours, name) for name in ("background", "text-muted", "foreground"))
    assert AA_TEXT <= contrast(muted, ground) < contrast(full, ground)


@pytest.mark.thorough
def test_each_theme_can_draw_each_page(tmp_path):
    """An error would end the terminal UI."""
    store_examples(tmp_path)
    drawn = set()

    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        app.theme = next(iter(THEMES))
        async for name in walk(app, pilot, PAGES):
            for theme in THEMES:
                app.theme = theme
                await pilot.pause()
                assert screen_text(app).strip()
                drawn.add((name, theme))

    pilot_of(tmp_path, steps, size=(100, 30))
    assert drawn == {(name, theme) for name in [*PAGES, "measurement"] for theme in THEMES}


def test_a_table_takes_the_colours_of_another_theme(tmp_path):
    store_examples(tmp_path)

    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        await pilot.press("r")
        await shows(pilot, "rows 1-1 of 1")
        for theme in (LIGHT, DARK):
            app.theme = theme.name
            await settle(pilot)
            cell = next(of for of in app.screen.query_one(PagedTable).get_row_at(0) if "complete" in of.plain)
            assert str(cell.style) == theme.success

    pilot_of(tmp_path, steps)
