"""Settings that people write: YAML of studies, training, masks and sensors; folders of runs."""
