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
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Write SCENE as a cloud of coloured points (PLY), which MeshLab, CloudCompare and Blender open.

    Points are in metres before a pinhole camera at the origin: x to the right, y up, the scene along -z.

    Args:
        scene: an estimate by the spectral-depth camera, a scene with depth, or a rendered one such as motorcycle.
        out: .ply file to write; NAME.ply in the current folder without it.
        focal: focal length of the camera in pixels of SCENE; that which SCENE knows without it, or else the width of
            its picture.
        confidence: leave out pixels whose confidence is lower, 0 to 1.
    """
    from tmca.applications.point_clouds import point_cloud as cloud_of
    from tmca.data import check_target
    from tmca.errors import check_range

    target = out or Path(f"{Path(scene).stem}.ply")
    check_target(target, overwrite)
    check_range("confidence", confidence, 0, 1)
    cloud = cloud_of(scene, focal, confidence)
    origin = "" if cloud.known else ", as wide as the picture, since the camera's is not known (--focal)"
    cloud.save(target, overwrite=overwrite)
    report = {"file": str(target), "points": len(cloud.points), "focal_px": cloud.focal_px, "focal_known": cloud.known}
    say(report, json, f"{target}: {len(cloud.points)} points, focal length {cloud.focal_px:g} px{origin}")
