"""The commands and where each one lives; none is imported before it is asked for."""

from __future__ import annotations

from typing import Any

from cyclopts import App, Parameter

from tmca import __version__

COMMANDS = {
    "demo": ("demo:demo", "Rendered scenes through a static and a time-multiplexed camera and back, with a report."),
    "render": ("render:render", "Write a rendered scene with its depth, or a light field, to a file."),
    "inspect": ("inspect:inspect", "Say what a file holds: cube, light field, capture, codes, prior."),
    "view": ("view:view", "Look at files in a browser: bands, spectra, errors, codes, views, depth."),
    "import": ("lab.import_capture:app", "Make a snapshot file of a real capture, with its mask, levels and noise."),
    "simulate": ("simulate:app", "Take a coded snapshot of a scene."),
    "reconstruct": ("reconstruct:app", "Recover the scene from a snapshot file."),
    "refocus": ("refocus:refocus", "Focus a light field after the exposure: photographs, a sweep, all in focus."),
    "point-cloud": ("point_cloud:point_cloud", "A scene with depth as coloured points (PLY)."),
    "decoders": ("decoders:decoders", "List the decoders of every camera, the priors they need and their settings."),
    "evaluate": ("evaluate:app", "Compare an estimate with the truth, by every metric."),
    "train": ("train:app", "Learn a camera's codes and its decoder together, or fine-tune on captures."),
    "compare": ("compare:app", "A table of codes, noises and decoders over a list of test scenes."),
    "sweep": ("sweep:app", "Every combination of some settings, over test scenes."),
    "study": ("study:study", "Codes, noises, decoders and seeds of a YAML file: a comparison of your own."),
    "design": ("design:app", "Find codes for a sensor, and say what they gain before anything is built."),
    "export": ("lab.export:app", "Codes as files that devices show: DMD, LCoS, deformable mirror, shutter."),
    "capture": ("lab.capture:app", "Show an export on a bench, simulated or real, and join frames into a snapshot."),
    "live": ("lab.live:app", "Decode what a bench captures as it comes: in the terminal, in a browser, recorded."),
    "scan": (
        "lab.scan:app",
        "Ground truth on the table: depth by fringes, spectra by a tunable source, both as one scene.",
    ),
    "calibrate": ("lab.calibrate:app", "From captures to a dated calibration of a coded camera, step by step."),
    "real": ("lab.real:app", "Real captures: mask in register, frames behind a pixel shutter, a report of all."),
    "decoder": ("lab.decoder:app", "Trained decoders as files that need no tmca: torch.export and ONNX."),
    "dbd": ("dbd:app", "Radar targets and radio paths from one overlaid signal."),
    "prior": ("prior:app", "Learn, show and judge codes by a Gaussian prior of scene blocks."),
}


def _shown(default: Any) -> str | None:
    """A default on a help page; what is off, or nothing, is not shown."""
    several = isinstance(default, list | tuple)
    return None if default in (None, False, "") else ",".join(map(str, default)) if several else str(default)


app = App(
    name="tmca",
    help="Time-multiplexed coded aperture cameras: simulate, reconstruct, compare.",
    version=__version__,
    default_parameter=Parameter(negative_bool="", negative_iterable="", show_default=_shown),
    suppress_keyboard_interrupt=False,
    help_epilogue="Start with `tmca demo`. --help explains a command on a screen, --help-all every option.",
)
app.register_install_completion_command(help="Completion of commands and options for bash, zsh or fish.")
for name, (target, text) in COMMANDS.items():
    app.command(f"tmca.cli.{target}", name=name, help=text)
