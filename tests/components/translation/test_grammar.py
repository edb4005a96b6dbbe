"""Structured Text that is generated, and the PLC's function block, obey the language's grammar."""

import pytest
from fraexp_plugins.machines.ads import BLOCK_SOURCE

from fraexp.components.kinds import FrictionModel
from fraexp.components.registry import Registry, create
from fraexp.components.translation.structured_text import st_text
from tests.components.translation.compiled import friction_block
from tests.components.translation.grammar import grammar_error
from tests.components.translation.test_laws import LAWS

DEFECTS = {
    "branch": ("END_IF", ""),
    "condition": ("THEN", ""),
    "declaration": ("END_VAR", "END_VARS"),
    "operator": (" * ", " ** * "),
    "type": (" : LREAL", " : "),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["gms", "elastoplastic", "positioned", "nested"])
def test_laws_are_structured_text(registry: Registry, name: str) -> None:
    block = friction_block(create(registry, FrictionModel, LAWS[name]), name)
    assert grammar_error(st_text([block], "axis", ["a note"])) is None


def test_the_function_block_of_a_twincat_machine_is_structured_text() -> None:
    assert grammar_error(BLOCK_SOURCE.read_text("utf-8")) is None


@pytest.mark.parametrize("defect", DEFECTS)
def test_the_grammar_notices_defects(defect: str) -> None:
    text, (sound, broken) = BLOCK_SOURCE.read_text("utf-8"), DEFECTS[defect]
    assert sound in text
    assert grammar_error(text.replace(sound, broken, 1)) is not None
