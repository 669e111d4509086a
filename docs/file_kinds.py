"""What the page of file formats says of every kind of file: sentences, commands, meanings of entries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

Meanings = Mapping[str, str]
ATTRIBUTES: Meanings = {
    # snapshots and estimates
    "scene": "name of the scene",
    "noise_seed": "seed of the noise",
    "source_bands": "bands of the scene, where only some of them were imaged",
    "camera": "kind of the camera: `spectral`, `light-field`, `spectral-depth`",
    "exposure": "`equal`: the slots share one exposure; `per-slot`: each has one",
    "full_scale": "level of a white scene with everything open, snapshot units",
    "sensor": "arguments of `tmca.Sensor`: noise, full well, bits, colour filters",
    "tmca_version": "version of tmca that wrote the file",
    "period": "rows and columns of one tile, where codes repeat",
    "disperser": "`single` or `dual`",
    "dispersion_axis": "along which bands are displaced",
    "origin": "scene column on the first sensor column",
    "relay_blur": "standard deviation of the relay's blur, pixels",
    "shear": "mask pixels per view, along y and x",
    "mask_scale": "mask pixels per sensor pixel",
    "bench": "arguments of `PhaseMaskBench`: lengths in metres",
    "depth": "nearest and farthest plane in metres, and their number",
    "energy": "how point spread functions are scaled",
    "image_formation": "how depths add up on the sensor",
    "decoder": "name of the decoder",
    "prior": "the prior that was used",
    "deviation_calibration": "scenes on which the deviation was calibrated; without it, it is as predicted",
    "seconds": "wall time",
    "depth_planes": "nearest and farthest plane in metres, and their number",
    "focal_px": "distance from the aperture to the sensor, pixels",
    "focal_of": "whose that is: of the `bench` or the `scene`",
    "unknown_depth_pixels": "pixels of unknown depth",
    "unknown_zero": "of these: zero in the file",
    "unknown_negative": "of these: negative in the file",
    "unknown_not_finite": "of these: not finite in the file",
    "unknown_outside": "of these: beyond the camera's range",
    # rendered scenes
    "name": "of the scene",
    "photograph": "that it is rendered from",
    "credit": "of the photograph",
    "split": "`train`, `validation` or `test`",
    "illuminant": "name of the light",
    "depth_source": "`rendered` or `measured`",
    "white_reflectance": "reflectance of white",
    "seed": "of everything random",
    "encoding": "of the photograph",
    # codes
    "filters": "family of the colour filters",
    "channels": "channels of the sensor",
    # priors
    "format": "name and version of the format",
    "kind": "what the file is",
    "sources": "scenes that were learned from, one a line",
    "block": "channels, rows and columns of a block",
    "views": "rows and columns of the grid of views",
    "residual": "relative norm of what the paths do not explain",
    "notes": "how it was made, or what was doubtful",
    # calibrations
    "created": "when the file was written",
    "builds_on": "the file whose steps it continues",
    "residuals": "what a step says of its own errors",
    "settings": "options of the step",
    "measured": "when the oldest frame was taken",
    "curve": "`cauchy`, `polynomial` or `measured`",
    # dual blind deconvolution
    "sigma": "standard deviation of the noise",
    "method": "that solved it",
    "exact": "1 = noiseless samples are explained to 1e-9",
    "certificate": "whether the recovery is proven optimal",
    "unexplained": "share of the samples' energy that no path explains",
    "units_delay_s": "seconds of a normalised delay of one",
    "units_doppler_hz": "hertz of a normalised Doppler of one",
    "units_carrier_hz": "carrier frequency, hertz",
    "units_spacing": "spacing of the antennas, wavelengths",
}
_WEIGHTS: Meanings = {
    "format": "name and version of the format",
    "tmca": "JSON with the entries below",
    "tmca.network": "`kind` and `settings` of the network",
    "tmca.camera": "variables and attributes of its camera, as in a snapshot; their values are tensors of the file",
    "tmca.prior": "file of the prior beside the weights, `rendered`, or nothing",
    "tmca.card": "how it was trained, and how good it is",
}
_MANIFEST: Meanings = {
    "format": "name and version of the format",
    "tmca": "version of tmca",
    "written": "when",
    "source": "file of the codes, as it was named",
    "camera": "kind of the camera",
    "settings": "of the camera that the codes are of",
    "source_at": "where the file of the codes lies",
    "codes_date": "when the codes were made",
    "slots": "number of slots K",
    "exposure_s": "of all slots together, seconds",
    "planes": "what is shown, a plane for each device",
    "planes[].plane": "`aperture` or `shutter`",
    "planes[].device": "description of the device: name, kind, size, pitch, bits, rates, …",
    "planes[].placement": "where code pixels lie on device pixels",
    "planes[].units": "what a value means",
    "planes[].codes_sha256": "checksum of the codes, whatever file holds them",
    "planes[].frames": "one for each slot",
    "planes[].frames[].slot": "number of the slot, from 0",
    "planes[].frames[].file": "the picture",
    "planes[].frames[].start_s": "from the trigger, seconds",
    "planes[].frames[].duration_s": "seconds",
    "planes[].frames[].trigger": "what starts the slot",
    "planes[].frames[].sha256": "checksum of the picture",
}
_CAPTURES: Meanings = {
    "export": "folder of the export",
    "export_sha256": "checksum of its manifest",
    "shown_sha256": "checksum of what it shows, whenever it was written",
    "taken_with": "what all frames were taken with",
    "taken_with.gain": "snapshot units of a digital number",
    "taken_with.saturation": "digital number from which on a pixel is saturated",
    "frames": "one for each frame, by the name of its file",
    "frames.*.slot": "number of the slot; null of dark frames and whole exposures",
    "frames.*.of": "the frame that it repeats",
    "frames.*.sha256": "checksum of the frame's file",
    "frames.*.taken": "when",
}
_STUDY: Meanings = {
    "command": "that made it",
    "commit": "of the repository, where there is one",
    "study": "the study, as its YAML file says it",
    "split": "scenes that were learned from and measured",
    "budget": "trainings, and seconds of decoding",
    "searches": "codes that were searched for",
    "rows": "a row for each code, noise and decoder, with figures of merit scene by scene and seed by seed",
    "expected_error": "expected and measured errors, where they are compared",
    "bands": "how many of the scenes' bands are measured, where some have more",
    "pictures": "files of pictures, with their titles",
    "failed": "cells that failed, and why",
}
_COLUMNS: Meanings = {
    "method": "code and decoder",
    "exposure": "`equal` or `per-slot`",
    "code": "name of the code",
    "noise": "name of the noise",
    "decoder": "name of the decoder",
    "psnr": "PSNR, dB; higher is better",
    "ssim": "SSIM; higher is better",
    "uiqi": "UIQI; higher is better",
    "sam": "spectral angle, degrees; lower is better",
    "ergas": "ERGAS; lower is better",
    "dd": "degree of distortion; lower is better",
    "throughput": "share of the light that is recorded",
    "seconds": "to decode a scene",
    "training_cpu_minutes": "of a network, CPU minutes",
}
_DECODER: Meanings = {
    "weights": "file of the network",
    "snapshot": "shape of the input",
    "scene": "shape of the output",
    "wavelengths_m": "of the bands, metres",
    "read_noise": "that the network is told, snapshot units",
    "shot_noise": "that the network is told, snapshot units",
    "units": "of the input",
    "codes": "norm and projections of the codes: they tell one camera from another",
    "files": "one for each format",
    "files[].format": "`torch` or `onnx`",
    "files[].file": "its name",
    "files[].error": "largest difference from the decoder, share of its largest value",
}


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Args:
        title: heading.
        about: what it is for.
        files: of `tiny_files`, with what each is.
        write, read: (command, Python).
        opened: how without tmca.
        meanings: of the entries of a JSON, CSV or safetensors file; of attributes that mean something else than in
            ``ATTRIBUTES``.
    """

    title: str
    about: str
    files: Mapping[str, str]
    write: tuple[str, str]
    read: tuple[str, str]
    opened: str
    meanings: Meanings = field(default_factory=dict)


_XARRAY = (
    '`xarray.open_dataset("{}", engine="h5netcdf")`, or any viewer of HDF5 or NetCDF, such as HDFView and Panoply.'
)
KINDS = (
    Kind(
        "Scene",
        "What a camera looks at: a spectral cube with depth, or a light field. `tmca render` makes these from"
        " photographs; scenes of your own "
        "may have [many other formats](../data.md).",
        {
            "scene.nc": "Spectral scene with depth",
            "views.nc": "Light field",
            "refocused.nc": "Photographs of `tmca refocus`",
        },
        ("tmca render coffee --out scene.nc", 'tmca.data.write_dataset(scene, "scene.nc")'),
        ("tmca simulate spectral scene.nc", 'tmca.read("scene.nc")'),
        _XARRAY.format("scene.nc")
        + " `tmca.data.write_tiff` writes a cube for ImageJ: one page for each band, named by its wavelength.",
    ),
    Kind(
        "Snapshot",
        "What the sensor recorded, with the codes, optics and noise of the camera that took it: all that a "
        "decoder needs. Other software may write it too: "
        "`tmca reconstruct` names a variable that is missing. Further attributes are notes, such as"
        " `scene_reading`: how the scene was read.",
        {
            "spectral.nc": "Spectral camera",
            "light-field.nc": "Light-field camera",
            "spectral-depth.nc": "Spectral-depth camera",
        },
        ("tmca simulate spectral coffee --out spectral.nc", 'tmca.simulate("coffee", camera).save("spectral.nc")'),
        ("tmca reconstruct spectral.nc", 'tmca.Snapshot.load("spectral.nc")'),
        _XARRAY.format("spectral.nc"),
    ),
    Kind(
        "Estimate",
        "The scene that a decoder makes of a snapshot. `deviation` is there where it was asked for; a light "
        "field also has disparity, its confidence and a "
        "picture with everything in focus; a scene with depth has its depth, and `depth_deviation`.",
        {
            "spectral_estimate.nc": "Spectral camera",
            "light-field_estimate.nc": "Light-field camera",
            "spectral-depth_estimate.nc": "Spectral-depth camera",
        },
        ("tmca reconstruct spectral.nc", 'tmca.reconstruct(snapshot).save("spectral_estimate.nc")'),
        ("tmca evaluate spectral_estimate.nc coffee", 'tmca.data.read_dataset("spectral_estimate.nc")'),
        _XARRAY.format("spectral_estimate.nc")
        + " `tmca view spectral_estimate.nc --static page.html` writes a page for any browser.",
    ),
    Kind(
        "Codes",
        "What the aperture and the shutter show, slot by slot, of one tile that repeats. Files of `tmca design`"
        " also say its `advice`, the `sensor` that the codes are for, and their `codes_date`.",
        {"codes.nc": "Codes of pixels"},
        ("tmca design spectral --out design", 'tmca.design_codes("spectral", out="design")'),
        (
            "tmca simulate spectral coffee --codes codes.nc",
            'camera_of(SpectralSpec(codes="codes.nc"), bands=12, size=(64, 64))',
        ),
        _XARRAY.format("codes.nc")
        + " The folder of `tmca design` also has `aperture.tif` and `shutter.tif` of 0 and 255 for ImageJ and "
        "devices, "
        "`design.json` with all numbers, and a page for the browser.",
    ),
    Kind(
        "Phase masks",
        "Height maps, colour filters and shutter of the spectral-depth camera, and the bench that they are for.",
        {"masks.nc": "Codes of masks"},
        ("tmca design spectral-depth --out design", 'tmca.design_codes("spectral-depth", out="design")'),
        (
            "tmca simulate spectral-depth coffee --codes masks.nc",
            'camera_of(SpectralDepthSpec(codes="masks.nc"), bands=31, size=(64, 64))',
        ),
        _XARRAY.format("masks.nc"),
    ),
    Kind(
        "Prior",
        "What is known of scenes before a snapshot is taken. Decoders such as `lmmse`, `mixture` and `sparse` use it.",
        {
            "gaussian.nc": "Gaussian prior",
            "component.nc": "Gaussian prior, not stationary",
            "mixture.nc": "Gaussian mixture",
            "dictionary.nc": "Dictionary",
        },
        ("tmca prior learn coffee --out prior.nc", 'tmca.priors.learn_prior(scenes, camera).save("prior.nc")'),
        ("tmca reconstruct spectral.nc --prior prior.nc", 'tmca.priors.load_prior("prior.nc")'),
        _XARRAY.format("prior.nc"),
        {"residual": "variance that sparse codes leave"},
    ),
    Kind(
        "Weights",
        "A trained network with the camera that it was trained for. The file is "
        "[safetensors](https://github.com/huggingface/safetensors): it holds numbers, no code.",
        {"weights.safetensors": "Header"},
        ("tmca train spectral --out run", 'Weights.of(network, camera).save("weights.safetensors")'),
        ("tmca reconstruct spectral.nc --weights run", 'tmca.decoders.Weights.load("run")'),
        '`safetensors.safe_open("weights.safetensors", "np")`: `metadata()` is the header, '
        "`get_tensor(name)` the values. Tensors of the network begin "
        "with `network.`; the others are the variables of the camera.",
        _WEIGHTS,
    ),
    Kind(
        "Calibration",
        "What was measured of a bench: a group for every step. A file has the groups that were measured; "
        "`psf` and `wavefront` have the number of their slot.",
        {"calibration.nc": ""},
        ("tmca calibrate dark frames --out bench", 'calibration.save("bench")'),
        ("tmca reconstruct frames.nc --calibration bench", 'tmca.lab.calibration.file.load_calibration("bench")'),
        '`xarray.open_datatree("calibration.nc", engine="h5netcdf")`, or HDFView.',
        {"camera": "its name, and the sizes of sensor and codes", "sources": "measured files, with their SHA-256"},
    ),
    Kind(
        "Export",
        "Codes as the devices of a bench show them: a folder of pictures, and `manifest.json`, which says "
        "what is shown when.",
        {"export/manifest.json": "`manifest.json`"},
        (
            "tmca export spectral.nc --device dli4120 --out export",
            'tmca.lab.display.export.export_codes(codes, devices, "export")',
        ),
        ("tmca capture export --scene coffee --out capture", 'tmca.lab.display.read_export("export")'),
        "The pictures are PNG, one for each slot; masks of a deformable mirror are a table, `zernike.csv`.",
        _MANIFEST,
    ),
    Kind(
        "Capture",
        "Frames of a bench in digital numbers: a folder of TIFF files, and `captures.json` with their "
        "checksums. `tmca capture` joins them into a snapshot file beside it.",
        {"capture/captures.json": "`captures.json`"},
        (
            "tmca capture export --scene coffee --out capture",
            'tmca.lab.acquisition.session.capture("export", device, "capture")',
        ),
        ("tmca reconstruct capture.nc", 'tmca.lab.acquisition.session.joined("capture", "export", camera)'),
        'ImageJ, or `tifffile.imread("capture/slot_000.tif")`: 16 bits, (rows, columns).',
        _CAPTURES,
    ),
    Kind(
        "Study",
        "Results of a comparison: `.json` holds everything, `.csv` the table, `.md` table and pictures as a "
        "page, `.html` the same in one file.",
        {"study/study.json": "`.json`", "study/study.csv": "`.csv`"},
        ("tmca study cube.tif --out study", 'tmca.evaluation.run_study(study, Path("study"), Path("study/cells"))'),
        ("", 'pandas.read_csv("study/study.csv")'),
        "A spreadsheet for `.csv`, a browser for `.html`, any editor for `.md`.",
        {**_STUDY, **_COLUMNS},
    ),
    Kind(
        "Dual blind deconvolution",
        "A problem is samples and known bases, with the truth of a simulated one; a recovery is the paths and"
        " signals of every source. Numbers at the end of a name "
        "count the sources. Complex numbers have a last axis `part`. A recovery that does not"
        " explain the samples says why in the attribute `doubt`.",
        {"problem.nc": "Problem", "recovery.nc": "Recovery"},
        ("tmca dbd simulate --out problem.nc", 'tmca.dbd.save_problem(problem, "problem.nc")'),
        ("tmca dbd solve problem.nc --out recovery.nc", 'tmca.dbd.load_problem("problem.nc")'),
        _XARRAY.format("recovery.nc") + " `tmca dbd solve --csv paths.csv` writes the paths as a table.",
    ),
    Kind(
        "Exported decoder",
        "A decoder as a program of its own, beside a camera: `decoder.pt2` (`torch.export`) and "
        "`decoder.onnx`, and `decoder.json`, which says what goes in and what "
        "comes out. Such a program is code: open only files that you trust.",
        {"decoder/decoder.json": "`decoder.json`"},
        ("tmca decoder export run --out decoder", 'tmca.lab.deploy.export_decoder("run", "decoder")'),
        (
            "tmca reconstruct spectral.nc -d decoder/decoder.pt2",
            'tmca.lab.loading.load_exported("decoder/decoder.pt2")',
        ),
        '`torch.export.load("decoder.pt2").module()` needs torch alone; '
        '`onnxruntime.InferenceSession("decoder.onnx")` needs no torch.',
        _DECODER,
    ),
)
