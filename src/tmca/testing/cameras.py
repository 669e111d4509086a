"""What every camera holds to."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import Camera, Snapshot
from tmca.decoders import make_decoder
from tmca.errors import SettingError, ShapeError
from tmca.sensor import Sensor
from tmca.testing.comparing import Loop, close, drawn, refused, run, same_shape, say
from tmca.testing.operators import check_operator

_NOISE = 0.1


@dataclass(frozen=True)
class CameraCase:
    """A camera under test.

    Args:
        camera: a small one without noise.
        depth: (2, 1, H, W) metres, of a camera that images it.
    """

    camera: Any
    depth: Tensor | None = None

    def given(self, camera: Any = None, batch: int = 2) -> tuple[Tensor, ...]:
        """A scene, and its depth where the camera images it, in the precision and on the device of a camera."""
        camera = self.camera if camera is None else camera
        held = next((one for one in camera.buffers() if one.is_floating_point()), torch.zeros(0))
        scene = drawn(batch, *self.camera.scene_shape, dtype=held.dtype, device=held.device)
        return (scene,) if self.depth is None else (scene, self.depth[:batch].to(scene))


def case_of(camera: Any, depth: Tensor | None = None) -> CameraCase:
    """A camera under test; one with planes of depth images a depth that is drawn between them."""
    planes = getattr(camera, "planes", None)
    if depth is None and camera.psf_window is not None and planes is not None:
        far, near = 1 / planes.far, 1 / planes.near
        share = drawn(2, 1, *camera.size, dtype=torch.float32, device=torch.device("cpu"))
        depth = 1 / (far + (near - far) * share)
    return CameraCase(camera, depth)


def check_camera(camera: Camera, *, depth: Tensor | None = None, loop: Loop | None = None) -> None:
    """Check what a camera does: shapes, noise, light, transpose, files, parts that are replaced, refusals, devices.

    Its operator is checked by `check_operator` too.

    Args:
        camera: a small one without noise, of odd sides at best.
        depth: (2, 1, H, W) metres of a camera that images depth; without, some between its ``planes``.
        loop: a slow and plain image of one scene (*scene_shape), which ``A`` is compared with.

    Raises:
        AssertionError: one line: what does not hold.
    """
    name, case = type(camera).__name__, case_of(camera, depth)
    run(CHECKS, case, name)
    if case.depth is None:
        check_operator(camera.operator())
    if loop is not None:
        run([is_its_slow_loop(loop)], case, name)


def is_its_slow_loop(loop: Loop) -> Callable[[CameraCase], None]:
    """The check that ``A`` of a batch of two is what a loop makes of each scene."""

    def A_is_its_slow_loop(case: CameraCase) -> None:
        scene, *depth = case.given()
        slow = torch.stack([loop(one) for one in scene]).to(scene)
        close(case.camera.A(scene, *depth), slow, "A", rtol=1e-4, atol=1e-5)

    return A_is_its_slow_loop


def a_snapshot_has_the_stated_shape_and_a_batch_is_taken_one_by_one(case: CameraCase) -> None:
    """Shapes are the stated ones, and every channel has a name."""
    given = case.given()
    together = case.camera(*given)
    same_shape(together.shape, (2, *case.camera.snapshot_shape), "a snapshot of two scenes")
    alone = torch.cat([case.camera(*(part[i : i + 1] for part in given)) for i in range(2)])
    close(together, alone, "snapshots together, and one by one,", atol=1e-6, rtol=1e-5)
    named, channels = len(case.camera.channel_names), given[0].flatten(1, -3).shape[1]
    say(named == channels, f"{named} channel_names of {channels} channels")


def noise_repeats_by_seed_and_comes_after_the_optics(case: CameraCase) -> None:
    """Equal seeds give equal noise, as strong as the sensor's."""
    given, camera = case.given(), case.camera.replace(sensor=Sensor(read_noise=_NOISE))
    same = torch.equal(camera(*given, generator=3), camera(*given, generator=3))
    say(same, "two snapshots of one seed differ")
    level = float((camera(*given, generator=3) - camera.exact(*given)).std())
    say(abs(level - _NOISE) < 0.4 * _NOISE, f"noise of {level:.2g} by a sensor with a read noise of {_NOISE:g}")


def a_dark_scene_is_dark_and_a_white_one_stays_below_full_scale(case: CameraCase) -> None:
    """``white`` is the most that a pixel gets, and ``throughput`` a share."""
    camera, (scene, *depth) = case.camera, case.given()
    dark = float(camera(torch.zeros_like(scene), *depth).abs().max())
    say(dark < 1e-6, f"a dark scene gives {dark:.2g}")
    white = float(camera(torch.ones_like(scene), *depth).max())
    limit = camera.full_scale
    say(0 < white <= limit * (1 + 1e-4), f"a white scene gives {white:.4g}, full scale (white) is {limit:.4g}")
    say(0 < camera.throughput() <= 1, f"throughput {camera.throughput():.4g}, expected a share above 0")


def the_adjoint_is_the_transpose_and_imaging_is_linear(case: CameraCase) -> None:
    """In single and in double precision."""
    for camera, rtol in ((case.camera, 1e-4), (deepcopy(case.camera).double(), 1e-6)):
        scene, *depth = case.given(camera)
        snapshot = drawn(2, *camera.snapshot_shape, dtype=scene.dtype, device=scene.device)
        image = camera.A(scene, *depth)
        say(image.dtype == scene.dtype, f"a scene of {scene.dtype} becomes a snapshot of {image.dtype}")
        there, back = (image * snapshot).sum(), (scene * camera.A_adjoint(snapshot, *depth)).sum()
        same = bool(abs(there - back) <= rtol * abs(there))
        say(same, f"⟨A x, y⟩ is {float(there):.6g}, ⟨x, A_adjoint y⟩ is {float(back):.6g}")
        close(camera.A(2 * scene, *depth), 2 * image, "A of twice a scene", rtol=1e-4, atol=1e-5)
        close(image, camera.exact(scene, *depth), "A, and exact,", rtol=1e-4, atol=1e-5)


def replacing_nothing_is_the_same_camera_and_a_sensor_leaves_the_first_as_it_is(case: CameraCase) -> None:
    """``replace`` makes cameras of the arguments of the constructor."""
    camera, given = case.camera, case.given()
    before = camera(*given)
    close(camera.replace()(*given), before, "the camera of replace()", rtol=1e-6, atol=1e-6)
    noisy = camera.replace(sensor=Sensor(read_noise=2 * _NOISE))
    say(camera.noise.read == 0 < noisy.noise.read, "replace(sensor=…) changes the first camera, or not the second")
    close(noisy.exact(*given), camera.exact(*given), "exact with another sensor", rtol=1e-6, atol=1e-6)
    refused(lambda: camera.replace(nonsense=1), SettingError, "replace(nonsense=1)")


def it_comes_back_from_its_file(case: CameraCase) -> None:
    """A snapshot that is written is read as it was, and its camera images as it did."""
    camera, given = case.camera, case.given(batch=1)
    taken = Snapshot(camera(*given), camera, {"scene": "random"})
    with TemporaryDirectory() as folder:
        again = Snapshot.load(taken.save(Path(folder) / "s.nc"))
    close(again.values, taken.values, "the snapshot of a file", rtol=0, atol=0)
    close(again.camera.exact(*given), camera.exact(*given), "exact of the camera of a file", rtol=1e-5, atol=1e-5)
    say(again.camera.snapshot_axes(again.values) == camera.snapshot_axes(taken.values), "snapshot_axes differ")


def what_does_not_fit_is_refused_in_a_line(case: CameraCase) -> None:
    """Scenes of another size, and snapshots of another number of channels."""
    camera, (scene, *depth) = case.camera, case.given()
    refused(lambda: camera(scene[..., :-1], *depth), ShapeError, "a scene with a column less")
    channels, height, width = camera.snapshot_shape
    for shape in ((7 * channels, height, width), (channels, height + 1, width)):
        snapshot = torch.ones(1, *shape).to(scene)
        more = [part[:1] for part in depth]
        refused(lambda one=snapshot, more=more: camera.A_adjoint(one, *more), ShapeError, f"a snapshot {shape}")  # type: ignore[misc]


def scenes_are_labelled(case: CameraCase) -> None:
    """``label`` keeps the axes of a scene, those of length one left out or not."""
    labelled = case.camera.label(case.given(batch=1)[0], "a scene")
    found, expected = ([side for side in shape if side > 1] for shape in (labelled.shape, case.camera.scene_shape))
    same_shape(found, expected, "a labelled scene")
    say(labelled.attrs.get("long_name") == "a scene", "label leaves its name out of the attribute long_name")


def a_snapshot_says_in_a_few_lines_what_it_is(case: CameraCase) -> None:
    """The text of snapshot and camera."""
    said = repr(Snapshot(case.camera(*case.given(batch=1)), case.camera))
    say(len(said.splitlines()) <= 6 and case.camera.kind in said, f"a snapshot is said to be {said!r}")
    say(f"buckets: {case.camera.buckets}" in repr(case.camera), "repr of the camera leaves its buckets out")


def decoders_that_it_names_are_there(case: CameraCase) -> None:
    """Every name in ``decoders`` is one of a decoder that can decode it."""
    for name in case.camera.decoders:
        make_decoder(name, case.camera.kind)


def a_graphics_processor_images_alike(case: CameraCase) -> None:
    """Where there is one."""
    if torch.cuda.is_available():
        camera = deepcopy(case.camera).cuda()
        there, here = camera(*case.given(camera)), case.camera(*case.given())
        close(there.cpu(), here, "a snapshot of a CUDA device", rtol=1e-4, atol=1e-4)


CHECKS = (
    a_snapshot_has_the_stated_shape_and_a_batch_is_taken_one_by_one,
    noise_repeats_by_seed_and_comes_after_the_optics,
    a_dark_scene_is_dark_and_a_white_one_stays_below_full_scale,
    the_adjoint_is_the_transpose_and_imaging_is_linear,
    replacing_nothing_is_the_same_camera_and_a_sensor_leaves_the_first_as_it_is,
    it_comes_back_from_its_file,
    what_does_not_fit_is_refused_in_a_line,
    scenes_are_labelled,
    a_snapshot_says_in_a_few_lines_what_it_is,
    decoders_that_it_names_are_there,
    a_graphics_processor_images_alike,
)
