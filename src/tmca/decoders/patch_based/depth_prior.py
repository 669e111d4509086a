"""Which prior of scenes a patch likelihood uses: a given one, a file's, or that of the rendered scenes."""

from __future__ import annotations

from pathlib import Path

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.patch_based.depth_likelihood import WINDOW, usual_window
from tmca.errors import DataError
from tmca.priors import GaussianPrior, Prior, load_prior, rendered_prior
from tmca.priors.spectral_depth import needed_block


def find_depth_prior(
    prior: str | Path | Prior | None, camera: SpectralDepthCamera, window: int | None = None
) -> GaussianPrior:
    """The prior that the windows of a camera are judged by.

    Args:
        prior: it, its file, or None for that of the rendered scenes at the camera's bands, learned on first use.
        camera: whose windows.
        window: their side, pixels; `usual_window` if None.

    Raises:
        DataError: no such file, or another prior than a Gaussian one.
        SettingError: bands that the rendered scenes do not have.
    """
    if prior is None:
        side = usual_window(camera) if window is None else window
        block = needed_block(max(WINDOW, side), camera.bench.window)  # smaller windows share that of usual ones
        return gaussian(rendered_prior(camera.wavelengths, 0, block=block), "prior")
    return gaussian(load_prior(prior), prior) if isinstance(prior, (str, Path)) else gaussian(prior, "prior")


def gaussian(prior: Prior, where: object) -> GaussianPrior:
    """A prior, unless it is of another kind; ``where`` names it.

    Raises:
        DataError: a mixture.
    """
    if not isinstance(prior, GaussianPrior):
        raise DataError(where, "a mixture prior", "a Gaussian prior", "learn one without --mixture")
    return prior
