"""The commands and where each one lives; none is imported before it is asked for."""

from __future__ import annotations

from typing import Any

from cyclopts import App, Group, Parameter

from tmca import __version__

GROUPS = {
    "Start": {
        "demo": ("demo:demo", "Rendered scenes through every camera and back, with a report."),
        "view": ("view:view", "Look at files in a browser: bands, spectra, views, depth."),
        "inspect": ("inspect:inspect", "Say what a file holds."),
        "render": ("render:render", "Write a rendered scene, with depth or as a light field."),
    },
    "Cameras": {
        "simulate": ("simulate:app", "Take a coded snapshot of a scene."),
        "reconstruct": ("reconstruct:app", "Recover the scene from a snapshot."),
        "refocus": ("refocus:refocus", "Focus a light field after the exposure."),
        "point-cloud": ("point_cloud:point_cloud", "A scene with depth as coloured points (PLY)."),
        "evaluate": ("evaluate:app", "Compare estimates with the truth, by every metric."),
        "decoders": ("decoders:decoders", "List decoders, the priors they need, their settings."),
        "prior": ("prior:app", "Learn and show a prior of scenes; judge codes by it."),
    },
    "Compare, design, train": {
        "study": ("study:study", "Compare codes and decoders on scenes of your own."),
        "compare": ("compare:app", "The comparison that comes with a camera."),
        "sweep": ("sweep:app", "Every combination of some settings, over test scenes."),
        "design": ("design:app", "Find codes for a sensor, and say what they gain."),
        "train": ("train:app", "Learn codes and decoder together, or fine-tune."),
        "decoder": ("lab.decoder:app", "Trained decoders as files: torch.export and ONNX."),
        "new": ("new:new", "Begin a camera, decoder or driver of your own."),
    },
    "On the bench": {
        "export": ("lab.export:app", "Codes as files that DMD, LCoS and shutters show."),
        "capture": ("lab.capture:app", "Show an export, join the frames into a snapshot."),
        "calibrate": ("lab.calibrate:app", "From captures to a dated calibration of a camera."),
        "live": ("lab.live:app", "Decode what a bench captures as it comes."),
        "import": ("lab.import_capture:app", "Make a snapshot file of a real capture."),
        "real": ("lab.real:app", "Masks of real captures in register; a report of all."),
        "scan": ("lab.scan:app", "Ground truth on the table: depth and spectra."),
    },
    "Radar and radio": {
        "dbd": ("dbd:app", "Radar targets and radio paths from one signal."),
    },
}
"""Commands by what they are for, most used first: where each one lives, and its line of the help."""
COMMANDS = {name: command for commands in GROUPS.values() for name, command in commands.items()}
GUIDE = """\
tmca simulates, designs and decodes coded cameras: one snapshot becomes a
spectral cube, a light field, or a cube with depth.

  tmca demo                        every camera on rendered scenes, a report
  tmca simulate spectral coffee    a snapshot of a scene: a name, or a file
  tmca reconstruct coffee_snapshot.nc --truth coffee
  tmca view coffee_lmmse.nc --truth coffee   the estimate beside the truth
  tmca study coffee --codes cassi,two-bucket       which code is better here

  tmca --help                      all commands
  tmca COMMAND --help              one command, its most used options first
"""


def _shown(default: Any) -> str | None:
    """A default on a help page; what is off, or nothing, is not shown."""
    several = isinstance(default, list | tuple)
    return None if default in (None, False, "") else ",".join(map(str, default)) if several else str(default)


app = App(
    name="tmca",
    help="Time-multiplexed coded aperture cameras: simulate, reconstruct, compare.",
    version=__version__,
    version_flags=("--version", "-V"),
    default_parameter=Parameter(negative_bool="", negative_iterable="", show_default=_shown),
    suppress_keyboard_interrupt=False,
    help_epilogue="--help explains a command on a screen, --help-all every option.",
)
for _place, (_title, _commands) in enumerate(GROUPS.items()):
    _group = Group(_title, sort_key=_place)
    for _rank, (_name, (_target, _text)) in enumerate(_commands.items()):
        app.command(f"tmca.cli.{_target}", name=_name, help=_text, group=_group, sort_key=_rank)
app.register_install_completion_command(help="Completion for bash, zsh or fish.")
app["--install-completion"].group = app["--version"].group = Group("More", sort_key=len(GROUPS))
app["--help"].show = False
