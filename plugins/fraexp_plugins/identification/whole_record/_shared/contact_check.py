"""The refusal of records of machines with friction at several contacts, or with several thrusts."""

from fraexp.api import RecordError, Signals

FRICTION_PREFIX = "friction."
"""Start of the name of a simulated channel with the friction force at a contact, if the plant has several."""


CONTROL_INPUT_PREFIX = "u."
"""Start of the name of a channel with the control input of a thrust that is not excited."""


def check_one_thrust(signals: Signals, estimator: str) -> None:
    """Raise RecordError if a record has control inputs of thrusts that hold a position while another is excited."""
    thrusts = [
        name.removeprefix(CONTROL_INPUT_PREFIX) for name in signals.units if name.startswith(CONTROL_INPUT_PREFIX)
    ]
    if thrusts:
        raise RecordError(
            f"{estimator}: thrusts that are not excited move the machine too ({', '.join(thrusts)}), and a replay has "
            "one thrust; use multi_contact_effective_input"
        )


def check_one_contact(signals: Signals, estimator: str) -> None:
    """Raise RecordError if a simulated record shows friction at more than one contact.

    A measured record does not say so; what the model leaves of it does. Further thrusts are refused as well.
    """
    check_one_thrust(signals, estimator)
    forces = [name for name in signals.units if name.startswith(FRICTION_PREFIX)]
    contacts = [
        name.removeprefix(FRICTION_PREFIX)
        for name in forces
        if any(segment.channels[name].any() for segment in signals.segments)
    ]
    if len(contacts) > 1:
        raise RecordError(
            f"{estimator}: the machine has friction at {len(contacts)} contacts ({', '.join(contacts)}); expected one, "
            "as the plant that is fitted has it: use multi_contact_maximum_likelihood or multi_contact_effective_input"
        )
