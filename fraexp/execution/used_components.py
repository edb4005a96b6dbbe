"""The components that sweeps use, and where each of them comes from."""

from collections.abc import Iterable, Iterator, Mapping

from fraexp.components.registry import LOCAL, Registry
from fraexp.data.sweep import Plain, Sweep
from fraexp.store import ComponentOrigin


def component_sections(experiment: Plain, estimators: Iterable[Plain]) -> Iterator[tuple[str, Plain]]:
    """Yield kind and plain data of the components of an experiment, of its compensation, and of estimators."""
    sections = {**experiment, "reader": experiment.get("record", {}).get("reader")}
    compensation = sections.pop("compensation", None) or {}
    for kind, spec in (*sections.items(), *compensation.items(), *(("estimator", of) for of in estimators)):
        if isinstance(spec, Mapping):
            yield kind, spec


def component_origins(sweep: Sweep, registry: Registry) -> dict[str, ComponentOrigin]:
    """Return source hash and distribution of every component that a sweep uses, under ``kind:name``."""
    return {
        f"{provider.component.kind}:{provider.component.name}": ComponentOrigin(
            provider.source_hash, provider.distribution
        )
        for kind, spec in component_sections(sweep.experiment, [sweep.estimator])
        for provider in registry.used_providers(kind, spec)
    }


def local_sources(sweeps: Iterable[Sweep], registry: Registry) -> dict[str, str]:
    """Return the source hashes of the local plugins that sweeps use, under ``kind:name``."""
    if not registry.local_files:
        return {}
    found = (pair for sweep in sweeps for pair in component_origins(sweep, registry).items())
    return {name: origin.source_hash for name, origin in found if origin.distribution == LOCAL}
