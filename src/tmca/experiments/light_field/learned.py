"""What experiments learn of light fields, once each: priors, a dictionary, examples to design codes for."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.data.light_field_scenes import Reading, read_middle
from tmca.data.scene_names import identity_of, short_names
from tmca.experiments.cells import Settings, cell_key
from tmca.experiments.source import source_digest

if TYPE_CHECKING:
    import xarray as xr


class Learned:
    """Files of what is learned from training light fields, made when they are first asked for.

    Args:
        names: of the light fields, what ``load_light_field`` reads.
        work: folder of the files.
        views: n for the centre n×n views.
        reading: of those from files.
    """

    def __init__(self, names: Sequence[str], work: Path, views: int, reading: Reading) -> None:
        self.names, self.work, self.views, self.reading = list(names), work, views, reading

    @cached_property
    def light_fields(self) -> list[xr.DataArray]:
        """All of them."""
        return [read_middle(name, self.views, self.reading) for name in self.names]

    @cached_property
    def identity(self) -> Settings:
        """What a file is made of."""
        scenes = [[identity_of(name) or name, self.reading.of(name)] for name in self.names]
        return {"scenes": scenes, "source": source_digest(__name__), "views": self.views}

    def prior(self) -> str:
        """The Gaussian prior of the patch LMMSE."""
        return self._learned("prior", "gaussian")

    def mixture(self) -> str:
        """The Gaussian mixture."""
        return self._learned("mixture", "mixture")

    def dictionary(self, atoms: int) -> str:
        """A dictionary of patches."""
        return self._learned(f"dictionary-{atoms}", "dictionary", atoms=atoms)

    def examples(self) -> str:
        """Folder of examples that codes are designed for; ``load_examples`` reads them."""
        from tmca.cameras import LightFieldCamera
        from tmca.data import make_folder
        from tmca.design import design_model, designable, learn_examples, save_examples
        from tmca.priors import views_of

        folder, grid = self.work / f"examples-{cell_key(self.identity)}", (self.views, self.views)
        if not (folder / "examples.json").exists():
            one = designable("static", 1, (8, 8), camera_type=LightFieldCamera, views=grid)
            cubes = {
                name.replace("/", "-"): views_of(field)[0].flatten(0, 1)
                for name, field in zip(short_names(self.names).values(), self.light_fields, strict=True)
            }
            save_examples(learn_examples(cubes, design_model(one.taps()), None, views=grid), make_folder(folder))
        return str(folder)

    def _learned(self, name: str, kind: str, **settings: Any) -> str:
        from tmca.priors import learn_prior

        file = self.work / f"{name}-{cell_key(self.identity)}.nc"
        if not file.exists():
            learn_prior(self.light_fields, None, kind, **settings).save(file)
        return str(file)
