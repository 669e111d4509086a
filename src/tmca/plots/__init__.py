"""Pictures from arrays: they know no camera."""
