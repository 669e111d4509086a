"""The spectral camera's application: cubes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

from tmca.applications.base import Application, has_deviation
from tmca.applications.camera_figures import snapshot_figure
from tmca.applications.demo import Demo, Taken, Trial, shipped_trial
from tmca.applications.moving import MOTION, check_axes, in_frames
from tmca.cameras import SpectralCamera
from tmca.data import Negative, read, rendered_scene, select_bands
from tmca.data.cubes import label
from tmca.data.fitting import fit_cube
from tmca.data.formats.opening import open_contents
from tmca.data.in_memory import as_cube, as_tensors, bands_first, even_bands, of_shape
from tmca.errors import DataError
from tmca.metrics import all_metrics
from tmca.plots.cube import reconstruction_figure
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr

METRICS = (
    ("psnr", "PSNR (dB)", ".2f"),
    ("ssim", "SSIM", ".3f"),
    ("uiqi", "UIQI", ".3f"),
    ("sam", "SAM (°)", ".2f"),
    ("ergas", "ERGAS", ".2f"),
    ("dd", "DD", ".4f"),
)


class SpectralDemo(Demo):
    """Two rendered scenes that the prior was not learned from, through random and learned codes.

    Random codes are decoded by the patch LMMSE, learned ones by the network that learned with them.
    """

    key, title = "rows", "Spectral snapshots"
    scenes = ("motorcycle", "coffee")
    shown = "two buckets, K = 4"
    read_noise, bands, period = 1e-3, 12, 32
    writes_scene = True
    codes: Mapping[str, tuple[str, dict[str, Any]]] = {
        "static (CASSI)": ("static", {"slots": 1, "aperture": "random", "shutter": "open"}),
        "two buckets, K = 4": ("buckets4", {"slots": 4, "aperture": "random", "shutter": "balanced", "buckets": 2}),
        "one-hot shutter, K = 4": ("onehot4", {"slots": 4, "aperture": "random", "shutter": "one-hot"}),
        "static, learned": ("learned_static", {"slots": 1}),
        "K = 8, learned": ("learned_tmca8", {"slots": 8}),
    }

    def scene(self, name: str, size: tuple[int, int]) -> xr.DataArray:
        cube = select_bands(rendered_scene(name, size=size)["radiance"], self.bands)
        return cube.assign_attrs(name=name)

    def trials(self, scene: xr.DataArray) -> list[Trial]:
        return [self._trial(scene, code, stem, settings) for code, (stem, settings) in self.codes.items()]

    def _trial(self, scene: xr.DataArray, code: str, stem: str, settings: dict[str, Any]) -> Trial:
        sensor, size = Sensor(read_noise=self.read_noise), (scene.sizes["y"], scene.sizes["x"])
        name = f"{scene.attrs['name']}_{stem}"
        if "learned" in stem:
            return shipped_trial(code, name, "spectral", size, sensor, settings["slots"])
        bands = scene["wavelength"].values.tolist()
        camera = SpectralCamera(bands=bands, size=size, sensor=sensor, period=self.period, **settings)
        return Trial(code, name, camera, "lmmse", {"uncertainty": True})

    def text(self, rows: Sequence[Mapping[str, Any]]) -> Sequence[str]:
        static, buckets, one, learned_static, learned = (row["psnr"] for row in rows[: len(self.codes)])
        return (
            f"Two rendered scenes of {self.bands} bands (400–700 nm) were each recorded in one snapshot by a static "
            "coded aperture and by apertures that change within the exposure while every pixel has its own shutter, at "
            f"equal exposure time and with read noise σ = {self.read_noise:g}. Snapshots through random codes were "
            "reconstructed in closed form, without training, under a Gaussian prior of small blocks learned from other "
            "rendered scenes; learned codes came with the network that learned with them on those scenes.",
            f"Over the static camera, four random slots changed the mean PSNR by {buckets - static:+.2f} dB where each "
            f"pixel has two buckets, which lose no light, and by {one - static:+.2f} dB where it has one and is open "
            f"in one slot; eight learned slots by {learned - learned_static:+.2f} dB over a learned static aperture. "
            "Random slots in one bucket do not pay under much noise: tmca design says what pays for a sensor.",
        )

    def figures(self, name: str, scene: xr.DataArray, taken: Mapping[str, Taken]) -> dict[str, tuple[str, Any]]:
        cubes = {code: one.estimate.values[0].numpy() for code, one in taken.items()}
        deviations = {
            code: one.estimate.deviation[0].numpy() for code, one in taken.items() if one.estimate.deviation is not None
        }
        multiplexed, waves = taken[self.shown].snapshot, scene["wavelength"].values.tolist()
        colours = "Truth and reconstructions (650, 550, 480 nm as red, green, blue), error, predicted error, spectra."
        return {
            f"{name}_reconstruction.png": (colours, reconstruction_figure(cubes, waves, scene.values, deviations)),
            f"{name}_snapshot.png": ("The time-multiplexed snapshot.", snapshot_figure(multiplexed, name)),
            f"{name}_codes.png": (
                "Aperture T, shutter S, and the code T̂ that they make together (a corner).",
                multiplexed.camera.plot(),
            ),
        }


class SpectralApplication(Application):
    """Cubes (wavelength, y, x)."""

    kind = "spectral"
    columns = METRICS
    demo = SpectralDemo()

    def labelled(self, scene: Any, where: str) -> xr.DataArray:
        return as_cube(scene, where)

    def scene(self, given: Any, camera: Any, where: str = "scene") -> xr.DataArray | xr.Dataset:
        """See ``Application``; bands of an array may be last, as in files, where the camera has none to be held to."""
        if isinstance(given, Tensor | np.ndarray) and "bands" in getattr(camera, "unbound", ()):
            given = bands_first(given, where)
        return super().scene(given, camera, where)

    def of_array(self, values: np.ndarray, camera: Any, where: str) -> xr.DataArray:
        """See ``Application``; bands that the camera does not know yet are spread evenly from 400 to 700 nm."""
        unknown = "bands" in getattr(camera, "unbound", ())
        cube = of_shape(values, ("L" if unknown else len(camera.wavelengths), "H", "W"), where)
        return label(cube, even_bands(len(cube), where) if unknown else np.array(camera.wavelengths))

    def parts(self, scene: xr.DataArray) -> dict[str, Any]:
        return {"bands": scene["wavelength"].values.tolist(), "size": (scene.sizes["y"], scene.sizes["x"])}

    def fitted(self, scene: xr.DataArray, camera: Any, where: str) -> xr.DataArray:
        """See ``Application``; the nearest band for every wavelength."""
        return fit_cube(scene, camera.wavelengths, camera.size, where)

    def tensors(self, scene: xr.DataArray) -> tuple[Tensor, ...]:
        return as_tensors(scene)

    def truth(
        self, source: str, camera: Any, notes: Mapping[str, Any], colours: bool = False, **reading: Any
    ) -> xr.DataArray:
        """See ``Application``; of all bands of the source the nearest ones."""
        return self.fitted(self.read(source, bands=None, **reading), camera, source)  # type: ignore[arg-type]

    def metrics(self, estimate: Mapping[str, np.ndarray], truth: xr.DataArray, camera: Any) -> dict[str, float]:
        """See ``Application``: PSNR, SSIM, UIQI, SAM, ERGAS, DD."""
        return all_metrics(estimate["values"][0], truth.values)

    def stored(self, path: str, **reading: Any) -> xr.Dataset:
        """See ``Application``; any cube is one. Given wavelengths are those of a file without its own."""
        with open_contents(path) as contents:
            noted = {name: contents.attrs[name] for name in ("scene", "real_capture", MOTION) if name in contents.attrs}
            moving, spread = in_frames(contents), has_deviation(contents)
        if moving:
            return _with_wavelengths(super().stored(path), path)
        negative: Negative = "clip" if reading.get("negative") == "clip" else "keep"
        try:
            cube = read(path, negative=negative)
        except DataError:
            if reading.get("wavelengths") is None:
                raise
            cube = read(path, wavelengths=reading["wavelengths"], negative=negative)
        if cube.attrs.get("scale_from") == "maximum":  # an estimate may be above 1
            cube = cube * cube.attrs["scale"]
        stored = cube.to_dataset(name="estimate").assign_attrs(noted)
        return stored.assign(deviation=read(path, variable="deviation", scale=1.0)) if spread else stored

    def camera_of(self, stored: xr.Dataset, where: str) -> Any:
        camera = super().camera_of(stored, where)
        camera.wavelengths = tuple(stored["wavelength"].values.tolist())
        return camera


def _with_wavelengths(stored: xr.Dataset, path: str) -> xr.Dataset:
    """An estimate in frames; DataError unless every frame is a cube with its wavelengths."""
    check_axes(stored, path, "wavelength", "y", "x")
    if "wavelength" not in stored.coords:
        raise DataError(path, "an estimate without wavelengths", "those of its bands, in metres", "write it again")
    return stored
