"""Files of the bench: calibrations, manifests, captures, devices, exported decoders."""
