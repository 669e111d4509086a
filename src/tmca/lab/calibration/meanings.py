"""What the variables of a calibration are: their attributes ``units`` and ``long_name``, for whoever opens the file."""

from __future__ import annotations

_DN, _SENSOR = "digital numbers", "sensor pixels"
_MAP = "sensor pixels per code pixel, and sensor pixels"
_MEANINGS: dict[str, dict[str, tuple[str, str]]] = {
    "dark": {
        "mean": (_DN, "offset of a pixel"),
        "read_noise": (_DN, "standard deviation of a pixel in a dark frame"),
        "defects": ("1", "1 = hot or noisy pixel"),
        "frames": ("1", "frames that were averaged"),
    },
    "flat": {
        "gain": ("1", "light of a pixel over the mean, under even light"),
        "level": (_DN, "mean above the dark"),
        "nonuniformity": ("1", "standard deviation of the response of pixels (PRNU), relative"),
        "std": ("1", "standard deviation of the gain"),
        "defects": ("1", "2 = dead pixel"),
        "frames": ("1", "frames that were averaged"),
    },
    "linearity": {
        "exposures": ("s", "exposure times"),
        "levels": (_DN, "mean above the dark"),
        "variances": ("digital numbers squared", "variance of a pixel over time"),
        "slope": ("digital numbers per second", "slope of the fitted line"),
        "offset": (_DN, "offset of the fitted line"),
        "deviations": ("1", "deviation from the fitted line, relative to it"),
        "saturation": (_DN, "level above the dark at which most pixels are saturated"),
        "gain": ("electrons per digital number", "gain, by photon transfer"),
        "gain_std": ("electrons per digital number", "standard deviation of the gain"),
        "read_noise": ("electrons", "read noise of the dark frames"),
    },
    "registration": {
        "matrix": (_MAP, "place of a code pixel (row, column, 1)"),
        "std": (
            _MAP,
            "standard deviation of the matrix; last column: shift of the middle",
        ),
        "blur": (_SENSOR, "standard deviation of the relay's blur"),
        "residual": ("1", "rms of what the fit leaves, share of the patterns' contrast"),
        "codes": ("code pixels", "rows and columns of the mask"),
        "sensor": (_SENSOR, "rows and columns of the sensor"),
        "wavelength": ("m", "wavelength of the light"),
        "leakage": ("1", "share of the light that closed mask pixels pass"),
        "leakage_std": ("1", "standard deviation of the leakage"),
    },
    "dispersion": {
        "wavelengths": ("m", "wavelengths of the captures"),
        "shifts": (_SENSOR, "displacement against the registration"),
        "std": (_SENSOR, "standard deviation of the displacement"),
        "coefficients": ("sensor pixels per power", "coefficients of the fitted curve, the constant one first"),
        "residual": (_SENSOR, "rms of what the curve leaves"),
        "response": ("1", "light over the power of the source, mean 1"),
        "misfit": ("1", "what the fit of a capture leaves, share of its light"),
    },
    "shear": {
        "places": ("view steps", "views that were open, from the middle"),
        "shifts": (_SENSOR, "displacement of the mask's shadow"),
        "step": ("sensor pixels per view", "displacement from view to view"),
        "std": ("sensor pixels per view", "standard deviation of the step"),
        "cross": ("sensor pixels per view", "displacement across the direction of the view"),
        "residual": (_SENSOR, "rms of what the fit leaves"),
        "light": ("1", "light of a view over that of the brightest"),
    },
    "timing": {
        "delay": ("slots of the aperture", "delay of the shutter"),
        "ratio": ("1", "duration of a slot of the shutter over one of the aperture"),
        "std": ("slots of the aperture, and 1", "standard deviation of delay and ratio"),
        "light": ("units of the levels", "light of a whole slot"),
        "residual": ("1", "rms of what the fit leaves, share of the largest level"),
        "slots": ("1", "number of slots K"),
        "repeats": ("1", "1 = the exposure repeats"),
        "leakage": ("1", "share of the light that a closed shutter records"),
        "leakage_std": ("1", "standard deviation of the leakage"),
    },
    "buckets": {
        "levels": ("1", "share of the light in every bucket, slots in one bucket or in turn"),
        "predicted": ("1", "the same by the fit"),
        "leakage": ("1", "share that a bucket loses to the others"),
        "transfer": ("slots", "time after a change of bucket in which light reaches none"),
        "std": ("1, and slots", "standard deviation of leakage and transfer"),
        "residual": ("1", "rms of what the fit leaves, share of the light"),
    },
    "psf": {
        "values": ("1", "point spread functions of unit energy"),
        "depths": ("m", "distance of the point"),
        "wavelengths": ("m", "wavelength of the light"),
        "centres": (_SENSOR, "row and column of the middle of a cut-out on the sensor"),
        "noise": ("1", "standard deviation of a pixel of the point spread function"),
    },
    "wavefront": {
        "modes": ("1", "n and m of a Zernike mode"),
        "coefficients": ("m rms of height", "Zernike coefficients beside the nominal heights"),
        "std": ("m rms of height", "standard deviation of the coefficients"),
        "tilts": ("m rms of height", "tilts by the place of the source"),
        "residual": ("1", "rms of what the fit leaves, share of that of the point spread functions"),
        "starts": ("1", "starts that were tried"),
    },
}


def about_field(kind: str, field: str) -> dict[str, str]:
    """Attributes of a field of a kind of part.

    Args:
        kind: such as ``registration``.
        field: such as ``matrix``.
    """
    units, meaning = _MEANINGS[kind][field]
    return {"units": units, "long_name": meaning}
