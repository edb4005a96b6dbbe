"""The letters of the literature for the parameters of a modal plant."""


def parameter_symbol(name: str) -> str:
    """Return the literature's letter for a parameter, such as f1 for frequencies.0."""
    head, _, number = name.partition(".")
    letters = {"rigid_body_gain": "k0", "frequencies": "f", "damping_ratios": "ζ", "modal_gain_ratios": "r"}
    letters |= {"viscous_coefficient": "D", "dead_time": "L"}
    return letters[head] + (str(int(number) + 1) if number else "") if head in letters else name
