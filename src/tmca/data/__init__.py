"""Reading and writing files, data sets, splits and rendered scenes."""

from tmca.data.rendering import rendered_names, rendered_scene, split_rendered

__all__ = ["rendered_names", "rendered_scene", "split_rendered"]
