"""``tmca point-cloud``: a scene with depth as coloured points."""

from __future__ import annotations

from pathlib import Path

from tmca.cli.options.output import Json, Overwrite, say


def point_cloud(
    scene: str,
    /,
    *,
    out: Path | None = None,
    focal: float | None = None,
    confidence: float = 0.0,
    baseline: float | None = None,
    focus: float | None = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Write SCENE as a cloud of coloured points (PLY), which MeshLab, CloudCompare and Blender open.

    Points are in metres before a pinhole camera at the origin: x to the right, y up, the scene at negative z. The
    disparity of a light field needs --focal, --baseline and --focus for it. Depth that was mapped onto the range of a
    camera is mapped back to the metres of the scene.

    Args:
        scene: an estimate, a scene with depth, a light field, or a rendered one such as motorcycle or coffee:1.
        out: .ply file to write; NAME.ply in the current folder without it.
        focal: focal length of the camera in pixels of SCENE; that which SCENE knows without it, or else the width of
            its picture.
        confidence: leave out pixels whose confidence is lower, 0 to 1; how many stay is printed.
        baseline: of a light field, metres between neighbouring views.
        focus: of a light field, metres to the plane in focus, whose disparity is 0.
    """
    from tmca.applications.point_clouds import point_cloud as cloud_of
    from tmca.data import check_target
    from tmca.errors import check_range

    target = out or Path(f"{Path(scene).stem.replace(':', '_')}.ply")
    check_target(target, overwrite)
    check_range("confidence", confidence, 0, 1)
    cloud = cloud_of(scene, focal, confidence, baseline=baseline, focus=focus)
    cloud.save(target, overwrite=overwrite)
    lengths = f"focal length {cloud.focal_px:g} px{cloud.origin}"
    near, far = cloud.distance
    report = {"file": str(target), "points": len(cloud.points), "focal_px": cloud.focal_px, "focal_known": cloud.known,
              "distance": [near, far], "left_out": dict(cloud.left_out)}  # fmt: skip
    say(report, json, f"{target}: {cloud.said}, {near:.3g} to {far:.3g} m away, {lengths}")
