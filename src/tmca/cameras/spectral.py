"""The spectral camera: CASSI whose aperture and shutter change K times within one exposure (thesis chapter 4)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from tmca.cameras.checks import band_wavelengths, choice
from tmca.cameras.coded import CodedCamera
from tmca.cameras.presets import PRESETS
from tmca.codes import MultiplexedCodes
from tmca.errors import SettingError, ShapeError
from tmca.operators import (
    LinearOperator,
    SlotwiseDisperser,
    TapOperator,
    coloured_code,
    dual_disperser,
    single_disperser,
    sum_by_channel,
)
from tmca.optics import Dispersion, gaussian_spread
from tmca.sensor import Sensor

DISPERSERS = ("single", "dual")


class SpectralCamera(CodedCamera):
    """A snapshot spectral camera with a time-multiplexed coded aperture.

    ``e_{m,n} = (1/K) Σ_k S^k_{m,n} Σ_ℓ κ_ℓ T^k_{m,n-d_ℓ} f_{m,n-d_ℓ,ℓ}`` (thesis eqs 18–21, errata), then noise.
    With ``slots=1, shutter="open"`` it is CASSI.

    Args:
        bands: number of bands L, or their wavelengths in metres. A number means even spacing from 400 to 700 nm.
        size: (H, W) of the scene, pixels.
        slots: number of time slots K within the exposure.
        aperture: family of the aperture codes (``tmca.codes.FAMILIES``) or patterns (K, H, W).
        shutter: family of the shutter codes or patterns (K, H, W').
        exposure: ``"equal"``: the slots share one exposure time (mean); ``"per-slot"``: each has its own (sum).
        dispersion: pixels per band, or the displacement of every band in pixels (negative, fractional, any order).
        disperser: ``"single"`` (mask, prism, sensor) or ``"dual"`` (prism, mask, opposite prism: nothing is displaced).
        response: (L,) sensor response κ; ones if None. A ``Parameter`` is learned.
        relay_blur: standard deviation of the relay's blur, pixels, one or one per band; 0 for none.
        sensor: noise, full well, bits; an ideal sensor if None.
        transmittance: share of open aperture pixels of a named family.
        duty: share of open shutter pixels of a named family.
        period: tile of the codes, pixels; full frame if None.
        seed: of the codes.
        learnable: ``True``, ``False``, ``"aperture"`` or ``"shutter"``.
        spread: of the logits of learned codes, see ``CodePlane``.
        coloured: (L, H, W) transmittance of a static coloured aperture, which takes the place of the codes: an open
            shutter, one slot, a single disperser, no relay blur.

    Raises:
        SettingError, ShapeError: an impossible value or codes that do not fit, naming both sizes.
    """

    kind = "spectral"
    channel = "band"
    coloured: Tensor | None

    def __init__(
        self,
        bands: int | Sequence[float] = 12,
        size: tuple[int, int] = (256, 256),
        slots: int = 8,
        *,
        aperture: str | Tensor = "random",
        shutter: str | Tensor = "random",
        exposure: str = "equal",
        dispersion: float | Sequence[float] | Dispersion = 1.0,
        disperser: str = "single",
        response: Tensor | Sequence[float] | None = None,
        relay_blur: float | list[float] = 0.0,
        sensor: Sensor | None = None,
        transmittance: float = 0.5,
        duty: float = 0.5,
        period: int | tuple[int, int] | None = None,
        seed: int = 0,
        learnable: bool | str = False,
        spread: float = 0.0,
        coloured: Tensor | None = None,
    ) -> None:
        super().__init__(size, slots, exposure, sensor)
        self.wavelengths = band_wavelengths(bands)
        self.bands = len(self.wavelengths)
        self.disperser = choice("disperser", disperser, DISPERSERS)
        self.dispersion = Dispersion.of(dispersion, self.bands)
        self.relay_blur = relay_blur
        gaussian_spread(relay_blur, self.bands)  # refuses a wrong one before anything is imaged
        if self.blurred and disperser == "dual":
            raise SettingError("disperser", "'dual' with relay blur", "'single', or no blur")
        self._hold_response(response)
        if coloured is not None:
            self._check_coloured(coloured)
            slots = self.slots = 1
            aperture = shutter = "open"
        self.register_buffer("coloured", coloured)
        wide = (self.size[0], self.size[1] + self.dispersion.spread)
        planes = (self.size, wide) if disperser == "single" else (wide, self.size)
        self.codes = MultiplexedCodes(
            slots, *planes, aperture=aperture, shutter=shutter, transmittance=transmittance, duty=duty,
            period=period, seed=seed, learnable=learnable, spread=spread,
        )  # fmt: skip

    @classmethod
    def from_preset(cls, name: str, **changes: Any) -> SpectralCamera:
        """A named camera: ``"thesis"`` (K = 8 random), ``"cassi"`` (its static camera), ``"one-hot"`` (K = 4).

        Args:
            name: of the preset.
            changes: arguments that replace the preset's.

        Raises:
            SettingError: unknown preset.
        """
        return cls(**{**PRESETS[choice("preset", name, tuple(PRESETS))], **changes})

    @property
    def channel_names(self) -> list[str]:
        """Wavelengths of the bands."""
        return [f"{w * 1e9:.0f} nm" for w in self.wavelengths]

    def code_cube(self) -> Tensor:
        """(L, H, W) the time-multiplexed code T̂ of eq. (20), without the sensor response; for a fractional
        displacement, the sum over its two taps."""
        aperture, shutter = self.codes()
        if self.coloured is not None:
            return self.coloured
        build = single_disperser if self.disperser == "single" else dual_disperser
        taps = build(aperture, shutter, self.dispersion, None, self.exposure).taps
        return sum_by_channel(taps.code, taps.channels, self.bands)

    @property
    def scene_shape(self) -> tuple[int, int, int]:
        """(L, H, W)."""
        return (self.bands, *self.size)

    @property
    def snapshot_shape(self) -> tuple[int, int, int]:
        """(1, H, W'): wider than the scene behind a single disperser."""
        return (1, self.size[0], self.size[1] + (self.dispersion.spread if self.disperser == "single" else 0))

    def operator(self) -> LinearOperator:
        """The linear part with the present codes; ``relay_blur`` keeps the slots apart and makes it slower."""
        return self._slotwise(moving=False) if self.blurred else super().operator()

    @property
    def blurred(self) -> bool:
        """Whether the relay optics blur."""
        return bool(torch.as_tensor(self.relay_blur).gt(0).any())

    def A(self, scene: Tensor) -> Tensor:
        """(B, L, H, W) → exact snapshot (B, 1, H, W')."""
        return self.operator().A(scene)

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """(B, 1, H, W') → (B, L, H, W)."""
        return self.operator().A_adjoint(snapshot)

    def A_dagger(self, snapshot: Tensor) -> Tensor:
        """(B, 1, H, W') → least-norm scene (B, L, H, W)."""
        return self.operator().A_dagger(snapshot)

    def forward(self, scene: Tensor, generator: torch.Generator | int | None = None) -> Tensor:
        """Take a snapshot: ``A``, then the sensor.

        Args:
            scene: (B, L, H, W) relative irradiance, or (B, K, L, H, W) for a scene that changes from slot to slot.
            generator: source of the sensor's randomness, or a seed.

        Returns:
            (B, 1, H, W') snapshot.

        Raises:
            ShapeError: wrong bands, size or slots.
        """
        operator = self._slotwise(moving=True) if scene.ndim == 5 else self.operator()
        return self.record(operator.A(scene), generator)

    def _geometry(self) -> tuple[object, ...]:
        return (self.dispersion,)

    def _collapsed(self) -> TapOperator:
        if self.coloured is not None:
            return coloured_code(self.coloured, self.dispersion, self.response)
        build = single_disperser if self.disperser == "single" else dual_disperser
        return build(*self.codes(), self.dispersion, self.response, self.exposure)

    def window(self, top: int, left: int, height: int, width: int) -> LinearOperator:
        """See ``CodedCamera``; light that a relay throws beyond the part is lost."""
        part = (top, left, height, width)
        return self._slotwise(part, moving=False) if self.blurred else super().window(*part)

    def moving_window(self, top: int, left: int, height: int, width: int) -> LinearOperator:
        """The operator of scenes (B, K, L, height, width) that move, behind a part of the codes."""
        return self._slotwise((top, left, height, width), moving=True)

    def _slotwise(self, part: tuple[int, int, int, int] | None = None, *, moving: bool) -> LinearOperator:
        if self.disperser == "dual" or self.coloured is not None:
            found = "'dual'" if self.disperser == "dual" else "a coloured aperture"
            raise SettingError("disperser", found, "'single' and binary codes for relay blur or a moving scene")
        top, left, height, width = part or (0, 0, *self.size)
        aperture, shutter = (plane[:, top : top + height, left:] for plane in self.codes())
        planes = aperture[..., :width], shutter[..., : width + self.dispersion.spread]
        blur = gaussian_spread(self.relay_blur, self.bands).to(self.response) if self.blurred else None
        return SlotwiseDisperser(*planes, self.dispersion, self.response, self.exposure, blur, moving)

    def _check_coloured(self, code: Tensor) -> None:
        expected = (self.bands, *self.size)
        if tuple(code.shape) != expected:
            raise ShapeError("coloured", f"shape {tuple(code.shape)}", f"{expected}: bands and size of the scene")
        if not bool(torch.isfinite(code).all()) or code.min() < 0 or code.max() > 1:
            raise SettingError("coloured", "values outside [0, 1]", "transmittances", "scale the patterns")
        if self.disperser == "dual" or self.blurred:
            raise SettingError("coloured", "a dual disperser or relay blur beside it", "a single disperser, no blur")

    def _hold_response(self, response: Tensor | Sequence[float] | None) -> None:
        values = torch.ones(self.bands) if response is None else response
        values = values if isinstance(values, Tensor) else torch.tensor(list(values), dtype=torch.get_default_dtype())
        if values.shape != (self.bands,):
            raise ShapeError("response", f"shape {tuple(values.shape)}", f"({self.bands},), one value per band")
        known = values.detach()
        if not bool(torch.isfinite(known).all()) or known.min() < 0 or known.max() <= 0:
            raise SettingError("response", str(known.tolist()), "finite numbers ≥ 0, not all zero")
        if isinstance(values, nn.Parameter):
            self.response = values
        else:
            self.register_buffer("response", values)
