"""What is said about an outcome fits its message."""

import pytest

from fraexp.data.results import Outcome


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ("friction takes nearly all of the input below 3.4 Hz", "frequencies that the message does not list"),
        ("the law leaves 4.1 % of the input unexplained: raise the amplitude", "about the whole result: do what"),
        (
            "it stands at 3 of 10 frequencies (2 to 80 Hz): at 80 Hz it may be off",
            "frequencies that the message does not list",
        ),
        ("it stands at 10 of 10 frequencies (2 to 80 Hz): at 80 Hz it may be off", "about the whole result: do what"),
        ("what it leaves of 17 of 17 records (2 to 125 Hz) is too much", "about the whole result: do what"),
        ("", "frequencies that the message does not list"),
    ],
)
def test_an_inaccurate_result_is_used_where_its_message_names_no_frequency(message: str, words: str) -> None:
    assert words in Outcome.INACCURATE.remedy(message)


@pytest.mark.parametrize("outcome", [outcome for outcome in Outcome if outcome is not Outcome.INACCURATE])
def test_other_outcomes_have_one_remedy(outcome: Outcome) -> None:
    assert outcome.remedy("nothing moves") == outcome.remedy("at 2 Hz") == outcome.value
