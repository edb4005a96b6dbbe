"""Signals of one experiment, simulated or measured."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fraexp.data.signals import Signals
from fraexp.data.sweep import Plain
from fraexp.interface.datasets import signals_dataset
from fraexp.views.words import plural

if TYPE_CHECKING:
    import xarray

    from fraexp.workspace.workspace_service import WorkspaceService


@dataclass(frozen=True, eq=False)
class Recording:
    """Sampled channels of one experiment: what `fraexp.estimate` takes."""

    signals: Signals
    """The samples, as an estimator gets them (see `fraexp.api.Signals`)."""
    experiment: Plain
    """What was simulated or read, completely resolved."""
    service: "WorkspaceService"
    files: Mapping[str, str] = field(default_factory=dict)
    """Files of a measured record."""

    @property
    def channels(self) -> dict[str, str]:
        """Units of the channels, by name."""
        return dict(self.signals.units)

    @property
    def outcome(self) -> str:
        """``ok``, or what went wrong in the experiment, such as ``diverged``."""
        return self.signals.outcome.name.lower()

    def to_xarray(self) -> "xarray.Dataset":
        """Return all samples over ``sample``, with the coordinates ``time`` [s], ``segment`` and ``period``.

        Each channel is a variable with its unit in the attribute ``units``. FraexpError if xarray is not installed.
        """
        attributes = {"outcome": self.outcome, "message": self.signals.message, "experiment": self.experiment}
        return signals_dataset(self.signals, attributes)

    def __repr__(self) -> str:
        channels = ", ".join(f"{name} [{unit}]" for name, unit in self.signals.units.items())
        source = {"loop": "simulated", "drive": "driven friction law", "record": "measured"}
        kind = source.get(str(self.experiment.get("source")), "")
        return f"<Recording: {kind}, {plural(len(self.signals.segments), 'segment')}, {channels}; {self.outcome}>"
