"""Images in terminals that show them by kitty's graphics protocol: kitty, Ghostty, WezTerm, Konsole.

Source: https://sw.kovidgoyal.net/kitty/graphics-protocol/
"""

from base64 import standard_b64encode
from collections.abc import Mapping

from fraexp.errors import FraexpError, did_you_mean

SWITCH = "FRAEXP_GRAPHICS"
"""Environment variable that overrides the detection."""
KITTY, NONE = "kitty", "none"
CHUNK_SIZE = 4096
"""Maximum number of characters of one escape sequence."""
TERMINALS = {"xterm-kitty", "xterm-ghostty", "ghostty", "wezterm"}
"""Values of TERM and TERM_PROGRAM, in lower case, of terminals with the protocol."""
MULTIPLEXERS = ("TMUX", "STY")
"""Variables of programs that keep images from the terminal."""


def has_graphics(environment: Mapping[str, str], is_terminal: bool) -> bool:
    """Return whether images can be shown, by the variables that terminals set; FraexpError if the switch is invalid.

    A terminal is not asked: its answer would be read by the shell if it came late.
    """
    switch = environment.get(SWITCH, "")
    if switch not in ("", KITTY, NONE):
        raise FraexpError(f"{SWITCH} is '{switch}'; expected {KITTY} or {NONE}{did_you_mean(switch, (KITTY, NONE))}")
    if switch or not is_terminal:
        return switch == KITTY
    names = {environment.get(name, "").lower() for name in ("TERM", "TERM_PROGRAM")}
    known = bool(names & TERMINALS) or "KITTY_WINDOW_ID" in environment or "KONSOLE_VERSION" in environment
    return known and not any(name in environment for name in MULTIPLEXERS)


def image_text(png: bytes, columns: int) -> str:
    """Return the escape sequences that show a PNG in a number of columns; its rows follow from its shape."""
    data = standard_b64encode(png).decode("ascii")
    chunks = [data[at : at + CHUNK_SIZE] for at in range(0, len(data), CHUNK_SIZE)]
    first = f"a=T,f=100,q=2,c={columns},"  # q=2: the terminal does not answer
    return "".join(
        f"\x1b_G{'' if number else first}m={int(number < len(chunks) - 1)};{chunk}\x1b\\"
        for number, chunk in enumerate(chunks)
    )
