"""What priors and decoders have to know of any camera."""

from __future__ import annotations


class Facts:
    """About the channels of a scene and how far light travels on the sensor; a constructor sets what is otherwise.

    ``views`` (V, U) where the channels are views; ``wavelengths`` in metres where they are bands;
    ``dispersion_extent``, columns from where the first band lies to where the last one does; ``psf_window`` (h, w) of
    the point spread functions of a camera of depth, which has the ``tile_size`` of its codes too.
    """

    views: tuple[int, int] | None = None
    wavelengths: tuple[float, ...] = ()
    dispersion_extent: int = 0
    psf_window: tuple[int, int] | None = None
