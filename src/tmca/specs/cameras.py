"""Specs of cameras: codes, optics and the file that they may come from, by kind of camera."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from tmca.errors import SettingError
from tmca.specs.base import Both, Buckets, Distances, Numbers, Pixels, Seed, Share, Slots, Spec

CAMERA_SPECS: dict[str, type[CameraSpec]] = {}
"""The spec of every kind of camera."""


class CameraSpec(Spec):
    """A camera of one kind; what is not given is the preset's, or the default.

    A new kind names its ``kind``; its fields are arguments of the camera's constructor, but for those in ``sources``.
    """

    kind: ClassVar[str]
    sources: ClassVar[tuple[str, ...]] = ("preset", "codes", "weights")
    shape: ClassVar[tuple[str, ...]] = ("size", "bands", "views")  # what a scene gives
    usual: ClassVar[str | None] = None  # preset where nothing is said of the codes

    @classmethod
    def __pydantic_init_subclass__(cls, **arguments: Any) -> None:
        super().__pydantic_init_subclass__(**arguments)
        if "kind" in cls.__dict__:
            CAMERA_SPECS[cls.kind] = cls

    def arguments(self) -> dict[str, Any]:
        """Arguments of the camera's constructor that were given, files by their names."""
        return self.given(*self.sources)

    def learned(self) -> tuple[str | None, str]:
        """Weights that bring codes and optics, None without, and the field that names them."""
        return getattr(self, "weights", None), "weights"

    @classmethod
    def axes(cls) -> tuple[str, ...]:
        """Names of what a sweep can vary: arguments of the constructor that are no files."""
        return tuple(name for name in cls.model_fields if name not in cls.sources)


class CodedSpec(CameraSpec):
    """Codes of a camera with an aperture and a shutter, and the exposure."""

    usual = "two-bucket"

    slots: Slots = 8
    """Time slots K within the exposure; those of the patterns where a file is given; 4 where no option says what the
    camera shows, as of the preset two-bucket."""
    aperture: str = "random"
    """Aperture codes: random, static, open, one-hot, complementary, blue-noise, s-matrix, balanced, or a file of
    patterns."""
    shutter: str = "random"
    """Shutter codes: random, static, open, one-hot, complementary, blue-noise, s-matrix, balanced, burst, or a file of
    patterns."""
    buckets: Buckets = 1
    "Buckets of a sensor pixel: with 2, the light of closed slots is read too."
    preset: str | None = None
    """Start from a named camera: two-bucket (where no option says what the camera shows), one-hot, thesis, burst (of
    two frames), and of the spectral camera cassi (static), of the light field clfp (static) and quick. Other options
    replace its values."""
    period: Pixels | None = None
    "Tile of the codes in pixels; full frame without it."
    seed: Seed = 0
    "Of the codes and the noise."
    codes: Path | None = None
    "Both planes from a file of `tmca design` (codes.nc), with their period."
    weights: str | None = None
    "Learned codes: a file or run of `tmca train`, or default, which comes with tmca."
    exposure: Literal["equal", "per-slot"] = "equal"
    "equal: the slots share one exposure time; per-slot: each has its own."
    transmittance: Share = 0.5
    "Share of open aperture pixels."
    duty: Share = 0.5
    "Share of open shutter pixels."


class SpectralSpec(CodedSpec):
    """The spectral camera."""

    kind: ClassVar[str] = "spectral"
    sources: ClassVar[tuple[str, ...]] = (*CodedSpec.sources, "coloured")

    weights: str | None = None
    "Learned codes: a file or run of `tmca train`, or default, which comes with tmca (static for --slots 1, or K = 8)."
    dispersion: Numbers = 1.0
    "Pixels per band, or the displacement of every band separated by commas."
    disperser: Literal["single", "dual"] = "single"
    "single or dual."
    relay_blur: Annotated[float, Field(ge=0)] = 0.0
    "Blur of the relay optics, standard deviation in pixels."
    coloured: Path | None = None
    "File of a static coloured aperture, bands × rows × columns, in the place of the codes."


class LightFieldSpec(CodedSpec):
    """The light-field camera."""

    kind: ClassVar[str] = "light-field"
    sources: ClassVar[tuple[str, ...]] = (*CodedSpec.sources, "vignetting")

    shear: Both = (1.0, 1.0)
    "Mask pixels per view, one number or ALONG_Y,ALONG_X."
    mask_scale: float = 1.0
    "Mask pixels per sensor pixel as the sensor sees them; 1 for a mask of pitch (1-s)·p."
    vignetting: Path | None = None
    "File with the share of light of every view, rows × columns."


class SpectralDepthSpec(CameraSpec):
    """The spectral-depth camera; what has no default is the preset's."""

    kind: ClassVar[str] = "spectral-depth"
    shape: ClassVar[tuple[str, ...]] = ("size",)

    preset: str = "quick"
    "Start from a named camera: thesis, diffractive (its phase mask alone), quick, quick-diffractive."
    slots: Slots | None = None
    "Time slots K within the exposure."
    depth: Distances = (0.4, 2.0)
    "NEAR,FAR of the depth planes, metres."
    mask: str | None = None
    "Phase mask: flat, zernike, free-form, rotational or lens."
    shutter: str | None = None
    "Shutter codes: random, static, open, one-hot, complementary, blue-noise, s-matrix, balanced or burst."
    buckets: Buckets = 1
    "Buckets of a sensor pixel: with 2, the light of closed slots is read too."
    planes: Annotated[int, Field(le=4096)] | None = None
    "Number of depth planes, even in inverse depth."
    codes: Path | None = None
    """Masks, shutter, filters and their bench from a file of `tmca design` (codes.nc), the bands are then the preset's;
    or all of the camera from weights of `tmca train`."""
    weights: str | None = None
    """Learned masks and optics: a file or run of `tmca train`, as with --codes; or default, those that come with tmca
    (K = 4)."""
    seed: Seed = 0
    "Of the codes and the noise."
    filters: str | None = None
    "Colour filters over the pixels: clear, gaussian or rgbw."
    channels: str | None = None
    "Of the sensor: monochrome or rgb."
    period: Pixels | None = None
    "Tile of shutter and filters, pixels."
    exposure: Literal["equal", "per-slot"] | None = None
    "equal: the slots share one exposure time; per-slot: each has its own."
    image_formation: Literal["linear", "occlusion"] | None = None
    "linear, or occlusion: near layers hide far ones."
    rms_nm: Annotated[float, Field(ge=0, le=1e5)] = 100.0
    "Of a random mask's heights, nm."
    modes: Annotated[int, Field(le=1024)] = 18
    "Zernike modes of a random mask, from defocus on."

    def arguments(self) -> dict[str, Any]:
        """See ``CameraSpec``; heights in metres as ``rms``.

        Raises:
            SettingError: what a mask that is not random does not have.
        """
        given = self.given(*self.sources)
        for name, without in (("rms_nm", ("flat", "lens")), ("modes", ("flat", "lens", "rotational"))):
            if name in given and self.mask in without:
                wanted = "a random mask that has it"
                raise SettingError(name, f"a mask that is {self.mask}", wanted, "leave one of the two out")
        return given | ({"rms": given.pop("rms_nm") * 1e-9} if "rms_nm" in given else {})

    def learned(self) -> tuple[str | None, str]:
        """See ``CameraSpec``: weights, or codes that are no file of `tmca design`."""
        if self.weights is not None or self.codes is None or self.codes.suffix == ".nc":
            return self.weights, "weights"
        return str(self.codes), "codes"
