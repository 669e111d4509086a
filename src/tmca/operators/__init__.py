"""Linear maps from scene to snapshot, with adjoint and pseudo-inverse."""
