"""Named values with unit, meaning and bounds: declared once, for TOML, help, forms, docs and tests."""

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Self, cast, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, model_validator
from pydantic.fields import FieldInfo

from fraexp.data import toml, units
from fraexp.data.rotary_axes import rotary_unit, to_rotary_units
from fraexp.errors import ParameterError, did_you_mean

REQUIRED: Any = ...
TYPICAL = {
    "N": 10.0, "N/m": 1e5, "N s/m": 10.0, "N/s": 100.0, "m": 1e-5, "m/s": 1e-3, "s": 1e-3, "Hz": 10.0, "kg": 5.0,
}  # fmt: skip
"""Magnitudes of the field by unit, for examples of parameters without a default."""
ROTARY = {"axis": "rotary"}
"""Context of a validation in which units are those of a rotary axis."""


def param(
    unit: str,
    meaning: str,
    default: Any = REQUIRED,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    inherit: str | None = None,
    beside: str = "",
) -> Any:
    """Declare a parameter: its SI unit ("1" for a pure number, "" for a name), meaning, default and bounds.

    `inherit` names the place in the experiment, such as ``loop.sample_time``, from which a study fills a
    parameter that it does not give, if the one called `beside` is not empty.
    """
    return Field(
        default,
        description=meaning,
        gt=above,
        ge=at_least,
        lt=below,
        le=at_most,
        json_schema_extra={"unit": unit, "inherit": inherit, "beside": beside},
    )


def unit_of(info: FieldInfo, *, rotary: bool = False) -> str:
    """Return the declared unit of a parameter, or what stands for it on a rotary axis."""
    extra = info.json_schema_extra
    unit = str(extra["unit"]) if isinstance(extra, dict) else ""
    return rotary_unit(unit) if rotary else unit


def value_bounds(info: FieldInfo) -> tuple[float | None, float | None]:
    """Return the least and the greatest value of a parameter, inside of exclusive bounds; None where there is none."""
    declared = {word: getattr(item, word) for item in info.metadata for word in BOUND_NAMES if hasattr(item, word)}
    low, high = declared.get("ge"), declared.get("le")
    span = TYPICAL.get(unit_of(info), 1.0)
    if "gt" in declared:
        low = declared["gt"] + 1e-6 * span
    if "lt" in declared:
        high = declared["lt"] - 1e-6 * span
    return low, high


BOUND_NAMES = ("gt", "ge", "lt", "le")


def typical_value(info: FieldInfo) -> float:
    """Return a number that suits a parameter: between two bounds, else typical of its unit and within one."""
    low, high = value_bounds(info)
    if low is not None and high is not None:
        return (low + high) / 2
    value = TYPICAL.get(unit_of(info), 1.0)
    return max(value, low) if low is not None else min(value, high) if high is not None else value


def _kind_of(info: FieldInfo) -> str:
    """Return what a parameter without unit expects."""
    return "table" if get_origin(info.annotation) is dict else "text"


def inherited_from(info: FieldInfo) -> str | None:
    """Return the place in the experiment that fills this parameter, or None."""
    extra = info.json_schema_extra
    place = extra.get("inherit") if isinstance(extra, dict) else None
    return place if isinstance(place, str) else None


def is_inherited(info: FieldInfo, values: Mapping[str, Any]) -> bool:
    """Say whether a parameter that is not given is filled from the experiment, beside the values of those before it."""
    extra = info.json_schema_extra
    beside = extra.get("beside") if isinstance(extra, dict) else None
    return inherited_from(info) is not None and (not beside or bool(values.get(str(beside))))


if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)


class _Constructor(ModelMetaclass, type):
    """What makes a call of a class raise a ParameterError of one line for values that do not fit."""

    def __call__(cls, *values: Any, **named: Any) -> Any:
        owner = cast("type[Parameters]", cls)
        if values:
            raise ParameterError(f"{cls.__name__}: found a value without a name; expected {example_call(owner)}")
        try:
            return super().__call__(**named)
        except ValidationError as error:
            raise _validation_error(owner, cls.__name__, named, error) from None


class Parameters(BaseModel, metaclass=_Constructor):
    """Named values with unit, meaning and bounds; immutable, and plain data when asked."""

    # A validator is built when it is first used: a study uses few of the classes that its components' modules define.
    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, ser_json_inf_nan="null", defer_build=True
    )

    @model_validator(mode="before")
    @classmethod
    def _read_units(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, Mapping):
            return data
        read = dict(data)
        for key, field in cls.model_fields.items():
            if isinstance(read.get(key), bool) and field.annotation in (float, int):
                raise ParameterError(f"{key} is {toml.as_text(read[key])}; expected a number").at("", key)
            if unit_of(field) and read.get(key) is not None:
                try:
                    read[key] = _with_units(read[key], unit_of(field, rotary=info.context == ROTARY))
                except ParameterError as error:
                    raise ParameterError(f"{key}: {error}{_axis_hint(read[key], field, info)}").at("", key) from None
        return read

    @classmethod
    def parse(cls, data: Mapping[str, Any], title: str, *, rotary: bool = False) -> Self:
        """Build from plain data; ParameterError says in one line what does not fit. `title` names the owner.

        Of a `rotary` axis, units that are written with values are those of torques and angles.
        """
        if not isinstance(data, Mapping):
            raise ParameterError(f"{title} is {data!r:.60}; expected a table")
        try:
            return cls.model_validate(data, context=ROTARY if rotary else None)
        except ValidationError as error:
            raise _validation_error(cls, title, data, error, rotary=rotary) from None
        except ParameterError as error:
            if rotary:
                to_rotary_units(error)
            raise error.at(_title_for(title, str(error))) from None

    def plain(self) -> dict[str, Any]:
        """Return plain data from which `parse` builds an equal object."""
        values = {key: getattr(self, key) for key in type(self).model_fields}
        return {key: _plain(value) for key, value in values.items()}

    def spec(self) -> dict[str, Any]:
        """Return the plain data that identifies this object as a value of another one."""
        return self.plain()


def example_call(cls: type[Parameters]) -> str:
    """Return how an object of a class is made: with the parameters that it needs, or with any if it needs none."""
    needed = [name for name, info in cls.model_fields.items() if info.is_required()] or list(cls.model_fields)
    return f"{cls.__name__}({', '.join(f'{name}=...' for name in needed)})"


def _axis_hint(value: Any, field: FieldInfo, info: ValidationInfo) -> str:
    """Return what to do about a unit of the other kind of axis; empty if the value has none."""
    is_rotary = info.context == ROTARY
    try:
        _with_units(value, unit_of(field, rotary=not is_rotary))
    except ParameterError:
        return ""
    return (
        "; loop.rotary = true says that the axis turns" if is_rotary else "; an axis that turns has loop.rotary = true"
    )


def _with_units(value: Any, unit: str) -> Any:
    if isinstance(value, str):
        return units.number(value, unit)
    if isinstance(value, list | tuple):
        return tuple(_with_units(item, unit) for item in value)
    return value


def _plain(value: Any) -> Any:
    if isinstance(value, Parameters):
        return value.spec()
    if isinstance(value, type):
        return getattr(value, "name", value.__name__)  # a component without numbers
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return value


BOUNDS = {"greater_than": "above", "greater_than_equal": "at least", "less_than": "below", "less_than_equal": "at most"}


def _validation_error(
    cls: type[Parameters], title: str, data: Mapping[str, Any], error: ValidationError, *, rotary: bool = False
) -> ParameterError:
    all_found = error.errors(include_url=False)
    found: Any = next(
        (one for one in all_found if one["type"] == "extra_forbidden"), all_found[0]
    )  # a slip of the pen first
    sentence = _validation_sentence(cls, title, data, found, rotary)
    return ParameterError(sentence).at("", ".".join(map(str, found["loc"])))


def _validation_sentence(cls: type[Parameters], title: str, data: Mapping[str, Any], found: Any, rotary: bool) -> str:
    cls, title, data, loc = _innermost_table(cls, title, data, found["loc"])
    place = ".".join(str(part) for part in loc)
    name = str(loc[0]) if loc else ""
    info = cls.model_fields.get(name)
    unit = units.with_powers(unit_of(info, rotary=rotary)) if info is not None else ""
    match found["type"]:
        case "extra_forbidden":
            return f"{title} has no parameter '{name}'{did_you_mean(name, cls.model_fields)}"
        case "tuple_type" if info is not None and len(loc) == 1:
            given = json.dumps(data[name], default=str)
            what = f"{info.description}, {unit or _kind_of(info)}"
            return f"{title}.{name} is {given} ({what}); expected a list, such as [{given}]"
        case "missing" if info is not None:
            source = inherited_from(info)
            remedy = f"; state it here, or '{source}' in the study" if source else ""
            return f"{title} lacks '{name}' ({info.description}, {unit or _kind_of(info)}){remedy}"
        case "greater_than" | "greater_than_equal" | "less_than" | "less_than_equal" if info is not None:
            bound = f"{BOUNDS[found['type']]} {next(iter(found['ctx'].values())):g} {unit}".removesuffix(" 1")
            return f"{title}.{place} is {toml.as_text(found['input'])}; the {info.description} must be {bound}"
    expected = found["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    what = f" ({info.description}, {unit or _kind_of(info)})" if info is not None else ""
    if len(loc) == 1 and isinstance(found["input"], list | tuple):
        expected += "; a study varies it in [grid]"
    return (
        f"{title}.{place} is {toml.as_text(found['input'])}{what}; expected {expected}"
        if place
        else f"{_title_for(title, expected)}{expected}"
    )


def _title_for(title: str, sentence: str) -> str:
    """Return the owner's name as it begins a sentence; empty for a condition that states it itself."""
    return "" if sentence.startswith((f"{title}.", f"{title}:", f"{title} ")) else f"{title}: "


def _innermost_table(
    cls: type[Parameters], title: str, data: Any, loc: tuple[Any, ...]
) -> tuple[type[Parameters], str, Any, tuple[Any, ...]]:
    """Return the table of parameters in which a location lies, its name, its data, and the location within it."""
    info = cls.model_fields.get(str(loc[0])) if len(loc) > 1 else None
    candidates = (info.annotation, *get_args(info.annotation)) if info is not None else ()
    inner = next((of for of in candidates if isinstance(of, type) and issubclass(of, Parameters)), None)
    if inner is None:
        return cls, title, data, loc
    outer = 2 if isinstance(loc[1], int) else 1  # a table, or one of a list of them
    if len(loc) == outer:
        return cls, title, data, loc
    for part in loc[:outer]:
        title, data = f"{title}.{part}", data[part]
    return _innermost_table(inner, title, data, loc[outer:])
