"""Images in terminals by kitty's protocol."""

import re
from base64 import standard_b64decode
from io import BytesIO
from pathlib import Path

import pytest
from PIL import Image

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.cli.terminal_graphics import has_graphics, image_text
from fraexp.data.sweep import Sweep
from fraexp.errors import FraexpError
from fraexp.views.words import short_key

SEQUENCE = re.compile(r"\x1b_G([^;]*);([A-Za-z0-9+/=]*)\x1b\\")


def shown_images(text: str) -> list[tuple[dict[str, str], bytes]]:
    """Return keys and data of each image, as a terminal reads them."""
    images: list[tuple[dict[str, str], bytes]] = []
    keys: dict[str, str] = {}
    data = ""
    for control, chunk in SEQUENCE.findall(text):
        assert len(chunk) <= 4096
        given = dict(pair.split("=") for pair in control.split(","))
        keys, data = {**keys, **given}, data + chunk
        if given["m"] == "0":
            images.append((keys, standard_b64decode(data)))
            keys, data = {}, ""
    assert not data, "the last image is complete"
    return images


@pytest.mark.parametrize("size", [1, 3072, 3073, 10_000])
def test_a_terminal_reads_the_same_bytes(size: int) -> None:
    data = bytes(number % 251 for number in range(size))
    ((keys, read),) = shown_images(image_text(data, 80))
    assert read == data
    assert (keys["a"], keys["f"], keys["c"], keys["q"]) == ("T", "100", "80", "2")


def test_terminals_are_known_by_their_variables_and_switched() -> None:
    assert has_graphics({"TERM": "xterm-kitty"}, True)
    assert has_graphics({"TERM": "xterm-256color", "TERM_PROGRAM": "WezTerm"}, True)
    assert not has_graphics({"TERM": "xterm-256color"}, True)
    assert not has_graphics({"TERM": "xterm-kitty"}, False), "a file is no terminal"
    assert not has_graphics({"TERM": "screen", "KITTY_WINDOW_ID": "1", "TMUX": "/tmp/tmux"}, True)
    assert not has_graphics({"TERM": "xterm-kitty", "FRAEXP_GRAPHICS": "none"}, True)
    assert has_graphics({"FRAEXP_GRAPHICS": "kitty"}, False)
    with pytest.raises(FraexpError, match="FRAEXP_GRAPHICS is 'kity'; expected kitty or none; did you mean 'kitty'"):
        has_graphics({"FRAEXP_GRAPHICS": "kity"}, True)


def test_each_unit_of_responses_is_an_image(
    workspace: Path, sweeps: list[Sweep], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FRAEXP_GRAPHICS", "kitty")
    monkeypatch.setenv("COLUMNS", "90")
    keys = [short_key(of.key) for of in sweeps[:2]]
    assert main(["plot", *keys, "--terminal", "--workspace", str(workspace)]) == ExitCode.OK
    ((keys_of, png),) = shown_images(capsys.readouterr().out)
    assert keys_of["c"] == "90"
    assert Image.open(BytesIO(png)).format == "PNG"
