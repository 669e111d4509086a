"""Reading and writing files, data sets, splits and rendered scenes."""

from tmca.data.atomic import atomic_path, check_target
from tmca.data.cubes import Negative, label, read
from tmca.data.depth_maps import label_depth, read_depth_map
from tmca.data.depth_scenes import load_spectral_depth
from tmca.data.describe import describe, view_shifts
from tmca.data.files import (
    content_digest,
    plain,
    read_attributes,
    read_dataset,
    tiff_bytes,
    write_dataset,
    write_json,
    write_text,
    write_tiff,
)
from tmca.data.fitting import at_bands, fitted_depth, nearest_bands, select_bands
from tmca.data.folders import check_folder, held_folder, make_folder
from tmca.data.formats.opening import read_array
from tmca.data.formats.stored import Contents, Stored, from_array, reads
from tmca.data.formats.wavelengths import KNOWN_SETS, KnownSet, metres_to_nm, nm_to_metres
from tmca.data.light_field_scenes import load_light_field
from tmca.data.light_fields import (
    ESTIMATED,
    find_disparity,
    label_light_field,
    read_disparity,
    read_light_field,
    write_light_field,
)
from tmca.data.rendered_folders import render_folder
from tmca.data.rendering import (
    rendered_light_field,
    rendered_names,
    rendered_scene,
    spectral_from_rgb,
    split_rendered,
    split_rendered_light_fields,
)
from tmca.data.rgbd import holds_rgbd, read_rgbd, refuse_rgbd, rgbd_sources
from tmca.data.scene_names import checksum_of, identity_of, read_split, write_split
from tmca.data.scenes import load_scene, read_scene
from tmca.data.spectral_depth import label_spectral_depth, place_cube, read_spectral_depth

__all__ = [
    "ESTIMATED",
    "KNOWN_SETS",
    "Contents",
    "KnownSet",
    "Negative",
    "Stored",
    "at_bands",
    "atomic_path",
    "check_folder",
    "check_target",
    "checksum_of",
    "content_digest",
    "describe",
    "find_disparity",
    "fitted_depth",
    "from_array",
    "held_folder",
    "holds_rgbd",
    "identity_of",
    "label",
    "label_depth",
    "label_light_field",
    "label_spectral_depth",
    "load_light_field",
    "load_scene",
    "load_spectral_depth",
    "make_folder",
    "metres_to_nm",
    "nearest_bands",
    "nm_to_metres",
    "place_cube",
    "plain",
    "read",
    "read_array",
    "read_attributes",
    "read_dataset",
    "read_depth_map",
    "read_disparity",
    "read_light_field",
    "read_rgbd",
    "read_scene",
    "read_spectral_depth",
    "read_split",
    "reads",
    "refuse_rgbd",
    "render_folder",
    "rendered_light_field",
    "rendered_names",
    "rendered_scene",
    "rgbd_sources",
    "select_bands",
    "spectral_from_rgb",
    "split_rendered",
    "split_rendered_light_fields",
    "tiff_bytes",
    "view_shifts",
    "write_dataset",
    "write_json",
    "write_light_field",
    "write_split",
    "write_text",
    "write_tiff",
]


def __dir__() -> list[str]:
    return sorted(__all__)
