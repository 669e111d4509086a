"""Pages of results: those of `tmca compare`, and one of tables alone for every other study."""

from types import ModuleType

from tmca.evaluation.pages import general, light_field, spectral, spectral_depth
from tmca.evaluation.study import Study

PAGES: dict[str, ModuleType] = {"spectral": spectral, "light-field": light_field, "spectral-depth": spectral_depth}


def page_of(study: Study) -> ModuleType:
    """The page of a study: ``results`` from measured cells, ``markdown`` from these, ``pictures`` and their files."""
    return PAGES[study.camera] if study.page else general
