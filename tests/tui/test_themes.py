"""The colours of the themes: every text can be read, and a state is known without its colour."""

import pytest
from textual.color import Color

from fraexp.data.results import Outcome
from fraexp.tui.plotting.curve_styles import ON_DARK, ON_LIGHT
from fraexp.tui.services.themes import DARK, LIGHT, STATE_SIGNS, state_cell, state_sign

AA_TEXT, AA_GRAPHICS = 4.5, 3.0
"""Contrasts of WCAG 2.2: 1.4.3 for texts, 1.4.11 for graphical objects."""
TEXTS = (
    "foreground", "text-muted", "text-disabled", "text-error", "text-success", "text-warning", "text-accent",
    "primary", "accent", "error", "success", "warning", "axis", "footer-description-foreground",
)  # fmt: skip
GROUNDS = ("background", "surface", "panel")


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
